//! Reads the shapes of colliders.

use super::super::description::{Motion, ShapeKind};
use super::super::error::{SceneError, Warning};
use super::super::graph::implicit::{self, Implicit, Placed};
use super::super::graph::math::{self, Mat3, Quat, Vec3};
use super::super::graph::triangles::Triangles;
use super::super::graph::{FAR, NEAR};
use super::deforming::deform;
use super::prims::Prim;
use super::stage::Stage;
use crate::solid_mesh::DecompositionOptions;

/// A shape and its rotation relative to its prim.
pub(super) type Turned = (ShapeKind, Quat);

/// Rotation by 90° that takes local y to z, as matrix columns and as a quaternion.
const Y_TO_Z: (Mat3, Quat) = (
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
    [std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2],
);
/// Rotation by 90° that takes local y to x, in the same form.
const Y_TO_X: (Mat3, Quat) = (
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [0.0, 0.0, -std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2],
);

/// Reads the shape of a collider under the linear map `map`. Returns `None`, with a warning, for a
/// collider that cannot act.
pub(super) fn read(
    stage: &Stage<'_>,
    prim: &Prim,
    map: Mat3,
    motion: Motion,
    warnings: &mut Vec<Warning>,
) -> Result<Option<Turned>, SceneError> {
    let size = |name: &str, low: f64, default: f64| -> Result<f64, SceneError> {
        Ok(stage.number(prim, name, low, FAR)?.unwrap_or(default))
    };
    let implicit = match prim.kind.as_str() {
        "Sphere" => Implicit::Sphere { radius: size("radius", NEAR, 1.0)? },
        "Cube" => Implicit::Box { size: [size("size", NEAR, 2.0)?; 3] },
        "Capsule" => {
            let radius = size("radius", NEAR, 0.5)?;
            Implicit::Capsule { height: size("height", 0.0, 1.0)?, top: radius, bottom: radius }
        }
        "Capsule_1" => {
            let (top, bottom) = (size("radiusTop", NEAR, 0.5)?, size("radiusBottom", NEAR, 0.5)?);
            Implicit::Capsule { height: size("height", NEAR, 1.0)?, top, bottom }
        }
        "Cylinder" => {
            let radius = size("radius", NEAR, 1.0)?;
            Implicit::Cylinder { height: size("height", NEAR, 2.0)?, top: radius, bottom: radius }
        }
        "Cylinder_1" => {
            let (top, bottom) = (size("radiusTop", NEAR, 1.0)?, size("radiusBottom", NEAR, 1.0)?);
            Implicit::Cylinder { height: size("height", NEAR, 2.0)?, top, bottom }
        }
        "Cone" => {
            let bottom = size("radius", NEAR, 1.0)?;
            Implicit::Cylinder { height: size("height", NEAR, 2.0)?, top: 0.0, bottom }
        }
        "Plane" => Implicit::Plane { x: None, z: None, double: false },
        "Mesh" => {
            let kind = mesh(stage, prim, map, motion, warnings)?;
            let kind = deform(stage, prim, (map, motion), kind, warnings)?;
            return Ok(kind.map(|kind| (kind, math::NO_TURN)));
        }
        other => {
            let what = match other {
                "" => "no collider acts: the prim has no type".to_owned(),
                other => format!(
                    "no collider acts: a {other} does not collide; Cube, Sphere, Capsule, \
                     Cylinder, Cone, Plane and Mesh do"
                ),
            };
            stage.warn(prim, what, warnings);
            return Ok(None);
        }
    };
    // Only round shapes and planes have an axis. Without a rotation, nothing is rounded.
    let round = !matches!(implicit, Implicit::Sphere { .. } | Implicit::Box { .. });
    let (map, turn) = match round.then(|| axis(stage, prim)).transpose()?.flatten() {
        None => (map, math::NO_TURN),
        Some((along, turn)) => (math::mul(math::transpose(along), math::mul(map, along)), turn),
    };
    Ok(match implicit::place(&implicit, map, motion) {
        Placed::Shape(kind) => Some((kind, turn)),
        Placed::Instead(kind, why) => {
            stage.warn(prim, format!("collider: {why}"), warnings);
            Some((kind, turn))
        }
        Placed::Nothing(why) => {
            stage.warn(prim, format!("no collider acts: {why}"), warnings);
            None
        }
    })
}

/// Returns the rotation from local y to the axis of a round shape or the normal of a plane.
fn axis(stage: &Stage<'_>, prim: &Prim) -> Result<Option<(Mat3, Quat)>, SceneError> {
    match stage.word(prim, "axis")? {
        Some("Y") => Ok(None),
        Some("X") => Ok(Some(Y_TO_X)),
        Some("Z") | None => Ok(Some(Y_TO_Z)),
        Some(_) => Err(stage.refuse(prim, "axis", "\"X\", \"Y\", \"Z\"")),
    }
}

