//! Findings about speed: what moves farther than it is thick.

use super::sizes::{extents, thickness};
use super::{Finding, Kind, dot, length, up};
use crate::scene::{Body, Motion, Scene};
use crate::settings::StepSettings;

/// Bodies that pass more than the thickness of the thinnest body, or their own, between two searches
/// for contacts: at the speed they start with, and what they gain by falling to the lowest body.
pub(super) fn too_fast(scene: &Scene, settings: &StepSettings) -> Vec<Finding> {
    let up = up(scene);
    let gravity = scene.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
    let lowest =
        scene.bodies.iter().map(|body| dot(&body.position, &up)).fold(f64::INFINITY, f64::min);
    let thin = |body: &Body| body.shapes.iter().filter_map(thickness).reduce(f64::min);
    let all = scene.bodies.iter().enumerate();
    let solid: Vec<(usize, f64)> = all.filter_map(|(i, body)| Some((i, thin(body)?))).collect();
    let thinnest = solid.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1));
    let Some(thinnest) = thinnest else { return Vec::new() };
    let mut findings = Vec::new();
    for &(index, own) in &solid {
        let body = &scene.bodies[index];
        let (other, limit) = if thinnest.1 < own { thinnest } else { (index, own) };
        let fall = match body.motion {
            Motion::Static => continue,
            Motion::Kinematic => 0.0,
            Motion::Dynamic => {
                let height = dot(&body.position, &up) - lowest;
                (2.0 * gravity * body.gravity_factor.abs() * height).sqrt()
            }
        };
        let speed = norm(&body.linear_velocity) + norm(&body.angular_velocity) * reach(body) + fall;
        let searches = f64::from(settings.searches.max(1));
        let travel = speed * scene.time_step / searches;
        if travel > limit {
            let slower = scene.time_step * limit / travel;
            findings.push(Finding {
                kind: Kind::TooFast,
                bodies: if other == index { vec![index] } else { vec![index, other] },
                value: Some(travel),
                limit: Some(limit),
                what: format!(
                    "{} may move {} between two searches for contacts (at {speed:.1} m/s, {searches} \
                     per step); accepted: up to {}, the thickness of {}",
                    scene.name_of(index),
                    length(travel),
                    length(limit),
                    scene.name_of(other)
                ),
                advice: format!("it may pass through: set time_step to {slower:.1e} s or less"),
            });
        }
    }
    findings
}

fn norm(vector: &[f64]) -> f64 {
    dot(vector, vector).sqrt()
}

/// How far a body reaches from its origin. \[m\]
fn reach(body: &Body) -> f64 {
    let far = |shape| extents(shape).map_or(0.0, |sides| 0.5 * norm(&sides));
    body.shapes.iter().map(|shape| norm(&shape.position) + far(shape)).fold(0.0, f64::max)
}
