//! Contacts of a block whose bodies move: their targets ([`Targets`]), the renewal of J where
//! bodies rotate ([`renew`]), and contacts that land ([`Landing`]).
//!
//! The equations of curved paths are in [`kinematics`](crate::kinematics).

use super::block::{Block, choose, splat};
use super::{Lanes, WIDTH};
use crate::kinematics::Moved;
use crate::{Contact, InverseMass, Real, Repair, Vector, Velocity};

/// Data from which targets are set ([`System::set_targets`](crate::System::set_targets)).
#[derive(Clone, Copy)]
pub(crate) struct Targets<'a, T: Real, const L: usize, const A: usize> {
    /// Index of the first body.
    first: usize,
    pub(super) displacements: &'a [Velocity<f32, L, A>],
    /// True if bodies rotate, so that targets account for the curvature of paths
    /// ([`kinematics`](crate::kinematics)).
    pub(super) turning: bool,
    repair: Repair<T>,
}

impl<'a, const L: usize, const A: usize> Targets<'a, f32, L, A> {
    pub(super) fn new(
        first: usize,
        displacements: &'a [Velocity<f32, L, A>],
        turning: bool,
        repair: &Repair<f32>,
    ) -> Self {
        Self { first, displacements, turning, repair: *repair }
    }

    /// Returns the same for all lanes.
    pub(super) fn in_lanes<V: Lanes>(&self) -> Targets<'a, V, L, A> {
        let Self { first, displacements, turning, repair } = *self;
        let repair = Repair {
            dt: splat(repair.dt),
            rate: splat(repair.rate),
            slop: splat(repair.slop),
            max_repair_speed: splat(repair.max_repair_speed),
            stick_rate: splat(repair.stick_rate),
        };
        Targets { first, displacements, turning, repair }
    }
}

impl<V: Lanes, const L: usize, const A: usize> Targets<'_, V, L, A> {
    /// Sets the targets of the points of a block. The bodies move at `velocities`, which are given
    /// if any body rotates.
    #[inline(always)]
    pub(super) fn set(
        &self,
        block: &Block<V, L, A>,
        points: &mut [Contact<V, L>],
        velocities: Option<[Velocity<V, L, A>; 2]>,
    ) {
        if block.center {
            self.set_felt::<0>(block, points, velocities);
        } else {
            self.set_felt::<A>(block, points, velocities);
        }
    }

    /// Sets the targets of points that feel `B` components of rotation
    /// ([`ConstraintFrame::twist_felt`]).
    #[inline(always)]
    fn set_felt<const B: usize>(
        &self,
        block: &Block<V, L, A>,
        points: &mut [Contact<V, L>],
        velocities: Option<[Velocity<V, L, A>; 2]>,
    ) {
        let [a, b] = block.gather_from(self.first, self.displacements);
        let mut moved: Velocity<V, L, B> = block.manifold.frame.twist_felt(&a, &b);
        let total = [&a, &b];
        if A > 0
            && let Some([a, b]) = velocities
            && let [first, ..] = points
        {
            let ahead = [&(a * self.repair.dt), &(b * self.repair.dt)];
            let then = [&(*total[0] + *ahead[0]), &(*total[1] + *ahead[1])];
            let turns = block.manifold.turns(first.gap[0], ahead, self.repair.dt);
            if any(turns, block.used) {
                let turns = turns.min(block.manifold.holds(first.gap[0], then));
                let gap = first.gap[0] + first.normal_velocity(&moved);
                let bend = block.manifold.moved(gap, ahead, V::ZERO).bend;
                moved.linear[0] += turns.choose(bend, V::ZERO);
            }
        }
        for contact in points {
            contact.set_target(&moved, &self.repair);
        }
    }
}

