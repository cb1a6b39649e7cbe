//! State of bodies and contacts as numbers, for worlds of any dimension.

use drystone::geometry::Geometry;
use drystone::{BodyId, ColliderId, InputError, Vector, Velocity, World};
use drystone_scene::Rotation;

use crate::forms::place;
use crate::input::check_count;

/// Pairs of colliders that touch ([`Touching`](drystone::Touching)), one entry for each pair.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TouchingPairs {
    /// Bodies a and b.
    pub bodies: Vec<[BodyId; 2]>,
    /// Their colliders.
    pub colliders: Vec<[ColliderId; 2]>,
    /// Unit normals from b towards a: two or three numbers each.
    pub normals: Vec<f32>,
    /// World positions at the deepest points: two or three numbers each. \[m\]
    pub points: Vec<f32>,
    /// Distances between the surfaces there, negative where they overlap. \[m\]
    pub gaps: Vec<f32>,
    /// Sums of the normal impulses of the last step, if recorded. \[N s\]
    pub impulses: Vec<f32>,
}

pub(super) fn write_touching<G: Geometry<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    pairs: &mut TouchingPairs,
) {
    let TouchingPairs { bodies, colliders, normals, points, gaps, impulses } = pairs;
    bodies.clear();
    colliders.clear();
    for numbers in [&mut *normals, points, gaps, impulses] {
        numbers.clear();
    }
    for pair in world.touching() {
        bodies.push(pair.bodies);
        colliders.push(pair.colliders);
        normals.extend(pair.normal.0);
        points.extend(pair.point.0);
        gaps.push(pair.gap);
        impulses.push(pair.impulse);
    }
}

/// Returns each body with its numbers.
pub(super) fn by_body<'a>(
    bodies: &'a [BodyId],
    numbers: &'a [f32],
    each: usize,
) -> Result<impl Iterator<Item = (BodyId, &'a [f32])> + Clone + use<'a>, InputError> {
    check_count("the slice for these bodies", numbers.len(), bodies.len() * each)?;
    Ok(bodies.iter().copied().zip(numbers.chunks_exact(each)))
}

/// Converts numbers to a pose. The world tells its dimension.
pub(super) fn pose_of<G: Geometry<L, A>, const L: usize, const A: usize>(
    _world: &World<G, L, A>,
    numbers: &[f32],
) -> G::Pose {
    G::read(numbers)
}

pub(super) fn write_pose<G: Geometry<L, A>, const L: usize, const A: usize>(
    _world: &World<G, L, A>,
    pose: &G::Pose,
) -> Vec<f32> {
    let mut out = Vec::new();
    G::write(pose, &mut out);
    out
}

/// Converts numbers to a velocity or a force.
pub(super) fn velocity_of<const L: usize, const A: usize>(numbers: &[f32]) -> Velocity<f32, L, A> {
    let number = |i: usize| numbers.get(i).copied().unwrap_or(0.0);
    Velocity {
        linear: Vector(std::array::from_fn(number)),
        angular: Vector(std::array::from_fn(|i| number(L + i))),
    }
}

/// Appends the numbers of a velocity; those of a particle have no rotation.
pub(super) fn write_velocity<const L: usize, const A: usize>(
    velocity: Velocity<f32, L, A>,
    out: &mut Vec<f32>,
) {
    let spin = if L == 3 { 3 } else { 1 };
    out.extend(velocity.linear.0);
    out.extend(velocity.angular.0);
    out.extend(std::iter::repeat_n(0.0, spin - A));
}

/// Moves the body in a slot to a pose of its track within `dt` \[s\].
pub(super) fn follow<G: Geometry<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    slot: usize,
    (position, rotation): (&[f64], &Rotation),
    dt: f32,
) -> Result<(), InputError> {
    let target = place::<G, L, A>(position, rotation);
    world.body_at(slot).map_or(Ok(()), |id| world.move_to(id, &target, dt))
}
