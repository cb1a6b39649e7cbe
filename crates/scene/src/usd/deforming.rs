//! Meshes that deform: time samples of their points.

use super::super::description::{Motion, ShapeKind};
use super::super::error::{SceneError, Warning};
use super::super::graph::FAR;
use super::super::graph::math::{Mat3, Vec3};
use super::super::graph::transform::Affine;
use super::layer::Value;
use super::prims::Prim;
use super::stage::Stage;
use crate::vertex_track::VertexTrack;

const POINTS: &str = "points";

/// Gives the shape of a mesh under the linear map `map` the places of its vertices over time, if its
/// points have time samples that differ. Takes triangles out that have no area at some time. Leaves
/// the shape as it is, with a warning, where it cannot deform.
pub(super) fn deform(
    stage: &Stage<'_>,
    prim: &Prim,
    (map, motion): (Mat3, Motion),
    kind: Option<ShapeKind>,
    warnings: &mut Vec<Warning>,
) -> Result<Option<ShapeKind>, SceneError> {
    let samples = samples(stage, prim)?;
    if samples.windows(2).all(|pair| matches!(pair, [(_, a), (_, b)] if a == b)) {
        return Ok(kind);
    }
    let mut still =
        |why: &str| stage.warn(prim, format!("its mesh does not deform: {why}"), warnings);
    let (mut vertices, mut triangles, decomposition) = match kind {
        Some(ShapeKind::Trimesh { vertices, triangles, decomposition, .. }) => {
            (vertices, triangles, decomposition)
        }
        other => {
            if other.is_some() {
                still("a hull, box or ball stands for it. The approximation 'none' deforms");
            }
            return Ok(other);
        }
    };
    let whole = |vertices, triangles, vertex_track| {
        Some(ShapeKind::Trimesh { vertices, triangles, decomposition, vertex_track })
    };
    if motion == Motion::Dynamic {
        still("its body is dynamic. A kinematic or static one deforms");
        return Ok(whole(vertices, triangles, None));
    }
    let count = vertices.len();
    if let Some((code, points)) = samples.iter().find(|(_, points)| points.len() != count) {
        let found = points.len();
        still(&format!("it has {count} points, and {found} at the time code {code}"));
        return Ok(whole(vertices, triangles, None));
    }
    let map = Affine { linear: map, shift: [0.0; 3] };
    let mut track = VertexTrack::default();
    for (code, points) in samples {
        let time = stage.units.seconds(code);
        if track.times.last().is_none_or(|last| *last < time) {
            track.times.push(time);
            track.points.push(points.iter().map(|point| map.point(*point)).collect());
        }
    }
    // Without a value of their own, the points at rest are those of the first sample.
    if prim.properties.get(POINTS).is_none_or(|points| points.value.is_none()) {
        vertices = track.at(0.0);
    }
    let all = triangles.len();
    triangles.retain(|corners| track.flat(*corners).is_none());
    let flat = all.saturating_sub(triangles.len());
    if flat > 0 {
        let what =
            format!("{flat} of {all} triangles have no area at some time, and touch nothing");
        stage.warn(prim, what, warnings);
    }
    Ok(if triangles.is_empty() { None } else { whole(vertices, triangles, Some(track)) })
}

/// Returns the points at each time code that has some.
fn samples(stage: &Stage<'_>, prim: &Prim) -> Result<Vec<(f64, Vec<Vec3>)>, SceneError> {
    let samples = prim.properties.get(POINTS).and_then(|points| points.samples.as_ref());
    let mut all = Vec::new();
    for (code, value) in samples.into_iter().flatten() {
        let points = match value {
            Value::Blocked => continue,
            Value::Tuples(3, numbers) => numbers.as_chunks::<3>().0.to_vec(),
            Value::Numbers(none) if none.is_empty() => Vec::new(),
            _ => return Err(stage.refuse(prim, POINTS, "a list of points at each time code")),
        };
        let far = points.iter().flatten().any(|x| !(-FAR..=FAR).contains(x));
        if far || !code.is_finite() {
            let accepted = format!("finite time codes, and coordinates up to {FAR:e} at each");
            return Err(stage.refuse(prim, POINTS, &accepted));
        }
        all.push((*code, points));
    }
    Ok(all)
}
