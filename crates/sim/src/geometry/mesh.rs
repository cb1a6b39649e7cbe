//! Contact of convex shapes with triangle meshes, in the frame of the mesh.
//!
//! For each triangle near a shape, the axis of the largest gap is searched. The candidates are the
//! triangle's normal, and axes that an edge, a vertex or the shape proposes. The topology of the
//! mesh must admit them ([`MeshTopology`](surface::MeshTopology)). Contacts are collected by
//! feature. All triangles of a facet share a manifold, as do all features below one face of the
//! shape; an edge or a vertex counts once.
//!
//! An open mesh has two sides: a shape touches it from the side of its center. A closed mesh pushes
//! shapes out along its outward normals, even if their centers are inside.

mod cylinder;
mod nearby;
mod polyhedra;
mod rounds;
mod solids;
mod surface;

use drystone_solver::moment;

pub(crate) use self::surface::MeshTopology;
use self::surface::{Beyond, Facet, MeshFace};
use super::solid::Corner;
use super::{ContactManifold, Curvature, Frame, ManifoldPoint, NormalCarrier};

use super::cylinders;
use super::solid::Polyhedron;

pub(super) use self::rounds::round;

use crate::geometry::Vec3;

/// Points within this fraction of an edge's length of the edge are on both sides of it. \[1\]
const ON_EDGE: f32 = 1e-4;

/// At a concave edge, a point below the mesh still counts for a triangle up to this multiple of its
/// depth beyond the edge. \[1\]
const STEEPEST: f32 = 10.0;

/// The part of a mesh that a manifold belongs to. It is a side of a facet, an edge, a vertex, or
/// the set of all features under a face of the shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MeshPart {
    Facet { facet: u32, behind: bool },
    Edge(u32),
    Vertex(u32),
    Under(u32),
}

impl MeshPart {
    fn number(self) -> u32 {
        match self {
            Self::Facet { facet, behind } => facet << 1 | u32::from(behind),
            Self::Edge(edge) => 1 << 30 | edge,
            Self::Vertex(vertex) => 2 << 30 | vertex,
            Self::Under(face) => 3 << 30 | face,
        }
    }

    /// Returns the curvature of the surfaces at a contact of this part with a shape of this radius,
    /// which is 0 for sharp shapes. \[m\]
    fn surfaces(self, radius: f32) -> Curvature {
        let normal = match self {
            Self::Facet { .. } => NormalCarrier::FaceOfB,
            Self::Under(_) => NormalCarrier::FaceOfA,
            Self::Edge(_) | Self::Vertex(_) if radius > 0.0 => NormalCarrier::Centers,
            Self::Edge(_) | Self::Vertex(_) => NormalCarrier::Edges,
        };
        Curvature { radii: [radius, 0.0], normal }
    }
}

/// Contacts of a shape with a mesh, one manifold for each part. The normals point out of the mesh.
#[derive(Default)]
pub(super) struct Gathered {
    manifolds: Vec<ContactManifold<3>>,
    count: usize,
    /// Triangles near the shape.
    near: Vec<u32>,
    /// Position of the shape above the facets near it.
    facets: Vec<Above>,
    polygon: Vec<Corner<3>>,
    vertices: Vec<Vec3>,
    faces: Vec<(Vec3, f32)>,
    memory: Vec<Corner<3>>,
    /// Sheet of the mesh that the shape touches, and whether it touches it on both sides.
    faced: Option<Faced>,
    both: bool,
    /// Radius of a round shape. \[m\]
    radius: f32,
}

/// Position of a shape above one side of a facet.
#[derive(Clone, Debug)]
struct Above {
    facet: u32,
    behind: bool,
    /// Height of its lowest point above the plane. \[m\]
    low: f32,
    /// For a solid: its face opposite to the facet, and the corners of that face in `polygon`.
    face: u32,
    corners: std::ops::Range<usize>,
    /// For a round shape: the range of its core over the facet, from 0 to 1.
    over: [f32; 2],
    /// True if the facet's normal is the best axis for one of its triangles: then all points over
    /// it count, also those that overlap.
    genuine: bool,
}

