use std::path::Path;

use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

use super::*;
use crate::description::{Mass, ShapeKind};
use crate::error::SceneError;
use crate::format::{read_json, read_toml};

fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(-0.0), -1e6..1e6, -1e-3..1e-3, -10.0..10.0]
}

fn vector(n: usize) -> impl Strategy<Value = Vec<f64>> {
    vec(coordinate(), n)
}

fn unit(n: usize) -> impl Strategy<Value = Vec<f64>> {
    let nonzero = |v: &Vec<f64>| v.iter().map(|x| x * x).sum::<f64>() > 1e-3;
    vec(-1.0..1.0, n).prop_filter("too short", nonzero).prop_map(|v: Vec<f64>| {
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        v.iter().map(|x| x / length).collect()
    })
}

fn quaternion() -> impl Strategy<Value = [f64; 4]> {
    unit(4).prop_map(|v| v.try_into().unwrap())
}

fn rotation(dimension: usize) -> BoxedStrategy<Rotation> {
    if dimension == 2 {
        return coordinate().prop_map(Rotation::Angle).boxed();
    }
    prop_oneof![Just(Rotation::identity(3)), quaternion().prop_map(Rotation::Quaternion)].boxed()
}

fn combine() -> impl Strategy<Value = Combine> {
    use Combine::*;
    prop::sample::select(vec![Average, Minimum, Maximum, Multiply, GeometricMean])
}

fn material() -> impl Strategy<Value = Material> {
    let resistance = || prop_oneof![Just(0.0), 0.0..10.0];
    let numbers = (0.0..1e6, 0.0..=1.0, resistance(), resistance());
    let made =
        (numbers, combine(), combine()).prop_map(|((f, r, rolling, spinning), fc, rc)| Material {
            friction: f,
            restitution: r,
            rolling_resistance: rolling,
            spinning_resistance: spinning,
            friction_combine: fc,
            restitution_combine: rc,
        });
    prop_oneof![Just(Material::default()), made]
}

fn damping() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), 0.0..10.0]
}

fn surface_velocity(dimension: usize) -> impl Strategy<Value = Option<SurfaceVelocity>> {
    let turns = if dimension == 3 { 3 } else { 1 };
    let angular = prop_oneof![Just(vec![0.0; turns]), vector(turns)];
    let made = (vector(dimension), angular, any::<bool>())
        .prop_map(|(linear, angular, local)| SurfaceVelocity { linear, angular, local });
    option::of(made)
}

fn filter() -> impl Strategy<Value = Filter> {
    let made = (any::<u64>(), any::<u64>(), any::<bool>()).prop_map(|(s, c, u)| Filter {
        systems: s,
        collides_with: c,
        collides_with_unnamed: u,
    });
    prop_oneof![Just(Filter::default()), made]
}

/// Random points around the corners of a simplex, so that they span the space.
fn hull(dimension: usize) -> impl Strategy<Value = ShapeKind> {
    vec(vec(-0.3..0.3, dimension), dimension + 1).prop_map(|mut points: Vec<Vec<f64>>| {
        points.iter_mut().enumerate().skip(1).for_each(|(i, p)| p[i - 1] += 10.0);
        ShapeKind::ConvexHull { points }
    })
}

fn kind(dimension: usize, motion: Motion) -> BoxedStrategy<ShapeKind> {
    let size = || 1e-5..1e6;
    let mut kinds = vec![
        size().prop_map(|radius| ShapeKind::Sphere { radius }).boxed(),
        vec(size(), dimension).prop_map(|half_extents| ShapeKind::Box { half_extents }).boxed(),
        (size(), 0.0..1e6)
            .prop_map(|(radius, half_height)| ShapeKind::Capsule { radius, half_height })
            .boxed(),
        hull(dimension).boxed(),
    ];
    if dimension == 3 {
        let cylinder = |(radius, half_height)| ShapeKind::Cylinder { radius, half_height };
        kinds.push((size(), size()).prop_map(cylinder).boxed());
    }
    if motion != Motion::Dynamic {
        kinds.push(unit(dimension).prop_map(|normal| ShapeKind::Halfspace { normal }).boxed());
    }
    if motion != Motion::Dynamic && dimension == 3 {
        let mesh = ShapeKind::Trimesh {
            decomposition: None,
            vertices: vec![[0.1, 0.2, 0.3], [1.0, 0.0, -0.0], [0.0, 1e-3, 7.0]],
            triangles: vec![[0, 1, 2], [2, 1, 0]],
        };
        kinds.push(Just(mesh).boxed());
    }
    prop::strategy::Union::new(kinds).boxed()
}

fn shape(dimension: usize, motion: Motion) -> impl Strategy<Value = Shape> {
    let place = (vector(dimension), rotation(dimension));
    let surface = (material(), surface_velocity(dimension));
    let parts = (kind(dimension, motion), place, surface, filter());
    parts.prop_map(|(kind, (position, rotation), (material, surface_velocity), filter)| Shape {
        kind,
        position,
        rotation,
        material,
        surface_velocity,
        filter,
    })
}

