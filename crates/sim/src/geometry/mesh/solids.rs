//! Contact of boxes, hulls and cylinders ([`ConvexShape`]) with triangle meshes.

use std::ops::Range;

use drystone_solver::{Vector, moment};

use super::surface::{Beyond, MeshFace, UPRIGHT};
use super::{Above, Corner, Gathered, ManifoldPoint, MeshPart, MeshQuery, Vec3, add};
use crate::geometry::ContactManifold;
use crate::geometry::polyhedra::{PREFERENCE, edge_beyond};

/// Contact points over a face represent the contact of the whole shape if they have at least this
/// fraction of its overlap. \[1\]
const MOST: f32 = 0.5;

/// Planes and lines at an angle whose sine is less than this count as parallel. \[1\]
pub(super) const PARALLEL: f32 = 1e-2;

/// A mesh edge lies on a face if the sine of the angle between them is less than this. \[1\]
const ALONG: f32 = 0.032;

/// Returns the feature of a contact point from its kind and its number.
pub(super) fn feature(kind: u64, number: u64) -> u64 {
    kind << 40 | number
}

/// A convex shape in the frame of a mesh. Its faces are flat; those of a cylinder are its caps.
pub(super) trait ConvexShape {
    /// Appends its vertices, if it has any.
    fn vertices(&self, out: &mut Vec<Vec3>);

    /// Appends the outward normal of each face, and the offset of its plane along the normal.
    /// \[1, m\]
    fn planes(&self, out: &mut Vec<(Vec3, f32)>);

    /// Returns the smallest and the largest coordinates, and the center. \[m\]
    fn bounds(&self, vertices: &[Vec3]) -> [Vec3; 3];

    /// Returns the height of its lowest point along a direction. \[m\]
    fn low(&self, direction: Vec3, vertices: &[Vec3]) -> f32;

    /// Returns the face whose normal is closest to a direction.
    fn facing(&self, direction: Vec3) -> usize;

    /// Appends the points of the shape that can touch a plane with this normal: of a polyhedron,
    /// the corners of `face`.
    fn corners(&self, face: usize, normal: Vec3, vertices: &[Vec3], out: &mut Vec<Corner<3>>);

    /// Returns the line on which the shape lies on a plane with this normal: its start, and the
    /// vector to its end. Only cylinders have one.
    fn line(&self, normal: Vec3) -> Option<[Vec3; 2]> {
        let _ = normal;
        None
    }

    /// Returns the range of a line, from 0 to 1, that is within a face as seen along a direction.
    /// The line is given by its start and the vector to its end.
    fn within(&self, face: &FaceOutline<'_>, direction: Vec3, line: [Vec3; 2]) -> Option<[f32; 2]>;

    /// True if a point is within a face as seen along a direction.
    fn covers(&self, face: &FaceOutline<'_>, direction: Vec3, location: Vec3) -> bool;

    /// Returns the distance of a triangle from the curved side of the shape, across its axis;
    /// negative infinity if it has none. \[m\]
    fn beside(&self, corners: [Vec3; 3]) -> f32 {
        let _ = corners;
        f32::NEG_INFINITY
    }

    /// Finds the best axis between the shape and a mesh edge, or an end of it, that both admit.
    /// Returns its gap \[m\], or `None` if no gap is larger than `sharp.beat`. `seen` holds the
    /// shape's own vertices and planes.
    fn rim(
        &self,
        sharp: Sharp<'_>,
        seen: (&[Vec3], &[(Vec3, f32)]),
    ) -> Option<(f32, BoundaryContact)>;

    /// Returns its radius of curvature at a contact with this normal. \[m\]
    fn radius(&self, normal: Vec3) -> f32 {
        let _ = normal;
        0.0
    }
}

/// A face of a shape.
pub(super) struct FaceOutline<'a> {
    /// Index of the face.
    pub(super) face: usize,
    /// Outward unit normal.
    pub(super) normal: Vec3,
    /// Its corners, in order around it. For a cap: the points that can touch a plane.
    pub(super) corners: &'a [Corner<3>],
}

/// A sharp edge of a mesh.
#[derive(Clone, Copy)]
pub(super) struct Sharp<'a> {
    pub(super) ahead: MeshQuery<'a>,
    pub(super) edge: u32,
    /// Its ends, in the winding order of a triangle.
    pub(super) line: [Vec3; 2],
    /// Center of the shape.
    pub(super) center: Vec3,
    /// Gap along the best axis so far, which has to be exceeded. \[m\]
    pub(super) beat: f32,
}

