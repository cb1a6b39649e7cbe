//! [`Checkpoint`]: the state of a world between two steps. A world that is restored from it takes
//! the same steps, bit by bit.

use std::any::Any;
use std::array::from_fn;
use std::fmt::{self, Debug, Display, Formatter};
use std::sync::{Arc, OnceLock};

use drystone_solver::ladder::SolverMemory;
use drystone_solver::lanes::{CachedImpulse, Reuse};
use drystone_solver::{InverseMass, SymmetricMatrix, Vector, Velocity};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

use super::World;
use crate::balance::Balance;
use crate::bodies::{SearchMotion, SpinState};
use crate::broad_phase::BroadPhase;
use crate::cache::{self, CachedManifold, CachedPoint, ManifoldCache, Pair};
use crate::certifier::JamSchedule;
use crate::colliders::Definitions;
use crate::geometry::{
    Bounds, Curvature, Frame, Geometry, MAX_POINTS, NormalCarrier, pose_numbers,
};
use crate::joints::SavedJoints;
use crate::sleep::Sleep;
use crate::surfaces::HeldTorque;

/// State of a world on which the next step depends, except the descriptions of its bodies.
///
/// Arrays hold the numbers of all bodies, shapes, pairs or points, one after the other. Data that a
/// step recomputes is left out: contact systems and colors.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Checkpoint {
    /// Generations of the slots of bodies and of colliders.
    slots: [Vec<u32>; 2],
    /// Copy of bodies and colliders; absent if the checkpoint was read from bytes.
    #[cfg_attr(feature = "serde", serde(skip))]
    definitions: Shared,
    /// Poses of the centers of mass ([`Geometry::write`]), not of the bodies' origins.
    poses: Vec<f32>,
    /// Rounding errors left out of the positions. \[m\]
    position_remainders: Vec<f32>,
    /// Rounding errors left out of the angular velocities of bodies that precess. \[rad/s\]
    spins: Vec<f32>,
    /// Linear and angular velocities. \[m/s, rad/s\]
    velocities: Vec<f32>,
    /// M^-1 J^T gamma of the last warm start of each body. \[m/s, rad/s\]
    contact_gains: Vec<f32>,
    /// How contacts and joints of each body balance: a mean velocity, then a time. \[m/s, rad/s, s\]
    balances: Vec<f32>,
    /// Forces and torques of the next step. \[N, N m\]
    forces: Vec<f32>,
    /// M^-1 as left by the last step: the linear part, then the rows of the angular part.
    masses: Vec<f32>,
    /// Path length of each body since its contacts and M^-1 were last rebuilt; infinite if the body
    /// has rotated. \[m\]
    moved_since_rebuild: Vec<f32>,
    /// Motion of each body since the last contact search: displacement of its center, and of its
    /// surfaces by rotation. \[m\]
    since_search: Vec<f32>,
    /// Stored boxes of the broad phase: lower and upper corner. \[m\]
    boxes: Vec<f32>,
    /// Pairs of near shapes, with their number of manifolds.
    pairs: Vec<[u32; 3]>,
    /// True for each pair that sleeps.
    asleep: Vec<bool>,
    /// Clearance of each pair. A pair without manifolds and with more clearance than its relative
    /// motion has no contacts; one with manifolds keeps their points. \[m\]
    clearances: Vec<f32>,
    /// Distance up to which contact points were last reused. \[m\]
    #[cfg_attr(feature = "serde", serde(default))]
    last_reuse: f32,
    /// Angular impulse of each pair against rolling and spinning; empty if nothing
    /// resists. \[N m s\]
    torques: Vec<f32>,
    /// Part and number of points of each manifold.
    manifolds: Vec<[u32; 2]>,
    /// By manifold: the normal, the vector from b to a, the normal in the frame of its carrier, and
    /// the frame of a relative to b when the points were found. The radii of curvature and the
    /// shares of the normal follow.
    frames: Vec<f32>,
    /// By point: position on a and on b and push point \[m\], impulse \[N s\], gap and slip \[m\].
    points: Vec<f32>,
    /// Feature of each point.
    features: Vec<u64>,
    /// Time for which each body has held still \[s\], the group with which it sleeps, and gravity
    /// of the last step.
    still: Vec<f32>,
    groups: Vec<u32>,
    gravity: Vec<f32>,
    /// Static and kinematic bodies that were added or moved since the last contact search.
    placed: Vec<u32>,
    /// Slots of the bodies that are held.
    #[cfg_attr(feature = "serde", serde(default))]
    held: Vec<u32>,
    /// Coordinates and impulses of the joints.
    #[cfg_attr(feature = "serde", serde(default))]
    joints: SavedJoints,
    /// State with which the solver tunes itself.
    memory: SolverMemory,
    /// Schedule of the searches for jams.
    jam_schedule: JamSchedule,
    /// Largest error of a substep of sweeps so far: steps beyond name the body at fault. \[m/s\]
    worst_of_sweeps: f64,
}

