//! [`Hold`]: a joint that every engine has.

use drystone_scene::{Coordinate, Drive, Joint, JointAxis, JointFrame, Rotation};

/// Kinds of joints that every engine has. Hinges turn about x, sliders move along x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HoldKind {
    Fixed,
    Ball,
    Hinge,
    Slider,
}

/// A velocity that is kept as far as a force allows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motor {
    /// \[m/s, or rad/s\]
    pub(crate) velocity: f64,
    /// \[N, or N m\]
    pub(crate) max_force: f64,
}

/// A joint that every engine has. Its free coordinate is that of the second body relative to the
/// first.
#[derive(Clone, Debug)]
pub(crate) struct Hold {
    pub(crate) kind: HoldKind,
    /// First and second body of a peer; the world if absent.
    pub(crate) bodies: [Option<usize>; 2],
    /// Frame in each.
    pub(crate) frames: [JointFrame; 2],
    /// Limits of the free coordinate of hinges and sliders. \[m, or rad\]
    pub(crate) limits: Option<[f64; 2]>,
    pub(crate) motor: Option<Motor>,
    /// True if the two bodies collide.
    pub(crate) collide: bool,
}

impl Hold {
    /// Reads a joint of a scene.
    ///
    /// # Errors
    /// Not every engine has such a joint.
    pub(crate) fn of(joint: &Joint) -> Result<Self, &'static str> {
        if !joint.enabled || joint.breaking != drystone_scene::Breaking::default() {
            return Err("is disabled or breaks");
        }
        let locked = |axis: &&JointAxis| axis.limits == Some([0.0; 2]) && axis.softness.is_none();
        let (locks, others): (Vec<_>, Vec<_>) = joint.axes.iter().partition(|axis| locked(axis));
        let mut names: Vec<_> = locks.iter().map(|axis| axis.coordinate.name()).collect();
        names.sort_unstable();
        let flat = matches!(joint.frames[0].rotation, Rotation::Angle(_));
        let kind = match (&names[..], flat) {
            (["swing_y", "swing_z", "twist", "x", "y", "z"], false)
            | (["angle", "x", "y"], true) => HoldKind::Fixed,
            (["x", "y", "z"], false) => HoldKind::Ball,
            (["swing_y", "swing_z", "x", "y", "z"], false) | (["x", "y"], true) => HoldKind::Hinge,
            (["swing_y", "swing_z", "twist", "y", "z"], false) | (["angle", "y"], true) => {
                HoldKind::Slider
            }
            _ => return Err("locks what not all engines lock"),
        };
        let free = match kind {
            HoldKind::Hinge if flat => Some(Coordinate::Angle),
            HoldKind::Hinge => Some(Coordinate::Twist),
            HoldKind::Slider => Some(Coordinate::Linear(0)),
            HoldKind::Fixed | HoldKind::Ball => None,
        };
        let (mut limits, mut motor) = (None, None);
        for axis in others {
            if Some(axis.coordinate) != free || axis.softness.is_some() || axis.friction > 0.0 {
                return Err("limits, brakes or softens what not all engines do");
            }
            limits = axis.limits;
            motor = match axis.drives[..] {
                [] => None,
                [Drive { velocity, damping: f64::INFINITY, stiffness: 0.0, max_force, .. }] => {
                    Some(Motor { velocity, max_force })
                }
                _ => return Err("has a spring or a drive that not all engines have"),
            };
        }
        let ([a, b], [frame_a, frame_b]) = (joint.bodies, joint.frames.clone());
        let (bodies, frames) = ([b, a], [frame_b, frame_a]);
        Ok(Self { kind, bodies, frames, limits, motor, collide: joint.collide })
    }
}