/// Contact of a shape with an edge or a vertex of a mesh.
#[derive(Clone, Copy)]
pub(super) struct BoundaryContact {
    pub(super) part: MeshPart,
    /// Unit vector out of the mesh.
    pub(super) direction: Vec3,
    /// The face of the shape whose normal is opposite to it, if there is one.
    pub(super) flat: Option<usize>,
    /// Contact points on the shape and on the mesh, with their features.
    pub(super) locations: [Option<(Vec3, Vec3, u64)>; 2],
}

/// A shape close to a mesh.
struct SolidQuery<'a, S: ConvexShape> {
    ahead: MeshQuery<'a>,
    shape: &'a S,
    center: Vec3,
}

/// Axis of the largest gap between a triangle and a shape, other than the triangle's normal.
#[derive(Clone, Copy)]
enum MeshAxis {
    /// A face of the shape, and the mesh vertex that is deepest below it.
    Face(usize, u32),
    BoundaryContact(BoundaryContact),
}

/// Collects the contacts of a shape with a mesh, up to a gap of `prediction`, in the frame of the
/// mesh. Returns a lower bound of the gap. \[m\]
pub(super) fn gather(
    ahead: MeshQuery<'_>,
    shape: &impl ConvexShape,
    tree: &parry3d::partitioning::Bvh,
    gathered: &mut Gathered,
) -> f32 {
    gathered.clear();
    gathered.vertices.clear();
    gathered.faces.clear();
    shape.vertices(&mut gathered.vertices);
    let [min, max, center] = shape.bounds(&gathered.vertices);
    let reach = Vector([ahead.prediction; 3]);
    let near = parry3d::bounding_volume::Aabb::new((min - reach).0.into(), (max + reach).0.into());
    gathered.near.extend(tree.intersect_aabb(&near));
    let meeting = SolidQuery { ahead, shape, center };
    let (mut apart, mut inside) = (ahead.prediction, false);
    for at in 0..gathered.near.len() {
        let index = gathered.near[at];
        if let Some(face) = &ahead.surface.faces[index as usize] {
            apart = apart.min(meeting.collide_face(face, gathered, &mut inside));
        }
    }
    meeting.keep_genuine(gathered);
    if inside {
        meeting.push_out(gathered);
    }
    apart
}

