//! [`Ledger`]: the energy balance of a step, item by item.
//!
//! A substep changes the velocities v to v' by the impulses p of contacts, gravity and forces.
//! Since M (v' - v) is their sum, the kinetic energy changes by
//!
//! ```text
//! T(v') - T(v) = sum over p of  p . J (v + v') / 2
//! ```
//!
//! Each impulse does work on the mean of the velocities before and after the substep, and the items
//! add up exactly. Friction that opposes slip loses energy in this balance, whatever happens within
//! the substep. A body at rest has no entries, although gravity and contacts act on it.
//!
//! An impact does work on the mean of the velocities just before and after it, which differ by c.
//! Gravity and forces act before it, and do work on (v + v' - c) / 2. Contacts and friction act
//! after it, and do work on (v + v' + c) / 2. The sum is still exact.
//!
//! Precession and the change of M by rotation count as integration. So does the difference between
//! the work of gravity and the change of the potential energy.

use drystone_solver::{
    Axis, Contact, InverseMass, Manifold, Mass, SurfaceEffects, System, Vector, Velocity,
};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

use crate::bodies::{Bodies, damped};
use crate::geometry::Geometry;

/// Energy balance of a step. Work that adds energy is positive. \[J\]
///
/// Up to rounding, kinetic + potential = forces + damping + driven + impacts + contacts +
/// friction + repair + relaxed + joints + drives + integration. Gravity is part of the left side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Ledger {
    /// Change of the kinetic energy.
    pub kinetic: f64,
    /// Change of the potential energy.
    pub potential: f64,
    /// Work of gravity: minus the change of the potential energy, up to errors of integration.
    pub gravity: f64,
    /// Work of applied forces and torques.
    pub forces: f64,
    /// Work of damping; never positive.
    pub damping: f64,
    /// Work done through contacts and joints by bodies that these cannot move, and by surface
    /// velocities; and the work that moves held bodies ([`World::hold`](crate::World::hold)), whose
    /// energy counts like that of the others.
    pub driven: f64,
    /// Work of impacts with restitution. It is counted at the arms of the end of the substep: where
    /// bodies rotate, it may be positive by a few percent, with the opposite in `integration`.
    pub impacts: f64,
    /// Work of the other normal impulses.
    pub contacts: f64,
    /// Work of friction and rolling resistance; positive only if sweeps have not converged.
    pub friction: f64,
    /// Overlap repair: the velocity that it adds, and the height by which it lifts bodies.
    pub repair: f64,
    /// Work of the relaxing sweep, which removes that velocity again; negative.
    pub relaxed: f64,
    /// Work of the locks, limits and friction of joints.
    pub joints: f64,
    /// Work of the motors and springs of joints.
    pub drives: f64,
    /// Error of time integration. In free fall it follows -h/2 p . g with the momentum p and the
    /// substep h, so it does not grow with time.
    pub integration: f64,
}

impl<const L: usize, const A: usize> JointRow<L, A> {
    /// Returns its bodies and the wrenches by which it acts on them. \[N s, N m s\]
    pub(crate) fn pulls(&self) -> impl Iterator<Item = (u32, Velocity<f64, L, A>)> {
        let Axis { jacobian, impulse, .. } = self.axis;
        self.bodies.into_iter().zip(jacobian.map(|of| of * impulse))
    }
}

