//! Findings about speed: bodies that move farther than they are thick.

use super::sizes::{extents, thickness};
use super::{Finding, FindingKind, dot, length, up};
use drystone::StepSettings;
use drystone_scene::{Body, Motion, Rotation, Scene};

/// Motion between two keys up to which it is no jump, as a fraction of the body's thickness. \[1\]
const JUMP: f64 = 0.1;
/// A jump is faster than the motion before and after it by this factor. \[1\]
const SUDDEN: f64 = 10.0;

/// Part of a step by which a key may miss it: files round times. \[1\]
const NEAR: f64 = 1e-3;

/// Finds bodies that may move more than their own thickness, or that of the thinnest body, between
/// two searches for contacts. The speed is the initial one plus the speed gained by falling to the
/// lowest body.
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
        let searches = f64::from(settings.max_searches.max(1));
        let travel = speed * scene.longest_step() / searches;
        if travel > limit {
            let slower = scene.time_step * limit / travel;
            findings.push(Finding {
                kind: FindingKind::TooFast,
                bodies: if other == index { vec![index] } else { vec![index, other] },
                joint: None,
                value: Some(travel),
                limit: Some(limit),
                what: format!(
                    "{} may move {} between two searches for contacts (at {speed:.1} m/s, \
                     {searches} per step); accepted: up to {}, the thickness of {}",
                    scene.name_of(index),
                    length(travel),
                    length(limit),
                    scene.name_of(other)
                ),
                advice: format!("it may tunnel: set time_step to {slower:.1e} s or less"),
            });
        }
    }
    findings
}

/// Finds meshes whose vertices move farther between two searches for contacts than the thinnest
/// dynamic body is thick.
pub(super) fn deforms_too_fast(scene: &Scene, settings: &StepSettings) -> Vec<Finding> {
    let thin = |(index, body): (usize, &Body)| {
        let dynamic = body.motion == Motion::Dynamic;
        let least = body.shapes.iter().filter_map(thickness).reduce(f64::min);
        least.filter(|_| dynamic).map(|thickness| (index, thickness))
    };
    let solid = scene.bodies.iter().enumerate().filter_map(thin);
    let Some((other, limit)) = solid.min_by(|a, b| a.1.total_cmp(&b.1)) else { return Vec::new() };
    let searches = f64::from(settings.max_searches.max(1));
    let mut findings = Vec::new();
    for (index, body) in scene.bodies.iter().enumerate() {
        let tracks = body.shapes.iter().filter_map(|shape| {
            let track = shape.kind.vertex_track()?;
            let (path, key) = track.longest(scene.time_step / searches);
            Some((path, track.times[key]))
        });
        let Some((path, time)) = tracks.max_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
        if path > limit {
            let what = format!(
                "a vertex of {} moves {} between two searches for contacts, from {time:.3} s on \
                 ({searches} per step); accepted: up to {}, the thickness of {}",
                scene.name_of(index),
                length(path),
                length(limit),
                scene.name_of(other)
            );
            let slower = scene.time_step * limit / path;
            let advice = format!("bodies may tunnel: set time_step to {slower:.1e} s or less");
            findings.push(Finding {
                kind: FindingKind::TooFast,
                bodies: vec![index, other],
                joint: None,
                value: Some(path),
                limit: Some(limit),
                what,
                advice,
            });
        }
    }
    findings
}

