use std::path::Path;

use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

use super::*;
use crate::description::{Mass, ShapeKind};
use crate::error::SceneError;
use crate::format::{read_json, read_toml};
use crate::joint::{Breaking, Coordinate, Drive, Joint, JointAxis, JointFrame, Softness};

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

pub(crate) fn quaternion() -> impl Strategy<Value = [f64; 4]> {
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
            vertex_track: None,
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
    if motion == Motion::Static {
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
            (prop_oneof![Just(vec![0.0; dimension]), vector(dimension)], any::<bool>()),
            vec(shape(dimension, motion), least..4),
            track(dimension, motion),
        )
            .prop_map(
                move |(
                    position,
                    rotation,
                    linear_velocity,
                    spin,
                    mass,
                    rest,
                    more,
                    shapes,
                    track,
                )| {
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
                        force: more.0,
                        start_asleep: more.1 && motion == Motion::Dynamic && track.times.is_empty(),
                        surface_velocity: rest.3,
                        shapes,
                        track,
                    }
                },
            )
    })
}

fn limits(is_unsigned: bool) -> BoxedStrategy<Option<[f64; 2]>> {
    let lowest = if is_unsigned { 0.0 } else { -1e6 };
    let made = (lowest..1e6, 0.0..1e3).prop_map(|(low, width)| [low, low + width]);
    let mut choices = vec![
        Just([0.0, 0.0]).boxed(),
        Just([-0.0, 0.0]).boxed(),
        Just([0.0, 1.0]).boxed(),
        Just([0.25, f64::INFINITY]).boxed(),
        Just([f64::NEG_INFINITY, f64::INFINITY]).boxed(),
        made.prop_map(|[low, high]: [f64; 2]| [low, high.min(1e6)]).boxed(),
    ];
    if !is_unsigned {
        choices.push(Just([f64::NEG_INFINITY, -0.0]).boxed());
    }
    option::of(prop::strategy::Union::new(choices)).boxed()
}

fn load() -> impl Strategy<Value = f64> {
    prop_oneof![Just(f64::INFINITY), 0.0..1e20, 0.0..10.0]
}

fn drive() -> impl Strategy<Value = Drive> {
    let stiffness = prop_oneof![Just(0.0), 0.0..1e20, 0.0..1e3];
    (coordinate(), coordinate(), stiffness, load(), load(), any::<bool>()).prop_map(
        |(position, velocity, stiffness, damping, max_force, acceleration)| Drive {
            position,
            velocity,
            stiffness,
            damping,
            max_force,
            acceleration,
        },
    )
}

fn axis(coordinate: Coordinate) -> impl Strategy<Value = JointAxis> {
    use Coordinate::*;
    let is_unsigned = matches!(
        coordinate,
        Radial(_) | Distance | Cone | EllipticCone(_) | Rotation | Pulley { .. }
    );
    let softness = (0.0..1e20, prop_oneof![Just(0.0), 0.0..1e20])
        .prop_map(|(stiffness, damping)| Softness { stiffness, damping });
    let friction = prop_oneof![Just(0.0), 0.0..1e20];
    (limits(is_unsigned), option::of(softness), vec(drive(), 0..3), friction).prop_map(
        move |(limits, softness, drives, friction)| JointAxis {
            coordinate,
            limits,
            softness,
            drives,
            friction,
        },
    )
}

