//! Jams: contacts and joints whose targets no velocities can reach.
//!
//! Examples are bodies wedged between converging walls or squeezed into too little room, and bars in
//! a loop that cannot close. Soft
//! contacts always have a response. Here it is the best one in the least-squares sense, but no
//! solution. The evidence is a self-stress: normal forces y >= 0 that nearly balance each other, on
//! contacts that should open. Rows of joints take part with forces of either sign, towards the
//! target t- if y > 0 and t+ if y < 0, as far as no bound limits their impulse: a motor need not
//! reach its target. Rows of rotation count as speeds at the radius sqrt(I / m).
//!
//! # The bound
//!
//! Let y be any such forces, v the current velocities and v' any velocities that reach all targets,
//! J v' >= t. Then y . J (v' - v) >= y . (t - J v), and by the Cauchy-Schwarz inequality
//!
//! |v' - v|_M >= y . (t - J v) / |J^T y|_M^-1.
//!
//! Balanced forces, J^T y = 0, mean that no v' exists (Farkas' lemma; `assembled::jam` has that
//! proof for matrices). With rounded numbers the bound says that the bodies would have to change
//! their velocities by more than anything here does.
//!
//! The best y is the least-squares residual of the targets, (t - J v)+ at the v that minimizes its
//! length, because there J^T y is 0. It equals the impulses of very stiff contacts without
//! friction, which [`newton`] finds. Friction does not jam: it does not act along normals.

use crate::island::Islands;
use crate::law::Interval;
use crate::part::SubSystem;
use crate::solution::Goal;
use crate::{Axis, Contact, InverseMass, Joint, Scalar, System, Vector, Velocity, newton};

/// A bound on the change of velocity beyond this multiple of the largest missing velocity is a
/// jam. \[1\]
const BEYOND: f64 = 1e3;
/// Such a multiple, for the current impulses, beyond which an island is examined closely. \[1\]
const SUSPECT: f64 = 3.0;
/// Softness of practically rigid contacts. \[1\]
const STIFF: f64 = 1e-7;
/// Largest number of Newton steps.
const BUDGET: usize = 40;
/// Largest number of manifolds and joints of an island that are examined closely, so that a search costs no
/// more than a step, whatever the size of the island. In a larger island these are the nearest to
/// the one that misses its target most. Forces that nearly balance there prove a jam of the whole
/// island.
const MOST: usize = 16;
/// Largest number of manifolds and joints examined closely in one call.
const ALL: usize = 64;

/// Contacts and joints that jam.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Jam {
    /// Indices into [`System::contacts`].
    pub contacts: Vec<u32>,
    /// Indices into [`System::joints`].
    pub joints: Vec<u32>,
    /// Their bodies in ascending order, fixed ones included.
    pub bodies: Vec<u32>,
    /// Speed by which these contacts and joints miss their targets, mean weighted by the self-stress. \[m/s\]
    pub missing: f64,
    /// Smallest change of the bodies' velocities that would reach all targets, root mean square
    /// weighted by mass; infinite if none does. \[m/s\]
    pub least_change: f64,
}

/// Finds the jams of a solved system, at most one per island.
///
/// Examines only islands with a contact or a joint that misses its target by more than `limit`
/// \[m/s\], and where the current impulses hint at a self-stress. Without these it costs one pass
/// over the contacts and joints. A joint is part of a jam only if the whole misses its targets by
/// more than `limit`: redundant locks differ by rounding.
///
/// A call examines a bounded number of manifolds and joints, so with many suspect islands it does not reach
/// all. `turn` selects the island to begin with.
pub fn find<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    islands: &mut Islands,
    limit: f64,
    turn: usize,
) -> Vec<Jam> {
    let missing = |index: usize| {
        let Some(manifold) = system.manifolds.get(index) else {
            return joint_misses(system, &system.joints[index - system.manifolds.len()]);
        };
        let twist = system.twist_of(manifold);
        let contacts = system.contacts[manifold.points()].iter();
        let contacts = contacts.filter(|contact| contact.effective_mass > T::ZERO);
        let missing = contacts.map(|contact| contact.target[0] - contact.normal_velocity(&twist));
        missing.fold(0.0, |most, own| own.to_f64().max(most))
    };
    let pairs = || system.pairs().enumerate().filter(|(index, _)| missing(*index) > limit);
    if pairs().next().is_none() {
        return Vec::new();
    }
    islands.find(system);
    let mut seen: Vec<u32> = pairs().map(|(_, bodies)| islands.of_pair(bodies)).collect();
    seen.sort_unstable();
    seen.dedup();
    let turn = turn % seen.len();
    seen.rotate_left(turn);
    let (mut left, mut jams) = (ALL, Vec::new());
    for island in seen {
        let suspect = Suspect::new(system, islands, island, missing);
        left = left.saturating_sub(suspect.system.manifolds.len() + suspect.system.joints.len());
        jams.extend(suspect.jam(limit));
        if left == 0 {
            break;
        }
    }
    jams
}

