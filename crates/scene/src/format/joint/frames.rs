//! Reads the frames of a joint: as they are in the bodies, or from points and directions in the
//! world at the start.

use std::f64::consts::FRAC_PI_2;

use super::setup::JointSetup;
use crate::description::{Body, Rotation};
use crate::error::SceneError;
use crate::format::cursor::{FieldCursor, Range, TableCursor};
use crate::format::setup::POSITION;
use crate::graph::math::{self, Mat3, Vec3};
use crate::joint::JointFrame;

pub(crate) const FRAME_KEYS: &[&str] = &["position", "rotation"];

/// Keys that place a joint in the world; `frames` takes their place.
const WORLD_KEYS: [&str; 6] = ["anchor", "anchors", "axis", "axis_y", "axes", "suspension"];

/// Frames may lie farther from a body than bodies from the origin.
const FRAME_POSITION: Range = Range::new(-1e7, 1e7, "m");
const FRAME_ANGLE: Range = Range::new(-1e7, 1e7, "rad");
const DIRECTION: Range = Range::new(-1e6, 1e6, "");

/// Largest cosine of two directions that should be perpendicular.
const SKEW: f64 = 1e-3;
/// Distance of two anchors that gives a warning. \[m\]
const APART: f64 = 1e3;

/// Reads the frames of a joint of this type between two bodies.
pub(super) fn read_frames(
    table: &TableCursor<'_>,
    name: &str,
    bodies: [Option<usize>; 2],
    setup: &JointSetup<'_>,
) -> Result<[JointFrame; 2], SceneError> {
    let sides = bodies.map(|body| setup.body(body));
    let Some(field) = table.get("frames") else {
        let [a, b] = read_rotations(table, name, setup)?;
        let [p, q] = read_anchors(table, sides, setup)?;
        let [i, j] = sides;
        return Ok([
            JointFrame { position: p, rotation: rotation_in(i, a) },
            JointFrame { position: q, rotation: rotation_in(j, b) },
        ]);
    };
    let given = WORLD_KEYS.iter().filter(|key| table.knows(key));
    if let Some(other) = given.filter_map(|key| table.get(key)).next() {
        return Err(other.refuse("nothing beside frames, which place the joint in the bodies"));
    }
    let accepted = "a list of 2 frames, in the first body and in the second";
    let mut frames = Vec::new();
    for (i, item) in field.items(accepted)?.enumerate() {
        let owner = table.nested(format!("frame {i}"));
        let frame = item.table(FRAME_KEYS, &owner)?;
        let zero = vec![0.0; setup.dimension];
        let rotation = frame.get("rotation").map(|field| match setup.dimension {
            3 => field.quaternion().map(Rotation::Quaternion),
            _ => field.real(&FRAME_ANGLE).map(Rotation::Angle),
        });
        frames.push(JointFrame {
            position: frame.vector_or("position", &FRAME_POSITION, zero)?,
            rotation: rotation.unwrap_or(Ok(Rotation::identity(setup.dimension)))?,
        });
    }
    frames.try_into().map_err(|frames: Vec<_>| {
        field.refuse_value(format!("a list of {}", frames.len()), accepted)
    })
}

/// Returns the distance of the origins of two frames at the start. \[m\]
pub(super) fn distance(
    bodies: [Option<usize>; 2],
    frames: &[JointFrame; 2],
    setup: &JointSetup<'_>,
) -> f64 {
    let [a, b] = frames;
    let [i, j] = bodies.map(|body| setup.body(body));
    apart(&point_of(i, &a.position), &point_of(j, &b.position))
}

/// Returns the position of a frame of a body in the world at the start. \[m\]
pub(super) fn world_point(
    body: Option<usize>,
    frame: &JointFrame,
    setup: &JointSetup<'_>,
) -> Vec<f64> {
    point_of(setup.body(body), &frame.position)
}

/// Returns the distance of two points. \[m\]
pub(super) fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
}

/// Warns of frames whose origins are far apart at the start.
pub(super) fn warn_of_distance(joint: &FieldCursor<'_>, owner: &str, distance: f64) {
    if distance > APART {
        joint.warn_of(
            owner,
            format_args!("has anchors that are {distance:.0} m apart at the start"),
        );
    }
}

/// Warns of a frame that is far from the body that it is in. Rounding of rotations moves such an
/// anchor.
pub(super) fn warn_of_arms(
    joint: &FieldCursor<'_>,
    owner: &str,
    bodies: [Option<usize>; 2],
    frames: &[JointFrame; 2],
    setup: &JointSetup<'_>,
) {
    for (index, frame) in bodies.into_iter().zip(frames) {
        let arm = frame.position.iter().map(|x| x * x).sum::<f64>().sqrt();
        if let Some(index) = index.filter(|_| arm > APART) {
            let body = setup.name_of(index);
            joint.warn_of(owner, format_args!("has an anchor that is {arm:.0} m from {body}"));
        }
    }
}