/// The [`Definitions`] of a world, if any. Comparisons ignore them, because the generations of
/// slots tell added and removed bodies.
#[derive(Clone, Default)]
struct Shared(Option<Arc<dyn Any + Send + Sync>>);

impl PartialEq for Shared {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Debug for Shared {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "bodies" } else { "no bodies" })
    }
}

/// Reason why a world rejects a checkpoint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CheckpointError {
    /// The bytes are not a checkpoint.
    Unreadable(String),
    /// It belongs to a world with other bodies.
    OtherWorld {
        /// Kind of data with the wrong size.
        what: &'static str,
        /// Size in this world.
        expected: usize,
        /// Size in the checkpoint.
        found: usize,
    },
    /// Bodies were added or removed since it was taken. It was read from bytes, which do not hold
    /// bodies.
    OtherBodies,
    /// It belongs to a world with other joints.
    OtherJoints,
    /// A number is infinite or NaN.
    NotFinite(&'static str),
    /// It has a pair of shapes that cannot touch in this world.
    OtherPair([u32; 2]),
}

impl Display for CheckpointError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        const OTHER: &str = "is a checkpoint of another world";
        match self {
            Self::Unreadable(why) => write!(f, "is not a checkpoint: {why}"),
            Self::OtherWorld { what, expected, found } => {
                write!(f, "{OTHER}: {what} need {expected} numbers, and it has {found}")
            }
            Self::OtherBodies => {
                f.write_str("is a checkpoint of other bodies: some were added or removed since")
            }
            Self::OtherJoints => f.write_str(
                "is a checkpoint of other joints: some were added, changed or removed since",
            ),
            Self::NotFinite(what) => write!(f, "has {what} that are not finite"),
            Self::OtherPair(pair) => {
                write!(f, "{OTHER}: its shapes {pair:?} do not collide here")
            }
        }
    }
}

