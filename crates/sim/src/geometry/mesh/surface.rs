//! [`Surface`]: a triangle mesh with the topology that decides which normals its parts may give.
//!
//! A direction d is a normal of a vertex or an edge if the mesh around it has no point farther along d: the
//! feature is a local maximum of d . x. Inside a flat or hollow region nothing but the face is one, so
//! inner edges are not felt. The rule needs no winding, and holds for both sides of an open mesh.

use std::collections::HashMap;
use std::ops::Range;

use drystone_solver::{Vector, moment};

/// Vertices within this part of the mesh's reach of a plane lie in it: what rounding leaves. \[1\]
const FLAT: f64 = 2e-6;

/// Edges bent by less than this, as the tangent of half the angle, give no normal of their own. \[1\]
const SHARP: f32 = 5e-4;

/// How far the mesh may rise around a local maximum, as part of the distance. \[1\]
const LEVEL: f32 = 1e-3;

/// Directions with a larger cosine between them count as one. \[1\]
pub(super) const UPRIGHT: f32 = 0.9995;

/// The bend of an edge that the mesh does not continue beyond.
const OPEN: f32 = f32::INFINITY;

type V = Vector<f32, 3>;

/// A triangle mesh as contacts see it.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    pub(super) points: Vec<V>,
    /// By triangle; none for a copy of another.
    pub(super) faces: Vec<Option<Face>>,
    pub(super) facets: Vec<Facet>,
    pub(super) edges: Vec<Edge>,
    pub(super) vertices: Vec<Vertex>,
    /// Of all edges: the opposite corner and the facet of each triangle there.
    wings: Vec<[u32; 2]>,
    /// Of all vertices: those at the other ends of their edges.
    rings: Vec<u32>,
    /// Of all vertices: the facets around them.
    fans: Vec<u32>,
}

/// A triangle.
#[derive(Clone, Debug)]
pub(super) struct Face {
    /// Counter-clockwise seen along its facet's normal.
    pub(super) corners: [u32; 3],
    /// From each corner to the next.
    pub(super) edges: [u32; 3],
    pub(super) facet: u32,
    /// At each edge, the tangent of half the angle by which the mesh turns towards the facet's normal.
    bends: [f32; 3],
    /// Whether an edge or a vertex may have a normal of its own: before the facet's normal, and behind.
    pub(super) sharp: [bool; 2],
}

/// Triangles in one plane that are joined by edges.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub(super) normal: V,
    /// The plane is where normal . x = offset. \[m\]
    pub(super) offset: f32,
    /// Whether it bounds a solid, with the normal outward: it has one side.
    pub(super) solid: bool,
    /// Which of the pieces of the mesh that hang together by edges it is of; their normals are on one side.
    pub(super) sheet: u32,
    /// Whether it is more than one triangle.
    pub(super) joined: bool,
}

/// A side of triangles.
#[derive(Clone, Debug)]
pub(super) struct Edge {
    pub(super) ends: [u32; 2],
    wings: Range<u32>,
    /// The sum of its faces' normals.
    outward: V,
    around: Around,
}

/// What the triangles around an edge or a vertex are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Around {
    /// All of solids: they are touched from outside only.
    Solid,
    Sheet,
    /// At an end of the surface.
    Rim,
}

/// A corner of triangles.
#[derive(Clone, Debug)]
pub(super) struct Vertex {
    ring: Range<u32>,
    fan: Range<u32>,
    /// Whether one of its edges is sharp.
    pub(super) sharp: bool,
    /// The sum of its faces' normals, weighted by angle: on which side a place is whose nearest point it is (Baerentzen,
    /// Aanaes 2005).
    outward: V,
    around: Around,
}

/// What the mesh does beyond an edge of a triangle, seen from one side of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Beyond {
    /// It turns away or ends: the edge may have a normal of its own.
    Sharp,
    /// It goes on, or rises with this tangent of half the angle.
    Rises(f32),
}

impl Face {
    pub(super) fn beyond(&self, edge: usize, side: f32) -> Beyond {
        let bend = self.bends[edge] * side;
        if self.bends[edge] == OPEN || bend < -SHARP {
            Beyond::Sharp
        } else {
            Beyond::Rises(bend.max(0.0))
        }
    }
}

impl Surface {
    pub(super) fn corners(&self, face: &Face) -> [V; 3] {
        face.corners.map(|corner| self.points[corner as usize])
    }

    pub(super) fn ends(&self, edge: u32) -> [V; 2] {
        self.edges[edge as usize].ends.map(|end| self.points[end as usize])
    }

