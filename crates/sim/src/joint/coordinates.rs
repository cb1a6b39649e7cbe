//! Coordinates of a joint and their rows of J, in space and in `f64`. The plane is the plane of x
//! and y.
//!
//! With the position p and the rotation R of frame a in frame b, x the x axis of b and e = R x that
//! of a, the rates of the coordinates are
//!
//! ```text
//! linear      dp/dt     = v_a(x_a) - v_b(x_a)            both bodies at the origin of frame a
//! twist       dq/dt     = omega . (x + e) / (1 + x . e)  omega: rotation of a relative to b
//! swing       dq/dt     = 2 (c de_m/dt - e_m dc/dt) / (c^2 + e_m^2)   c = 1 + x . e,  m: the other
//!                                                        axis of b,  de/dt = omega x e
//! cone        dq/dt     = omega . (x x e) / sin q
//! ```
//!
//! The rows follow from them by the arms from the centers of mass.

use std::cell::OnceCell;

use drystone_solver::{Vector, Velocity};

use super::Coordinate;

pub(crate) type Vec3 = Vector<f64, 3>;

/// A unit quaternion x, y, z, w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Turn(pub(crate) [f64; 4]);

impl Turn {
    pub(crate) const NONE: Self = Self([0.0, 0.0, 0.0, 1.0]);

    /// Returns a unit quaternion along these numbers.
    pub(crate) fn normalized(numbers: [f64; 4]) -> Self {
        let length = numbers.iter().map(|x| x * x).sum::<f64>().sqrt();
        Self(numbers.map(|x| x / length))
    }

    /// Returns the rotation by a rotation vector. \[rad\]
    pub(crate) fn by(vector: Vec3) -> Self {
        let angle = vector.length();
        if angle < 1e-4 {
            // sin(x/2)/x and cos(x/2) to the fifth order.
            let squared = angle * angle;
            let half = vector * (0.5 - squared / 48.0);
            let w = 1.0 - squared / 8.0 + squared * squared / 384.0;
            return Self::normalized([half[0], half[1], half[2], w]);
        }
        let axis = vector * (libm::sin(0.5 * angle) / angle);
        Self([axis[0], axis[1], axis[2], libm::cos(0.5 * angle)])
    }

    fn axis(&self) -> Vec3 {
        Vector([self.0[0], self.0[1], self.0[2]])
    }

    /// Returns the rotation by `other`, then by this one.
    #[inline(always)]
    pub(crate) fn of(&self, other: &Self) -> Self {
        let (p, q) = (self.axis(), other.axis());
        let (v, w) = (self.0[3], other.0[3]);
        let axis = q * v + p * w + cross(p, q);
        Self([axis[0], axis[1], axis[2], v * w - p.dot(q)])
    }

    pub(crate) fn inverse(&self) -> Self {
        let [x, y, z, w] = self.0;
        Self([-x, -y, -z, w])
    }

    /// Rotates a vector.
    #[inline(always)]
    pub(crate) fn rotate(&self, vector: Vec3) -> Vec3 {
        let axis = self.axis();
        let twice = cross(axis, vector) * 2.0;
        vector + twice * self.0[3] + cross(axis, twice)
    }

    /// Returns the rotation vector of the smaller angle. \[rad\]
    pub(crate) fn vector(&self) -> Vec3 {
        let sign = if self.0[3] < 0.0 { -1.0 } else { 1.0 };
        let sine = self.axis() * sign;
        let length = sine.length();
        let scale =
            if length > 1e-9 { 2.0 * libm::atan2(length, self.0[3] * sign) / length } else { 2.0 };
        sine * scale
    }
}

pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    Vector([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
}

/// Position and rotation of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub(crate) position: Vec3,
    pub(crate) turn: Turn,
}

impl Place {
    pub(crate) const ORIGIN: Self = Self { position: Vector([0.0; 3]), turn: Turn::NONE };

