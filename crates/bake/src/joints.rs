//! Conversion of a scene's joints to those of a world.

use drystone::geometry::Geometry;
use drystone::{BodyId, Breaking, Coordinate, Drive, Joint, JointAxis, JointFrames, Softness};
use drystone_scene as scene;

use crate::forms::place;

/// Name of a joint, or its index.
pub(crate) fn name(joint: &scene::Joint, index: usize) -> String {
    joint.name.clone().unwrap_or_else(|| format!("joint {index}"))
}

/// Converts a joint of a scene to a joint of a world in which `body` returns the bodies.
pub(crate) fn joint_of<G: Geometry<L, A>, const L: usize, const A: usize>(
    joint: &scene::Joint,
    body: impl Fn(usize) -> Option<BodyId>,
) -> Joint<G, L, A> {
    let frame = |of: &scene::JointFrame| place::<G, L, A>(&of.position, &of.rotation);
    let [a, b] = &joint.frames;
    let most = |load: Option<f64>| load.unwrap_or(f64::INFINITY);
    let scene::Breaking { force, torque, impulse } = joint.breaking;
    Joint {
        bodies: joint.bodies.map(|index| index.and_then(&body)),
        frames: JointFrames::Bodies([frame(a), frame(b)]),
        axes: joint.axes.iter().map(axis).collect(),
        breaking: Breaking { force: most(force), torque: most(torque), impulse: most(impulse) },
        collide: joint.collide,
        enabled: joint.enabled,
        user_data: 0,
    }
}

/// Converts an axis of a joint.
pub fn axis(of: &scene::JointAxis) -> JointAxis {
    JointAxis {
        coordinate: coordinate(&of.coordinate),
        limits: of.limits,
        softness: of
            .softness
            .map(|scene::Softness { stiffness, damping }| Softness { stiffness, damping }),
        drives: of.drives.iter().map(drive).collect(),
        friction: of.friction,
    }
}

/// Converts a spring or a motor.
pub fn drive(of: &scene::Drive) -> Drive {
    let scene::Drive { position, velocity, stiffness, damping, max_force, acceleration } = *of;
    Drive { position, velocity, stiffness, damping, max_force, acceleration }
}

fn coordinate(of: &scene::Coordinate) -> Coordinate {
    match *of {
        scene::Coordinate::Linear(axis) => Coordinate::Linear(axis),
        scene::Coordinate::Radial(axis) => Coordinate::Radial(axis),
        scene::Coordinate::Distance => Coordinate::Distance,
        scene::Coordinate::Angle => Coordinate::Angle,
        scene::Coordinate::Twist => Coordinate::Twist,
        scene::Coordinate::Swing(axis) => Coordinate::Swing(axis),
        scene::Coordinate::Cone => Coordinate::Cone,
        scene::Coordinate::EllipticCone(angles) => Coordinate::EllipticCone(angles),
        scene::Coordinate::Rotation => Coordinate::Rotation,
        scene::Coordinate::Cardan(axis) => Coordinate::Cardan(axis),
        scene::Coordinate::Gear { ratio } => Coordinate::Gear { ratio },
        scene::Coordinate::Rack { radius } => Coordinate::Rack { radius },
        scene::Coordinate::Screw { pitch } => Coordinate::Screw { pitch },
        scene::Coordinate::Pulley { points, ratio } => Coordinate::Pulley { points, ratio },
    }
}
