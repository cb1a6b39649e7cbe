//! Converts cached manifolds to the rows of the contact system, the input of the solver.

use drystone_solver::lanes::GatherLanes;
use drystone_solver::lanes::{CachedImpulse, FAR, LaneSlots, ManifoldSource, Reuse};
use drystone_solver::{ConstraintFrame, Contact, Manifold, Vector, Velocity, contact_frame};

use crate::cache::{self, CachedManifold, CachedPoint, ManifoldCache};
use crate::certifier::Stiffness;
use crate::geometry::MAX_POINTS;

/// Weight of a point in the mean of as many points as the index. \[1\]
const SHARES: [f32; MAX_POINTS + 1] = [0.0, 1.0, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0];

/// The cached manifolds of a step as a source of solver manifolds.
pub(crate) struct CacheSource<'a, const L: usize, const A: usize> {
    pub(crate) cache: &'a ManifoldCache<L>,
    pub(crate) velocities: &'a [Velocity<f32, L, A>],
    pub(crate) stiffness: Stiffness<'a>,
    /// Pairs of bodies that joints couple.
    pub(crate) couplings: &'a [[u32; 2]],
    /// True for bodies whose M^-1 has changed since their rows were read; empty without joints.
    pub(crate) renewed: &'a [bool],
    /// True if these are the manifolds of the step before, with as many points.
    pub(crate) same: bool,
    /// True if all bodies take their substeps together.
    pub(crate) whole_system: bool,
    /// True if the manifolds must be in order, so that sums over them do not depend on contacts
    /// that have come and gone.
    pub(crate) in_order: bool,
}

impl<const L: usize, const A: usize> ManifoldSource<L> for CacheSource<'_, L, A> {
    fn count(&self) -> usize {
        self.cache.manifolds.len()
    }

    fn key(&self, manifold: u32) -> ([u32; 2], u32) {
        let cached = &self.cache.manifolds[manifold as usize];
        (cached.bodies, cached.count)
    }

    fn same_keys(&self) -> bool {
        self.same
    }

    #[inline(always)]
    fn reuse(&self, manifold: u32) -> Reuse {
        let reuse = self.cache.reuse[manifold as usize];
        let bodies = || self.cache.manifolds[manifold as usize].bodies;
        let moved = self.in_order && !self.same;
        let is_renewed = |body: u32| self.renewed.get(body as usize) == Some(&true);
        let anew = moved
            || self.stiffness.changes() && self.stiffness.is_new(bodies())
            || !self.renewed.is_empty() && bodies().into_iter().any(is_renewed);
        if anew { reuse.changed() } else { reuse }
    }

    fn stands(&self, body: u32) -> bool {
        !self.whole_system && self.velocities[body as usize] == Velocity::ZERO
    }

    fn is_whole(&self) -> bool {
        self.in_order
    }

    fn couplings(&self) -> &[[u32; 2]] {
        self.couplings
    }

    #[inline(always)]
    fn take<V: GatherLanes>(
        &self,
        seats: &LaneSlots<'_>,
        manifold: &mut Manifold<V, L>,
        points: &mut [Contact<V, L>],
    ) {
        let cache = V::each(|lane| &self.cache.manifolds[seats.manifold(lane)]);
        let kept = |lane| matches!(self.cache.reuse[seats.manifold(lane)], Reuse::Kept(_));
        let turned = V::gathered(V::each(|lane| f32::from(!kept(lane))));
        let normal = V::gathered_vector(V::each(|lane| &cache[lane].normal));
        manifold.frame.axes = contact_frame(normal);
        let impulse_normal = V::gathered_vector(V::each(|lane| &cache[lane].impulse_normal));
        let before = ConstraintFrame { axes: contact_frame(impulse_normal), ..manifold.frame };
        manifold.friction = V::gathered(V::each(|lane| cache[lane].friction));
        manifold.restitution = V::gathered(V::each(|lane| cache[lane].restitution));
        for side in 0..2 {
            let surfaces = |lane: usize| cache[lane].surfaces;
            manifold.radii[side] = V::gathered(V::each(|lane| surfaces(lane).radii[side]));
            let normal_share = |lane| surfaces(lane).normal.shares()[side];
            manifold.normal_share[side] = V::gathered(V::each(normal_share));
        }
        let compliance = |lane| self.stiffness.compliance(cache[lane].bodies);
        manifold.compliance = V::gathered(V::each(compliance));
        let mut sum = Vector::ZERO;
        for (index, contact) in points.iter_mut().enumerate() {
            let own = V::each(|lane| self.point(cache[lane], index));
            contact.offset = V::gathered_vector(V::each(|lane| &own[lane].0.push_point));
            sum += contact.offset;
            contact.gap = V::gathered_vector(V::each(|lane| &own[lane].1.gap));
            contact.impulse = V::gathered_vector(V::each(|lane| &own[lane].1.impulse));
            let mut slip = contact.gap;
            slip[0] = V::ZERO;
            let slip = manifold.frame.to_frame(before.to_world(slip));
            let impulse = manifold.frame.to_frame(before.to_world(contact.impulse));
            for i in 1..L {
                contact.gap[i] = turned.choose(slip[i], contact.gap[i]);
            }
            for i in 0..L {
                contact.impulse[i] = turned.choose(impulse[i], contact.impulse[i]);
            }
            contact.impulse[0] = contact.impulse[0].max(V::ZERO);
        }
        // The center is in the plane of the first point, which is the deepest: open points exert no
        // force.
        let mean = sum * V::gathered(V::each(|lane| SHARES[cache[lane].count as usize]));
        let center = match points {
            [] => mean,
            [first, ..] => mean + normal * normal.dot(first.offset - mean),
        };
        for contact in points {
            contact.offset = manifold.frame.to_frame(contact.offset - center);
            contact.offset[0] = V::ZERO;
        }
        let center_offset = V::gathered_vector(V::each(|lane| &cache[lane].center_offset));
        manifold.frame.arms = [center - center_offset, center];
    }
}