impl std::error::Error for CheckpointError {}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Saves the state between two steps ([`World::checkpoint`]).
    pub(crate) fn save_state(&self) -> Checkpoint {
        let definitions = self.shared_definitions();
        let slots = [&self.bodies.slots, &self.colliders.slots];
        let bodies = &self.bodies;
        let mut poses = Vec::with_capacity(self.len() * pose_numbers(L));
        bodies.poses.iter().for_each(|pose| G::write(pose, &mut poses));
        let (mut pairs, mut cache) = (self.contacts.pairs.clone(), ManifoldCache::default());
        let there = |collider: &u32| self.colliders.slots.is_taken(*collider as usize);
        pairs.retain(|pair| pair.colliders.iter().all(there));
        for pair in &mut pairs {
            let from = if pair.is_sleeping { &self.sleep.cache } else { &self.contacts.cache };
            cache.take_pair(pair, from);
        }
        let nothing = Bounds { min: Vector::ZERO, max: Vector::ZERO };
        let boxes = self.broad_phase.boxes().iter().enumerate();
        let there = |collider: usize| self.colliders.slots.is_taken(collider);
        let boxes = boxes.map(|(at, stored)| if there(at) { *stored } else { nothing });
        Checkpoint {
            slots: slots.map(|slots| slots.generations().to_vec()),
            definitions,
            poses,
            position_remainders: flat(&bodies.position_remainders),
            spins: bodies.spin_states.iter().flat_map(|turn| turn.remainder.0).collect(),
            velocities: flat_velocities(&self.bodies.velocities),
            contact_gains: flat_velocities(&self.bodies.contact_gains),
            balances: self.bodies.balances.iter().flat_map(flat_balance).collect(),
            forces: (0..self.len()).flat_map(|body| flat_velocity(&bodies.force(body))).collect(),
            masses: self.bodies.inverse_masses.iter().flat_map(flat_mass).collect(),
            moved_since_rebuild: bodies
                .moved_since_rebuild
                .iter()
                .zip(&bodies.turned)
                .map(moved_since_rebuild)
                .collect(),
            since_search: bodies.since_search.iter().flat_map(flat_since_search).collect(),
            boxes: boxes.flat_map(|of| of.min.0.into_iter().chain(of.max.0)).collect(),
            pairs: pairs.iter().map(|of| [of.colliders[0], of.colliders[1], of.count]).collect(),
            clearances: pairs.iter().map(saved_clearance).collect(),
            last_reuse: self.contacts.last_reuse,
            asleep: pairs.iter().map(|of| of.is_sleeping).collect(),
            torques: self.torques(&pairs),
            manifolds: cache.manifolds.iter().map(|of| [of.part, of.count]).collect(),
            frames: cache.manifolds.iter().flat_map(flat_manifold).collect(),
            points: cache.points.iter().zip(&cache.impulses).flat_map(flat_point).collect(),
            features: cache.points.iter().map(|point| point.feature).collect(),
            still: self.sleep.still.clone(),
            groups: self.sleep.group.clone(),
            gravity: self.sleep.last_gravity.0.to_vec(),
            placed: self.sleep.placed.clone(),
            held: (0..)
                .zip(&bodies.held)
                .filter(|(_, held)| **held)
                .map(|(slot, _)| slot)
                .collect(),
            joints: self.solver.joints.save(),
            memory: self.solver.certifier.island_solver.memory,
            jam_schedule: self.solver.certifier.jam_schedule,
            worst_of_sweeps: self.solver.certifier.worst_of_sweeps,
        }
    }

    /// Returns the copy of bodies, colliders and joints, made if there is none.
    fn shared_definitions(&self) -> Shared {
        let definitions = self.definitions.get_or_init(|| {
            Arc::new(Definitions {
                bodies: self.bodies.clone(),
                colliders: self.colliders.clone(),
                joints: self.solver.joints.clone(),
            })
        });
        Shared(Some(Arc::clone(definitions) as Arc<dyn Any + Send + Sync>))
    }

    fn torques(&self, pairs: &[Pair]) -> Vec<f32> {
        if !self.colliders.has_resistance {
            return Vec::new();
        }
        let held = &self.solver.surfaces.held;
        let of = |pair: &Pair| {
            let found = held.binary_search_by_key(&pair.colliders, |held| held.colliders);
            found.map_or(Vector::ZERO, |at| held[at].torque).0
        };
        pairs.iter().flat_map(of).collect()
    }

    /// Loads a state ([`World::restore`]).
    pub(crate) fn load_state(&mut self, from: &Checkpoint) -> Result<(), CheckpointError> {
        let slots = [&self.bodies.slots, &self.colliders.slots];
        let same = slots.map(|slots| slots.generations()) == [&from.slots[0][..], &from.slots[1]];
        let definitions = from.definitions.0.clone().and_then(|of| of.downcast().ok());
        let here = match (definitions, self.definitions.get()) {
            (Some(of), Some(own)) if Arc::ptr_eq(&of, own) => None,
            (of, _) => of,
        };
        let before = here.map(|of: Arc<Definitions<G, L, A>>| {
            let bodies = std::mem::replace(&mut self.bodies, of.bodies.clone());
            let colliders = std::mem::replace(&mut self.colliders, of.colliders.clone());
            let joints = std::mem::replace(&mut self.solver.joints, of.joints.clone());
            let definitions = std::mem::replace(&mut self.definitions, OnceLock::from(of));
            (bodies, colliders, joints, definitions)
        });
        let contacts = self.check(from).and_then(|()| match before {
            None if !same => Err(CheckpointError::OtherBodies),
            _ => self.contacts_of(from),
        });
        let (pairs, [cache, sleeping]) = match (contacts, before) {
            (Ok(contacts), _) => contacts,
            (Err(error), None) => return Err(error),
            (Err(error), Some((bodies, colliders, joints, definitions))) => {
                (self.bodies, self.colliders, self.solver.joints) = (bodies, colliders, joints);
                self.definitions = definitions;
                return Err(error);
            }
        };
        self.contacts.pairs = pairs;
        self.solver.joints.load(&from.joints);
        for slot in 0..self.solver.joints.records.len() as u32 {
            self.solver.joints.pair(slot, |body| self.bodies.is_static(body));
        }
        for pair in &mut self.contacts.pairs {
            if self.solver.joints.separates(pair.bodies) {
                pair.separate();
            }
        }
        self.hold_torques(from);
        self.contacts.cache = cache;
        self.contacts.last_reuse = from.last_reuse;
        let placed = from.placed.clone();
        self.sleep = Sleep::resumed(from.still.clone(), from.groups.clone(), placed, sleeping);
        self.sleep.last_gravity = take(&mut from.gravity.iter().copied());
        let there = |collider: usize| self.colliders.slots.is_taken(collider);
        let boxes = from.boxes.chunks_exact(2 * L).enumerate();
        self.broad_phase = BroadPhase::with_boxes(boxes.map(|(collider, corners)| {
            let mut corners = corners.iter().copied();
            let (min, max) = (take(&mut corners), take(&mut corners));
            there(collider).then_some(Bounds { min, max })
        }));
        self.solver.certifier.jam_schedule = from.jam_schedule;
        self.solver.certifier.worst_of_sweeps = from.worst_of_sweeps;
        self.solver.certifier.island_solver.memory = from.memory;
        self.restore_bodies(from);
        self.solver.lanes.forget();
        self.colliders.update_poses(&self.bodies);
        Ok(())
    }

    /// Loads the torques of the pairs that are there.
    fn hold_torques(&mut self, from: &Checkpoint) {
        self.solver.surfaces.held.clear();
        let torques = from.torques.chunks_exact(A.max(1)).zip(&self.contacts.pairs);
        self.solver.surfaces.held.extend(torques.map(|(numbers, pair)| HeldTorque {
            colliders: pair.colliders,
            torque: take(&mut numbers.iter().copied()),
        }));
    }

    fn restore_bodies(&mut self, from: &Checkpoint) {
        // Calls before the restore concern the next step no more.
        self.colliders.mesh_motions.clear();
        self.bodies.led_energy = [0.0; 2];
        for (body, numbers) in from.poses.chunks_exact(pose_numbers(L)).enumerate() {
            let pose = G::read(numbers);
            self.bodies.poses[body] = pose;
            self.bodies.frames[body] = G::frame(&pose);
        }
        let bodies = &mut self.bodies;
        for slot in 0..bodies.held.len() {
            if bodies.can_be_moved(slot) {
                bodies.set_held(slot, from.held.binary_search(&(slot as u32)).is_ok());
            }
        }
        fill(&from.position_remainders, &mut bodies.position_remainders);
        let mut numbers = from.spins.iter().copied();
        for turn in &mut bodies.spin_states {
            *turn = SpinState { remainder: take(&mut numbers), ..SpinState::default() };
        }
        fill_velocities(&from.velocities, &mut bodies.velocities);
        fill_velocities(&from.contact_gains, &mut bodies.contact_gains);
        let mut numbers = from.balances.iter().copied();
        for balance in &mut bodies.balances {
            let sinking = Velocity { linear: take(&mut numbers), angular: take(&mut numbers) };
            let Vector([since]) = take(&mut numbers);
            *balance = Balance { sinking, since };
        }
        bodies.forces.resize(bodies.poses.len(), Velocity::ZERO);
        fill_velocities(&from.forces, &mut bodies.forces);
        bodies.moved_since_rebuild.clone_from(&from.moved_since_rebuild);
        // The path length of bodies that have rotated is stored as infinite.
        for (turned, moved_since_rebuild) in
            bodies.turned.iter_mut().zip(&bodies.moved_since_rebuild)
        {
            *turned = moved_since_rebuild.is_infinite();
        }
        let mut numbers = from.since_search.iter().copied();
        for since_search in &mut bodies.since_search {
            let (linear, Vector([turned])) = (take(&mut numbers), take(&mut numbers));
            *since_search = SearchMotion { linear, turned };
        }
        let mut numbers = from.masses.iter().copied();
        for mass in &mut bodies.inverse_masses {
            let [linear] = take(&mut numbers).0;
            let angular = SymmetricMatrix(from_fn(|_| take(&mut numbers)));
            *mass = InverseMass { linear, angular };
        }
    }

    /// Checks that array sizes match this world and that numbers are finite.
    fn check(&self, from: &Checkpoint) -> Result<(), CheckpointError> {
        let (bodies, shapes) = (self.len(), self.colliders.body.len());
        let resist = self.colliders.has_resistance;
        let manifolds = from.pairs.iter().map(|[_, _, count]| *count as usize).sum();
        let points: usize = from.manifolds.iter().map(|[_, count]| *count as usize).sum();
        for (what, expected, found) in [
            ("poses", bodies * pose_numbers(L), from.poses.len()),
            ("position_remainders", bodies * L, from.position_remainders.len()),
            ("spins", bodies * A, from.spins.len()),
            ("velocities", bodies * (L + A), from.velocities.len()),
            ("contact gains", bodies * (L + A), from.contact_gains.len()),
            ("balances", bodies * (L + A + 1), from.balances.len()),
            ("forces", bodies * (L + A), from.forces.len()),
            ("masses", bodies * (1 + A * A), from.masses.len()),
            ("distances moved", bodies, from.moved_since_rebuild.len()),
            ("motions since the search", bodies * (L + 1), from.since_search.len()),
            ("boxes", shapes * 2 * L, from.boxes.len()),
            ("clearances", from.pairs.len(), from.clearances.len()),
            ("torques", if resist { from.pairs.len() * A } else { 0 }, from.torques.len()),
            ("manifolds", manifolds, from.manifolds.len()),
            ("frames", from.manifolds.len() * manifold_numbers(L), from.frames.len()),
            ("points", points * point_numbers(L), from.points.len()),
            ("features", points, from.features.len()),
            ("rest times", bodies, from.still.len()),
            ("groups", bodies, from.groups.len()),
            ("pairs asleep", from.pairs.len(), from.asleep.len()),
            ("gravity", L, from.gravity.len()),
        ] {
            if expected != found {
                return Err(CheckpointError::OtherWorld { what, expected, found });
            }
        }
        self.check_joints(&from.joints)?;
        let slots = from.placed.iter().chain(&from.held);
        if slots.into_iter().any(|&body| body as usize >= bodies) {
            return Err(CheckpointError::OtherBodies);
        }
        check_finite(from)
    }

    fn check_joints(&self, from: &SavedJoints) -> Result<(), CheckpointError> {
        if !self.solver.joints.fits(from) {
            return Err(CheckpointError::OtherJoints);
        }
        match from.numbers.iter().all(|number| number.is_finite()) {
            true => Ok(()),
            false => Err(CheckpointError::NotFinite("joints")),
        }
    }

    /// Returns the pairs of a checkpoint whose sizes have been checked, and the manifolds of the
    /// awake pairs and of the sleeping ones.
    fn contacts_of(
        &self,
        from: &Checkpoint,
    ) -> Result<(Vec<Pair>, [ManifoldCache<L>; 2]), CheckpointError> {
        let shapes = self.colliders.body.len() as u32;
        let (mut pairs, mut caches): (Vec<Pair>, [_; 2]) = (Vec::new(), Default::default());
        let mut manifolds =
            from.manifolds.iter().zip(from.frames.chunks_exact(manifold_numbers(L)));
        let mut points = from.points.chunks_exact(point_numbers(L)).zip(&from.features);
        let states = from.clearances.iter().zip(&from.asleep);
        for (&[a, b, count], (&clearance, &is_sleeping)) in from.pairs.iter().zip(states) {
            let cache: &mut ManifoldCache<L> = &mut caches[usize::from(is_sleeping)];
            let sorted = pairs.last().is_none_or(|last| last.colliders < [a, b]);
            let pair = (sorted && a < b && b < shapes)
                .then(|| self.colliders.pair(&self.bodies, [a, b]))
                .flatten()
                .ok_or(CheckpointError::OtherPair([a, b]))?;
            let first = cache.manifolds.len() as u32;
            let pair = Pair { first, count, clearance, is_sleeping, ..pair };
            for (&[part, count], frames) in manifolds.by_ref().take(count as usize) {
                if count as usize > MAX_POINTS {
                    return Err(CheckpointError::OtherPair([a, b]));
                }
                let first = cache.points.len();
                let own = points.by_ref().take(count as usize);
                let own = own.map(|(numbers, feature)| point(numbers, *feature));
                own.for_each(|(point, cached)| {
                    cache.points.push(point);
                    cache.impulses.push(cached);
                });
                let reach = cache::reach(&cache.points[first..]);
                let found = manifold_from(&pair, [part, first as u32, count], reach, frames);
                cache.manifolds.push(found);
                cache.reuse.push(Reuse::New);
            }
            pairs.push(pair);
        }
        Ok((pairs, caches))
    }
}

