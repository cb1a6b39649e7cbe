//! Regression tests on scenes in which other engines or earlier versions failed. The files are in
//! the folder `field` of the one that the environment variable DRYSTONE_DATA names; without it the
//! tests are skipped.
//!
//! Each case measures one number and has one bound. A case in [`AWAITING`] must exceed its bound:
//! one that holds has to leave the list.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

use drystone::StepSettings;
use drystone_bake::check::{FindingKind, check};
use drystone_bake::recording::Recording;
use drystone_bake::{AnyWorld, build};
use drystone_scene::{Read, Scene, ShapeKind};

use crate::common::worked;

/// Cases that do not hold yet.
const AWAITING: &[&str] =
    &["capsule, real-time preset", "dropped cone", "dropped cone, real-time preset"];

/// Asserts that a `measured` number is at most `bound`, or exceeds it for a case in [`AWAITING`].
/// NaN and a panic exceed every bound.
fn case(name: &str, bound: f64, unit: &str, measured: impl FnOnce() -> f64) {
    if folder().is_none() {
        return;
    }
    let value = catch_unwind(AssertUnwindSafe(measured)).unwrap_or(f64::NAN);
    println!("{name}: {value:.6} {unit}; accepted: up to {bound} {unit}");
    let holds = value <= bound;
    if AWAITING.contains(&name) {
        assert!(!holds, "{name} holds now, with {value} {unit}: take it off the list AWAITING");
    } else {
        assert!(holds, "{name}: {value} {unit}; accepted: up to {bound} {unit}");
    }
}

/// Returns the folder of the files, or None without DRYSTONE_DATA.
fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("DRYSTONE_DATA");
    if folder.is_none() {
        eprintln!("skipped: DRYSTONE_DATA is not set");
    }
    Some(PathBuf::from(folder?).join("field"))
}

fn path(file: &str) -> PathBuf {
    folder().unwrap_or_default().join(file)
}

fn read(file: &str) -> Read {
    drystone_bake::read(&path(file)).unwrap_or_else(|error| panic!("{error}"))
}

fn scene(file: &str) -> Scene {
    read(file).scene
}

/// The presets of `bake` and of `bake --realtime`.
#[derive(Clone, Copy)]
enum Preset {
    Certified,
    Realtime,
}
use Preset::{Certified, Realtime};

impl Preset {
    fn settings(self, scene: &Scene) -> StepSettings {
        let preset = match self {
            Certified => StepSettings::certified(),
            Realtime => StepSettings { certify: true, ..StepSettings::realtime() },
        };
        drystone_bake::settings(scene, preset).unwrap_or_else(|error| panic!("{error}"))
    }

