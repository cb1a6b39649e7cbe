//! [`World`]: bodies, their contacts, and the step that moves both on.

mod checkpoint;

pub use checkpoint::{Checkpoint, CheckpointError};

use drystone_solver::restitution::{self, Blow, Collisions};
use drystone_solver::wide::Wide;
use drystone_solver::{InverseMass, Repair, System, Vector, Velocity};

use crate::bodies::{Bodies, Body, BodyId, Inertia};
use crate::broad_phase::BroadPhase;
use crate::cache::{Pair, Records};
use crate::certifier::Certifier;
use crate::geometry::{Bounds, Frame, Geometry, MassProperties};
use crate::ledger::Books;
use crate::narrow_phase::{Surroundings, Travel, Worker, manifolds};
use crate::report::{Clock, Measure, Stage, StepReport};
use crate::saved::SavedSystem;
use crate::scene::{Combine, Filter, Material, Motion};
use crate::settings::StepSettings;
use crate::{motion, rows};

/// Rounds of collisions within a substep: a blow passes through this many contacts against the
/// order of the contacts.
const COLLISION_ROUNDS: usize = 32;

/// Sweeps over what collides at once.
const COLLISION_SWEEPS: usize = 40;

/// Bodies and their contacts, in the dimension of `G`.
pub struct World<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// How steps are taken.
    pub settings: StepSettings,
    /// Acceleration of free fall. \[m/s^2\]
    pub gravity: Vector<f32, L>,
    bodies: Bodies<G, L, A>,
    colliders: Colliders<G, L, A>,
    broad_phase: BroadPhase<L>,
    pairs: Vec<Pair>,
    records: Records<L>,
    old_records: Records<L>,
    /// Velocities and inverse masses of the bodies live here, where the solver works on them.
    system: System<f32, L, A>,
    /// The contacts of `system`, sixteen side by side, for the sweeps.
    wide: Wide<L, A>,
    certifier: Certifier<L, A>,
    blow: Blow<L, A>,
    books: Books<L, A>,
    /// What each body has moved since the step began.
    displacements: Vec<Velocity<f32, L, A>>,
    travel: Vec<Travel<L>>,
    workers: Vec<Worker<G, L, A>>,
    pool: Option<rayon::ThreadPool>,
    /// Whether steps save their last contact system, and that of the last step.
    saving: bool,
    saved: Option<SavedSystem<L, A>>,
}

/// The shapes of all bodies, one array per property.
struct Colliders<G: Geometry<L, A>, const L: usize, const A: usize> {
    body: Vec<u32>,
    shapes: Vec<G::Shape>,
    /// Smallest extent of a solid; unlimited for what has no volume. \[m\]
    thickness: Vec<f32>,
    /// In the frame of the body's center of mass.
    local: Vec<G::Pose>,
    /// Turned with the body, seen from its center of mass.
    poses: Vec<G::Pose>,
    material: Vec<Material>,
    filter: Vec<Filter>,
    removed: Vec<bool>,
}

/// How the substeps of a part of a step are taken.
struct Plan {
    /// Length of a substep. \[s\]
    h: f32,
    substeps: u32,
    /// Whether each is solved to the tolerance.
    solving: bool,
    /// The one that is certified with all residuals.
    examined: Option<u32>,
    ledger: bool,
    repair: Repair<f32>,
    /// How blows are resolved, where anything bounces.
    collisions: Option<Collisions<f32>>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// An empty world without gravity, on one thread.
    pub fn new(settings: StepSettings) -> Self {
        Self {
            settings,
            gravity: Vector::ZERO,
            bodies: Bodies::new(),
            colliders: Colliders {
                body: Vec::new(),
                shapes: Vec::new(),
                thickness: Vec::new(),
                local: Vec::new(),
                poses: Vec::new(),
                material: Vec::new(),
                filter: Vec::new(),
                removed: Vec::new(),
            },
            broad_phase: BroadPhase::new(),
            pairs: Vec::new(),
            records: Records::default(),
            old_records: Records::default(),
            system: System::new(),
            wide: Wide::new(),
            certifier: Certifier::default(),
            blow: Blow::default(),
            books: Books::default(),
            displacements: Vec::new(),
            travel: Vec::new(),
            workers: Vec::new(),
            pool: None,
            saving: false,
            saved: None,
        }
    }

