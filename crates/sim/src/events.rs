//! [`Touching`] and [`PairImpulse`]: the contacts of a step as games, sounds and dust need them,
//! without a copy of the contact system.

use drystone_solver::Vector;

use crate::cache::Pair;
use crate::geometry::Geometry;
use crate::ids::{BodyId, ColliderId};
use crate::impulses::PairSum;
use crate::world::World;

/// Two colliders that touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touching<const L: usize> {
    /// Bodies a and b.
    pub bodies: [BodyId; 2],
    /// Their colliders.
    pub colliders: [ColliderId; 2],
    /// Unit normal, from b towards a.
    pub normal: Vector<f32, L>,
    /// World position midway between the surfaces, at the deepest point. \[m\]
    pub point: Vector<f32, L>,
    /// Distance between the surfaces at that point, negative where they overlap. \[m\]
    pub gap: f32,
    /// Sum of the normal impulses of all substeps of the last step, impacts included, if steps
    /// record them ([`World::record_impulses`]). It is 0 in steps that both bodies sleep through.
    /// \[N s\]
    pub impulse: f32,
}

/// Normal impulses between two colliders in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairImpulse<const L: usize> {
    /// Bodies a and b.
    pub bodies: [BodyId; 2],
    /// Their colliders.
    pub colliders: [ColliderId; 2],
    /// Unit normal, from b towards a: the mean of those of the contact points, weighted by
    /// impulses. Zero if they cancel.
    pub normal: Vector<f32, L>,
    /// World position: the mean of the contact points, weighted by impulses, each on the surface
    /// of the body that moved less. \[m\]
    pub point: Vector<f32, L>,
    /// Sum over contact points and substeps, impacts included; positive. \[N s\]
    pub impulse: f32,
    /// Largest speed at which the surfaces approach each other at one of the contact points, with
    /// the velocities before the step. \[m/s\]
    pub speed: f32,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Turns the recording of impulses for [`World::touching`] and [`World::impulses`] on or off.
    /// It is off by default: then a step takes its islands one after the other through all
    /// substeps, which is faster.
    pub fn record_impulses(&mut self, recording: bool) {
        self.execution.recording = recording;
        self.scratch.impulses.pairs.clear();
    }

    /// Returns the colliders that touched at the end of the last step, or pushed each other in it,
    /// sleepers included. One entry for each pair of colliders, in the order of their slots.
    pub fn touching(&self) -> impl Iterator<Item = Touching<L>> + '_ {
        self.contacts.pairs.iter().filter_map(|pair| self.touching_of(pair))
    }

    /// Returns the impulses of the last step, also those of colliders that have parted since, if
    /// steps record them ([`World::record_impulses`]). One entry for each pair of colliders that
    /// pushed each other, in the order of their slots; none for sleepers.
    pub fn impulses(&self) -> impl Iterator<Item = PairImpulse<L>> + '_ {
        self.scratch.impulses.pairs.iter().filter_map(|PairSum { colliders, bodies, sum }| {
            let colliders = colliders.map(|slot| self.collider_at(slot as usize));
            let bodies = bodies.map(|slot| self.body_at(slot as usize));
            let ([Some(p), Some(q)], [Some(a), Some(b)]) = (colliders, bodies) else {
                return None;
            };
            (sum.impulse > 0.0).then(|| PairImpulse {
                bodies: [a, b],
                colliders: [p, q],
                normal: sum.normal(),
                point: sum.point(),
                impulse: sum.impulse,
                speed: sum.speed,
            })
        })
    }

    fn touching_of(&self, pair: &Pair) -> Option<Touching<L>> {
        let cache = if pair.is_sleeping { &self.sleep.cache } else { &self.contacts.cache };
        let view = cache.view();
        let [a, b] = pair.bodies.map(|body| &self.bodies.frames[body as usize]);
        let (mut deepest, mut is_pressed) = (None, false);
        for manifold in view.of(pair.manifolds()) {
            for (point, cached) in view.points_of(manifold).iter().zip(view.impulses_of(manifold)) {
                is_pressed |= cached.impulse[0] > 0.0;
                let gap = cached.gap[0];
                if deepest.is_none_or(|(_, _, least)| gap < least) {
                    let point = (a.point(point.on_a) + b.point(point.on_b)) * 0.5;
                    deepest = Some((manifold.normal, point, gap));
                }
            }
        }
        let (normal, point, gap) = deepest?;
        let impulse = self.scratch.impulses.of(pair.colliders).map_or(0.0, |sum| sum.impulse);
        let touches = gap <= 0.0 || is_pressed || impulse > 0.0;
        let colliders = pair.colliders.map(|slot| self.collider_at(slot as usize));
        let bodies = pair.bodies.map(|slot| self.body_at(slot as usize));
        let ([Some(p), Some(q)], [Some(a), Some(b)]) = (colliders, bodies) else { return None };
        touches.then_some(Touching {
            bodies: [a, b],
            colliders: [p, q],
            normal,
            point,
            gap,
            impulse,
        })
    }
}
