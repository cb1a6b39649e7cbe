//! Targets of the contacts in a block: from gaps and overlaps ([`Targets`]), and of contacts that
//! have landed ([`Landing`]).

use super::block::{Block, splat};
use super::{Lanes, WIDTH};
use crate::{Contact, Real, Repair, Velocity};

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
