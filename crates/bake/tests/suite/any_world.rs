//! Tests of worlds that are made body by body, in all four kinds.

use std::path::Path;

use drystone::{BodyId, StepSettings};
use drystone_bake::{
    AnyCheckpoint, AnyWorld, BuildError, TouchingPairs, WorldKind, build, read_toml, settings,
};
use drystone_scene::{
    Body, DecompositionOptions, Material, Motion, Rotation, Shape, ShapeKind, SurfaceVelocity,
    Track,
};

const STEP: f64 = 1.0 / 60.0;

fn ball(radius: f64) -> ShapeKind {
    ShapeKind::Sphere { radius }
}

fn ground(kind: WorldKind) -> Body {
    let mut normal = vec![0.0; kind.dimension()];
    normal[1] = 1.0;
    let plane = ShapeKind::Halfspace { normal };
    match kind.dimension() {
        3 => Body::new(Motion::Static, [0.0; 3], plane),
        _ => Body::new(Motion::Static, [0.0; 2], plane),
    }
}

/// Returns a dynamic ball, or a particle, at (x, y).
fn round(kind: WorldKind, [x, y]: [f64; 2], radius: f64) -> Body {
    let moves = Motion::Dynamic;
    match kind {
        WorldKind::Rigid2 => Body::new(moves, [x, y], ball(radius)),
        WorldKind::Rigid3 => Body::new(moves, [x, y, 0.0], ball(radius)),
        WorldKind::Particles2 => Body::particle([x, y], radius),
        WorldKind::Particles3 => Body::particle([x, y, 0.0], radius),
    }
}

fn with_gravity(kind: WorldKind, settings: StepSettings) -> AnyWorld {
    let mut world = AnyWorld::new(kind, settings);
    world.set_gravity(&[0.0, -9.81, 0.0][..kind.dimension()]).unwrap();
    world
}

fn place_in_heap(i: usize) -> [f64; 2] {
    [0.31 * (i % 4) as f64, 0.3 + 0.45 * (i / 4) as f64]
}

/// Returns a world with a heap of balls on the ground, and their identifiers.
fn heap(kind: WorldKind) -> (AnyWorld, Vec<BodyId>) {
    let mut world = with_gravity(kind, StepSettings::realtime());
    world.add(&ground(kind)).unwrap();
    let add = |i| world.add(&round(kind, place_in_heap(i), 0.2)).unwrap();
    let balls = (0..12).map(add).collect();
    (world, balls)
}

/// Takes steps, and returns the hash after each.
fn hashes(world: &mut AnyWorld, steps: usize) -> Vec<u64> {
    let mut hash = || {
        world.step(STEP).unwrap();
        world.state_hash()
    };
    (0..steps).map(|_| hash()).collect()
}

/// Rigid bodies in 3D as text.
const SPACE: &str = r#"
gravity = [0, -9.81, 0.5]

[[bodies]]
motion = "static"
surface_velocity = [0.5, 0, 0]
shapes = [{ type = "halfspace", normal = [0, 1, 0], friction = 0.8 }]

[[bodies]]
position = [0, 0.52, 0]
rotation = [0, 0.6, 0, 0.8]
mass = 3.0
restitution = 0.25
shapes = [
    { type = "box", half_extents = [0.5, 0.25, 0.4] },
    { type = "capsule", radius = 0.1, half_height = 0.2, position = [0, 0.4, 0] },
]

[[bodies]]
position = [0.1, 2, 0]
linear_velocity = [0, -1, 0]
angular_velocity = [0, 0, 3]
density = 500
shapes = [{ type = "cylinder", radius = 0.3, half_height = 0.1, restitution = 0.5 }]

[[bodies]]
motion = "kinematic"
position = [3, 0.5, 0]
shapes = [{ type = "sphere", radius = 0.4 }]
track = [{ time = 0 }, { time = 2, position = [-3, 0.5, 0] }]
"#;