    /// Uses `threads` threads; results do not depend on it. Keeps to one where no more can be had.
    pub fn set_threads(&mut self, threads: usize) {
        self.pool = (threads > 1)
            .then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok())
            .flatten();
    }

    /// Adds a body. Mass and inertia come from its shapes unless it brings its own; a dynamic
    /// body without either cannot be moved.
    pub fn add(&mut self, body: Body<G, L, A>) -> BodyId {
        let inertia = match (body.motion, body.inertia) {
            (Motion::Dynamic, Some(inertia)) => inertia,
            (Motion::Dynamic, None) => {
                let solid = body.colliders.iter().fold(MassProperties::ZERO, |sum, collider| {
                    let own = G::mass(&collider.shape, collider.density);
                    sum.joined(&own.placed(&G::frame(&collider.pose)))
                });
                Inertia::of(&solid)
            }
            _ => Inertia::FIXED,
        };
        let to_center = G::pose(-inertia.center, &[]);
        let pose = G::compose(&body.pose, &G::pose(inertia.center, &[]));
        let index = self.allocate();
        let reach = body.colliders.iter().map(|collider| {
            let bounds = G::bounds(&collider.shape, &G::compose(&to_center, &collider.pose));
            let far: [f32; L] = std::array::from_fn(|i| bounds.max[i].max(-bounds.min[i]));
            Vector(far).length()
        });
        let reach = reach.fold(0.0, f32::max);
        let bodies = &mut self.bodies;
        bodies.motion[index] = Some(body.motion);
        bodies.poses[index] = pose;
        bodies.frames[index] = G::frame(&pose);
        bodies.remainders[index] = Vector::ZERO;
        bodies.gyroscopic[index] = body.motion == Motion::Dynamic && inertia.gyroscopic();
        bodies.inertia[index] = inertia;
        bodies.gravity_factor[index] = body.gravity_factor;
        bodies.reach[index] = reach;
        bodies.forces[index] = Velocity::ZERO;
        let moves = body.motion != Motion::Static;
        self.system.velocities[index] = if moves { body.velocity } else { Velocity::ZERO };
        self.update_mass(index);
        for collider in body.colliders {
            let colliders = &mut self.colliders;
            let id = colliders.body.len() as u32;
            let local = G::compose(&to_center, &collider.pose);
            let (turned, bounds) =
                place::<G, L, A>(&collider.shape, &local, &pose, &self.bodies.frames[index]);
            self.broad_phase.update(id, &bounds);
            colliders.body.push(index as u32);
            colliders.thickness.push(thickness::<G, L, A>(&collider.shape));
            colliders.shapes.push(collider.shape);
            colliders.local.push(local);
            colliders.poses.push(turned);
            colliders.material.push(collider.material);
            colliders.filter.push(collider.filter);
            colliders.removed.push(false);
        }
        BodyId { index: index as u32, generation: self.bodies.generation[index] }
    }

    /// A slot for a new body: the lowest that is free.
    fn allocate(&mut self) -> usize {
        let bodies = &mut self.bodies;
        if let Some(index) = bodies.motion.iter().position(Option::is_none) {
            bodies.generation[index] += 1;
            return index;
        }
        let origin = G::pose(Vector::ZERO, &[]);
        bodies.motion.push(None);
        bodies.generation.push(0);
        bodies.poses.push(origin);
        bodies.frames.push(G::frame(&origin));
        bodies.remainders.push(Vector::ZERO);
        bodies.inertia.push(Inertia::FIXED);
        bodies.gyroscopic.push(false);
        bodies.turns.push(Vector::ZERO);
        bodies.gravity_factor.push(1.0);
        bodies.reach.push(0.0);
        bodies.forces.push(Velocity::ZERO);
        self.displacements.push(Velocity::ZERO);
        self.travel.push(Travel::default());
        self.system.add_body(Velocity::ZERO, InverseMass::FIXED) as usize
    }

    /// Removes a body; returns whether it was there.
    pub fn remove(&mut self, id: BodyId) -> bool {
        let Some(index) = self.index(id) else { return false };
        self.bodies.motion[index] = None;
        self.bodies.inertia[index] = Inertia::FIXED;
        self.system.velocities[index] = Velocity::ZERO;
        self.system.masses[index] = InverseMass::FIXED;
        for collider in 0..self.colliders.body.len() {
            if self.colliders.body[collider] == index as u32 && !self.colliders.removed[collider] {
                self.colliders.removed[collider] = true;
                self.broad_phase.remove(collider as u32);
            }
        }
        true
    }

    fn index(&self, id: BodyId) -> Option<usize> {
        let index = id.index();
        let there = self.bodies.motion.get(index).is_some_and(Option::is_some);
        (there && self.bodies.generation[index] == id.generation).then_some(index)
    }

    /// Slots for bodies, removed ones included: what indices run over.
    pub fn len(&self) -> usize {
        self.bodies.poses.len()
    }

    /// Whether the world never had a body.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Pose of a body's origin.
    pub fn pose(&self, id: BodyId) -> Option<G::Pose> {
        self.index(id).map(|index| self.bodies.origin(index))
    }

    /// Appends the poses of all slots, in order, as numbers ([`Geometry::write`]).
    pub fn write_poses(&self, out: &mut Vec<f32>) {
        for body in 0..self.len() {
            G::write(&self.bodies.origin(body), out);
        }
    }

    /// Velocity of a body's center of mass.
    pub fn velocity(&self, id: BodyId) -> Option<Velocity<f32, L, A>> {
        self.index(id).map(|index| self.system.velocities[index])
    }

    /// Sets the velocity of a dynamic or kinematic body.
    pub fn set_velocity(&mut self, id: BodyId, velocity: Velocity<f32, L, A>) {
        if let Some(index) = self.index(id)
            && self.bodies.motion[index] != Some(Motion::Static)
        {
            self.system.velocities[index] = velocity;
        }
    }

    /// Gives a kinematic body the velocity that takes it to `target` within `dt` \[s\].
    pub fn move_to(&mut self, id: BodyId, target: &G::Pose, dt: f32) {
        let Some(index) = self.index(id) else { return };
        let from = self.bodies.origin(index);
        let apart = G::frame(target).position - G::frame(&from).position;
        self.system.velocities[index] = Velocity {
            linear: apart * (1.0 / dt),
            angular: G::turn_between(&from, target) * (1.0 / dt),
        };
    }

    /// Adds a force \[N\] and torque \[N m\] that act through the next step.
    pub fn add_force(&mut self, id: BodyId, force: Velocity<f32, L, A>) {
        if let Some(index) = self.index(id) {
            self.bodies.forces[index] += force;
        }
    }

    /// The contact system of the last substep, as the solver left it.
    pub fn system(&self) -> &System<f32, L, A> {
        &self.system
    }

    /// Whether steps save the contact system of their last substep. By default they do not.
    pub fn save_systems(&mut self, saving: bool) {
        self.saving = saving;
        self.saved = None;
    }

    /// The contact system of the last substep as it was before it was solved, if that was asked for.
    pub fn saved(&self) -> Option<&SavedSystem<L, A>> {
        self.saved.as_ref()
    }

    /// Moves the world on by `dt` \[s\].
    pub fn step(&mut self, dt: f32) -> StepReport {
        let mut report = StepReport::default();
        let mut clock = Clock::start();
        let substeps = self.settings.substeps.max(1);
        self.find_pairs(dt);
        let parts = self.parts(dt).min(self.settings.searches.max(1));
        let substeps = substeps.div_ceil(parts);
        for part in 0..parts {
            if parts > 1 {
                self.find_pairs(dt / parts as f32);
                self.parts(dt / parts as f32);
            }
            clock.lap(&mut report, Stage::Pairs);
            let last = part + 1 == parts;
            self.part(dt / parts as f32, substeps, last, &mut clock, &mut report);
        }
        self.bodies.forces.fill(Velocity::ZERO);
        report.pairs = self.pairs.len();
        report.manifolds = self.system.manifolds.len();
        report.contacts = self.system.contacts.len();
        report
    }

    /// Into how many parts, each with its own contacts, a step is divided: a power of two, so that
    /// near bodies pass no more than `travel_per_search` of each other. Sets [`Travel::blow`].
    fn parts(&mut self, dt: f32) -> u32 {
        let limit = self.settings.travel_per_search;
        let fall = self.gravity.length() * dt * dt;
        let mut worst = 0.0f32;
        for pair in &self.pairs {
            let [a, b] = pair.bodies.map(|body| body as usize);
            let [one, other] = [self.travel[a], self.travel[b]];
            let apart = (one.linear - other.linear).length();
            self.travel[a].blow = one.blow.max(apart);
            self.travel[b].blow = other.blow.max(apart);
            let travel = apart + one.angular + other.angular + fall;
            worst = worst.max(travel / pair.thickness);
        }
        let parts = (worst / limit).ceil();
        if parts.is_finite() { (parts.clamp(1.0, 256.0) as u32).next_power_of_two() } else { 1 }
    }

    /// A part of a step, from the search for contacts to new poses.
    fn part(
        &mut self,
        dt: f32,
        substeps: u32,
        last: bool,
        clock: &mut Clock,
        report: &mut StepReport,
    ) {
        self.find_manifolds();
        clock.lap(report, Stage::Manifolds);
        rows::rows(&self.records, &self.bodies, dt, &mut self.system);
        let plan = self.plan(dt / substeps as f32, substeps, last);
        self.pack(&plan);
        clock.lap(report, Stage::Rows);
        for substep in 0..substeps {
            self.substep(&plan, substep, clock, report);
        }
        self.arrive(&plan, clock, report);
    }

    fn plan(&self, h: f32, substeps: u32, last: bool) -> Plan {
        let settings = &self.settings;
        let mut manifolds = self.system.manifolds.iter();
        Plan {
            h,
            substeps,
            solving: settings.tolerance > 0.0,
            examined: (last && settings.certify).then_some(substeps - 1),
            ledger: settings.ledger,
            repair: settings.repair_in(h),
            collisions: manifolds.any(|manifold| manifold.restitution > 0.0).then_some(
                Collisions {
                    law: settings.impact_law,
                    dt: h,
                    threshold: settings.restitution_threshold,
                    rounds: COLLISION_ROUNDS,
                    sweeps: COLLISION_SWEEPS,
                },
            ),
        }
    }

    /// Makes the contacts of a part ready for its substeps.
    fn pack(&mut self, plan: &Plan) {
        self.displacements.fill(Velocity::ZERO);
        let (system, wide, certifier) = (&mut self.system, &mut self.wide, &mut self.certifier);
        let certifying = plan.solving || plan.examined.is_some();
        if certifying {
            certifier.find_islands(system);
        }
        if plan.solving {
            let weight = |body| self.bodies.weight(body, self.gravity);
            certifier.stiffen(system, weight, &self.settings, plan.h);
        }
        wide.pack(system, self.settings.softness);
        if certifying {
            certifier.start(system, wide);
        }
        if plan.ledger {
            self.books.open(&self.bodies, self.gravity, system);
        }
    }

    /// Forces, blows, contacts, motion, and contacts again as rigid ones.
    fn substep(&mut self, plan: &Plan, substep: u32, clock: &mut Clock, report: &mut StepReport) {
        let (system, wide, certifier) = (&mut self.system, &mut self.wide, &mut self.certifier);
        let (bodies, moved, books) = (&mut self.bodies, &mut self.displacements, &mut self.books);
        if plan.ledger {
            books.start(&system.velocities);
        }
        motion::predict(bodies, &system.masses, self.gravity, plan.h, &mut system.velocities);
        clock.lap(report, Stage::Predict);
        if let Some(collisions) = &plan.collisions {
            if plan.ledger {
                books.strike(0, &system.velocities);
            }
            system.set_targets(moved, &plan.repair);
            report.collisions += restitution::collide(system, moved, collisions, &mut self.blow);
            wide.take_impacts(system);
            if plan.ledger {
                books.strike(1, &system.velocities);
            }
            clock.lap(report, Stage::Bounce);
        }
        let examined = plan.examined == Some(substep);
        if plan.solving || examined {
            certifier.prospective.clone_from(&system.velocities);
        }
        if self.saving && substep + 1 == plan.substeps {
            let positions = bodies.frames.iter().map(|frame| frame.position).collect();
            self.saved = Some(SavedSystem { system: system.clone(), positions, substep: plan.h });
        }
        wide.start(&mut system.velocities, moved, &plan.repair);
        if self.saving
            && let Some(saved) = &mut self.saved
        {
            // Targets are set by now, and no sweep has touched the impulses yet.
            wide.unpack(&mut saved.system);
        }
        clock.lap(report, Stage::WarmStart);
        if plan.solving {
            let outcome = certifier.refine(system, wide, &self.settings, examined);
            // Forward and back.
            report.sweeps += 2 * outcome.iterations;
            report.join(&outcome, clock);
        } else {
            for _ in 0..self.settings.iterations {
                wide.sweep_normals(&mut system.velocities);
            }
            report.sweeps += self.settings.iterations as usize;
            clock.lap(report, Stage::Solve);
            if examined {
                let outcome = certifier.examine(system, wide);
                report.join(&outcome, clock);
            }
        }
        if plan.ledger {
            wide.unpack(system);
            books.depart(system);
        }
        motion::advance(bodies, plan.h, &mut system.velocities, moved);
        clock.lap(report, Stage::Advance);
        if plan.ledger {
            books.arrive(&system.velocities);
        }
        wide.relax(&mut system.velocities);
        if plan.ledger {
            wide.unpack(system);
            books.end(bodies, self.gravity, system, plan.h);
        }
        clock.lap(report, Stage::Relax);
        report.sweeps += 1;
    }

    /// Gives impulses and poses back at the end of a part.
    fn arrive(&mut self, plan: &Plan, clock: &mut Clock, report: &mut StepReport) {
        self.wide.unpack(&mut self.system);
        if plan.examined.is_some() {
            let sinking = report.certified.map_or(0.0, |of| of.residuals[1]);
            report.jams = self.certifier.jams(&self.system, sinking);
            clock.lap(report, Stage::Certify);
        }
        motion::arrive(&mut self.bodies, &self.displacements);
        if plan.ledger {
            let ledger = self.books.close(&self.bodies, self.gravity, &self.system.velocities);
            report.energy.get_or_insert_default().join(&ledger);
        }
        for body in 0..self.len() {
            self.update_mass(body);
        }
        clock.lap(report, Stage::Advance);
        let hold = self.settings.hold;
        rows::remember(&self.system, &self.displacements, hold, &mut self.records);
        clock.lap(report, Stage::Remember);
    }

    /// M^-1 of a body at its present pose.
    fn update_mass(&mut self, body: usize) {
        if self.bodies.is_dynamic(body) {
            let inertia = &self.bodies.inertia[body];
            self.system.masses[body] = InverseMass {
                linear: inertia.inverse_mass(),
                angular: self.bodies.frames[body].tensor(inertia.inverse_moments),
            };
        } else {
            self.system.masses[body] = InverseMass::FIXED;
        }
    }

    /// Pairs of shapes whose boxes, enlarged by where they can get to in `dt`, overlap.
    fn find_pairs(&mut self, dt: f32) {
        let reach = self.settings.prediction_distance * 0.5;
        for body in 0..self.len() {
            let velocity = &self.system.velocities[body];
            self.travel[body] = Travel {
                linear: velocity.linear * dt,
                angular: velocity.angular.length() * self.bodies.reach[body] * dt,
                blow: 0.0,
            };
        }
        let colliders = &mut self.colliders;
        for id in 0..colliders.body.len() {
            let body = colliders.body[id] as usize;
            if colliders.removed[id] || self.bodies.motion[body] == Some(Motion::Static) {
                continue;
            }
            let (pose, frame) = (&self.bodies.poses[body], &self.bodies.frames[body]);
            let (turned, mut bounds) =
                place::<G, L, A>(&colliders.shapes[id], &colliders.local[id], pose, frame);
            colliders.poses[id] = turned;
            for i in 0..L {
                let ahead = self.travel[body].linear[i];
                bounds.min[i] += ahead.min(0.0) - reach;
                bounds.max[i] += ahead.max(0.0) + reach;
            }
            self.broad_phase.update(id as u32, &bounds);
        }
        let Some(found) = self.broad_phase.new_pairs() else { return };
        let old = self.pairs.len();
        for &pair in found {
            let known = self.pairs[..old].binary_search_by_key(&pair, |known| known.colliders);
            if known.is_err()
                && let Some(pair) = new_pair(colliders, &self.bodies, pair)
            {
                self.pairs.push(pair);
            }
        }
        let broad_phase = &self.broad_phase;
        self.pairs.retain(|pair| broad_phase.near(pair.colliders));
        self.pairs.sort_unstable_by_key(|pair| pair.colliders);
    }

    fn find_manifolds(&mut self) {
        std::mem::swap(&mut self.records, &mut self.old_records);
        let around = Surroundings::<G, L, A> {
            shapes: &self.colliders.shapes,
            poses: &self.colliders.poses,
            bodies: &self.bodies,
            travel: &self.travel,
            prediction_distance: self.settings.prediction_distance,
            reuse_distance: self.settings.reuse_distance,
        };
        let (pairs, old) = (&mut self.pairs, &self.old_records);
        let (workers, records) = (&mut self.workers, &mut self.records);
        match &self.pool {
            None => manifolds(&around, pairs, old, workers, false, records),
            Some(pool) => pool.install(|| manifolds(&around, pairs, old, workers, true, records)),
        }
    }

    /// Energies, deepest overlap and residual as the last step left them.
    pub fn measure(&self) -> Measure {
        let mut out = Measure { finite: true, ..Measure::default() };
        for body in 0..self.len() {
            let frame = &self.bodies.frames[body];
            let velocity = &self.system.velocities[body];
            let sums = [frame.position.dot(frame.position), velocity.linear.dot(velocity.linear)];
            out.finite &= sums.iter().all(|x| x.is_finite())
                && velocity.angular.dot(velocity.angular).is_finite();
            if !self.bodies.is_dynamic(body) {
                continue;
            }
            out.fastest = out.fastest.max(f64::from(velocity.linear.length()));
            out.kinetic_energy += 0.5 * self.bodies.mass(body).squared(&velocity.cast());
        }
        out.potential_energy = self.bodies.potential_energy(self.gravity);
        for manifold in &self.system.manifolds {
            let [a, b] = manifold.bodies.map(|body| &self.displacements[body as usize]);
            let moved = manifold.twist(a, b);
            for contact in &self.system.contacts[manifold.points()] {
                let gap = contact.gap[0] + contact.normal_velocity(&moved);
                out.deepest_penetration = out.deepest_penetration.max(f64::from(-gap));
            }
        }
        out.residual = self.system.residual(true);
        out
    }
}

