//! [`Touching`]: the contacts of a step as games and sounds need them, without a copy of the
//! contact system.

use drystone_solver::Vector;

use crate::cache::Pair;
use crate::geometry::Geometry;
use crate::ids::{BodyId, ColliderId};
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

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Turns the recording of impulses for [`World::touching`] on or off. It is off by default:
    /// then a step takes its islands one after the other through all substeps, which is faster.
    pub fn record_impulses(&mut self, recording: bool) {
        self.execution.recording = recording;
        self.scratch.pair_impulses.clear();
    }

    /// Returns the colliders that touched at the end of the last step, or pushed each other in it,
    /// sleepers included. One entry for each pair of colliders, in the order of their slots.
    pub fn touching(&self) -> impl Iterator<Item = Touching<L>> + '_ {
        self.contacts.pairs.iter().filter_map(|pair| self.touching_of(pair))
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
        let recorded = &self.scratch.pair_impulses;
        let found = recorded.binary_search_by_key(&pair.colliders, |(colliders, _)| *colliders);
        let impulse = found.map_or(0.0, |at| recorded[at].1);
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
