//! What goes into a packed system, [`ManifoldSource`], and what comes out, [`CachedImpulse`].

use crate::color::Reuse;
use crate::lanes::{GatherLanes, WIDTH};
use crate::{Contact, Manifold, Real, System, Vector};

/// Manifolds and their points, to be packed.
pub trait ManifoldSource<const L: usize>: Sync {
    /// How many manifolds there are.
    fn count(&self) -> usize;

    /// The bodies of a manifold and how many points it has.
    fn key(&self, manifold: u32) -> ([u32; 2], u32);

    /// Whether the keys are those of the last time, and need not be gone through. By default they
    /// may be others.
    fn same_keys(&self) -> bool {
        false
    }

    /// What a manifold was the time before. By default all are new.
    fn reuse(&self, manifold: u32) -> Reuse {
        let _ = manifold;
        Reuse::New
    }

    /// Whether a body that cannot be moved does not move at all: its manifolds can be in several batches. By
    /// default none is known to.
    fn stands(&self, body: u32) -> bool {
        let _ = body;
        false
    }

    /// Takes manifolds to their seats, and their points, place, gap and impulse, to `points`, which are as many
    /// or more: one that is not there is [`FAR`] open.
    fn take<V: GatherLanes>(
        &self,
        seats: &LaneSlots<'_>,
        manifold: &mut Manifold<V, L>,
        points: &mut [Contact<V, L>],
    );
}

/// Where manifolds are taken to: into all lanes of a block, or one of them.
#[derive(Clone, Copy, Debug)]
pub struct LaneSlots<'a> {
    pub(super) manifolds: &'a [u32; WIDTH],
    pub(super) bodies: &'a [[u32; WIDTH]; 2],
    /// Of each side, the lanes whose body can be moved, as bits.
    pub(super) moving: [u16; 2],
    /// The lanes in question, as bits, and the first of them.
    pub(super) lanes: u16,
    pub(super) first: usize,
}

impl LaneSlots<'_> {
    /// The number of the manifold of a lane. Lanes count from the first.
    #[inline(always)]
    pub fn manifold(&self, lane: usize) -> usize {
        self.manifolds[self.first + lane] as usize
    }

    /// The body on a side of it.
    #[inline(always)]
    pub fn body(&self, side: usize, lane: usize) -> usize {
        self.bodies[side][self.first + lane] as usize
    }

    /// Whether that can be moved.
    #[inline(always)]
    pub fn moves(&self, side: usize, lane: usize) -> bool {
        self.moving[side] >> (self.first + lane) & 1 != 0
    }

    /// Whether all bodies can be moved.
    #[inline(always)]
    pub fn all_move(&self) -> bool {
        self.moving[0] & self.moving[1] & self.lanes == self.lanes
    }
}

/// What a point hands to the next step, in the frame of its manifold ([`Contact`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct CachedImpulse<const L: usize> {
    /// gamma. \[N s\]
    pub impulse: Vector<f32, L>,
    /// After the step; of the slip what friction holds. \[m\]
    pub gap: Vector<f32, L>,
}

/// The gap of a point that is not there: so far open that it never takes an impulse. \[m\]
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
            manifold.frame[i] = V::gathered_vector(V::each(|lane| &own[lane].frame[i]));
        }
        for side in 0..2 {
            manifold.arms[side] = V::gathered_vector(V::each(|lane| &own[lane].arms[side]));
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
            contact.place = V::gathered_vector(V::each(|lane| &own[lane].place));
            contact.gap = V::gathered_vector(V::each(|lane| &own[lane].gap));
            contact.impulse = V::gathered_vector(V::each(|lane| &own[lane].impulse));
        }
    }
}

/// A point that is not there.
pub(super) fn open<T: Real, const L: usize>() -> Contact<T, L> {
    let mut contact = Contact::default();
    contact.gap[0] = T::from_f64(f64::from(FAR));
    contact
}
