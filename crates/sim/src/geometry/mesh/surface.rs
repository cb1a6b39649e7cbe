//! [`MeshTopology`]: a triangle mesh with the topology that decides which contact normals its
//! features admit.
//!
//! A vertex or an edge admits the normal d if it is a local maximum of d . x: no point of the mesh
//! around it is farther along d. In a flat or concave region only the face admits normals, so
//! contacts do not catch on internal edges. The rule needs no winding, and holds for both sides of
//! an open mesh.

use std::collections::HashMap;
use std::ops::Range;

use drystone_solver::{Vector, moment};

/// Tolerance of coplanar vertices, as a fraction of the largest coordinate: rounding error. \[1\]
const FLAT: f64 = 2e-6;

/// Edges with a smaller bend (tangent of half the angle) admit no normal of their own. \[1\]
const SHARP: f32 = 5e-4;

/// Largest rise of the mesh around a local maximum, as a fraction of the distance from it. \[1\]
const LEVEL: f32 = 1e-3;

/// Directions with a larger cosine between them count as equal. \[1\]
pub(super) const UPRIGHT: f32 = 0.9995;

/// The bend of an edge where the mesh ends.
const OPEN: f32 = f32::INFINITY;

use crate::geometry::Vec3;
use crate::ids::sorted;

/// A triangle mesh prepared for contact detection.
#[derive(Clone, Debug)]
pub(crate) struct MeshTopology {
    pub(super) points: Vec<Vec3>,
    /// By triangle; none for degenerate triangles and for copies of another one.
    pub(super) faces: Vec<Option<MeshFace>>,
    pub(super) facets: Vec<Facet>,
    pub(super) edges: Vec<Edge>,
    pub(super) vertices: Vec<Vertex>,
    /// For all edges: the opposite corner and the facet of each triangle at the edge.
    wings: Vec<[u32; 2]>,
    /// For all vertices: the other ends of their edges.
    rings: Vec<u32>,
    /// For all vertices: the facets around them.
    fans: Vec<u32>,
}

/// A triangle of the mesh.
#[derive(Clone, Debug)]
pub(super) struct MeshFace {
    /// Counter-clockwise seen from where the normal of its facet points.
    pub(super) corners: [u32; 3],
    /// Edges from each corner to the next.
    pub(super) edges: [u32; 3],
    pub(super) facet: u32,
    /// Bend at each edge: tangent of half the angle by which the mesh turns towards the facet's
    /// normal. \[1\]
    bends: [f32; 3],
    /// True if an edge or a vertex may admit a normal of its own: in front of the facet, and behind
    /// it.
    pub(super) sharp: [bool; 2],
}

/// Coplanar triangles that are joined by edges.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub(super) normal: Vec3,
    /// Offset of the plane normal . x = offset. \[m\]
    pub(super) offset: f32,
    /// True if the facet bounds a solid, with an outward normal: it has one side.
    pub(super) solid: bool,
    /// Number of its sheet: triangles connected by edges, whose normals are on one side.
    pub(super) sheet: u32,
    /// True if the facet has more than one triangle.
    pub(super) joined: bool,
}

/// An edge of the mesh.
#[derive(Clone, Debug)]
pub(super) struct Edge {
    pub(super) ends: [u32; 2],
    wings: Range<u32>,
    /// Sum of the normals of the faces at the edge.
    outward: Vec3,
    around: Around,
}

/// Kind of the surface around an edge or a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Around {
    /// All triangles bound solids: contacts are outside only.
    Solid,
    Sheet,
    /// A boundary of the surface.
    Rim,
}

/// A vertex of the mesh.
#[derive(Clone, Debug)]
pub(super) struct Vertex {
    ring: Range<u32>,
    fan: Range<u32>,
    /// True if one of its edges is sharp.
    pub(super) sharp: bool,
    /// Sum of the normals of the faces at the vertex, weighted by angle. It tells on which side of
    /// the surface a point is whose nearest point is this vertex (Baerentzen, Aanaes 2005).
    outward: Vec3,
    around: Around,
}

/// The mesh beyond an edge of a triangle, seen from one side of the triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Beyond {
    /// It turns away or ends: the edge may admit a normal of its own.
    Sharp,
    /// It is flat, or rises with this tangent of half the angle.
    Rises(f32),
}

impl MeshFace {
    pub(super) fn beyond(&self, edge: usize, side: f32) -> Beyond {
        let bend = self.bends[edge] * side;
        if self.bends[edge] == OPEN || bend < -SHARP {
            Beyond::Sharp
        } else {
            Beyond::Rises(bend.max(0.0))
        }
    }
}

impl MeshTopology {
    pub(super) fn corners(&self, face: &MeshFace) -> [Vec3; 3] {
        face.corners.map(|corner| self.points[corner as usize])
    }

    pub(super) fn ends(&self, edge: u32) -> [Vec3; 2] {
        self.edges[edge as usize].ends.map(|end| self.points[end as usize])
    }

