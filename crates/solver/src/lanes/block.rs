//! [`Block`]: sixteen manifolds in lanes, and the velocities of their bodies. A [`ManifoldSource`]
//! provides the manifolds; a [`CachedImpulse`] is what a point leaves for the next step.
#![allow(unsafe_code)]

use super::coloring::{Coloring, LaneMap, Reuse};
use super::number::gather;
use super::{GatherLanes, KernelLanes, Lanes, Row, WIDTH, lanes_of};
use crate::island::NONE;
use crate::pgs::is_center;
use crate::thread_pool::DisjointSlice;
use crate::{
    ConstraintFrame, Contact, InverseMass, Manifold, Mobility, Real, System, Vector, Velocity,
    each_lane,
};

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

    /// Returns whether all manifolds are to be one batch. Sums over manifolds then do not depend on
    /// the batches of earlier calls. The default is `false`.
    fn is_whole(&self) -> bool {
        false
    }

    /// Returns the pairs of bodies that joints couple: they are to be in one batch. If they change,
    /// so do the [keys](Self::same_keys). The default is none.
    fn couplings(&self) -> &[[u32; 2]] {
        &[]
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

/// Largest number of points in a block whose lanes are read one by one.
const FEW: usize = 8;

/// Largest number of lanes that are read one by one; beyond it, reading all together is faster.
const SINGLY: u32 = 5;

/// Up to sixteen manifolds, no two of which move the same body.
#[derive(Clone, Debug)]
#[repr(C)]
pub(crate) struct Block<V: KernelLanes, const L: usize, const A: usize> {
    /// Half of the change of J^T gamma from the renewal of J, where bodies rotate: the momenta that a
    /// gains and b loses before velocities are solved. \[N s, N m s\]
    pub(super) lag: [Velocity<V, L, A>; 2],
    pub(super) masses: [InverseMass<V, L, A>; 2],
    pub(super) mobility: Mobility<V, L, A>,
    /// The `bodies` of this manifold have no meaning, since each lane has its own.
    pub(super) manifold: Manifold<V, L>,
    pub(super) bodies: [[u32; WIDTH]; 2],
    /// Range of the bodies of its batch, which contains all its `bodies`.
    pub(super) reach: [u32; 2],
    pub(super) islands: [u32; WIDTH],
    /// Lanes in use, as bits.
    pub(super) used: u16,
    /// For each side, the lanes whose body can be moved, as bits.
    pub(super) moving: [u16; 2],
    /// For each side, the lanes whose body is in another batch, as bits. Such a body has zero
    /// velocity, and `bodies` names the other body of the manifold in its place.
    pub(super) away: [u16; 2],
    /// True if each manifold has a single point, at its center.
    pub(super) center: bool,
    /// True if J has been renewed.
    pub(super) renewed: bool,
}

impl<V: Lanes, const L: usize, const A: usize> Block<V, L, A> {
    pub(super) fn empty() -> Self {
        Self {
            used: 0,
            bodies: [[0; WIDTH]; 2],
            reach: [0, 1],
            moving: [0; 2],
            away: [0; 2],
            islands: [NONE; WIDTH],
            center: false,
            renewed: false,
            lag: [Velocity::ZERO; 2],
            masses: [InverseMass::default(); 2],
            mobility: Mobility::default(),
            manifold: Manifold::default(),
        }
    }

    /// Assigns new manifolds to stale lanes, and bodies of the batch to idle lanes.
    pub(super) fn seat(&mut self, members: &LaneMap, coloring: &Coloring) {
        let LaneMap { used, stale, manifolds } = members;
        let batch = coloring.key(manifolds[0]).batch;
        let own = coloring.division.bodies(usize::from(batch));
        self.reach = [own.start, own.end].map(|body| body as u32);
        let [first, end] = self.reach;
        let is_own = |body: u32| body.wrapping_sub(first) < end - first;
        let (changed, mut moving, mut away) = (*stale | !*used, [0; 2], [0; 2]);
        for lane in lanes_of(changed) {
            let key = coloring.key(manifolds[lane]);
            for side in 0..2 {
                let mut body = key.bodies[side];
                if !is_own(body) {
                    body = key.bodies[1 - side];
                    assert!(is_own(body), "a manifold of the batch");
                    away[side] |= 1 << lane;
                }
                self.bodies[side][lane] = body;
                moving[side] |= u16::from(key.moving[side]) << lane;
            }
        }
        for side in 0..2 {
            // Idle lanes are not written back.
            self.moving[side] = (self.moving[side] & !changed | moving[side]) & used;
            self.away[side] = self.away[side] & !changed | away[side];
        }
        self.used = *used;
    }

    /// Returns the bodies of each side, including those of other batches.
    #[inline(always)]
    fn bodies_of(&self, members: &LaneMap, coloring: &Coloring) -> [[u32; WIDTH]; 2] {
        let mut out = self.bodies;
        for side in 0..2 {
            for lane in lanes_of(self.away[side]) {
                out[side][lane] = coloring.key(members.manifolds[lane]).bodies[side];
            }
        }
        out
    }

    /// Reads the stale manifolds and their points.
    #[inline(always)]
    pub(super) fn take(
        &mut self,
        members: &LaneMap,
        coloring: &Coloring,
        rows: &impl ManifoldSource<L>,
        masses: &[InverseMass<f32, L, A>],
        points: &mut [Contact<V, L>],
    ) {
        let before = std::mem::replace(&mut self.manifold.count, points.len() as u32) as usize;
        let (manifolds, bodies, moving) =
            (&members.manifolds, &self.bodies_of(members, coloring), self.moving);
        let all = LaneSlots { manifolds, bodies, moving, lanes: members.used, first: 0 };
        let stale = members.stale & members.used;
        if stale.count_ones() > SINGLY || stale == members.used || points.len() > FEW {
            for side in 0..2 {
                take_masses(&mut self.masses[side], masses, &all, side);
            }
            // All other data is read, or follows from it.
            for contact in &mut *points {
                (contact.target, contact.impact) = (Vector::ZERO, V::ZERO);
            }
            rows.take(&all, &mut self.manifold, points);
            clear(points, !members.used);
            return;
        }
        debug_assert!(points.len() <= before, "no points are new to those that stay");
        clear(points, members.stale & !members.used);
        for lane in lanes_of(stale) {
            let seat = LaneSlots { lanes: 1 << lane, first: lane, ..all };
            for side in 0..2 {
                let mut mass = InverseMass::default();
                take_masses::<f32, L, A>(&mut mass, masses, &seat, side);
                set_mass(&mut self.masses[side], lane, &mass);
            }
            let (mut manifold, mut contacts) = (Manifold::default(), [Contact::default(); FEW]);
            let contacts = &mut contacts[..points.len()];
            rows.take::<f32>(&seat, &mut manifold, contacts);
            set_manifold(&mut self.manifold, lane, &manifold);
            for (wide, own) in points.iter_mut().zip(contacts) {
                set_contact(wide, lane, own);
            }
        }
    }

    /// Updates W of the bodies in the lanes where `turns` is positive. `masses` are those of the bodies
    /// from index `first` on.
    #[inline(always)]
    pub(super) fn take_turned(
        &mut self,
        first: usize,
        masses: &[InverseMass<f32, L, A>],
        turns: V,
    ) {
        let still = InverseMass::FIXED;
        for side in 0..2 {
            let of = V::each(|lane| match self.away[side] >> lane & 1 {
                0 => &masses[self.bodies[side][lane] as usize - first],
                _ => &still,
            });
            for i in 0..A {
                let row = V::each(|lane| &of[lane].angular.0[i]);
                let own = &mut self.masses[side].angular.0[i];
                *own = choose(turns, V::gathered_vector(row), *own);
            }
        }
    }

    /// Computes the effective masses of its points ([`Contact::prepare`]).
    #[inline(always)]
    pub(super) fn prepare(&mut self, points: &mut [Contact<V, L>], softness: V) {
        self.center = is_center(points);
        if self.center {
            self.prepare_felt::<0>(points, softness);
        } else {
            self.prepare_felt::<A>(points, softness);
        }
    }

    /// Computes the effective masses of points that feel `B` components of rotation
    /// ([`ConstraintFrame::twist_felt`]).
    #[inline(always)]
    fn prepare_felt<const B: usize>(&mut self, points: &mut [Contact<V, L>], softness: V) {
        self.mobility.set_felt::<B>(&self.manifold.frame, &self.masses);
        for contact in points {
            contact.prepare_felt::<A, B>(&self.manifold, &self.mobility, softness);
        }
    }

    /// Returns the manifold in a lane, without its points. It is between these bodies.
    pub(super) fn manifold_in(&self, lane: usize, bodies: [u32; 2]) -> Manifold<f32, L> {
        let wide = &self.manifold;
        Manifold {
            bodies,
            frame: ConstraintFrame {
                axes: std::array::from_fn(|i| get(&wide.frame.axes[i], lane)),
                arms: std::array::from_fn(|i| get(&wide.frame.arms[i], lane)),
            },
            friction: wide.friction.get(lane),
            restitution: wide.restitution.get(lane),
            compliance: wide.compliance.get(lane),
            radii: wide.radii.map(|of| of.get(lane)),
            normal_share: wide.normal_share.map(|of| of.get(lane)),
            first: 0,
            count: 0,
        }
    }

    /// Returns the bodies of each lane.
    ///
    /// # Panics
    /// A body is in another batch.
    pub(super) fn pairs(&self) -> [[u32; 2]; WIDTH] {
        assert_eq!(self.away, [0; 2], "manifolds within one batch");
        let [a, b] = &self.bodies;
        std::array::from_fn(|lane| [a[lane], b[lane]])
    }

    /// Returns the island of all its manifolds, if it is the same.
    #[inline(always)]
    pub(super) fn island(&self) -> Option<u32> {
        let [first, ..] = self.islands;
        self.islands.iter().fold(true, |one, of| one & (*of == first)).then_some(first)
    }

    /// Returns the lanes that an iteration visits, as bits: none if all islands are done. Islands that are done
    /// go along with their neighbors, manifolds without an island do not.
    #[inline(always)]
    pub(super) fn due_lanes(&self, done: &[bool]) -> u16 {
        let is_open = |island: u32| done.get(island as usize) == Some(&false);
        match self.island() {
            Some(island) => u16::from(is_open(island)) * self.used,
            None if self.islands.iter().any(|&island| is_open(island)) => {
                let has_island = self.islands.map(|island| (island as usize) < done.len());
                (0..).zip(has_island).fold(0, |all, (lane, own)| all | u16::from(own) << lane)
            }
            None => 0,
        }
    }
}

impl<V: Lanes, const L: usize, const A: usize> Block<V, L, A> {
    /// Returns the velocities, or other such data, of the bodies in each lane. `from` begins with
    /// body `first`.
    #[inline(always)]
    pub(super) fn gather_from(
        &self,
        first: usize,
        from: &[Velocity<f32, L, A>],
    ) -> [Velocity<V, L, A>; 2] {
        // SAFETY: the slice is borrowed, so nobody changes it.
        unsafe { self.gather(&DisjointSlice::reading(first, from)) }
    }

    /// Returns the velocities of the bodies in each lane.
    ///
    /// # Safety
    /// Nobody changes the velocities of its bodies at the same time.
    #[inline(always)]
    pub(super) unsafe fn gather<C: KernelLanes>(
        &self,
        from: &DisjointSlice<'_, Velocity<f32, L, A>>,
    ) -> [Velocity<C, L, A>; 2] {
        self.check(from);
        // SAFETY: just checked, and as the caller promises.
        unsafe { [self.gather_side(0, from), self.gather_side(1, from)] }
    }

    /// # Safety
    /// The conditions of `gather` hold, and the bodies have been checked.
    #[inline(always)]
    unsafe fn gather_side<C: KernelLanes>(
        &self,
        side: usize,
        from: &DisjointSlice<'_, Velocity<f32, L, A>>,
    ) -> Velocity<C, L, A> {
        let bodies = &self.bodies[side];
        let mut numbers = [C::ZERO; 8];
        let at = each_lane!(lane => from.place(bodies[lane]).cast::<f32>().cast_const());
        // SAFETY: as the caller promises. A velocity takes up whole rows, which are the fastest to
        // read.
        unsafe { gather(at, &mut numbers[..(L + A).max(4)]) };
        if self.away[side] != 0 {
            self.stop(side, &mut numbers[..L + A]);
        }
        let mut out = Velocity::ZERO;
        out.linear.0.copy_from_slice(&numbers[..L]);
        out.angular.0.copy_from_slice(&numbers[L..L + A]);
        out
    }

    /// Sets the velocities of bodies in other batches to zero; they are those of the other bodies
    /// of their manifolds.
    #[inline(always)]
    fn stop<C: KernelLanes>(&self, side: usize, numbers: &mut [C]) {
        let mut away = [0.0; WIDTH];
        for (lane, own) in away.iter_mut().enumerate() {
            *own = f32::from(self.away[side] >> lane & 1);
        }
        let away = C::from_array(away);
        for number in numbers {
            *number = away.choose(C::ZERO, *number);
        }
    }

    /// Checks that the bodies of the block are in a slice, since lanes are read and written
    /// unchecked.
    ///
    /// # Panics
    /// Some are not.
    #[inline(always)]
    pub(super) fn check(&self, of: &DisjointSlice<'_, Velocity<f32, L, A>>) {
        const { assert!(size_of::<Velocity<f32, L, A>>() >= size_of::<Row>() * (L + A).div_ceil(4)) };
        let [first, end] = self.reach.map(|body| body as usize);
        of.check(first..end);
    }
}

/// Returns `new` in the lanes where `by` is positive, else `old`.
#[inline(always)]
pub(super) fn choose<V: Lanes, const N: usize>(
    by: V,
    new: Vector<V, N>,
    old: Vector<V, N>,
) -> Vector<V, N> {
    Vector(std::array::from_fn(|i| by.choose(new[i], old[i])))
}

/// Sets a lane of a wide vector.
pub(super) fn set<V: Lanes, const N: usize>(
    wide: &mut Vector<V, N>,
    lane: usize,
    of: &Vector<f32, N>,
) {
    for i in 0..N {
        wide[i].set(lane, of[i]);
    }
}

/// Sets a lane of a wide M^-1.
#[inline(always)]
fn set_mass<V: Lanes, const L: usize, const A: usize>(
    wide: &mut InverseMass<V, L, A>,
    lane: usize,
    own: &InverseMass<f32, L, A>,
) {
    wide.linear.set(lane, own.linear);
    for i in 0..A {
        set(&mut wide.angular.0[i], lane, &own.angular.0[i]);
    }
}

/// Sets a lane of a wide manifold to the data that [`ManifoldSource::take`] reads.
#[inline(always)]
fn set_manifold<V: Lanes, const L: usize>(
    wide: &mut Manifold<V, L>,
    lane: usize,
    own: &Manifold<f32, L>,
) {
    for i in 0..L {
        set(&mut wide.frame.axes[i], lane, &own.frame.axes[i]);
    }
    for side in 0..2 {
        set(&mut wide.frame.arms[side], lane, &own.frame.arms[side]);
    }
    wide.friction.set(lane, own.friction);
    wide.restitution.set(lane, own.restitution);
    wide.compliance.set(lane, own.compliance);
    for side in 0..2 {
        wide.radii[side].set(lane, own.radii[side]);
        wide.normal_share[side].set(lane, own.normal_share[side]);
    }
}

/// Sets `place`, `gap`, `impulse` and `impact` of a point in a lane.
#[inline(always)]
fn set_contact<V: Lanes, const L: usize>(
    wide: &mut Contact<V, L>,
    lane: usize,
    own: &Contact<f32, L>,
) {
    set(&mut wide.offset, lane, &own.offset);
    set(&mut wide.gap, lane, &own.gap);
    set(&mut wide.impulse, lane, &own.impulse);
    wide.impact.set(lane, own.impact);
}

/// Opens the points in idle lanes. Otherwise their data would keep changing, towards subnormal
/// numbers, which are slow on some processors.
#[inline(always)]
fn clear<V: Lanes, const L: usize>(points: &mut [Contact<V, L>], idle: u16) {
    for lane in lanes_of(idle) {
        for contact in &mut *points {
            set(&mut contact.gap, lane, &open::<f32, L>().gap);
            set(&mut contact.impulse, lane, &Vector::ZERO);
        }
    }
}

/// Returns an absent point.
fn open<T: Real, const L: usize>() -> Contact<T, L> {
    let mut contact = Contact::default();
    contact.gap[0] = T::from_f64(f64::from(FAR));
    contact
}

/// Reads M^-1 of the bodies on a side.
#[inline(always)]
fn take_masses<V: GatherLanes, const L: usize, const A: usize>(
    wide: &mut InverseMass<V, L, A>,
    masses: &[InverseMass<f32, L, A>],
    seats: &LaneSlots<'_>,
    side: usize,
) {
    let of = V::each(|lane| &masses[seats.body(side, lane)]);
    wide.linear = V::gathered(V::each(|lane| of[lane].linear));
    for i in 0..A {
        wide.angular.0[i] = V::gathered_vector(V::each(|lane| &of[lane].angular.0[i]));
    }
}

pub(super) fn splat<V: KernelLanes>(value: f32) -> V {
    V::from_array([value; WIDTH])
}

/// Returns the contact in a lane.
pub(super) fn contact_in<V: Lanes, const L: usize>(
    wide: &Contact<V, L>,
    lane: usize,
) -> Contact<f32, L> {
    Contact {
        offset: get(&wide.offset, lane),
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
