//! From records to the contact system: what the solver is given.

use drystone_solver::lanes::{Lanes, WIDTH, gathered};
use drystone_solver::wide::{FAR, Rows, Trace};
use drystone_solver::{Contact, Manifold, Vector, Velocity, contact_frame, each_lane};

use crate::cache::{self, Point, Record, Records};
use crate::certifier::Stiffness;

/// The records of a step of length `dt` \[s\] as manifolds.
pub(crate) struct RowsOf<'a, const L: usize, const A: usize> {
    pub(crate) records: &'a Records<L>,
    pub(crate) velocities: &'a [Velocity<f32, L, A>],
    pub(crate) stiffness: Stiffness<'a>,
    pub(crate) dt: f32,
    /// Whether all substeps are taken for everything at once.
    pub(crate) together: bool,
}

impl<const L: usize, const A: usize> Rows<L> for RowsOf<'_, L, A> {
    fn outlines(&self) -> impl Iterator<Item = ([u32; 2], u32)> {
        self.records.manifolds.iter().map(|record| (record.bodies, record.count))
    }

    fn kept(&self, manifold: u32) -> Option<u32> {
        let before = self.records.kept[manifold as usize];
        (before != cache::NEW).then_some(before)
    }

    fn stands(&self, body: u32) -> bool {
        !self.together && self.velocities[body as usize] == Velocity::ZERO
    }

    #[inline(always)]
    fn take<V: Lanes>(
        &self,
        manifolds: &[u32; WIDTH],
        bodies: &[[u32; WIDTH]; 2],
        moving: [u16; 2],
        manifold: &mut Manifold<V, L>,
        points: &mut [Contact<V, L>],
    ) {
        let records = each_lane!(lane => &self.records.manifolds[manifolds[lane] as usize]);
        let kept = each_lane!(lane => self.records.kept[manifolds[lane] as usize]);
        let turned = V::from_array(each_lane!(lane => f32::from(kept[lane] == cache::NEW)));
        manifold.frame = contact_frame(gathered(each_lane!(lane => &records[lane].normal)));
        let traced = contact_frame(gathered(each_lane!(lane => &records[lane].traced)));
        let before = Manifold { frame: traced, ..*manifold };
        manifold.friction = V::from_array(each_lane!(lane => records[lane].friction));
        manifold.restitution = V::from_array(each_lane!(lane => records[lane].restitution));
        manifold.compliance =
            V::from_array(each_lane!(lane => self.stiffness.compliance(records[lane].bodies)));
        let mut sum = Vector::ZERO;
        for (index, contact) in points.iter_mut().enumerate() {
            let own = each_lane!(lane => self.point(records[lane], index));
            contact.place = gathered(each_lane!(lane => &own[lane].0.middle));
            sum += contact.place;
            contact.gap = gathered(each_lane!(lane => &own[lane].1.gap));
            contact.impulse = gathered(each_lane!(lane => &own[lane].1.impulse));
            let mut slip = contact.gap;
            slip[0] = V::ZERO;
            let slip = manifold.to_frame(before.to_world(slip));
            let impulse = manifold.to_frame(before.to_world(contact.impulse));
            for i in 1..L {
                contact.gap[i] = turned.choose(slip[i], contact.gap[i]);
            }
            for i in 0..L {
                contact.impulse[i] = turned.choose(impulse[i], contact.impulse[i]);
            }
            contact.impulse[0] = contact.impulse[0].max(V::ZERO);
        }
        let center = sum * V::from_array(each_lane!(lane => records[lane].share));
        for contact in points {
            contact.place = manifold.to_frame(contact.place - center);
        }
        let apart = gathered(each_lane!(lane => &records[lane].apart));
        manifold.arms = [center - apart, center];
        if moving != [u16::MAX; 2] {
            self.carry(bodies, moving, &mut manifold.arms);
        }
    }
}

impl<const L: usize, const A: usize> RowsOf<'_, L, A> {
    /// A point of a record and its trace; one that is not there is far away.
    #[inline(always)]
    fn point(&self, record: &Record<L>, index: usize) -> (&Point<L>, &Trace<L>) {
        if index < record.count as usize {
            let at = record.first as usize + index;
            (&self.records.points[at], &self.records.traces[at])
        } else {
            const { (&Point::OPEN, &cache::open(FAR)) }
        }
    }

    /// A body that carries others round gives them the velocity of where they are at half the step; that of
    /// the start would throw them outward.
    #[inline(always)]
    fn carry<V: Lanes>(
        &self,
        bodies: &[[u32; WIDTH]; 2],
        moving: [u16; 2],
        arms: &mut [Vector<V, L>; 2],
    ) {
        let [a, b] = bodies;
        let of = self.velocities;
        let v_a: Vector<V, L> = gathered(each_lane!(lane => &of[a[lane] as usize].linear));
        let v_b: Vector<V, L> = gathered(each_lane!(lane => &of[b[lane] as usize].linear));
        let half = V::from_f64(f64::from(0.5 * self.dt));
        for (side, ahead) in [v_b - v_a, v_a - v_b].into_iter().enumerate() {
            let fixed = each_lane!(lane => f32::from(!moving[side] >> lane & 1));
            let fixed = V::from_array(fixed);
            arms[side] += (ahead * half).only_if(fixed);
        }
    }
}
