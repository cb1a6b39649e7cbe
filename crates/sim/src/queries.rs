//! Queries between steps: the colliders in a box, at a point, and on a ray.
//!
//! The tree of the broad phase finds candidates, whose shapes are then tested at the current poses
//! of their bodies. The world does not change.

use drystone_solver::Vector;

use crate::broad_phase::BoxIndex;
use crate::geometry::{Bounds, Geometry, Ray, SurfaceHit};
use crate::ids::{BodyId, ColliderId};
use crate::input::{self, InputError};
use crate::world::World;

/// Relative rounding error of distances. \[1\]
const ROUNDING: f32 = 1e-6;

/// The point at which a ray enters a collider ([`World::cast_ray`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit<const L: usize> {
    /// The body.
    pub body: BodyId,
    /// Its collider.
    pub collider: ColliderId,
    /// World position. \[m\]
    pub point: Vector<f32, L>,
    /// Unit normal of the surface on the side of the ray's origin; against the ray if it begins in
    /// the collider.
    pub normal: Vector<f32, L>,
    /// Distance from the origin of the ray; 0 if the ray begins in the collider. \[m\]
    pub distance: f32,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Finds colliders by their boxes ([`World::colliders_in_box`]).
    pub(crate) fn find_in_box(&self, bounds: &Bounds<L>) -> Result<Vec<ColliderId>, InputError> {
        input::check_box(bounds)?;
        let near = self.near(bounds).into_iter();
        Ok(near.filter_map(|shape| self.collider_at(shape)).collect())
    }

    /// Finds colliders that contain a point ([`World::colliders_at`]).
    pub(crate) fn find_at(&self, point: Vector<f32, L>) -> Result<Vec<ColliderId>, InputError> {
        input::check_point(&point)?;
        let direction = Vector(std::array::from_fn(|i| if i == 0 { 1.0 } else { 0.0 }));
        // A ray of no length meets the shapes that it begins in.
        let ray = Ray { origin: point, direction, length: 0.0 };
        let near = self.near(&Bounds { min: point, max: point });
        let holds = |shape: &usize| {
            !G::is_open(&self.colliders.shapes[*shape]) && self.hit(*shape, &ray).is_some()
        };
        Ok(near.into_iter().filter(holds).filter_map(|shape| self.collider_at(shape)).collect())
    }

    /// Finds the first hit of a ray ([`World::cast_ray_where`]).
    pub(crate) fn first_hit(
        &self,
        origin: Vector<f32, L>,
        direction: Vector<f32, L>,
        max_distance: f32,
        accepts: &dyn Fn(ColliderId) -> bool,
    ) -> Result<Option<RayHit<L>>, InputError> {
        let length = input::check_ray(&origin, &direction, max_distance)?;
        let unit = Vector(direction.0.map(|x| (f64::from(x) / length) as f32));
        let mut ray = Ray { origin, direction: unit, length: max_distance };
        let mut best: Option<RayHit<L>> = None;
        self.current_boxes().cast(&mut ray, |shape, ray| {
            let Some(id) = self.collider_at(shape as usize).filter(|id| accepts(*id)) else {
                return;
            };
            let found = self.hit(shape as usize, ray).zip(self.body_of(id));
            let Some((SurfaceHit { distance, normal }, body)) = found else { return };
            // Among equal distances the lowest slot counts, in whichever order they are found.
            let is_first = best
                .is_none_or(|best| (distance, id.index()) < (best.distance, best.collider.index()));
            if is_first {
                let point = ray.origin + ray.direction * distance;
                best = Some(RayHit { body, collider: id, point, normal, distance });
                ray.length = distance;
            }
        });
        Ok(best)
    }

    fn current_boxes(&self) -> BoxIndex<'_, L> {
        let Self { bodies, colliders, broad_phase, .. } = self;
        broad_phase.index(|| colliders.outside(bodies, broad_phase))
    }

    /// Returns the colliders whose boxes at their current poses overlap this box, in order.
    fn near(&self, bounds: &Bounds<L>) -> Vec<usize> {
        let mut near = Vec::new();
        self.current_boxes().visit(bounds, |shape| near.push(shape as usize));
        let overlaps =
            |shape: &usize| self.colliders.current_bounds(&self.bodies, *shape).overlaps(bounds);
        near.retain(overlaps);
        near.sort_unstable();
        near
    }

    /// Returns where a ray enters a collider. The distance is measured from a point of the ray near
    /// the collider, so that it is as exact for origins that are far away.
    fn hit(&self, shape: usize, ray: &Ray<L>) -> Option<SurfaceHit<L>> {
        let (colliders, bodies) = (&self.colliders, &self.bodies);
        let (collider, pose) = (&colliders.shapes[shape], colliders.current_pose(bodies, shape));
        let origin = ray.origin - bodies.frames[colliders.body[shape] as usize].position;
        let own = G::shape_of(collider);
        let skipped = if G::extent(own).is_some() {
            let Bounds { min, max } = G::bounds(own, &pose);
            let middle = ray.direction.dot((min + max) * 0.5 - origin);
            (middle - (max - min).length()).max(0.0)
        } else {
            0.0
        };
        let (origin, length) = (origin + ray.direction * skipped, ray.length - skipped);
        let near = Ray { origin, length: (length + ROUNDING * ray.length).max(0.0), ..*ray };
        let hit = G::cast_ray(collider, &pose, &near)?;
        let distance = skipped + hit.distance;
        (distance <= ray.length).then_some(SurfaceHit { distance, ..hit })
    }
}