/// Finds jumps in the tracks of bodies. A jump moves a body by more than a fraction of its
/// thickness in less than half a step. It is also many times faster than the motion before and
/// after it. Causes are a key with STEP interpolation, or two keys at almost the same time.
pub(super) fn jumps(scene: &Scene) -> Vec<Finding> {
    let step = scene.time_step;
    let mut findings = Vec::new();
    for (index, body) in scene.bodies.iter().enumerate() {
        let track = &body.track;
        let sides = body.shapes.iter().filter_map(extents).flatten();
        let Some(thin) = sides.filter(|side| *side > 0.0).reduce(f64::min) else { continue };
        let reach = reach(body);
        let passed = |i: usize| {
            let way = distance(&track.positions[i], &track.positions[i + 1]);
            way + reach * track.rotations[i].angle_to(&track.rotations[i + 1])
        };
        let lasts = |i: usize| track.times[i + 1] - track.times[i];
        let segments = track.times.len().saturating_sub(1);
        let speed = |i: usize| if i < segments { passed(i) / lasts(i) } else { 0.0 };
        let jump = |i: &usize| {
            let around = speed(i.wrapping_sub(1)).max(speed(i + 1));
            lasts(*i) < 0.5 * step && passed(*i) > JUMP * thin && speed(*i) > SUDDEN * around
        };
        let farthest = (0..segments).filter(jump).max_by(|a, b| passed(*a).total_cmp(&passed(*b)));
        let Some(worst) = farthest else { continue };
        let (speed, limit) = (passed(worst) / step, JUMP * thin / step);
        let what = format!(
            "{} jumps by {} at {:.3} s, which in one step means {speed:.1} m/s; accepted: up to \
             {limit:.1} m/s",
            scene.name_of(index),
            length(passed(worst)),
            track.times[worst + 1]
        );
        let advice = "it throws bodies that it touches, and tunnels through bodies on its way: \
         give the keys LINEAR interpolation and time between them";
        findings.push(Finding::of_body(index, FindingKind::Jump, [speed, limit], what, advice));
    }
    findings
}

/// Finds keys between two steps that are out of the way: bodies move from step to step, and never get
/// there. Half of the detour over the key is more than a fraction of the body's thickness.
pub(super) fn missed_keys(scene: &Scene) -> Vec<Finding> {
    let mut findings = Vec::new();
    let end = scene.steps.map_or(f64::INFINITY, |steps| f64::from(steps) * scene.time_step);
    for (index, body) in scene.bodies.iter().enumerate() {
        let sides = body.shapes.iter().filter_map(extents).flatten();
        let Some(thin) = sides.filter(|side| *side > 0.0).reduce(f64::min) else { continue };
        let (track, reach) = (&body.track, reach(body));
        let passed = |(p, a): &(Vec<f64>, Rotation), (q, b): &(Vec<f64>, Rotation)| {
            distance(p, q) + reach * a.angle_to(b)
        };
        let of_body = track.times.iter().map(|&time| {
            let [before, after] = steps_around(time, scene.time_step).map(|step| track.at(step));
            let key = track.at(time);
            let detour = passed(&before, &key) + passed(&key, &after) - passed(&before, &after);
            (0.5 * detour, time)
        });
        let meshes = body.shapes.iter().filter_map(|shape| shape.kind.vertex_track());
        let of_meshes = meshes.flat_map(|track| {
            track.times.iter().zip(&track.points).map(|(&time, keys)| {
                let [before, after] =
                    steps_around(time, scene.time_step).map(|step| track.at(step));
                let detours = before.iter().zip(keys).zip(&after).map(|((p, key), q)| {
                    0.5 * (distance(p, key) + distance(key, q) - distance(p, q))
                });
                (detours.fold(0.0, f64::max), time)
            })
        });
        let simulated = of_body.chain(of_meshes).filter(|(_, time)| (0.0..=end).contains(time));
        let worst = simulated.max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((miss, time)) = worst.filter(|(miss, _)| *miss > JUMP * thin) else { continue };
        let what = format!(
            "{} has a key at {time:.4} s that no step reaches, {} off its way from step to step; \
             accepted: up to {}",
            scene.name_of(index),
            length(miss),
            length(JUMP * thin)
        );
        let advice = "what it should strike there is not struck: move the key to a multiple of \
         time_step, or set time_step such that it is one";
        let numbers = [miss, JUMP * thin];
        findings.push(Finding::of_body(index, FindingKind::MissedKey, numbers, what, advice));
    }
    findings
}

/// Returns the times of the steps before and after a time, which are the same near a step. \[s\]
fn steps_around(time: f64, step: f64) -> [f64; 2] {
    let (count, nearest) = (time / step, (time / step).round());
    if (count - nearest).abs() < NEAR {
        [time; 2]
    } else {
        [count.floor() * step, count.ceil() * step]
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(p, q)| (q - p).powi(2)).sum::<f64>().sqrt()
}

fn norm(vector: &[f64]) -> f64 {
    dot(vector, vector).sqrt()
}

/// Returns a bound on the distance of a point of the body from its origin. \[m\]
fn reach(body: &Body) -> f64 {
    let far = |shape| extents(shape).map_or(0.0, |sides| 0.5 * norm(&sides));
    body.shapes.iter().map(|shape| norm(&shape.position) + far(shape)).fold(0.0, f64::max)
}
