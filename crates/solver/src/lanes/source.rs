//! Input of a packed system, [`ManifoldSource`], and its output, [`CachedImpulse`].

use super::coloring::Reuse;
use super::{GatherLanes, WIDTH};
use crate::{Contact, Manifold, Real, System, Vector};

/// A source of manifolds and their points, to be packed.
pub trait ManifoldSource<const L: usize>: Sync {
    /// Returns the number of manifolds.
    fn count(&self) -> usize;

    /// Returns the bodies of a manifold and its number of points.
    fn key(&self, manifold: u32) -> ([u32; 2], u32);

    /// Returns whether the keys are those of the last call and need not be read. The default is
    /// `false`.
    fn same_keys(&self) -> bool {
        false
    }

    /// Returns the state of a manifold relative to the last call. By default all manifolds are new.
    fn reuse(&self, manifold: u32) -> Reuse {
        let _ = manifold;
        Reuse::New
    }

    /// Returns whether a body that cannot be moved has zero velocity. The manifolds of such a body
    /// can be in several batches. The default is `false`.
    fn stands(&self, body: u32) -> bool {
        let _ = body;
        false
    }

    /// Reads manifolds into the lanes `seats`, and `place`, `gap` and `impulse` of their points
    /// into `points`. There may be more `points` than a manifold has; an absent point has the gap
    /// [`FAR`].
    fn take<V: GatherLanes>(
        &self,
        seats: &LaneSlots<'_>,
        manifold: &mut Manifold<V, L>,
        points: &mut [Contact<V, L>],
    );
}

/// Lanes into which manifolds are read: all lanes of a block, or one of them.
#[derive(Clone, Copy, Debug)]
pub struct LaneSlots<'a> {
    pub(super) manifolds: &'a [u32; WIDTH],
    pub(super) bodies: &'a [[u32; WIDTH]; 2],
    /// For each side, the lanes whose body can be moved, as bits.
    pub(super) moving: [u16; 2],
    /// The lanes, as bits, and the first of them.
    pub(super) lanes: u16,
    pub(super) first: usize,
}

impl LaneSlots<'_> {
    /// Returns the index of the manifold in a lane. Lanes are counted from the first one.
    #[inline(always)]
    pub fn manifold(&self, lane: usize) -> usize {
        self.manifolds[self.first + lane] as usize
    }

    /// Returns the body on a side of this manifold.
    #[inline(always)]
    pub fn body(&self, side: usize, lane: usize) -> usize {
        self.bodies[side][self.first + lane] as usize
    }

    /// Returns whether this body can be moved.
    #[inline(always)]
    pub fn moves(&self, side: usize, lane: usize) -> bool {
        self.moving[side] >> (self.first + lane) & 1 != 0
    }

    /// Returns whether all bodies can be moved.
    #[inline(always)]
    pub fn all_move(&self) -> bool {
        self.moving[0] & self.moving[1] & self.lanes == self.lanes
    }
}

/// Data that a point passes to the next step, in the frame of its manifold ([`Contact`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct CachedImpulse<const L: usize> {
    /// gamma. \[N s\]
    pub impulse: Vector<f32, L>,
    /// Gap after the step. The slip is at most what friction holds. \[m\]
    pub gap: Vector<f32, L>,
}

/// Gap of an absent point, so wide that the point never gets an impulse. \[m\]
pub const FAR: f32 = 1e6;

impl<const L: usize, const A: usize> ManifoldSource<L> for System<f32, L, A> {
    fn count(&self) -> usize {
        self.manifolds.len()
    }

    fn key(&self, manifold: u32) -> ([u32; 2], u32) {
        let manifold = &self.manifolds[manifold as usize];
        (manifold.bodies, manifold.count)
    }

    #[inline(always)]
    fn take<V: GatherLanes>(
        &self,
        seats: &LaneSlots<'_>,
        manifold: &mut Manifold<V, L>,
        points: &mut [Contact<V, L>],
    ) {
        let own = V::each(|lane| &self.manifolds[seats.manifold(lane)]);
        for i in 0..L {
            manifold.frame.axes[i] = V::gathered_vector(V::each(|lane| &own[lane].frame.axes[i]));
        }
        for side in 0..2 {
            let arms = V::each(|lane| &own[lane].frame.arms[side]);
            manifold.frame.arms[side] = V::gathered_vector(arms);
        }
        manifold.friction = V::gathered(V::each(|lane| own[lane].friction));
        manifold.restitution = V::gathered(V::each(|lane| own[lane].restitution));
        manifold.compliance = V::gathered(V::each(|lane| own[lane].compliance));
        for side in 0..2 {
            manifold.radii[side] = V::gathered(V::each(|lane| own[lane].radii[side]));
            manifold.normal_share[side] = V::gathered(V::each(|lane| own[lane].normal_share[side]));
        }
        let open = open();
        for (index, contact) in points.iter_mut().enumerate() {
            let own = V::each(|lane| self.contacts[own[lane].points()].get(index).unwrap_or(&open));
            contact.offset = V::gathered_vector(V::each(|lane| &own[lane].offset));
            contact.gap = V::gathered_vector(V::each(|lane| &own[lane].gap));
            contact.impulse = V::gathered_vector(V::each(|lane| &own[lane].impulse));
        }
    }
}

/// Returns an absent point.
pub(super) fn open<T: Real, const L: usize>() -> Contact<T, L> {
    let mut contact = Contact::default();
    contact.gap[0] = T::from_f64(f64::from(FAR));
    contact
}
