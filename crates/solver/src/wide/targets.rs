//! [`Targets`]: what the contacts of blocks are to reach.

use super::block::{Block, splat};
use crate::lanes::Lanes;
use crate::{Contact, Repair, Velocity};

/// What targets are set from ([`System::set_targets`](crate::System::set_targets)).
#[derive(Clone, Copy)]
pub(crate) struct Targets<'a, V: Lanes, const L: usize, const A: usize> {
    /// The number of the first body.
    first: usize,
    pub(super) displacements: &'a [Velocity<f32, L, A>],
    repair: Repair<V>,
}

impl<'a, V: Lanes, const L: usize, const A: usize> Targets<'a, V, L, A> {
    pub(super) fn new(
        first: usize,
        displacements: &'a [Velocity<f32, L, A>],
        repair: &Repair<f32>,
    ) -> Self {
        Self {
            first,
            displacements,
            repair: Repair {
                dt: splat(repair.dt),
                rate: splat(repair.rate),
                slop: splat(repair.slop),
                push_speed: splat(repair.push_speed),
                hold: splat(repair.hold),
            },
        }
    }

    /// Those of the points of a block.
    #[inline(always)]
    pub(super) fn set(&self, block: &Block<V, L, A>, points: &mut [Contact<V, L>]) {
        if block.center {
            self.set_felt::<0>(block, points);
        } else {
            self.set_felt::<A>(block, points);
        }
    }

    /// The same of points that feel `B` components of turning ([`Manifold::twist_felt`]).
    #[inline(always)]
    fn set_felt<const B: usize>(&self, block: &Block<V, L, A>, points: &mut [Contact<V, L>]) {
        let [a, b] = block.gather_from(self.first, self.displacements);
        let moved: Velocity<V, L, B> = block.manifold.twist_felt(&a, &b);
        for contact in points {
            contact.set_target(&moved, &self.repair);
        }
    }
}