    /// Returns the world frame of `local`, which is given in this one.
    #[inline(always)]
    pub(crate) fn of(&self, local: &Self) -> Self {
        Self {
            position: self.position + self.turn.rotate(local.position),
            turn: self.turn.of(&local.turn),
        }
    }

    /// Returns a world frame in the coordinates of this one.
    #[inline(always)]
    pub(crate) fn local(&self, world: &Self) -> Self {
        let back = self.turn.inverse();
        Self { position: back.rotate(world.position - self.position), turn: back.of(&world.turn) }
    }
}

/// Returns the numbers of a rotation that takes the x axis to a direction ([`Geometry::pose`]).
///
/// [`Geometry::pose`]: crate::geometry::Geometry::pose
pub(crate) fn towards<const L: usize, const A: usize>(axis: [f32; L]) -> Vec<f32> {
    let mut to = [0.0; 3];
    to.iter_mut().zip(axis).for_each(|(to, own)| *to = f64::from(own));
    let length = Vector(to).length();
    match A {
        1 => vec![libm::atan2(to[1], to[0]) as f32],
        3 => {
            let [x, y, z] = to.map(|own| own / length);
            // Half of the way from x to the axis; half a turn about z if it points backwards.
            let half = if x > -1.0 + 1e-9 { [0.0, -z, y, 1.0 + x] } else { [0.0, 0.0, 1.0, 0.0] };
            Turn::normalized(half).0.map(|own| own as f32).to_vec()
        }
        _ => Vec::new(),
    }
}

/// Coordinate of a row. Locks of rotation use components of rotation vectors, which have no
/// singular value near zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RowCoordinate {
    Of(Coordinate),
    /// Component of the rotation vector in frame b. Exact where the others are locked to zero.
    RotationVector(usize),
    /// Component of the rotation vector of the swing in frame b. Exact where both are locked to
    /// zero.
    SwingVector(usize),
    /// Sine of a swing: how far the x axis of a leans along an axis of b. It holds the two at right
    /// angles, without a singular place.
    Lean(usize),
    /// An elliptic cone times its smaller half-angle: it moves as far as angles do. \[rad\]
    Ellipse([f64; 2]),
}

impl RowCoordinate {
    /// Returns true if it is an angle.
    pub(crate) fn is_angle(&self) -> bool {
        match self {
            Self::Of(coordinate) => coordinate.is_angle(),
            Self::RotationVector(_) | Self::SwingVector(_) | Self::Lean(_) | Self::Ellipse(_) => {
                true
            }
        }
    }
}

/// The frames of a joint when its bodies were joined, and the axis of its gears.
///
/// Gears count how far bodies spin about their own axes, the integral of omega . axis. A twist between two
/// rotations has no value where the axis is turned back. So the frames from which gears count
/// [follow](JointPlaces::unspun) the axes.
#[derive(Clone, Debug)]
pub(crate) struct JointOrigin {
    /// Frames a and b in the world when the bodies were joined.
    pub(crate) start: [Place; 2],
    /// Axis of the frames about which gears and pinions turn: x, or z in the plane.
    pub(crate) gear_axis: Vec3,
}

/// The frames of a joint in the world, and the centers of mass of its bodies.
#[derive(Clone, Debug)]
pub(crate) struct JointPlaces<'a> {
    /// Frames a and b.
    pub(crate) frames: [Place; 2],
    /// Centers of mass of a and b. \[m\]
    pub(crate) centers: [Vec3; 2],
    origin: &'a JointOrigin,
    /// Frame a in frame b.
    relative: Place,
    /// Its rotation vector, and that of its swing, once a row has asked for them. \[rad\]
    rotation: OnceCell<Vec3>,
    swing: OnceCell<Vec3>,
}