/// Returns the clearance of a pair as far as a step depends on it. It may be infinite or negative.
fn saved_clearance(pair: &Pair) -> f32 {
    match pair {
        _ if pair.is_separated() => 0.0,
        _ if pair.count > 0 => pair.clearance.max(0.0),
        _ => pair.clearance,
    }
}

/// Returns the path length of a body since the last rebuild, or infinity if it has rotated.
fn moved_since_rebuild((moved_since_rebuild, turned): (&f32, &bool)) -> f32 {
    if *turned { f32::INFINITY } else { *moved_since_rebuild }
}

/// Number of numbers of a manifold: two normals and a vector, position and axes of a frame, and
/// four numbers for the surfaces.
const fn manifold_numbers(dimension: usize) -> usize {
    (4 + dimension) * dimension + 4
}

fn flat_manifold<const L: usize>(
    manifold: &CachedManifold<L>,
) -> impl Iterator<Item = f32> + use<L> {
    let Frame { position, axes } = manifold.found_at;
    let vectors = [manifold.normal, manifold.center_offset, manifold.local_normal, position];
    let vectors = vectors.into_iter().chain(axes);
    let Curvature { radii, normal } = manifold.surfaces;
    vectors.flat_map(|vector| vector.0).chain(radii).chain(normal.shares())
}