impl Ledger {
    /// Returns the items with their names, in order.
    pub fn items(&self) -> [(&'static str, f64); 14] {
        [
            ("kinetic", self.kinetic),
            ("potential", self.potential),
            ("gravity", self.gravity),
            ("forces", self.forces),
            ("damping", self.damping),
            ("driven", self.driven),
            ("impacts", self.impacts),
            ("contacts", self.contacts),
            ("friction", self.friction),
            ("repair", self.repair),
            ("relaxed", self.relaxed),
            ("joints", self.joints),
            ("drives", self.drives),
            ("integration", self.integration),
        ]
    }

    /// Returns the work of all contacts without that of driven bodies: impacts, normal impulses,
    /// friction and repair. Contacts are springs: they may return energy that they took in an
    /// earlier step. Any energy beyond that is an error. \[J\]
    pub fn by_contacts(&self) -> f64 {
        self.impacts + self.contacts + self.friction + self.repair + self.relaxed
    }

    /// Returns the energy that contacts added in this step, or 0 if they removed energy. \[J\]
    pub fn created(&self) -> f64 {
        self.by_contacts().max(0.0)
    }

    /// Returns the change of energy that no item explains: the rounding error. \[J\]
    pub fn unexplained(&self) -> f64 {
        let by_joints = self.joints + self.drives;
        let applied = self.forces + self.damping + self.driven + by_joints;
        let explained = applied + self.by_contacts() + self.integration;
        self.kinetic + self.potential - explained
    }

    /// Adds the items of the following step.
    pub fn join(&mut self, other: &Self) {
        self.kinetic += other.kinetic;
        self.potential += other.potential;
        self.gravity += other.gravity;
        self.forces += other.forces;
        self.damping += other.damping;
        self.driven += other.driven;
        self.impacts += other.impacts;
        self.contacts += other.contacts;
        self.friction += other.friction;
        self.repair += other.repair;
        self.relaxed += other.relaxed;
        self.joints += other.joints;
        self.drives += other.drives;
        self.integration += other.integration;
    }
}

/// Velocities of all bodies.
type Velocities<T, const L: usize, const A: usize> = Vec<Velocity<T, L, A>>;

/// A row of a joint, with its impulse.
#[derive(Clone, Debug)]
pub(crate) struct JointRow<const L: usize, const A: usize> {
    pub(crate) bodies: [u32; 2],
    pub(crate) axis: Axis<f64, L, A>,
    /// True if it is a motor or a spring.
    pub(crate) is_drive: bool,
}

/// Data that a part of a step collects for its ledger.
#[derive(Default)]
pub(crate) struct LedgerBuilder<const L: usize, const A: usize> {
    ledger: Ledger,
    /// Kinetic and potential energy at the start of the part. \[J\]
    opening: [f64; 2],
    /// Kinetic energy when the part ends, before the poses follow. \[J\]
    unturned: f64,
    masses: Vec<Mass<L, A>>,
    /// M^-1 at the poses for which the masses were computed.
    inverses: Vec<InverseMass<f32, L, A>>,
    /// Velocities at the start of the substep.
    start: Velocities<f32, L, A>,
    /// Velocities before and after impacts; empty if nothing bounces.
    impact_velocities: [Velocities<f32, L, A>; 2],
    /// Velocities before and after the motion of the bodies.
    moved: [Velocities<f32, L, A>; 2],
    /// Mean velocities on which gravity and forces do work, and those on which contacts do.
    mean: [Velocities<f64, L, A>; 2],
    /// Manifolds before the motion of the bodies, and impulses of their contacts. \[N s\]
    manifolds: Vec<Manifold<f32, L>>,
    pressed: Vec<Vector<f32, L>>,
    /// Rows of the joints as the substep solved them, then as it relaxed them.
    joint_rows: Vec<JointRow<L, A>>,
    has_joints: bool,
    /// Impulses of impacts up to the previous substep. \[N s\]
    impacts: Vec<f32>,
}

impl<const L: usize, const A: usize> LedgerBuilder<L, A> {
    /// Begins the ledger of a part, before its first substep.
    pub(crate) fn open<G: Geometry<L, A>>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        gravity: Vector<f32, L>,
        system: &System<f32, L, A>,
    ) {
        self.ledger = Ledger::default();
        self.masses.clear();
        self.masses.extend((0..system.velocities.len()).map(|body| bodies.mass(body)));
        self.inverses.clone_from(&system.masses);
        self.opening = [self.kinetic_energy(&system.velocities), bodies.potential_energy(gravity)];
        self.impacts.clear();
        self.impacts.resize(system.contacts.len(), 0.0);
        self.impact_velocities.iter_mut().for_each(Vec::clear);
    }

    /// Records the velocities at the start of a substep.
    pub(crate) fn start(&mut self, velocities: &[Velocity<f32, L, A>]) {
        copy(velocities, &mut self.start);
    }

    /// Takes over M and M^-1 with which the substep starts, where they are not those that the last
    /// one left.
    pub(crate) fn update_mass(
        &mut self,
        body: usize,
        mass: Mass<L, A>,
        inverse: &InverseMass<f32, L, A>,
    ) {
        let velocity = self.start[body].cast();
        let before = std::mem::replace(&mut self.masses[body], mass);
        self.ledger.integration += 0.5 * (mass.squared(&velocity) - before.squared(&velocity));
        self.inverses[body] = *inverse;
    }

    /// Records the velocities before impacts (`when` = 0) or after them (1).
    pub(crate) fn record_impacts(&mut self, when: usize, velocities: &[Velocity<f32, L, A>]) {
        copy(velocities, &mut self.impact_velocities[when]);
    }

    /// Records velocities, impulses and manifolds after the solve, before the bodies move.
    pub(crate) fn record_solution(&mut self, system: &System<f32, L, A>) {
        copy(&system.velocities, &mut self.moved[0]);
        self.pressed.clear();
        self.pressed.extend(system.contacts.iter().map(|contact| contact.impulse));
        self.manifolds.clone_from(&system.manifolds);
    }