fn by_hand_in_space(settings: StepSettings) -> AnyWorld {
    let mut world = AnyWorld::new(WorldKind::Rigid3, settings);
    world.set_gravity(&[0.0, -9.81, 0.5]).unwrap();
    let mut floor = ground(WorldKind::Rigid3);
    floor.shapes[0].material.friction = 0.8;
    let linear = vec![0.5, 0.0, 0.0];
    floor.surface_velocity = Some(SurfaceVelocity { linear, angular: vec![0.0; 3], local: true });
    let half_extents = vec![0.5, 0.25, 0.4];
    let mut hammer = Body::new(Motion::Dynamic, [0.0, 0.52, 0.0], ShapeKind::Box { half_extents });
    hammer.rotation = Rotation::Quaternion([0.0, 0.6, 0.0, 0.8]);
    hammer.mass.mass = Some(3.0);
    let handle = Shape::new(ShapeKind::Capsule { radius: 0.1, half_height: 0.2 }, 3);
    hammer.shapes.push(Shape { position: vec![0.0, 0.4, 0.0], ..handle });
    let bouncy = Material { restitution: 0.25, ..Material::default() };
    hammer.shapes.iter_mut().for_each(|shape| shape.material = bouncy.clone());
    let coin = ShapeKind::Cylinder { radius: 0.3, half_height: 0.1 };
    let mut coin = Body::new(Motion::Dynamic, [0.1, 2.0, 0.0], coin);
    coin.linear_velocity = vec![0.0, -1.0, 0.0];
    coin.angular_velocity = vec![0.0, 0.0, 3.0];
    coin.mass.density = Some(500.0);
    coin.shapes[0].material.restitution = 0.5;
    let driven = Body {
        track: Track {
            times: vec![0.0, 2.0],
            positions: vec![vec![3.0, 0.5, 0.0], vec![-3.0, 0.5, 0.0]],
            rotations: vec![Rotation::identity(3); 2],
        },
        ..Body::new(Motion::Kinematic, [3.0, 0.5, 0.0], ball(0.4))
    };
    for body in [floor, hammer, coin, driven] {
        world.add(&body).unwrap();
    }
    world
}

/// Rigid bodies in 2D as text.
const PLANE: &str = r#"
dimension = 2

[[bodies]]
motion = "static"
shapes = [{ type = "halfspace", normal = [0, 1] }]

[[bodies]]
position = [0, 0.5]
rotation = 0.3
shapes = [{ type = "box", half_extents = [0.5, 0.25] }]

[[bodies]]
position = [0.2, 1.5]
angular_velocity = -4
shapes = [{ type = "convex_hull", points = [[-0.3, 0], [0.3, 0], [0, 0.4]] }]
"#;

fn by_hand_in_the_plane(settings: StepSettings) -> AnyWorld {
    let mut world = with_gravity(WorldKind::Rigid2, settings);
    let half_extents = vec![0.5, 0.25];
    let mut brick = Body::new(Motion::Dynamic, [0.0, 0.5], ShapeKind::Box { half_extents });
    brick.rotation = Rotation::Angle(0.3);
    let points = vec![vec![-0.3, 0.0], vec![0.3, 0.0], vec![0.0, 0.4]];
    let mut wedge = Body::new(Motion::Dynamic, [0.2, 1.5], ShapeKind::ConvexHull { points });
    wedge.angular_velocity = vec![-4.0];
    for body in [ground(WorldKind::Rigid2), brick, wedge] {
        world.add(&body).unwrap();
    }
    world
}

/// Returns the particles of [`heap`] as text.
fn particle_heap(kind: WorldKind) -> String {
    let (comma, dimension) = if kind.dimension() == 3 { (", 0", 3) } else { ("", 2) };
    let mut text = format!(
        "dimension = {dimension}\nbodies_as = \"particles\"\n[[bodies]]\nmotion = \"static\"\n\
         shapes = [{{ type = \"halfspace\", normal = [0, 1{comma}] }}]\n"
    );
    for i in 0..12 {
        let [x, y] = place_in_heap(i);
        text += &format!(
            "[[bodies]]\nposition = [{x:?}, {y:?}{comma}]\n\
             shapes = [{{ type = \"sphere\", radius = 0.2 }}]\n"
        );
    }
    text
}

