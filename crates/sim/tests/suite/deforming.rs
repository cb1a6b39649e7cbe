//! Tests of meshes whose vertices move: contacts on them have the velocity of the surface.

use crate::common::*;
use drystone::geometry::Rigid3;
use drystone::{
    BodyId, ColliderId, InputError, Ledger, MeshFault, Motion, StepSettings, Vector, World3,
};
use parry3d::shape::SharedShape;

type Vec3 = Vector<f32, 3>;

/// A world with a mesh that deforms, and the time.
struct Stage {
    world: World3,
    body: BodyId,
    mesh: ColliderId,
    rest: Vec<Vec3>,
    steps: u32,
}

impl Stage {
    fn new(settings: StepSettings, shape: SharedShape, friction: f64) -> Self {
        let mut world = World3::new(settings);
        world.gravity = Vector([0.0, -GRAVITY, 0.0]);
        let floor = body(Motion::Kinematic, [0.0; 3], shape, &surface(friction, 0.0));
        let body = world.add(floor).unwrap();
        let mesh = world.colliders(body).next().unwrap();
        let rest = world.vertices(mesh).unwrap();
        Self { world, body, mesh, rest, steps: 0 }
    }

    fn time(&self) -> f32 {
        self.steps as f32 * DT
    }

    /// Takes a step in which each vertex moves to its place at the end of the step.
    fn step(&mut self, place: impl Fn(Vec3, f32) -> Vec3) -> drystone::StepReport {
        self.steps += 1;
        let time = self.time();
        let targets: Vec<Vec3> = self.rest.iter().map(|vertex| place(*vertex, time)).collect();
        self.world.move_vertices(self.mesh, &targets).unwrap();
        self.world.step(DT).unwrap()
    }
}

fn presets() -> [(&'static str, StepSettings, f32); 3] {
    [
        ("certified", StepSettings::certified(), 1e-4),
        ("quality", StepSettings::quality(), 1e-4),
        ("real-time", StepSettings::realtime(), 1e-3),
    ]
}

fn moved(by: [f32; 3], time: f32) -> impl Fn(Vec3, f32) -> Vec3 {
    move |vertex, at| vertex + Vector(by) * at.min(time)
}

/// A box on a floor that rises at 1 m/s, sinks at 1 m/s or slides at 0.5 m/s has its velocity
/// within 1e-3 m/s, and a gap below 0.1 mm, or 1 mm with the real-time preset.
#[test]
fn a_floor_that_moves_carries_a_box() {
    for (name, settings, sag) in presets() {
        for velocity in [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.5, 0.2, 0.1]] {
            let what = format!("{name}, {velocity:?}");
            let mut stage = Stage::new(settings.clone(), grid(7, 3.0), 0.8);
            let shape = Rigid3::cuboid([0.2, 0.1, 0.3]);
            let block = dynamic([0.05, 0.1, 0.0], shape, &surface(0.8, 0.0));
            let block = stage.world.add(block).unwrap();
            for _ in 0..60 {
                stage.step(moved(velocity, 1.0));
            }
            let found = crate::common::velocity(&stage.world, block);
            let off = (found.linear - Vector(velocity)).length() + 0.2 * found.angular.length();
            assert_below(&format!("{what}: velocity"), off, 1e-3);
            let gap = place(&stage.world, block)[1] - 0.1 - velocity[1];
            assert_below(&format!("{what}: gap {gap}"), gap.abs(), sag);
            let depth = stage.world.measure().deepest_penetration as f32;
            assert_below(&format!("{what}: depth"), depth, sag);
        }
    }
}

