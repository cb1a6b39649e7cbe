//! Restitution: target velocities from the velocities before the step, and collisions by a law of
//! impact.
//!
//! The laws differ where several contacts collide at once. They share the choice of closing
//! contacts, the problem gamma >= 0, w >= 0, gamma . w = 0, the limit on the energy, and the time
//! of impact within the step.
//!
//! - Newton: the notes' (1), one collision after the other.
//! - Poisson: C. Glocker, F. Pfeiffer, "Multiple impacts with friction in rigid multibody systems",
//!   1995.
//! - Reflections: B. Smith, D. Kaufman, E. Vouga, R. Tamstorf, E. Grinspun, "Reflections on
//!   simultaneous impact", 2012.

use std::ops::Range;

use crate::island::Islands;
use crate::part::SubSystem;
use crate::solution::Goal;
use crate::{InverseMass, Mobility, Real, Scalar, System, Vector, Velocity, newton, pgs};

/// Sets t_i = max(t_i, -c_r v_i^-) where a contact approached faster than `threshold` \[m/s\]
/// before the step. This is the notes' restitution hypothesis, combined with overlap repair by the
/// maximum.
///
/// `before` are the velocities before the step's forces. With the prospective ones every resting
/// contact would bounce off gravity. An open contact bounces only if its approach closes the gap
/// within the step (its t_i is -gap / h); otherwise it keeps its target.
pub fn set_targets<T: Real, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    before: &[Velocity<T, L, A>],
    threshold: T,
) {
    for manifold in &system.manifolds {
        let [a, b] = manifold.bodies.map(|body| &before[body as usize]);
        let twist = manifold.frame.twist(a, b);
        for contact in &mut system.contacts[manifold.points()] {
            let approach = -contact.normal_velocity(&twist);
            let repair = contact.target[0];
            let bounce = repair.max(manifold.restitution * approach);
            contact.target[0] = (approach - threshold.max(-repair)).choose(bounce, repair);
        }
    }
}

/// Law of impact for contacts that collide at once. u is the relative velocity along the normals, e
/// the restitution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImpactLaw {
    /// Isolated collisions, the notes' (1): manifold by manifold in order, each from the velocities
    /// that the previous one left, with u+ >= -e u-. The result depends on the order.
    Newton,
    /// Contacts that press are compressed together until none approaches. Then each returns e times
    /// its compression impulse, and none may approach again. A row of touching balls that is hit
    /// moves on as one, except the first ball.
    Poisson,
    /// Approaching contacts are reflected together, repeatedly, until none approaches. If the
    /// impulses lambda just stop them, each gets (1 + e) lambda: a blend of the inelastic response
    /// and its mirror image. Preserves symmetry, passes an impact through a row of touching balls,
    /// and conserves energy for e = 1. Smith et al. blend once after all reflections. Here each
    /// reflection is blended, so that the loss of a contact does not depend on distant contacts.
    #[default]
    Reflections,
}

/// Parameters of [`collide`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpactSettings<T> {
    /// Law of impact for contacts that collide at once.
    pub law: ImpactLaw,
    /// Step h that contains the impacts. \[s\]
    pub dt: T,
    /// Approach speed below which manifolds do not bounce. \[m/s\]
    pub threshold: T,
    /// Largest number of rounds, each of which searches for approaching contacts. \[1\]
    pub rounds: usize,
    /// Largest number of sweeps over the contacts of an impact. The next round continues from what
    /// they leave. \[1\]
    pub sweeps: usize,
}

