//! Cylinders as shapes that touch meshes. Their faces are the caps.

use drystone_solver::Vector;

use super::solids::{Outline, Rim, Shape, Sharp, feature};
use super::surface::UPRIGHT;
use super::{Corner, MeshQuery, Part, V};
use crate::geometry::cylinders::{Placed, STEEP, in_disc, within};

/// Points of an edge within this fraction of its length from an end count as the vertex there.
/// \[1\]
const END: f32 = 1e-5;

/// A cylinder in the frame of a mesh.
pub(super) struct Seen {
    pub(super) cylinder: Placed,
    /// The feature of a contact point of the step before.
    pub(super) before: Option<u64>,
}

impl Seen {
    /// Moves a point along a direction to the plane of a cap.
    fn lifted(cap: &Outline<'_>, direction: V, middle: V, place: V) -> Option<V> {
        let slope = cap.normal.dot(direction);
        let by = cap.normal.dot(middle - place) / slope;
        (slope.abs() > STEEP).then(|| place + direction * by)
    }
}

impl Shape for Seen {
    fn vertices(&self, _: &mut Vec<V>) {}

    fn planes(&self, out: &mut Vec<(V, f32)>) {
        let caps = self.cylinder.caps();
        out.extend(caps.map(|(normal, middle)| (normal, normal.dot(middle))));
    }

    fn bounds(&self, _: &[V]) -> [V; 3] {
        let center = self.cylinder.center();
        let unit = |i: usize| Vector(std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }));
        let reach = Vector(std::array::from_fn(|i| self.cylinder.extent(unit(i))));
        [center - reach, center + reach, center]
    }

    fn low(&self, direction: V, _: &[V]) -> f32 {
        direction.dot(self.cylinder.center()) - self.cylinder.extent(direction)
    }

    fn facing(&self, direction: V) -> usize {
        let [(normal, _), _] = self.cylinder.caps();
        usize::from(normal.dot(direction) < 0.0)
    }

    fn corners(&self, _: usize, normal: V, _: &[V], out: &mut Vec<Corner<3>>) {
        let facing = self.cylinder.facing(normal, self.before);
        out.extend(facing.points().map(|(position, name)| Corner::new(position, name)));
    }

    fn line(&self, normal: V) -> Option<[V; 2]> {
        self.cylinder.facing(normal, None).line()
    }

    fn within(&self, cap: &Outline<'_>, direction: V, [from, along]: [V; 2]) -> Option<[f32; 2]> {
        let (_, middle) = self.cylinder.caps()[cap.face];
        let lifted = |place| Self::lifted(cap, direction, middle, place);
        let [start, end] = [lifted(from)?, lifted(from + along)?];
        let [first, last] = in_disc(start - middle, end - start, self.cylinder.disc());
        (first < last).then_some([first, last])
    }

    fn covers(&self, cap: &Outline<'_>, direction: V, place: V) -> bool {
        let (_, middle) = self.cylinder.caps()[cap.face];
        let lifted = Self::lifted(cap, direction, middle, place);
        lifted.is_some_and(|place| within(place - middle, self.cylinder.disc()))
    }

    fn beside(&self, corners: [V; 3]) -> f32 {
        let at = corners.map(|corner| self.cylinder.seen_along(corner));
        let (mut left, mut right, mut least) = (false, false, f32::INFINITY);
        for k in 0..3 {
            let ([x, y], [u, v]) = (at[k], at[(k + 1) % 3]);
            let (along, turn) = ([u - x, v - y], x * v - y * u);
            left |= turn > 0.0;
            right |= turn < 0.0;
            let squared = along[0] * along[0] + along[1] * along[1];
            let part = -(x * along[0] + y * along[1]) / squared.max(f32::MIN_POSITIVE);
            let part = part.clamp(0.0, 1.0);
            let [x, y] = [x + along[0] * part, y + along[1] * part];
            least = least.min(x * x + y * y);
        }
        // The axis passes through the triangle.
        if left != right { f32::NEG_INFINITY } else { least.sqrt() - self.cylinder.disc().sqrt() }
    }

    fn rim(
        &self,
        Sharp { ahead, edge, center, mut beat, .. }: Sharp<'_>,
        (_, faces): (&[V], &[(V, f32)]),
    ) -> Option<(f32, Rim)> {
        let MeshQuery { surface, prediction, .. } = ahead;
        let line = surface.ends(edge);
        if self.cylinder.is_beyond(line, prediction) {
            return None;
        }
        let mut best = None;
        for found in self.cylinder.ways_to(line) {
            let (gap, direction) = (found.gap, -found.normal);
            let end =
                if found.part < END { Some(0) } else { (found.part > 1.0 - END).then_some(1) };
            let (part, gives) = match end {
                Some(end) => {
                    let vertex = surface.edges[edge as usize].ends[end];
                    let sharp = surface.vertices[vertex as usize].sharp;
                    (Part::Vertex(vertex), sharp && surface.vertex_gives(vertex, direction))
                }
                None => (Part::Edge(edge), surface.edge_gives(edge, direction)),
            };
            let on_mesh = line[0] + (line[1] - line[0]) * found.part;
            let front = direction.dot(center - on_mesh) > 0.0;
            if gap <= beat || gap > prediction || !gives || !front {
                continue;
            }
            beat = gap;
            let flat = (0..2).find(|&cap| -faces[cap].0.dot(direction) > UPRIGHT);
            let mut number = 0;
            let places = self.cylinder.places_on(line, &found, prediction).map(|places| {
                number += 1;
                places.map(|[on_a, on_b]| (on_a, on_b, feature(6, number)))
            });
            best = Some((gap, Rim { part, direction, flat, places }));
        }
        best
    }

    fn radius(&self, normal: V) -> f32 {
        self.cylinder.roundness(normal)
    }
}
