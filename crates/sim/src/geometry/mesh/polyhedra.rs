//! Boxes and hulls as shapes that touch meshes.

use drystone_solver::{Vector, moment};

use super::solids::{BoundaryContact, ConvexShape, FaceOutline, PARALLEL, Sharp, feature};
use super::surface::UPRIGHT;
use super::{Corner, Frame, MeshPart, MeshQuery, Vec3};
use crate::geometry::solid::Polyhedron;

/// A box or a hull in the frame of a mesh.
pub(super) struct PolyhedronInMesh<'a, P> {
    pub(super) shape: &'a P,
    pub(super) frame: &'a Frame<3>,
}

impl<P: Polyhedron> ConvexShape for PolyhedronInMesh<'_, P> {
    fn vertices(&self, out: &mut Vec<Vec3>) {
        self.shape.vertices(out);
        for vertex in out {
            *vertex = self.frame.point(*vertex);
        }
    }

    fn planes(&self, out: &mut Vec<(Vec3, f32)>) {
        out.extend((0..self.shape.faces()).map(|own| {
            let (normal, vertex) = self.shape.face(own);
            let normal = self.frame.direction(normal);
            (normal, normal.dot(self.frame.point(vertex)))
        }));
    }

    fn bounds(&self, vertices: &[Vec3]) -> [Vec3; 3] {
        let (mut min, mut max) = (Vector([f32::INFINITY; 3]), Vector([f32::NEG_INFINITY; 3]));
        let mut center: Vec3 = Vector::ZERO;
        for vertex in vertices {
            center += *vertex;
            for i in 0..3 {
                min[i] = min[i].min(vertex[i]);
                max[i] = max[i].max(vertex[i]);
            }
        }
        [min, max, center * (1.0 / vertices.len() as f32)]
    }

    fn low(&self, direction: Vec3, vertices: &[Vec3]) -> f32 {
        let heights = vertices.iter().map(|vertex| direction.dot(*vertex));
        heights.fold(f32::INFINITY, f32::min)
    }

    fn facing(&self, direction: Vec3) -> usize {
        self.shape.facing(self.frame.local_direction(direction))
    }

    fn corners(&self, face: usize, _: Vec3, vertices: &[Vec3], out: &mut Vec<Corner<3>>) {
        let start = out.len();
        self.shape.corners(face, out);
        for corner in &mut out[start..] {
            corner.position = vertices[corner.feature as usize];
        }
    }

    fn within(
        &self,
        face: &FaceOutline<'_>,
        direction: Vec3,
        [from, along]: [Vec3; 2],
    ) -> Option<[f32; 2]> {
        let polygon = face.corners;
        let [mut first, mut last] = [0.0f32, 1.0f32];
        let turn = winding(polygon, direction);
        for (i, corner) in polygon.iter().enumerate() {
            let (start, end) = (corner.position, polygon[(i + 1) % polygon.len()].position);
            let outward: Vec3 = moment(end - start, direction);
            let outward = outward * turn;
            let (height, rise) = (outward.dot(from - start), outward.dot(along));
            if rise > 0.0 {
                last = last.min(-height / rise);
            } else if rise < 0.0 {
                first = first.max(-height / rise);
            } else if height > 0.0 {
                return None;
            }
        }
        (first < last).then_some([first, last])
    }

    fn covers(&self, face: &FaceOutline<'_>, direction: Vec3, location: Vec3) -> bool {
        let polygon = face.corners;
        let turn = winding(polygon, direction);
        (0..polygon.len()).all(|i| {
            let (start, end) = (polygon[i].position, polygon[(i + 1) % polygon.len()].position);
            let outward: Vec3 = moment(end - start, direction);
            turn * outward.dot(location - start) <= super::ON_EDGE * outward.dot(outward)
        })
    }

    fn rim(
        &self,
        sharp: Sharp<'_>,
        (vertices, faces): (&[Vec3], &[(Vec3, f32)]),
    ) -> Option<(f32, BoundaryContact)> {
        let (mut best, mut sharp) = (None, sharp);
        for own in 0..self.shape.edges() {
            if let Some((gap, rim)) = self.across(sharp, own, (vertices, faces)) {
                sharp.beat = gap;
                best = Some((gap, rim));
            }
        }
        best
    }
}

impl<P: Polyhedron> PolyhedronInMesh<'_, P> {
    /// Returns the contact of a mesh edge and an edge of the shape, with the gap along the axis
    /// across both. Returns `None` if the gap is not more than `beat` \[m\], or if the mesh or the
    /// shape does not admit the axis.
    #[inline]
    fn across(
        &self,
        Sharp { ahead, edge, line: [from, to], center, beat }: Sharp<'_>,
        own: usize,
        (vertices, faces): (&[Vec3], &[(Vec3, f32)]),
    ) -> Option<(f32, BoundaryContact)> {
        let MeshQuery { surface, prediction, .. } = ahead;
        let [start, end] = self.shape.ends(own).map(|end| vertices[end]);
        let apart = (0..3).any(|i| {
            start[i].min(end[i]) - prediction > from[i].max(to[i])
                || from[i].min(to[i]) - prediction > start[i].max(end[i])
        });
        if apart {
            return None;
        }
        let (along, other) = (to - from, end - start);
        let across: Vec3 = moment(along, other);
        let (squared, lengths) = (across.dot(across), along.dot(along) * other.dot(other));
        if squared <= PARALLEL * PARALLEL * lengths {
            return None;
        }
        // Point the axis away from the mesh: the opposite corners of the triangles are below.
        let apex = surface.wings(edge).first()?[0];
        let below = across.dot(surface.points[apex as usize] - from) <= 0.0;
        let direction = across * (if below { 1.0 } else { -1.0 } / squared.sqrt());
        let gap = direction.dot(start - from);
        if gap <= beat || gap > prediction || !surface.edge_gives(edge, direction) {
            return None;
        }
        // The axis must lie between the normals of both faces at the edge of the shape.
        let [one, two] = self.shape.flanks(own).map(|face| faces[face].0);
        let (both, a, b) = (one.dot(two), -one.dot(direction), -two.dot(direction));
        if a - both * b < 0.0 || b - both * a < 0.0 {
            return None;
        }
        let between = start - from;
        let (u, w) = (along.dot(along), other.dot(other));
        let (skew, p, q) = (along.dot(other), between.dot(along), between.dot(other));
        let s = (p * w - skew * q) / (u * w - skew * skew);
        let t = (skew * s - q) / w;
        let within = 0.0..=1.0;
        if !within.contains(&s) || !within.contains(&t) {
            return None;
        }
        let (on_mesh, on_shape) = (from + along * s, start + other * t);
        if direction.dot(center - on_mesh) <= 0.0 {
            return None;
        }
        let flat =
            self.shape.flanks(own).into_iter().find(|&own| -faces[own].0.dot(direction) > UPRIGHT);
        let locations = [Some((on_shape, on_mesh, feature(5, own as u64))), None];
        Some((gap, BoundaryContact { part: MeshPart::Edge(edge), direction, flat, locations }))
    }
}

/// Returns 1 if a polygon is counter-clockwise as seen from where a direction points, else -1.
fn winding(polygon: &[Corner<3>], direction: Vec3) -> f32 {
    let [first, ..] = polygon else { return 1.0 };
    let mut area: Vec3 = Vector::ZERO;
    for pair in polygon.windows(2) {
        area += moment(pair[0].position - first.position, pair[1].position - first.position);
    }
    if area.dot(direction) < 0.0 { -1.0 } else { 1.0 }
}
