//! Tests of bodies on triangle meshes: they stand, slide, roll, and stay on their side.

use std::f32::consts::PI;

use crate::common::*;
use drystone::geometry::{Geometry, Rigid3};
use drystone::{BodyId, Motion, StepSettings, World3};
use drystone_solver::{Vector, Velocity};
use parry3d::shape::SharedShape;

/// Returns presets and time steps \[s\] with their names.
fn paces() -> [(&'static str, StepSettings, f32); 4] {
    [
        ("24 steps a second", StepSettings::certified(), 1.0 / 24.0),
        ("120 steps a second", StepSettings::certified(), 1.0 / 120.0),
        ("24 steps a second, real-time preset", StepSettings::realtime(), 1.0 / 24.0),
        ("60 steps a second, real-time preset", StepSettings::realtime(), 1.0 / 60.0),
    ]
}

fn with(settings: &StepSettings) -> World3 {
    let mut world: World3 = world();
    world.settings = StepSettings { sleep_delay: 0.0, ..settings.clone() };
    world
}

/// Orientation of the triangles of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Winding {
    Original,
    Turned,
    Mixed,
}

const WINDINGS: [Winding; 3] = [Winding::Original, Winding::Turned, Winding::Mixed];

fn wound(triangles: &[[u32; 3]], winding: Winding) -> Vec<[u32; 3]> {
    let turn = |index| match winding {
        Winding::Original => false,
        Winding::Turned => true,
        Winding::Mixed => index % 3 == 0,
    };
    let own =
        |(index, &[a, b, c]): (usize, &[u32; 3])| if turn(index) { [a, c, b] } else { [a, b, c] };
    triangles.iter().enumerate().map(own).collect()
}

/// A ground of `n` by `n` squares from -1 to 1 m, with vertices at these heights \[m\].
struct Terrain {
    n: usize,
    height: fn(f32, f32) -> f32,
}

impl Terrain {
    fn at(&self, i: usize) -> f32 {
        2.0 * i as f32 / self.n as f32 - 1.0
    }

    fn shape(&self, winding: Winding) -> SharedShape {
        let (n, mut vertices, mut triangles) = (self.n, Vec::new(), Vec::new());
        for i in 0..=n {
            for j in 0..=n {
                let (x, z) = (self.at(i), self.at(j));
                vertices.push([x, (self.height)(x, z), z]);
            }
        }
        for i in 0..n {
            for j in 0..n {
                let a = (i * (n + 1) + j) as u32;
                let (b, c) = (a + 1, a + n as u32 + 1);
                triangles.extend([[a, b, c], [b, c + 1, c]]);
            }
        }
        Rigid3::mesh(&vertices, &wound(&triangles, winding))
    }

    /// Returns the height of the ground at a position. \[m\]
    fn below(&self, x: f32, z: f32) -> f32 {
        let cell = |x: f32| {
            let part = (x + 1.0) * 0.5 * self.n as f32;
            let index = (part.max(0.0) as usize).min(self.n - 1);
            (index, part - index as f32)
        };
        let ((i, u), (j, v)) = (cell(x), cell(z));
        let h = |i: usize, j: usize| (self.height)(self.at(i), self.at(j));
        let (b, c) = (h(i, j + 1), h(i + 1, j));
        if u + v <= 1.0 {
            let a = h(i, j);
            a + (c - a) * u + (b - a) * v
        } else {
            let d = h(i + 1, j + 1);
            d + (b - d) * (1.0 - u) + (c - d) * (1.0 - v)
        }
    }
}

const FLAT: fn(f32, f32) -> f32 = |_, _| 0.0;
const WAVY: fn(f32, f32) -> f32 = |x, z| 0.06 * (5.0 * x).sin() * (4.0 * z).cos();
const BUMPY: fn(f32, f32) -> f32 = |x, z| 0.02 * (57.0 * x + 31.0 * z * z).sin();
const HOLLOW: fn(f32, f32) -> f32 = |x, z| 0.3 * (x * x + z * z);