/// Value of a coordinate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reading {
    /// q, without the turns of its angles. \[m, or rad\]
    pub(crate) value: f64,
    /// Angles in q that count turns, each with its share: dq = share d(angle). \[rad, 1 or m/rad\]
    pub(crate) angles: [[f64; 2]; 2],
}

/// A coordinate and its row of J.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Evaluated {
    pub(crate) reading: Reading,
    /// J_a and J_b.
    pub(crate) rows: [Velocity<f64, 3, 3>; 2],
}

impl Reading {
    /// Returns q with the turns that take its angles next to those before, and these angles.
    #[inline(always)]
    pub(crate) fn turned(&self, before: &[f64; 2]) -> (f64, [f64; 2]) {
        if self.angles == [[0.0; 2]; 2] {
            return (self.value, [0.0; 2]);
        }
        let mut value = self.value;
        let angles = [0, 1].map(|i: usize| {
            let [angle, share] = self.angles[i];
            let turned = nearest(angle, before[i], std::f64::consts::TAU);
            value += share * (turned - angle);
            turned
        });
        (value, angles)
    }
}

/// A wrench in frame b that acts at the origin of frame a.
#[derive(Clone, Copy, Debug)]
struct Wrench {
    linear: Vec3,
    angular: Vec3,
}

const X: Vec3 = Vector([1.0, 0.0, 0.0]);
const Z: Vec3 = Vector([0.0, 0.0, 1.0]);

/// Returns the axis of frames about which gears and pinions turn in a space of `dimension`.
pub(crate) fn gear_axis(dimension: usize) -> Vec3 {
    if dimension == 2 { Z } else { X }
}

fn unit(axis: usize) -> Vec3 {
    let mut unit = Vec3::ZERO;
    unit[axis] = 1.0;
    unit
}

fn linear(value: f64, along: Vec3) -> (f64, Wrench) {
    (value, Wrench { linear: along, angular: Vec3::ZERO })
}

fn angular(value: f64, about: Vec3) -> (f64, Wrench) {
    (value, Wrench { linear: Vec3::ZERO, angular: about })
}

/// Below this cosine, sine or length a direction is not defined. \[1\]
const SINGULAR: f64 = 1e-9;

/// Returns the distance and the direction of a vector, or `otherwise` for a vector without one.
fn polar(vector: Vec3, otherwise: Vec3) -> (f64, Vec3) {
    let length = vector.length();
    if length > SINGULAR { (length, vector * (1.0 / length)) } else { (length, otherwise) }
}

impl<'a> JointPlaces<'a> {
    #[inline(always)]
    pub(crate) fn new(frames: [Place; 2], origin: &'a JointOrigin, centers: [Vec3; 2]) -> Self {
        let relative = frames[1].local(&frames[0]);
        let (rotation, swing) = (OnceCell::new(), OnceCell::new());
        Self { frames, origin, centers, relative, rotation, swing }
    }

    /// Returns the axes of frame b in the world.
    #[inline(always)]
    pub(crate) fn axes(&self) -> [Vec3; 3] {
        [0, 1, 2].map(|axis| self.frames[1].turn.rotate(unit(axis)))
    }

    /// Reads a coordinate.
    #[inline(always)]
    pub(crate) fn read(&self, coordinate: &RowCoordinate) -> Reading {
        match self.evaluate_in_world(coordinate) {
            Some(of_two) => of_two.reading,
            None => self.measure(coordinate).0,
        }
    }

    /// Evaluates a coordinate and its row, with the [axes](Self::axes) of frame b.
    #[inline(always)]
    pub(crate) fn evaluate(&self, coordinate: &RowCoordinate, axes: &[Vec3; 3]) -> Evaluated {
        if let Some(of_two) = self.evaluate_in_world(coordinate) {
            return of_two;
        }
        let (reading, Wrench { linear, angular }) = self.measure(coordinate);
        let a = &self.frames[0];
        let in_world = |own: Vec3| axes[0] * own[0] + axes[1] * own[1] + axes[2] * own[2];
        let (linear, angular) = (in_world(linear), in_world(angular));
        let momentum = |center: Vec3, sign: f64| Velocity {
            linear: linear * sign,
            angular: (angular + cross(a.position - center, linear)) * sign,
        };
        let rows = [momentum(self.centers[0], 1.0), momentum(self.centers[1], -1.0)];
        Evaluated { reading, rows }
    }