/// Returns 1 for a row of translation, else the radius sqrt(I / m) of a row of rotation. \[1, m\]
fn lever<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    joint: &Joint,
    axis: &Axis<f64, L, A>,
) -> f64 {
    if axis.jacobian.iter().any(|own| own.linear != Vector::ZERO) {
        return 1.0;
    }
    let masses = joint.bodies.map(|body| system.masses[body as usize].cast());
    let unit: f64 = masses.iter().map(|mass: &InverseMass<f64, L, A>| mass.linear).sum();
    let mobility = axis.mobility(&masses);
    if unit > 0.0 && mobility > 0.0 { (unit / mobility).sqrt() } else { 0.0 }
}

/// Returns the velocity missing to a target along an axis, in the direction in which its impulse may
/// grow without bound; 0 if there is none. \[m/s, rad/s\]
pub fn missing_along(law: &Interval<f64>, u: f64) -> f64 {
    let ([low, high], [lo, hi]) = (law.targets, law.bounds);
    let below = if hi == f64::INFINITY { (low - u).max(0.0) } else { 0.0 };
    let above = if lo == f64::NEG_INFINITY { (high - u).min(0.0) } else { 0.0 };
    below + above
}

/// Returns the largest speed by which a row of a joint misses its targets. \[m/s\]
fn joint_misses<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    joint: &Joint,
) -> f64 {
    let [a, b] = joint.bodies.map(|body| system.velocities[body as usize].cast());
    let axes = system.axes[joint.axes()].iter().filter(|axis| axis.effective_mass > T::ZERO);
    let miss = |axis: &Axis<T, L, A>| {
        let axis = axis.cast();
        missing_along(&axis.law, axis.velocity(&a, &b)).abs() * lever(system, joint, &axis)
    };
    axes.map(miss).fold(0.0, f64::max)
}

/// Returns up to [`MOST`] of the manifolds and joints `own`, in their order: the one with the largest
/// `missing` \[m/s\], those that touch its bodies and miss their targets, the neighbors of these,
/// and so on.
fn around_worst<T: Scalar, const L: usize, const A: usize>(
    whole: &System<T, L, A>,
    own: &[usize],
    missing: impl Fn(usize) -> f64,
) -> Vec<usize> {
    let pairs: Vec<_> = whole.pairs().collect();
    let missing: Vec<f64> = own.iter().map(|&index| missing(index)).collect();
    let mut worst = 0;
    for at in 1..own.len() {
        if missing[at] > missing[worst] {
            worst = at;
        }
    }
    let mut inside = vec![false; whole.velocities.len()];
    let enter = |inside: &mut Vec<bool>, at: usize| {
        for body in pairs[own[at]] {
            // Fixed bodies do not count as neighbors: most contacts touch the floor.
            inside[body as usize] |= whole.masses[body as usize] != InverseMass::FIXED;
        }
    };
    let (mut taken, mut count) = (vec![false; own.len()], 1);
    taken[worst] = true;
    enter(&mut inside, worst);
    loop {
        // Those that touch a body found before this round.
        let before = inside.clone();
        let start = count;
        for at in 0..own.len() {
            let touches = pairs[own[at]].iter().any(|&body| before[body as usize]);
            if taken[at] || !touches || missing[at] <= 0.0 || count == MOST {
                continue;
            }
            taken[at] = true;
            count += 1;
            enter(&mut inside, at);
        }
        if count == start || count == MOST {
            break;
        }
    }
    own.iter().zip(taken).filter_map(|(&index, taken)| taken.then_some(index)).collect()
}

/// An island as a system of its own, without friction.
struct Suspect<const L: usize, const A: usize> {
    system: System<f64, L, A>,
    /// Indices of its contacts, joints and bodies in the whole system.
    contacts: Vec<u32>,
    joints: Vec<u32>,
    bodies: Vec<u32>,
}

impl<const L: usize, const A: usize> Suspect<L, A> {
    /// Copies an island, or the part of a large one around the manifold or joint with the largest
    /// `missing` \[m/s\]. Rows of rotation become speeds at their [`lever`].
    fn new<T: Scalar>(
        whole: &System<T, L, A>,
        islands: &Islands,
        island: u32,
        missing: impl Fn(usize) -> f64,
    ) -> Self {
        let mut part = SubSystem::default();
        part.clear(whole);
        let own = whole.pairs().enumerate();
        let own = own.filter(|(_, bodies)| islands.of_pair(*bodies) == island);
        let mut own: Vec<usize> = own.map(|(index, _)| index).collect();
        if own.len() > MOST {
            own = around_worst(whole, &own, missing);
        }
        for index in own {
            match index.checked_sub(whole.manifolds.len()) {
                None => part.add(whole, index),
                Some(joint) => part.add_joint(whole, joint),
            }
        }
        for manifold in &mut part.system.manifolds {
            (manifold.friction, manifold.compliance) = (0.0, f64::INFINITY);
        }
        let contacts = part.contacts(whole).map(|contact| contact as u32).collect();
        let mut suspect =
            Self { system: part.system, contacts, joints: part.joints, bodies: part.bodies };
        suspect.level();
        suspect
    }