impl Gathered {
    fn clear(&mut self) {
        self.count = 0;
        self.facets.clear();
        self.polygon.clear();
        self.near.clear();
        (self.faced, self.both, self.radius) = (None, false, 0.0);
    }

    /// Records that the shape touches this side of a facet, or of its surroundings.
    fn face(&mut self, facet: &Facet, side: f32) {
        let own = Faced { sheet: facet.sheet % SHEETS, side };
        self.both |= self.faced.is_some_and(|known| known.sheet == own.sheet && known != own);
        self.faced = Some(own);
    }

    /// Finds or adds the manifold of a part.
    fn of(&mut self, part: MeshPart, normal: Vec3) -> &mut ContactManifold<3> {
        let number = part.number();
        let known = self.manifolds[..self.count].iter().position(|touch| touch.part == number);
        let index = known.unwrap_or_else(|| {
            if self.count == self.manifolds.len() {
                self.manifolds.push(ContactManifold::default());
            }
            let touch = &mut self.manifolds[self.count];
            touch.points.clear();
            (touch.part, touch.normal) = (number, normal);
            touch.surfaces = part.surfaces(self.radius);
            self.count += 1;
            self.count - 1
        });
        &mut self.manifolds[index]
    }

    fn has(&self, part: MeshPart) -> bool {
        let number = part.number();
        self.manifolds[..self.count].iter().any(|touch| touch.part == number)
    }

    /// Reports the manifolds, reduced, with the shape as a, in the coordinates in which the mesh's
    /// `frame` is given.
    pub(super) fn report(
        &mut self,
        frame: &Frame<3>,
        mesh_is_a: bool,
        report: &mut dyn FnMut(&ContactManifold<3>),
    ) {
        // The next step reads from a point's feature where the shape is.
        let name = if self.both { 0 } else { self.faced.map_or(0, Faced::name) };
        for touch in &mut self.manifolds[..self.count] {
            if touch.points.is_empty() {
                continue;
            }
            touch.reduce();
            touch.transform(frame);
            let points = touch.points.iter_mut().chain(&mut touch.spare);
            points.for_each(|point| point.feature |= name);
            if mesh_is_a {
                touch.exchange();
            }
            touch.report(report);
        }
    }
}

/// The sheet of a mesh that a shape touched in the step before, and the side of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Faced {
    sheet: u32,
    side: f32,
}

/// Sheets are distinguished modulo this number.
const SHEETS: u32 = 1 << 16;

/// Position of the sheet in the feature of a point, below two bits of another meaning.
const FACED: u32 = 44;

impl Faced {
    fn name(self) -> u64 {
        (u64::from(self.sheet) << 2 | if self.side < 0.0 { 3 } else { 2 }) << FACED
    }

    /// Reads the sheet from the feature of a point.
    pub(super) fn of(feature: u64) -> Option<Self> {
        let name = feature >> FACED;
        let side = if name & 1 == 1 { -1.0 } else { 1.0 };
        let faced = Self { sheet: (name >> 2) as u32 % SHEETS, side };
        (feature >> 62 == 0 && name & 2 == 2).then_some(faced)
    }
}

/// Adds a point, unless a point with its feature is known.
fn add(touch: &mut ContactManifold<3>, point: ManifoldPoint<3>) {
    if touch.points.iter().all(|known| known.feature != point.feature) {
        touch.points.push(point);
    }
}

/// A contact query for a shape and a mesh.
#[derive(Clone, Copy)]
pub(super) struct MeshQuery<'a> {
    pub(super) surface: &'a MeshTopology,
    /// Prediction distance. \[m\]
    pub(super) prediction: f32,
    /// Displacement of the shape relative to the mesh until the next contact search. \[m\]
    pub(super) motion: Vec3,
    /// Largest displacement of its surface by rotation until then. \[m\]
    pub(super) turning: f32,
    /// The sheet that the shape touched in the step before.
    pub(super) faced: Option<Faced>,
}

