//! Tests that the public samples of joints, in glTF and OpenUSD, move as their numbers say. They
//! are in the folder that the environment variable DRYSTONE_DATA names. Without it they are
//! skipped, aloud.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, SQRT_2};
use std::path::PathBuf;

use drystone::{BodyId, JointState, StepSettings};
use drystone_bake::{AnyWorld, build, read};
use drystone_scene::{Body, Motion, Scene};

const GRAVITY: f64 = 9.81;

/// Steps per second. \[Hz\]
const RATE: usize = 60;

/// A sample while it is simulated, with the settings of bakes.
struct Sample {
    scene: Scene,
    world: AnyWorld,
    steps: usize,
}

impl Sample {
    fn new(file: &str, settings: StepSettings) -> Option<Self> {
        let Some(root) = std::env::var_os("DRYSTONE_DATA") else {
            eprintln!("skipped: DRYSTONE_DATA is not set");
            return None;
        };
        let path = PathBuf::from(root).join(file);
        let scene = read(&path).unwrap_or_else(|error| panic!("{error}")).scene;
        let world = build(&scene, settings).unwrap();
        Some(Self { scene, world, steps: 0 })
    }

    /// Reads a test of the group `RigidBodies_Joint`.
    fn test(number: &str) -> Option<Self> {
        let folder = "gltf/khr_physics/tests/RigidBodies_Joint";
        let file = format!("{folder}/RigidBodies_Joint_{number}.gltf");
        Self::new(&file, StepSettings::certified())
    }

    fn step(&mut self) {
        self.world.step(1.0 / RATE as f64).unwrap();
        self.steps += 1;
        assert!(self.world.measure().finite, "not finite after {} steps", self.steps);
    }

    fn time(&self) -> f64 {
        self.steps as f64 / RATE as f64
    }

    fn joints(&self) -> Vec<JointState> {
        self.world.joints().into_iter().map(|id| self.world.joint(id).unwrap()).collect()
    }

    /// Returns the only joint, which must hold its locks and limits within these bounds.
    fn joint(&self, gap: f64, angle: f64) -> JointState {
        let [joint] = <[JointState; 1]>::try_from(self.joints()).unwrap();
        let time = self.time();
        assert!(!joint.broken);
        assert!(joint.gap < gap, "misses by {} m at {time} s", joint.gap);
        assert!(joint.angle < angle, "misses by {} rad at {time} s", joint.angle);
        joint
    }

    /// Returns the velocity of the first dynamic body: linear and angular.
    fn velocity(&self) -> Vec<f64> {
        self.moving(AnyWorld::velocity)
    }

    /// Returns the pose of the first dynamic body: position and quaternion.
    fn pose(&self) -> Vec<f64> {
        self.moving(AnyWorld::pose)
    }

    fn moving(&self, of: impl Fn(&AnyWorld, BodyId) -> Option<Vec<f32>>) -> Vec<f64> {
        let moves = |body: &Body| body.motion == Motion::Dynamic;
        let slot = self.scene.bodies.iter().position(moves).unwrap();
        let id = self.world.body_at(slot).unwrap();
        of(&self.world, id).unwrap().into_iter().map(f64::from).collect()
    }

    /// Rotates a direction of a body into the world.
    fn direction(&self, body: usize, local: [f32; 3]) -> [f64; 3] {
        let q = self.world.pose(self.world.body_at(body).unwrap()).unwrap();
        let turn = parry3d::math::Rotation::from_xyzw(q[3], q[4], q[5], q[6]);
        (turn * parry3d::math::Vector::from(local)).to_array().map(f64::from)
    }
}

fn near(what: &str, measured: f64, expected: f64, within: f64) {
    let off = (measured - expected).abs();
    assert!(off <= within, "{what}: {measured}, expected {expected} within {within}");
}

/// Returns the period of a pendulum by the arithmetic-geometric mean. \[s\]
fn period(frequency: f64, amplitude: f64) -> f64 {
    let (mut a, mut b) = (1.0, (amplitude / 2.0).cos());
    for _ in 0..20 {
        (a, b) = ((a + b) / 2.0, (a * b).sqrt());
    }
    2.0 * PI / (frequency * a)
}