fn manifold_from<const L: usize>(
    pair: &Pair,
    [part, first, count]: [u32; 3],
    reach: f32,
    numbers: &[f32],
) -> CachedManifold<L> {
    let mut numbers = numbers.iter().copied();
    let normal = take(&mut numbers);
    let [center_offset, local_normal, position] = from_fn(|_| take(&mut numbers));
    let axes = from_fn(|_| take(&mut numbers));
    let [radii, shares]: [Vector<f32, 2>; 2] = from_fn(|_| take(&mut numbers));
    CachedManifold {
        bodies: pair.bodies,
        friction: pair.friction,
        restitution: pair.restitution,
        part,
        surfaces: Curvature { radii: radii.0, normal: NormalCarrier::of(shares.0) },
        first,
        count,
        normal,
        impulse_normal: normal,
        center_offset,
        local_normal,
        undecided: false,
        found_at: Frame { position, axes },
        reach,
    }
}

/// Number of numbers of a point: five vectors.
const fn point_numbers(dimension: usize) -> usize {
    5 * dimension
}

fn flat_point<const L: usize>(
    (point, cached): (&CachedPoint<L>, &CachedImpulse<L>),
) -> impl Iterator<Item = f32> + use<L> {
    let vectors = [point.on_a, point.on_b, point.push_point, cached.impulse, cached.gap];
    vectors.into_iter().flat_map(|vector| vector.0)
}

