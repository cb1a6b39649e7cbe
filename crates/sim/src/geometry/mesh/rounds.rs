//! Contact of balls and capsules with triangle meshes.

use drystone_solver::moment;

use super::solids::nearest_inside;
use super::surface::{Beyond, Facet, MeshFace, UPRIGHT};
use super::{Above, Gathered, ManifoldPoint, MeshPart, MeshQuery, ON_EDGE, Vec3, add};
use crate::geometry::ContactManifold;
use crate::geometry::rounds::{RoundedCore, between_rounds, nearest};

/// A face counts as nearest if it is no farther from the core than an edge, to within this fraction
/// of the distance. \[1\]
const AS_NEAR: f32 = 1e-4;

/// Points of an edge within this fraction of its length from an end count as the vertex there.
/// \[1\]
const END: f32 = 1e-5;

/// Collects the contacts of a ball or a capsule with a mesh, up to a gap of `prediction`, in the
/// frame of the mesh. Returns a lower bound of the gap. \[m\]
pub(crate) fn round(
    ahead: MeshQuery<'_>,
    round: &RoundedCore<3>,
    tree: &parry3d::partitioning::Bvh,
    gathered: &mut Gathered,
) -> f32 {
    gathered.clear();
    gathered.radius = round.radius;
    let [a, b] = round.ends;
    let reach = round.radius + ahead.prediction;
    let corner = |pick: fn(f32, f32) -> f32, reach: f32| {
        let corner: [f32; 3] = std::array::from_fn(|i| pick(a[i], b[i]) + reach);
        corner.into()
    };
    let near =
        parry3d::bounding_volume::Aabb::new(corner(f32::min, -reach), corner(f32::max, reach));
    gathered.near.extend(tree.intersect_aabb(&near));
    let (mut apart, mut behind) = (ahead.prediction, false);
    for at in 0..gathered.near.len() {
        let index = gathered.near[at];
        if let Some(face) = &ahead.surface.faces[index as usize] {
            let meeting = RoundQuery { ahead, round, center: round.at(0.5) };
            apart = apart.min(meeting.collide_face(face, gathered, &mut behind));
        }
    }
    let meeting = RoundQuery { ahead, round, center: round.at(0.5) };
    meeting.lay_on_facets(gathered);
    if behind && let Some(face) = nearest_inside(ahead, meeting.center, &gathered.near) {
        meeting.push_out(face, gathered);
    }
    apart
}

/// A round shape close to a mesh.
struct RoundQuery<'a> {
    ahead: MeshQuery<'a>,
    round: &'a RoundedCore<3>,
    center: Vec3,
}

/// The edge or vertex of a triangle that is nearest to a core.
struct NearestBoundary {
    part: MeshPart,
    distance: f32,
    /// Unit vector from the mesh to the core.
    direction: Vec3,
    /// Position of the nearest point on the core, from 0 to 1.
    along: f32,
    on_mesh: Vec3,
}

