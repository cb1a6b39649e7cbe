//! Contact of convex shapes with ends, faces or edges ([`Shape`]) with triangle meshes.

use std::ops::Range;

use drystone_solver::{Vector, moment};

use super::surface::{Beyond, Face, UPRIGHT};
use super::{Above, Corner, Gathered, ManifoldPoint, MeshQuery, Part, V, add};
use crate::geometry::ContactManifold;
use crate::geometry::separation::{PREFERENCE, edge_beyond};

/// Points over a face count for the whole shape if they have at least this part of its overlap. \[1\]
const MOST: f32 = 0.5;

/// Planes and lines at an angle whose sine is less than this are parallel. \[1\]
pub(super) const PARALLEL: f32 = 1e-2;

/// A mesh edge lies along a face if the sine of the angle between them is less than this. \[1\]
const ALONG: f32 = 0.032;

/// A name for a point: what made it, and its number.
pub(super) fn feature(kind: u64, number: u64) -> u64 {
    kind << 40 | number
}

/// A convex shape as it is asked about a mesh, in the frame of the mesh. Faces are flat: of a cylinder, its caps.
pub(super) trait Shape {
    /// Appends its vertices, if it has any.
    fn vertices(&self, out: &mut Vec<V>);

    /// Appends the outward normal of each face, and how far its plane is along that. \[1, m\]
    fn planes(&self, out: &mut Vec<(V, f32)>);

    /// The least and the greatest coordinates, and the center.
    fn bounds(&self, vertices: &[V]) -> [V; 3];

    /// Height of its lowest point along a direction. \[m\]
    fn low(&self, direction: V, vertices: &[V]) -> f32;

    /// The face that looks along a direction.
    fn facing(&self, direction: V) -> usize;

    /// Appends what of it looks against a plane with this normal, on the side of a face.
    fn corners(&self, face: usize, normal: V, vertices: &[V], out: &mut Vec<Corner<3>>);

    /// The line on which it lies on a plane with this normal, from its start along it: of what is round.
    fn line(&self, normal: V) -> Option<[V; 2]> {
        let _ = normal;
        None
    }

    /// The part of a line, from a point along a way, that is within a face as seen along a direction.
    fn within(&self, face: &Outline<'_>, direction: V, line: [V; 2]) -> Option<[f32; 2]>;

    /// A place is within a face as seen along a direction.
    fn covers(&self, face: &Outline<'_>, direction: V, place: V) -> bool;

    /// Distance of a triangle from its round side, across the axis; less than anything if it has none. \[m\]
    fn beside(&self, corners: [V; 3]) -> f32 {
        let _ = corners;
        f32::NEG_INFINITY
    }

    /// Gap to an edge of the mesh along a direction that both admit, if it beats that of another. \[m\] `seen` are the
    /// shape's own vertices and planes.
    fn rim(&self, sharp: Sharp<'_>, seen: (&[V], &[(V, f32)])) -> Option<(f32, Rim)>;

    /// Its radius of curvature where it touches along a normal. \[m\]
    fn radius(&self, normal: V) -> f32 {
        let _ = normal;
        0.0
    }
}

/// A face of a shape.
pub(super) struct Outline<'a> {
    /// Its number.
    pub(super) face: usize,
    /// Outward.
    pub(super) normal: V,
    /// Its corners, in order around it; of a cap, what looks against a plane.
    pub(super) corners: &'a [Corner<3>],
}

/// A sharp edge of a mesh.
#[derive(Clone, Copy)]
pub(super) struct Sharp<'a> {
    pub(super) ahead: MeshQuery<'a>,
    pub(super) edge: u32,
    /// Its ends, in the order of a triangle.
    pub(super) line: [V; 2],
    /// Center of the shape.
    pub(super) center: V,
    /// Gap along another direction. \[m\]
    pub(super) beat: f32,
}

/// Contact of a shape with an edge or a vertex of a mesh.
#[derive(Clone, Copy)]
pub(super) struct Rim {
    pub(super) part: Part,
    /// Out of the mesh, of unit length.
    pub(super) direction: V,
    /// The face of the shape that looks along it.
    pub(super) flat: Option<usize>,
    /// Places on the shape and on the mesh, with names.
    pub(super) places: [Option<(V, V, u64)>; 2],
}

/// A shape near a mesh.
struct Meeting<'a, S: Shape> {
    ahead: MeshQuery<'a>,
    shape: &'a S,
    center: V,
}