/// Resolves collisions until no contact that closes in this step approaches faster than the
/// threshold, or until the rounds are used up. Returns the number of colliding manifolds, each time
/// counted.
///
/// Only moving walls add kinetic energy. An impact changes it by 1/2 gamma . (u- + u+); if that is
/// positive for an island, its gamma is scaled down.
///
/// Manifolds without restitution are left to the sweeps unless an impact drives their bodies
/// together. A body that lies on the floor is pressed into it at the speed of the impact, so the
/// floor contact takes part in the impact. The impulses are stored in
/// [`Contact::impact`](crate::Contact::impact).
///
/// A light body between a heavy one and the floor is hit again and again, each time more weakly.
/// Contacts that still approach after all rounds are solved together, for u+ >= -e u-. Contacts
/// closed by these impulses only stop.
///
/// The time of impact tau is the time within the step of length h at which the point lands, on the
/// parabola of its motion. Forces give the bodies the velocity `forced` in the step, and the
/// fraction 1 - tau / h of it after the impact. The velocity that bounces is u - (1 - tau / h) J
/// forced.
///
/// The step then moves the bodies for all of h with the velocity after the impact. Therefore
/// `displacements`, which start at -h/2 `forced`, change by -tau times the change of velocity. A
/// ball in free fall then follows both parabolas exactly.
pub fn collide<T: Scalar, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    displacements: &mut [Velocity<T, L, A>],
    forced: &[Velocity<T, L, A>],
    how: &ImpactSettings<T>,
    blow: &mut ImpactSolver<L, A>,
) -> usize {
    let all = 0..system.manifolds.len();
    let mut collisions = 0;
    blow.forced.clear();
    blow.forced.extend(forced.iter().map(|own| own.cast()));
    blow.struck.clear();
    blow.struck.resize(system.velocities.len(), NEVER);
    for _ in 0..how.rounds {
        let before = collisions;
        match how.law {
            ImpactLaw::Newton => {
                for index in all.clone() {
                    collisions += blow.fall(system, displacements, how, index..index + 1);
                }
            }
            ImpactLaw::Poisson | ImpactLaw::Reflections => {
                collisions += blow.fall(system, displacements, how, all.clone());
            }
        }
        if collisions == before {
            return collisions;
        }
    }
    collisions + blow.finish(system, displacements, how, all)
}

/// Time of impact of a body without an impact. \[1\]
const NEVER: f64 = -1.0;

/// Largest number of manifolds for Newton's method; more of them are solved by sweeps.
const MANY: usize = 64;

/// Largest number of rounds in which [`ImpactSolver::finish`] adds manifolds.
const DRAWN: usize = 8;

/// Softness of practically rigid contacts. \[1\]
const STIFF: f64 = 1e-9;

/// Largest number of Newton steps.
const BUDGET: usize = 20;

/// Error of a solved contact, as a fraction of the fastest approach; larger if the scalar type of
/// the system is coarser. \[1\]
const ACCURACY: f64 = 1e-12;

/// Solver for contacts that collide at once: the buffers of [`collide`], kept between calls.
#[derive(Clone, Debug, Default)]
pub struct ImpactSolver<const L: usize, const A: usize> {
    part: SubSystem<L, A>,
    /// Time of impact of each manifold, as a fraction of the step: that of its earliest point, but
    /// not before the last impact on its bodies. \[1\]
    times: Vec<f64>,
    /// Time of the last impact on each body of the whole system, as a fraction of the step. \[1\]
    struck: Vec<f64>,
    /// True if each contact closes.
    closing: Vec<bool>,
    /// Velocity that forces give each body of the whole system in the step.
    forced: Vec<Velocity<f64, L, A>>,
    /// Relative velocity that forces give each contact after its impact; 0 if it does not
    /// close. \[m/s\]
    regained: Vec<f64>,
    /// Poisson's law: impulse of each contact from compression and restitution, which further
    /// expansion only adds to. \[N s\]
    held: Vec<f64>,
    sweeps: usize,
    /// Error allowed for a contact, as a fraction of the fastest approach. \[1\]
    accuracy: f64,
    /// Fastest approach. \[m/s\]
    approach: f64,
    islands: Islands,
    /// gamma . u- and gamma^T A gamma of each island. \[J\]
    work: Vec<[f64; 2]>,
}

impl<const L: usize, const A: usize> ImpactSolver<L, A> {
    /// Returns whether the last [`collide`] has changed the velocity of a body.
    pub fn is_struck(&self, body: usize) -> bool {
        self.struck.get(body).is_some_and(|&time| time != NEVER)
    }

    /// Resolves one impact among these manifolds; returns how many took part.
    fn fall<T: Scalar>(
        &mut self,
        system: &mut System<T, L, A>,
        displacements: &mut [Velocity<T, L, A>],
        how: &ImpactSettings<T>,
        among: Range<usize>,
    ) -> usize {
        self.clear(system, how);
        if !self.gather(system, how.threshold, among.clone(), false) {
            return 0;
        }
        match how.law {
            ImpactLaw::Newton => self.newton(),
            ImpactLaw::Poisson => self.poisson(system, how, among),
            ImpactLaw::Reflections => self.reflect(),
        }
        self.limit_energy();
        self.land(system, displacements, how.dt)
    }