impl<S: ConvexShape> SolidQuery<'_, S> {
    /// Collects the contacts of the shape with a triangle. Returns a lower bound of their gap.
    /// \[m\] Sets `behind` if the center is behind a face that has one side.
    fn collide_face(&self, face: &MeshFace, gathered: &mut Gathered, behind: &mut bool) -> f32 {
        let MeshQuery { surface, prediction, .. } = self.ahead;
        let facet = &surface.facets[face.facet as usize];
        let (side, hidden) = self.ahead.side(facet, self.center);
        let above = self.above(face.facet, side, gathered);
        let low = gathered.facets[above].low;
        if low > prediction {
            return low;
        }
        *behind |= hidden;
        let own = if hidden { f32::NEG_INFINITY } else { low };
        if !face.sharp[usize::from(side < 0.0)] {
            if !hidden {
                self.on_facet(face, above, true, gathered);
            }
            return low;
        }
        self.see_faces(gathered);
        let ((most, outermost), best) = self.farthest(face, side, own, gathered);
        let turned = most;
        let most = most.max(self.shape.beside(surface.corners(face)));
        let apart = low.max(most);
        if most > prediction {
            return apart;
        }
        let margin = PREFERENCE * prediction;
        let wins = best.filter(|&(gap, axis)| match axis {
            MeshAxis::Face(..) => gap > own + margin,
            MeshAxis::BoundaryContact(_) => gap > edge_beyond(own, prediction),
        });
        // If an axis that the mesh does not admit has a larger gap, then the nearest feature
        // belongs to another triangle. If all axes overlap, that axis may be a side of the shape
        // that something sharp has just passed.
        let elsewhere = match wins {
            Some((gap, _)) => most > gap.max(0.0) + margin,
            None => most > own + margin,
        };
        match wins {
            Some((_, axis)) if !elsewhere => self.on_axis(face, side, above, axis, gathered),
            _ if hidden => {}
            _ => self.on_facet(face, above, !elsewhere, gathered),
        }
        if elsewhere && 0.0 < turned && most <= self.ahead.turning {
            self.under(face, outermost, None, gathered);
        }
        apart
    }

    /// Finds or adds the position of the shape above a side of a facet. Returns its index.
    fn above(&self, facet: u32, side: f32, gathered: &mut Gathered) -> usize {
        let plane = &self.ahead.surface.facets[facet as usize];
        let behind = side < 0.0;
        if plane.joined {
            let same = |above: &Above| above.facet == facet && above.behind == behind;
            if let Some(known) = gathered.facets.iter().position(same) {
                return known;
            }
        }
        let normal = plane.normal * side;
        let low = self.shape.low(normal, &gathered.vertices) - side * plane.offset;
        let over = [1.0, 0.0];
        let mut above =
            Above { facet, behind, low, face: u32::MAX, corners: 0..0, over, genuine: false };
        if low <= self.ahead.prediction {
            let own = self.shape.facing(-normal);
            above.face = own as u32;
            above.corners = self.corners(own, normal, gathered);
        }
        gathered.facets.push(above);
        gathered.facets.len() - 1
    }

    /// Appends the corners of the shape that can touch a plane. Returns their range in `polygon`.
    fn corners(&self, own: usize, normal: Vec3, gathered: &mut Gathered) -> Range<usize> {
        let start = gathered.polygon.len();
        self.shape.corners(own, normal, &gathered.vertices, &mut gathered.polygon);
        start..gathered.polygon.len()
    }

    /// Computes the planes of the shape's faces, once.
    fn see_faces(&self, gathered: &mut Gathered) {
        if gathered.faces.is_empty() {
            self.shape.planes(&mut gathered.faces);
        }
    }

    /// Returns the manifold of a part.
    fn manifold<'g>(
        &self,
        part: MeshPart,
        normal: Vec3,
        gathered: &'g mut Gathered,
    ) -> &'g mut ContactManifold<3> {
        gathered.radius = self.shape.radius(normal);
        gathered.of(part, normal)
    }

    /// Returns the largest gap of a triangle along a face normal of the shape, with that face.
    /// Returns also the largest gap along an axis that the mesh admits, with the axis, if it is
    /// more than `least` \[m\].
    fn farthest(
        &self,
        face: &MeshFace,
        side: f32,
        least: f32,
        gathered: &Gathered,
    ) -> ((f32, usize), Option<(f32, MeshAxis)>) {
        let MeshQuery { surface, prediction, .. } = self.ahead;
        let corners = surface.corners(face);
        let (mut most, mut best) = ((f32::NEG_INFINITY, 0), None);
        let mut beat = least;
        for (own, &(normal, offset)) in gathered.faces.iter().enumerate() {
            let heights = corners.map(|corner| normal.dot(corner));
            let lowest = (1..3).fold(0, |low, k| if heights[k] < heights[low] { k } else { low });
            let gap = heights[lowest] - offset;
            if gap > most.0 {
                most = (gap, own);
            }
            if gap > prediction {
                return (most, None);
            }
            let vertex = face.corners[lowest];
            if gap > beat
                && normal.dot(self.center) - offset < gap
                && surface.vertex_gives(vertex, -normal)
            {
                beat = gap;
                best = Some((gap, MeshAxis::Face(own, vertex)));
            }
        }
        for k in (0..3).filter(|&k| face.beyond(k, side) == Beyond::Sharp) {
            let line = [corners[k], corners[(k + 1) % 3]];
            let (ahead, center) = (self.ahead, self.center);
            let sharp = Sharp { ahead, edge: face.edges[k], line, center, beat };
            if let Some((gap, rim)) = self.shape.rim(sharp, (&gathered.vertices, &gathered.faces)) {
                beat = gap;
                best = Some((gap, MeshAxis::BoundaryContact(rim)));
            }
        }
        (most, best)
    }

    /// Collects the contacts along an axis that is not the triangle's normal.
    fn on_axis(
        &self,
        face: &MeshFace,
        side: f32,
        above: usize,
        axis: MeshAxis,
        gathered: &mut Gathered,
    ) {
        let surface = self.ahead.surface;
        let direction = match axis {
            MeshAxis::Face(own, _) => -gathered.faces[own].0,
            MeshAxis::BoundaryContact(rim) => rim.direction,
        };
        let facet = &surface.facets[face.facet as usize];
        if side * facet.normal.dot(direction) > UPRIGHT {
            return self.on_facet(face, above, true, gathered);
        }
        // If a neighboring face has this normal, the contact belongs to that face.
        match axis {
            MeshAxis::Face(own, vertex) => {
                if !surface.vertex_is_flush(vertex, direction) {
                    gathered.face(facet, side);
                    self.under(face, own, Some(vertex), gathered);
                }
            }
            MeshAxis::BoundaryContact(rim) => {
                match rim.part {
                    MeshPart::Edge(edge) if surface.edge_is_flush(edge, direction) => return,
                    MeshPart::Edge(edge) if surface.wings(edge).len() > 1 => {
                        gathered.face(facet, side)
                    }
                    MeshPart::Vertex(vertex) if surface.vertex_is_flush(vertex, direction) => {
                        return;
                    }
                    MeshPart::Vertex(_) => gathered.face(facet, side),
                    _ => {}
                }
                if let Some(own) = rim.flat {
                    return self.under(face, own, None, gathered);
                }
                if !gathered.has(rim.part) {
                    let touch = self.manifold(rim.part, direction, gathered);
                    for (on_a, on_b, feature) in rim.locations.into_iter().flatten() {
                        let gap = direction.dot(on_a - on_b);
                        add(touch, ManifoldPoint { on_a, on_b, gap, feature });
                    }
                }
            }
        }
    }

    /// Collects the contacts of the shape over a triangle. These are corners of its lowest face
    /// over the triangle, and parts of that face over the boundary of the facet. If `all` is false,
    /// the contact may still turn out to belong to another facet ([`Self::keep_genuine`]).
    fn on_facet(&self, face: &MeshFace, above: usize, all: bool, gathered: &mut Gathered) {
        let MeshQuery { surface, prediction, .. } = self.ahead;
        let Above { facet: number, behind, low, face: own, corners, .. } =
            gathered.facets[above].clone();
        let facet = &surface.facets[number as usize];
        let side = if behind { -1.0 } else { 1.0 };
        let normal = facet.normal * side;
        let height = |location: Vec3| normal.dot(location) - side * facet.offset;
        let start = gathered.memory.len();
        let mut deepest = f32::INFINITY;
        for at in corners.clone() {
            let Corner { position, feature, .. } = gathered.polygon[at];
            let gap = height(position);
            if gap <= prediction
                && (self.ahead.is_over(face, facet, side, position, gap)
                    || self.ahead.moves_onto(face, facet, side, position, gap))
            {
                deepest = deepest.min(gap);
                gathered.memory.push(Corner { position, feature, height: gap });
            }
        }
        if all {
            self.over_sides(face, (number, own), normal, corners, gathered);
        }
        gathered.facets[above].genuine |= all || low <= 0.0 && deepest <= MOST * low;
        let found = start..gathered.memory.len();
        if !found.is_empty() {
            let memory = std::mem::take(&mut gathered.memory);
            let touch = self.manifold(MeshPart::Facet { facet: number, behind }, normal, gathered);
            for corner in &memory[found] {
                let (on_a, gap) = (corner.position, corner.height);
                let feature = u64::from(corner.feature);
                add(touch, ManifoldPoint { on_a, on_b: on_a - normal * gap, gap, feature });
            }
            gathered.memory = memory;
        }
        gathered.memory.truncate(start);
    }

    /// Removes the overlapping points of facets to which no contact belongs. A facet keeps them in
    /// two cases: they are near the deepest point of the shape, or the face normal is the best axis
    /// for one of its triangles.
    fn keep_genuine(&self, gathered: &mut Gathered) {
        for at in 0..gathered.facets.len() {
            let Above { facet: number, behind, genuine, .. } = gathered.facets[at];
            let part = MeshPart::Facet { facet: number, behind };
            if !gathered.has(part) {
                continue;
            }
            let facet = &self.ahead.surface.facets[number as usize];
            let side = if behind { -1.0 } else { 1.0 };
            let touch = self.manifold(part, facet.normal * side, gathered);
            touch.points.retain(|point| genuine || point.gap > 0.0);
            if !touch.points.is_empty() {
                gathered.face(facet, side);
            }
        }
    }

    /// Collects the parts of a face of the shape that are over the sides of a triangle where its
    /// facet ends.
    fn over_sides(
        &self,
        face: &MeshFace,
        (number, own): (u32, u32),
        normal: Vec3,
        corners: Range<usize>,
        gathered: &mut Gathered,
    ) {
        let MeshQuery { surface, prediction, .. } = self.ahead;
        let locations = surface.corners(face);
        let lying = self.shape.line(normal);
        for k in 0..3 {
            let inner = |&[_, other]: &[u32; 2]| other == number;
            if surface.wings(face.edges[k]).iter().filter(|wing| inner(wing)).count() > 1 {
                continue;
            }
            let [from, along] = [locations[k], locations[(k + 1) % 3] - locations[k]];
            if let Some(position) = lying.and_then(|line| cross(line, [from, along], normal)) {
                let gap = normal.dot(position - from);
                if gap <= prediction {
                    let feature = 3 << 30 | face.edges[k];
                    gathered.memory.push(Corner { position, feature, height: gap });
                }
            }
            self.see_faces(gathered);
            let (plane, offset) = gathered.faces[own as usize];
            let own = outline(own as usize, plane, &gathered.polygon[corners.clone()]);
            // Seen along the normal of the mesh.
            let Some(range) = self.shape.within(&own, normal, [from, along]) else { continue };
            let slope = plane.dot(normal);
            for (end, part) in range.into_iter().enumerate() {
                let location = from + along * part;
                // Distance along the normal to the face of the shape.
                let gap = (offset - plane.dot(location)) / slope;
                if slope < -PARALLEL && gap <= prediction {
                    let feature = match part {
                        0.0 => 1 << 30 | face.corners[k],
                        1.0 => 1 << 30 | face.corners[(k + 1) % 3],
                        _ => 2 << 30 | face.edges[k] << 1 | end as u32,
                    };
                    let position = location + normal * gap;
                    gathered.memory.push(Corner { position, feature, height: gap });
                }
            }
        }
    }

    /// Collects the contacts of a triangle below a face of the shape. These are sharp vertices, and
    /// edges with no mesh above them, or else the vertex that is `deepest`.
    fn under(&self, face: &MeshFace, own: usize, deepest: Option<u32>, gathered: &mut Gathered) {
        let MeshQuery { surface, prediction, motion, turning, .. } = self.ahead;
        let (normal, offset) = gathered.faces[own];
        let direction = -normal;
        let corners = self.corners(own, direction, gathered);
        let outline = outline(own, normal, &gathered.polygon[corners.clone()]);
        let mut found: [Option<(Vec3, u64)>; 9] = [None; 9];
        for k in 0..3 {
            let edge = face.edges[k];
            let [from, to] = surface.ends(edge);
            let along = to - from;
            let level = direction.dot(along);
            if level * level < ALONG * ALONG * along.dot(along)
                && surface.edge_gives(edge, direction)
                && let Some(range) = self.shape.within(&outline, direction, [from, along])
            {
                for (end, part) in range.into_iter().enumerate() {
                    let name = match part {
                        0.0 => feature(1, u64::from(surface.edges[edge as usize].ends[0])),
                        1.0 => feature(1, u64::from(surface.edges[edge as usize].ends[1])),
                        _ => feature(2, u64::from(edge) << 1 | end as u64),
                    };
                    found[2 * k + end] = Some((from + along * part, name));
                }
            }
        }
        for (k, &vertex) in face.corners.iter().enumerate() {
            let location = surface.points[vertex as usize];
            let gap = normal.dot(location) - offset;
            let approach = normal.dot(motion);
            let is_under = || {
                let comes = gap > 0.0 && approach > gap;
                self.shape.covers(&outline, normal, location)
                    || comes
                        && self.shape.covers(&outline, normal, location - motion * (gap / approach))
                    || gap < 0.0 && deepest == Some(vertex)
            };
            // Vertices that are not the nearest can become it by rotation only.
            if surface.vertices[vertex as usize].sharp
                && (0.0 < gap && gap <= turning || surface.vertex_gives(vertex, direction))
                && is_under()
            {
                found[6 + k] = Some((location, feature(1, u64::from(vertex))));
            }
        }
        gathered.polygon.truncate(corners.start);
        for (location, feature) in found.into_iter().flatten() {
            let gap = normal.dot(location) - offset;
            if gap <= prediction {
                let touch = self.manifold(MeshPart::Under(own as u32), direction, gathered);
                add(
                    touch,
                    ManifoldPoint { on_a: location - normal * gap, on_b: location, gap, feature },
                );
            }
        }
    }

    /// If the center is inside a solid, replaces all contacts by one that pushes it out the
    /// shortest way.
    fn push_out(&self, gathered: &mut Gathered) {
        let surface = self.ahead.surface;
        let Some(face) = nearest_inside(self.ahead, self.center, &gathered.near) else { return };
        gathered.count = 0;
        let facet = &surface.facets[face.facet as usize];
        let (side, _) = self.ahead.side(facet, self.center);
        let above = self.above(face.facet, side, gathered);
        let corners = gathered.facets[above].corners.clone();
        gathered.face(facet, side);
        let (part, normal) =
            (MeshPart::Facet { facet: face.facet, behind: side < 0.0 }, facet.normal * side);
        for at in corners {
            let Corner { position, feature, .. } = gathered.polygon[at];
            let gap = normal.dot(position) - side * facet.offset;
            let touch = self.manifold(part, normal, gathered);
            let on_b = position - normal * gap;
            let feature = u64::from(feature);
            add(touch, ManifoldPoint { on_a: position, on_b, gap, feature });
        }
    }
}