fn ring(sides: usize, height: f32) -> impl Iterator<Item = [f32; 3]> {
    let angle = move |i| 2.0 * PI * i as f32 / sides as f32;
    (0..sides).map(move |i| [angle(i).cos(), height, angle(i).sin()])
}

fn cone(sides: usize) -> Vec<[f32; 3]> {
    ring(sides, -1.0).chain([[0.0, 1.0, 0.0]]).collect()
}

fn prism(sides: usize) -> Vec<[f32; 3]> {
    ring(sides, -1.0).chain(ring(sides, 1.0)).collect()
}

/// Returns a shape of about this size \[m\], its corners, and the radius around them \[m\].
fn shape(kind: usize, size: f32, random: &mut Random) -> (SharedShape, Vec<[f32; 3]>, f32) {
    let hull = |points: Vec<[f32; 3]>| {
        let points: Vec<_> = points.iter().map(|p| p.map(|x| x * size)).collect();
        (Rigid3::hull(&points), points, 0.0)
    };
    let cuboid = |half: [f32; 3]| {
        let half = half.map(|x| x * size);
        let corner = |i: usize| [0, 1, 2].map(|k| if i >> k & 1 == 0 { half[k] } else { -half[k] });
        (Rigid3::cuboid(half), (0..8).map(corner).collect(), 0.0)
    };
    match kind {
        0 => cuboid([1.0, 0.7, 0.5]),
        1 => cuboid([1.0, 0.1, 0.8]),
        2 => (Rigid3::ball(size), vec![[0.0; 3]], size),
        3 => {
            let (half, radius) = (0.7 * size, 0.4 * size);
            (Rigid3::capsule(half, radius), vec![[0.0, half, 0.0], [0.0, -half, 0.0]], radius)
        }
        4 => hull((0..12).map(|_| random.vector(1.0)).collect()),
        5 => hull(prism(3)),
        6 => hull(prism(32)),
        sides => hull(cone(4 << (sides - 7))),
    }
}

const KINDS: usize = 12;

/// Returns the depth of the deepest corner of a shape below the ground, where its radius counts by
/// 0.9. \[m\]
fn depth(world: &World3, id: BodyId, ground: &Terrain, corners: &[[f32; 3]], radius: f32) -> f32 {
    let frame = Rigid3::frame(&world.pose(id).unwrap());
    let corner = |corner: &[f32; 3]| {
        let place = frame.point(Vector(*corner));
        ground.below(place[0], place[2]) - place[1] + radius * 0.9
    };
    corners.iter().map(corner).fold(f32::NEG_INFINITY, f32::max)
}

/// All shapes, dropped at up to 20 m/s onto all kinds of ground, come to lie there with no corner
/// deeper than 1 cm.
#[test]
fn shapes_stay_on_meshes() {
    let grounds = [(1, FLAT), (10, FLAT), (60, FLAT), (20, WAVY), (20, BUMPY), (25, HOLLOW)];
    let mut random = Random(21);
    for (number, (n, height)) in grounds.into_iter().enumerate() {
        let ground = Terrain { n, height };
        for (pace, (name, settings, dt)) in paces().into_iter().enumerate() {
            let mut world = with(&settings);
            let (size, speed) = (0.06, [0.0, 5.0, 20.0, 2.0][(number + pace) % 4]);
            let winding = WINDINGS[(number + pace) % 3];
            let rough = surface(0.5, 0.0);
            world.add(body(Motion::Static, [0.0; 3], ground.shape(winding), &rough)).unwrap();
            let mut bodies = Vec::new();
            for kind in 0..KINDS {
                let (x, z) = (-0.6 + 0.4 * (kind % 4) as f32, -0.5 + 0.5 * (kind / 4) as f32);
                let (shape, corners, radius) = shape(kind, size, &mut random);
                let top = (0..9).map(|i| {
                    let aside = |i: usize| (i as f32 - 1.0) * 0.1;
                    ground.below(x + aside(i % 3), z + aside(i / 3))
                });
                let y = top.fold(0.0, f32::max) + 1.6 * size + random.between(0.0, 0.1);
                let mut fallen = dynamic([x, y, z], shape, &rough);
                let turn = random.vector(3.0);
                fallen.pose = Rigid3::advance(&fallen.pose, Vector::ZERO, Vector(turn));
                fallen.velocity.linear = Vector([0.0, -speed, 0.0]);
                bodies.push((kind, world.add(fallen).unwrap(), corners, radius));
            }
            for _ in 0..(0.6 / dt) as usize {
                world.step(dt).unwrap();
            }
            for (kind, id, corners, radius) in bodies {
                let what = format!("shape {kind}, ground {number}, {speed} m/s, {name}");
                let place = place(&world, id);
                if place[0].abs() < 0.9 && place[2].abs() < 0.9 {
                    let deep = depth(&world, id, &ground, &corners, radius);
                    assert_below(&format!("{what}: depth [m]"), deep, 0.01);
                }
            }
        }
    }
}