/// The queries between steps name the bodies of the world, not what stands for the surface.
#[test]
fn queries_name_the_bodies() {
    let mut stage = Stage::new(StepSettings::certified(), grid(4, 3.0), 0.5);
    let block = dynamic([0.0, 0.1, 0.0], Rigid3::cuboid([0.2, 0.1, 0.2]), &surface(0.5, 0.0));
    let block = stage.world.add(block).unwrap();
    (0..10).for_each(|_| _ = stage.step(moved([0.0, 0.5, 0.0], 9.0)));
    let world = &mut stage.world;
    let points = world.contact_points();
    assert!(points.bodies.len() >= 4, "{points:?}");
    assert!(points.bodies.iter().flatten().all(|body| *body < 2), "{points:?}");
    let height = 10.0 * DT * 0.5;
    for (point, gap) in points.points.chunks_exact(3).zip(&points.gaps) {
        assert!((point[1] - height).abs() < 2e-3 && gap.abs() < 1e-3, "{points:?}");
    }
    assert!(world.nearby().iter().all(|near| near.bodies == [0, 1]));
    let system = world.system();
    assert!(system.velocities.len() > 2 && system.manifolds.iter().all(|of| of.bodies[1] < 9));
    assert_eq!((world.len(), world.velocities().len()), (2, 2));
    assert!(world.measure().residual < 1e-3);
    let touching: Vec<_> = world.touching().collect();
    assert_eq!(touching.len(), 1);
    assert!(touching[0].bodies.contains(&block) && touching[0].bodies.contains(&stage.body));
    // A body that is added takes the slot after them, and nothing fails before the next step.
    world.add(dynamic([0.0, 1.0, 0.0], Rigid3::ball(0.1), &surface(0.5, 0.0))).unwrap();
    assert!(world.measure().finite && world.contact_points().bodies.is_empty());
    stage.step(moved([0.0, 0.5, 0.0], 9.0));
    assert_eq!(stage.world.len(), 3);
}

/// A rotation about z by an angle, then a displacement.
fn turned([x, y, z]: [f32; 3], angle: f32, by: [f32; 3]) -> Vec3 {
    let (sin, cos) = angle.sin_cos();
    Vector([x * cos - y * sin + by[0], x * sin + y * cos + by[1], z + by[2]])
}

/// A mesh that deforms as a rigid body moves carries a box, a ball and a hull to the same places as
/// a kinematic body with that motion, within 0.1 mm, or 1 mm with the real-time preset.
#[test]
fn a_rigid_deformation_equals_a_rigid_motion() {
    for (name, settings, bound) in presets() {
        let motion = |time: f32| {
            let angle = 0.15 * (2.0 * time).sin();
            (angle, [0.1 * (3.0 * time).sin(), 0.2 * time, 0.05 * time])
        };
        let mut stage = Stage::new(settings.clone(), grid(5, 4.0), 0.9);
        let mut rigid = Stage::new(settings, grid(5, 4.0), 0.9);
        let rough = surface(0.9, 0.0);
        for world in [&mut stage.world, &mut rigid.world] {
            world.add(dynamic([-0.5, 0.1, 0.1], Rigid3::cuboid([0.2, 0.1, 0.3]), &rough)).unwrap();
            world.add(dynamic([0.6, 0.2, -0.4], Rigid3::ball(0.2), &rough)).unwrap();
            let corners = [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.1], [0.0, 0.0, -0.2], [0.0, 0.3, 0.0]];
            let hull = SharedShape::convex_hull(&corners.map(Into::into)).unwrap();
            world.add(dynamic([0.1, 0.0, 0.7], hull, &rough)).unwrap();
        }
        for _ in 0..120 {
            stage.step(|vertex, time| {
                let (angle, by) = motion(time);
                turned(vertex.0, angle, by)
            });
            let (angle, by) = motion(stage.time());
            let pose = Rigid3::turned(by, angle);
            rigid.world.move_to(rigid.body, &pose, DT).unwrap();
            rigid.world.step(DT).unwrap();
        }
        let bodies: Vec<BodyId> = stage.world.bodies().skip(1).collect();
        let others: Vec<BodyId> = rigid.world.bodies().skip(1).collect();
        for (a, b) in bodies.into_iter().zip(others) {
            let apart = (place(&stage.world, a) - place(&rigid.world, b)).length();
            assert_below(&format!("{name}, body {}", a.index()), apart, bound);
        }
    }
}

/// Returns a sphere of radius 0.5 as a closed mesh.
fn sphere() -> SharedShape {
    let (vertices, triangles) = parry3d::shape::Ball::new(0.5).to_trimesh(24, 24);
    let vertices: Vec<[f32; 3]> = vertices.iter().map(|vertex| vertex.to_array()).collect();
    Rigid3::mesh(&vertices, &triangles)
}