/// What part of a triangle and the shape are farthest apart.
#[derive(Clone, Copy)]
enum Axis {
    /// A face of the shape, and the vertex of the mesh that is deepest.
    Face(usize, u32),
    Rim(Rim),
}

/// Gathers where a shape touches a mesh or is within `prediction` of it, in the frame of the mesh. Returns how far they
/// are apart at least. \[m\]
pub(super) fn gather(
    ahead: MeshQuery<'_>,
    shape: &impl Shape,
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
    let meeting = Meeting { ahead, shape, center };
    let (mut apart, mut inside) = (ahead.prediction, false);
    for at in 0..gathered.near.len() {
        let index = gathered.near[at];
        if let Some(face) = &ahead.surface.faces[index as usize] {
            apart = apart.min(meeting.meet(face, gathered, &mut inside));
        }
    }
    meeting.keep_genuine(gathered);
    if inside {
        meeting.push_out(gathered);
    }
    apart
}

impl<S: Shape> Meeting<'_, S> {
    /// Gathers where the shape touches a triangle; returns how far they are apart at least. \[m\] Sets `behind` if the
    /// center is behind a face that has one side.
    fn meet(&self, face: &Face, gathered: &mut Gathered, behind: &mut bool) -> f32 {
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
            Axis::Face(..) => gap > own + margin,
            Axis::Rim(_) => gap > edge_beyond(own, prediction),
        });
        // What another direction parts, which the mesh does not admit, is nearer elsewhere. Where all overlap, that may
        // be a side of the shape that something sharp has just come by.
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

    /// What the shape is to a side of a facet: its number.
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

    /// Corners of the shape that look against a plane: their range among the polygons.
    fn corners(&self, own: usize, normal: V, gathered: &mut Gathered) -> Range<usize> {
        let start = gathered.polygon.len();
        self.shape.corners(own, normal, &gathered.vertices, &mut gathered.polygon);
        start..gathered.polygon.len()
    }

    /// Sees the planes of the shape's faces from the mesh.
    fn see_faces(&self, gathered: &mut Gathered) {
        if gathered.faces.is_empty() {
            self.shape.planes(&mut gathered.faces);
        }
    }

    /// The manifold of a part.
    fn manifold<'g>(
        &self,
        part: Part,
        normal: V,
        gathered: &'g mut Gathered,
    ) -> &'g mut ContactManifold<3> {
        gathered.radius = self.shape.radius(normal);
        gathered.of(part, normal)
    }

    /// How far the shape and a triangle are apart along a face of the shape, the most; and the most along a direction
    /// that the mesh admits, if that is more than `least` \[m\].
    fn farthest(
        &self,
        face: &Face,
        side: f32,
        least: f32,
        gathered: &Gathered,
    ) -> ((f32, usize), Option<(f32, Axis)>) {
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
                best = Some((gap, Axis::Face(own, vertex)));
            }
        }
        for k in (0..3).filter(|&k| face.beyond(k, side) == Beyond::Sharp) {
            let line = [corners[k], corners[(k + 1) % 3]];
            let (ahead, center) = (self.ahead, self.center);
            let sharp = Sharp { ahead, edge: face.edges[k], line, center, beat };
            if let Some((gap, rim)) = self.shape.rim(sharp, (&gathered.vertices, &gathered.faces)) {
                beat = gap;
                best = Some((gap, Axis::Rim(rim)));
            }
        }
        (most, best)
    }

    /// Gathers what touches along an axis that is not the face's own.
    fn on_axis(&self, face: &Face, side: f32, above: usize, axis: Axis, gathered: &mut Gathered) {
        let surface = self.ahead.surface;
        let direction = match axis {
            Axis::Face(own, _) => -gathered.faces[own].0,
            Axis::Rim(rim) => rim.direction,
        };
        let facet = &surface.facets[face.facet as usize];
        if side * facet.normal.dot(direction) > UPRIGHT {
            return self.on_facet(face, above, true, gathered);
        }
        // A neighbor that looks that way has it as its face.
        match axis {
            Axis::Face(own, vertex) => {
                if !surface.vertex_is_flush(vertex, direction) {
                    gathered.face(facet, side);
                    self.under(face, own, Some(vertex), gathered);
                }
            }
            Axis::Rim(rim) => {
                match rim.part {
                    Part::Edge(edge) if surface.edge_is_flush(edge, direction) => return,
                    Part::Edge(edge) if surface.wings(edge).len() > 1 => gathered.face(facet, side),
                    Part::Vertex(vertex) if surface.vertex_is_flush(vertex, direction) => return,
                    Part::Vertex(_) => gathered.face(facet, side),
                    _ => {}
                }
                if let Some(own) = rim.flat {
                    return self.under(face, own, None, gathered);
                }
                if !gathered.has(rim.part) {
                    let touch = self.manifold(rim.part, direction, gathered);
                    for (on_a, on_b, feature) in rim.places.into_iter().flatten() {
                        let gap = direction.dot(on_a - on_b);
                        add(touch, ManifoldPoint { on_a, on_b, gap, feature });
                    }
                }
            }
        }
    }

    /// Gathers what of the shape is over a triangle: corners of its face that looks there, and what of that face is
    /// over the sides of the facet. If not `all`, the facet may still be found to be another's
    /// ([`Self::keep_genuine`]).
    fn on_facet(&self, face: &Face, above: usize, all: bool, gathered: &mut Gathered) {
        let MeshQuery { surface, prediction, .. } = self.ahead;
        let Above { facet: number, behind, low, face: own, corners, .. } =
            gathered.facets[above].clone();
        let facet = &surface.facets[number as usize];
        let side = if behind { -1.0 } else { 1.0 };
        let normal = facet.normal * side;
        let height = |place: V| normal.dot(place) - side * facet.offset;
        let start = gathered.memory.len();
        let mut deepest = f32::INFINITY;
        for at in corners.clone() {
            let Corner { position, feature, .. } = gathered.polygon[at];
            let gap = height(position);
            if gap <= prediction
                && (self.ahead.is_over(face, facet, side, position, gap)
                    || self.ahead.comes_over(face, facet, side, position, gap))
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
            let touch = self.manifold(Part::Facet { facet: number, behind }, normal, gathered);
            for corner in &memory[found] {
                let (on_a, gap) = (corner.position, corner.height);
                let feature = u64::from(corner.feature);
                add(touch, ManifoldPoint { on_a, on_b: on_a - normal * gap, gap, feature });
            }
            gathered.memory = memory;
        }
        gathered.memory.truncate(start);
    }

    /// Keeps of facets only what is near the deepest point of the shape, or still apart, unless a triangle of it is what
    /// the shape is farthest from.
    fn keep_genuine(&self, gathered: &mut Gathered) {
        for at in 0..gathered.facets.len() {
            let Above { facet: number, behind, genuine, .. } = gathered.facets[at];
            let part = Part::Facet { facet: number, behind };
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

    /// Remembers what of a face of the shape is over the sides of a triangle at which its facet ends.
    fn over_sides(
        &self,
        face: &Face,
        (number, own): (u32, u32),
        normal: V,
        corners: Range<usize>,
        gathered: &mut Gathered,
    ) {
        let MeshQuery { surface, prediction, .. } = self.ahead;
        let places = surface.corners(face);
        let lying = self.shape.line(normal);
        for k in 0..3 {
            let inner = |&[_, other]: &[u32; 2]| other == number;
            if surface.wings(face.edges[k]).iter().filter(|wing| inner(wing)).count() > 1 {
                continue;
            }
            let [from, along] = [places[k], places[(k + 1) % 3] - places[k]];
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
                let place = from + along * part;
                // Along the normal to the face of the shape.
                let gap = (offset - plane.dot(place)) / slope;
                if slope < -PARALLEL && gap <= prediction {
                    let feature = match part {
                        0.0 => 1 << 30 | face.corners[k],
                        1.0 => 1 << 30 | face.corners[(k + 1) % 3],
                        _ => 2 << 30 | face.edges[k] << 1 | end as u32,
                    };
                    let position = place + normal * gap;
                    gathered.memory.push(Corner { position, feature, height: gap });
                }
            }
        }
    }

    /// Gathers what of a triangle is under a face of the shape: sharp vertices and edges that nothing around is above;
    /// else the vertex that is deepest.
    fn under(&self, face: &Face, own: usize, deepest: Option<u32>, gathered: &mut Gathered) {
        let MeshQuery { surface, prediction, motion, turning, .. } = self.ahead;
        let (normal, offset) = gathered.faces[own];
        let direction = -normal;
        let corners = self.corners(own, direction, gathered);
        let outline = outline(own, normal, &gathered.polygon[corners.clone()]);
        let mut found: [Option<(V, u64)>; 9] = [None; 9];
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
            let place = surface.points[vertex as usize];
            let gap = normal.dot(place) - offset;
            let approach = normal.dot(motion);
            let is_under = || {
                let comes = gap > 0.0 && approach > gap;
                self.shape.covers(&outline, normal, place)
                    || comes
                        && self.shape.covers(&outline, normal, place - motion * (gap / approach))
                    || gap < 0.0 && deepest == Some(vertex)
            };
            // What is not the nearest comes to be by turning only.
            if surface.vertices[vertex as usize].sharp
                && (0.0 < gap && gap <= turning || surface.vertex_gives(vertex, direction))
                && is_under()
            {
                found[6 + k] = Some((place, feature(1, u64::from(vertex))));
            }
        }
        gathered.polygon.truncate(corners.start);
        for (place, feature) in found.into_iter().flatten() {
            let gap = normal.dot(place) - offset;
            if gap <= prediction {
                let touch = self.manifold(Part::Under(own as u32), direction, gathered);
                add(touch, ManifoldPoint { on_a: place - normal * gap, on_b: place, gap, feature });
            }
        }
    }

    /// If the center is inside a solid, gathers in place of all else what pushes it out the nearest way.
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
            (Part::Facet { facet: face.facet, behind: side < 0.0 }, facet.normal * side);
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

/// The triangle nearest to a center, of those near, if the center is behind it.
pub(super) fn nearest_inside<'a>(
    ahead: MeshQuery<'a>,
    center: V,
    near: &[u32],
) -> Option<&'a Face> {
    let surface = ahead.surface;
    let mut best: Option<(f32, &Face, bool)> = None;
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

/// Crossing of two segments as seen along a direction: a place on the first.
fn cross([start, way]: [V; 2], [from, along]: [V; 2], direction: V) -> Option<V> {
    let outward: V = moment(along, direction);
    let part = outward.dot(from - start) / outward.dot(way);
    let place = start + way * part;
    let at = along.dot(place - from) / along.dot(along);
    ((0.0..=1.0).contains(&part) && (0.0..=1.0).contains(&at)).then_some(place)
}

fn outline(face: usize, normal: V, corners: &[Corner<3>]) -> Outline<'_> {
    Outline { face, normal, corners }
}