/// Worlds that are made by hand take the same certified steps, bit by bit, as the scenes of the
/// same bodies.
#[test]
fn worlds_by_hand_have_the_bits_of_scenes() {
    let texts = [
        PLANE.to_owned(),
        SPACE.to_owned(),
        particle_heap(WorldKind::Particles2),
        particle_heap(WorldKind::Particles3),
    ];
    for (kind, text) in WorldKind::ALL.into_iter().zip(texts) {
        let scene = read_toml(Path::new("text.toml"), &text).unwrap().scene;
        let preset = settings(&scene, StepSettings::certified()).unwrap();
        let mut read = build(&scene, preset.clone()).unwrap();
        let mut made = match kind {
            WorldKind::Rigid2 => by_hand_in_the_plane(preset),
            WorldKind::Rigid3 => by_hand_in_space(preset),
            _ => {
                let (mut world, _) = heap(kind);
                *world.settings_mut() = preset;
                world
            }
        };
        assert_eq!((read.kind(), made.kind()), (kind, kind));
        let (expected, found) = (hashes(&mut read, 60), hashes(&mut made, 60));
        assert_ne!(expected[0], expected[59], "{kind:?} stands still");
        assert_eq!(expected, found, "{kind:?}");
    }
}

/// A world that is restored in memory repeats its steps bit by bit after bodies were added and
/// removed, identifiers and tracks included. As bytes, a checkpoint takes the same bodies only.
#[test]
fn checkpoints_bring_bodies_back() {
    for kind in WorldKind::ALL {
        let (mut world, balls) = heap(kind);
        let mut lift = round(kind, [-3.0, 0.0], 0.5);
        let far = [vec![-3.0, 9.0, 0.0], vec![-3.0, 9.0]][3 - kind.dimension()].clone();
        lift.motion = Motion::Kinematic;
        lift.track = Track {
            times: vec![0.0, 3.0],
            positions: vec![lift.position.clone(), far],
            rotations: vec![lift.rotation; 2],
        };
        let lift = world.add(&lift).unwrap();
        hashes(&mut world, 20);
        let checkpoint = world.checkpoint();
        let bytes = AnyCheckpoint::from_bytes(&checkpoint.to_bytes()).unwrap();
        let expected = hashes(&mut world, 30);

        assert!(world.remove(balls[3]) && world.remove(lift) && !world.remove(lift));
        let next = world.add(&round(kind, [0.4, 3.0], 0.3)).unwrap();
        assert_eq!(world.pose(balls[3]), None);
        assert!(hashes(&mut world, 7) != expected[..7]);
        let before = world.state_hash();
        let refused = world.restore(&bytes).unwrap_err().to_string();
        assert!(refused.starts_with("is a checkpoint of "), "{refused}");
        assert_eq!(world.state_hash(), before);

        world.restore(&checkpoint).unwrap();
        assert!((world.time() - 20.0 * STEP).abs() < 1e-9);
        assert_eq!((world.bodies().count(), world.pose(next)), (14, None));
        assert!(world.pose(balls[3]).is_some());
        assert_eq!(hashes(&mut world, 30), expected, "{kind:?}");
        world.restore(&bytes).unwrap();
        assert_eq!(hashes(&mut world, 30), expected, "{kind:?} from bytes");
    }
}

/// Poses and velocities that one world wrote, another takes, and it goes on alike.
#[test]
fn states_go_in_and_out_in_slices() {
    for kind in WorldKind::ALL {
        let ((mut one, _), (mut other, _)) = (heap(kind), heap(kind));
        hashes(&mut one, 15);
        let (mut poses, mut velocities) = (Vec::new(), Vec::new());
        one.write_poses(&mut poses);
        one.write_velocities(&mut velocities);
        let all: Vec<BodyId> = other.bodies().collect();
        assert_eq!(poses.len(), all.len() * kind.pose_numbers());
        assert_eq!(velocities.len(), all.len() * kind.velocity_numbers());
        // The ground is static and has no velocity.
        let own = &velocities[kind.velocity_numbers()..];
        other.set_poses(&all, &poses).unwrap();
        other.set_velocities(&all[1..], own).unwrap();
        assert_eq!(other.state_hash(), one.state_hash(), "{kind:?}");
        let last = all[all.len() - 1];
        assert_eq!(other.pose(last).unwrap(), poses[poses.len() - kind.pose_numbers()..]);
        let end = velocities.len() - kind.velocity_numbers();
        assert_eq!(other.velocity(last).unwrap(), velocities[end..]);
    }
}

