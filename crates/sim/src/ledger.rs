//! [`Ledger`]: where the energy of a step came from, and where it went.
//!
//! A substep takes the velocities v to v' by impulses p at contacts, gravity and forces. Since
//! M (v' - v) is their sum,
//!
//! ```text
//! T(v') - T(v) = sum over p of  p . J (v + v') / 2
//! ```
//!
//! so each impulse works on the mean of the velocities before and after the substep, and the items
//! add up exactly. Friction that opposes slip loses energy in these books whatever happens in
//! between, and what rests has no entries at all, although gravity pulls and contacts push.
//!
//! A collision works on the velocities just before and after it, c apart. Gravity and forces come
//! before it and work on (v + v' - c) / 2; contacts and friction come after it, and work on
//! (v + v' + c) / 2: the sum is still exact.
//!
//! Precession, and inertia that turns with its body, count as integration, as does the difference
//! between what gravity worked on and how far the bodies came down.

use drystone_solver::{
    Contact, InverseMass, Manifold, Mass, SurfaceEffects, System, Vector, Velocity,
};
use serde::{Deserialize, Serialize};

use crate::bodies::{Bodies, damped};
use crate::geometry::Geometry;

/// The energy of a step, item by item. Work that adds energy is positive. \[J\]
///
/// To rounding, kinetic + potential = forces + damping + driven + impacts + contacts + friction + repair +
/// relaxed + integration. Gravity is on the left already.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// Change of the kinetic energy.
    pub kinetic: f64,
    /// Change of the potential energy.
    pub potential: f64,
    /// Work of gravity: what the potential energy loses, but for errors of integration.
    pub gravity: f64,
    /// Work of the forces and torques that were asked for.
    pub forces: f64,
    /// Work of damping; never positive.
    pub damping: f64,
    /// Work of the bodies that nothing moves but themselves, and of surfaces that run, through their contacts.
    pub driven: f64,
    /// Work of collisions that bounce; never positive.
    pub impacts: f64,
    /// Work of normal impulses besides.
    pub contacts: f64,
    /// Work of friction and of resistance to rolling; positive only as far as sweeps have not converged.
    pub friction: f64,
    /// Overlap repair: the velocity it gives, and the height it lifts bodies by.
    pub repair: f64,
    /// What the relaxing sweep takes out of that velocity again; negative.
    pub relaxed: f64,
    /// What time stepping makes or loses. In free fall it follows -h/2 p . g, p the momentum and h the
    /// substep, and so does not grow with time.
    pub integration: f64,
}

impl Ledger {
    /// The names of the items and the items, in order.
    pub fn items(&self) -> [(&'static str, f64); 12] {
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
            ("integration", self.integration),
        ]
    }

    /// Work of all contacts, but for what driven bodies bring: collisions, normal impulses, friction
    /// and repair together. Contacts are springs: what they took they may give back in a later
    /// step; what they give beyond that is from nowhere. \[J\]
    pub fn by_contacts(&self) -> f64 {
        self.impacts + self.contacts + self.friction + self.repair + self.relaxed
    }

    /// What contacts gave in this step, if they gave more than they took. \[J\]
    pub fn created(&self) -> f64 {
        self.by_contacts().max(0.0)
    }

    /// The change of energy that no item explains: rounding. \[J\]
    pub fn unexplained(&self) -> f64 {
        let explained =
            self.forces + self.damping + self.driven + self.by_contacts() + self.integration;
        self.kinetic + self.potential - explained
    }

    /// Both, one after the other.
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
        self.integration += other.integration;
    }
}

/// The velocities of all bodies.
type Velocities<T, const L: usize, const A: usize> = Vec<Velocity<T, L, A>>;

/// What a part of a step notes down for its ledger.
#[derive(Default)]
pub(crate) struct LedgerBuilder<const L: usize, const A: usize> {
    ledger: Ledger,
    /// Kinetic and potential energy when the part began. \[J\]
    opening: [f64; 2],
    /// Kinetic energy when the part ends, before the poses follow. \[J\]
    unturned: f64,
    masses: Vec<Mass<L, A>>,
    /// M^-1 of where bodies were when the masses were taken.
    inverses: Vec<InverseMass<f32, L, A>>,
    /// At the start of the substep.
    start: Velocities<f32, L, A>,
    /// Before and after collisions; empty where nothing bounces.
    struck: [Velocities<f32, L, A>; 2],
    /// Before and after bodies have moved and turned.
    moved: [Velocities<f32, L, A>; 2],
    /// What gravity and forces work on, and what contacts do.
    mean: [Velocities<f64, L, A>; 2],
    /// The manifolds when bodies moved, and the impulses of their contacts. \[N s\]
    manifolds: Vec<Manifold<f32, L>>,
    pressed: Vec<Vector<f32, L>>,
    /// Impulses of collisions until the substep before. \[N s\]
    impacts: Vec<f32>,
}

