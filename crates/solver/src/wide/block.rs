//! [`Block`]: sixteen manifolds side by side.

use std::ops::Range;

use crate::color::Coloring;
use crate::island::NONE;
use crate::lanes::{Lanes, WIDTH};
use crate::pgs::Parts;
use crate::{Contact, InverseMass, Manifold, Mobility, System, Vector};

/// The gap of a point that is not there. \[m\]
const FAR: f32 = 1e6;

/// Up to sixteen manifolds that move different bodies.
#[derive(Clone, Debug)]
pub(super) struct Block<V: Lanes, const L: usize, const A: usize> {
    /// How many of the lanes are in use.
    pub(super) lanes: usize,
    pub(super) bodies: [[u32; WIDTH]; 2],
    /// Of each side, the lanes whose body can be moved, as bits.
    pub(super) moving: [u16; 2],
    pub(super) islands: [u32; WIDTH],
    pub(super) masses: [InverseMass<V, L, A>; 2],
    pub(super) mobility: Mobility<V, L, A>,
    /// `bodies` of this one mean nothing: each lane has its own.
    pub(super) manifold: Manifold<V, L>,
}

impl<V: Lanes, const L: usize, const A: usize> Block<V, L, A> {
    pub(super) fn empty() -> Self {
        Self {
            lanes: 0,
            bodies: [[0; WIDTH]; 2],
            moving: [0; 2],
            islands: [NONE; WIDTH],
            masses: [InverseMass::default(); 2],
            mobility: Mobility::default(),
            manifold: Manifold::default(),
        }
    }

    /// Puts a manifold into a lane of the block and of its points.
    pub(super) fn take(
        &mut self,
        lane: usize,
        manifold: &Manifold<f32, L>,
        system: &System<f32, L, A>,
        points: &mut [Contact<V, L>],
    ) {
        if self.lanes == 0 {
            // Idle lanes read the bodies of the first, and are not written back. What a lane has
            // too few points for is so far open that it never takes an impulse.
            self.bodies = manifold.bodies.map(|body| [body; WIDTH]);
            self.moving = [0; 2];
            self.masses = [InverseMass::default(); 2];
            self.manifold.frame = [Vector::ZERO; L];
            self.manifold.arms = [Vector::ZERO; 2];
            let mut open = Contact::default();
            open.gap[0] = splat(FAR);
            points.fill(open);
        }
        self.lanes += 1;
        self.manifold.friction.set(lane, manifold.friction);
        self.manifold.compliance.set(lane, manifold.compliance);
        for (wide, axis) in self.manifold.frame.iter_mut().zip(&manifold.frame) {
            set(wide, lane, axis);
        }
        for side in 0..2 {
            set(&mut self.manifold.arms[side], lane, &manifold.arms[side]);
            let body = manifold.bodies[side];
            let mass = &system.masses[body as usize];
            self.bodies[side][lane] = body;
            self.moving[side] |= u16::from(*mass != InverseMass::FIXED) << lane;
            self.masses[side].linear.set(lane, mass.linear);
            for (wide, row) in self.masses[side].angular.0.iter_mut().zip(&mass.angular.0) {
                set(wide, lane, row);
            }
        }
        for (wide, contact) in points.iter_mut().zip(&system.contacts[manifold.points()]) {
            set(&mut wide.place, lane, &contact.place);
            set(&mut wide.gap, lane, &contact.gap);
            set(&mut wide.impulse, lane, &contact.impulse);
        }
    }

    pub(super) fn parts(&self) -> Parts<'_, V, L, A> {
        (&self.manifold, &self.mobility, &self.masses)
    }

    /// Whether all its manifolds belong to islands that are done.
    pub(super) fn is_done(&self, done: &[bool]) -> bool {
        let mut own = self.islands[..self.lanes].iter();
        own.all(|&island| done.get(island as usize).copied().unwrap_or(true))
    }
}

/// Puts the manifolds that have a place in some of the blocks, of which `first` is the first, there.
///
/// In the order of the manifolds: they come from memory in a stream, while the blocks that are being
/// filled, at most one for each color and number of points, stay in cache.
pub(super) fn fill<V: Lanes, const L: usize, const A: usize>(
    first: usize,
    blocks: &mut [Block<V, L, A>],
    contacts: &mut [Contact<V, L>],
    coloring: &Coloring,
    system: &System<f32, L, A>,
) {
    let start = blocks.first().map_or(0, |block| block.manifold.first as usize);
    for (manifold, &place) in system.manifolds.iter().zip(&coloring.places) {
        let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
        if let Some(block) = block.checked_sub(first).and_then(|at| blocks.get_mut(at)) {
            let Range { start: from, end } = block.manifold.points();
            block.take(lane, manifold, system, &mut contacts[from - start..end - start]);
        }
    }
}

/// The effective masses ([`Contact::prepare`]) of blocks that have been filled, and their points.
#[inline(always)]
pub(super) fn prepare<V: Lanes, const L: usize, const A: usize>(
    blocks: &mut [Block<V, L, A>],
    contacts: &mut [Contact<V, L>],
    softness: V,
) {
    let mut later = contacts;
    for block in blocks {
        block.mobility = Mobility::of(&block.manifold, &block.masses);
        let points;
        (points, later) = later.split_at_mut(block.manifold.count as usize);
        for contact in points {
            contact.prepare(&block.manifold, &block.mobility, softness);
        }
    }
}

pub(super) fn splat<V: Lanes>(value: f32) -> V {
    V::from_array([value; WIDTH])
}

pub(super) fn set<V: Lanes, const N: usize>(
    wide: &mut Vector<V, N>,
    lane: usize,
    of: &Vector<f32, N>,
) {
    for i in 0..N {
        wide[i].set(lane, of[i]);
    }
}