    fn build(self, scene: &Scene) -> AnyWorld {
        build(scene, self.settings(scene)).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// A recorded run of a scene with its energies.
struct Film {
    recording: Recording,
    /// Kinetic and potential energy, before the first step and after each one. \[J\]
    energies: Vec<f64>,
    /// Kinetic energy at the same times. \[J\]
    kinetic: Vec<f64>,
}

type Point = [f64; 3];

fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: Point, b: Point) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

fn cross(a: Point, b: Point) -> Point {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

fn norm(v: Point) -> f64 {
    dot(v, v).sqrt()
}

/// A unit quaternion, x y z w.
type Quaternion = [f64; 4];

fn times(p: Quaternion, q: Quaternion) -> Quaternion {
    let ([a, b], [r, s]) = ([p, q].map(|of| [of[0], of[1], of[2]]), [p[3], q[3]]);
    let c = cross(a, b);
    let [x, y, z] = std::array::from_fn(|i| r * b[i] + s * a[i] + c[i]);
    [x, y, z, r * s - dot(a, b)]
}

fn inverse([x, y, z, w]: Quaternion) -> Quaternion {
    [-x, -y, -z, w]
}

fn turn(q: Quaternion, v: Point) -> Point {
    let [x, y, z, _] = times(times(q, [v[0], v[1], v[2], 0.0]), inverse(q));
    [x, y, z]
}

/// Returns the rotation vector of a quaternion. \[rad\]
fn rotation(q: Quaternion) -> Point {
    let sign = if q[3] < 0.0 { -1.0 } else { 1.0 };
    let axis = [q[0], q[1], q[2]].map(|x| x * sign);
    let sine = norm(axis);
    let angle = 2.0 * libm::atan2(sine, q[3] * sign);
    axis.map(|x| if sine > 0.0 { x / sine * angle } else { 0.0 })
}

impl Film {
    /// Bakes a scene for its number of steps, or for 10 s.
    fn of(scene: &Scene, preset: Preset) -> Self {
        let seconds = 10.0;
        let steps = scene.steps.unwrap_or((seconds / scene.time_step - 1e-6).ceil() as u32);
        Self::for_steps(scene, preset, steps)
    }

    fn for_steps(scene: &Scene, preset: Preset, steps: u32) -> Self {
        let mut world = preset.build(scene);
        let mut recording = Recording {
            dimension: scene.dimension,
            bodies: scene.bodies.len(),
            frame_time: scene.time_step,
            start: 0,
            poses: Vec::new(),
        };
        let (mut energies, mut kinetic) = (Vec::new(), Vec::new());
        world.write_poses(&mut recording.poses);
        for step in 0..=steps {
            if step > 0 {
                world.step(scene.time_step).unwrap();
                world.write_poses(&mut recording.poses);
            }
            let measure = world.measure();
            assert!(measure.finite, "not finite after {step} steps");
            energies.push(measure.kinetic_energy + measure.potential_energy);
            kinetic.push(measure.kinetic_energy);
        }
        Self { recording, energies, kinetic }
    }

    fn last(&self) -> usize {
        self.recording.frames() - 1
    }

    fn frames(&self) -> std::ops::RangeInclusive<usize> {
        0..=self.last()
    }

    fn position(&self, frame: usize, body: usize) -> Point {
        let pose = self.recording.pose(frame, body);
        std::array::from_fn(|i| f64::from(pose[i]))
    }

    fn rotation(&self, frame: usize, body: usize) -> Quaternion {
        let pose = self.recording.pose(frame, body);
        let q: Quaternion = std::array::from_fn(|i| f64::from(pose[3 + i]));
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        q.map(|x| x / length)
    }

    /// Returns the world position of a point of a body, which is given in the frame of the body.
    /// \[m\]
    fn point(&self, frame: usize, body: usize, local: Point) -> Point {
        let (at, arm) = (self.position(frame, body), turn(self.rotation(frame, body), local));
        std::array::from_fn(|i| at[i] + arm[i])
    }

    /// Returns the mean velocity of a body since the frame before. \[m/s\]
    fn velocity(&self, frame: usize, body: usize) -> Point {
        let way = minus(self.position(frame, body), self.position(frame - 1, body));
        way.map(|x| x / self.recording.frame_time)
    }

    /// Returns the mean angular velocity of a body since the frame before, in world axes. \[rad/s\]
    fn spin(&self, frame: usize, body: usize) -> Point {
        let [from, to] = [frame - 1, frame].map(|frame| self.rotation(frame, body));
        rotation(times(to, inverse(from))).map(|x| x / self.recording.frame_time)
    }

    /// Returns the largest value of a function over all frames.
    fn most(&self, of: impl Fn(usize) -> f64) -> f64 {
        self.frames().map(of).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns the largest distance of any of these bodies from its start. \[mm\]
    fn moved(&self, bodies: std::ops::Range<usize>) -> f64 {
        let far = |frame| {
            let way = |body| minus(self.position(frame, body), self.position(0, body));
            bodies.clone().map(|body| norm(way(body))).fold(0.0, f64::max)
        };
        1e3 * self.most(far)
    }

    /// Returns the largest angle between an axis of a body and the vertical. \[deg\]
    fn tilt(&self, body: usize, axis: Point) -> f64 {
        self.most(|frame| {
            let up = turn(self.rotation(frame, body), axis)[1];
            libm::acos(up.clamp(-1.0, 1.0)).to_degrees()
        })
    }

    /// Returns the highest energy above that of the start, relative to the largest loss. \[%\]
    fn energy_rise(&self) -> f64 {
        let highest = self.energies.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let lowest = self.energies.iter().copied().fold(f64::INFINITY, f64::min);
        100.0 * (highest - self.energies[0]) / (self.energies[0] - lowest).abs().max(1e-12)
    }
}

const UP: Point = [0.0, 1.0, 0.0];

/// A panel stays within 0.1 degrees of upright.
#[test]
fn panel_stands() {
    case("panel", 0.1, "deg", || Film::of(&scene("01_panel_falls.json"), Certified).tilt(1, UP));
}

/// A lying can moves by at most 1 mm.
#[test]
fn can_lies() {
    case("can", 1.0, "mm", || Film::of(&scene("02_can_rolls_off.json"), Certified).moved(1..2));
}

/// A weeble tilts by at most 29 degrees.
#[test]
fn weeble_rocks() {
    case("weeble", 29.0, "deg", || Film::of(&scene("03_weeble.json"), Certified).tilt(1, UP));
}

/// Returns the frames in which the center of the slider is over the second box.
fn over_the_seam(film: &Film) -> impl Iterator<Item = usize> {
    let beyond = |x: f64| (0.3..1.7).contains(&x);
    film.frames().skip(1).filter(move |&frame| beyond(film.position(frame, 2)[0]))
}

/// A box that slides over a seam at 4 m/s stays within 1 % of its speed and rises by at most 1 mm.
#[test]
fn box_slides_over_a_seam() {
    let film = || Film::of(&scene("04_seam.json"), Certified);
    case("seam speed", 1.0, "%", || {
        let film = film();
        let off = |frame| 100.0 * (film.velocity(frame, 2)[0] / 4.0 - 1.0).abs();
        assert!(over_the_seam(&film).next().is_some(), "never gets there");
        over_the_seam(&film).map(off).fold(0.0, f64::max)
    });
    case("seam height", 1.0, "mm", || {
        let film = film();
        1e3 * film.most(|frame| film.position(frame, 2)[1] - 0.2)
    });
}

/// A rotating tool keeps its kinetic energy within 1 %.
#[test]
fn tool_keeps_its_energy() {
    for (name, preset) in [("tool", Certified), ("tool, real-time preset", Realtime)] {
        case(name, 1.0, "%", || {
            let film = Film::of(&scene("05_spin_gains.json"), preset);
            100.0 * film.most(|frame| (film.kinetic[frame] / film.kinetic[0] - 1.0).abs())
        });
    }
}

/// Bodies of infinite mass move like bodies of large mass, within 1 %.
#[test]
fn infinite_mass_turns_as_a_large_one() {
    case("infinite mass", 1.0, "%", || {
        let film = Film::of(&scene("06_infinite_mass.json"), Certified);
        100.0 * (film.spin(film.last(), 0)[2] / -1.8175 - 1.0).abs()
    });
    case("plate of infinite mass", 1.0, "%", || {
        let infinite = scene("robust/inf.toml");
        let mut large = infinite.clone();
        large.bodies[0].mass.mass = Some(1e6);
        large.bodies[0].mass.inertia = Some(vec![1e6, 1.0, 1e6]);
        let [one, other] = [&infinite, &large].map(|scene| Film::of(scene, Certified));
        // Later the plate of 1e6 kg tilts under the ball, by 0.3 mrad in 10 s, and the ball rolls
        // away by 18 mm.
        let two_seconds = 120;
        let [a, b] = [&one, &other].map(|film| film.position(two_seconds, 1));
        100.0 * norm(minus(a, b)) / norm(minus(b, other.position(0, 1)))
    });
}

/// A ball drifts along its trough by at most 5 mm.
#[test]
fn trough_does_not_push_along() {
    for (name, preset) in [("trough", Certified), ("trough, real-time preset", Realtime)] {
        case(name, 5.0, "mm", || {
            let film = Film::of(&scene("07_trough_drift.json"), preset);
            let start = film.position(0, 1)[2];
            1e3 * film.most(|frame| (film.position(frame, 1)[2] - start).abs())
        });
    }
}

/// All six marbles stay in their cup.
#[test]
fn cup_keeps_its_marbles() {
    case("cup", 0.0, "marbles lost", || {
        let film = Film::of(&scene("08_cup_outward.json"), Certified);
        let inside = |body: usize| {
            let [x, y, z] = film.position(film.last(), body);
            y > 0.05 && libm::hypot(x, z) < 0.12
        };
        (2..8).filter(|&body| !inside(body)).count() as f64
    });
}

/// A conveyor carries its load by at least 0.5 m in 60 steps.
#[test]
fn conveyor_moves() {
    case("conveyor", -0.5, "m", || {
        let film = Film::for_steps(&scene("09_conveyor.usda"), Certified, 60);
        film.position(0, 1)[0] - film.position(film.last(), 1)[0]
    });
}

/// Bricks move by at most 1 mm in the real-time preset.
#[test]
fn bricks_stay() {
    case("bricks", 1.0, "mm", || Film::of(&scene("10_bricks_realtime.json"), Realtime).moved(1..7));
}

/// A cone that stands on a mesh moves by at most 1 mm.
#[test]
fn cone_stands_on_a_mesh() {
    for (name, preset) in [("cone", Certified), ("cone, real-time preset", Realtime)] {
        case(name, 1.0, "mm", || Film::of(&scene("11_cone_on_mesh.json"), preset).moved(1..2));
    }
}

/// A cone dropped onto a mesh penetrates it by at most 1 mm.
#[test]
fn cone_lands_on_a_mesh() {
    for (name, preset) in
        [("dropped cone", Certified), ("dropped cone, real-time preset", Realtime)]
    {
        case(name, 1.0, "mm", || {
            let scene = scene("12_cone_dropped_on_mesh.json");
            let film = Film::of(&scene, preset);
            let ShapeKind::ConvexHull { points } = &scene.bodies[1].shapes[0].kind else {
                panic!("the cone is no hull");
            };
            let deepest = |frame| {
                let height = |p: &Vec<f64>| film.point(frame, 1, [p[0], p[1], p[2]])[1];
                points.iter().map(|p| -height(p)).fold(f64::NEG_INFINITY, f64::max)
            };
            1e3 * film.most(deepest)
        });
    }
}

/// Returns the deepest overlap of a light round body with a floor or with a heavy ball. \[mm\]
fn squeezed(file: &str) -> f64 {
    let scene = scene(file);
    let film = Film::of(&scene, Certified);
    let (radius, half) = match scene.bodies[1].shapes[0].kind {
        ShapeKind::Sphere { radius } => (radius, 0.0),
        ShapeKind::Capsule { radius, half_height } => (radius, half_height),
        _ => panic!("the light body is not round"),
    };
    let ShapeKind::Sphere { radius: heavy } = scene.bodies[2].shapes[0].kind else {
        panic!("the heavy body is no ball");
    };
    1e3 * film.most(|frame| {
        let ends = [-half, half].map(|y| film.point(frame, 1, [0.0, y, 0.0]));
        let in_floor = ends.map(|end| radius - end[1]).into_iter().fold(0.0, f64::max);
        let (center, along) = (film.position(frame, 2), minus(ends[1], ends[0]));
        let length = dot(along, along);
        let from = minus(center, ends[0]);
        let t = if length > 0.0 { (dot(from, along) / length).clamp(0.0, 1.0) } else { 0.0 };
        let apart = norm(minus(from, along.map(|x| x * t)));
        in_floor.max(radius + heavy - apart)
    })
}

/// A heavy ball that bounces onto a lying ball presses it by at most 3 mm, and a capsule by at most
/// 5 mm.
#[test]
fn bounce_onto_a_resting_body_presses_no_body() {
    case("squeeze", 3.0, "mm", || squeezed("motion/1_squeeze_e005_ratio1.json"));
    case("squeezed capsule", 5.0, "mm", || squeezed("motion/1_squeeze_capsule_129mm.json"));
}

/// A capsule at a wall moves by at most 1 mm in the last second.
#[test]
fn capsule_comes_to_rest_at_a_wall() {
    for (name, preset) in [("capsule", Certified), ("capsule, real-time preset", Realtime)] {
        case(name, 1.0, "mm in the last second", || {
            let film = Film::of(&scene("motion/2_capsule_wall.json"), preset);
            let last = film.last();
            // Both ends of its segment are followed, so that rotation counts too.
            let way = |y| {
                let [from, to] =
                    [last - 60, last].map(|frame| film.point(frame, 2, [0.0, y, 0.065]));
                norm(minus(to, from))
            };
            1e3 * way(-0.045).max(way(0.045))
        });
    }
}

/// Boxes given as hulls collide with the velocities of boxes, within 5 %.
#[test]
fn hulls_collide_as_boxes() {
    case("hulls", 5.0, "%", || {
        let [boxes, hulls] = ["motion/2b_box_right.json", "motion/2b_hull_ghost.json"]
            .map(|file| Film::of(&scene(file), Certified));
        let last = boxes.last();
        let off = |a: Point, b: Point| 100.0 * norm(minus(a, b)) / norm(a);
        let of_body = |body| {
            let linear = off(boxes.velocity(last, body), hulls.velocity(last, body));
            linear.max(off(boxes.spin(last, body), hulls.spin(last, body)))
        };
        of_body(0).max(of_body(1))
    });
}

/// A toppling box is at the exact angle after 0.8 s. The error is at most 0.007 rad with 60 steps
/// per second, and 0.001 rad with 960.
#[test]
fn box_topples_with_the_realtime_preset() {
    for (name, rate, bound) in [("topple at 1/60", 60u32, 0.007), ("topple at 1/960", 960, 0.001)] {
        case(name, bound, "rad", || {
            let mut scene = scene("motion/3_topple_realtime.json");
            scene.time_step = 1.0 / f64::from(rate);
            let film = Film::for_steps(&scene, Realtime, rate * 4 / 5);
            let start = scene.bodies[1].position[0].atan2(scene.bodies[1].position[1]);
            let [from, to] = [0, film.last()].map(|frame| film.rotation(frame, 1));
            let turned = rotation(times(to, inverse(from)))[2];
            (start - turned - 0.7263).abs()
        });
    }
}

/// Returns the volume of the convex hull of points. No four points of its surface may lie in one
/// plane. \[m^3\]
fn volume(points: &[Point]) -> f64 {
    let count = points.len();
    let mut sum = 0.0;
    for i in 0..count {
        for j in i + 1..count {
            for k in j + 1..count {
                let [a, b, c] = [i, j, k].map(|index| minus(points[index], points[0]));
                let normal = cross(minus(b, a), minus(c, a));
                let side = |index: usize| dot(normal, minus(minus(points[index], points[0]), a));
                let others = || (0..count).filter(|index| ![i, j, k].contains(index)).map(side);
                if others().all(|x| x > 0.0) || others().all(|x| x < 0.0) {
                    sum += (dot(a, cross(b, c)) / 6.0).abs();
                }
            }
        }
    }
    sum
}

/// A hull has the mass of its exact volume, within 1e-6.
#[test]
fn hull_has_its_mass() {
    case("hull's mass", 1e-6, "of the mass", || {
        let scene = scene("motion/4_hull_mass.json");
        let ShapeKind::ConvexHull { points } = &scene.bodies[0].shapes[0].kind else {
            panic!("is no hull");
        };
        let points: Vec<Point> = points.iter().map(|p| [p[0], p[1], p[2]]).collect();
        let exact = scene.bodies[0].mass.density.unwrap() * volume(&points);
        (Certified.build(&scene).masses()[0] / exact - 1.0).abs()
    });
}

/// A far body that touches nothing changes no bit of the motion of four others.
#[test]
fn bodies_that_touch_nothing_change_no_bit() {
    case("far body", 0.0, "numbers that differ", || {
        let [with, without] = ["motion/5_far_with.json", "motion/5_far_without.json"]
            .map(|file| Film::of(&scene(file), Certified).recording);
        let differ = |frame: usize, body: usize| {
            let [a, b] = [&with, &without].map(|of| of.pose(frame, body));
            a.iter().zip(b).filter(|(x, y)| x.to_bits() != y.to_bits()).count()
        };
        let frames = 0..without.frames();
        frames.map(|f| (0..4).map(|body| differ(f, body)).sum::<usize>()).sum::<usize>() as f64
    });
}

/// Drops a stick and returns the rise of the energy above its start \[%\], or infinity if the stick
/// does not lie in the end. The floor is at height `floor`, and the center of a lying stick is
/// `half` above it \[m\].
fn dropped(file: &str, preset: Preset, [floor, half]: [f64; 2]) -> f64 {
    let film = Film::of(&scene(file), preset);
    let height = film.position(film.last(), 1)[1] - floor;
    if (height - half).abs() > 0.5 * half {
        eprintln!("{file}: {height} m above the floor in the end");
        return f64::INFINITY;
    }
    film.energy_rise()
}

/// Dropped sticks lie in the end, and their energy rises by at most 1 %.
#[test]
fn sticks_lie() {
    for (name, file, floor, half) in [
        ("pencil", "pencil", 0.0, 0.0035),
        ("stick", "stick", 0.0, 0.002),
        ("stick of 10 mm", "stick_realtime_10mm", 0.0, 0.005),
        ("stick on a table", "stick_panic", 0.5, 0.001),
    ] {
        let file = match file {
            "stick_realtime_10mm" => format!("robust/{file}.json"),
            _ => format!("robust/{file}_realtime.json"),
        };
        case(name, 1.0, "% of the energy", || dropped(&file, Realtime, [floor, half]));
        let name = format!("{name} in a bake");
        case(&name, 1.0, "% of the energy", || dropped(&file, Certified, [floor, half]));
    }
    for (name, preset) in [("rod", Certified), ("rod, real-time preset", Realtime)] {
        case(name, 1.0, "% of the energy", || {
            dropped("robust/rod_panic.json", preset, [0.0, 5e-5])
        });
    }
}

/// A needle as a hull is refused, or the energy of its fall rises by at most 1 %.
#[test]
fn needle_is_refused_or_falls() {
    for (name, preset) in [("needle", Certified), ("needle, real-time preset", Realtime)] {
        case(name, 1.0, "% of the energy", || {
            let scene = scene("robust/hull_panic.json");
            match build(&scene, preset.settings(&scene)) {
                Err(_) => 0.0,
                Ok(_) => Film::of(&scene, preset).energy_rise(),
            }
        });
    }
}

/// A box rests at its height on a quad within 1 mm, also with z up.
#[test]
fn box_rests_on_a_quad() {
    // A scene with z up is rotated to have y up.
    let up = 1;
    for (name, file) in
        [("quad", "quad_hull_double_sided"), ("quad with z up", "quad_z_up_looks_down")]
    {
        case(name, 1.0, "mm", || {
            let film = Film::of(&scene(&format!("robust/{file}.usda")), Certified);
            let body =
                (0..2).max_by(|&a, &b| film.position(0, a)[up].total_cmp(&film.position(0, b)[up]));
            1e3 * (film.position(film.last(), body.unwrap())[up] - 0.25).abs()
        });
    }
}

/// The check of a tall box names its jam within 1 s, and its first step takes at most 1 s.
#[test]
fn check_answers_within_a_second() {
    case("check of a tall box", 1.0, "s", || {
        worked(|| {
            let read = read("robust/ws_s10.gltf");
            let findings = check(&read, &Certified.settings(&read.scene)).unwrap();
            assert!(findings.iter().any(|of| of.kind == FindingKind::Wedged), "no jam is named");
        })
    });
    case("first step of a tall box", 1.0, "s", || {
        let scene = scene("robust/ws_s10.gltf");
        let mut world = Certified.build(&scene);
        worked(|| drop(world.step(scene.time_step).unwrap()))
    });
}

/// A stage that inherits from an absent class still has its two bodies.
#[test]
fn absent_class_composes_to_nothing() {
    case("absent class", 0.0, "bodies missing", || {
        2.0 - scene("robust/inherits_missing_class.usda").bodies.len() as f64
    });
}

/// Every file of the collection is named in this one.
#[test]
fn every_file_has_a_case() {
    let Some(folder) = folder() else { return };
    let text = include_str!("field.rs");
    for part in ["", "motion", "robust"] {
        for entry in fs::read_dir(folder.join(part)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            let known = text.contains(name.trim_end_matches("_realtime"));
            assert!(path.is_dir() || name == "README" || known, "{name} has no case");
        }
    }
}

/// The helpers of this file give known rotations, angles and volumes within 1e-12.
#[test]
fn angles_and_volumes_have_known_values() {
    let quarter = libm::sqrt(0.5);
    let about_z = [0.0, 0.0, quarter, quarter];
    let turned = turn(about_z, [1.0, 0.0, 0.0]);
    assert!(norm(minus(turned, UP)) < 1e-12, "{turned:?}");
    let angle = rotation(about_z);
    assert!(norm(minus(angle, [0.0, 0.0, std::f64::consts::FRAC_PI_2])) < 1e-12, "{angle:?}");
    let corner = [[0.0; 3], [1.0, 0.0, 0.0], UP, [0.0, 0.0, 1.0], [0.1, 0.1, 0.1]];
    assert!((volume(&corner) - 1.0 / 6.0).abs() < 1e-12);
}
