//! [`Ray`]: where a ray enters a shape.
//!
//! A convex shape is an intersection of half-spaces, balls and infinite cylinders. The part of a
//! ray in it is the intersection of its parts in those ([`Span`]). A capsule is the union of two
//! balls and a cylinder.

use drystone_solver::Vector;

use super::Frame;
use super::solid::Solid;

/// A ray: the points origin + t direction with 0 <= t <= length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray<const L: usize> {
    /// Start. \[m\]
    pub origin: Vector<f32, L>,
    /// Unit vector.
    pub direction: Vector<f32, L>,
    /// Length; may be infinite. \[m\]
    pub length: f32,
}

/// The point at which a ray enters a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit<const L: usize> {
    /// Distance from the origin of the ray; 0 if the ray begins in the shape. \[m\]
    pub distance: f32,
    /// Unit normal of the surface on the side of the ray's origin; against the ray if it begins in
    /// the shape.
    pub normal: Vector<f32, L>,
}

impl<const L: usize> Ray<L> {
    /// Returns the ray in the coordinates of a frame.
    pub fn seen_from(&self, frame: &Frame<L>) -> Self {
        Self {
            origin: frame.local_point(self.origin),
            direction: frame.local_direction(self.direction),
            length: self.length,
        }
    }

    /// Returns the hit of a ray that begins in a shape.
    pub(super) fn start(&self) -> SurfaceHit<L> {
        SurfaceHit { distance: 0.0, normal: -self.direction }
    }

    /// Returns where it enters the half-space behind a plane through the origin of the coordinates.
    pub(super) fn on_halfspace(&self, normal: Vector<f32, L>) -> Option<SurfaceHit<L>> {
        let mut span = Span::new(self);
        span.cut_by_plane(Vector::ZERO, normal);
        span.entry()
    }

    /// Returns where it enters a solid with flat faces.
    pub(super) fn on_solid(&self, solid: &impl Solid<L>) -> Option<SurfaceHit<L>> {
        let mut span = Span::new(self);
        for face in 0..solid.faces() {
            let (normal, vertex) = solid.face(face);
            span.cut_by_plane(vertex, normal);
        }
        span.entry()
    }

    /// Returns where it enters a ball.
    pub(super) fn on_ball(&self, center: Vector<f32, L>, radius: f32) -> Option<SurfaceHit<L>> {
        let mut span = Span::new(self);
        span.cut_by_tube(center, Vector::ZERO, radius);
        span.entry()
    }

    /// Returns where it enters a cylinder between the centers of its caps.
    pub(super) fn on_tube(
        &self,
        [from, to]: [Vector<f32, L>; 2],
        radius: f32,
    ) -> Option<SurfaceHit<L>> {
        let length = (to - from).length();
        if length == 0.0 {
            return None;
        }
        let axis = (to - from) * (1.0 / length);
        let mut span = Span::new(self);
        span.cut_by_plane(from, -axis);
        span.cut_by_plane(to, axis);
        span.cut_by_tube(from, axis, radius);
        span.entry()
    }

    /// Returns where it enters a capsule about a segment. The ends may coincide.
    pub(super) fn on_capsule(
        &self,
        ends: [Vector<f32, L>; 2],
        radius: f32,
    ) -> Option<SurfaceHit<L>> {
        let [from, to] = ends.map(|end| self.on_ball(end, radius));
        let parts = [self.on_tube(ends, radius), from, to];
        parts.into_iter().flatten().min_by(|p, q| p.distance.total_cmp(&q.distance))
    }
}

/// The part of a ray in a convex shape: between its entry and its exit.
struct Span<'a, const L: usize> {
    ray: &'a Ray<L>,
    enter: SurfaceHit<L>,
    /// Distance at which the ray leaves the shape. \[m\]
    leave: f32,
}

impl<'a, const L: usize> Span<'a, L> {
    fn new(ray: &'a Ray<L>) -> Self {
        Self { ray, enter: ray.start(), leave: ray.length }
    }

    fn entry(self) -> Option<SurfaceHit<L>> {
        (self.enter.distance <= self.leave).then_some(self.enter)
    }

    /// Keeps the part between two distances. \[m\]
    fn keep(&mut self, from: f32, normal: Vector<f32, L>, to: f32) {
        if from > self.enter.distance {
            self.enter = SurfaceHit { distance: from, normal };
        }
        self.leave = self.leave.min(to);
    }

    /// Keeps nothing.
    fn clear(&mut self) {
        self.leave = f32::NEG_INFINITY;
    }

    /// Keeps the part behind a plane.
    fn cut_by_plane(&mut self, point: Vector<f32, L>, normal: Vector<f32, L>) {
        let height = normal.dot(self.ray.origin - point);
        let rate = normal.dot(self.ray.direction);
        if rate < 0.0 {
            self.keep(-height / rate, normal, f32::INFINITY);
        } else if rate > 0.0 {
            self.keep(0.0, normal, -height / rate);
        } else if height > 0.0 {
            self.clear();
        }
    }

    /// Keeps the part in an infinite cylinder about an axis through `center`. The axis is a unit
    /// vector, or zero for a ball.
    fn cut_by_tube(&mut self, center: Vector<f32, L>, axis: Vector<f32, L>, radius: f32) {
        let across = |v: Vector<f32, L>| v - axis * axis.dot(v);
        let (arm, way) = (across(self.ray.origin - center), across(self.ray.direction));
        let rate = way.dot(way);
        if rate == 0.0 {
            if arm.dot(arm) > radius * radius {
                self.clear();
            }
            return;
        }
        // The half chord follows from the nearest point: the textbook's b^2 - a c cancels.
        let middle = -arm.dot(way) / rate;
        let nearest = arm + way * middle;
        let squared = (radius * radius - nearest.dot(nearest)) / rate;
        if squared < 0.0 {
            return self.clear();
        }
        let half = squared.sqrt();
        let outward = nearest - way * half;
        let length = outward.length();
        let normal = if length > 0.0 { outward * (1.0 / length) } else { -self.ray.direction };
        self.keep(middle - half, normal, middle + half);
    }
}
