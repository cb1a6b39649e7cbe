//! Findings about the contacts at the start.

use std::collections::BTreeMap;

use drystone_solver::jam::Jam;

use super::{Finding, FindingKind, dot, length, up};
use drystone::{Nearby, StepSettings};
use drystone_scene::{BodiesAs, Scene};

/// Length of a step in which practically nothing moves. \[s\]
pub(super) const INSTANT: f64 = 1e-6;
/// Initial overlap up to which it counts as rounding in the scene. \[m\]
const OVERLAP: f64 = 1e-4;
/// Maximum gap of bodies that touch. \[m\]
const TOUCH: f64 = 1e-3;
/// Accepted ratio of the masses of a body and of the body that carries it. It applies if every
/// substep is solved to a tolerance; ten times this ratio was tried. \[1\]
const SOLVED: f64 = 1e6;
/// Accepted mass ratio per substep with a fixed number of sweeps. A ratio of 100 was too much for 4
/// substeps, and 1000 for 32. \[1\]
const SWEPT: f64 = 10.0;
/// Cosine of the angle between normal and vertical beyond which a contact carries a body. \[1\]
const CARRIES: f64 = 0.5;
/// Missed separation speed above which contacts are examined for jams. \[m/s\]
const MISSED: f64 = 0.1;

/// Returns settings for a step that finds contacts at the least cost.
pub(super) fn at_the_start(settings: &StepSettings) -> StepSettings {
    StepSettings {
        substeps: 1,
        iterations: 1,
        max_searches: 1,
        tolerance: 0.0,
        certify: false,
        ledger: false,
        ..settings.clone()
    }
}

/// Finds the deepest overlap of each pair of bodies.
pub(super) fn overlaps(scene: &Scene, near: &[Nearby]) -> Vec<Finding> {
    let mut deepest: BTreeMap<[usize; 2], f64> = BTreeMap::new();
    for pair in near.iter().filter(|pair| pair.gap < -OVERLAP) {
        let depth = deepest.entry(sorted(pair.bodies)).or_default();
        *depth = depth.max(-pair.gap);
    }
    let finding = |([a, b], depth): ([usize; 2], f64)| Finding {
        kind: FindingKind::Overlap,
        bodies: vec![a, b],
        joint: None,
        value: Some(depth),
        limit: Some(OVERLAP),
        what: format!(
            "{} and {} overlap by {} at the start; accepted: up to {}",
            scene.name_of(a),
            scene.name_of(b),
            length(depth),
            length(OVERLAP)
        ),
        advice:
            "they will be pushed apart, and move the bodies that they carry: move or shrink one"
                .to_owned(),
    };
    deepest.into_iter().map(finding).collect()
}

fn sorted([a, b]: [usize; 2]) -> [usize; 2] {
    [a.min(b), a.max(b)]
}

/// Reports the jams of the first step.
pub(super) fn wedged(scene: &Scene, jams: &[Jam]) -> Vec<Finding> {
    let finding = |jam: &Jam| {
        let bodies: Vec<usize> = jam.bodies.iter().map(|&body| body as usize).collect();
        let names: Vec<_> = bodies.iter().map(|&body| scene.name_of(body)).collect();
        let joints = jam.joints.iter().map(|&joint| scene.joint_name_of(joint as usize));
        let joints: Vec<_> = joints.collect();
        let with = match joints.as_slice() {
            [] => "contacts".to_owned(),
            _ => format!("contacts and joints ({})", joints.join(", ")),
        };
        Finding {
            kind: FindingKind::Wedged,
            bodies,
            joint: jam.joints.first().map(|&joint| joint as usize),
            value: Some(jam.missing),
            limit: Some(MISSED),
            what: format!(
                "{} are wedged: no velocities satisfy their {with}, which miss their targets by {:.2} \
                 m/s",
                names.join(", "),
                jam.missing
            ),
            advice: "give them room, or make one of the fixed ones dynamic".to_owned(),
        }
    };
    jams.iter().map(finding).collect()
}

/// Finds heavy bodies on light ones, for which iterative methods converge slowly. Light bodies on
/// heavy ones are harmless.
pub(super) fn mass_ratios(
    scene: &Scene,
    near: &[Nearby],
    masses: &[f64],
    settings: &StepSettings,
) -> Vec<Finding> {
    let up = up(scene);
    let solved = settings.tolerance > 0.0;
    let limit = if solved { SOLVED } else { SWEPT * f64::from(settings.substeps) };
    let mut worst = BTreeMap::new();
    for pair in near.iter().filter(|pair| pair.gap <= TOUCH) {
        let [a, b] = pair.bodies;
        // The normal points from b to a.
        for (upper, lower, sign) in [(a, b, 1.0), (b, a, -1.0)] {
            let ratio = masses[upper] / masses[lower];
            let above = sign * dot(&pair.normal, &up) > -1e-3;
            if above && ratio.is_finite() && ratio > limit {
                worst.insert([upper, lower], ratio);
            }
        }
    }
    let finding = |([upper, lower], ratio): ([usize; 2], f64)| Finding {
        kind: FindingKind::MassRatio,
        bodies: vec![upper, lower],
        joint: None,
        value: Some(ratio),
        limit: Some(limit),
        what: format!(
            "{} is {ratio:.0} times as heavy as {}, which carries it; accepted: up to {limit}",
            scene.name_of(upper),
            scene.name_of(lower)
        ),
        advice:
            "it may penetrate: make the heavy one lighter or the light one heavier, or bake with \
                 a tolerance"
                .to_owned(),
    };
    worst.into_iter().map(finding).collect()
}

/// Finds bodies that carry others and stand on a contact without friction.
pub(super) fn frictionless(scene: &Scene, near: &[Nearby], masses: &[f64]) -> Vec<Finding> {
    if scene.bodies_as == BodiesAs::Particles {
        return Vec::new();
    }
    let up = up(scene);
    // Upper body, lower body, friction.
    let carried = near.iter().filter(|pair| pair.gap <= TOUCH).filter_map(|pair| {
        let ([a, b], along) = (pair.bodies, dot(&pair.normal, &up));
        match along {
            CARRIES.. => Some((a, b, pair.friction)),
            _ if along <= -CARRIES => Some((b, a, pair.friction)),
            _ => None,
        }
    });
    let carried: Vec<_> = carried.filter(|(upper, ..)| masses[*upper].is_finite()).collect();
    let mut seen = BTreeMap::new();
    for &(body, on, friction) in carried.iter().filter(|(.., friction)| *friction <= 0.0) {
        if let Some((load, ..)) = carried.iter().find(|(_, lower, _)| *lower == body) {
            seen.entry([body, on]).or_insert((*load, friction));
        }
    }
    let finding = |([body, on], (load, friction)): ([usize; 2], (usize, f64))| Finding {
        kind: FindingKind::Frictionless,
        bodies: vec![body, on, load],
        joint: None,
        value: Some(friction),
        limit: Some(0.0),
        what: format!(
            "{} carries {} and stands on {} with a friction of {friction}; accepted: above 0",
            scene.name_of(body),
            scene.name_of(load),
            scene.name_of(on)
        ),
        advice:
            "any push makes it slide: give both surfaces friction, and check their combine rules"
                .to_owned(),
    };
    seen.into_iter().map(finding).collect()
}