/// Every coordinate of a dimension, each with parameters of its own.
fn coordinates(dimension: usize) -> BoxedStrategy<Vec<Coordinate>> {
    use Coordinate::*;
    let number = || prop_oneof![Just(1.0), 0.0..1e3];
    let points = (vector(dimension), vector(dimension)).prop_map(|(mut p, mut q)| {
        p.resize(3, 0.0);
        q.resize(3, 0.0);
        [p.try_into().unwrap(), q.try_into().unwrap()]
    });
    let parameters = (number(), number(), number(), points, number(), [1e-6..3.1, 1e-6..3.1]);
    let all = parameters.prop_map(move |(ratio, radius, pitch, points, weight, half_angles)| {
        let pulley = Pulley { points, ratio: weight };
        if dimension == 2 {
            let plain = vec![Linear(0), Linear(1), Distance, Angle];
            return [plain, vec![Gear { ratio }, Rack { radius: -radius }, pulley]].concat();
        }
        let linear = vec![Linear(0), Linear(1), Linear(2), Radial(0), Radial(1), Radial(2)];
        let angular = vec![Twist, Swing(1), Swing(2), Cone, EllipticCone(half_angles), Rotation];
        let cardan = vec![Cardan(0), Cardan(1), Cardan(2), Distance];
        let couplings = vec![Gear { ratio: -ratio }, Rack { radius }, Screw { pitch }, pulley];
        [linear, angular, cardan, couplings].concat()
    });
    all.prop_flat_map(|all| {
        let count = all.len();
        prop::sample::subsequence(all, 0..=count.min(7)).prop_shuffle()
    })
    .boxed()
}

fn frame(dimension: usize) -> impl Strategy<Value = JointFrame> {
    (vector(dimension), rotation(dimension))
        .prop_map(|(position, rotation)| JointFrame { position, rotation })
}

/// Joints of the dynamic bodies with others and with the world.
pub(crate) fn joints(dimension: usize, bodies: &[Body]) -> BoxedStrategy<Vec<Joint>> {
    let others: Vec<_> = (0..bodies.len()).map(Some).chain([None]).collect();
    let moves = |i: &usize| bodies[*i].motion == Motion::Dynamic;
    let dynamic: Vec<_> = (0..bodies.len()).filter(moves).collect();
    if dynamic.is_empty() {
        return Just(Vec::new()).boxed();
    }
    let pair = (prop::sample::select(dynamic), prop::sample::select(others), any::<bool>())
        .prop_map(|(a, b, is_first)| {
            let b = b.filter(|b| *b != a);
            if is_first { [Some(a), b] } else { [b, Some(a)] }
        });
    let axes =
        coordinates(dimension).prop_flat_map(|all| all.into_iter().map(axis).collect::<Vec<_>>());
    let loads = (option::of(load()), option::of(load()), option::of(load()))
        .prop_map(|(force, torque, impulse)| Breaking { force, torque, impulse });
    let frames = [frame(dimension), frame(dimension)];
    let parts = (option::of("[^\\n]{0,9}"), pair, frames, axes, loads, [any::<bool>(); 2]);
    let joint = parts.prop_map(|(name, bodies, frames, axes, breaking, [collide, enabled])| {
        Joint { name, bodies, frames, axes, breaking, collide, enabled }
    });
    let number = |(i, joint): (usize, Joint)| Joint {
        name: joint.name.map(|name| format!("{name}{i}")),
        ..joint
    };
    vec(joint, 0..4)
        .prop_map(move |joints| joints.into_iter().enumerate().map(number).collect())
        .boxed()
}

fn scene() -> impl Strategy<Value = Scene> {
    without_joints().prop_flat_map(|scene| {
        let joints = joints(scene.dimension, &scene.bodies);
        joints.prop_map(move |joints| Scene { joints, ..scene.clone() })
    })
}

fn without_joints() -> impl Strategy<Value = Scene> {
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
            (solver, world_track(dimension)),
        )
            .prop_map(move |(name, gravity, time_step, steps, bodies, (solver, track))| {
                Scene {
                    name,
                    dimension,
                    gravity,
                    time_step,
                    track,
                    steps,
                    bodies_as: BodiesAs::Rigid,
                    joints: Vec::new(),
                    bodies: numbered(bodies),
                    solver: solver.as_object().unwrap().clone(),
                }
            })
    })
}

fn world_track(dimension: usize) -> impl Strategy<Value = WorldTrack> {
    let keys = vec((0.0..=1.0f64, vector(dimension)), 0..4);
    keys.prop_map(|keys| WorldTrack {
        times: (0..keys.len()).map(|i| i as f64 - 0.3).collect(),
        speeds: keys.iter().map(|(speed, _)| *speed).collect(),
        gravities: keys.into_iter().map(|(_, gravity)| gravity).collect(),
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