/// A fixed box of 1000 kg stays in place within 0.01 mm.
#[test]
fn a_fixed_box_stays() {
    let Some(mut sample) = Sample::test("00") else { return };
    let start = sample.pose();
    for _ in 0..10 * RATE {
        sample.step();
        sample.joint(1e-5, 1e-5);
        for (now, before) in sample.pose().into_iter().zip(&start) {
            near("pose", now, *before, 1e-5);
        }
    }
}

/// A cube that hangs by an edge swings between -45 and 45 degrees about that edge, x in one file
/// and z in the other, with the period of a physical pendulum.
#[test]
fn cubes_on_hinges_swing_as_pendulums() {
    for (number, axis) in [("02", 0), ("03", 2)] {
        let Some(mut sample) = Sample::test(number) else { return };
        let start = sample.pose();
        let anchor = [0.5, -0.5, 0.5];
        let angle = |sample: &Sample| {
            let pose = sample.pose();
            (pose[2 - axis] - anchor[2 - axis]).atan2(anchor[1] - pose[1])
        };
        let (mut last, mut crossings, mut largest) = (angle(&sample), Vec::new(), 0.0_f64);
        near("angle at the start", last, -FRAC_PI_4, 1e-6);
        for _ in 0..10 * RATE {
            sample.step();
            sample.joint(1e-5, 1e-5);
            near("position along the axis", sample.pose()[axis], start[axis], 1e-5);
            let now = angle(&sample);
            if (now < 0.0) != (last < 0.0) {
                crossings.push(sample.time() - now / (now - last) / RATE as f64);
            }
            (last, largest) = (now, largest.max(now.abs()));
        }
        // A cube of 1 m: moment 1/6 + 1/2 about an edge, whose distance is sqrt(1/2).
        let frequency = (GRAVITY * SQRT_2 / 2.0 / (2.0 / 3.0)).sqrt();
        let expected = period(frequency, FRAC_PI_4);
        let swings = (crossings.len() - 1) as f64 / 2.0;
        let measured = (crossings[crossings.len() - 1] - crossings[0]) / swings;
        println!("{number}: period {measured} s, expected {expected} s, {largest} rad at most");
        near("period", measured, expected, 1e-3 * expected);
        near("largest angle", largest, FRAC_PI_4, 1e-3);
    }
}

/// A slider of 45 degrees slides without friction from one limit to the other, 4 m away, and stays
/// there.
#[test]
fn a_slider_slides_to_its_other_limit() {
    let Some(mut sample) = Sample::test("05") else { return };
    let start = sample.pose();
    let slid = |sample: &Sample| {
        let pose = sample.pose();
        (pose[0] - start[0]).hypot(pose[1] - start[1])
    };
    for _ in 0..RATE {
        sample.step();
        sample.joint(1e-5, 1e-5);
    }
    let acceleration = GRAVITY * SQRT_2 / 2.0;
    near("slid in 1 s", slid(&sample), acceleration / 2.0, 1e-3 * acceleration);
    for _ in 0..2 * RATE {
        sample.step();
        sample.joint(1e-5, 1e-5);
    }
    near("slid at the end", slid(&sample), 4.0, 1e-4);
}

/// A slider whose bodies collide stops on the other body, 1 m from its center.
#[test]
fn a_slider_with_collision_stops_on_its_other_body() {
    let Some(mut sample) = Sample::test("06") else { return };
    for _ in 0..3 * RATE {
        sample.step();
        sample.joint(1e-5, 1e-4);
    }
    let pose = sample.pose();
    near("distance at the end", pose[0].hypot(pose[1]), 1.0, 1e-4);
    assert!(pose[0] < 0.0 && pose[1] > 0.0, "has passed: {pose:?}");
}

