//! Renewal of J and M^-1 in a block whose bodies rotate ([`kinematics`](crate::kinematics)).

use super::Lanes;
use super::block::Block;
use super::targets::any;
use crate::kinematics::Moved;
use crate::{Contact, InverseMass, Vector, Velocity};

/// J is renewed only where that changes velocities by less than this fraction of the velocity from
/// rotation. So it is renewed under weights, but not in impacts. \[1\]
const MOST_LAG: f64 = 0.2;

/// Returns a positive number where a lag \[N s, N m s\] changes velocities by less than
/// [`MOST_LAG`] of the velocity that rotation at these `spins` \[rad/s\] gives at the arms.
#[inline(always)]
fn settles<V: Lanes, const L: usize, const A: usize>(
    arms: &[Vector<V, L>; 2],
    masses: &[InverseMass<V, L, A>; 2],
    lag: &[Velocity<V, L, A>; 2],
    spins: [Vector<V, A>; 2],
) -> V {
    let (mut turned, mut changed) = (V::ZERO, V::ZERO);
    for side in 0..2 {
        let squared = arms[side].dot(arms[side]);
        let change = masses[side].velocity(&lag[side]);
        turned += spins[side].dot(spins[side]) * squared;
        changed += change.linear.dot(change.linear) + change.angular.dot(change.angular) * squared;
    }
    turned * V::from_f64(MOST_LAG * MOST_LAG) - changed
}

/// Bodies that have moved for a substep.
#[derive(Clone, Copy)]
pub struct MovedBodies<'a, const L: usize, const A: usize> {
    /// Velocities at which they have moved. \[m/s, rad/s\]
    pub velocities: &'a [Velocity<f32, L, A>],
    /// Displacements since gaps were measured. \[m, rad\]
    pub displacements: &'a [Velocity<f32, L, A>],
    /// M^-1 in the current orientations.
    pub masses: &'a [InverseMass<f32, L, A>],
    /// True if each body rotates faster than [`LEAST_SPIN`](crate::kinematics::LEAST_SPIN), or has
    /// done so since gaps were measured.
    pub turned: &'a [bool],
}

/// Renews J of the manifolds of a block whose bodies rotate ([`kinematics`](crate::kinematics)),
/// and M^-1.
///
/// With the old W of a slender body, an impulse would make it spin about an axis that is not its
/// own. `terms` are the length of the substep \[s\] and the softness of contacts.
#[inline(always)]
pub(super) fn renew<V: Lanes, const L: usize, const A: usize>(
    block: &mut Block<V, L, A>,
    points: &mut [Contact<V, L>],
    first: usize,
    bodies: MovedBodies<'_, L, A>,
    terms: [V; 2],
) {
    let turned = |any, &body| any | bodies.turned[body as usize - first];
    if block.used == 0 || !block.bodies.as_flattened().iter().fold(false, turned) {
        block.renewed = false;
        return;
    }
    if block.center {
        renew_felt::<V, L, A, 0>(block, points, first, bodies, terms);
    } else {
        renew_felt::<V, L, A, A>(block, points, first, bodies, terms);
    }
}

/// Renews J for points that feel `B` components of rotation ([`ConstraintFrame::twist_felt`]).
///
/// [`ConstraintFrame::twist_felt`]: crate::Manifold
#[inline(always)]
fn renew_felt<V: Lanes, const L: usize, const A: usize, const B: usize>(
    block: &mut Block<V, L, A>,
    points: &mut [Contact<V, L>],
    first: usize,
    bodies: MovedBodies<'_, L, A>,
    [dt, softness]: [V; 2],
) {
    let [a, b] = block.gather_from(first, bodies.velocities);
    let spins = [a.angular, b.angular];
    let moved = [&(a * dt), &(b * dt)];
    let [deepest, ..] = &*points else { return };
    let turns = block.manifold.turns(deepest.gap[0], moved, dt);
    block.renewed = any(turns, block.used);
    if !block.renewed {
        return;
    }
    let [a, b] = block.gather_from(first, bodies.displacements);
    let manifold = &mut block.manifold;
    let turns = turns.min(manifold.holds(deepest.gap[0], [&a, &b]));
    let mut wrench = Velocity::ZERO;
    for contact in &*points {
        contact.add_wrench(0..L, contact.impulse, &mut wrench);
    }
    let mut before: Velocity<V, L, B> = manifold.frame.twist_felt(&a, &b);
    let gap = deepest.gap[0] + deepest.normal_velocity(&before);
    let twist = if B == 0 { V::ZERO } else { V::ONE };
    let Moved { frame: next, bend } = manifold.moved(gap, moved, twist);
    // Half of the impulse acts through J before the motion, half through J after it.
    let half = V::from_f64(0.5);
    let [to_a, from_b]: [Velocity<V, L, A>; 2] = manifold.frame.momenta(&wrench);
    let [to_a_next, from_b_next] = next.momenta(&wrench);
    let lag: [Velocity<V, L, A>; 2] = [(to_a_next - to_a) * half, (from_b_next - from_b) * half];
    // An impact changes rotation at once, so correcting the lag of its arms would feed back on
    // itself.
    let turns = turns.min(settles(&next.arms, &block.masses, &lag, spins));
    let choose = |new: Vector<V, L>, old: Vector<V, L>| {
        let mut out = old;
        for i in 0..L {
            out[i] = turns.choose(new[i], old[i]);
        }
        out
    };
    for i in 0..L {
        manifold.frame.axes[i] = choose(next.axes[i], manifold.frame.axes[i]);
    }
    for side in 0..2 {
        manifold.frame.arms[side] = choose(next.arms[side], manifold.frame.arms[side]);
    }
    block.lag = lag.map(|own| own * turns.choose(V::ONE, V::ZERO));
    before.linear[0] += bend;
    let after: Velocity<V, L, B> = manifold.frame.twist_felt(&a, &b);
    for contact in &mut *points {
        let mut own = *contact;
        own.renew(&before, &after);
        contact.gap = choose(own.gap, contact.gap);
    }
    // Done in all lanes: the result of a lane must not depend on the other lanes.
    block.take_turned(first, bodies.masses);
    block.prepare(points, softness);
}