    /// Measures the rows of rotation in speeds, and takes those with two bounds out.
    fn level(&mut self) {
        let system = &mut self.system;
        for joint in system.joints.clone() {
            for row in joint.axes() {
                let mut axis = system.axes[row];
                let lever = lever(system, &joint, &axis);
                axis.jacobian = axis.jacobian.map(|own| own * lever);
                axis.law.targets = axis.law.targets.map(|target| target * lever);
                axis.impulse = if lever > 0.0 { axis.impulse / lever } else { 0.0 };
                if lever == 0.0 || axis.law.bounds.iter().all(|bound| bound.is_finite()) {
                    (axis.law.bounds, axis.impulse) = ([0.0; 2], 0.0);
                }
                system.axes[row] = axis;
            }
        }
    }

    /// Makes all contacts and rows practically rigid, without impulses.
    fn stiffen(&self) -> System<f64, L, A> {
        let mut stiff = self.system.clone();
        for contact in &mut stiff.contacts {
            contact.impulse = Vector::ZERO;
        }
        for joint in &stiff.joints {
            let masses = joint.bodies.map(|body| stiff.masses[body as usize]);
            for axis in &mut stiff.axes[joint.axes()] {
                axis.impulse = 0.0;
                axis.law.compliance = STIFF * axis.mobility(&masses);
            }
        }
        stiff.prepare(STIFF);
        stiff
    }

    fn jam(self, limit: f64) -> Option<Jam> {
        let missing = self.missing();
        let demand = missing.iter().map(|missing| missing[0].max(-missing[1])).fold(0.0, f64::max);
        let at_hand = self.stress(&self.system, 0.0);
        let pressed = at_hand.iter().any(|&y| y != 0.0);
        if pressed && self.bound(&at_hand, &missing) < SUSPECT * demand {
            return None;
        }
        let mut stiff = self.stiffen();
        newton::solve(&mut stiff, &Goal { tolerance: 1e-9 * demand, budget: BUDGET });
        // Reports as few contacts and joints as prove the jam.
        [1e-3, 0.0].into_iter().find_map(|least| {
            let stress = self.stress(&stiff, least);
            let change = self.bound(&stress, &missing);
            let jam = (change > BEYOND * demand).then(|| self.name(&stress, &missing, change))?;
            (jam.joints.is_empty() || jam.missing > limit).then_some(jam)
        })
    }

    /// Returns t- - J v and t+ - J v of each contact, then of each row of a joint; 0 for a target
    /// that no impulse without bound acts towards. \[m/s\]
    fn missing(&self) -> Vec<[f64; 2]> {
        let mut missing = Vec::with_capacity(self.system.contacts.len() + self.system.axes.len());
        for manifold in &self.system.manifolds {
            let twist = self.system.twist_of(manifold);
            let contacts = &self.system.contacts[manifold.points()];
            let of = |c: &Contact<f64, L>| [c.target[0] - c.normal_velocity(&twist), 0.0];
            missing.extend(contacts.iter().map(of));
        }
        for joint in &self.system.joints {
            let [a, b] = joint.bodies.map(|body| self.system.velocities[body as usize]);
            for axis in &self.system.axes[joint.axes()] {
                let (u, [lo, hi]) = (axis.velocity(&a, &b), axis.law.bounds);
                let [low, high] = axis.law.targets.map(|target| target - u);
                let acts = [hi == f64::INFINITY, lo == f64::NEG_INFINITY];
                missing.push([if acts[0] { low } else { 0.0 }, if acts[1] { high } else { 0.0 }]);
            }
        }
        missing
    }