/// Cones and prisms of up to 64 sides stand on meshes: they move aside by less than 1 mm. They are
/// at most 0.2 mm deeper than a box on the same mesh.
#[test]
fn cones_stand_on_meshes() {
    for (name, settings, dt) in paces() {
        for (n, sides) in [(1, 8), (1, 64), (7, 16), (50, 33)] {
            let ground = Terrain { n, height: FLAT };
            let mut world = with(&settings);
            let rough = surface(0.5, 0.0);
            world
                .add(body(Motion::Static, [0.0; 3], ground.shape(Winding::Turned), &rough))
                .unwrap();
            let cone: Vec<_> = cone(sides).iter().map(|p| p.map(|x| x * 0.1)).collect();
            let prism: Vec<_> = prism(sides).iter().map(|p| p.map(|x| x * 0.1)).collect();
            let shapes =
                [Rigid3::hull(&cone), Rigid3::hull(&prism), Rigid3::cuboid([0.1, 0.1, 0.1])];
            let places = [-0.43, 0.03, 0.47];
            let mut add = |(shape, x)| world.add(dynamic([x, 0.1, 0.04], shape, &rough)).unwrap();
            let ids: Vec<_> = shapes.into_iter().zip(places).map(&mut add).collect();
            for _ in 0..(1.5 / dt) as usize {
                world.step(dt).unwrap();
            }
            let sunk: Vec<f32> = ids.iter().map(|&id| 0.1 - place(&world, id)[1]).collect();
            for (id, x) in ids.into_iter().zip(places) {
                let place = place(&world, id);
                let what = format!("{sides} sides on {n} squares, {name}");
                assert_below(&format!("{what}: aside [m]"), (place[0] - x).abs(), 1e-3);
                assert_below(&format!("{what}: sunk [m]"), 0.1 - place[1], sunk[2] + 2e-4);
            }
        }
    }
}

/// Returns half a pipe of strips along z, 3 m long and with a radius of 1 m.
fn trough(strips: u32, winding: Winding) -> SharedShape {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..=strips {
        let angle = PI * (i as f32 / strips as f32 - 0.5);
        vertices.extend([-1.5, 1.5].map(|z| [angle.sin(), 1.0 - angle.cos(), z]));
    }
    for i in 0..strips {
        let a = 2 * i;
        triangles.extend([[a, a + 1, a + 2], [a + 1, a + 3, a + 2]]);
    }
    Rigid3::mesh(&vertices, &wound(&triangles, winding))
}

