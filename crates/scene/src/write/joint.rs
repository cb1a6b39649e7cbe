//! Writes joints, all as general ones with frames in their bodies: no number is computed.

use super::defaults::{number_unless, rotation_unless, same, unless};
use crate::description::{Body, Rotation};
use crate::document::joint::{
    AxisDocument, BodyReference, BreakingDocument, CoordinateDocument, DriveDocument,
    EllipticConeDocument, FrameDocument, Freedom, GearDocument, GeneralDocument, JointDocument,
    JointKindDocument, Limit, LimitsDocument, Mode, PlainAxisDocument, PulleyDocument,
    PulleyPointsDocument, RackDocument, ScrewDocument,
};
use crate::document::values::Unbounded;
use crate::format::joint::axis::LOCKED;
use crate::format::joint::coordinate::{default_limits, rank};
use crate::joint::{Breaking, Coordinate, Drive, Joint, JointAxis, JointFrame};

pub(super) fn joint_document(joint: &Joint, all: &[Body], dimension: usize) -> JointDocument {
    let mut general = GeneralDocument::default();
    joint.axes.iter().for_each(|axis| set_axis(&mut general, axis, dimension));
    let is_sorted = joint.axes.is_sorted_by_key(|axis| rank(axis.coordinate));
    let names = || joint.axes.iter().map(|axis| axis.coordinate.name()).collect();
    general.order = (!is_sorted).then(names);
    JointDocument {
        kind: JointKindDocument::General { coordinates: Box::new(general) },
        name: joint.name.clone(),
        bodies: bodies(joint.bodies, all),
        anchors: None,
        frames: Some(joint.frames.iter().map(|frame| frame_document(frame, dimension)).collect()),
        breaking: breaking(joint.breaking),
        collide: joint.collide.then_some(true),
        enabled: (!joint.enabled).then_some(false),
        extras: None,
    }
}

/// Names the bodies; the world comes last, or is -1.
fn bodies(bodies: [Option<usize>; 2], all: &[Body]) -> Vec<BodyReference> {
    let reference = |body: Option<usize>| match body {
        None => BodyReference::Index(-1),
        Some(index) => match all.get(index).and_then(|body| body.name.clone()) {
            Some(name) => BodyReference::Name(name),
            None => BodyReference::Index(index as i64),
        },
    };
    let count = if bodies[1].is_some() { 2 } else { 1 };
    bodies.into_iter().take(count).map(reference).collect()
}

fn frame_document(frame: &JointFrame, dimension: usize) -> FrameDocument {
    FrameDocument {
        position: unless(&frame.position, &vec![0.0; dimension]),
        rotation: rotation_unless(frame.rotation, Rotation::identity(dimension)),
    }
}

fn breaking(loads: Breaking) -> Option<BreakingDocument> {
    let load = |load: Option<f64>| load.map(Unbounded::Number);
    (loads != Breaking::default()).then(|| BreakingDocument {
        force: load(loads.force),
        torque: load(loads.torque),
        impulse: load(loads.impulse),
    })
}

fn set_axis(general: &mut GeneralDocument, axis: &JointAxis, dimension: usize) {
    let table = axis_document(axis);
    let plain = match axis.coordinate {
        Coordinate::Linear(0) => &mut general.x,
        Coordinate::Linear(1) => &mut general.y,
        Coordinate::Linear(_) => &mut general.z,
        Coordinate::Radial(0) => &mut general.radial_x,
        Coordinate::Radial(1) => &mut general.radial_y,
        Coordinate::Radial(_) => &mut general.radial_z,
        Coordinate::Distance => &mut general.distance,
        Coordinate::Angle => &mut general.angle,
        Coordinate::Twist => &mut general.twist,
        Coordinate::Swing(1) => &mut general.swing_y,
        Coordinate::Swing(_) => &mut general.swing_z,
        Coordinate::Cone => &mut general.cone,
        Coordinate::Rotation => &mut general.rotation,
        Coordinate::Cardan(0) => &mut general.angle_x,
        Coordinate::Cardan(1) => &mut general.angle_y,
        Coordinate::Cardan(_) => &mut general.angle_z,
        Coordinate::EllipticCone(half_angles) => {
            general.elliptic_cone = Some(EllipticConeDocument { half_angles, axis: table });
            return;
        }
        Coordinate::Gear { ratio } => {
            general.gear = Some(GearDocument { ratio, axis: table });
            return;
        }
        Coordinate::Rack { radius } => {
            general.rack = Some(RackDocument { radius, axis: table });
            return;
        }
        Coordinate::Screw { pitch } => {
            general.screw = Some(ScrewDocument { pitch, axis: table });
            return;
        }
        Coordinate::Pulley { points, ratio } => {
            let points = points.iter().map(|p| p.iter().take(dimension).copied().collect());
            let points = points.collect();
            let points = PulleyPointsDocument { points, ratio: number_unless(ratio, 1.0) };
            general.pulley = Some(PulleyDocument { points, axis: table });
            return;
        }
    };
    *plain = Some(coordinate_document(axis, table));
}

/// Writes limits alone as such, and anything else as a table.
fn coordinate_document(axis: &JointAxis, table: AxisDocument) -> CoordinateDocument {
    let alone = axis.softness.is_none()
        && axis.drives.is_empty()
        && axis.friction.to_bits() == 0.0_f64.to_bits();
    match table.limits {
        Some(LimitsDocument::Word(word)) if alone => CoordinateDocument::Word(word),
        Some(LimitsDocument::Numbers(limits)) if alone => CoordinateDocument::Limits(limits),
        _ => CoordinateDocument::Table(Box::new(PlainAxisDocument { axis: table })),
    }
}

fn axis_document(axis: &JointAxis) -> AxisDocument {
    let default = default_limits(axis.coordinate);
    let limits = match (axis.limits, default) {
        (None, None) => None,
        (None, Some(_)) => Some(LimitsDocument::Word(Freedom::Free)),
        (Some(limits), Some(default)) if same(&limits, &default) => None,
        (Some(limits), _) if same(&limits, &LOCKED) => Some(LimitsDocument::Word(Freedom::Locked)),
        (Some(limits), _) => Some(LimitsDocument::Numbers(limits.map(Limit::Number))),
    };
    AxisDocument {
        limits,
        limit_stiffness: axis.softness.map(|softness| softness.stiffness),
        limit_damping: axis.softness.map(|softness| softness.damping),
        spring: None,
        motor: None,
        drives: axis.drives.iter().map(drive_document).collect(),
        friction: number_unless(axis.friction, 0.0),
    }
}

fn drive_document(drive: &Drive) -> DriveDocument {
    DriveDocument {
        position: number_unless(drive.position, 0.0),
        velocity: number_unless(drive.velocity, 0.0),
        stiffness: number_unless(drive.stiffness, 0.0),
        damping: number_unless(drive.damping, 0.0).map(Unbounded::Number),
        mode: drive.acceleration.then_some(Mode::Acceleration),
        at_most: number_unless(drive.max_force, f64::INFINITY).map(Unbounded::Number),
    }
}