/// Displacements of this substep that the velocities at its end do not tell: a body with joints falls by
/// half of what gravity adds, and its joints take the rest of that velocity when contacts have been solved.
/// For solves to a tolerance: with a few sweeps they would make contacts oscillate.
#[derive(Clone, Copy, Debug)]
pub struct Lead<'a, const L: usize, const A: usize> {
    /// Displacements since gaps were measured. \[m, rad\]
    pub displacements: &'a [Velocity<f32, L, A>],
    /// The part of them that is meant here: h / 2 times what forces, springs and contacts give bodies in each
    /// substep. \[m, rad\]
    pub offsets: &'a [Velocity<f32, L, A>],
    /// Velocities at the start of the substep. What slides or strikes has no place to keep.
    pub velocities: &'a [Velocity<f32, L, A>],
    /// By body: true if it has joints. Targets of other bodies stay.
    pub joined: &'a [bool],
    /// Parameters with which targets have been set.
    pub repair: Repair<f32>,
}

/// Speed of two surfaces up to which their contact is at rest. Beyond twice that it is not. \[m/s\]
const SLOW: f32 = 0.05;

impl<const L: usize, const A: usize> Lead<'_, L, A> {
    /// Takes the offsets out of targets that have been set, so that points in contact keep their places,
    /// not their velocities. Targets of open gaps do so already. Returns the change of each target.
    #[inline(always)]
    pub(super) fn shift<V: Lanes>(
        &self,
        block: &Block<V, L, A>,
        points: &mut [Contact<V, L>],
        shifts: &mut [Vector<V, L>],
    ) {
        let Repair { dt, rate, stick_rate, .. } = self.repair;
        let twist = |of: &[Velocity<f32, L, A>]| {
            let [a, b] = block.gather_from(0, of);
            block.manifold.frame.twist(&a, &b)
        };
        let (moved, offset) = (twist(self.displacements), twist(self.offsets));
        let before = twist(self.velocities);
        let counts = V::from_array(std::array::from_fn(|lane| {
            let is_joined =
                |side: &[u32; WIDTH]| self.joined.get(side[lane] as usize) == Some(&true);
            if block.bodies.iter().any(is_joined) { 1.0 } else { 0.0 }
        }));
        let [of_slip, of_overlap] =
            [stick_rate * dt, rate].map(|own| counts * splat((1.0 - own) / dt));
        for (contact, shift) in points.iter_mut().zip(shifts) {
            let gap = contact.gap[0] + contact.normal_velocity(&moved);
            let speed = contact.relative_velocity(&before);
            let speed = speed.dot(speed).sqrt() * splat(1.0 / SLOW);
            let rests = (splat::<V>(2.0) - speed).max(V::ZERO).min(splat(1.0));
            let offset = contact.relative_velocity(&offset) * rests;
            *shift = offset * of_slip;
            shift[0] = gap.choose(V::ZERO, offset[0] * of_overlap);
            contact.target -= *shift;
        }
    }
}

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
    let rotates = block.manifold.turns(deepest.gap[0], moved, dt);
    block.renewed = any(rotates, block.used);
    if !block.renewed {
        return;
    }
    let [a, b] = block.gather_from(first, bodies.displacements);
    let manifold = &mut block.manifold;
    let turns = rotates.min(manifold.holds(deepest.gap[0], [&a, &b]));
    let mut wrench = Velocity::ZERO;
    for contact in &*points {
        contact.add_wrench(0..L, contact.impulse, &mut wrench);
    }
    let mut before: Velocity<V, L, B> = manifold.frame.twist_felt(&a, &b);
    let gap = deepest.gap[0] + deepest.normal_velocity(&before);
    // A single point is at the center, and does not spin with the body.
    let twist = deepest.offset.dot(deepest.offset).choose(V::ONE, V::ZERO);
    let Moved { frame: next, bend } = manifold.moved(gap, moved, twist);
    // Half of the impulse acts through J before the motion, half through J after it.
    let half = V::from_f64(0.5);
    let [to_a, from_b]: [Velocity<V, L, A>; 2] = manifold.frame.momenta(&wrench);
    let [to_a_next, from_b_next] = next.momenta(&wrench);
    let lag: [Velocity<V, L, A>; 2] = [(to_a_next - to_a) * half, (from_b_next - from_b) * half];
    // An impact changes rotation at once, so correcting the lag of its arms would feed back on
    // itself.
    let turns = turns.min(settles(&next.arms, &block.masses, &lag, spins));
    for i in 0..L {
        manifold.frame.axes[i] = choose(turns, next.axes[i], manifold.frame.axes[i]);
    }
    for side in 0..2 {
        manifold.frame.arms[side] = choose(turns, next.arms[side], manifold.frame.arms[side]);
    }
    let one = turns.choose(V::ONE, V::ZERO);
    block.lag = [lag[0] * one, lag[1] * one];
    before.linear[0] += bend;
    let after: Velocity<V, L, B> = manifold.frame.twist_felt(&a, &b);
    for contact in &mut *points {
        let mut own = *contact;
        own.renew(&before, &after);
        contact.gap = choose(turns, own.gap, contact.gap);
    }
    // The result of a lane must not depend on the other lanes.
    block.take_turned(first, bodies.masses, rotates);
    block.prepare(points, softness);
}

