//! Tests that a step of a settled scene allocates no memory.

use crate::common::counting::allocations;
use crate::common::*;
use drystone::geometry::{Particles, Rigid2, Rigid3};
use drystone::{Joint, Motion, World};

/// Drops these shapes into a tray, lets them settle for 300 steps, and asserts that 50 more
/// allocate nothing.
fn settled<G: RoundShapes<L, A>, const L: usize, const A: usize>(
    name: &str,
    wall: impl Fn(usize, f32) -> G::Shape,
    shapes: &[G::Shape],
) {
    let material = surface(0.5, 0.0);
    let mut world: World<G, L, A> = world();
    for (axis, side) in [(0, -1.0), (0, 1.0), (1, -1.0), (2, -1.0), (2, 1.0)] {
        if axis < L {
            let mut position = [0.0; L];
            position[axis] = side * 2.0 - if axis == 1 { -1.5 } else { 0.0 };
            let wall = wall(axis, -side);
            world.add(body(Motion::Static, position, wall, &material)).unwrap();
        }
    }
    let mut random = Random(3);
    for index in 0..if L == 2 { 30 } else { 64 } {
        let cell = |axis: u32| (index / 4usize.pow(axis) % 4) as f32 * 0.8 - 1.2;
        let height = if L == 2 { index / 4 } else { index / 16 };
        let aside: f32 = random.between(-0.05, 0.05);
        let position = v(cell(0) + aside, 0.5 + 0.7 * height as f32, cell(1) + aside);
        world.add(dynamic(position, shapes[index % shapes.len()].clone(), &material)).unwrap();
    }
    for _ in 0..300 {
        world.step(DT).unwrap();
    }
    let mut contacts = 0;
    let taken = allocations(|| {
        for _ in 0..50 {
            contacts = world.step(DT).unwrap().contacts;
        }
    });
    assert!(contacts >= 20, "({L},{A}) {name}: only {contacts} contacts");
    assert_eq!(taken, 0, "({L},{A}) {name}: allocations in 50 steps");
}

fn solid<G: Rigid<L, A>, const L: usize, const A: usize>(name: &str, shapes: &[G::Shape]) {
    let wall = |axis: usize, _| {
        let mut half = [4.0; L];
        half[axis] = 0.5;
        G::cuboid(half)
    };
    settled::<G, L, A>(name, wall, shapes);
}

fn halfspace<G: RoundShapes<L, A>, const L: usize, const A: usize>(
    axis: usize,
    side: f32,
) -> G::Shape {
    let mut normal = [0.0; L];
    normal[axis] = side;
    G::halfspace(normal)
}

/// Fifty steps of settled particles, and of settled bodies in 2D, allocate nothing.
#[test]
fn a_settled_pile_allocates_nothing() {
    settled::<Particles, 2, 0>("particles", halfspace::<Particles, 2, 0>, &[Particles::ball(0.3)]);
    settled::<Particles, 3, 0>("particles", halfspace::<Particles, 3, 0>, &[Particles::ball(0.3)]);
    let (ball, block) = (Rigid2::ball(0.3), Rigid2::cuboid([0.3; 2]));
    let hull = Rigid2::hull(&[[-0.3, -0.2], [0.3, -0.2], [0.2, 0.2], [-0.1, 0.3]]);
    solid::<Rigid2, 2, 1>("balls", std::slice::from_ref(&ball));
    solid::<Rigid2, 2, 1>("boxes", std::slice::from_ref(&block));
    solid::<Rigid2, 2, 1>("hulls", std::slice::from_ref(&hull));
    let mixed = [ball, block, hull, Rigid2::capsule(0.15, 0.2)];
    solid::<Rigid2, 2, 1>("mixed", &mixed);
    settled::<Rigid2, 2, 1>("mixed between planes", halfspace::<Rigid2, 2, 1>, &mixed);
}

/// Fifty steps of settled bodies in 3D allocate nothing.
#[test]
fn a_settled_pile_in_space_allocates_nothing() {
    let (ball, block) = (Rigid3::ball(0.3), Rigid3::cuboid([0.3; 3]));
    let (low, high) = ([-0.3, -0.2, -0.3], [0.3, 0.2, 0.25]);
    let corner = |i: usize| std::array::from_fn(|k| if i >> k & 1 == 0 { low[k] } else { high[k] });
    let mut corners: Vec<[f32; 3]> = (0..8).map(corner).collect();
    corners.push([0.05, 0.35, 0.0]);
    let hull = Rigid3::hull(&corners);
    let capsule = Rigid3::capsule(0.15, 0.2);
    solid::<Rigid3, 3, 3>("balls", std::slice::from_ref(&ball));
    solid::<Rigid3, 3, 3>("boxes", std::slice::from_ref(&block));
    solid::<Rigid3, 3, 3>("hulls", std::slice::from_ref(&hull));
    solid::<Rigid3, 3, 3>("capsules", std::slice::from_ref(&capsule));
    solid::<Rigid3, 3, 3>("mixed", &[ball, block, hull, capsule]);
}

/// Fifty steps of chains that swing, of which some lie on the floor, allocate nothing. The links of every
/// second one collide.
#[test]
fn swinging_chains_allocate_nothing() {
    let material = surface(0.5, 0.0);
    let mut world: World<Rigid3, 3, 3> = world();
    add_floor(&mut world, &material);
    for chain in 0..4 {
        let (z, mut above) = (chain as f32, None);
        for link in 0..6 {
            let y = 3.0 - chain as f32 * 0.6;
            let position = [0.4 * link as f32 + 0.2, y, z];
            let shape = Rigid3::capsule(0.1, 0.05);
            let id = world.add(dynamic(position, shape, &material)).unwrap();
            let joint = Joint::ball([above, Some(id)]).at([0.4 * link as f32, y, z]);
            world.join(if chain % 2 == 0 { joint } else { joint.colliding() }).unwrap();
            above = Some(id);
        }
    }
    for _ in 0..900 {
        world.step(DT).unwrap();
    }
    let mut gap = 0.0f64;
    let taken = allocations(|| {
        for _ in 0..50 {
            gap = gap.max(world.step(DT).unwrap().joint_gap[0]);
        }
    });
    assert!(gap > 0.0 && gap < 1e-3, "gap of {gap} m");
    assert_eq!(taken, 0, "allocations in 50 steps");
}