    /// Records the velocities after the bodies have moved.
    pub(crate) fn record_motion(&mut self, velocities: &[Velocity<f32, L, A>]) {
        copy(velocities, &mut self.moved[1]);
    }

    /// Adds the energy by which repair of joints has lifted bodies. \[J\]
    pub(crate) fn record_repair(&mut self, lifted: f64) {
        self.ledger.repair += lifted;
    }

    /// Records rows of joints, with the impulses that they have just given.
    pub(crate) fn record_joints(&mut self, rows: impl Iterator<Item = JointRow<L, A>>) {
        self.joint_rows.extend(rows);
    }

    /// Adds the work of the recorded rows of joints. What follows from the inertia with which a
    /// pulled body was solved counts as integration.
    fn joints(&mut self) {
        for JointRow { bodies, axis, is_drive, .. } in self.joint_rows.drain(..) {
            let [a, b] = bodies.map(|body| &self.mean[1][body as usize]);
            let work = axis.impulse * axis.velocity(a, b);
            *(if is_drive { &mut self.ledger.drives } else { &mut self.ledger.joints }) += work;
            // The work on a body that joints cannot move does not become energy of the body.
            let sides = [[a, &Velocity::ZERO], [&Velocity::ZERO, b]];
            for (body, [a, b]) in bodies.into_iter().zip(sides) {
                if self.masses[body as usize] == Mass::ZERO {
                    self.ledger.driven -= axis.impulse * axis.velocity(a, b);
                }
            }
        }
    }