/// A limit on three axes keeps two points within 1 m, which the swinging box reaches.
#[test]
fn a_distance_stays_within_its_limit() {
    let Some(mut sample) = Sample::test("07") else { return };
    let mut farthest = 0.0_f64;
    for _ in 0..10 * RATE {
        sample.step();
        farthest = farthest.max(sample.joint(5e-5, 1e-5).values[0]);
    }
    near("largest distance", farthest, 1.0, 5e-5);
}

/// A box with its center of mass beside its hinge swings from level to level. Its origin, which is
/// on the axis, stays.
#[test]
fn a_center_of_mass_beside_the_hinge_swings() {
    let Some(mut sample) = Sample::test("08") else { return };
    let (mut lowest, mut other) = (0.0_f64, 0.0_f64);
    for _ in 0..10 * RATE {
        sample.step();
        sample.joint(1e-5, 1e-5);
        let arm = sample.direction(1, [0.0, 0.0, 1.0]);
        near("arm along the axis", arm[0], 0.0, 1e-5);
        assert!(arm[1] < 2e-3, "swings above its start: {arm:?}");
        (lowest, other) = (lowest.min(arm[1]), other.min(arm[2]));
    }
    near("lowest", lowest, -1.0, 2e-3);
    near("on the other side", other, -1.0, 2e-3);
}

/// A motor of 1.57 rad/s and damping 1/s brings its body to that angular velocity exponentially.
#[test]
fn an_angular_drive_reaches_its_velocity() {
    let Some(mut sample) = Sample::test("09") else { return };
    for _ in 0..10 * RATE {
        sample.step();
        sample.joint(1e-5, 1e-5);
        let expected = FRAC_PI_2 * (1.0 - (-sample.time()).exp());
        near("angular velocity", sample.velocity()[3], expected, 0.01 * FRAC_PI_2);
    }
}

/// A spring of 100/s^2 with damping 1/s bears the weight of its body 98.1 mm below the target. The
/// body moves as a damped oscillator.
#[test]
fn a_linear_drive_moves_as_an_oscillator() {
    let Some(mut sample) = Sample::test("10") else { return };
    for _ in 0..10 * RATE {
        sample.step();
        sample.joint(1e-5, 1e-5);
        let sag = oscillation(100.0, 1.0, sample.time()) * GRAVITY / 100.0;
        near("height", sample.pose()[1], 2.0 - sag, 1e-3);
    }
}

/// Returns the answer of an oscillator of mass 1 at rest to a constant force, as a part of the
/// displacement that remains.
fn oscillation(stiffness: f64, damping: f64, time: f64) -> f64 {
    let decay = damping / 2.0;
    let omega = (stiffness - decay * decay).sqrt();
    let turn = omega * time;
    1.0 - (-decay * time).exp() * (turn.cos() + decay / omega * turn.sin())
}

/// Joint of the sample `JointTypes` with two swings that are limited to 45 degrees. Where both are
/// at their limits, the axis is at 90 degrees, and may turn over.
const PYRAMID: &str = "jointSpaceA (node 38)";

/// Simulates the sample `JointTypes` for 10 s. All its joints hold their locks and limits, and its
/// two drives reach their targets.
fn all_types_of_joints_hold(settings: StepSettings) {
    let file = "gltf/khr_physics/samples/JointTypes/JointTypes.gltf";
    let Some(mut sample) = Sample::new(file, settings) else { return };
    assert_eq!(sample.scene.joints.len(), 11);
    let names: Vec<_> = sample.scene.joints.iter().map(|of| of.name.clone().unwrap()).collect();
    for _ in 0..10 * RATE {
        sample.step();
        for (name, joint) in names.iter().zip(sample.joints()) {
            let time = sample.time();
            assert!(joint.gap < 2e-4, "{name} misses by {} m at {time} s", joint.gap);
            let angle = if name == PYRAMID { 0.0 } else { joint.angle };
            assert!(angle < 2e-3, "{name} misses by {angle} rad at {time} s");
        }
    }
    let joints = sample.joints();
    let value = |name: &str, axis: usize| {
        joints[names.iter().position(|of| of == name).unwrap()].values[axis]
    };
    // A motor of -1.57 rad/s with damping 1/s; its body is not quite balanced.
    let turned = -1.57 * (10.0 - 1.0 + (-10.0_f64).exp());
    near("turned by the motor", value("jointSpaceA (node 45)", 3), turned, 0.01 * turned.abs());
    // A spring of 10 N/m with its rest at 1.2 m bears 1 kg.
    let raised = (1.2 - GRAVITY / 10.0) * oscillation(10.0, 0.1, 10.0);
    near("raised by the spring", value("jointSpaceA (node 51)", 1), raised, 1e-3);
}