/// A ball or capsule in a trough of strips drifts along it by less than 0.1 mm in 10 s.
#[test]
fn troughs_do_not_push_along() {
    let shapes = [(Rigid3::ball(0.07), 0.0), (Rigid3::ball(0.07), 0.5), {
        (Rigid3::capsule(0.06, 0.04), 0.0)
    }];
    for (strips, winding) in [16, 64, 256].into_iter().zip(WINDINGS) {
        for settings in [StepSettings::certified(), StepSettings::realtime()] {
            for (shape, friction) in &shapes {
                let mut world = with(&settings);
                let material = surface(*friction, 0.0);
                world
                    .add(body(Motion::Static, [0.0; 3], trough(strips, winding), &material))
                    .unwrap();
                let mut ball = dynamic([-0.6, 0.5, 0.137], shape.clone(), &material);
                let along = Vector([0.5 * PI, 0.0, 0.0]);
                ball.pose = Rigid3::advance(&ball.pose, Vector::ZERO, along);
                let ball = world.add(ball).unwrap();
                let mut drift = 0.0f32;
                for _ in 0..600 {
                    world.step(DT).unwrap();
                    drift = drift.max((place(&world, ball)[2] - 0.137).abs());
                }
                let what = format!("{strips} strips, friction {friction}");
                assert_below(&format!("{what}: drift [m]"), drift, 1e-4);
                assert!(place(&world, ball)[1] > 0.03, "{what}: {:?}", place(&world, ball));
            }
        }
    }
}

/// Balls in a cup of a single layer of triangles stay there, and one thrown at it stays outside,
/// whatever the orientation of its faces.
#[test]
fn a_cup_has_two_sides() {
    let (sides, radius) = (24, 0.1);
    let mut vertices = vec![[0.0; 3]];
    for y in [0.0, 0.15] {
        vertices.extend(ring(sides, y).map(|[x, y, z]| [x * radius, y, z * radius]));
    }
    let mut triangles = Vec::new();
    for i in 0..sides as u32 {
        let (a, b) = (1 + i, 1 + (i + 1) % sides as u32);
        let (c, d) = (a + sides as u32, b + sides as u32);
        triangles.extend([[0, a, b], [a, c, b], [b, c, d]]);
    }
    for winding in WINDINGS {
        for settings in [StepSettings::certified(), StepSettings::realtime()] {
            let mut world = with(&settings);
            let rough = surface(0.4, 0.0);
            add_floor(&mut world, &rough);
            let cup = Rigid3::mesh(&vertices, &wound(&triangles, winding));
            world.add(body(Motion::Static, [0.0, 0.05, 0.0], cup, &rough)).unwrap();
            let mut ball = |x: f32, y: f32, z: f32, speed: f32| {
                let ball = dynamic([x, y, z], Rigid3::ball(0.02), &rough);
                world.add(moving(ball, [speed, 0.0, 0.0])).unwrap()
            };
            let inside: Vec<_> = (0..6)
                .map(|i| ball(0.02 - 0.01 * (i % 3) as f32, 0.12 + 0.045 * i as f32, 0.01, 0.0))
                .collect();
            let outside = ball(0.4, 0.1, 0.0, -4.0);
            run(&mut world, 2.0);
            for id in inside {
                let [x, y, z] = place(&world, id).0;
                let aside = (x * x + z * z).sqrt();
                assert!(aside < 0.081 && y > 0.068, "{winding:?}: {x} {y} {z}");
            }
            let place = place(&world, outside);
            assert!(place[0] > 0.115, "{winding:?}, thrown at it: {place:?}");
        }
    }
}

/// Returns a box of 1 m by 0.5 m by 1 m with sides of `n` by `n` squares, facing outward unless
/// wound otherwise.
fn block(n: u32, winding: Winding) -> SharedShape {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let half = [0.5, 0.25, 0.5];
    for axis in 0..3 {
        for sign in [1.0, -1.0f32] {
            let first = vertices.len() as u32;
            for i in 0..=n {
                for j in 0..=n {
                    let mut vertex = [0.0; 3];
                    vertex[axis] = sign * half[axis];
                    for (other, k) in [(1, i), (2, j)] {
                        let other = (axis + other) % 3;
                        vertex[other] = half[other] * (2.0 * k as f32 / n as f32 - 1.0);
                    }
                    vertices.push(vertex);
                }
            }
            for i in 0..n {
                for j in 0..n {
                    let a = first + i * (n + 1) + j;
                    let (b, c) = (a + n + 1, a + 1);
                    for [p, q, r] in [[a, b, c], [b, b + 1, c]] {
                        triangles.push(if sign > 0.0 { [p, q, r] } else { [p, r, q] });
                    }
                }
            }
        }
    }
    Rigid3::mesh(&vertices, &wound(&triangles, winding))
}