fn mesh(
    stage: &Stage<'_>,
    prim: &Prim,
    map: Mat3,
    motion: Motion,
    warnings: &mut Vec<Warning>,
) -> Result<Option<ShapeKind>, SceneError> {
    const APPROXIMATION: &str = "physics:approximation";
    let form = stage.word(prim, APPROXIMATION)?.unwrap_or("none");
    let triangles = triangles(stage, prim)?;
    let placed = |implicit: Implicit| match implicit::place(&implicit, map, motion) {
        Placed::Shape(kind) | Placed::Instead(kind, _) => Some(kind),
        Placed::Nothing(_) => None,
    };
    let convex = match form {
        // A mesh on a dynamic body is decomposed; any other collides as it is.
        "none" | "meshSimplification" | "convexDecomposition" => false,
        "convexHull" => true,
        // An off-center one becomes a convex hull, whose points include the offset.
        "boundingCube" | "boundingSphere" => {
            let Some((low, high)) = bounds(&triangles.vertices) else {
                stage.warn(prim, "no collider acts: its mesh has no triangles", warnings);
                return Ok(None);
            };
            let corners = [low, high];
            let middle = math::scale(math::add(low, high), 0.5);
            let size = math::sub(high, low);
            let centered = math::length(middle) <= 1e-9 * math::length(size);
            let cube = form == "boundingCube";
            if centered && size.iter().all(|x| *x >= NEAR) {
                return Ok(placed(if cube {
                    Implicit::Box { size }
                } else {
                    Implicit::Sphere { radius: radius(&triangles.vertices, middle) }
                }));
            }
            let points = if cube {
                let pick = |i: usize, axis: usize| {
                    corners.get((i >> axis) & 1).and_then(|p| p.get(axis)).copied().unwrap_or(0.0)
                };
                (0..8).map(|i| [pick(i, 0), pick(i, 1), pick(i, 2)]).collect()
            } else {
                implicit::ball(radius(&triangles.vertices, middle), 0.0)
                    .into_iter()
                    .map(|point| math::add(point, middle))
                    .collect()
            };
            let around = Triangles { vertices: points, triangles: vec![[0, 1, 2]] };
            let solid = around.solid(map, true, None, motion);
            solid.notes.into_iter().for_each(|note| stage.warn(prim, note, warnings));
            return Ok(solid.kind);
        }
        other => {
            let what = format!("approximation '{other}' is unknown: 'none' acts");
            stage.warn(prim, what, warnings);
            false
        }
    };
    let decomposition = decomposition(stage, prim)?;
    let solid = triangles.solid(map, convex, decomposition, motion);
    solid.notes.into_iter().for_each(|note| stage.warn(prim, note, warnings));
    Ok(solid.kind)
}

/// Reads the accuracy and the number of convex pieces, if the prim states either.
fn decomposition(
    stage: &Stage<'_>,
    prim: &Prim,
) -> Result<Option<DecompositionOptions>, SceneError> {
    let [low, high] = DecompositionOptions::ACCURACY;
    let [fewest, most] = DecompositionOptions::PIECES.map(f64::from);
    let accuracy = stage.number(prim, "drystone:accuracy", low, high)?;
    let mut pieces = stage.number(prim, "drystone:pieces", fewest, most)?;
    if pieces.is_none() {
        const PHYSX: &str = "physxConvexDecompositionCollision:maxConvexHulls";
        pieces = stage.number(prim, PHYSX, 0.0, 1e9)?.map(|count| count.clamp(fewest, most));
    }
    let default = DecompositionOptions::default();
    Ok((accuracy.is_some() || pieces.is_some()).then(|| DecompositionOptions {
        accuracy: accuracy.unwrap_or(default.accuracy),
        pieces: pieces.map_or(default.pieces, |count| count as u32),
    }))
}

fn bounds(points: &[Vec3]) -> Option<(Vec3, Vec3)> {
    let first = *points.first()?;
    Some(points.iter().fold((first, first), |(low, high), point| {
        let ([a, b, c], [d, e, f], [x, y, z]) = (low, high, *point);
        ([a.min(x), b.min(y), c.min(z)], [d.max(x), e.max(y), f.max(z)])
    }))
}

/// Radius of the ball about `middle` that contains all points.
fn radius(points: &[Vec3], middle: Vec3) -> f64 {
    points.iter().fold(0.0, |most, point| math::length(math::sub(*point, middle)).max(most))
}

/// Reads the triangles of a mesh; faces with more corners are split into fans.
fn triangles(stage: &Stage<'_>, prim: &Prim) -> Result<Triangles, SceneError> {
    const CORNERS: &str = "faceVertexIndices";
    let vertices = stage.points(prim, "points", FAR)?;
    let counts = stage.whole_numbers(prim, "faceVertexCounts")?.unwrap_or_default();
    let corners = stage.whole_numbers(prim, CORNERS)?.unwrap_or_default();
    let sum = counts.iter().fold(0_usize, |sum, count| sum.saturating_add(*count as usize));
    if sum != corners.len() {
        let value = format!("{} indices", corners.len());
        let accepted = format!("accepted: {sum}, the sum of faceVertexCounts");
        return Err(stage.wrong(prim, CORNERS, value, &accepted));
    }
    if let Some(wrong) = corners.iter().find(|corner| **corner as usize >= vertices.len()) {
        let accepted = format!("accepted: below {}, the number of points", vertices.len());
        return Err(stage.wrong(prim, CORNERS, wrong.to_string(), &accepted));
    }
    let flip = stage.word(prim, "orientation")? == Some("leftHanded");
    let mut triangles = Vec::new();
    let mut rest = corners.as_slice();
    for count in counts {
        let Some((face, others)) = rest.split_at_checked(count as usize) else { break };
        rest = others;
        let Some((hub, around)) = face.split_first() else { continue };
        for pair in around.windows(2) {
            let [b, c] = *pair else { continue };
            if *hub != b && b != c && c != *hub {
                triangles.push(if flip { [*hub, c, b] } else { [*hub, b, c] });
            }
        }
    }
    Ok(Triangles { vertices, triangles })
}