    fn clear<T: Scalar>(&mut self, system: &System<T, L, A>, how: &ImpactSettings<T>) {
        self.part.clear(system);
        self.times.clear();
        self.closing.clear();
        self.regained.clear();
        self.approach = 0.0;
        self.sweeps = how.sweeps;
        self.accuracy = ACCURACY.max(8.0 * T::EPSILON);
    }

    /// Solves the contacts that still approach together, and those that this closes. Returns how
    /// many manifolds took part.
    fn finish<T: Scalar>(
        &mut self,
        system: &mut System<T, L, A>,
        displacements: &mut [Velocity<T, L, A>],
        how: &ImpactSettings<T>,
        among: Range<usize>,
    ) -> usize {
        self.clear(system, how);
        let mut known = 0;
        for round in 0..DRAWN {
            if !self.gather(system, how.threshold, among.clone(), round > 0) {
                break;
            }
            let manifolds = &self.part.system.manifolds;
            if round == 0 && manifolds.iter().all(|manifold| manifold.restitution >= 1.0) {
                // A sequence of elastic impacts ends, however long; the next substep continues it.
                return 0;
            }
            self.aim(known, |closes, open, u, restitution| {
                if !closes {
                    open
                } else if round == 0 {
                    -restitution * u
                } else {
                    0.0
                }
            });
            known = self.times.len();
            if known > MANY {
                self.solve();
            } else {
                self.solve_exactly();
            }
        }
        if known == 0 {
            return 0;
        }
        // One time for all: the large opposite impulses on a light body cancel only if their times
        // agree.
        let latest = self.times.iter().copied().fold(0.0, f64::max);
        self.times.fill(latest);
        let manifolds = &mut self.part.system.manifolds;
        let largest = manifolds.iter().map(|manifold| manifold.restitution).fold(0.0, f64::max);
        manifolds.iter_mut().for_each(|manifold| manifold.restitution = largest);
        self.limit_energy();
        self.land(system, displacements, how.dt)
    }

    /// Adds the closing manifolds that have restitution or a body with an impact; with `drawn`,
    /// also those that share a movable body with the part. Returns true if any was added.
    fn gather<T: Scalar>(
        &mut self,
        system: &System<T, L, A>,
        threshold: T,
        among: Range<usize>,
        drawn: bool,
    ) -> bool {
        let before = self.times.len();
        for index in among {
            let manifold = &system.manifolds[index];
            let masses = system.masses_of(manifold);
            if masses == [InverseMass::FIXED; 2] || self.part.holds(index) {
                continue;
            }
            let mut struck = NEVER;
            let mut here = false;
            for (body, mass) in manifold.bodies.into_iter().zip(&masses) {
                struck = struck.max(self.struck[body as usize]);
                here |= drawn && *mass != InverseMass::FIXED && self.part.has(body);
            }
            if manifold.restitution <= T::ZERO && struck == NEVER && !here {
                continue;
            }
            let [a, b] = manifold.bodies.map(|body| self.part.velocity(system, body));
            let twist = manifold.frame.twist(&a, &b);
            let (points, known) = (&system.contacts[manifold.points()], self.closing.len());
            let [a, b] = manifold.bodies.map(|body| &self.forced[body as usize]);
            let forced = manifold.cast::<f64>().frame.twist(a, b);
            // Fractions of the step.
            let mut time = 1.0f64;
            let mut fastest = 0.0f64;
            for contact in points {
                let u = contact.normal_velocity(&twist);
                let open = contact.unbiased_target();
                let closes = u < open;
                let gained = contact.cast::<f64>().normal_velocity(&forced);
                if closes {
                    let own = comes_down(open.to_f64(), u.to_f64(), gained);
                    time = time.min(own);
                    fastest = fastest.max((1.0 - own) * gained - u.to_f64());
                }
                self.closing.push(closes);
                self.regained.push(gained);
            }
            if fastest <= threshold.to_f64() {
                self.closing.truncate(known);
                self.regained.truncate(known);
                continue;
            }
            time = time.max(struck);
            for (gained, closes) in self.regained[known..].iter_mut().zip(&self.closing[known..]) {
                *gained *= if *closes { 1.0 - time } else { 0.0 };
            }
            self.part.add(system, index);
            make_rigid(&mut self.part.system);
            self.times.push(time);
            self.approach = self.approach.max(fastest);
        }
        self.times.len() > before
    }

