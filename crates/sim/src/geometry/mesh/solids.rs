//! Contact of boxes and hulls with triangle meshes.

use drystone_solver::{Vector, moment};

use super::surface::{Beyond, Face, UPRIGHT};
use super::{Above, Ahead, Corner, Frame, Gathered, Part, TouchPoint, V, add};
use crate::geometry::separation::{PREFERENCE, edge_beyond};
use crate::geometry::solid::Polyhedron;

/// Points over a face count for the whole shape if they have at least this part of its overlap. \[1\]
const MOST: f32 = 0.5;

/// Edges at an angle whose sine is less than this are parallel. \[1\]
const PARALLEL: f32 = 1e-2;

/// A mesh edge lies along a face if the sine of the angle between them is less than this. \[1\]
const ALONG: f32 = 0.032;

/// A name for a point: what made it, and its number.
fn feature(kind: u64, number: u64) -> u64 {
    kind << 40 | number
}

/// A solid near a mesh.
struct Meeting<'a, P: Polyhedron> {
    ahead: Ahead<'a>,
    shape: &'a P,
    /// Of the shape, seen from the mesh.
    frame: &'a Frame<3>,
    center: V,
}

/// What part of a triangle and the shape are farthest apart.
#[derive(Clone, Copy)]
enum Axis {
    /// A face of the shape, and the vertex of the mesh that is deepest.
    Face(usize, u32),
    /// An edge of the mesh and one of the shape, the direction and where they are nearest.
    Edges { edge: u32, own: usize, direction: V, on_mesh: V, on_shape: V },
}