impl MeshQuery<'_> {
    /// Returns the only side of a facet that can be touched. For a solid it is the outer side, for
    /// a sheet the side where the shape was in the step before. So a shape that was pressed through
    /// an open mesh is pushed back.
    fn only_side(&self, facet: &Facet) -> Option<f32> {
        let faced = self.faced.filter(|faced| faced.sheet == facet.sheet % SHEETS);
        if facet.solid { Some(1.0) } else { faced.map(|faced| faced.side) }
    }

    /// Returns the side of a facet that a shape with this center touches, and whether the center is
    /// behind that side.
    fn side(&self, facet: &Facet, center: Vec3) -> (f32, bool) {
        let height = facet.normal.dot(center) - facet.offset;
        let near = if height < 0.0 { -1.0 } else { 1.0 };
        let side = self.only_side(facet).unwrap_or(near);
        (side, side != near)
    }

    /// True if a point is over a triangle, on a side of it (1 or -1) and at a `height` above it.
    /// \[m\]
    ///
    /// A point beyond an edge is still over the triangle in two cases. Either the mesh rises beyond
    /// the edge and the point is below it there. Or motion within the step may bring the point back
    /// over the triangle.
    fn is_over(
        &self,
        face: &MeshFace,
        facet: &Facet,
        side: f32,
        location: Vec3,
        height: f32,
    ) -> bool {
        let corners = self.surface.corners(face);
        (0..3).all(|k| {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let outward: Vec3 = moment(to - from, facet.normal);
            let (beyond, squared) = (outward.dot(location - from), outward.dot(outward));
            if beyond <= ON_EDGE * squared {
                return true;
            }
            let Beyond::Rises(bend) = face.beyond(k, side) else { return false };
            let room = if height < 0.0 {
                -height * bend.min(STEEPEST)
            } else if bend > 0.0 {
                self.motion.length()
            } else {
                return false;
            };
            let beyond = beyond - ON_EDGE * squared;
            beyond * beyond <= room * room * squared
        })
    }

    /// True if a point at a `height` above a triangle \[m\] comes down on it, or moves to a
    /// location where it may.
    fn moves_onto(
        &self,
        face: &MeshFace,
        facet: &Facet,
        side: f32,
        location: Vec3,
        height: f32,
    ) -> bool {
        let approach = -side * facet.normal.dot(self.motion);
        height > 0.0
            && approach > 0.0
            && self.is_over(
                face,
                facet,
                side,
                location + self.motion * (height / approach).min(1.0),
                0.0,
            )
    }
}

/// Collects the contacts of a box or a hull with a mesh, up to a gap of `prediction`, in the frame
/// of the mesh. Returns a lower bound of the gap. \[m\]
pub(super) fn polyhedron(
    ahead: MeshQuery<'_>,
    shape: &impl Polyhedron,
    frame: &Frame<3>,
    tree: &parry3d::partitioning::Bvh,
    gathered: &mut Gathered,
) -> f32 {
    solids::gather(ahead, &polyhedra::PolyhedronInMesh { shape, frame }, tree, gathered)
}

/// Finds the contacts of a cylinder as [`polyhedron`] does for a solid. `before` is the feature of
/// a contact point of the step before.
pub(super) fn cylinder(
    ahead: MeshQuery<'_>,
    cylinder: cylinders::PosedCylinder,
    before: Option<u64>,
    tree: &parry3d::partitioning::Bvh,
    gathered: &mut Gathered,
) -> f32 {
    let before = before.map(|name| name & ((1 << FACED) - 1));
    solids::gather(ahead, &cylinder::CylinderInMesh { cylinder, before }, tree, gathered)
}

/// Fills `touch` with the sharp vertices of a mesh near a half-space, in the frame of the mesh.
/// Returns a lower bound of the gap. \[m\]
pub(super) fn on_plane(
    surface: &MeshTopology,
    (point, normal): (Vec3, Vec3),
    prediction: f32,
    touch: &mut ContactManifold<3>,
) -> f32 {
    let mut apart = prediction;
    touch.points.clear();
    (touch.part, touch.normal) = (0, normal);
    let used = surface.vertices.iter().zip(&surface.points).zip(0..);
    for ((_, &location), feature) in used.filter(|((vertex, _), _)| vertex.sharp) {
        let gap = normal.dot(location - point);
        apart = apart.min(gap);
        if gap <= prediction {
            touch.points.push(ManifoldPoint {
                on_a: location,
                on_b: location - normal * gap,
                gap,
                feature,
            });
        }
    }
    touch.reduce();
    apart
}

#[cfg(test)]
mod tests;