    /// Applies Newton's law: u >= -e u- where a point closes. Other points of the manifold may
    /// close their gaps.
    fn newton(&mut self) {
        self.aim(0, |closes, open, u, restitution| if closes { -restitution * u } else { open });
        self.solve();
    }

    /// Applies Poisson's law: compression, which adds the manifolds that it closes until none
    /// approaches, then expansion.
    fn poisson<T: Scalar>(
        &mut self,
        whole: &System<T, L, A>,
        how: &ImpactSettings<T>,
        among: Range<usize>,
    ) {
        for _ in 0..how.rounds {
            self.aim(0, |closes, open, _, _| if closes { 0.0 } else { open });
            self.solve();
            if !self.gather(whole, how.threshold, among.clone(), true) {
                break;
            }
        }
        let system = &mut self.part.system;
        self.held.clear();
        for manifold in &system.manifolds {
            for contact in &mut system.contacts[manifold.points()] {
                self.held.push((1.0 + manifold.restitution) * contact.impulse[0]);
                contact.impulse[0] *= manifold.restitution;
            }
        }
        system.apply_impulses();
        // Expansion may close other contacts; their impulses add to the ones held.
        system.contacts.iter_mut().for_each(|contact| contact.impulse[0] = 0.0);
        self.solve();
        for (contact, held) in self.part.system.contacts.iter_mut().zip(&self.held) {
            contact.impulse[0] += held;
        }
    }

    /// Reflects by (1 + e) lambda, where lambda stops the closing points. Other points take no
    /// part.
    fn reflect(&mut self) {
        self.aim(0, |closes, _, _, _| if closes { 0.0 } else { f64::NEG_INFINITY });
        self.solve();
        // Scaling makes lambda . w = 0 exact however accurate the solution is, so e = 1 conserves
        // energy.
        self.scale(|work, quadratic| -work / quadratic);
        let system = &mut self.part.system;
        for manifold in &system.manifolds {
            for contact in &mut system.contacts[manifold.points()] {
                contact.impulse[0] *= 1.0 + manifold.restitution;
            }
        }
    }

    /// Sets the targets of manifold `from` and all later ones. The arguments of `target` are:
    /// whether the point closes, its target if it does not, u at the time of impact, and e. \[m/s\]
    fn aim(&mut self, from: usize, target: impl Fn(bool, f64, f64, f64) -> f64) {
        let system = &mut self.part.system;
        let first = system.manifolds[from].first as usize;
        let mut closing = self.closing[first..].iter().zip(&self.regained[first..]);
        for manifold in &system.manifolds[from..] {
            let twist = system.twist_of(manifold);
            for (contact, (&closes, &regained)) in
                system.contacts[manifold.points()].iter_mut().zip(&mut closing)
            {
                let u = contact.normal_velocity(&twist) - regained;
                let open = contact.unbiased_target();
                contact.target[0] = target(closes, open, u, manifold.restitution) + regained;
            }
        }
    }

    /// Solves gamma >= 0, w >= 0, gamma . w = 0 with w = u - t by sweeps, from the current
    /// impulses.
    fn solve(&mut self) {
        let system = &mut self.part.system;
        for _ in 0..self.sweeps {
            pgs::sweep_normals(system);
            if system.residual(false) <= self.accuracy * self.approach {
                break;
            }
        }
    }

    /// Solves the same problem by Newton's method, which mass ratios do not slow down.
    fn solve_exactly(&mut self) {
        let system = &mut self.part.system;
        system.velocities.clone_from(&self.part.start);
        system.prepare(STIFF);
        let goal = Goal { tolerance: self.accuracy * self.approach, budget: BUDGET };
        newton::solve(system, &goal);
    }

    /// Limits the scale s of the impulses so that the kinetic energy does not grow:
    ///
    /// Delta T = s gamma . u- + s^2 / 2 gamma^T A gamma <= 0
    /// for s <= -2 gamma . u- / gamma^T A gamma.
    fn limit_energy(&mut self) {
        self.scale(|work, quadratic| (-2.0 * work / quadratic).min(1.0));
    }

