//! Bouncing: target velocities from the pre-step velocity, and collisions by a law of impact.
//!
//! The laws differ where several contacts collide at once. All share the rest: which contacts
//! close, the solution of gamma >= 0, w >= 0, gamma . w = 0, the limit on the energy, and when a blow
//! falls within the step.
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

/// t_i = max(t_i, -c_r v_i^-) where a contact approached faster than `threshold` \[m/s\] before the
/// step: the notes' restitution hypothesis, combined with overlap repair by maximum.
///
/// `before` are the velocities before the step's forces, not the prospective ones: otherwise
/// every resting contact would bounce off gravity. An open contact bounces only if that approach
/// closes it within the step (its t_i is -gap / h), else it keeps its target.
pub fn set_targets<T: Real, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    before: &[Velocity<T, L, A>],
    threshold: T,
) {
    for manifold in &system.manifolds {
        let [a, b] = manifold.bodies.map(|body| &before[body as usize]);
        let twist = manifold.twist(a, b);
        for contact in &mut system.contacts[manifold.points()] {
            let approach = -contact.normal_velocity(&twist);
            let repair = contact.target[0];
            let bounce = repair.max(manifold.restitution * approach);
            contact.target[0] = (approach - threshold.max(-repair)).choose(bounce, repair);
        }
    }
}

/// What contacts that collide at once do with each other. u is the relative velocity along the
/// normals, e the restitution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImpactLaw {
    /// The notes' isolated collisions (1), manifold by manifold in their order, each from the
    /// velocities that the last one left: u+ >= -e u-. Depends on that order.
    Newton,
    /// All contacts that press compress together until none approaches; then each gives back e
    /// times the impulse of its compression, and none may approach again. A row of touching balls
    /// moves on as one, less the first.
    Poisson,
    /// What approaches is reflected together: with lambda the impulses that just stop it, a contact
    /// gets (1 + e) lambda, a blend of the inelastic answer and its mirror image; and again, until
    /// nothing approaches. Keeps symmetry, lets a blow pass through a row of touching balls, and
    /// keeps the energy for e = 1. Smith et al. blend once at the end of all reflections; blended in
    /// each, what a contact loses does not depend on contacts far away.
    #[default]
    Reflections,
}

/// How collisions are resolved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpactSettings<T> {
    /// What contacts do that collide at once.
    pub law: ImpactLaw,
    /// The step h within which blows fall. \[s\]
    pub dt: T,
    /// Manifolds that approach more slowly do not bounce. \[m/s\]
    pub threshold: T,
    /// How often the contacts are looked at for what approaches. \[1\]
    pub rounds: usize,
    /// Sweeps over the contacts of a blow at most; what they leave open is left to the next round.
    /// \[1\]
    pub sweeps: usize,
}

/// Resolves collisions until none that closes in this step approaches faster than the threshold, or
/// the rounds have passed. Returns the number of manifolds that collided, each time counted.
///
/// Kinetic energy never grows, but for what moving walls bring: a blow changes it by
/// 1/2 gamma . (u- + u+), and gamma is scaled down, island by island, where that is positive.
///
/// Manifolds without restitution are left to the sweeps, unless a blow drives their bodies together: a body that lies
/// on the floor is squeezed as fast as it was struck, and takes the blow on. The impulses go into
/// [`Contact::impact`](crate::Contact::impact).
///
/// A light body between a heavy one and the floor is struck again and again, each time for less. What still approaches
/// after all rounds is solved together: u+ >= -e u- where it approaches, and what that drives together stops.
///
/// A blow falls at the time tau within the step of length h at which the point comes down, on the
/// parabola of its motion. Forces give the bodies `forced` velocity in the step, of which the part
/// 1 - tau / h after the blow: what bounces is u - (1 - tau / h) J forced. The step then moves the bodies
/// all of h with the velocity after it, and `displacements`, which start at -h/2 `forced`, are put back by
/// tau times the change of velocity. So a ball in free fall follows both parabolas exactly.
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

/// The time of a blow that did not fall. \[1\]
const NEVER: f64 = -1.0;

/// Manifolds that Newton's method is asked for: more of them get the sweeps.
const MANY: usize = 64;

/// Rounds of what is solved together and drives others together.
const DRAWN: usize = 8;

/// Softness of contacts that are as good as rigid. \[1\]
const STIFF: f64 = 1e-9;

/// Newton steps at most.
const BUDGET: usize = 20;

/// Part of the fastest approach by which a solved contact may be off, unless the numbers of the system
/// are coarser.
const ACCURACY: f64 = 1e-12;

/// Contacts that collide at once: what [`collide`] works in, kept so that the next call takes no
/// memory.
#[derive(Clone, Debug, Default)]
pub struct ImpactSolver<const L: usize, const A: usize> {
    part: SubSystem<L, A>,
    /// Of each manifold: gap / approach of the point that closes first; not before its bodies were struck. \[1\]
    times: Vec<f64>,
    /// Of each body of the whole system: the part of the step after which it was last struck. \[1\]
    struck: Vec<f64>,
    /// Of each contact: whether it closes.
    closing: Vec<bool>,
    /// Of each body of the whole system: the velocity that forces give it in the step.
    forced: Vec<Velocity<f64, L, A>>,
    /// Of each contact: the relative velocity that forces give it after the blow; 0 if it does not
    /// close. \[m/s\]
    regained: Vec<f64>,
    /// Of each contact: what it gets in any case. \[N s\]
    held: Vec<f64>,
    sweeps: usize,
    /// Part of the fastest approach by which a contact may be off. \[1\]
    accuracy: f64,
    /// The fastest approach. \[m/s\]
    approach: f64,
    islands: Islands,
    /// Of each island: gamma . u- and gamma^T A gamma. \[J\]
    work: Vec<[f64; 2]>,
}