/// A closed mesh pushes out a body whose center is inside, and one whose faces all look inward is a
/// room. The height of the body at rest is right within 0.5 %.
#[test]
fn closed_meshes_push_out() {
    let shapes = [
        Rigid3::ball(0.1),
        Rigid3::cuboid([0.1, 0.1, 0.1]),
        Rigid3::hull(&cone(16).iter().map(|p| p.map(|x| x * 0.1)).collect::<Vec<_>>()),
    ];
    for (n, winding) in [1, 5].into_iter().flat_map(|n| WINDINGS.map(|winding| (n, winding))) {
        for settings in [StepSettings::certified(), StepSettings::realtime()] {
            for (shape, start) in shapes.iter().flat_map(|shape| [(shape, 0.22), (shape, 0.4)]) {
                let mut world = with(&settings);
                let rough = surface(0.5, 0.0);
                world.add(body(Motion::Static, [0.0; 3], block(n, winding), &rough)).unwrap();
                let id = world.add(dynamic([0.1, start, 0.1], shape.clone(), &rough)).unwrap();
                run(&mut world, 1.0);
                let height = place(&world, id)[1];
                let room = winding == Winding::Turned && start < 0.25;
                let wanted = if room { -0.15 } else { 0.35 };
                let what = format!("{n} squares, {winding:?}, from {start} m");
                assert_within(&format!("{what}: height [m]"), height, wanted, 5e-3);
            }
        }
    }
}

/// Shapes slide over a plane of many triangles as over a single one: their velocity changes by less
/// than 1 %, and they rise by less than 1 mm.
#[test]
fn inner_edges_do_not_slow() {
    let smooth = surface(0.0, 0.0);
    let cone: Vec<_> = cone(32).iter().map(|p| p.map(|x| x * 0.1)).collect();
    let shapes = [Rigid3::hull(&cone), Rigid3::cuboid([0.1; 3]), Rigid3::ball(0.1)];
    for settings in [StepSettings::certified(), StepSettings::realtime()] {
        for (shape, speed) in shapes.iter().flat_map(|shape| [0.1, 2.0, 16.0].map(|v| (shape, v))) {
            let ground = Terrain { n: 40, height: FLAT };
            let mut world = with(&settings);
            world
                .add(body(Motion::Static, [0.0; 3], ground.shape(Winding::Mixed), &smooth))
                .unwrap();
            let slider = dynamic([-0.8, 0.1, -0.31], shape.clone(), &smooth);
            let slider = world.add(moving(slider, [speed, 0.0, 0.37 * speed])).unwrap();
            let mut rise = 0.0f32;
            for _ in 0..((1.4 / speed / DT) as usize).clamp(3, 60) {
                world.step(DT).unwrap();
                rise = rise.max(place(&world, slider)[1] - 0.1);
            }
            let Velocity { linear, .. } = velocity(&world, slider);
            let change = (linear - Vector([speed, 0.0, 0.37 * speed])).length() / speed;
            assert_below(&format!("at {speed} m/s: change of speed [1]"), change, 0.01);
            assert_below(&format!("at {speed} m/s: rise [m]"), rise, 1e-3);
        }
    }
}