fn mass(dimension: usize, motion: Motion) -> BoxedStrategy<Mass> {
    if motion != Motion::Dynamic {
        return Just(Mass::default()).boxed();
    }
    let moments = if dimension == 3 { 3 } else { 1 };
    let inertia = option::of(vec(prop_oneof![Just(f64::INFINITY), 1e-6..1e6], moments));
    let axes = if dimension == 3 { option::of(quaternion()).boxed() } else { Just(None).boxed() };
    let total = option::of(prop_oneof![Just(f64::INFINITY), 1e-12..1e15]);
    let parts = (option::of(1e-12..1e15), total, option::of(vector(dimension)), inertia, axes);
    let made = |(density, mass, center, inertia, inertia_rotation): (
        Option<f64>,
        Option<f64>,
        _,
        _,
        _,
    )| {
        let density = if mass.is_some() { None } else { density };
        Mass { density, mass, center, inertia, inertia_rotation }
    };
    parts.prop_map(made).boxed()
}

fn track(dimension: usize, motion: Motion) -> BoxedStrategy<Track> {
    if motion != Motion::Kinematic {
        return Just(Track::default()).boxed();
    }
    vec((1e-3..10.0, vector(dimension), rotation(dimension)), 0..4)
        .prop_map(|keys: Vec<(f64, _, _)>| {
            let mut track = Track::default();
            for (wait, position, rotation) in keys {
                track.times.push(track.times.last().unwrap_or(&-1.0) + wait);
                track.positions.push(position);
                track.rotations.push(rotation);
            }
            track
        })
        .boxed()
}

fn body(dimension: usize) -> impl Strategy<Value = Body> {
    let motions = vec![Motion::Dynamic, Motion::Static, Motion::Kinematic];
    prop::sample::select(motions).prop_flat_map(move |motion| {
        let moments = if dimension == 3 { 3 } else { 1 };
        let least = usize::from(motion == Motion::Dynamic);
        (
            vector(dimension),
            rotation(dimension),
            vector(dimension),
            vector(moments),
            mass(dimension, motion),
            (prop_oneof![Just(1.0), -2.0..2.0], damping(), damping(), surface_velocity(dimension)),
            vec(shape(dimension, motion), least..4),
            track(dimension, motion),
        )
            .prop_map(
                move |(position, rotation, linear_velocity, spin, mass, rest, shapes, track)| {
                    Body {
                        name: None,
                        motion,
                        position,
                        rotation,
                        linear_velocity,
                        angular_velocity: spin,
                        mass,
                        gravity_factor: rest.0,
                        linear_damping: rest.1,
                        angular_damping: rest.2,
                        surface_velocity: rest.3,
                        shapes,
                        track,
                    }
                },
            )
    })
}

fn scene() -> impl Strategy<Value = Scene> {
    (2..=3usize).prop_flat_map(|dimension| {
        let solver = prop_oneof![
            Just(serde_json::json!({})),
            Just(serde_json::json!({"substeps": 8, "repair": 0.2})),
        ];
        (
            option::of(".*"),
            vector(dimension),
            prop_oneof![Just(TIME_STEP), 1e-6..=1.0],
            option::of(0..=10_000_000u32),
            vec((option::of("[^\\n]{0,9}"), body(dimension)), 0..4),
            solver,
        )
            .prop_map(move |(name, gravity, time_step, steps, bodies, solver)| Scene {
                name,
                dimension,
                gravity,
                time_step,
                steps,
                bodies_as: BodiesAs::Rigid,
                joints: Vec::new(),
                bodies: numbered(bodies),
                solver: solver.as_object().unwrap().clone(),
            })
    })
}

fn numbered(bodies: Vec<(Option<String>, Body)>) -> Vec<Body> {
    let named = bodies.into_iter().enumerate();
    named.map(|(i, (name, body))| Body { name: name.map(|n| format!("{n}{i}")), ..body }).collect()
}

/// Compares by debug output, which shows every bit of a number, including the sign of zero; `==`
/// does not.
fn check(scene: &Scene, read: Result<crate::Read, SceneError>, text: &str) {
    let read = read.unwrap_or_else(|error| panic!("{error}\n{text}")).scene;
    assert_eq!(format!("{scene:?}"), format!("{read:?}"), "{text}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn reading_what_was_written_gives_the_same_scene(scene in scene()) {
        let json = to_json(&scene);
        check(&scene, read_json(Path::new("scene.json"), &json), &json);
        let toml = to_toml(&scene);
        check(&scene, read_toml(Path::new("scene.toml"), &toml), &toml);
    }
}

#[test]
fn defaults_are_left_out() {
    let text = "[[bodies]]\n\n[[bodies.shapes]]\ntype = \"sphere\"\nradius = 0.5\n";
    let scene = read_toml(Path::new("scene.toml"), text).unwrap().scene;
    assert_eq!(to_toml(&scene), text);
}

#[test]
fn particles_keep_their_default_friction() {
    let text = "bodies_as = \"particles\"\n\n[[bodies]]\n\n[[bodies.shapes]]\ntype = \"sphere\"\n\
                radius = 0.5\n";
    let scene = read_toml(Path::new("scene.toml"), text).unwrap().scene;
    assert_eq!(to_toml(&scene), text);
}