impl RoundQuery<'_> {
    /// Collects the contacts of the shape with a triangle. Returns a lower bound of their gap.
    /// \[m\] Sets `behind` if the center is behind a face that has one side.
    fn collide_face(&self, face: &MeshFace, gathered: &mut Gathered, behind: &mut bool) -> f32 {
        let MeshQuery { surface, prediction, .. } = self.ahead;
        let facet = &surface.facets[face.facet as usize];
        let (round, radius) = (self.round, self.round.radius);
        let (side, hidden) = self.ahead.side(facet, self.center);
        let heights = round.ends.map(|end| side * (facet.normal.dot(end) - facet.offset));
        let low = heights[0].min(heights[1]);
        if low - radius > prediction {
            return low - radius;
        }
        *behind |= hidden;
        let over = self.over(face, facet, side, heights);
        let at = |part: f32| heights[0] + (heights[1] - heights[0]) * part;
        let lowest = over.map_or(f32::INFINITY, |[first, last]| at(first).min(at(last)));
        let rim = if face.sharp[usize::from(side < 0.0)] { self.rim(face, side) } else { None };
        let near = rim.filter(|rim| rim.distance < lowest * (1.0 - AS_NEAR));
        match (near, over) {
            (Some(rim), over) => {
                if rim.distance - radius <= prediction {
                    let upright = side * facet.normal.dot(rim.direction) > UPRIGHT;
                    if upright && !hidden {
                        let [first, last] = over.unwrap_or([rim.along; 2]);
                        let range = [first.min(rim.along), last.max(rim.along)];
                        self.is_over(face.facet, side, range, gathered);
                    } else {
                        if matches!(rim.part, MeshPart::Edge(edge) if surface.wings(edge).len() > 1)
                        {
                            gathered.face(facet, side);
                        }
                        self.on_rim(&rim, gathered);
                    }
                }
                rim.distance - radius
            }
            (None, Some(range)) => {
                if !hidden {
                    self.is_over(face.facet, side, range, gathered);
                }
                lowest - radius
            }
            (None, None) => low - radius,
        }
    }

    /// Returns the range of the core that is over a triangle, or comes over it within the step.
    fn over(
        &self,
        face: &MeshFace,
        facet: &Facet,
        side: f32,
        heights: [f32; 2],
    ) -> Option<[f32; 2]> {
        let corners = self.ahead.surface.corners(face);
        let [mut first, mut last] = [0.0f32, 1.0f32];
        let along = self.round.ends[1] - self.round.ends[0];
        for k in 0..3 {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let outward: Vec3 = moment(to - from, facet.normal);
            let slack = ON_EDGE * outward.dot(outward);
            let (height, rise) =
                (outward.dot(self.round.ends[0] - from) - slack, outward.dot(along));
            if rise > 0.0 {
                last = last.min(-height / rise);
            } else if rise < 0.0 {
                first = first.max(-height / rise);
            } else if height > 0.0 {
                first = 2.0;
            }
        }
        let mut range = (first <= last).then_some([first, last]);
        for (end, part) in [(0, 0.0f32), (1, 1.0)] {
            let gap = heights[end] - self.round.radius;
            let location = self.round.ends[end] - facet.normal * (side * self.round.radius);
            let covered = range.is_some_and(|[first, last]| first <= part && part <= last);
            if !covered
                && gap > 0.0
                && (self.ahead.moves_onto(face, facet, side, location, gap)
                    || self.ahead.is_over(face, facet, side, location, gap))
            {
                let [first, last] = range.unwrap_or([part; 2]);
                range = Some([first.min(part), last.max(part)]);
            }
        }
        range
    }

    /// Returns the nearest of the sharp edges and vertices of a triangle.
    fn rim(&self, face: &MeshFace, side: f32) -> Option<NearestBoundary> {
        let surface = self.ahead.surface;
        let mut best: Option<NearestBoundary> = None;
        for k in 0..3 {
            let ends = surface.ends(face.edges[k]);
            let edge = RoundedCore { ends, radius: 0.0 };
            let [along, t] = nearest(self.round, &edge);
            let vertex = if t < END {
                Some(0)
            } else if t > 1.0 - END {
                Some(1)
            } else {
                None
            };
            let part = match vertex {
                Some(end) => {
                    let vertex = surface.edges[face.edges[k] as usize].ends[end];
                    if !surface.vertices[vertex as usize].sharp {
                        continue;
                    }
                    MeshPart::Vertex(vertex)
                }
                None if face.beyond(k, side) == Beyond::Sharp => MeshPart::Edge(face.edges[k]),
                None => continue,
            };
            let on_mesh = vertex.map_or_else(|| edge.at(t), |end| ends[end]);
            let arm = self.round.at(along) - on_mesh;
            let distance = arm.length();
            if distance > 0.0 && best.as_ref().is_none_or(|best| distance < best.distance) {
                let direction = arm * (1.0 / distance);
                best = Some(NearestBoundary { part, distance, direction, along, on_mesh });
            }
        }
        best
    }

    /// Collects the contact with the nearest edge or vertex, if the mesh admits its direction.
    fn on_rim(&self, rim: &NearestBoundary, gathered: &mut Gathered) {
        let MeshQuery { surface, prediction, .. } = self.ahead;
        let &NearestBoundary { part, distance, direction, on_mesh, .. } = rim;
        let radius = self.round.radius;
        let is_ball = self.round.ends[0] == self.round.ends[1];
        let gives = match part {
            MeshPart::Edge(edge) => {
                surface.edge_gives(edge, direction) && !surface.edge_is_flush(edge, direction)
            }
            MeshPart::Vertex(vertex) => {
                surface.vertex_gives(vertex, direction)
                    && !surface.vertex_is_flush(vertex, direction)
            }
            _ => false,
        };
        if !gives || gathered.has(part) {
            return;
        }
        match part {
            MeshPart::Edge(edge) if !is_ball => {
                // If the capsule lies along the edge, both ends touch.
                let edge = RoundedCore { ends: surface.ends(edge), radius: 0.0 };
                let touch = gathered.of(part, direction);
                between_rounds(self.round, &edge, prediction, touch);
            }
            _ => {
                let touch = gathered.of(part, direction);
                let gap = distance - radius;
                let on_a = on_mesh + direction * gap;
                add(touch, ManifoldPoint { on_a, on_b: on_mesh, gap, feature: 0 });
            }
        }
    }

    /// Records that a range of the core is over a side of a facet.
    fn is_over(&self, facet: u32, side: f32, [first, last]: [f32; 2], gathered: &mut Gathered) {
        gathered.face(&self.ahead.surface.facets[facet as usize], side);
        let behind = side < 0.0;
        let same = |above: &&mut Above| above.facet == facet && above.behind == behind;
        if let Some(known) = gathered.facets.iter_mut().find(same) {
            known.over = [known.over[0].min(first), known.over[1].max(last)];
            return;
        }
        let (low, face, corners, over) = (0.0, u32::MAX, 0..0, [first, last]);
        gathered.facets.push(Above { facet, behind, low, face, corners, over, genuine: true });
    }

    /// Collects the contacts at the ends of the range over each facet.
    fn lay_on_facets(&self, gathered: &mut Gathered) {
        for at in 0..gathered.facets.len() {
            let Above { facet: number, behind, over, .. } = gathered.facets[at];
            let side = if behind { -1.0 } else { 1.0 };
            let touch_part = MeshPart::Facet { facet: number, behind };
            let facet = &self.ahead.surface.facets[number as usize];
            let touch = gathered.of(touch_part, facet.normal * side);
            self.lay(facet, side, over, self.ahead.prediction, touch);
        }
    }

    fn lay(
        &self,
        facet: &Facet,
        side: f32,
        over: [f32; 2],
        most: f32,
        touch: &mut ContactManifold<3>,
    ) {
        let normal = facet.normal * side;
        let is_point = over[0] == over[1] || self.round.ends[0] == self.round.ends[1];
        for (end, part) in over[..if is_point { 1 } else { 2 }].iter().enumerate() {
            let on_a = self.round.at(*part) - normal * self.round.radius;
            let gap = normal.dot(on_a) - side * facet.offset;
            if gap <= most {
                let on_b = on_a - normal * gap;
                add(touch, ManifoldPoint { on_a, on_b, gap, feature: end as u64 });
            }
        }
    }

    /// Replaces all contacts by one with a face that pushes the shape out of a solid.
    fn push_out(&self, face: &MeshFace, gathered: &mut Gathered) {
        gathered.count = 0;
        let facet = &self.ahead.surface.facets[face.facet as usize];
        let (side, _) = self.ahead.side(facet, self.center);
        gathered.face(facet, side);
        let part = MeshPart::Facet { facet: face.facet, behind: side < 0.0 };
        let touch = gathered.of(part, facet.normal * side);
        self.lay(facet, side, [0.0, 1.0], f32::INFINITY, touch);
    }
}