impl<const L: usize, const A: usize> CacheSource<'_, L, A> {
    /// Returns a point of a manifold and its cached impulse. Points beyond its count are open.
    #[inline(always)]
    fn point(
        &self,
        cached: &CachedManifold<L>,
        index: usize,
    ) -> (&CachedPoint<L>, &CachedImpulse<L>) {
        if index < cached.count as usize {
            let at = cached.first as usize + index;
            (&self.cache.points[at], &self.cache.impulses[at])
        } else {
            const { (&CachedPoint::OPEN, &cache::open(FAR)) }
        }
    }
}

#[cfg(test)]
mod tests {
    use drystone_solver::lanes::LaneSystem;
    use drystone_solver::{InverseMass, System};

    use super::*;
    use crate::certifier::Certifier;
    use crate::settings::StepSettings;

    /// Points are projected to the plane of the first, about the mean of the push points. A point
    /// that is open by half a meter has no effect above that plane.
    #[test]
    fn points_lie_in_the_plane_of_the_deepest() {
        let mut cache: ManifoldCache<3> = ManifoldCache::default();
        let (cached, points, impulses) = cache.add(2);
        let slanted = Vector([0.6, 0.8, 0.0]);
        (cached.bodies, cached.normal, cached.impulse_normal) = ([0, 1], slanted, slanted);
        for (at, height) in [0.25, 0.5].into_iter().enumerate() {
            points[at].push_point = slanted * height + Vector([-0.8, 0.6, 0.0]) * height;
            impulses[at].gap[0] = 2.0 * height - 0.5;
        }
        let moves = InverseMass { linear: 1.0, ..InverseMass::FIXED };
        let mut system: System<f32, 3, 3> = System::new();
        system.masses = vec![moves; 2];
        system.velocities = vec![Velocity::ZERO; 2];
        let mut certifier: Certifier<3, 3> = Certifier::default();
        let rows = CacheSource {
            renewed: &[],
            cache: &cache,
            velocities: &system.velocities,
            stiffness: certifier.no_stiffness(),
            couplings: &[],
            same: false,
            whole_system: true,
            in_order: false,
        };
        let mut lanes = LaneSystem::new();
        lanes.pack(&rows, &system.masses, 0.0);
        lanes.unpack(&mut system);
        let (manifold, contacts) = (&system.manifolds[0], &system.contacts);
        let [_, arm] = manifold.frame.arms.map(|arm| manifold.frame.to_frame(arm));
        assert!((arm[0] - 0.25).abs() < 1e-6, "{arm:?}");
        assert!(contacts.iter().all(|contact| contact.offset[0] == 0.0), "{contacts:?}");
        let sum = contacts[0].offset + contacts[1].offset;
        let apart = (contacts[0].offset - contacts[1].offset).length();
        assert!(sum.length() < 1e-6 && (apart - 0.25).abs() < 1e-6, "{contacts:?}");
    }

    /// A kept manifold is gathered again if its stiffness has changed. It is also gathered again if
    /// manifolds must be in order and some have come or gone.
    #[test]
    fn kept_manifolds_keep_their_stiffness_and_order() {
        let mut cache: ManifoldCache<3> = ManifoldCache::default();
        cache.add(1).0.bodies = [0, 1];
        cache.reuse[0] = Reuse::Kept(0);
        let moves = InverseMass { linear: 1.0, ..InverseMass::FIXED };
        let mut certifier: Certifier<3, 3> = Certifier::default();
        certifier.find_islands(&[InverseMass::FIXED, moves], cache.pairs());
        let settings = StepSettings::certified();
        let mut reuse = |h, [same, in_order]: [bool; 2]| {
            let stiffness = certifier.stiffness(cache.pairs(), |_| [10.0, 1.0], &settings, h);
            let (cache, velocities): (_, &[Velocity<f32, 3, 3>]) = (&cache, &[]);
            let (couplings, whole_system) = (&[], true);
            let rows = CacheSource {
                renewed: &[],
                cache,
                velocities,
                stiffness,
                couplings,
                same,
                whole_system,
                in_order,
            };
            rows.reuse(0)
        };
        let found = [
            (0.01, [true, true]),
            (0.01, [true, true]),
            (0.005, [true, true]),
            (0.005, [true, true]),
            (0.005, [false, false]),
            (0.005, [false, true]),
        ];
        let (kept, changed) = (Reuse::Kept(0), Reuse::Changed(0));
        let found = found.map(|(h, flags)| reuse(h, flags));
        assert_eq!(found, [changed, kept, changed, kept, kept, changed]);
    }
}