/// Gathers where a box or a hull touches a mesh or is within `prediction` of it, in the frame of the mesh.
/// Returns how far they are apart at least. \[m\]
pub(crate) fn solid<P: Polyhedron>(
    ahead: Ahead<'_>,
    shape: &P,
    frame: &Frame<3>,
    tree: &parry3d::partitioning::Bvh,
    gathered: &mut Gathered,
) -> f32 {
    gathered.clear();
    gathered.vertices.clear();
    gathered.faces.clear();
    shape.vertices(&mut gathered.vertices);
    let (mut min, mut max) = (Vector([f32::INFINITY; 3]), Vector([f32::NEG_INFINITY; 3]));
    let mut center: V = Vector::ZERO;
    for vertex in &mut gathered.vertices {
        *vertex = frame.point(*vertex);
        center += *vertex;
        for i in 0..3 {
            min[i] = min[i].min(vertex[i]);
            max[i] = max[i].max(vertex[i]);
        }
    }
    let center = center * (1.0 / gathered.vertices.len() as f32);
    let reach = Vector([ahead.prediction; 3]);
    let near = parry3d::bounding_volume::Aabb::new((min - reach).0.into(), (max + reach).0.into());
    gathered.near.extend(tree.intersect_aabb(&near));
    let meeting = Meeting { ahead, shape, frame, center };
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

impl<P: Polyhedron> Meeting<'_, P> {
    /// Gathers where the shape touches a triangle; returns how far they are apart at least. \[m\] Sets `behind` if the
    /// center is behind a face that has one side.
    fn meet(&self, face: &Face, gathered: &mut Gathered, behind: &mut bool) -> f32 {
        let Ahead { surface, prediction, .. } = self.ahead;
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
        let apart = low.max(most);
        if most > prediction {
            return apart;
        }
        let margin = PREFERENCE * prediction;
        let wins = best.filter(|&(gap, axis)| match axis {
            Axis::Face(..) => gap > own + margin,
            Axis::Edges { .. } => gap > edge_beyond(own, prediction),
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
        if elsewhere && 0.0 < most && most <= self.ahead.turning {
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
        let heights = gathered.vertices.iter().map(|vertex| normal.dot(*vertex));
        let low = heights.fold(f32::INFINITY, f32::min) - side * plane.offset;
        let over = [1.0, 0.0];
        let mut above =
            Above { facet, behind, low, face: u32::MAX, corners: 0..0, over, genuine: false };
        if low <= self.ahead.prediction {
            let own = self.shape.facing(self.frame.local_direction(-normal));
            above.face = own as u32;
            above.corners = self.corners(own, gathered);
        }
        gathered.facets.push(above);
        gathered.facets.len() - 1
    }

    /// The corners of a face of the shape, seen from the mesh: where they are among the polygons.
    fn corners(&self, own: usize, gathered: &mut Gathered) -> std::ops::Range<usize> {
        let start = gathered.polygon.len();
        self.shape.corners(own, &mut gathered.polygon);
        for corner in &mut gathered.polygon[start..] {
            corner.position = gathered.vertices[corner.feature as usize];
        }
        start..gathered.polygon.len()
    }

    /// Sees the planes of the shape's faces from the mesh.
    fn see_faces(&self, gathered: &mut Gathered) {
        if gathered.faces.is_empty() {
            gathered.faces.extend((0..self.shape.faces()).map(|own| {
                let (normal, vertex) = self.shape.face(own);
                let normal = self.frame.direction(normal);
                (normal, normal.dot(self.frame.point(vertex)))
            }));
        }
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
        let Ahead { surface, prediction, .. } = self.ahead;
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
            let [from, to] = [corners[k], corners[(k + 1) % 3]];
            for own in 0..self.shape.edges() {
                if let Some((gap, axis)) =
                    self.across(face.edges[k], [from, to], own, beat, gathered)
                {
                    beat = gap;
                    best = Some((gap, axis));
                }
            }
        }
        (most, best)
    }

    /// How far an edge of the mesh and one of the shape are apart across both, if that is more than `beat` \[m\] and
    /// neither the mesh nor the shape has anything between.
    #[inline]
    fn across(
        &self,
        edge: u32,
        [from, to]: [V; 2],
        own: usize,
        beat: f32,
        gathered: &Gathered,
    ) -> Option<(f32, Axis)> {
        let Ahead { surface, prediction, .. } = self.ahead;
        let [start, end] = self.shape.ends(own).map(|end| gathered.vertices[end]);
        let apart = (0..3).any(|i| {
            start[i].min(end[i]) - prediction > from[i].max(to[i])
                || from[i].min(to[i]) - prediction > start[i].max(end[i])
        });
        if apart {
            return None;
        }
        let (along, other) = (to - from, end - start);
        let across: V = moment(along, other);
        let (squared, lengths) = (across.dot(across), along.dot(along) * other.dot(other));
        if squared <= PARALLEL * PARALLEL * lengths {
            return None;
        }
        // Away from the mesh: the opposite corners of its triangles are below.
        let apex = surface.wings(edge).first()?[0];
        let below = across.dot(surface.points[apex as usize] - from) <= 0.0;
        let direction = across * (if below { 1.0 } else { -1.0 } / squared.sqrt());
        let gap = direction.dot(start - from);
        if gap <= beat || gap > prediction || !surface.edge_gives(edge, direction) {
            return None;
        }
        // Of the shape, both faces at the edge rise along the direction: it looks between their normals.
        let [one, two] = self.shape.flanks(own).map(|face| gathered.faces[face].0);
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
        let front = direction.dot(self.center - on_mesh) > 0.0;
        let axis = Axis::Edges { edge, own, direction, on_mesh, on_shape };
        front.then_some((gap, axis))
    }

    /// Gathers what touches along an axis that is not the face's own.
    fn on_axis(&self, face: &Face, side: f32, above: usize, axis: Axis, gathered: &mut Gathered) {
        let surface = self.ahead.surface;
        let direction = match axis {
            Axis::Face(own, _) => -gathered.faces[own].0,
            Axis::Edges { direction, .. } => direction,
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
            Axis::Edges { edge, own, direction, on_mesh, on_shape } => {
                if surface.edge_is_flush(edge, direction) {
                    return;
                }
                if surface.wings(edge).len() > 1 {
                    gathered.face(facet, side);
                }
                let flanks = self.shape.flanks(own);
                let flat = |&own: &usize| -gathered.faces[own].0.dot(direction) > UPRIGHT;
                if let Some(own) = flanks.into_iter().find(flat) {
                    return self.under(face, own, None, gathered);
                }
                let part = Part::Edge(edge);
                if !gathered.has(part) {
                    let touch = gathered.of(part, direction);
                    let gap = direction.dot(on_shape - on_mesh);
                    let feature = feature(5, own as u64);
                    add(touch, TouchPoint { on_a: on_shape, on_b: on_mesh, gap, feature });
                }
            }
        }
    }

    /// Gathers what of the shape is over a triangle: corners of its face that looks there, and what of that face is
    /// over the sides of the facet. If not `all`, the facet may still be found to be another's
    /// ([`Self::keep_genuine`]).
    fn on_facet(&self, face: &Face, above: usize, all: bool, gathered: &mut Gathered) {
        let Ahead { surface, prediction, .. } = self.ahead;
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
            let touch = gathered.of(Part::Facet { facet: number, behind }, normal);
            for corner in &memory[found] {
                let (on_a, gap) = (corner.position, corner.height);
                let feature = u64::from(corner.feature);
                add(touch, TouchPoint { on_a, on_b: on_a - normal * gap, gap, feature });
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
            let touch = gathered.of(part, facet.normal * side);
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
        corners: std::ops::Range<usize>,
        gathered: &mut Gathered,
    ) {
        let Ahead { surface, prediction, .. } = self.ahead;
        let places = surface.corners(face);
        for k in 0..3 {
            let inner = |&[_, other]: &[u32; 2]| other == number;
            if surface.wings(face.edges[k]).iter().filter(|wing| inner(wing)).count() > 1 {
                continue;
            }
            let [from, along] = [places[k], places[(k + 1) % 3] - places[k]];
            let polygon = &gathered.polygon[corners.clone()];
            // Seen along the normal of the mesh.
            let Some(range) = within(polygon, normal, [from, along]) else { continue };
            self.see_faces(gathered);
            let (plane, offset) = gathered.faces[own as usize];
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
        let Ahead { surface, prediction, motion, turning, .. } = self.ahead;
        let (normal, offset) = gathered.faces[own];
        let direction = -normal;
        let corners = self.corners(own, gathered);
        let mut found: [Option<(V, u64)>; 9] = [None; 9];
        for k in 0..3 {
            let edge = face.edges[k];
            let [from, to] = surface.ends(edge);
            let along = to - from;
            let level = direction.dot(along);
            if level * level < ALONG * ALONG * along.dot(along)
                && surface.edge_gives(edge, direction)
                && let Some(range) =
                    within(&gathered.polygon[corners.clone()], direction, [from, along])
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
        let polygon = &gathered.polygon[corners.clone()];
        for (k, &vertex) in face.corners.iter().enumerate() {
            let place = surface.points[vertex as usize];
            let gap = normal.dot(place) - offset;
            let approach = normal.dot(motion);
            let is_under = || {
                let comes = gap > 0.0 && approach > gap;
                is_within(polygon, normal, place)
                    || comes && is_within(polygon, normal, place - motion * (gap / approach))
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
                let touch = gathered.of(Part::Under(own as u32), direction);
                add(touch, TouchPoint { on_a: place - normal * gap, on_b: place, gap, feature });
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
            let touch = gathered.of(part, normal);
            let on_b = position - normal * gap;
            let feature = u64::from(feature);
            add(touch, TouchPoint { on_a: position, on_b, gap, feature });
        }
    }
}

/// The triangle nearest to a center, of those near, if the center is behind it.
pub(super) fn nearest_inside<'a>(ahead: Ahead<'a>, center: V, near: &[u32]) -> Option<&'a Face> {
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

/// The part of a line, from a point along a way, that is within a convex polygon as seen along a direction.
fn within(polygon: &[Corner<3>], direction: V, [from, along]: [V; 2]) -> Option<[f32; 2]> {
    let [mut first, mut last] = [0.0f32, 1.0f32];
    let turn = winding(polygon, direction);
    for (i, corner) in polygon.iter().enumerate() {
        let (start, end) = (corner.position, polygon[(i + 1) % polygon.len()].position);
        let outward: V = moment(end - start, direction);
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

/// Whether a place is within a convex polygon as seen along a direction.
fn is_within(polygon: &[Corner<3>], direction: V, place: V) -> bool {
    let turn = winding(polygon, direction);
    (0..polygon.len()).all(|i| {
        let (start, end) = (polygon[i].position, polygon[(i + 1) % polygon.len()].position);
        let outward: V = moment(end - start, direction);
        turn * outward.dot(place - start) <= super::ON_EDGE * outward.dot(outward)
    })
}

/// 1 if a polygon is counter-clockwise as seen from where a direction points to, else -1.
fn winding(polygon: &[Corner<3>], direction: V) -> f32 {
    let [first, ..] = polygon else { return 1.0 };
    let mut area: V = Vector::ZERO;
    for pair in polygon.windows(2) {
        area += moment(pair[0].position - first.position, pair[1].position - first.position);
    }
    if area.dot(direction) < 0.0 { -1.0 } else { 1.0 }
}
