//! Cylinders as shapes that touch meshes. Their faces are the caps.

use drystone_solver::Vector;

use super::solids::{BoundaryContact, ConvexShape, FaceOutline, Sharp, feature};
use super::surface::UPRIGHT;
use super::{Corner, MeshPart, MeshQuery, Vec3};
use crate::geometry::cylinders::{PosedCylinder, STEEP, in_disc, within};

/// Points of an edge within this fraction of its length from an end count as the vertex there.
/// \[1\]
const END: f32 = 1e-5;

/// A cylinder in the frame of a mesh.
pub(super) struct CylinderInMesh {
    pub(super) cylinder: PosedCylinder,
    /// The feature of a contact point of the step before.
    pub(super) before: Option<u64>,
}

impl CylinderInMesh {
    /// Moves a point along a direction to the plane of a cap.
    fn lifted(
        cap: &FaceOutline<'_>,
        direction: Vec3,
        middle: Vec3,
        location: Vec3,
    ) -> Option<Vec3> {
        let slope = cap.normal.dot(direction);
        let by = cap.normal.dot(middle - location) / slope;
        (slope.abs() > STEEP).then(|| location + direction * by)
    }
}

impl ConvexShape for CylinderInMesh {
    fn vertices(&self, _: &mut Vec<Vec3>) {}

    fn planes(&self, out: &mut Vec<(Vec3, f32)>) {
        let caps = self.cylinder.caps();
        out.extend(caps.map(|(normal, middle)| (normal, normal.dot(middle))));
    }

    fn bounds(&self, _: &[Vec3]) -> [Vec3; 3] {
        let center = self.cylinder.center();
        let unit = |i: usize| Vector(std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }));
        let reach = Vector(std::array::from_fn(|i| self.cylinder.extent(unit(i))));
        [center - reach, center + reach, center]
    }

    fn low(&self, direction: Vec3, _: &[Vec3]) -> f32 {
        direction.dot(self.cylinder.center()) - self.cylinder.extent(direction)
    }

    fn facing(&self, direction: Vec3) -> usize {
        let [(normal, _), _] = self.cylinder.caps();
        usize::from(normal.dot(direction) < 0.0)
    }

    fn corners(&self, _: usize, normal: Vec3, _: &[Vec3], out: &mut Vec<Corner<3>>) {
        let facing = self.cylinder.facing(normal, self.before);
        out.extend(facing.points().map(|(position, name)| Corner::new(position, name)));
    }

    fn line(&self, normal: Vec3) -> Option<[Vec3; 2]> {
        self.cylinder.facing(normal, None).line()
    }

    fn within(
        &self,
        cap: &FaceOutline<'_>,
        direction: Vec3,
        [from, along]: [Vec3; 2],
    ) -> Option<[f32; 2]> {
        let (_, middle) = self.cylinder.caps()[cap.face];
        let lifted = |location| Self::lifted(cap, direction, middle, location);
        let [start, end] = [lifted(from)?, lifted(from + along)?];
        let [first, last] = in_disc(start - middle, end - start, self.cylinder.disc());
        (first < last).then_some([first, last])
    }

    fn covers(&self, cap: &FaceOutline<'_>, direction: Vec3, location: Vec3) -> bool {
        let (_, middle) = self.cylinder.caps()[cap.face];
        let lifted = Self::lifted(cap, direction, middle, location);
        lifted.is_some_and(|location| within(location - middle, self.cylinder.disc()))
    }

    fn beside(&self, corners: [Vec3; 3]) -> f32 {
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
        (_, faces): (&[Vec3], &[(Vec3, f32)]),
    ) -> Option<(f32, BoundaryContact)> {
        let MeshQuery { surface, prediction, .. } = ahead;
        let line = surface.ends(edge);
        if self.cylinder.is_beyond(line, prediction) {
            return None;
        }
        let mut best = None;
        for found in self.cylinder.nearest_features(line) {
            let (gap, direction) = (found.gap, -found.normal);
            let end =
                if found.part < END { Some(0) } else { (found.part > 1.0 - END).then_some(1) };
            let (part, gives) = match end {
                Some(end) => {
                    let vertex = surface.edges[edge as usize].ends[end];
                    let sharp = surface.vertices[vertex as usize].sharp;
                    (MeshPart::Vertex(vertex), sharp && surface.vertex_gives(vertex, direction))
                }
                None => (MeshPart::Edge(edge), surface.edge_gives(edge, direction)),
            };
            let on_mesh = line[0] + (line[1] - line[0]) * found.part;
            let front = direction.dot(center - on_mesh) > 0.0;
            if gap <= beat || gap > prediction || !gives || !front {
                continue;
            }
            beat = gap;
            let flat = (0..2).find(|&cap| -faces[cap].0.dot(direction) > UPRIGHT);
            let mut number = 0;
            let locations =
                self.cylinder.contact_points_on(line, &found, prediction).map(|locations| {
                    number += 1;
                    locations.map(|[on_a, on_b]| (on_a, on_b, feature(6, number)))
                });
            best = Some((gap, BoundaryContact { part, direction, flat, locations }));
        }
        best
    }

    fn radius(&self, normal: Vec3) -> f32 {
        self.cylinder.rounding_radius(normal)
    }
}