impl<const L: usize, const A: usize> LedgerBuilder<L, A> {
    /// Before the first substep of a part.
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
        self.struck.iter_mut().for_each(Vec::clear);
    }

    /// At the start of a substep.
    pub(crate) fn start(&mut self, velocities: &[Velocity<f32, L, A>]) {
        copy(velocities, &mut self.start);
    }

    /// When the substep starts with another M and M^-1 of a body than the one before has left.
    pub(crate) fn turn(&mut self, body: usize, mass: Mass<L, A>, inverse: &InverseMass<f32, L, A>) {
        let velocity = self.start[body].cast();
        let before = std::mem::replace(&mut self.masses[body], mass);
        self.ledger.integration += 0.5 * (mass.squared(&velocity) - before.squared(&velocity));
        self.inverses[body] = *inverse;
    }

    /// Before collisions (0), or after them (1).
    pub(crate) fn strike(&mut self, when: usize, velocities: &[Velocity<f32, L, A>]) {
        copy(velocities, &mut self.struck[when]);
    }

    /// When bodies are about to move with the velocities that the sweeps found.
    pub(crate) fn depart(&mut self, system: &System<f32, L, A>) {
        copy(&system.velocities, &mut self.moved[0]);
        self.pressed.clear();
        self.pressed.extend(system.contacts.iter().map(|contact| contact.impulse));
        self.manifolds.clone_from(&system.manifolds);
    }

    /// When they have moved.
    pub(crate) fn arrive(&mut self, velocities: &[Velocity<f32, L, A>]) {
        copy(velocities, &mut self.moved[1]);
    }

    /// At the end of a substep of length `h` \[s\]; `system` holds its impulses, `surfaces` what those of its manifolds
    /// do, if any.
    pub(crate) fn end<G: Geometry<L, A>>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        gravity: Vector<f32, L>,
        (system, surfaces): (&System<f32, L, A>, &[SurfaceEffects<f32, L, A>]),
        h: f32,
    ) {
        let substep = h;
        let h = f64::from(h);
        self.take_means(&system.velocities);
        for (body, own) in self.masses.iter_mut().enumerate() {
            let [mean, after] = [&self.mean[0][body], &self.mean[1][body]];
            if *own == Mass::ZERO {
                continue;
            }
            let mass = *own;
            let (push, inverse) = (bodies.force(body).cast::<f64>(), &self.inverses[body]);
            let pushed = Velocity {
                linear: push.linear * f64::from(inverse.linear),
                angular: inverse.angular.cast() * push.angular,
            };
            self.ledger.forces += h * mean.dot(&mass.momentum(&pushed));
            let pull = bodies.pull(body, gravity).cast::<f64>();
            self.ledger.gravity += h * mass.linear * mean.linear.dot(pull);
            let change = Velocity {
                linear: pushed.linear.cast() + bodies.pull(body, gravity),
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
                // It has turned: what relaxes it, meets another inertia than what has pushed it.
                self.inverses[body] = system.masses[body];
                *own = bodies.mass(body);
                let end: Velocity<f64, L, A> = system.velocities[body].cast();
                let relaxed = end - self.moved[1][body].cast();
                let change = |of: &Velocity<f64, L, A>| own.momentum(of) - mass.momentum(of);
                self.ledger.integration +=
                    0.5 * end.dot(&change(&end)) - after.dot(&change(&relaxed));
            }
        }
        let mut surfaces = surfaces.iter();
        for (number, manifold) in system.manifolds.iter().enumerate() {
            self.ledger.integration -= self.lag(&self.manifolds[number], manifold, system);
            let surface = surfaces.next();
            let pulls = manifold.bodies.map(|body| {
                let at = body as usize;
                let moves = self.masses[at].linear > 0.0;
                if moves { bodies.pull(at, gravity).cast() } else { Vector::ZERO }
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

    /// Work of the blows and of the half of its impulses that a manifold gave before J was renewed, as far
    /// as J has changed since. \[J\]
    fn lag(
        &self,
        before: &Manifold<f32, L>,
        after: &Manifold<f32, L>,
        system: &System<f32, L, A>,
    ) -> f64 {
        if (before.frame, before.arms) == (after.frame, after.arms) {
            return 0.0;
        }
        let (mut wrench, mut blow) = (Velocity::ZERO, Velocity::ZERO);
        for index in after.points() {
            let contact: Contact<f64, L> = system.contacts[index].cast();
            contact.add_wrench(0..L, self.pressed[index].cast(), &mut wrench);
            let mut impact = Vector::ZERO;
            impact[0] = contact.impact - f64::from(self.impacts[index]);
            contact.add_wrench(0..1, impact, &mut blow);
        }
        let [then, now]: [Manifold<f64, L>; 2] = [before.cast(), after.cast()];
        let work = |wrench: &Velocity<f64, L, A>, [a, b]: [Velocity<f64, L, A>; 2]| {
            let [then, now] = [&then, &now].map(|of| of.momenta(wrench));
            a.dot(&(now[0] - then[0])) - b.dot(&(now[1] - then[1]))
        };
        let bodies = after.bodies.map(|body| body as usize);
        let mut changed = 0.5 * work(&wrench, bodies.map(|body| self.mean[1][body]));
        if !self.struck[0].is_empty() {
            let mean = |body: usize| {
                (self.struck[0][body].cast::<f64>() + self.struck[1][body].cast()) * 0.5
            };
            changed += work(&blow, bodies.map(mean));
        }
        changed
    }

    /// The means of the velocities at the start and the end of the substep.
    fn take_means(&mut self, end: &[Velocity<f32, L, A>]) {
        self.mean.iter_mut().for_each(Vec::clear);
        for (body, (start, end)) in self.start.iter().zip(end).enumerate() {
            let bounced = !self.struck[0].is_empty();
            let blow = if bounced { difference(&self.struck, body) } else { Velocity::ZERO };
            let sum = start.cast::<f64>() + end.cast();
            self.mean[0].push((sum - blow) * 0.5);
            self.mean[1].push((sum + blow) * 0.5);
        }
    }

    /// The items of a contact. `lift`: what an impulse that relaxing takes out, had left as potential
    /// energy. \[m/s\]
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
        let (frame, anchors) = (manifold.frame, manifold.anchors(contact.place.cast()));
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
            // Friction works on the slip against the belt; what it gives besides, the belt brings.
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
            let [before, after] = [&self.struck[0], &self.struck[1]]
                .map(|of| frame[0].dot(relative([of[a].cast(), of[b].cast()])));
            push += frame[0] * impact;
            self.ledger.impacts += impact * 0.5 * (before + after);
        }

        self.ledger.driven += self.absorbed(system, a, anchors[0], push);
        self.ledger.driven += self.absorbed(system, b, anchors[1], -push);
    }

    /// The items of the resistance to rolling of a manifold.
    fn resist(
        &mut self,
        system: &System<f32, L, A>,
        manifold: &Manifold<f32, L>,
        surface: &SurfaceEffects<f32, L, A>,
    ) {
        let [a, b] = manifold.bodies.map(|body| body as usize);
        let torque = manifold.turning_in_world(surface.torque).cast::<f64>();
        let turning = self.mean[1][a].angular - self.mean[1][b].angular;
        self.ledger.friction += torque.dot(turning);
        for (body, torque) in [(a, torque), (b, -torque)] {
            let (mass, mean) = (&self.masses[body], &self.mean[1][body]);
            let inverse: InverseMass<f64, L, A> = system.masses[body].cast();
            let kept = mass.angular * (inverse.angular * torque);
            self.ledger.driven += mean.angular.dot(kept) - torque.dot(mean.angular);
        }
    }

    /// The part of an impulse's work on a body that does not become kinetic energy, since the body,
    /// or its turning, moves as it will. \[J\]
    fn absorbed(
        &self,
        system: &System<f32, L, A>,
        body: usize,
        anchor: Vector<f64, L>,
        push: Vector<f64, L>,
    ) -> f64 {
        let (mass, mean) = (&self.masses[body], &self.mean[1][body]);
        // Turned, what is locked about some axis is singular.
        if mass.linear > 0.0 && mass.angular.inverse().is_some() {
            return 0.0;
        }
        let kept = if *mass == Mass::ZERO {
            Velocity::ZERO
        } else {
            let inverse: InverseMass<f64, L, A> = system.masses[body].cast();
            mass.momentum(&inverse.response(anchor, push))
        };
        // Minus: what the mover gives is what the impulse does not find in the books of the body.
        mean.dot(&kept) - push.dot(mean.at(anchor))
    }

    /// After the last substep, before the poses follow.
    pub(crate) fn stop(&mut self, velocities: &[Velocity<f32, L, A>]) {
        self.unturned = self.kinetic_energy(velocities);
    }

    /// When they have followed; returns the ledger of the part.
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
        *ledger
    }

    /// 1/2 v^T M v. \[J\]
    fn kinetic_energy(&self, velocities: &[Velocity<f32, L, A>]) -> f64 {
        let squares = self.masses.iter().zip(velocities).map(|(mass, v)| mass.squared(&v.cast()));
        0.5 * squares.sum::<f64>()
    }
}

/// What a body's velocity is in the second more than in the first.
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