    /// Scales the impulses of each island by `factor` of gamma . u- and gamma^T A gamma.
    fn scale(&mut self, factor: impl Fn(f64, f64) -> f64) {
        let system = &mut self.part.system;
        self.islands.find(system);
        self.work.clear();
        self.work.resize(self.islands.count, [0.0; 2]);
        system.velocities.clone_from(&self.part.start);
        system.apply_impulses();
        let mut regained = self.regained.iter();
        for manifold in &system.manifolds {
            let [a, b] = manifold.bodies.map(|body| &self.part.start[body as usize]);
            let (start, end) = (manifold.frame.twist(a, b), system.twist_of(manifold));
            let work = &mut self.work[self.islands.of_pair(manifold.bodies) as usize];
            for (contact, regained) in system.contacts[manifold.points()].iter().zip(&mut regained)
            {
                let gamma = contact.impulse[0];
                let u = contact.normal_velocity(&start);
                work[0] += gamma * (u - regained);
                work[1] += gamma * (contact.normal_velocity(&end) - u);
            }
        }
        for manifold in &system.manifolds {
            let [work, quadratic] = self.work[self.islands.of_pair(manifold.bodies) as usize];
            let scale = if quadratic > 0.0 { factor(work, quadratic).max(0.0) } else { 0.0 };
            for contact in &mut system.contacts[manifold.points()] {
                contact.impulse[0] *= scale;
            }
        }
    }

    /// Applies the impulses to the whole system, and corrects the displacements for the times of
    /// impact. Returns how many manifolds have an impulse.
    fn land<T: Scalar>(
        &mut self,
        whole: &mut System<T, L, A>,
        displacements: &mut [Velocity<T, L, A>],
        dt: T,
    ) -> usize {
        let Self { part, times, struck, .. } = self;
        let mut taken = 0;
        for ((own, &index), &time) in part.system.manifolds.iter().zip(&part.manifolds).zip(&*times)
        {
            let manifold = whole.manifolds[index as usize];
            let before = whole.velocities_of(&manifold);
            let solved = &part.system.contacts[own.points()];
            let mut impulses = solved.iter().map(|contact| T::from_f64(contact.impulse[0]));
            whole.change(index as usize, |_, contact| {
                let mut blow = Vector::ZERO;
                blow[0] = impulses.next().unwrap_or(T::ZERO);
                contact.impact += blow[0];
                blow
            });
            let after = whole.velocities_of(&manifold);
            let is_struck = solved.iter().any(|contact| contact.impulse[0] > 0.0);
            for (body, mass) in manifold.bodies.into_iter().zip(whole.masses_of(&manifold)) {
                if is_struck && mass != InverseMass::FIXED {
                    let own = &mut struck[body as usize];
                    *own = own.max(time);
                }
            }
            let tau = T::from_f64(time) * dt;
            for (body, (before, after)) in
                manifold.bodies.into_iter().zip(before.into_iter().zip(after))
            {
                displacements[body as usize] += (before - after) * tau;
            }
            taken += usize::from(is_struck);
        }
        taken
    }
}

/// Returns the time at which a point lands, 0..1 of the step, by Newton's method. It is the root s
/// of
///
/// -open + s u + (1 - s)^2 a / 2,
///
/// where u is the velocity at the end of the step, and a the velocity that forces add in the step.
fn comes_down(open: f64, u: f64, gained: f64) -> f64 {
    let mut time = open / u;
    for _ in 0..3 {
        let left = 1.0 - time;
        let slope = u - gained * left;
        if slope >= 0.0 {
            break;
        }
        time -= (time * u - open + 0.5 * gained * left * left) / slope;
    }
    time.clamp(0.0, 1.0)
}

/// Makes the last manifold rigid, without friction and impulses.
fn make_rigid<const L: usize, const A: usize>(system: &mut System<f64, L, A>) {
    let Some(manifold) = system.manifolds.last_mut() else { return };
    manifold.friction = 0.0;
    let manifold = *manifold;
    let mobility = Mobility::of(&manifold.frame, &system.masses_of(&manifold));
    for contact in &mut system.contacts[manifold.points()] {
        contact.impulse = Vector::ZERO;
        contact.prepare(&manifold, &mobility, 0.0);
    }
}