/// A sphere that grows by 0.5 m/s pushes a ball and a box away at its speed, and gives them the
/// energy of that speed: the ledger has it as driven, and contacts create none.
#[test]
fn a_growing_mesh_pushes_outward() {
    for (name, settings, _) in presets() {
        let settings = StepSettings { ledger: true, ..settings };
        let mut stage = Stage::new(settings, sphere(), 0.0);
        stage.world.gravity = Vector::ZERO;
        let smooth = surface(0.0, 0.0);
        let ball = dynamic([0.71, 0.0, 0.0], Rigid3::ball(0.2), &smooth);
        let ball = stage.world.add(ball).unwrap();
        let block = dynamic([0.0, 0.61, 0.0], Rigid3::cuboid([0.3, 0.1, 0.2]), &smooth);
        let block = stage.world.add(block).unwrap();
        let (mut total, start) = (Ledger::default(), energy(&stage.world));
        let mut created = 0.0f64;
        for _ in 0..60 {
            let report = stage.step(|vertex, time| vertex * (1.0 + time.min(1.0)));
            let ledger = report.energy.unwrap();
            created = created.max(ledger.created());
            total.join(&ledger);
        }
        for (what, id) in [("ball", ball), ("box", block)] {
            let speed = velocity(&stage.world, id).linear.length();
            assert!((speed - 0.5).abs() < 0.02, "{name}, {what}: {speed} m/s");
        }
        let gained = energy(&stage.world) - start;
        assert!((total.driven / gained - 2.0).abs() < 0.1, "{name}: {total:#?}, {gained} J");
        assert!((total.kinetic - gained).abs() < 1e-3 * gained, "{name}: {total:#?}, {gained} J");
        assert!(total.by_contacts() < 1e-3 * gained, "{name}: {total:#?}, {gained} J");
        assert!(total.unexplained().abs() < 1e-3 * gained, "{name}: {total:#?}");
    }
}

/// A wave of 5 cm passes under a box and a ball at 1 m/s: they overlap it by less than 1 mm.
#[test]
fn a_wave_passes_under_bodies() {
    let mut stage = Stage::new(StepSettings::certified(), grid(40, 4.0), 0.5);
    let rough = surface(0.5, 0.0);
    let block = dynamic([0.0, 0.1, 0.0], Rigid3::cuboid([0.2, 0.1, 0.2]), &rough);
    let block = stage.world.add(block).unwrap();
    let ball = stage.world.add(dynamic([0.7, 0.15, 0.0], Rigid3::ball(0.15), &rough)).unwrap();
    let (mut deepest, mut highest) = (0.0f64, 0.0f32);
    for _ in 0..180 {
        let report = stage.step(|vertex, time| {
            let [x, _, z] = vertex.0;
            let height = 0.05 * (3.0 * (x - time)).sin() * (2.0 * time).min(1.0);
            Vector([x, height, z])
        });
        assert_eq!(report.certified.unwrap().failed, 0, "{report:?}");
        deepest = deepest.max(stage.world.measure().deepest_penetration);
        highest = highest.max(place(&stage.world, block)[1]);
    }
    assert!(deepest < 1e-3, "{deepest} m");
    assert_above("the wave lifts the box", highest, 0.12);
    for id in [block, ball] {
        assert!(
            place(&stage.world, id)[1] > 0.0 && velocity(&stage.world, id).linear.length() < 2.0
        );
    }
}

/// Bodies asleep on a mesh wake when it begins to move, stay awake as long as it does, and fall
/// asleep again afterwards. So do those on a part of it that stays.
#[test]
fn bodies_on_a_moving_mesh_are_awake() {
    let settings = StepSettings { sleep_delay: 0.3, ..StepSettings::certified() };
    let mut stage = Stage::new(settings, grid(8, 4.0), 0.5);
    let block = dynamic([1.0, 0.1, 0.0], Rigid3::cuboid([0.1; 3]), &surface(0.5, 0.0));
    let block = stage.world.add(block).unwrap();
    (0..40).for_each(|_| _ = stage.world.step(DT).unwrap());
    assert!(stage.world.is_sleeping(block));
    for _ in 0..60 {
        stage.step(|vertex, time| {
            let [x, y, z] = vertex.0;
            if x < -1.0 { Vector([x, y + 0.1 * time, z]) } else { vertex }
        });
        assert!(!stage.world.is_sleeping(block), "at {} s", stage.time());
    }
    (0..40).for_each(|_| _ = stage.world.step(DT).unwrap());
    assert!(stage.world.is_sleeping(block));
    let lifted = |vertex: Vec3, time: f32| vertex + Vector([0.0, time - 1.0, 0.0]);
    (0..10).for_each(|_| _ = stage.step(lifted));
    let height = place(&stage.world, block)[1];
    assert!((height - 0.1 - 10.0 * DT).abs() < 1e-3, "{height} m");
}