/// Marbles of 1 to 10 mm radius at 20 m/s do not tunnel through a single layer of triangles: no
/// center is 2 mm below it.
#[test]
fn small_marbles_do_not_tunnel() {
    let mut random = Random(5);
    for (n, height) in [(1, FLAT), (40, FLAT), (20, BUMPY)] {
        let ground = Terrain { n, height };
        for (name, settings, dt) in paces() {
            let mut world = with(&settings);
            let rough = surface(0.4, 0.0);
            world
                .add(body(Motion::Static, [0.0; 3], ground.shape(Winding::Original), &rough))
                .unwrap();
            let ids: Vec<_> = (0..9)
                .map(|i| {
                    let radius = [0.001, 0.003, 0.01][i % 3];
                    let x = -0.2 + 0.2 * (i % 3) as f32;
                    let place = [x, 0.1 + random.between(0.0, 0.3), -0.2 + 0.2 * (i / 3) as f32];
                    let marble = dynamic(place, Rigid3::ball(radius), &rough);
                    let aside: [f32; 3] = random.vector(6.0);
                    world.add(moving(marble, [aside[0], -20.0, aside[2]])).unwrap()
                })
                .collect();
            for _ in 0..(0.3 / dt) as usize {
                world.step(dt).unwrap();
            }
            for id in ids {
                let place = place(&world, id);
                if place[0].abs() < 0.95 && place[2].abs() < 0.95 {
                    let deep = ground.below(place[0], place[2]) - place[1];
                    assert_below(&format!("{n} squares, {name}: center below [m]"), deep, 2e-3);
                }
            }
        }
    }
}

/// A box at rest on a wavy mesh moves by less than 0.2 mm in 3 s.
#[test]
fn a_box_on_waves_does_not_creep() {
    for winding in WINDINGS {
        let ground = Terrain { n: 20, height: WAVY };
        let mut world = with(&StepSettings::certified());
        let rough = surface(0.8, 0.0);
        world.add(body(Motion::Static, [0.0; 3], ground.shape(winding), &rough)).unwrap();
        let id = world
            .add(dynamic([0.1, 0.16, 0.05], Rigid3::cuboid([0.25, 0.06, 0.2]), &rough))
            .unwrap();
        run(&mut world, 3.0);
        let start = place(&world, id);
        run(&mut world, 3.0);
        let moved = (place(&world, id) - start).length();
        assert_below(&format!("{winding:?}: moved [m]"), moved, 2e-4);
    }
}

/// Plates, sticks and capsules at 20 m/s do not tunnel through a floor of 2 cm in the real-time
/// preset. No step adds more than 0.1 % to their energy.
#[test]
fn slender_bodies_do_not_tunnel_through_thin_floors() {
    let mut random = Random(5);
    let shapes = [
        Rigid3::cuboid([0.06, 0.006, 0.048]),
        Rigid3::cuboid([0.1, 0.004, 0.004]),
        Rigid3::capsule(0.06, 0.01),
    ];
    for shape in shapes {
        let mut world = with(&StepSettings::realtime());
        let rough = surface(0.5, 0.0);
        world
            .add(body(
                Motion::Static,
                [0.0, -0.01, 0.0],
                Rigid3::cuboid([30.0, 0.01, 30.0]),
                &rough,
            ))
            .unwrap();
        let mut things = Vec::new();
        for i in 0..60 {
            let (x, z) = (0.72 * (i % 8) as f32, 0.72 * (i / 8) as f32);
            let at = [x, 0.12 + random.between(0.0, 0.8), z];
            let mut thrown = dynamic(at, shape.clone(), &rough);
            thrown.pose = Rigid3::advance(&thrown.pose, Vector::ZERO, Vector(random.vector(3.0)));
            thrown.velocity.linear = Vector([0.0, -20.0, 0.0]);
            things.push(world.add(thrown).unwrap());
        }
        for _ in 0..60 {
            let before = energy(&world);
            world.step(1.0 / 60.0).unwrap();
            let after = energy(&world);
            assert!(
                after < before * (1.0 + 1e-3 * before.signum()) + 1e-3,
                "{before} J to {after} J"
            );
        }
        for id in things {
            let place = place(&world, id);
            assert!(place[1] > -0.01, "{place:?}");
        }
    }
}
