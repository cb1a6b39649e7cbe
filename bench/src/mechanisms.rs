//! Scenes of joints made in code: chains, a slider-crank, bridges, ragdolls, a net, cars.

use std::f64::consts::PI;
use std::path::Path;

use drystone_bake::read_json;
use serde_json::{Value, json};

use crate::case::Case;

/// Names of all mechanisms.
pub(crate) const NAMES: [&str; 14] = [
    "chain_10_1000",
    "chain_100_1000",
    "whip_100",
    "slider_crank",
    "bridge_50",
    "bridge_200",
    "ragdoll",
    "ragdoll_heavy",
    "ragdolls_1000",
    "net_30",
    "cars_100",
    "chain_100_1000_2d",
    "bridge_200_2d",
    "net_30_2d",
];

/// Steps of 1/60 s of a mechanism, its bodies and its joints.
struct Mechanism {
    steps: usize,
    bodies: Vec<Value>,
    joints: Vec<Value>,
}

/// Makes a mechanism by its name.
pub(crate) fn mechanism(name: &str) -> Option<Case> {
    let (kind, flat) = name.strip_suffix("_2d").map_or((name, false), |kind| (kind, true));
    let Mechanism { steps, bodies, joints } = match kind {
        "chain_10_1000" => Mechanism { steps: 600, ..chain(10, 0.5, 1000.0, PI / 6.0) },
        "chain_100_1000" => chain(100, 0.1, 1000.0, 0.0),
        "whip_100" => chain(100, 0.1, 0.0, PI / 2.0),
        "slider_crank" => slider_crank(),
        "bridge_50" => bridge(50),
        "bridge_200" => bridge(200),
        "ragdoll" => ragdolls(1, 30.0),
        "ragdoll_heavy" => ragdolls(1, 500.0),
        "ragdolls_1000" => ragdolls(1000, 30.0),
        "net_30" => net(30, flat),
        "cars_100" => cars(100),
        _ => return None,
    };
    let mut scene = json!({
        "gravity": [0.0, -9.81, 0.0], "time_step": 1.0 / 60.0, "steps": steps,
        "bodies": bodies, "joints": joints,
    });
    if flat {
        flatten(&mut scene);
    }
    let read = read_json(Path::new(name), &scene.to_string());
    let scene = read.expect("mechanisms are scenes without errors").scene;
    Some(Case { name: name.to_string(), file: None, scene, steps, stand_tolerance: None })
}

/// Makes a scene of bodies and joints in the plane z = 0 one of the plane.
fn flatten(scene: &mut Value) {
    scene["dimension"] = json!(2);
    scene["gravity"].as_array_mut().expect("a vector").truncate(2);
    for body in scene["bodies"].as_array_mut().expect("a list") {
        body["position"].as_array_mut().expect("a vector").truncate(2);
        let turn = &body["rotation"];
        body["rotation"] = json!(2.0 * number(&turn[2]).atan2(number(&turn[3])));
        for shape in body["shapes"].as_array_mut().expect("a list") {
            if let Some(half) = shape.get_mut("half_extents") {
                half.as_array_mut().expect("a vector").truncate(2);
            }
        }
    }
    for joint in scene["joints"].as_array_mut().expect("a list") {
        joint["type"] = json!("hinge");
        joint.as_object_mut().expect("a table").remove("axis");
        joint["anchor"].as_array_mut().expect("a vector").truncate(2);
    }
}

fn number(of: &Value) -> f64 {
    of.as_f64().expect("a number")
}

/// Makes a box turned by `angle` about z.
fn block([x, y, z]: [f64; 3], half: [f64; 3], mass: f64, angle: f64) -> Value {
    let (sin, cos) = (0.5 * angle).sin_cos();
    json!({
        "position": [x, y, z], "rotation": [0.0, 0.0, sin, cos], "mass": mass,
        "shapes": [{ "type": "box", "half_extents": half }],
    })
}

fn ground(half: [f64; 3]) -> Value {
    let mut ground = block([0.0, -half[1], 0.0], half, 1.0, 0.0);
    ground["motion"] = json!("static");
    ground.as_object_mut().expect("a table").remove("mass");
    ground
}

/// Holds `bodies`, the second of which is the world if absent.
fn joint(kind: &str, bodies: &[usize], anchor: [f64; 3]) -> Value {
    let mut joint = json!({ "type": kind, "bodies": bodies, "anchor": anchor });
    match kind {
        "hinge" => joint["axis"] = json!([0.0, 0.0, 1.0]),
        "slider" => joint["axis"] = json!([1.0, 0.0, 0.0]),
        _ => {}
    }
    joint
}

