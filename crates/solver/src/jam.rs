//! Jams: contacts whose targets no velocities can reach.
//!
//! Examples are bodies wedged between converging walls, or squeezed into too little room. Soft
//! contacts always have a response. Here it is the best one in the least-squares sense, but no
//! solution. The evidence is a self-stress: normal forces y >= 0 that nearly balance each other, on
//! contacts that should open.
//!
//! # The bound
//!
//! Let y >= 0 be any such forces, v the current velocities and v' any velocities that reach all
//! targets, J v' >= t. Then y . J (v' - v) >= y . (t - J v), and by the Cauchy-Schwarz inequality
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
use crate::part::SubSystem;
use crate::solution::Goal;
use crate::{InverseMass, Scalar, System, Vector, Velocity, newton};

/// A bound on the change of velocity beyond this multiple of the largest missing velocity is a
/// jam. \[1\]
const BEYOND: f64 = 1e3;
/// Such a multiple, for the current impulses, beyond which an island is examined closely. \[1\]
const SUSPECT: f64 = 3.0;
/// Softness of practically rigid contacts. \[1\]
const STIFF: f64 = 1e-7;
/// Largest number of Newton steps.
const BUDGET: usize = 40;
/// Largest number of manifolds of an island that are examined closely, so that a search costs no
/// more than a step, whatever the size of the island. In a larger island these are the nearest to
/// the one that misses its target most. Forces that nearly balance there prove a jam of the whole
/// island.
const MOST: usize = 16;
/// Largest number of manifolds examined closely in one call.
const ALL: usize = 64;

/// Contacts that jam.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Jam {
    /// Indices into [`System::contacts`].
    pub contacts: Vec<u32>,
    /// Their bodies in ascending order, fixed ones included.
    pub bodies: Vec<u32>,
    /// Speed by which these contacts miss their targets, mean weighted by the self-stress. \[m/s\]
    pub missing: f64,
    /// Smallest change of the bodies' velocities that would reach all targets, root mean square
    /// weighted by mass; infinite if none does. \[m/s\]
    pub least_change: f64,
}

/// Finds the jams of a solved system, at most one per island.
///
/// Examines only islands with a contact that misses its target by more than `limit` \[m/s\], and
/// where the current impulses hint at a self-stress. Without these it costs one pass over the
/// contacts.
///
/// A call examines a bounded number of manifolds, so with many suspect islands it does not reach
/// all. `turn` selects the island to begin with.
pub fn find<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    islands: &mut Islands,
    limit: f64,
    turn: usize,
) -> Vec<Jam> {
    let missing = |index: usize| {
        let manifold = &system.manifolds[index];
        let twist = system.twist_of(manifold);
        let contacts = system.contacts[manifold.points()].iter();
        let contacts = contacts.filter(|contact| contact.effective_mass > T::ZERO);
        let missing = contacts.map(|contact| contact.target[0] - contact.normal_velocity(&twist));
        missing.fold(0.0, |most, own| own.to_f64().max(most))
    };
    let Some(first) = (0..system.manifolds.len()).find(|&index| missing(index) > limit) else {
        return Vec::new();
    };
    islands.find(system);
    let mut seen: Vec<u32> = (first..system.manifolds.len())
        .filter(|&index| missing(index) > limit)
        .map(|index| islands.of_pair(system.manifolds[index].bodies))
        .collect();
    seen.sort_unstable();
    seen.dedup();
    let turn = turn % seen.len();
    seen.rotate_left(turn);
    let (mut left, mut jams) = (ALL, Vec::new());
    for island in seen {
        let suspect = Suspect::new(system, islands, island, missing);
        left = left.saturating_sub(suspect.system.manifolds.len());
        jams.extend(suspect.jam());
        if left == 0 {
            break;
        }
    }
    jams
}