    /// Whether the mesh around an edge has nothing farther along `direction`, which is across it.
    pub(super) fn edge_gives(&self, edge: u32, direction: V) -> bool {
        let of = &self.edges[edge as usize];
        let start = self.points[of.ends[0] as usize];
        let outside = of.around != Around::Solid || direction.dot(of.outward) > 0.0;
        outside && self.wings(edge).iter().all(|&[apex, _]| self.is_below(apex, start, direction))
    }

    /// The same of a vertex.
    pub(super) fn vertex_gives(&self, vertex: u32, direction: V) -> bool {
        let of = &self.vertices[vertex as usize];
        let place = self.points[vertex as usize];
        let outside = of.around != Around::Solid || direction.dot(of.outward) > 0.0;
        let ring = &self.rings[of.ring.start as usize..of.ring.end as usize];
        outside && ring.iter().all(|&other| self.is_below(other, place, direction))
    }

    fn is_below(&self, point: u32, top: V, direction: V) -> bool {
        let arm = self.points[point as usize] - top;
        let rise = direction.dot(arm);
        rise <= 0.0 || rise * rise <= LEVEL * LEVEL * arm.dot(arm)
    }

    /// The opposite corner and the facet of each triangle at an edge.
    pub(super) fn wings(&self, edge: u32) -> &[[u32; 2]] {
        let Range { start, end } = self.edges[edge as usize].wings;
        &self.wings[start as usize..end as usize]
    }

    /// Whether a face at an edge looks along a direction.
    pub(super) fn edge_is_flush(&self, edge: u32, direction: V) -> bool {
        self.wings(edge).iter().any(|&[_, facet]| self.looks_along(facet, direction))
    }

    /// Whether a face at a vertex looks along a direction.
    pub(super) fn vertex_is_flush(&self, vertex: u32, direction: V) -> bool {
        let Range { start, end } = self.vertices[vertex as usize].fan;
        let mut fan = self.fans[start as usize..end as usize].iter();
        fan.any(|&facet| self.looks_along(facet, direction))
    }

    fn looks_along(&self, facet: u32, direction: V) -> bool {
        let Facet { normal, solid, .. } = self.facets[facet as usize];
        let along = normal.dot(direction);
        along > UPRIGHT || !solid && along < -UPRIGHT
    }

    /// The point of a triangle nearest to a place, and whether that is on a side of the surface there (1: where the
    /// normals point to, or -1), or beyond its end.
    pub(super) fn nearest(&self, face: &Face, side: f32, place: V) -> (V, bool) {
        let facet = &self.facets[face.facet as usize];
        let corners = self.corners(face);
        let within = (0..3).all(|k| {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let outward: V = moment(to - from, facet.normal);
            outward.dot(place - from) <= 0.0
        });
        let height = facet.normal.dot(place) - facet.offset;
        if within {
            return (place - facet.normal * height, side * height > 0.0);
        }
        let mut best = (f32::INFINITY, corners[0], true);
        for k in 0..3 {
            let (from, along) = (corners[k], corners[(k + 1) % 3] - corners[k]);
            let part = along.dot(place - from) / along.dot(along).max(f32::MIN_POSITIVE);
            let point = from + along * part.clamp(0.0, 1.0);
            let arm = place - point;
            if arm.dot(arm) < best.0 {
                let vertex = |k: usize| {
                    let of = &self.vertices[face.corners[k] as usize];
                    (of.outward, of.around)
                };
                let (outward, around) = if part <= 0.0 {
                    vertex(k)
                } else if part >= 1.0 {
                    vertex((k + 1) % 3)
                } else {
                    let of = &self.edges[face.edges[k] as usize];
                    (of.outward, of.around)
                };
                let outside = around == Around::Rim || side * outward.dot(arm) >= 0.0;
                best = (arm.dot(arm), point, outside);
            }
        }
        (best.1, best.2)
    }

    /// The topology of a mesh.
    pub(crate) fn of(mesh: &parry3d::shape::TriMesh) -> Self {
        Builder::of(mesh).finish()
    }
}