    /// True if no point of the mesh around an edge is farther along `direction`, which is across
    /// the edge.
    pub(super) fn edge_gives(&self, edge: u32, direction: Vec3) -> bool {
        let of = &self.edges[edge as usize];
        let start = self.points[of.ends[0] as usize];
        let outside = of.around != Around::Solid || direction.dot(of.outward) > 0.0;
        outside && self.wings(edge).iter().all(|&[apex, _]| self.is_below(apex, start, direction))
    }

    /// True if no point of the mesh around a vertex is farther along `direction`.
    pub(super) fn vertex_gives(&self, vertex: u32, direction: Vec3) -> bool {
        let of = &self.vertices[vertex as usize];
        let location = self.points[vertex as usize];
        let outside = of.around != Around::Solid || direction.dot(of.outward) > 0.0;
        let ring = &self.rings[of.ring.start as usize..of.ring.end as usize];
        outside && ring.iter().all(|&other| self.is_below(other, location, direction))
    }

    fn is_below(&self, point: u32, top: Vec3, direction: Vec3) -> bool {
        let arm = self.points[point as usize] - top;
        let rise = direction.dot(arm);
        rise <= 0.0 || rise * rise <= LEVEL * LEVEL * arm.dot(arm)
    }

    /// Returns the opposite corner and the facet of each triangle at an edge.
    pub(super) fn wings(&self, edge: u32) -> &[[u32; 2]] {
        let Range { start, end } = self.edges[edge as usize].wings;
        &self.wings[start as usize..end as usize]
    }

    /// True if a face at an edge has `direction` as a contact normal.
    pub(super) fn edge_is_flush(&self, edge: u32, direction: Vec3) -> bool {
        self.wings(edge).iter().any(|&[_, facet]| self.looks_along(facet, direction))
    }

    /// True if a face at a vertex has `direction` as a contact normal.
    pub(super) fn vertex_is_flush(&self, vertex: u32, direction: Vec3) -> bool {
        let Range { start, end } = self.vertices[vertex as usize].fan;
        let mut fan = self.fans[start as usize..end as usize].iter();
        fan.any(|&facet| self.looks_along(facet, direction))
    }

    fn looks_along(&self, facet: u32, direction: Vec3) -> bool {
        let Facet { normal, solid, .. } = self.facets[facet as usize];
        let along = normal.dot(direction);
        along > UPRIGHT || !solid && along < -UPRIGHT
    }