fn point<const L: usize>(numbers: &[f32], feature: u64) -> (CachedPoint<L>, CachedImpulse<L>) {
    let mut numbers = numbers.iter().copied();
    let [on_a, on_b, push_point] = from_fn(|_| take(&mut numbers));
    let cached = CachedImpulse { impulse: take(&mut numbers), gap: take(&mut numbers) };
    (CachedPoint { on_a, on_b, push_point, feature }, cached)
}

/// Checks that the numbers of a checkpoint are finite.
fn check_finite(from: &Checkpoint) -> Result<(), CheckpointError> {
    for (what, numbers) in [
        ("poses", &from.poses),
        ("position_remainders", &from.position_remainders),
        ("spins", &from.spins),
        ("velocities", &from.velocities),
        ("contact gains", &from.contact_gains),
        ("balances", &from.balances),
        ("forces", &from.forces),
        ("masses", &from.masses),
        ("motions since the search", &from.since_search),
        ("boxes", &from.boxes),
        ("clearances", &from.clearances),
        ("torques", &from.torques),
        ("frames", &from.frames),
        ("points", &from.points),
        ("rest times", &from.still),
        ("gravity", &from.gravity),
    ] {
        if numbers.iter().any(|number| !number.is_finite()) {
            return Err(CheckpointError::NotFinite(what));
        }
    }
    Ok(())
}