/// Triangles on their way to a surface, in twice the precision.
struct Builder {
    points: Vec<Vector<f64, 3>>,
    /// Corners after merging; none for what is left out.
    triangles: Vec<Option<[u32; 3]>>,
    edges: Vec<[u32; 2]>,
    /// The triangles at each edge.
    at_edge: Vec<Vec<u32>>,
    of_triangle: Vec<[u32; 3]>,
    /// Whether a triangle bounds a solid, wound outward.
    solid: Vec<bool>,
    /// The piece that it is of.
    sheet: Vec<u32>,
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

impl Builder {
    fn of(mesh: &parry3d::shape::TriMesh) -> Self {
        let (mut places, mut points, mut merged) = (HashMap::new(), Vec::new(), Vec::new());
        for vertex in mesh.vertices() {
            // Adding zero makes one of both zeros.
            let place = vertex.to_array().map(|x| (x + 0.0).to_bits());
            merged.push(*places.entry(place).or_insert_with(|| {
                points.push(Vector(vertex.to_array().map(f64::from)));
                points.len() as u32 - 1
            }));
        }
        let (mut seen, mut numbers) = (HashMap::new(), HashMap::new());
        let (mut edges, mut at_edge) = (Vec::new(), Vec::<Vec<u32>>::new());
        let (mut triangles, mut of_triangle) = (Vec::new(), Vec::new());
        for (index, corners) in mesh.indices().iter().enumerate() {
            let corners = corners.map(|corner| merged[corner as usize]);
            let mut set = corners;
            set.sort_unstable();
            let flat = set[0] == set[1] || set[1] == set[2];
            // A copy of another triangle, as double-sided meshes have, adds nothing.
            if flat || seen.insert(set, index).is_some() || area(&points, corners).length() <= 0.0 {
                triangles.push(None);
                of_triangle.push([0; 3]);
                continue;
            }
            triangles.push(Some(corners));
            of_triangle.push(sides(corners).map(|side| {
                let number = *numbers.entry(sorted(side)).or_insert_with(|| {
                    edges.push(sorted(side));
                    at_edge.push(Vec::new());
                    edges.len() - 1
                });
                at_edge[number].push(index as u32);
                number as u32
            }));
        }
        let (solid, sheet) = (vec![false; triangles.len()], vec![0; triangles.len()]);
        let mut builder = Self { points, triangles, edges, at_edge, of_triangle, solid, sheet };
        builder.orient();
        builder
    }

    /// Winds neighbors alike, and tells what bounds a solid.
    fn orient(&mut self) {
        let mut seen = vec![false; self.triangles.len()];
        let mut sheets = 0;
        for start in 0..self.triangles.len() {
            if seen[start] || self.triangles[start].is_none() {
                continue;
            }
            seen[start] = true;
            let mut piece = vec![start];
            let (mut closed, mut turned, mut at) = (true, false, 0);
            while let Some(&triangle) = piece.get(at) {
                at += 1;
                let Some(corners) = self.triangles[triangle] else { continue };
                for (side, edge) in sides(corners).into_iter().zip(self.of_triangle[triangle]) {
                    let &[one, other] = self.at_edge[edge as usize].as_slice() else {
                        closed = false;
                        continue;
                    };
                    let other = if one as usize == triangle { other } else { one } as usize;
                    let Some(theirs) = self.triangles[other] else { continue };
                    let alike = !sides(theirs).contains(&side);
                    if !seen[other] {
                        seen[other] = true;
                        piece.push(other);
                        if !alike {
                            turned = true;
                            self.turn(other);
                        }
                    } else if !alike {
                        // It has one side only, as a Moebius strip.
                        closed = false;
                    }
                }
            }
            piece.iter().for_each(|&triangle| self.sheet[triangle] = sheets);
            sheets += 1;
            let volume = if closed { self.volume(&piece) } else { 0.0 };
            // Wound inward throughout it is a room, with a wall of two sides.
            if volume > 0.0 || volume < 0.0 && turned {
                for triangle in piece {
                    self.solid[triangle] = true;
                    if volume < 0.0 {
                        self.turn(triangle);
                    }
                }
            }
        }
    }

    fn turn(&mut self, triangle: usize) {
        if let Some(corners) = &mut self.triangles[triangle] {
            corners.swap(1, 2);
            self.of_triangle[triangle].swap(0, 2);
        }
    }

    /// Six times the volume that triangles enclose. \[m^3\]
    fn volume(&self, piece: &[usize]) -> f64 {
        let corners = || piece.iter().filter_map(|&triangle| self.triangles[triangle]);
        let Some(first) = corners().next() else { return 0.0 };
        let origin = self.points[first[0] as usize];
        let part = |corners: [u32; 3]| {
            area(&self.points, corners).dot(self.points[corners[0] as usize] - origin)
        };
        corners().map(part).sum()
    }