    /// Returns the impulses of `solved` along normals, then along rows of joints, scaled to a maximum
    /// of 1. Those up to `least`, those beyond a finite bound, and those of contacts and rows that
    /// nothing can move, are 0.
    fn stress(&self, solved: &System<f64, L, A>, least: f64) -> Vec<f64> {
        let normal = |contact: &Contact<f64, L>| {
            if contact.effective_mass > 0.0 { contact.impulse[0].max(0.0) } else { 0.0 }
        };
        let along = |axis: &Axis<f64, L, A>| {
            let most = axis.law.bounds.map(|bound| if bound.is_finite() { 0.0 } else { bound });
            if axis.effective_mass > 0.0 { axis.impulse.clamp(most[0], most[1]) } else { 0.0 }
        };
        let normals = solved.contacts.iter().map(normal);
        let mut stress: Vec<f64> = normals.chain(solved.axes.iter().map(along)).collect();
        let largest = stress.iter().map(|y| y.abs()).fold(f64::MIN_POSITIVE, f64::max);
        for y in &mut stress {
            *y = if y.abs() > least * largest { *y / largest } else { 0.0 };
        }
        stress
    }

    /// Returns the smallest change of velocity that the forces y prove, root mean square weighted
    /// by the mass of the bodies that they press. \[m/s\]
    fn bound(&self, y: &[f64], missing: &[[f64; 2]]) -> f64 {
        let system = &self.system;
        let mut moved = vec![Velocity::ZERO; system.velocities.len()];
        let mut pressed = vec![false; moved.len()];
        for manifold in &system.manifolds {
            let masses = system.masses_of(manifold);
            let [i, j] = manifold.bodies.map(|body| body as usize);
            let (mut a, mut b) = (moved[i], moved[j]);
            let mut wrench = Velocity::ZERO;
            for point in manifold.points() {
                if y[point] > 0.0 {
                    let mut push = Vector::ZERO;
                    push[0] = y[point];
                    system.contacts[point].add_wrench(0..1, push, &mut wrench);
                    (pressed[i], pressed[j]) = (true, true);
                }
            }
            manifold.frame.apply(&wrench, &masses, &mut a, &mut b);
            (moved[i], moved[j]) = (a, b);
        }
        let (_, along) = y.split_at(system.contacts.len());
        for joint in &system.joints {
            for (axis, &y) in system.axes[joint.axes()].iter().zip(&along[joint.axes()]) {
                for (body, jacobian) in joint.bodies.into_iter().zip(&axis.jacobian) {
                    let body = body as usize;
                    moved[body] += system.masses[body].velocity(&(*jacobian * y));
                    pressed[body] |= y != 0.0;
                }
            }
        }
        // |J^T y|^2 in the metric M^-1, computed as y . J (M^-1 J^T y).
        let mut left = 0.0;
        for joint in &system.joints {
            let [a, b] = joint.bodies.map(|body| moved[body as usize]);
            for (axis, &y) in system.axes[joint.axes()].iter().zip(&along[joint.axes()]) {
                left += y * axis.velocity(&a, &b);
            }
        }
        for manifold in &system.manifolds {
            let [a, b] = manifold.bodies.map(|body| &moved[body as usize]);
            let twist = manifold.frame.twist(a, b);
            for point in manifold.points() {
                left += y[point] * system.contacts[point].normal_velocity(&twist);
            }
        }
        let mut mass = 0.0;
        for (own, _) in system.masses.iter().zip(&pressed).filter(|(_, pressed)| **pressed) {
            own.mass().add_measure(&mut mass);
        }
        let mass = mass.abs();
        let work = work(y, missing);
        if work <= 0.0 { 0.0 } else { work / (left.max(0.0) * mass).sqrt() }
    }

    fn name(&self, y: &[f64], missing: &[[f64; 2]], least_change: f64) -> Jam {
        let (normal, along) = y.split_at(self.system.contacts.len());
        let mut bodies = Vec::new();
        for manifold in &self.system.manifolds {
            if manifold.points().any(|point| y[point] > 0.0) {
                bodies.extend(manifold.bodies.map(|body| self.bodies[body as usize]));
            }
        }
        let mut joints = Vec::new();
        for (joint, &index) in self.system.joints.iter().zip(&self.joints) {
            if along[joint.axes()].iter().any(|&y| y != 0.0) {
                joints.push(index);
                bodies.extend(joint.bodies.map(|body| self.bodies[body as usize]));
            }
        }
        bodies.sort_unstable();
        bodies.dedup();
        let stressed = (0..normal.len()).filter(|&i| normal[i] > 0.0);
        Jam {
            contacts: stressed.map(|i| self.contacts[i]).collect(),
            joints,
            bodies,
            missing: work(y, missing) / y.iter().map(|y| y.abs()).sum::<f64>(),
            least_change,
        }
    }
}

/// Returns the sum of y (t - J v), where positive forces act towards t- and negative ones towards
/// t+. \[m/s\]
fn work(y: &[f64], missing: &[[f64; 2]]) -> f64 {
    let one = |(&y, [low, high]): (&f64, &[f64; 2])| match y {
        y if y > 0.0 => y * low,
        y if y < 0.0 => y * high,
        _ => 0.0,
    };
    y.iter().zip(missing).map(one).sum()
}