/// A checkpoint restores the vertices, also in the middle of the motion; read from bytes they are
/// set again. The further steps have the same bits.
#[test]
fn a_checkpoint_has_the_vertices() {
    let wave = |vertex: Vec3, time: f32| {
        let [x, _, z] = vertex.0;
        Vector([x, 0.05 * (3.0 * x - 5.0 * time).sin(), z])
    };
    let built = |settings: StepSettings| {
        let mut stage = Stage::new(settings, grid(12, 3.0), 0.5);
        let rough = surface(0.5, 0.0);
        for i in 0..4 {
            let at = [0.5 * i as f32 - 0.8, 0.2, 0.05 * i as f32];
            let shape = if i % 2 == 0 { Rigid3::ball(0.1) } else { Rigid3::cuboid([0.1; 3]) };
            stage.world.add(dynamic(at, shape, &rough)).unwrap();
        }
        stage
    };
    let poses = |stage: &Stage| {
        let mut out = Vec::new();
        stage.world.write_poses(&mut out);
        out
    };
    for (name, settings, _) in presets() {
        let mut stage = built(settings.clone());
        (0..25).for_each(|_| _ = stage.step(wave));
        let checkpoint = stage.world.checkpoint();
        let (vertices, steps) = (stage.world.vertices(stage.mesh).unwrap(), stage.steps);
        let go_on = |stage: &mut Stage| -> Vec<Vec<f32>> {
            (0..40)
                .map(|step| {
                    // The mesh stops and moves again.
                    if step % 16 < 12 {
                        stage.step(wave);
                    } else {
                        stage.world.step(DT).unwrap();
                    }
                    poses(stage)
                })
                .collect()
        };
        let expected = go_on(&mut stage);
        stage.world.restore(&checkpoint).unwrap();
        assert_eq!(stage.world.vertices(stage.mesh).unwrap(), vertices, "{name}");
        stage.steps = steps;
        assert!(go_on(&mut stage) == expected, "{name}: other bits in the same world");
        // A checkpoint of bytes: a world of the same bodies at their start.
        let mut other = built(settings);
        #[cfg(feature = "serde")]
        {
            let bytes = postcard::to_allocvec(&checkpoint).unwrap();
            other.world.restore(&postcard::from_bytes(&bytes).unwrap()).unwrap();
            other.world.restore_vertices(other.mesh, &vertices).unwrap();
            other.steps = steps;
            assert!(go_on(&mut other) == expected, "{name}: other bits in another world");
        }
        let _ = &mut other;
    }
}

/// Vertices that are too many, not finite or flat, and colliders that are no kinematic mesh are
/// refused by name, and change nothing.
#[test]
fn wrong_vertices_are_refused() {
    let mut stage = Stage::new(StepSettings::certified(), grid(2, 2.0), 0.5);
    let still = body(Motion::Static, [0.0; 3], grid(2, 2.0), &surface(0.5, 0.0));
    let still = stage.world.add(still).unwrap();
    let ball = stage.world.add(dynamic([0.0, 1.0, 0.0], Rigid3::ball(0.1), &surface(0.5, 0.0)));
    let world = &mut stage.world;
    let collider = |world: &World3, body| world.colliders(body).next().unwrap();
    let (still, ball) = (collider(world, still), collider(world, ball.unwrap()));
    let rest = stage.rest.clone();
    let refused = |world: &mut World3, id, targets: &[Vec3]| {
        let before = world.vertices(id);
        let error = world.move_vertices(id, targets).unwrap_err();
        assert_eq!(world.vertices(id), before);
        error
    };
    let fault = |error| match error {
        InputError::Mesh(fault) => fault,
        other => panic!("{other}"),
    };
    assert_eq!(fault(refused(world, ball, &rest)), MeshFault::NotAMesh);
    assert_eq!(fault(refused(world, still, &rest)), MeshFault::NotKinematic);
    let count = MeshFault::Vertices { expected: 9, found: 8 };
    assert_eq!(fault(refused(world, stage.mesh, &rest[..8])), count);
    let mut wrong = rest.clone();
    wrong[4][1] = f32::NAN;
    assert!(matches!(refused(world, stage.mesh, &wrong), InputError::OutOfRange { .. }));
    let mut flat = rest.clone();
    flat[1] = rest[0];
    assert_eq!(fault(refused(world, stage.mesh, &flat)), MeshFault::FlatTriangle(0));
    let lower: Vec<Vec3> = rest.iter().map(|vertex| *vertex - Vector([0.0, 1.0, 0.0])).collect();
    world.set_vertices(still, &lower).unwrap();
    assert_eq!(world.vertices(still).unwrap(), lower);
    // Too fast: refused by the step, which changes nothing.
    world.move_vertices(stage.mesh, &lower).unwrap();
    assert!(world.step(1e-13).is_err());
    assert_eq!(world.vertices(stage.mesh).unwrap(), rest);
}