    fn finish(self) -> Surface {
        let Self { points, triangles, edges, at_edge, of_triangle, solid, .. } = &self;
        let areas: Vec<Vector<f64, 3>> = triangles
            .iter()
            .map(|of| of.map_or(Vector::ZERO, |corners| area(points, corners)))
            .collect();
        let (facets, facet_of, turned) = self.facets(&areas);
        let single = |v: Vector<f64, 3>| Vector(v.0.map(|x| x as f32));
        // Edges with their wings.
        let mut wings = Vec::new();
        let mut around: Vec<Edge> = Vec::with_capacity(edges.len());
        for (&ends, at) in edges.iter().zip(at_edge) {
            let start = wings.len() as u32;
            let mut outward = Vector::ZERO;
            for &triangle in at {
                let corners = triangles[triangle as usize].unwrap_or_default();
                let apex = corners.into_iter().find(|corner| !ends.contains(corner));
                wings.push([apex.unwrap_or(ends[0]), facet_of[triangle as usize]]);
                outward += facets[facet_of[triangle as usize] as usize].normal;
            }
            let own = if at.len() == 1 {
                Around::Rim
            } else if at.iter().all(|&triangle| solid[triangle as usize]) {
                Around::Solid
            } else {
                Around::Sheet
            };
            around.push(Edge { ends, wings: start..wings.len() as u32, outward, around: own });
        }
        let mut surface = Surface {
            points: points.iter().map(|&point| single(point)).collect(),
            faces: Vec::with_capacity(triangles.len()),
            facets,
            edges: around,
            vertices: Vec::new(),
            wings,
            rings: Vec::new(),
            fans: Vec::new(),
        };
        for (triangle, corners) in triangles.iter().enumerate() {
            let face = corners.map(|mut corners| {
                let (facet, mut own) = (facet_of[triangle], of_triangle[triangle]);
                if turned[triangle] {
                    corners.swap(1, 2);
                    own.swap(0, 2);
                }
                let bends = [0, 1, 2].map(|k| surface.bend(own[k], facet, corners[(k + 2) % 3]));
                Face { corners, edges: own, facet, bends, sharp: [false; 2] }
            });
            surface.faces.push(face);
        }
        surface.find_vertices(solid);
        surface
    }

    /// Joins triangles in one plane: the facets, that of each triangle, and whether it is wound against it.
    fn facets(&self, areas: &[Vector<f64, 3>]) -> (Vec<Facet>, Vec<u32>, Vec<bool>) {
        let Self { points, triangles, at_edge, of_triangle, solid, .. } = self;
        let size = points.iter().flat_map(|p| p.0).fold(0.0f64, |size, x| size.max(x.abs()));
        let count = triangles.len();
        let (mut facets, mut of, mut turned) = (Vec::new(), vec![u32::MAX; count], vec![false; count]);
        // From the largest on: slivers, whose own planes mean nothing, join what they lie on.
        let mut order: Vec<usize> = (0..count).filter(|&t| triangles[t].is_some()).collect();
        order.sort_by(|&a, &b| areas[b].length().total_cmp(&areas[a].length()));
        for seed in order {
            let Some(corners) = triangles[seed] else { continue };
            if of[seed] != u32::MAX {
                continue;
            }
            let normal = areas[seed] * (1.0 / areas[seed].length());
            let offset = normal.dot(points[corners[0] as usize]);
            let out = |corner: u32| normal.dot(points[corner as usize]) - offset;
            let number = facets.len() as u32;
            of[seed] = number;
            let (mut piece, mut at) = (vec![seed], 0);
            while let Some(&triangle) = piece.get(at) {
                at += 1;
                for edge in of_triangle[triangle] {
                    let &[one, other] = at_edge[edge as usize].as_slice() else { continue };
                    let other = if one as usize == triangle { other } else { one } as usize;
                    let Some(theirs) = triangles[other] else { continue };
                    let flat = theirs.iter().all(|&corner| out(corner).abs() <= FLAT * size);
                    // One that is folded back lies in the plane, too, and is wound the other way.
                    let shared = self.edges[edge as usize];
                    let apex = |of: [u32; 3]| of.into_iter().find(|corner| !shared.contains(corner));
                    let folded = match (triangles[triangle].and_then(apex), apex(theirs)) {
                        (Some(own), Some(other)) => self.same_side(shared, [own, other], normal),
                        _ => true,
                    };
                    if of[other] == u32::MAX && flat && !folded && solid[other] == solid[seed] {
                        of[other] = number;
                        turned[other] = areas[other].dot(normal) < 0.0;
                        piece.push(other);
                    }
                }
            }
            facets.push(Facet {
                normal: Vector(normal.0.map(|x| x as f32)),
                offset: offset as f32,
                solid: solid[seed],
                sheet: self.sheet[seed],
                joined: piece.len() > 1,
            });
        }
        (facets, of, turned)
    }