/// Returns up to [`MOST`] of the manifolds `own`, in their order: the one with the largest
/// `missing` \[m/s\], those that touch its bodies and miss their targets, the neighbors of these,
/// and so on.
fn around_worst<T: Scalar, const L: usize, const A: usize>(
    whole: &System<T, L, A>,
    own: &[usize],
    missing: impl Fn(usize) -> f64,
) -> Vec<usize> {
    let missing: Vec<f64> = own.iter().map(|&index| missing(index)).collect();
    let mut worst = 0;
    for at in 1..own.len() {
        if missing[at] > missing[worst] {
            worst = at;
        }
    }
    let mut inside = vec![false; whole.velocities.len()];
    let enter = |inside: &mut Vec<bool>, at: usize| {
        for body in whole.manifolds[own[at]].bodies {
            // Fixed bodies do not count as neighbors: most contacts touch the floor.
            inside[body as usize] |= whole.masses[body as usize] != InverseMass::FIXED;
        }
    };
    let (mut taken, mut count) = (vec![false; own.len()], 1);
    taken[worst] = true;
    enter(&mut inside, worst);
    loop {
        // Manifolds that touch a body found before this round.
        let before = inside.clone();
        let start = count;
        for at in 0..own.len() {
            let touches = whole.manifolds[own[at]].bodies.iter().any(|&body| before[body as usize]);
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
    /// Indices of its contacts and bodies in the whole system.
    contacts: Vec<u32>,
    bodies: Vec<u32>,
}

impl<const L: usize, const A: usize> Suspect<L, A> {
    /// Copies an island, or the part of a large one around the manifold with the largest
    /// `missing` \[m/s\].
    fn new<T: Scalar>(
        whole: &System<T, L, A>,
        islands: &Islands,
        island: u32,
        missing: impl Fn(usize) -> f64,
    ) -> Self {
        let mut part = SubSystem::default();
        part.clear(whole);
        let own = |index: &usize| islands.of_pair(whole.manifolds[*index].bodies) == island;
        let mut own: Vec<usize> = (0..whole.manifolds.len()).filter(own).collect();
        if own.len() > MOST {
            own = around_worst(whole, &own, missing);
        }
        own.into_iter().for_each(|index| part.add(whole, index));
        for manifold in &mut part.system.manifolds {
            (manifold.friction, manifold.compliance) = (0.0, f64::INFINITY);
        }
        let contacts = part.contacts(whole).map(|contact| contact as u32).collect();
        Self { system: part.system, contacts, bodies: part.bodies }
    }

    fn jam(self) -> Option<Jam> {
        let missing = self.missing();
        let demand = missing.iter().copied().fold(0.0, f64::max);
        let at_hand = self.stress(&self.system, 0.0);
        let pressed = at_hand.iter().any(|&y| y > 0.0);
        if pressed && self.bound(&at_hand, &missing) < SUSPECT * demand {
            return None;
        }
        let mut stiff = self.system.clone();
        for contact in &mut stiff.contacts {
            contact.impulse = Vector::ZERO;
        }
        stiff.prepare(STIFF);
        newton::solve(&mut stiff, &Goal { tolerance: 1e-9 * demand, budget: BUDGET });
        // Reports as few contacts as prove the jam.
        [1e-3, 0.0].into_iter().find_map(|least| {
            let stress = self.stress(&stiff, least);
            let change = self.bound(&stress, &missing);
            (change > BEYOND * demand).then(|| self.name(&stress, &missing, change))
        })
    }

    /// Returns t - J v of each contact. \[m/s\]
    fn missing(&self) -> Vec<f64> {
        let mut missing = Vec::with_capacity(self.system.contacts.len());
        for manifold in &self.system.manifolds {
            let twist = self.system.twist_of(manifold);
            let contacts = &self.system.contacts[manifold.points()];
            missing.extend(contacts.iter().map(|c| c.target[0] - c.normal_velocity(&twist)));
        }
        missing
    }

    /// Returns the normal impulses of `solved`, scaled to a maximum of 1. Those up to `least`, and
    /// those of contacts that nothing can move, are 0.
    fn stress(&self, solved: &System<f64, L, A>, least: f64) -> Vec<f64> {
        let normal = |i: usize| {
            let contact = &solved.contacts[i];
            if contact.effective_mass > 0.0 { contact.impulse[0].max(0.0) } else { 0.0 }
        };
        let largest = (0..solved.contacts.len()).map(normal).fold(f64::MIN_POSITIVE, f64::max);
        let part = |i| normal(i) / largest;
        (0..solved.contacts.len()).map(|i| if part(i) > least { part(i) } else { 0.0 }).collect()
    }

    /// Returns the smallest change of velocity that the forces y prove, root mean square weighted
    /// by the mass of the bodies that they press. \[m/s\]
    fn bound(&self, y: &[f64], missing: &[f64]) -> f64 {
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
        // |J^T y|^2 in the metric M^-1, computed as y . J (M^-1 J^T y).
        let mut left = 0.0;
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
        let work: f64 = y.iter().zip(missing).map(|(y, missing)| y * missing).sum();
        if work <= 0.0 { 0.0 } else { work / (left.max(0.0) * mass).sqrt() }
    }

    fn name(&self, y: &[f64], missing: &[f64], least_change: f64) -> Jam {
        let mut bodies = Vec::new();
        for manifold in &self.system.manifolds {
            if manifold.points().any(|point| y[point] > 0.0) {
                bodies.extend(manifold.bodies.map(|body| self.bodies[body as usize]));
            }
        }
        bodies.sort_unstable();
        bodies.dedup();
        let stressed = (0..y.len()).filter(|&i| y[i] > 0.0);
        let weighted: f64 = y.iter().zip(missing).map(|(y, missing)| y * missing).sum();
        Jam {
            contacts: stressed.map(|i| self.contacts[i]).collect(),
            bodies,
            missing: weighted / y.iter().sum::<f64>(),
            least_change,
        }
    }
}
