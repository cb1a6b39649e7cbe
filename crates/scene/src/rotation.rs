//! [`Rotation`]: how a body or a frame is turned.

use std::array::from_fn;

/// A rotation as written in a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rotation {
    /// Angle in 2D. \[rad\]
    Angle(f64),
    /// Unit quaternion x, y, z, w in 3D.
    Quaternion([f64; 4]),
}

impl Rotation {
    /// Returns the rotation by zero, in 2 or 3 dimensions.
    pub fn identity(dimension: usize) -> Self {
        if dimension == 3 { Self::Quaternion([0.0, 0.0, 0.0, 1.0]) } else { Self::Angle(0.0) }
    }

    /// Returns the rotation as a quaternion x, y, z, w; an angle turns about z.
    pub fn quaternion(self) -> [f64; 4] {
        match self {
            Self::Quaternion(quaternion) => quaternion,
            Self::Angle(angle) => {
                let (sin, cos) = (libm::sin(angle / 2.0), libm::cos(angle / 2.0));
                [0.0, 0.0, sin, cos]
            }
        }
    }

    /// Returns the angle of the rotation from `self` to `other`, by the shorter way for
    /// quaternions. \[rad\]
    pub fn angle_to(&self, other: &Self) -> f64 {
        match (self, other) {
            (Self::Quaternion(p), Self::Quaternion(q)) => {
                let dot: f64 = p.iter().zip(q).map(|(x, y)| x * y).sum();
                2.0 * libm::acos(dot.abs().min(1.0))
            }
            (Self::Angle(a), Self::Angle(b)) => (b - a).abs(),
            _ => 0.0,
        }
    }

    /// Interpolates from `self` (`t` = 0) to `other` (`t` = 1) at constant angular speed.
    /// Quaternions take the shorter way (slerp).
    pub fn towards(&self, other: &Self, t: f64) -> Self {
        match (self, other) {
            (Self::Quaternion(p), Self::Quaternion(q)) => {
                let dot: f64 = p.iter().zip(q).map(|(x, y)| x * y).sum();
                let sign = if dot < 0.0 { -1.0 } else { 1.0 };
                let angle = libm::acos((dot * sign).min(1.0));
                let sine = libm::sin(angle);
                let (from, to) = if sine > 1e-6 {
                    (libm::sin((1.0 - t) * angle) / sine, libm::sin(t * angle) / sine)
                } else {
                    (1.0 - t, t)
                };
                let mixed: [f64; 4] = from_fn(|i| p[i] * from + q[i] * to * sign);
                let length = mixed.iter().map(|x| x * x).sum::<f64>().sqrt();
                Self::Quaternion(mixed.map(|x| x / length))
            }
            (Self::Angle(a), Self::Angle(b)) => Self::Angle(a + (b - a) * t),
            _ => *self,
        }
    }
}