/// Takes the next numbers as a vector.
fn take<const N: usize>(numbers: &mut impl Iterator<Item = f32>) -> Vector<f32, N> {
    Vector(from_fn(|_| numbers.next().unwrap_or(0.0)))
}

fn flat_mass<const L: usize, const A: usize>(
    mass: &InverseMass<f32, L, A>,
) -> impl Iterator<Item = f32> + use<L, A> {
    [mass.linear].into_iter().chain(mass.angular.0.into_iter().flat_map(|row| row.0))
}

fn flat_since_search<const L: usize>(
    since_search: &SearchMotion<L>,
) -> impl Iterator<Item = f32> + use<L> {
    since_search.linear.0.into_iter().chain([since_search.turned])
}

fn flat<const N: usize>(vectors: &[Vector<f32, N>]) -> Vec<f32> {
    vectors.iter().flat_map(|vector| vector.0).collect()
}

fn fill<const N: usize>(numbers: &[f32], vectors: &mut [Vector<f32, N>]) {
    let mut numbers = numbers.iter().copied();
    vectors.iter_mut().for_each(|vector| *vector = take(&mut numbers));
}

fn flat_velocities<const L: usize, const A: usize>(of: &[Velocity<f32, L, A>]) -> Vec<f32> {
    of.iter().flat_map(flat_velocity).collect()
}

fn flat_velocity<const L: usize, const A: usize>(
    of: &Velocity<f32, L, A>,
) -> impl Iterator<Item = f32> + use<L, A> {
    of.linear.0.into_iter().chain(of.angular.0)
}

fn flat_balance<const L: usize, const A: usize>(
    of: &Balance<L, A>,
) -> impl Iterator<Item = f32> + use<L, A> {
    flat_velocity(&of.sinking).chain([of.since])
}

fn fill_velocities<const L: usize, const A: usize>(
    numbers: &[f32],
    velocities: &mut [Velocity<f32, L, A>],
) {
    let mut numbers = numbers.iter().copied();
    for velocity in velocities {
        *velocity = Velocity { linear: take(&mut numbers), angular: take(&mut numbers) };
    }
}