    /// Returns the rotations of both frames without their spin about the axis of gears since the start.
    pub(crate) fn unspun(&self) -> [Turn; 2] {
        let JointOrigin { start, gear_axis } = self.origin;
        [0, 1].map(|side: usize| {
            let turn = &self.frames[side].turn;
            let (angle, _) = twist(&start[side].turn.inverse().of(turn), *gear_axis);
            turn.of(&Turn::by(*gear_axis * -angle))
        })
    }

    /// Measures a coordinate of frame a in frame b.
    #[inline(always)]
    fn measure(&self, coordinate: &RowCoordinate) -> (Reading, Wrench) {
        let relative = &self.relative;
        let (value, wrench) = match coordinate {
            RowCoordinate::Of(coordinate) => of_relative(coordinate, relative),
            RowCoordinate::RotationVector(axis) => {
                let vector = self.rotation.get_or_init(|| relative.turn.vector());
                angular(vector[*axis], unit(*axis))
            }
            RowCoordinate::SwingVector(axis) => {
                let vector = self.swing.get_or_init(|| swing(&relative.turn));
                angular(vector[*axis], unit(*axis))
            }
            RowCoordinate::Ellipse(angles) => {
                let own = Coordinate::EllipticCone(*angles);
                let (value, about) = of_direction(&own, relative.turn.rotate(X));
                let size = smaller(angles);
                angular(value * size, about.angular * size)
            }
            RowCoordinate::Lean(about) => {
                let (along, sign) = side_of_swing(*about);
                let e = relative.turn.rotate(X);
                angular(e[along] * sign, cross(e, unit(along)) * sign)
            }
        };
        let angles = match coordinate {
            RowCoordinate::Of(Coordinate::Screw { pitch }) => {
                [[twist(&relative.turn, X).0, -pitch / std::f64::consts::TAU], [0.0; 2]]
            }
            RowCoordinate::Of(of) if of.is_angle() => [[value, 1.0], [0.0; 2]],
            _ => [[0.0; 2]; 2],
        };
        (Reading { value, angles }, wrench)
    }

    /// Evaluates a coordinate that measures both bodies against the world; `None` for another one.
    #[inline(always)]
    fn evaluate_in_world(&self, coordinate: &RowCoordinate) -> Option<Evaluated> {
        let RowCoordinate::Of(
            coordinate @ (Coordinate::Gear { .. }
            | Coordinate::Rack { .. }
            | Coordinate::Pulley { .. }),
        ) = coordinate
        else {
            return None;
        };
        let JointOrigin { start, gear_axis } = self.origin;
        let turned = |side: usize| {
            let (frame, start) = (&self.frames[side], &start[side]);
            let turn = start.turn.inverse().of(&frame.turn);
            let (angle, axis) = twist(&turn, *gear_axis);
            (angle, start.turn.rotate(axis))
        };
        let spin = |axis: Vec3| Velocity { linear: Vec3::ZERO, angular: axis };
        let pull = |side: usize, along: Vec3| Velocity {
            linear: along,
            angular: cross(self.frames[side].position - self.centers[side], along),
        };
        let (value, angles, rows) = match coordinate {
            Coordinate::Gear { ratio } => {
                let ((q, axis), (p, other)) = (turned(0), turned(1));
                let angles = [[q, 1.0], [p, *ratio]];
                (q + ratio * p, angles, [spin(axis), spin(other * *ratio)])
            }
            Coordinate::Rack { radius } => {
                let (q, axis) = turned(0);
                let along = start[1].turn.rotate(X);
                let moved = (self.frames[1].position - start[1].position).dot(along);
                let angles = [[q, *radius], [0.0; 2]];
                (q * radius + moved, angles, [spin(axis * *radius), pull(1, along)])
            }
            Coordinate::Pulley { points, ratio } => {
                let rope = |side: usize| {
                    polar(
                        self.frames[side].position - Vector(points[side]),
                        Vector([0.0, -1.0, 0.0]),
                    )
                };
                let ((q, along), (p, other)) = (rope(0), rope(1));
                (q + ratio * p, [[0.0; 2]; 2], [pull(0, along), pull(1, other * *ratio)])
            }
            _ => return None,
        };
        Some(Evaluated { reading: Reading { value, angles }, rows })
    }
}