    /// Returns the point of a triangle nearest to `location`, and whether `location` is on the
    /// given side of the surface there. The side is 1 where the normals point, or -1. Beyond the
    /// boundary of the surface, the flag is true.
    pub(super) fn nearest(&self, face: &MeshFace, side: f32, location: Vec3) -> (Vec3, bool) {
        let facet = &self.facets[face.facet as usize];
        let corners = self.corners(face);
        let within = (0..3).all(|k| {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let outward: Vec3 = moment(to - from, facet.normal);
            outward.dot(location - from) <= 0.0
        });
        let height = facet.normal.dot(location) - facet.offset;
        if within {
            return (location - facet.normal * height, side * height > 0.0);
        }
        let mut best = (f32::INFINITY, corners[0], true);
        for k in 0..3 {
            let (from, along) = (corners[k], corners[(k + 1) % 3] - corners[k]);
            let part = along.dot(location - from) / along.dot(along).max(f32::MIN_POSITIVE);
            let point = from + along * part.clamp(0.0, 1.0);
            let arm = location - point;
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

    /// Builds the topology of a mesh.
    pub(crate) fn of(mesh: &parry3d::shape::TriMesh) -> Self {
        Builder::of(mesh).finish()
    }
}

/// A mesh while its surface is built, in double precision.
struct Builder {
    points: Vec<Vector<f64, 3>>,
    /// Corners after vertices are merged; none for triangles that are left out.
    triangles: Vec<Option<[u32; 3]>>,
    edges: Vec<[u32; 2]>,
    /// Triangles at each edge.
    at_edge: Vec<Vec<u32>>,
    of_triangle: Vec<[u32; 3]>,
    /// True for triangles that bound a solid. They are wound outward.
    solid: Vec<bool>,
    /// Number of the sheet of each triangle.
    sheet: Vec<u32>,
}

fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

impl Builder {
    fn of(mesh: &parry3d::shape::TriMesh) -> Self {
        let (mut locations, mut points, mut merged) = (HashMap::new(), Vec::new(), Vec::new());
        for vertex in mesh.vertices() {
            // Adding zero turns -0 into 0, so that both merge.
            let location = vertex.to_array().map(|x| (x + 0.0).to_bits());
            merged.push(*locations.entry(location).or_insert_with(|| {
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
            // A copy of another triangle, as in double-sided meshes, adds nothing.
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

    /// Winds the triangles of each sheet alike, and finds the sheets that bound a solid.
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
                        // The sheet is not orientable, as a Moebius strip.
                        closed = false;
                    }
                }
            }
            piece.iter().for_each(|&triangle| self.sheet[triangle] = sheets);
            sheets += 1;
            let volume = if closed { self.volume(&piece) } else { 0.0 };
            // A mesh that is wound inward throughout is a room, whose walls have two sides.
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

    /// Returns six times the volume that triangles enclose. \[m^3\]
    fn volume(&self, piece: &[usize]) -> f64 {
        let corners = || piece.iter().filter_map(|&triangle| self.triangles[triangle]);
        let Some(first) = corners().next() else { return 0.0 };
        let origin = self.points[first[0] as usize];
        let part = |corners: [u32; 3]| {
            area(&self.points, corners).dot(self.points[corners[0] as usize] - origin)
        };
        corners().map(part).sum()
    }

    fn finish(self) -> MeshTopology {
        let Self { points, triangles, edges, at_edge, of_triangle, solid, .. } = &self;
        let areas: Vec<Vector<f64, 3>> = triangles
            .iter()
            .map(|of| of.map_or(Vector::ZERO, |corners| area(points, corners)))
            .collect();
        let (facets, facet_of, turned) = self.facets(&areas);
        let single = |v: Vector<f64, 3>| Vector(v.0.map(|x| x as f32));
        // Collect the wings of each edge.
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
        let mut surface = MeshTopology {
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
                MeshFace { corners, edges: own, facet, bends, sharp: [false; 2] }
            });
            surface.faces.push(face);
        }
        surface.find_vertices(solid);
        surface
    }

    /// Joins coplanar triangles. Returns the facets, the facet of each triangle, and whether the
    /// triangle is wound against it.
    fn facets(&self, areas: &[Vector<f64, 3>]) -> (Vec<Facet>, Vec<u32>, Vec<bool>) {
        let Self { points, triangles, at_edge, of_triangle, solid, .. } = self;
        let size = points.iter().flat_map(|p| p.0).fold(0.0f64, |size, x| size.max(x.abs()));
        let count = triangles.len();
        let (mut facets, mut of, mut turned) =
            (Vec::new(), vec![u32::MAX; count], vec![false; count]);
        // Start with the largest triangles. Slivers have no reliable plane, so they join larger
        // ones.
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
                    // A triangle that is folded back lies in the plane, too, but is wound the other
                    // way.
                    let shared = self.edges[edge as usize];
                    let apex =
                        |of: [u32; 3]| of.into_iter().find(|corner| !shared.contains(corner));
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

    /// True if two points in a plane are on the same side of a line.
    fn same_side(&self, line: [u32; 2], apexes: [u32; 2], normal: Vector<f64, 3>) -> bool {
        let [from, to] = line.map(|corner| self.points[corner as usize]);
        let across: Vector<f64, 3> = moment(to - from, normal);
        let [a, b] = apexes.map(|apex| across.dot(self.points[apex as usize] - from));
        a * b > 0.0
    }
}

/// Returns the normal of a triangle, of twice its area in length. \[m^2\]
fn area(points: &[Vector<f64, 3>], corners: [u32; 3]) -> Vector<f64, 3> {
    let [a, b, c] = corners.map(|corner| points[corner as usize]);
    moment(b - a, c - a)
}

impl MeshTopology {
    /// Returns the bend of the mesh at an edge, seen from the triangle with this facet and this
    /// opposite corner. \[1\]
    fn bend(&self, edge: u32, facet: u32, apex: u32) -> f32 {
        let &[one, other] = self.wings(edge) else { return OPEN };
        let [beyond, theirs] = if one == [apex, facet] { other } else { one };
        if theirs == facet {
            return 0.0;
        }
        let normal = self.facets[facet as usize].normal;
        let [from, to] = self.ends(edge);
        let across: Vec3 = moment(to - from, normal);
        let own = across.dot(self.points[apex as usize] - from);
        let across = across * (-own.signum() / across.length());
        let arm = self.points[beyond as usize] - from;
        let (rise, run) = (normal.dot(arm), across.dot(arm));
        let length = (rise * rise + run * run).sqrt();
        if length + run <= 1e-4 * length { OPEN } else { rise / (length + run) }
    }

    /// Collects the surroundings of each vertex, and marks the faces with sharp edges or vertices.
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
                let location = self.points[own];
                let arms = [1, 2].map(|next| {
                    let arm = self.points[face.corners[(k + next) % 3] as usize] - location;
                    arm * (1.0 / arm.length())
                });
                let angle = libm::acosf(arms[0].dot(arms[1]).clamp(-1.0, 1.0));
                outward[own] += normal * angle;
                // Contacts of a solid are outside only.
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
            face.sharp = [1.0, -1.0]
                .map(|side| vertex || (0..3).any(|k| face.beyond(k, side) == Beyond::Sharp));
        }
    }
}

#[cfg(test)]
mod tests;