/// Makes a straight chain of `count` links of 1 kg from the origin, `angle` from straight down,
/// with `load` kg at its end.
fn chain(count: usize, link: f64, load: f64, angle: f64) -> Mechanism {
    let at = |s: f64| [s * angle.sin(), -s * angle.cos(), 0.0];
    let length = count as f64 * link;
    let mut bodies: Vec<_> = (0..count)
        .map(|i| block(at((i as f64 + 0.5) * link), [0.02, 0.5 * link, 0.02], 1.0, angle))
        .collect();
    let mut joints = vec![joint("ball", &[0], at(0.0))];
    if load > 0.0 {
        bodies.push(block(at(length + 0.25), [0.25; 3], load, angle));
    }
    joints.extend((1..bodies.len()).map(|i| joint("ball", &[i, i - 1], at(i as f64 * link))));
    Mechanism { steps: 300, bodies, joints }
}

/// Makes a crank of 0.1 m that turns at 4 pi rad/s, a rod of 0.3 m and a slider.
fn slider_crank() -> Mechanism {
    let bodies = vec![
        block([0.05, 0.0, 0.0], [0.05, 0.01, 0.01], 1.0, 0.0),
        block([0.25, 0.0, 0.0], [0.15, 0.01, 0.01], 1.0, 0.0),
        block([0.4, 0.0, 0.0], [0.05, 0.03, 0.03], 1.0, 0.0),
    ];
    let mut crank = joint("hinge", &[0], [0.0; 3]);
    crank["motor"] = json!({ "velocity": 4.0 * PI, "at_most": 1e4 });
    let joints = vec![
        crank,
        joint("hinge", &[1, 0], [0.1, 0.0, 0.0]),
        joint("slider", &[2], [0.4, 0.0, 0.0]),
        joint("hinge", &[2, 1], [0.4, 0.0, 0.0]),
    ];
    Mechanism { steps: 300, bodies, joints }
}

/// Makes a bridge of planks of 10 kg and 0.5 m on an arc over 0.96 of their length, with a box of
/// 100 kg on each fifth of them, in the middle.
fn bridge(count: usize) -> Mechanism {
    const PITCH: f64 = 0.5;
    let n = count as f64;
    // Angle of a chord, by bisection.
    let (mut low, mut high) = (1e-6, 2.0 * PI / n);
    for _ in 0..100 {
        let turn = 0.5 * (low + high);
        let span = PITCH * (0.5 * n * turn).sin() / (0.5 * turn).sin();
        if span > 0.96 * n * PITCH { low = turn } else { high = turn }
    }
    let (turn, radius) = (low, 0.5 * PITCH / (0.5 * low).sin());
    let node = |i: usize| {
        let angle = (i as f64 - 0.5 * n) * turn;
        [radius * angle.sin(), radius * ((0.5 * n * turn).cos() - angle.cos()), 0.0]
    };
    let plank = |i: usize| {
        let ([ax, ay, _], [bx, by, _]) = (node(i), node(i + 1));
        ([0.5 * (ax + bx), 0.5 * (ay + by)], (by - ay).atan2(bx - ax))
    };
    let mut bodies: Vec<_> = (0..count)
        .map(|i| {
            let ([x, y], angle) = plank(i);
            block([x, y, 0.0], [0.23, 0.03, 0.5], 10.0, angle)
        })
        .collect();
    let mut joints = vec![joint("hinge", &[0], node(0))];
    joints.extend((1..count).map(|i| joint("hinge", &[i, i - 1], node(i))));
    joints.push(joint("hinge", &[count - 1], node(count)));
    for i in 2 * count / 5..3 * count / 5 {
        let ([x, y], angle) = plank(i);
        let up = 0.03 + 0.2 + 0.002;
        let center = [x - up * angle.sin(), y + up * angle.cos(), 0.0];
        bodies.push(block(center, [0.2; 3], 100.0, angle));
    }
    Mechanism { steps: 600, bodies, joints }
}