/// Returns the twist angle of a rotation about a unit vector \[rad\], and the rotation axis of its
/// rate.
#[inline(always)]
fn twist(turn: &Turn, about: Vec3) -> (f64, Vec3) {
    let e = turn.rotate(about);
    let (sine, sum) = (turn.axis().dot(about), about + e);
    (2.0 * libm::atan2(sine, turn.0[3]), sum * (1.0 / (1.0 + about.dot(e)).max(SINGULAR)))
}

/// Returns the rotation vector of the swing of a rotation: of the shortest rotation that takes x to
/// where it is. \[rad\]
fn swing(turn: &Turn) -> Vec3 {
    let e = turn.rotate(X);
    let (sine, axis) = polar(cross(X, e), Z);
    axis * libm::atan2(sine, X.dot(e))
}

/// Returns the smaller half-angle of an elliptic cone. \[rad\]
pub(super) fn smaller([y, z]: &[f64; 2]) -> f64 {
    y.min(*z)
}

/// Evaluates a coordinate of frame a in the coordinates of frame b.
#[inline(always)]
fn of_relative(coordinate: &Coordinate, relative: &Place) -> (f64, Wrench) {
    let Place { position: p, turn } = relative;
    match *coordinate {
        Coordinate::Linear(axis) => linear(p[axis], unit(axis)),
        Coordinate::Radial(axis) => {
            let (value, along) = polar(*p - unit(axis) * p[axis], unit((axis + 1) % 3));
            linear(value, along)
        }
        Coordinate::Distance => {
            let (value, along) = polar(*p, Vector([0.0, -1.0, 0.0]));
            linear(value, along)
        }
        Coordinate::Angle => angular(2.0 * libm::atan2(turn.0[2], turn.0[3]), Z),
        Coordinate::Screw { pitch } => {
            let (angle, axis) = twist(turn, X);
            let per_radian = -pitch / std::f64::consts::TAU;
            (p[0] + per_radian * angle, Wrench { linear: X, angular: axis * per_radian })
        }
        Coordinate::Twist => {
            let (value, axis) = twist(turn, X);
            angular(value, axis)
        }
        Coordinate::Rotation => {
            let (value, axis) = polar(turn.vector(), X);
            angular(value, axis)
        }
        Coordinate::Cardan(axis) => cardan(axis, turn),
        ref other => of_direction(other, turn.rotate(X)),
    }
}

/// Returns the axis of b along which the x axis of a goes in a swing, with its sign: about y it falls
/// along z, about z it rises along y.
fn side_of_swing(about: usize) -> (usize, f64) {
    if about == 1 { (2, -1.0) } else { (1, 1.0) }
}