/// A force acts for one step: dv = f dt / m. A body that is moved to a pose is there after a step.
#[test]
fn forces_and_targets_move_bodies() {
    for kind in WorldKind::ALL {
        let mut world = AnyWorld::new(kind, StepSettings::quality());
        let pushed = world.add(&round(kind, [0.0, 0.0], 0.5)).unwrap();
        let moved = Body { motion: Motion::Kinematic, ..round(kind, [9.0, 0.0], 0.5) };
        let moved = world.add(&moved).unwrap();
        let mass = world.masses()[0] as f32;
        let mut force = vec![0.0; kind.velocity_numbers()];
        force[1] = 60.0 * mass;
        world.add_forces(&[pushed], &force).unwrap();
        let mut target = world.pose(moved).unwrap();
        target[0] = 8.0;
        world.move_to(&[moved], &target, STEP).unwrap();
        (0..2).for_each(|_| drop(world.step(STEP).unwrap()));
        let velocity = world.velocity(pushed).unwrap();
        assert!((velocity[1] - 1.0).abs() < 1e-5, "{kind:?}: {velocity:?}");
        let pose = world.pose(moved).unwrap();
        assert!((pose[0] - 7.0).abs() < 1e-5, "{kind:?}: {pose:?} after two steps");
        world.set_velocities(&[moved], &vec![0.0; kind.velocity_numbers()]).unwrap();
        world.step(STEP).unwrap();
        assert_eq!(world.pose(moved).unwrap(), pose);
    }
}

/// A ball at rest on the ground has one contact, of which all tables say the same: its impulse
/// carries the weight. A removed ball leaves none.
#[test]
fn contacts_are_told_in_slices() {
    for kind in WorldKind::ALL {
        let mut world =
            with_gravity(kind, StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() });
        world.record_impulses(true);
        let ground = world.add(&ground(kind)).unwrap();
        let ball = world.add(&round(kind, [0.25, 0.5], 0.5)).unwrap();
        (0..60).for_each(|_| drop(world.step(STEP).unwrap()));
        let weight = world.masses()[1] * 9.81 * STEP;
        let dimension = kind.dimension();
        let (mut pairs, points) = (TouchingPairs::default(), world.contact_points());
        world.write_touching(&mut pairs);
        assert_eq!((pairs.bodies.len(), points.gaps.len()), (1, 1), "{kind:?}");
        assert_eq!(pairs.bodies[0].map(|id| id.index() as u32), points.bodies[0]);
        assert!(pairs.bodies[0].contains(&ball) && pairs.bodies[0].contains(&ground));
        let substeps = f64::from(world.settings().substeps);
        for impulse in [f64::from(pairs.impulses[0]), substeps * f64::from(points.impulses[0])] {
            assert!((impulse / weight - 1.0).abs() < 1e-2, "{kind:?}: {impulse} of {weight}");
        }
        let up = if points.bodies[0][0] == 1 { 1.0 } else { -1.0 };
        assert_eq!(pairs.normals, points.frames[..dimension]);
        assert!((points.frames[1] - up).abs() < 1e-6, "{kind:?}: {:?}", points.frames);
        assert_eq!(points.frames.len(), dimension * dimension);
        for place in [&pairs.points, &points.points] {
            let from_touch = [place[0] - 0.25, place[1]];
            assert!(from_touch.iter().all(|x| x.abs() < 1e-3), "{kind:?}: {place:?}");
        }
        assert!(points.gaps[0].abs() < 1e-3 && pairs.gaps[0].abs() < 1e-3);
        world.remove(ball);
        world.step(STEP).unwrap();
        world.write_touching(&mut pairs);
        assert_eq!((pairs, world.contact_points().gaps.len()), (TouchingPairs::default(), 0));
    }
}

/// A heap falls asleep, and a change of a body wakes it.
#[test]
fn bodies_sleep_and_wake() {
    for kind in WorldKind::ALL {
        let mut world = with_gravity(kind, StepSettings::realtime());
        world.add(&ground(kind)).unwrap();
        let ball = world.add(&round(kind, [0.0, 0.5], 0.5)).unwrap();
        (0..90).for_each(|_| drop(world.step(STEP).unwrap()));
        assert!(world.is_sleeping(ball), "{kind:?}");
        world.set_damping(ball, [0.5, 0.0]).unwrap();
        assert!(!world.is_sleeping(ball), "{kind:?}");
        (0..90).for_each(|_| drop(world.step(STEP).unwrap()));
        world.wake(ball);
        assert!(!world.is_sleeping(ball), "{kind:?}");
    }
}