impl<const L: usize, const A: usize> ImpactSolver<L, A> {
    /// One blow among these manifolds; returns how many took part.
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

    /// Solves together what still approaches, and what that drives together; returns how many manifolds took part.
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
                // Elastic blows end, be they many: the next substep goes on.
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
        // At one time: what a light body is pushed and pushed back is much more than what it moves.
        let latest = self.times.iter().copied().fold(0.0, f64::max);
        self.times.fill(latest);
        let manifolds = &mut self.part.system.manifolds;
        let largest = manifolds.iter().map(|manifold| manifold.restitution).fold(0.0, f64::max);
        manifolds.iter_mut().for_each(|manifold| manifold.restitution = largest);
        self.limit_energy();
        self.land(system, displacements, how.dt)
    }

    /// Takes in the manifolds that bounce, and those of struck bodies, which are not here yet; returns whether there
    /// are any. With `drawn` those of bodies that are here, too.
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
            let twist = manifold.twist(&a, &b);
            let (points, known) = (&system.contacts[manifold.points()], self.closing.len());
            let [a, b] = manifold.bodies.map(|body| &self.forced[body as usize]);
            let forced = manifold.cast::<f64>().twist(a, b);
            // In steps.
            let mut time = 1.0f64;
            let mut fastest = 0.0f64;
            for contact in points {
                let u = contact.normal_velocity(&twist);
                let open = contact.target[0].min(T::ZERO);
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

    /// u >= -e u- where a point closes; the others of the manifold may close their gaps.
    fn newton(&mut self) {
        self.aim(0, |closes, open, u, restitution| if closes { -restitution * u } else { open });
        self.solve();
    }

    /// Compression, which draws in what it pushes together, until nothing approaches; then expansion.
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
        // What expansion pushes may push back, on top of what is held.
        system.contacts.iter_mut().for_each(|contact| contact.impulse[0] = 0.0);
        self.solve();
        for (contact, held) in self.part.system.contacts.iter_mut().zip(&self.held) {
            contact.impulse[0] += held;
        }
    }

    /// (1 + e) lambda, lambda being what stops the points that close; the others take no part.
    fn reflect(&mut self) {
        self.aim(0, |closes, _, _, _| if closes { 0.0 } else { f64::NEG_INFINITY });
        self.solve();
        // lambda . w = 0 exactly, however well that is solved: so e = 1 keeps the energy.
        self.scale(|work, quadratic| -work / quadratic);
        let system = &mut self.part.system;
        for manifold in &system.manifolds {
            for contact in &mut system.contacts[manifold.points()] {
                contact.impulse[0] *= 1.0 + manifold.restitution;
            }
        }
    }

    /// Sets the targets from this manifold on, of whether a point closes, its open target, u at the time
    /// of the blow, and e. \[m/s\]
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
                let open = contact.target[0].min(0.0);
                contact.target[0] = target(closes, open, u, manifold.restitution) + regained;
            }
        }
    }

    /// gamma >= 0, w >= 0, gamma . w = 0 with w = u - t, from the impulses at hand.
    fn solve(&mut self) {
        let system = &mut self.part.system;
        for _ in 0..self.sweeps {
            pgs::sweep_normals(system);
            if system.residual(false) <= self.accuracy * self.approach {
                break;
            }
        }
    }

    /// The same by Newton's method, for which a heavy body on a light one is no harder than others.
    fn solve_exactly(&mut self) {
        let system = &mut self.part.system;
        system.velocities.clone_from(&self.part.start);
        system.prepare(STIFF);
        let goal = Goal { tolerance: self.accuracy * self.approach, budget: BUDGET };
        newton::solve(system, &goal);
    }

    /// Delta T = s gamma . u- + s^2 / 2 gamma^T A gamma <= 0 for s <= -2 gamma . u- / gamma^T A gamma.
    fn limit_energy(&mut self) {
        self.scale(|work, quadratic| (-2.0 * work / quadratic).min(1.0));
    }

    /// Scales the impulses of each island by what follows from gamma . u- and gamma^T A gamma.
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
            let (start, end) = (manifold.twist(a, b), system.twist_of(manifold));
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

    /// Gives the impulses to the whole system, and puts displacements back; returns how many
    /// manifolds took any.
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

/// When a point comes down, 0..1 of the step: the root s of -open + s u + (1 - s)^2 a / 2 by Newton's
/// method, with u the velocity at the end of the step and a what forces add to it in the step.
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

/// Lets the last manifold be rigid, without friction or impulses.
fn make_rigid<const L: usize, const A: usize>(system: &mut System<f64, L, A>) {
    let Some(manifold) = system.manifolds.last_mut() else { return };
    manifold.friction = 0.0;
    let manifold = *manifold;
    let mobility = Mobility::of(&manifold, &system.masses_of(&manifold));
    for contact in &mut system.contacts[manifold.points()] {
        contact.impulse = Vector::ZERO;
        contact.prepare(&manifold, &mobility, 0.0);
    }
}
