//! Findings about the scale of glTF nodes.

use super::{Finding, FindingKind};
use drystone_scene::Read;

/// Relative difference up to which a scale counts as even. \[1\]
const EVEN: f64 = 1e-3;

/// Finds bodies with mirrored or unevenly scaled shapes; one finding of each kind per body.
pub(super) fn scales(read: &Read) -> Vec<Finding> {
    let Some(source) = &read.source else { return Vec::new() };
    let mut findings = Vec::new();
    for index in 0..read.scene.bodies.len() {
        let name = read.scene.name_of(index);
        let mut found = |kind, value, limit, what: String, advice: &str| {
            findings.push(Finding::of_body(index, kind, [value, limit], what, advice));
        };
        let scales = || source.scales(index).iter();
        let mirror = scales().map(smallest).fold(f64::INFINITY, f64::min);
        if mirror < 0.0 {
            let what = format!("{name} has a shape of scale {mirror:.4}; accepted: above 0");
            let advice = "an implicit shape takes its absolute value, a mesh is mirrored: apply \
             the scale before the export";
            found(FindingKind::NegativeScale, mirror, 0.0, what, advice);
        }
        let uneven = scales().map(unevenness).fold(1.0, f64::max);
        if uneven > 1.0 + EVEN {
            let what = format!(
                "{name} has a shape scaled {uneven:.4} times as much along one axis as along \
                 another; accepted: evenly"
            );
            let advice = "round shapes become convex hulls, and rotated nodes below it are \
             sheared: apply the scale before the export";
            found(FindingKind::UnevenScale, uneven, 1.0, what, advice);
        }
    }
    findings
}

/// Returns the smallest scale factor along the axes of a shape.
fn smallest([x, y, z]: &[[f64; 3]; 3]) -> f64 {
    x[0].min(y[1]).min(z[2])
}

/// Returns the ratio of the largest to the smallest factor; 1 if the scale disables the shape.
fn unevenness(scale: &[[f64; 3]; 3]) -> f64 {
    let factors = scale.map(|axis| super::dot(&axis, &axis).sqrt());
    let (low, high) =
        factors.iter().fold((f64::INFINITY, 0.0f64), |(low, high), x| (low.min(*x), high.max(*x)));
    if low > 0.0 { high / low } else { 1.0 }
}