/// Evaluates a coordinate of the direction e of the x axis of frame a in frame b.
#[inline(always)]
fn of_direction(coordinate: &Coordinate, e: Vec3) -> (f64, Wrench) {
    let (sine, axis) = polar(cross(X, e), Z);
    match *coordinate {
        Coordinate::Swing(about) => {
            let (component, sign) = side_of_swing(about);
            let (own, c) = (e[component] * sign, 1.0 + e[0]);
            let rate = cross(e, unit(component)) * (sign * c) - cross(e, X) * own;
            let value = 2.0 * libm::atan2(own, c);
            angular(value, rate * (2.0 / (c * c + own * own).max(SINGULAR)))
        }
        Coordinate::EllipticCone([about_y, about_z]) => {
            let angle = libm::atan2(sine, X.dot(e));
            let s = axis * angle;
            let scaled = Vector([0.0, s[1] / about_y, s[2] / about_z]);
            let value = scaled.length();
            let gradient = Vector([0.0, scaled[1] / about_y, scaled[2] / about_z]);
            // The swing vector changes along its axis, and across it as e circles about x.
            let circling = cross(e, axis) * (gradient.dot(cross(X, axis)) * angle / sine.max(1e-6));
            let about = axis * gradient.dot(axis) + circling;
            angular(value, about * (1.0 / value.max(SINGULAR)))
        }
        _ => angular(libm::atan2(sine, X.dot(e)), axis),
    }
}

/// Evaluates a Cardan angle: R = R_z(gamma) R_y(beta) R_x(alpha).
#[inline(always)]
fn cardan(axis: usize, turn: &Turn) -> (f64, Wrench) {
    let e = turn.rotate(X);
    let beta = libm::asin((-e[2]).clamp(-1.0, 1.0));
    let cosine = libm::cos(beta).max(1e-6);
    let gamma = libm::atan2(e[1], e[0]);
    let (sin, cos) = (libm::sin(gamma), libm::cos(gamma));
    match axis {
        0 => {
            let [y, z] = [unit(1), Z].map(|of| turn.rotate(of)[2]);
            angular(libm::atan2(y, z), Vector([cos / cosine, sin / cosine, 0.0]))
        }
        1 => angular(beta, Vector([-sin, cos, 0.0])),
        _ => {
            let tangent = libm::sin(beta) / cosine;
            angular(gamma, Vector([tangent * cos, tangent * sin, 1.0]))
        }
    }
}