/// Reads the positions of the frames in their bodies.
fn read_anchors(
    table: &TableCursor<'_>,
    sides: [Option<&Body>; 2],
    setup: &JointSetup<'_>,
) -> Result<[Vec<f64>; 2], SceneError> {
    let n = setup.dimension;
    let anchor = if table.knows("anchor") { table.get("anchor") } else { None };
    if let Some(field) = table.get("anchors") {
        if anchor.is_some() {
            return Err(field.refuse("either anchor or anchors, not both"));
        }
        let accepted = "2 points, in the frame of the first body and of the second";
        let points: Vec<_> = field
            .items(accepted)?
            .map(|item| item.vector(n, &POSITION))
            .collect::<Result<_, _>>()?;
        return points.try_into().map_err(|_| field.refuse(accepted));
    }
    if let Some(field) = anchor {
        let point = field.vector(n, &POSITION)?;
        return Ok(sides.map(|body| point_in(body, &point)));
    }
    if !table.knows("anchor") {
        if sides.iter().any(Option::is_none) {
            table.require("anchors", "2 points, in the frame of the body and in the world")?;
        }
        return Ok([vec![0.0; n], vec![0.0; n]]);
    }
    let first = sides.iter().flatten().next();
    let point = first.map_or_else(|| vec![0.0; n], |body| body.position.clone());
    Ok(sides.map(|body| point_in(body, &point)))
}

/// Reads the directions of a joint, and returns the rotations of its two frames in the world.
fn read_rotations(
    table: &TableCursor<'_>,
    name: &str,
    setup: &JointSetup<'_>,
) -> Result<[Rotation; 2], SceneError> {
    if setup.dimension == 2 {
        return read_angles(table, name).map(|angle| [Rotation::Angle(angle); 2]);
    }
    let same = |x: Vec3, y: Option<Vec3>| [Rotation::Quaternion(turned(x, y)); 2];
    match name {
        "universal" => {
            let (field, [x, z]) = read_pair(table)?;
            if math::dot(x, z).abs() > SKEW {
                return Err(field.refuse("2 directions that are perpendicular (within 1e-3)"));
            }
            Ok(same(x, Some(math::cross(z, x))))
        }
        "gear" | "rack" if name == "rack" || table.get("axes").is_some() => {
            let (_, pair) = read_pair(table)?;
            match table.get("axis") {
                None => Ok(pair.map(|axis| Rotation::Quaternion(turned(axis, None)))),
                Some(field) => Err(field.refuse("nothing beside axes")),
            }
        }
        "wheel" => {
            let x = read_direction(&table.require("axis", AXIS)?)?;
            let field = table.require("suspension", AXIS)?;
            let y = read_direction(&field)?;
            if math::dot(x, y).abs() > SKEW {
                return Err(field.refuse("a direction that is perpendicular to axis (within 1e-3)"));
            }
            Ok(same(x, Some(y)))
        }
        "hinge" | "slider" | "piston" | "planar" | "screw" | "gear" => {
            let x = read_direction(&table.require("axis", AXIS)?)?;
            Ok(same(x, read_second(table, x)?))
        }
        _ if table.knows("axis") && table.get("axis").is_some() => {
            let x = read_direction(&table.require("axis", AXIS)?)?;
            Ok(same(x, read_second(table, x)?))
        }
        _ => Ok([Rotation::identity(3); 2]),
    }
}

const AXIS: &str = "a direction in the world: a vector that is not 0";

/// Reads the direction of the x axis of a joint in 2D, and returns its angle. \[rad\]
fn read_angles(table: &TableCursor<'_>, name: &str) -> Result<f64, SceneError> {
    for key in ["axes", "axis_y"] {
        if let Some(field) = if table.knows(key) { table.get(key) } else { None } {
            return Err(field.refuse("nothing in 2D, where a joint has one axis at most"));
        }
    }
    let angle = |field: FieldCursor<'_>| {
        let [x, y, _] = read_flat(&field)?;
        Ok(libm::atan2(y, x))
    };
    match name {
        "hinge" | "gear" | "wheel" if table.get("axis").is_some() => {
            let field = table.require("axis", AXIS)?;
            Err(field.refuse("nothing in 2D, where bodies turn in the plane"))
        }
        "slider" | "rack" => angle(table.require("axis", AXIS)?),
        "wheel" => Ok(angle(table.require("suspension", AXIS)?)? - FRAC_PI_2),
        "general" => table.get("axis").map_or(Ok(0.0), angle),
        _ => Ok(0.0),
    }
}