    /// Adds a substep of length `h` \[s\], at its end. `system` has its impulses; `surfaces` has
    /// the surface effects of its manifolds, if any.
    pub(crate) fn end<G: Geometry<L, A>>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        gravity: Vector<f32, L>,
        (system, surfaces): (&System<f32, L, A>, &[SurfaceEffects<f32, L, A>]),
        h: f32,
    ) {
        self.take_means(&system.velocities);
        for body in 0..self.masses.len() {
            if self.masses[body] != Mass::ZERO {
                self.add_body(bodies, gravity, (system, body), h);
            }
        }
        self.has_joints |= !self.joint_rows.is_empty();
        self.joints();
        let h = f64::from(h);
        let mut surfaces = surfaces.iter();
        for (number, manifold) in system.manifolds.iter().enumerate() {
            self.ledger.integration -= self.lag(&self.manifolds[number], manifold, system);
            let surface = surfaces.next();
            let pulls = manifold.bodies.map(|body| {
                let at = body as usize;
                let moves = self.masses[at].linear > 0.0;
                if moves { bodies.gravity_on(at, gravity).cast() } else { Vector::ZERO }
            });
            let lift = h * manifold.normal().cast::<f64>().dot(pulls[0] - pulls[1]);
            for index in manifold.points() {
                self.contact(system, manifold, (index, surface), lift);
            }
            if let Some(surface) = surface {
                self.resist(system, manifold, surface);
            }
        }
    }

    /// Adds the work of forces, gravity and damping on a body in a substep, and what its rotation
    /// has left out.
    fn add_body<G: Geometry<L, A>>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        gravity: Vector<f32, L>,
        (system, body): (&System<f32, L, A>, usize),
        substep: f32,
    ) {
        let h = f64::from(substep);
        let [mean, after] = [&self.mean[0][body], &self.mean[1][body]];
        let mass = self.masses[body];
        let (push, inverse) = (bodies.force(body).cast::<f64>(), &self.inverses[body]);
        let pushed = Velocity {
            linear: push.linear * f64::from(inverse.linear),
            angular: inverse.angular.cast() * push.angular,
        };
        self.ledger.forces += h * mean.dot(&mass.momentum(&pushed));
        let pull = bodies.gravity_on(body, gravity).cast::<f64>();
        self.ledger.gravity += h * mass.linear * mean.linear.dot(pull);
        let change = Velocity {
            linear: pushed.linear.cast() + bodies.gravity_on(body, gravity),
            angular: pushed.angular.cast(),
        };
        let change = change * substep;
        if let Some(damping) = bodies.damping.get(body) {
            let lost = damped(*damping, &self.start[body], &change, substep);
            self.ledger.damping += mean.dot(&mass.momentum(&lost.cast()));
        }
        let turned = difference(&self.moved, body);
        self.ledger.integration += after.dot(&mass.momentum(&turned));
        if self.inverses[body] != system.masses[body] {
            // The body has rotated, so the relaxing sweep acts on another inertia than the
            // solve did.
            self.inverses[body] = system.masses[body];
            let own = bodies.mass(body);
            self.masses[body] = own;
            let end: Velocity<f64, L, A> = system.velocities[body].cast();
            let relaxed = end - self.moved[1][body].cast();
            let change = |of: &Velocity<f64, L, A>| own.momentum(of) - mass.momentum(of);
            self.ledger.integration += 0.5 * end.dot(&change(&end)) - after.dot(&change(&relaxed));
        }
    }

    /// Returns the work of impacts and of half of the impulses of a manifold that results from the
    /// change of J within the substep. \[J\]
    fn lag(
        &self,
        before: &Manifold<f32, L>,
        after: &Manifold<f32, L>,
        system: &System<f32, L, A>,
    ) -> f64 {
        if before.frame == after.frame {
            return 0.0;
        }
        let (mut wrench, mut impact_change) = (Velocity::ZERO, Velocity::ZERO);
        for index in after.points() {
            let contact: Contact<f64, L> = system.contacts[index].cast();
            contact.add_wrench(0..L, self.pressed[index].cast(), &mut wrench);
            let mut impact = Vector::ZERO;
            impact[0] = contact.impact - f64::from(self.impacts[index]);
            contact.add_wrench(0..1, impact, &mut impact_change);
        }
        let [then, now]: [Manifold<f64, L>; 2] = [before.cast(), after.cast()];
        let work = |wrench: &Velocity<f64, L, A>, [a, b]: [Velocity<f64, L, A>; 2]| {
            let [then, now] = [&then, &now].map(|of| of.frame.momenta(wrench));
            a.dot(&(now[0] - then[0])) - b.dot(&(now[1] - then[1]))
        };
        let bodies = after.bodies.map(|body| body as usize);
        let mut changed = 0.5 * work(&wrench, bodies.map(|body| self.mean[1][body]));
        if !self.impact_velocities[0].is_empty() {
            let mean = |body: usize| {
                (self.impact_velocities[0][body].cast::<f64>()
                    + self.impact_velocities[1][body].cast())
                    * 0.5
            };
            changed += work(&impact_change, bodies.map(mean));
        }
        changed
    }

    /// Computes the mean velocities of the substep.
    fn take_means(&mut self, end: &[Velocity<f32, L, A>]) {
        self.mean.iter_mut().for_each(Vec::clear);
        for (body, (start, end)) in self.start.iter().zip(end).enumerate() {
            let bounced = !self.impact_velocities[0].is_empty();
            let impact_change =
                if bounced { difference(&self.impact_velocities, body) } else { Velocity::ZERO };
            let sum = start.cast::<f64>() + end.cast();
            self.mean[0].push((sum - impact_change) * 0.5);
            self.mean[1].push((sum + impact_change) * 0.5);
        }
    }

    /// Adds the items of a contact. `lift` \[m/s\] times an impulse that the relaxing sweep removes
    /// is the potential energy which that impulse has added.
    fn contact(
        &mut self,
        system: &System<f32, L, A>,
        manifold: &Manifold<f32, L>,
        (index, surface): (usize, Option<&SurfaceEffects<f32, L, A>>),
        lift: f64,
    ) {
        let contact = &system.contacts[index];
        let [a, b] = manifold.bodies.map(|body| body as usize);
        let manifold: Manifold<f64, L> = manifold.cast();
        let (frame, anchors) = (manifold.frame.axes, manifold.frame.anchors(contact.offset.cast()));
        let gamma = contact.impulse.cast::<f64>();
        let relative = |of: [Velocity<f64, L, A>; 2]| of[0].at(anchors[0]) - of[1].at(anchors[1]);
        let u = relative([self.mean[1][a], self.mean[1][b]]);

        let mut push = frame[0] * gamma[0];
        self.ledger.contacts += gamma[0] * frame[0].dot(u);
        for i in 1..L {
            push += frame[i] * gamma[i];
            self.ledger.friction += gamma[i] * frame[i].dot(u);
        }
        if let Some(surface) = surface {
            // Friction does work on the slip relative to the belt. The rest of its work comes from
            // the belt.
            let belt = contact.relative_velocity(&surface.belt).cast::<f64>();
            let work: f64 = (1..L).map(|i| gamma[i] * belt[i]).sum();
            self.ledger.friction += work;
            self.ledger.driven -= work;
        }

        let taken = gamma[0] - f64::from(self.pressed[index][0]);
        if taken != 0.0 {
            let [before, after] = [&self.moved[1], &system.velocities]
                .map(|of| frame[0].dot(relative([of[a].cast(), of[b].cast()])));
            let relaxed = taken * 0.5 * (before + after);
            self.ledger.relaxed += relaxed;
            self.ledger.repair += taken * lift - relaxed;
            self.ledger.integration -= taken * lift;
        }

        let impact = f64::from(contact.impact - self.impacts[index]);
        if impact > 0.0 {
            self.impacts[index] = contact.impact;
            let [before, after] = [&self.impact_velocities[0], &self.impact_velocities[1]]
                .map(|of| frame[0].dot(relative([of[a].cast(), of[b].cast()])));
            push += frame[0] * impact;
            self.ledger.impacts += impact * 0.5 * (before + after);
        }

        self.ledger.driven += self.absorbed(system, a, anchors[0], push);
        self.ledger.driven += self.absorbed(system, b, anchors[1], -push);
    }

    /// Adds the items of the rolling resistance of a manifold.
    fn resist(
        &mut self,
        system: &System<f32, L, A>,
        manifold: &Manifold<f32, L>,
        surface: &SurfaceEffects<f32, L, A>,
    ) {
        let [a, b] = manifold.bodies.map(|body| body as usize);
        let torque = manifold.frame.turning_in_world(surface.torque).cast::<f64>();
        let turning = self.mean[1][a].angular - self.mean[1][b].angular;
        self.ledger.friction += torque.dot(turning);
        for (body, torque) in [(a, torque), (b, -torque)] {
            let (mass, mean) = (&self.masses[body], &self.mean[1][body]);
            let inverse: InverseMass<f64, L, A> = system.masses[body].cast();
            let kept = mass.angular * (inverse.angular * torque);
            self.ledger.driven += mean.angular.dot(kept) - torque.dot(mean.angular);
        }
    }

    /// Returns the part of an impulse's work on a body that does not become kinetic energy. It is
    /// not zero if the motion or rotation of the body is prescribed. \[J\]
    fn absorbed(
        &self,
        system: &System<f32, L, A>,
        body: usize,
        anchor: Vector<f64, L>,
        push: Vector<f64, L>,
    ) -> f64 {
        let (mass, mean) = (&self.masses[body], &self.mean[1][body]);
        // In rotated coordinates, the inertia of a body that is locked about some axis is singular.
        if mass.linear > 0.0 && mass.angular.inverse().is_some() {
            return 0.0;
        }
        let kept = if *mass == Mass::ZERO {
            Velocity::ZERO
        } else {
            let inverse: InverseMass<f64, L, A> = system.masses[body].cast();
            mass.momentum(&inverse.response(anchor, push))
        };
        // Negative: the body's drive supplies the work that the impulse does not add to the body's
        // energy.
        mean.dot(&kept) - push.dot(mean.at(anchor))
    }

    /// Records the kinetic energy after the last substep, before the poses are updated.
    pub(crate) fn stop(&mut self, velocities: &[Velocity<f32, L, A>]) {
        self.unturned = self.kinetic_energy(velocities);
    }

    /// Returns the ledger of the part, after the last substep, when the poses have been updated.
    pub(crate) fn close<G: Geometry<L, A>>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        gravity: Vector<f32, L>,
        velocities: &[Velocity<f32, L, A>],
    ) -> Ledger {
        for (body, mass) in self.masses.iter_mut().enumerate() {
            *mass = bodies.mass(body);
        }
        let [kinetic, potential] = self.opening;
        let turned = self.kinetic_energy(velocities);
        let ledger = &mut self.ledger;
        ledger.kinetic = turned - kinetic;
        ledger.potential = bodies.potential_energy(gravity) - potential;
        ledger.integration += ledger.gravity + ledger.potential + turned - self.unturned;
        if std::mem::take(&mut self.has_joints) {
            // Rotation in each substep, and the inertia with which pulled bodies were solved.
            ledger.integration += ledger.unexplained();
        }
        *ledger
    }

    /// Returns 1/2 v^T M v. \[J\]
    fn kinetic_energy(&self, velocities: &[Velocity<f32, L, A>]) -> f64 {
        let squares = self.masses.iter().zip(velocities).map(|(mass, v)| mass.squared(&v.cast()));
        0.5 * squares.sum::<f64>()
    }
}

/// Returns the velocity of a body in the second array minus that in the first.
fn difference<const L: usize, const A: usize>(
    of: &[Velocities<f32, L, A>; 2],
    body: usize,
) -> Velocity<f64, L, A> {
    of[1][body].cast::<f64>() - of[0][body].cast()
}

fn copy<T: Clone>(from: &[T], to: &mut Vec<T>) {
    to.clear();
    to.extend_from_slice(from);
}