/// Returns the angle that differs from `angle` by whole turns of `turn` \[rad\], nearest to
/// `before`.
pub(crate) fn nearest(angle: f64, before: f64, turn: f64) -> f64 {
    angle + turn * libm::rint((before - angle) / turn)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COORDINATES: [RowCoordinate; 22] = {
        use Coordinate as C;
        use RowCoordinate::{Ellipse, Lean, Of};
        [
            Lean(1),
            Lean(2),
            Ellipse([0.3, 0.7]),
            Of(C::Linear(0)),
            Of(C::Linear(1)),
            Of(C::Linear(2)),
            Of(C::Radial(0)),
            Of(C::Radial(2)),
            Of(C::Distance),
            Of(C::Twist),
            Of(C::Swing(1)),
            Of(C::Swing(2)),
            Of(C::Cone),
            Of(C::EllipticCone([0.4, 0.9])),
            Of(C::Rotation),
            Of(C::Cardan(0)),
            Of(C::Cardan(1)),
            Of(C::Cardan(2)),
            Of(C::Gear { ratio: -2.5 }),
            Of(C::Rack { radius: 0.3 }),
            Of(C::Screw { pitch: 0.2 }),
            Of(C::Pulley { points: [[1.0, 4.0, 0.5], [-2.0, 5.0, 0.0]], ratio: 2.0 }),
        ]
    };

    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
        }

        fn vector(&mut self, size: f64) -> Vec3 {
            Vector([self.next() * size, self.next() * size, self.next() * size])
        }

        fn place(&mut self) -> Place {
            Place { position: self.vector(1.0), turn: Turn::by(self.vector(1.5)) }
        }
    }

    /// Moves the bodies of a joint by velocities times a time.
    fn moved<'a>(
        at: &JointPlaces<'a>,
        velocities: &[Velocity<f64, 3, 3>; 2],
        time: f64,
    ) -> JointPlaces<'a> {
        let centers = [0, 1].map(|side| at.centers[side] + velocities[side].linear * time);
        let frames = [0, 1].map(|side: usize| {
            let turn = Turn::by(velocities[side].angular * time);
            let arm = at.frames[side].position - at.centers[side];
            let position = centers[side] + turn.rotate(arm);
            Place { position, turn: turn.of(&at.frames[side].turn) }
        });
        JointPlaces::new(frames, at.origin, centers)
    }

    /// The row of each coordinate is its derivative: J v is the change of q along random motions,
    /// by central differences.
    #[test]
    fn rows_are_derivatives() {
        let mut random = Random(7);
        for _ in 0..300 {
            let frames = [random.place(), random.place()];
            let start = [random.place(), random.place()];
            let centers = [0, 1].map(|_| random.vector(1.0));
            let origin = JointOrigin { start, gear_axis: X };
            let at = JointPlaces::new(frames, &origin, centers);
            let velocities = [0, 1]
                .map(|_| Velocity { linear: random.vector(1.0), angular: random.vector(1.0) });
            let e = frames[1].local(&frames[0]).turn.rotate(X);
            for coordinate in &COORDINATES {
                let near = matches!(
                    coordinate,
                    RowCoordinate::Of(Coordinate::Swing(_) | Coordinate::Cardan(_))
                );
                if near && (e[1].abs() > 0.98 || e[2].abs() > 0.98) || X.dot(e) < -0.95 {
                    continue;
                }
                let Evaluated { rows, .. } = at.evaluate(coordinate, &at.axes());
                let rate = rows[0].dot(&velocities[0]) + rows[1].dot(&velocities[1]);
                let h = 1e-5;
                let [before, after] =
                    [-h, h].map(|time| moved(&at, &velocities, time).read(coordinate));
                let (before, angles) = before.turned(&[0.0; 2]);
                let found = (after.turned(&angles).0 - before) / (2.0 * h);
                let error = (rate - found).abs() / (1.0 + rate.abs());
                assert!(error < 1e-6, "{coordinate:?}: {rate} is {found}");
            }
        }
    }

    /// Rotation vectors are derivatives where they lock: at zero.
    #[test]
    fn locks_of_rotation_are_derivatives_at_zero() {
        let mut random = Random(3);
        for _ in 0..50 {
            let b = random.place();
            let frames = [b, b];
            let centers = [0, 1].map(|_| random.vector(1.0));
            let origin = JointOrigin { start: frames, gear_axis: X };
            let at = JointPlaces::new(frames, &origin, centers);
            let velocities = [0, 1]
                .map(|_| Velocity { linear: random.vector(1.0), angular: random.vector(1.0) });
            for axis in 0..3 {
                for coordinate in
                    [RowCoordinate::RotationVector(axis), RowCoordinate::SwingVector(axis.max(1))]
                {
                    let rows = at.evaluate(&coordinate, &at.axes()).rows;
                    let rate = rows[0].dot(&velocities[0]) + rows[1].dot(&velocities[1]);
                    let h = 1e-6;
                    let [before, after] =
                        [-h, h].map(|time| moved(&at, &velocities, time).read(&coordinate));
                    let found = (after.value - before.value) / (2.0 * h);
                    assert!((rate - found).abs() < 1e-5, "{coordinate:?}: {rate} is {found}");
                }
            }
        }
    }

    #[test]
    fn the_x_axis_points_where_it_is_told() {
        for axis in [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.6, -0.8, 0.0], [1.0, 0.0, 0.0]] {
            let numbers = towards::<3, 3>(axis);
            let turn = Turn::normalized(std::array::from_fn(|i| f64::from(numbers[i])));
            let apart = turn.rotate(X) - Vector(axis.map(f64::from));
            assert!(apart.length() < 1e-6, "{axis:?}: {apart:?}");
        }
    }
}