/// Reads the y axis of a joint, made perpendicular to its x axis.
fn read_second(table: &TableCursor<'_>, x: Vec3) -> Result<Option<Vec3>, SceneError> {
    let Some(field) = (if table.knows("axis_y") { table.get("axis_y") } else { None }) else {
        return Ok(None);
    };
    let y = read_direction(&field)?;
    if math::dot(x, y).abs() > 1.0 - SKEW * SKEW {
        return Err(field.refuse("a direction other than that of axis"));
    }
    Ok(Some(y))
}

/// Reads the two directions of a joint.
fn read_pair<'a>(table: &'a TableCursor<'_>) -> Result<(FieldCursor<'a>, [Vec3; 2]), SceneError> {
    let accepted = "2 directions in the world: vectors that are not 0";
    let field = table.require("axes", accepted)?;
    let axes: Vec<Vec3> =
        field.items(accepted)?.map(|item| read_direction(&item)).collect::<Result<_, _>>()?;
    let pair = axes.try_into().map_err(|_| field.refuse(accepted))?;
    Ok((field, pair))
}

fn read_direction(field: &FieldCursor<'_>) -> Result<Vec3, SceneError> {
    let vector = field.vector(3, &DIRECTION)?;
    let direction = Vec3::try_from(vector).ok().and_then(math::unit);
    direction.ok_or_else(|| field.refuse(AXIS))
}

fn read_flat(field: &FieldCursor<'_>) -> Result<Vec3, SceneError> {
    let mut vector = field.vector(2, &DIRECTION)?;
    vector.push(0.0);
    let direction = Vec3::try_from(vector).ok().and_then(math::unit);
    direction.ok_or_else(|| field.refuse(AXIS))
}

/// Returns the rotation whose x axis is the unit vector `x`. Its y axis is as near to `y` as can
/// be; without `y` it is the smallest such rotation.
fn turned(x: Vec3, y: Option<Vec3>) -> math::Quat {
    if let Some(y) = y
        && let Some(z) = math::unit(math::cross(x, y))
    {
        let axes: Mat3 = [x, math::cross(z, x), z];
        return math::from_rotation(axes);
    }
    let [cos, y, z] = x;
    // For -x, any axis perpendicular to x will do.
    if cos < -1.0 + 1e-9 {
        return [0.0, 0.0, 1.0, 0.0];
    }
    math::quat_unit([0.0, 0.0 - z, y, 1.0 + cos]).unwrap_or(math::NO_TURN)
}

/// Returns a point of the world in the frame of a body at the start; unchanged for the world.
fn point_in(body: Option<&Body>, point: &[f64]) -> Vec<f64> {
    let Some(body) = body else { return point.to_vec() };
    let arm: Vec<f64> = point.iter().zip(&body.position).map(|(p, x)| p - x).collect();
    turn(inverse(body.rotation), &arm)
}

/// Returns a point of a body in the world at the start.
fn point_of(body: Option<&Body>, point: &[f64]) -> Vec<f64> {
    let Some(body) = body else { return point.to_vec() };
    let arm = turn(body.rotation, point);
    arm.iter().zip(&body.position).map(|(r, x)| r + x).collect()
}

/// Returns a rotation in the world relative to a body at the start.
fn rotation_in(body: Option<&Body>, rotation: Rotation) -> Rotation {
    match (body.map(|body| body.rotation), rotation) {
        (Some(Rotation::Quaternion(body)), Rotation::Quaternion(own)) => {
            let q = math::quat_mul(math::conjugate(body), own);
            Rotation::Quaternion(math::quat_as_written(q).unwrap_or(q))
        }
        (Some(Rotation::Angle(body)), Rotation::Angle(own)) => Rotation::Angle(own - body),
        _ => rotation,
    }
}

fn inverse(rotation: Rotation) -> Rotation {
    match rotation {
        Rotation::Quaternion(q) => Rotation::Quaternion(math::conjugate(q)),
        Rotation::Angle(angle) => Rotation::Angle(-angle),
    }
}

/// Rotates a vector with 2 or 3 components.
fn turn(rotation: Rotation, vector: &[f64]) -> Vec<f64> {
    match (rotation, vector) {
        (Rotation::Quaternion(q), &[x, y, z]) => math::turn(q, [x, y, z]).to_vec(),
        (Rotation::Angle(angle), &[x, y]) => {
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            vec![cos * x - sin * y, sin * x + cos * y]
        }
        _ => vector.to_vec(),
    }
}
