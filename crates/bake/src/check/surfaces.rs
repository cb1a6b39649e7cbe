//! Findings about how the restitutions of two surfaces combine.

use super::{Finding, FindingKind};
use crate::convert::material;
use drystone_scene::{Material, Motion, Scene};

/// Restitution from which on a bounce loses no energy. \[1\]
const LOSSLESS: f64 = 1.0;

/// A material with a body that has it.
struct Surface<'a> {
    material: &'a Material,
    body: usize,
    /// Last body that has it; differs from `body` if several have it.
    last: usize,
    dynamic: bool,
}

/// Finds pairs of surfaces that bounce forever, and surfaces whose restitution never acts. Each
/// finding names the first body of a surface.
pub(super) fn bounces(scene: &Scene) -> Vec<Finding> {
    let surfaces = surfaces(scene);
    let together = |a: &Surface<'_>, b: &Surface<'_>| {
        material(a.material).restitution_with(&material(b.material))
    };
    let mut findings = Vec::new();
    for (i, a) in surfaces.iter().enumerate() {
        let met = |b: &&Surface<'_>| (a.dynamic || b.dynamic) && a.body != b.last;
        for b in surfaces[i..].iter().filter(met).filter(|b| together(a, b) >= LOSSLESS) {
            findings.push(Finding {
                kind: FindingKind::LosslessBounce,
                bodies: vec![a.body, b.body],
                joint: None,
                value: Some(together(a, b)),
                limit: Some(LOSSLESS),
                what: format!(
                    "the surfaces of {} and {} combine to a restitution of {}; accepted: below \
                     {LOSSLESS}",
                    scene.name_of(a.body),
                    scene.name_of(b.body),
                    together(a, b)
                ),
                advice: "they never come to rest: lower one, or change how they combine".to_owned(),
            });
        }
        let own = a.material.restitution;
        if own > 0.0 && surfaces.iter().filter(met).all(|b| together(a, b) <= 0.0) {
            let what = format!(
                "the restitution {own} of {} never acts: with every other surface it combines to 0",
                scene.name_of(a.body)
            );
            let advice = "give the others a restitution, or combine by maximum";
            findings.push(Finding::of_body(
                a.body,
                FindingKind::IdleBounce,
                [own, 0.0],
                what,
                advice,
            ));
        }
    }
    findings
}

/// Returns the distinct surfaces, each with the first body that has it.
fn surfaces(scene: &Scene) -> Vec<Surface<'_>> {
    let mut surfaces: Vec<Surface<'_>> = Vec::new();
    for (index, body) in scene.bodies.iter().enumerate() {
        let dynamic = body.motion == Motion::Dynamic;
        for shape in &body.shapes {
            let material = &shape.material;
            let same = |of: &&mut Surface<'_>| of.material == material && of.dynamic == dynamic;
            match surfaces.iter_mut().find(same) {
                Some(known) => known.last = index,
                None => surfaces.push(Surface { material, body: index, last: index, dynamic }),
            }
        }
    }
    surfaces
}