/// All types of joints hold with 16 substeps.
#[test]
fn all_types_of_joints_hold_with_16_substeps() {
    all_types_of_joints_hold(StepSettings { substeps: 16, ..StepSettings::certified() });
}

/// So they do with fixed work.
#[test]
fn all_types_of_joints_hold_with_fixed_work() {
    all_types_of_joints_hold(StepSettings::quality());
}

/// All types of joints hold with the settings of bakes.
#[test]
fn all_types_of_joints_hold_in_bakes() {
    all_types_of_joints_hold(StepSettings::certified());
}

/// Two swings within 45 degrees keep their axes within the corner of a pyramid: 2 acos of 0.863,
/// by the formula of the extension.
#[test]
fn two_swings_do_not_turn_over() {
    let file = "gltf/khr_physics/samples/JointTypes/JointTypes.gltf";
    let Some(mut sample) = Sample::new(file, StepSettings::quality()) else { return };
    let joint = sample.scene.joints.iter().find(|of| of.name.as_deref() == Some(PYRAMID));
    let [Some(a), Some(b)] = joint.unwrap().bodies else { panic!("two bodies expected") };
    for _ in 0..10 * RATE {
        sample.step();
        // The locked twist is that about y in both bodies.
        let [a, b] = [a, b].map(|body| sample.direction(body, [0.0, 1.0, 0.0]));
        let cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let angle = cosine.clamp(-1.0, 1.0).acos().to_degrees();
        assert!(angle < 61.0, "{angle} degrees at {} s", sample.time());
    }
}

/// The robot has 14 joints whose bodies are simulated. They miss by less than 0.01 mm and 0.02
/// degrees, once the eyes are within their limits, which they miss by 1 mm at the start. The robot
/// stays on the floor.
#[test]
fn the_joints_of_the_robot_hold() {
    let file = "gltf/khr_physics/samples/Robot_skinned/Robot_skinned.gltf";
    let Some(mut sample) = Sample::new(file, StepSettings::certified()) else { return };
    assert_eq!(sample.scene.joints.len(), 14);
    let mut worst = [0.0_f64; 2];
    for _ in 0..10 * RATE {
        sample.step();
        if sample.time() > 0.5 {
            for joint in sample.joints() {
                assert!(!joint.broken);
                worst = [worst[0].max(joint.gap), worst[1].max(joint.angle)];
            }
        }
    }
    println!("misses by {} m and {} rad", worst[0], worst[1]);
    assert!(worst[0] < 1e-5 && worst[1] < 0.02_f64.to_radians(), "{worst:?}");
    let mut poses = Vec::new();
    sample.world.write_poses(&mut poses);
    let lowest = poses.chunks(7).map(|pose| pose[1]).fold(f32::INFINITY, f32::min);
    assert!(lowest > -0.5, "a body is at {lowest} m");
}

/// The joint of OpenUSD's example reaches the 10 degrees per second of its drive.
#[test]
fn the_driven_joint_of_openusd_turns() {
    let folder = "usd_physics/openusd/pxr/usd/usdPhysics/examples";
    let file = format!("{folder}/usdPhysicsJoints.usda");
    let Some(mut sample) = Sample::new(&file, StepSettings::certified()) else { return };
    for _ in 0..10 * RATE {
        sample.step();
        sample.joint(1e-5, 2e-4);
    }
    let speed = sample.velocity()[3..].iter().map(|x| x * x).sum::<f64>().sqrt();
    near("angular velocity", speed, 10.0_f64.to_radians(), 1e-3);
}