/// The pose of a shape as seen from its body's center of mass, turned with the body, and its box in
/// the world.
fn place<G: Geometry<L, A>, const L: usize, const A: usize>(
    shape: &G::Shape,
    local: &G::Pose,
    body: &G::Pose,
    frame: &Frame<L>,
) -> (G::Pose, Bounds<L>) {
    let turned = G::compose(&G::advance(body, -frame.position, Vector::ZERO), local);
    let Bounds { min, max } = G::bounds(shape, &turned);
    (turned, Bounds { min: min + frame.position, max: max + frame.position })
}

/// The smallest extent of a solid; unlimited for what has no volume. \[m\]
fn thickness<G: Geometry<L, A>, const L: usize, const A: usize>(shape: &G::Shape) -> f32 {
    if G::mass(shape, 1.0).mass <= 0.0 {
        return f32::INFINITY;
    }
    let bounds = G::bounds(shape, &G::pose(Vector::ZERO, &[]));
    (bounds.max - bounds.min).0.into_iter().fold(f32::INFINITY, f32::min)
}

fn new_pair<G: Geometry<L, A>, const L: usize, const A: usize>(
    colliders: &Colliders<G, L, A>,
    bodies: &Bodies<G, L, A>,
    pair: [u32; 2],
) -> Option<Pair> {
    let [a, b] = pair.map(|id| id as usize);
    let owners = [colliders.body[a], colliders.body[b]];
    let moved = owners.iter().any(|&body| bodies.is_dynamic(body as usize));
    if owners[0] == owners[1] || !moved || !colliders.filter[a].collides(&colliders.filter[b]) {
        return None;
    }
    let (p, q) = (&colliders.material[a], &colliders.material[b]);
    let friction = Combine::of(p.friction_combine, q.friction_combine, p.friction, q.friction);
    let bounce =
        Combine::of(p.restitution_combine, q.restitution_combine, p.restitution, q.restitution);
    Some(Pair {
        colliders: pair,
        bodies: owners,
        friction: friction as f32,
        restitution: bounce as f32,
        thickness: colliders.thickness[a].min(colliders.thickness[b]),
        first: 0,
        count: 0,
    })
}