/// A point has landed if less than this fraction of its gap is left. \[1\]
const LANDED: f64 = 1e-3;

/// Positions of bodies after a substep.
#[derive(Clone, Copy)]
pub struct Landing<'a, const L: usize, const A: usize> {
    /// Displacements since gaps were measured. \[m, rad\]
    pub displacements: &'a [Velocity<f32, L, A>],
    /// Length of the substep. \[s\]
    pub dt: f32,
    /// No two surfaces have approached each other faster in it. \[m/s\]
    pub approach: f32,
}

/// Sets the targets of points that have landed in the substep to 0. Their bodies stop there, and do
/// not enter the next substep at the speed of their approach.
///
/// Some targets stay. Bodies that bounce have their impact in the next substep. J is out of date
/// for bodies that have rotated far. Points that [`Landing::approach`] cannot have closed are
/// skipped.
#[inline(always)]
pub(super) fn land<V: Lanes, const L: usize, const A: usize>(
    block: &Block<V, L, A>,
    points: &mut [Contact<V, L>],
    first: usize,
    landing: &Landing<'_, L, A>,
) {
    // The target is -1 / h of the gap before.
    let approach = splat::<V>(landing.approach);
    let coming = |point: &Contact<V, L>| (-point.target[0]).min(approach + point.target[0]);
    let coming = points.iter().fold(V::ZERO, |most, point| most.max(coming(point)));
    if !any(coming, block.used) {
        return;
    }
    if block.center {
        land_felt::<V, L, A, 0>(block, points, first, landing);
    } else {
        land_felt::<V, L, A, A>(block, points, first, landing);
    }
}

/// Sets the targets for points that feel `B` components of rotation
/// ([`ConstraintFrame::twist_felt`]).
///
/// [`ConstraintFrame::twist_felt`]: crate::Manifold
#[inline(always)]
fn land_felt<V: Lanes, const L: usize, const A: usize, const B: usize>(
    block: &Block<V, L, A>,
    points: &mut [Contact<V, L>],
    first: usize,
    landing: &Landing<'_, L, A>,
) {
    let [a, b] = block.gather_from(first, landing.displacements);
    let moved: Velocity<V, L, B> = block.manifold.frame.twist_felt(&a, &b);
    let [deepest, ..] = &*points else { return };
    let holds = block.manifold.holds(deepest.gap[0], [&a, &b]);
    let landed = splat::<V>(landing.dt) * V::from_f64(LANDED);
    for contact in points {
        let gap = contact.gap[0] + contact.normal_velocity(&moved);
        let before = contact.target[0];
        // The target was -1 / h times the gap before the substep.
        let target = (gap + before * landed).choose(before, V::ZERO);
        let target = block.manifold.restitution.choose(before, target);
        let target = holds.choose(target, before);
        contact.target[0] = (-before).choose(target, before);
    }
}

/// Returns whether any of the `used` lanes is positive.
#[inline(always)]
pub(super) fn any<V: Lanes>(of: V, used: u16) -> bool {
    (0..WIDTH).fold(false, |any, lane| any | (of.get(lane) > 0.0 && used >> lane & 1 != 0))
}