/// Returns the nearby triangle closest to a center, if the center is behind it.
pub(super) fn nearest_inside<'a>(
    ahead: MeshQuery<'a>,
    center: Vec3,
    near: &[u32],
) -> Option<&'a MeshFace> {
    let surface = ahead.surface;
    let mut best: Option<(f32, &MeshFace, bool)> = None;
    for face in near.iter().filter_map(|&index| surface.faces[index as usize].as_ref()) {
        let only = ahead.only_side(&surface.facets[face.facet as usize]);
        let (point, outside) = surface.nearest(face, only.unwrap_or(1.0), center);
        let arm = center - point;
        let squared = arm.dot(arm);
        if best.is_none_or(|(least, ..)| squared < least) {
            best = Some((squared, face, outside || only.is_none()));
        }
    }
    best.filter(|&(.., outside)| !outside).map(|(_, face, _)| face)
}

/// Returns the point of the first segment at which it crosses the second as seen along a direction.
fn cross([start, way]: [Vec3; 2], [from, along]: [Vec3; 2], direction: Vec3) -> Option<Vec3> {
    let outward: Vec3 = moment(along, direction);
    let part = outward.dot(from - start) / outward.dot(way);
    let location = start + way * part;
    let at = along.dot(location - from) / along.dot(along);
    ((0.0..=1.0).contains(&part) && (0.0..=1.0).contains(&at)).then_some(location)
}

fn outline(face: usize, normal: Vec3, corners: &[Corner<3>]) -> FaceOutline<'_> {
    FaceOutline { face, normal, corners }
}
