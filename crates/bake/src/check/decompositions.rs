//! Findings about meshes that collide as convex pieces.

use std::collections::BTreeSet;

use super::{Finding, FindingKind, length};
use crate::decomposition::Decompositions;
use drystone_scene::{Motion, Scene, ShapeKind};

/// Reports how the meshes of dynamic bodies collide: one finding for each distinct decomposition,
/// except for single pieces within the accuracy.
pub fn decompositions(scene: &Scene, known: &mut Decompositions) -> Vec<Finding> {
    let (mut findings, mut said) = (Vec::new(), BTreeSet::new());
    for (index, body) in scene.bodies.iter().enumerate() {
        for shape in body.shapes.iter().filter(|_| body.motion == Motion::Dynamic) {
            let ShapeKind::Trimesh { decomposition, .. } = &shape.kind else { continue };
            let options = decomposition.unwrap_or_default();
            let Some(Ok(found)) = known.of_shape(&shape.kind) else { continue };
            let of = found.deviation;
            let worst = of.outward.max(of.inward);
            if found.pieces.len() == 1 && worst <= options.accuracy * found.size
                || !said.insert((worst.to_bits(), found.pieces.len(), found.size.to_bits()))
            {
                continue;
            }
            let limit = options.accuracy * found.size;
            let what = format!(
                "the mesh of {} collides as {} convex pieces, up to {} off ({:.2} % of its size; \
                 accepted: {:.2} %); {:.1} % of its volume is added, {:.1} % lost",
                scene.name_of(index),
                found.pieces.len(),
                length(worst),
                100.0 * worst / found.size,
                100.0 * options.accuracy,
                100.0 * of.added,
                100.0 * of.lost
            );
            let advice = format!(
                "hollows narrower than {} may be closed: allow it more pieces, or thicken it",
                length(2.0 * worst)
            );
            let kind = FindingKind::Decomposition;
            findings.push(Finding::of_body(index, kind, [worst, limit], what, &advice));
        }
    }
    findings
}