/// A belt by hand carries what lies on it, until it is stopped.
#[test]
fn belts_start_and_stop() {
    let mut world = with_gravity(WorldKind::Rigid2, StepSettings::quality());
    let belt = world.add(&ground(WorldKind::Rigid2)).unwrap();
    let half_extents = vec![0.5, 0.5];
    let load = Body::new(Motion::Dynamic, [0.0, 0.5], ShapeKind::Box { half_extents });
    let load = world.add(&load).unwrap();
    let runs = SurfaceVelocity { linear: vec![1.0, 0.0], angular: vec![0.0], local: true };
    for (surface, speed) in [(Some(&runs), 1.0), (None, 0.0)] {
        world.set_surface_velocity(belt, surface).unwrap();
        (0..60).for_each(|_| drop(world.step(STEP).unwrap()));
        let velocity = world.velocity(load).unwrap();
        assert!((velocity[0] - speed).abs() < 1e-2, "{velocity:?}");
    }
}

/// Equal meshes of a world share one decomposition, which is that of a scene.
#[test]
fn meshes_are_decomposed_once() {
    let cube = |i: usize| [i & 1, i >> 1 & 1, i >> 2].map(|x| x as f64 - 0.5);
    let faces: [[u32; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let decomposition = Some(DecompositionOptions::default());
    let mesh = ShapeKind::Trimesh {
        vertices: (0..8).map(cube).collect(),
        triangles,
        decomposition,
        vertex_track: None,
    };
    let mut world = with_gravity(WorldKind::Rigid3, StepSettings::realtime());
    for x in [0.0, 3.0] {
        world.add(&Body::new(Motion::Dynamic, [x, 0.0, 0.0], mesh.clone())).unwrap();
    }
    assert!(world.masses().iter().all(|mass| (mass - 1000.0).abs() < 1e-2), "{:?}", world.masses());
}

/// Returns the error for a body of a kind of world. The world stays empty.
fn refused(kind: WorldKind, body: &Body) -> String {
    let mut world = AnyWorld::new(kind, StepSettings::quality());
    let error = world.add(body).expect_err("a wrong body").to_string();
    assert!(world.is_empty(), "{error}");
    error
}

/// A change that makes a body wrong.
type Change<'a> = &'a dyn Fn(&mut Body);

/// Bodies and shapes of which no world can be made are refused with item, value and accepted range.
#[test]
fn wrong_bodies_are_refused() {
    use WorldKind::{Particles3, Rigid2, Rigid3};
    let [nan, inf] = [f64::NAN, f64::INFINITY];
    let change = |change: Change<'_>| {
        let mut body = Body::new(Motion::Dynamic, [0.0; 3], ball(1.0));
        body.name = Some("it".to_owned());
        change(&mut body);
        refused(Rigid3, &body)
    };
    assert_eq!(
        change(&|of| of.position = vec![1.0, 2.0]),
        "it: the number of entries of the position is 2; accepted: from 3 to 3"
    );
    let lists: [(&str, Change<'_>); 18] = [
        ("rotation", &|of| of.rotation = Rotation::Angle(1.0)),
        ("linear velocity", &|of| of.linear_velocity.clear()),
        ("angular velocity", &|of| of.angular_velocity = vec![1.0]),
        ("mass", &|of| of.mass.mass = Some(nan)),
        ("mass", &|of| of.mass.mass = Some(0.0)),
        ("density", &|of| of.mass.density = Some(nan)),
        ("center of mass", &|of| of.mass.center = Some(vec![0.0])),
        ("inertia", &|of| of.mass.inertia = Some(vec![1.0])),
        ("moment of inertia", &|of| of.mass.inertia = Some(vec![1.0, nan, 1.0])),
        ("position [m]", &|of| of.position[1] = nan),
        ("velocity [m/s]", &|of| of.linear_velocity[1] = inf),
        ("friction", &|of| of.shapes[0].material.friction = -1.0),
        ("position of a shape", &|of| of.shapes[0].position = vec![]),
        ("positions of the track", &|of| of.track.times = vec![0.0]),
        ("force", &|of| of.force = vec![1.0]),
        ("track of a static body", &|of| {
            (of.motion, of.track.times) = (Motion::Static, vec![0.0]);
        }),
        ("mass [kg]", &|of| of.shapes.clear()),
        ("surface velocity", &|of| {
            let linear = vec![1.0, 0.0];
            let belt = SurfaceVelocity { linear, angular: vec![0.0; 3], local: true };
            of.surface_velocity = Some(belt);
        }),
    ];
    for (item, wrong) in lists {
        let error = change(wrong);
        assert!(error.starts_with("it: ") && error.contains(item), "{item}: {error}");
    }
    let track = |times: &[f64]| {
        let mut body = Body::new(Motion::Kinematic, [0.0; 3], ball(1.0));
        let (positions, rotations) = (vec![vec![0.0; 3]; 2], vec![Rotation::identity(3); 2]);
        body.track = Track { times: times.to_vec(), positions, rotations };
        refused(Rigid3, &body)
    };
    assert!(track(&[0.0]).contains("positions of the track is 2; accepted: from 1 to 1"));
    for times in [[1.0, 1.0], [0.0, nan], [2.0, 1.0]] {
        assert!(track(&times).contains("a time of the track [s]"), "{times:?}");
    }
    let rough = refused(Particles3, &Body::new(Motion::Dynamic, [0.0; 3], ball(1.0)));
    assert!(rough.contains("the friction of a particle [1] is 0.5; accepted: from 0 to 0"));
    let flat = refused(Rigid2, &Body::new(Motion::Dynamic, [0.0; 3], ball(1.0)));
    assert!(flat.contains("position is 3; accepted: from 2 to 2"), "{flat}");
}

/// Shapes without a size, and lists of points that make no shape, are refused without a panic.
#[test]
fn wrong_shapes_are_refused() {
    let refused = |motion, kind| {
        let body = Body::new(motion, [0.0; 3], kind);
        let error = refused(WorldKind::Rigid3, &body);
        assert!(error.starts_with("shape 0 of body 0: "), "{error}");
        error
    };
    let nan = f64::NAN;
    for kind in [
        ball(0.0),
        ball(nan),
        ball(f64::INFINITY),
        ShapeKind::Box { half_extents: vec![1.0, -1.0, 1.0] },
        ShapeKind::Box { half_extents: vec![1.0, 1.0] },
        ShapeKind::Capsule { radius: 1.0, half_height: -0.1 },
        ShapeKind::Cylinder { radius: 1.0, half_height: 0.0 },
        ShapeKind::Halfspace { normal: vec![0.0; 3] },
        ShapeKind::ConvexHull { points: vec![] },
        ShapeKind::ConvexHull { points: vec![vec![0.0; 3]; 5] },
        ShapeKind::ConvexHull { points: vec![vec![nan, 0.0, 0.0]; 5] },
    ] {
        refused(Motion::Kinematic, kind.clone());
        refused(Motion::Dynamic, kind);
    }
    let mesh = |vertices: &[[f64; 3]], triangles: &[[u32; 3]]| ShapeKind::Trimesh {
        vertices: vertices.to_vec(),
        triangles: triangles.to_vec(),
        decomposition: None,
        vertex_track: None,
    };
    let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    for motion in [Motion::Static, Motion::Dynamic] {
        refused(motion, mesh(&corners, &[]));
        refused(motion, mesh(&corners, &[[0, 1, 3]]));
        refused(motion, mesh(&[[nan; 3]; 3], &[[0, 1, 2]]));
        refused(motion, mesh(&[[1.0; 3]; 3], &[[0, 1, 2]]));
    }
    assert!(refused(Motion::Dynamic, mesh(&corners, &[[0, 1, 2]])).contains("not closed"));
    let mut plane = AnyWorld::new(WorldKind::Rigid2, StepSettings::quality());
    for points in [vec![], vec![vec![0.0; 2]; 4], vec![vec![0.0, 0.0], vec![1.0, 1.0]]] {
        let hull = ShapeKind::ConvexHull { points };
        let error = plane.add(&Body::new(Motion::Dynamic, [0.0; 2], hull)).unwrap_err();
        assert!(matches!(error, BuildError::Shape { shape: 0, .. }), "{error}");
    }
}

/// Slices of the wrong length, unknown bodies and numbers out of range are refused.
#[test]
fn wrong_slices_are_refused() {
    for kind in WorldKind::ALL {
        let (mut world, balls) = heap(kind);
        let before = world.checkpoint().to_bytes();
        let few = vec![0.0; kind.pose_numbers() - 1];
        let error = world.set_poses(&balls[..1], &few).unwrap_err().to_string();
        let accepted = kind.pose_numbers();
        assert!(error.contains(&format!("is {}; accepted: from {accepted}", few.len())), "{error}");
        let twice = vec![0.0; 2 * kind.velocity_numbers()];
        assert!(world.set_velocities(&balls[..1], &twice).is_err());
        assert!(world.add_forces(&balls[..3], &twice).is_err());
        assert!(world.set_gravity(&[0.0]).is_err());
        let mut fast = vec![0.0; kind.velocity_numbers()];
        fast[0] = f32::NAN;
        assert!(world.set_velocities(&balls[..1], &fast).is_err());
        assert!(world.add_forces(&balls[..1], &fast).is_err());
        let (_, strangers) = heap(kind);
        let pose = world.pose(balls[0]).unwrap();
        assert!(world.set_poses(&strangers[..1], &pose).is_err());
        assert!(world.move_to(&balls[..1], &pose, f64::NAN).is_err());
        assert!(world.step(f64::NAN).is_err() && world.time() == 0.0);
        assert_eq!(world.checkpoint().to_bytes(), before, "{kind:?}");
        let other = AnyWorld::new(kind, StepSettings::quality()).checkpoint();
        assert!(AnyCheckpoint::from_bytes(&other.to_bytes()[..3]).is_err());
    }
}

/// A setter for several bodies changes none of them if the value of one is wrong, or the body is
/// unknown or static.
#[test]
fn a_wrong_value_in_a_slice_changes_nothing() {
    for kind in WorldKind::ALL {
        let (mut world, balls) = heap(kind);
        let ground = world.body_at(0).unwrap();
        let (stranger, pose) = (heap(kind).1[0], world.pose(balls[0]).unwrap());
        let velocity = vec![0.25; kind.velocity_numbers()];
        let before = world.checkpoint().to_bytes();
        // The first body is right, the second is wrong in the number at `at`.
        let two = |right: &[f32], at: usize| {
            let mut both = right.repeat(2);
            both[right.len() + at] = f32::NAN;
            both
        };
        for at in 0..kind.dimension() {
            assert!(world.set_poses(&balls[..2], &two(&pose, at)).is_err());
            assert!(world.move_to(&balls[..2], &two(&pose, at), STEP).is_err());
            assert!(world.set_velocities(&balls[..2], &two(&velocity, at)).is_err());
            assert!(world.add_forces(&balls[..2], &two(&velocity, at)).is_err());
        }
        let (poses, velocities) = (pose.repeat(2), velocity.repeat(2));
        let with_stranger = [balls[0], stranger];
        assert!(world.set_poses(&with_stranger, &poses).is_err());
        assert!(world.move_to(&with_stranger, &poses, STEP).is_err());
        assert!(world.set_velocities(&with_stranger, &velocities).is_err());
        assert!(world.add_forces(&with_stranger, &velocities).is_err());
        let with_ground = [balls[0], ground];
        assert!(world.move_to(&with_ground, &poses, STEP).is_err());
        assert!(world.set_velocities(&with_ground, &velocities).is_err());
        // The pose is right, and too far away to be reached in this time.
        let mut far = poses.clone();
        far[pose.len()] = 9e8;
        assert!(world.move_to(&balls[..2], &far, 1e-4).is_err());
        assert_eq!(world.checkpoint().to_bytes(), before, "{kind:?}");
        world.set_velocities(&balls[..2], &velocities).unwrap();
        assert_ne!(world.checkpoint().to_bytes(), before, "{kind:?}");
    }
}
