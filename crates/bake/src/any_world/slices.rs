//! State of bodies and contacts as numbers, for worlds of any dimension.

use drystone::geometry::Geometry;
use drystone::{BodyId, ColliderId, InputError, Vector, Velocity, World};
use drystone_scene::Rotation;
use serde::{Deserialize, Serialize};

use super::guide::{Guide, MeshGuide};
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

/// Normal impulses between colliders in a step
/// ([`PairImpulse`](drystone::PairImpulse)), one entry for each pair of colliders.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PairImpulses {
    /// Slots of bodies a and b.
    pub bodies: Vec<[u32; 2]>,
    /// World positions, weighted by impulses: two or three numbers each. \[m\]
    pub points: Vec<f32>,
    /// Unit normals from b towards a: two or three numbers each.
    pub normals: Vec<f32>,
    /// Sums of the normal impulses. \[N s\]
    pub impulses: Vec<f32>,
    /// Approach speeds with the velocities before the step. \[m/s\]
    pub speeds: Vec<f32>,
}

impl PairImpulses {
    /// No entries.
    pub const NONE: Self = Self {
        bodies: Vec::new(),
        points: Vec::new(),
        normals: Vec::new(),
        impulses: Vec::new(),
        speeds: Vec::new(),
    };

    /// Appends the entries of another step.
    pub fn append(&mut self, other: &Self) {
        self.bodies.extend(&other.bodies);
        self.points.extend(&other.points);
        self.normals.extend(&other.normals);
        self.impulses.extend(&other.impulses);
        self.speeds.extend(&other.speeds);
    }

    /// Returns true if there are as many numbers as the pairs of bodies need, all of which are
    /// below `bodies`.
    pub fn fits(&self, bodies: usize, dimension: usize) -> bool {
        let count = self.bodies.len();
        let vectors = count.saturating_mul(dimension);
        [self.points.len(), self.normals.len()] == [vectors; 2]
            && [self.impulses.len(), self.speeds.len()] == [count; 2]
            && self.bodies.as_flattened().iter().all(|body| (*body as usize) < bodies)
    }
}

pub(super) fn impulses_of<G: Geometry<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
) -> PairImpulses {
    let mut pairs = PairImpulses::default();
    for pair in world.impulses() {
        pairs.bodies.push(pair.bodies.map(|id| id.index() as u32));
        pairs.points.extend(pair.point.0);
        pairs.normals.extend(pair.normal.0);
        pairs.impulses.push(pair.impulse);
        pairs.speeds.push(pair.speed);
    }
    pairs
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

/// Guides the body in a slot in a step of `dt` \[s\] that ends at `time`: along its track, or by
/// its force; and the vertices of its meshes. Releases it if its track has ended.
pub(super) fn guide<G: Geometry<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    slot: usize,
    guide: &Guide,
    [time, passing, dt]: [f64; 3],
) -> Result<(), InputError> {
    let Some(id) = world.body_at(slot) else { return Ok(()) };
    for mesh in guide.meshes.iter().filter(|mesh| mesh.moves([time - passing, time])) {
        if let Some(collider) = collider_of(world, id, mesh.shape) {
            world.move_vertices(collider, &vectors(&mesh.at(time)))?;
        }
    }
    if guide.leads(time) {
        let (position, rotation) = guide.track.at(time);
        return follow(world, slot, (&position, &rotation), dt as f32);
    }
    if guide.leads(time - passing) {
        world.hold(id, false)?;
    }
    if guide.pushes() && !world.is_sleeping(id) {
        world.add_force(id, velocity_of(&guide.force))?;
    }
    Ok(())
}

/// Moves the body in a slot to a pose of its track within `dt` \[s\].
fn follow<G: Geometry<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    slot: usize,
    (position, rotation): (&[f64], &Rotation),
    dt: f32,
) -> Result<(), InputError> {
    let target = place::<G, L, A>(position, rotation);
    world.body_at(slot).map_or(Ok(()), |id| world.move_to(id, &target, dt))
}

/// Origin of the vertices of a mesh: placed for the first time, or as a checkpoint had them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Anew,
    Restored,
}

/// Gives a mesh that deforms the vertices that it has at `time` \[s\].
pub(super) fn place_mesh<G: Geometry<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    id: BodyId,
    mesh: &MeshGuide,
    (time, place): (f64, Place),
) -> Result<(), InputError> {
    let Some(collider) = collider_of(world, id, mesh.shape) else { return Ok(()) };
    let vertices = vectors(&mesh.at(time));
    match place {
        Place::Anew => world.set_vertices(collider, &vertices),
        Place::Restored => world.restore_vertices(collider, &vertices),
    }
}

/// Returns the collider of a shape of a body that is not dynamic.
fn collider_of<G: Geometry<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: BodyId,
    shape: usize,
) -> Option<ColliderId> {
    // They come in reverse order of addition.
    let last = world.colliders(id).count().checked_sub(1)?;
    world.colliders(id).nth(last.checked_sub(shape)?)
}

fn vectors<const L: usize>(points: &[[f32; 3]]) -> Vec<Vector<f32, L>> {
    let vector =
        |point: &[f32; 3]| Vector(std::array::from_fn(|i| point.get(i).copied().unwrap_or(0.0)));
    points.iter().map(vector).collect()
}