/// Makes figures of eleven boxes, dropped from 1 m, each with a torso of `torso` kg.
fn ragdolls(count: usize, torso: f64) -> Mechanism {
    const HEIGHT: f64 = 2.0;
    let side = (count as f64).sqrt().ceil();
    let mut bodies = vec![ground([2.0 * side + 2.0, 1.0, 2.0 * side + 2.0])];
    let mut joints = Vec::new();
    for figure in 0..count {
        let place = [figure as f64 % side, (figure as f64 / side).floor()];
        let [cx, cz] = place.map(|i| 2.0 * (i - 0.5 * (side - 1.0)));
        let at = |[x, y, z]: [f64; 3]| [cx + x, y + HEIGHT, cz + z];
        let mut part = |center: [f64; 3], half: [f64; 3], mass: f64| {
            bodies.push(block(at(center), half, mass, 0.0));
            bodies.len() - 1
        };
        let pelvis = part([0.0, 0.0, 0.0], [0.1, 0.08, 0.15], 12.0);
        let trunk = part([0.0, 0.33, 0.0], [0.1, 0.24, 0.17], torso);
        let head = part([0.0, 0.72, 0.0], [0.09, 0.12, 0.09], 5.0);
        joints.push(joint("ball", &[trunk, pelvis], at([0.0, 0.085, 0.0])));
        joints.push(joint("ball", &[head, trunk], at([0.0, 0.585, 0.0])));
        for s in [1.0, -1.0] {
            let thigh = part([0.0, -0.29, 0.09 * s], [0.06, 0.20, 0.06], 8.0);
            let shin = part([0.0, -0.71, 0.09 * s], [0.05, 0.20, 0.05], 4.0);
            let arm = part([0.0, 0.40, 0.22 * s], [0.04, 0.15, 0.04], 2.5);
            let hand = part([0.0, 0.08, 0.22 * s], [0.035, 0.15, 0.035], 2.0);
            let mut knee = joint("hinge", &[shin, thigh], at([0.0, -0.50, 0.09 * s]));
            knee["limits"] = json!([-2.4, 0.0]);
            let mut elbow = joint("hinge", &[hand, arm], at([0.0, 0.24, 0.22 * s]));
            elbow["limits"] = json!([0.0, 2.4]);
            joints.push(joint("ball", &[thigh, pelvis], at([0.0, -0.085, 0.09 * s])));
            joints.push(knee);
            joints.push(joint("ball", &[arm, trunk], at([0.0, 0.555, 0.22 * s])));
            joints.push(elbow);
        }
    }
    Mechanism { steps: if count > 1 { 300 } else { 360 }, bodies, joints }
}

/// Makes `side` x `side` balls of 1 kg, each held to its neighbors halfway, and to the world along an
/// edge: level, or hanging if `upright`.
fn net(side: usize, upright: bool) -> Mechanism {
    let (mut bodies, mut joints) = (Vec::new(), Vec::new());
    let at = |i: f64, j: f64| if upright { [i, -j, 0.0] } else { [i, 0.0, j] };
    for j in 0..side {
        for i in 0..side {
            let held = j == 0;
            let mut ball = json!({
                "position": at(i as f64, j as f64), "rotation": [0.0, 0.0, 0.0, 1.0],
                "shapes": [{ "type": "sphere", "radius": 0.4 }],
            });
            ball[if held { "motion" } else { "mass" }] =
                if held { json!("static") } else { json!(1.0) };
            bodies.push(ball);
            let own = bodies.len() - 1;
            if i > 0 && j > 0 {
                joints.push(joint("ball", &[own, own - 1], at(i as f64 - 0.5, j as f64)));
            }
            if j > 0 {
                joints.push(joint("ball", &[own, own - side], at(i as f64, j as f64 - 0.5)));
            }
        }
    }
    Mechanism { steps: 600, bodies, joints }
}

/// Makes cars of 800 kg on four driven wheels of 20 kg, on a road with a sill in every second
/// meter.
fn cars(count: usize) -> Mechanism {
    const REACH: f64 = 60.0;
    let rows = (count as f64).sqrt().ceil();
    let mut bodies = vec![ground([REACH, 1.0, 2.0 * rows])];
    for sill in 0..REACH as usize {
        let x = 2.0 * sill as f64 - REACH + 1.0;
        let mut bump = block([x, 0.0, 0.0], [0.08, 0.03, 2.0 * rows], 1.0, 0.0);
        bump["motion"] = json!("static");
        bump.as_object_mut().expect("a table").remove("mass");
        bodies.push(bump);
    }
    let mut joints = Vec::new();
    for car in 0..count {
        let place = [car as f64 % rows, (car as f64 / rows).floor()];
        let (x, z) = (4.0 * place[0] + 6.0 - REACH, 3.0 * (place[1] - 0.5 * (rows - 1.0)));
        bodies.push(block([x, 0.6, z], [1.2, 0.2, 0.5], 800.0, 0.0));
        let chassis = bodies.len() - 1;
        for [along, aside] in [[0.9, 0.75], [0.9, -0.75], [-0.9, 0.75], [-0.9, -0.75]] {
            let center = [x + along, 0.4, z + aside];
            bodies.push(json!({
                "position": center, "rotation": [0.0, 0.0, 0.0, 1.0], "mass": 20.0,
                "shapes": [{ "type": "sphere", "radius": 0.35 }],
            }));
            let mut axle = joint("hinge", &[bodies.len() - 1, chassis], center);
            axle["motor"] = json!({ "velocity": -12.0, "at_most": 200.0 });
            joints.push(axle);
        }
    }
    Mechanism { steps: 600, bodies, joints }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_mechanisms_are_scenes() {
        for name in NAMES {
            let case = mechanism(name).unwrap();
            assert!(!case.scene.joints.is_empty(), "{name}");
        }
    }
}