    /// Whether two points in a plane are on the same side of a line.
    fn same_side(&self, line: [u32; 2], apexes: [u32; 2], normal: Vector<f64, 3>) -> bool {
        let [from, to] = line.map(|corner| self.points[corner as usize]);
        let across: Vector<f64, 3> = moment(to - from, normal);
        let [a, b] = apexes.map(|apex| across.dot(self.points[apex as usize] - from));
        a * b > 0.0
    }
}

/// Twice the area of a triangle, along its normal. \[m^2\]
fn area(points: &[Vector<f64, 3>], corners: [u32; 3]) -> Vector<f64, 3> {
    let [a, b, c] = corners.map(|corner| points[corner as usize]);
    moment(b - a, c - a)
}

impl Surface {
    /// By how much the mesh bends at an edge, as a triangle of this facet with this opposite corner sees it.
    fn bend(&self, edge: u32, facet: u32, apex: u32) -> f32 {
        let &[one, other] = self.wings(edge) else { return OPEN };
        let [beyond, theirs] = if one == [apex, facet] { other } else { one };
        if theirs == facet {
            return 0.0;
        }
        let normal = self.facets[facet as usize].normal;
        let [from, to] = self.ends(edge);
        let across: V = moment(to - from, normal);
        let own = across.dot(self.points[apex as usize] - from);
        let across = across * (-own.signum() / across.length());
        let arm = self.points[beyond as usize] - from;
        let (rise, run) = (normal.dot(arm), across.dot(arm));
        let length = (rise * rise + run * run).sqrt();
        if length + run <= 1e-4 * length { OPEN } else { rise / (length + run) }
    }

    /// Gathers what is around each vertex, and which triangles have sharp parts.
    fn find_vertices(&mut self, solid: &[bool]) {
        let count = self.points.len();
        let (mut rings, mut fans) = (vec![Vec::new(); count], vec![Vec::new(); count]);
        let (mut outward, mut around, mut sharp) =
            (vec![Vector::ZERO; count], vec![Around::Solid; count], vec![false; count]);
        for edge in &self.edges {
            let [a, b] = edge.ends;
            for end in edge.ends.map(|end| end as usize) {
                match edge.around {
                    Around::Rim => around[end] = Around::Rim,
                    Around::Sheet if around[end] == Around::Solid => around[end] = Around::Sheet,
                    _ => {}
                }
            }
            rings[a as usize].push(b);
            rings[b as usize].push(a);
        }
        for (face, &solid) in self.faces.iter().zip(solid) {
            let Some(face) = face else { continue };
            let normal = self.facets[face.facet as usize].normal;
            for (k, corner) in face.corners.iter().enumerate() {
                let own = *corner as usize;
                if !fans[own].contains(&face.facet) {
                    fans[own].push(face.facet);
                }
                let place = self.points[own];
                let arms = [1, 2].map(|next| {
                    let arm = self.points[face.corners[(k + next) % 3] as usize] - place;
                    arm * (1.0 / arm.length())
                });
                let angle = libm::acosf(arms[0].dot(arms[1]).clamp(-1.0, 1.0));
                outward[own] += normal * angle;
                // A solid is touched from outside only.
                let seen = |side: &f32| face.beyond(k, *side) == Beyond::Sharp;
                if [1.0, -1.0][..if solid { 1 } else { 2 }].iter().any(seen) {
                    sharp[own] = true;
                    sharp[face.corners[(k + 1) % 3] as usize] = true;
                }
            }
        }
        for own in 0..count {
            let starts = [self.rings.len() as u32, self.fans.len() as u32];
            self.rings.append(&mut rings[own]);
            self.fans.append(&mut fans[own]);
            self.vertices.push(Vertex {
                ring: starts[0]..self.rings.len() as u32,
                fan: starts[1]..self.fans.len() as u32,
                sharp: sharp[own],
                outward: outward[own],
                around: around[own],
            });
        }
        for face in self.faces.iter_mut().flatten() {
            let vertex = face.corners.iter().any(|&corner| sharp[corner as usize]);
            face.sharp = [1.0, -1.0].map(|side| {
                vertex || (0..3).any(|k| face.beyond(k, side) == Beyond::Sharp)
            });
        }
    }
}

#[cfg(test)]
mod tests;
