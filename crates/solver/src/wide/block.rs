//! [`Block`]: sixteen manifolds side by side.

use std::ops::Range;

use super::Rows;
use crate::color::Coloring;
use crate::island::NONE;
use crate::lanes::{Lanes, WIDTH};
use crate::pgs::Parts;
use crate::{Contact, InverseMass, Manifold, Mobility, Vector};

/// The gap of a point that is not there. \[m\]
const FAR: f32 = 1e6;

/// Up to sixteen manifolds that move different bodies.
#[derive(Clone, Debug)]
pub(crate) struct Block<V: Lanes, const L: usize, const A: usize> {
    /// How many of the lanes are in use.
    pub(super) lanes: usize,
    pub(super) bodies: [[u32; WIDTH]; 2],
    /// All bodies are before this one.
    pub(super) end: u32,
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
            end: 1,
            moving: [0; 2],
            islands: [NONE; WIDTH],
            masses: [InverseMass::default(); 2],
            mobility: Mobility::default(),
            manifold: Manifold::default(),
        }
    }

    /// Takes the manifold of this index, between these bodies, into a lane of the block and of its
    /// points.
    #[inline(always)]
    fn take(
        &mut self,
        lane: usize,
        bodies: [u32; 2],
        index: usize,
        rows: &impl Rows<L>,
        masses: &[InverseMass<f32, L, A>],
        points: &mut [Contact<V, L>],
    ) {
        if self.lanes == 0 {
            // Idle lanes read the bodies of the first, and are not written back. What a lane has
            // too few points for is so far open that it never takes an impulse.
            self.bodies = bodies.map(|body| [body; WIDTH]);
            self.end = 0;
            self.moving = [0; 2];
            self.masses = [InverseMass::default(); 2];
            self.manifold.frame = [Vector::ZERO; L];
            self.manifold.arms = [Vector::ZERO; 2];
            let mut open = Contact::default();
            open.gap[0] = splat(FAR);
            points.fill(open);
        }
        self.lanes += 1;
        for (side, body) in bodies.into_iter().enumerate() {
            self.bodies[side][lane] = body;
            self.end = self.end.max(body + 1);
            let mass = &masses[body as usize];
            if *mass == InverseMass::FIXED {
                continue;
            }
            self.moving[side] |= 1 << lane;
            self.masses[side].linear.set(lane, mass.linear);
            for i in 0..A {
                for j in i..A {
                    self.masses[side].angular.0[i][j].set(lane, mass.angular.0[i][j]);
                }
            }
        }
        rows.put(index, lane, &mut self.manifold, points);
    }

    /// Finds the effective masses of its points ([`Contact::prepare`]).
    #[inline(always)]
    pub(super) fn prepare(&mut self, points: &mut [Contact<V, L>], softness: V) {
        self.mobility = Mobility::of(&self.manifold, &self.masses);
        for contact in points {
            contact.prepare(&self.manifold, &self.mobility, softness);
        }
    }

    /// The manifold in a lane, without its points.
    pub(super) fn manifold_in(&self, lane: usize) -> Manifold<f32, L> {
        let wide = &self.manifold;
        Manifold {
            bodies: self.bodies.map(|side| side[lane]),
            frame: std::array::from_fn(|i| get(&wide.frame[i], lane)),
            arms: std::array::from_fn(|i| get(&wide.arms[i], lane)),
            friction: wide.friction.get(lane),
            restitution: wide.restitution.get(lane),
            compliance: wide.compliance.get(lane),
            first: 0,
            count: 0,
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
    rows: &impl Rows<L>,
    masses: &[InverseMass<f32, L, A>],
) {
    let start = blocks.first().map_or(0, |block| block.manifold.first as usize);
    for (index, (&place, (bodies, _))) in coloring.places.iter().zip(rows.outlines()).enumerate() {
        let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
        if let Some(block) = block.checked_sub(first).and_then(|at| blocks.get_mut(at)) {
            let Range { start: from, end } = block.manifold.points();
            let points = &mut contacts[from - start..end - start];
            block.take(lane, bodies, index, rows, masses, points);
        }
    }
}

pub(super) fn splat<V: Lanes>(value: f32) -> V {
    V::from_array([value; WIDTH])
}

/// What a lane of a contact has.
pub(super) fn contact_in<V: Lanes, const L: usize>(
    wide: &Contact<V, L>,
    lane: usize,
) -> Contact<f32, L> {
    Contact {
        place: get(&wide.place, lane),
        gap: get(&wide.gap, lane),
        target: get(&wide.target, lane),
        impulse: get(&wide.impulse, lane),
        impact: wide.impact.get(lane),
        effective_mass: wide.effective_mass.get(lane),
        tangential_mass: wide.tangential_mass.get(lane),
        compliance: wide.compliance.get(lane),
        tangential_compliance: wide.tangential_compliance.get(lane),
    }
}

#[inline(always)]
pub(super) fn get<V: Lanes, const N: usize>(wide: &Vector<V, N>, lane: usize) -> Vector<f32, N> {
    let mut out = Vector::ZERO;
    for i in 0..N {
        out[i] = wide[i].get(lane);
    }
    out
}

/// Puts a vector into a lane of a wide one.
#[inline(always)]
pub fn set<V: Lanes, const N: usize>(wide: &mut Vector<V, N>, lane: usize, of: &Vector<f32, N>) {
    for i in 0..N {
        wide[i].set(lane, of[i]);
    }
}
