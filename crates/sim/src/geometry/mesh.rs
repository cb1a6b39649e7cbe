//! Contact of convex shapes with triangle meshes, in the mesh's frame.
//!
//! Each triangle near a shape is asked along which direction the two are farthest apart: its face's normal, or
//! one that an edge, a vertex or the shape proposes and the mesh's topology admits
//! ([`Surface`](surface::Surface)). What is found is gathered by feature: triangles of one facet share a
//! manifold, and so do all that lies under one face of the shape; an edge or a vertex counts once.
//!
//! An open mesh has two sides: a shape touches it from where its center is. A closed one pushes out along its
//! outward normals, also what has its center inside.

mod cylinder;
mod polyhedra;
mod rounds;
mod solids;
mod surface;

use drystone_solver::{Vector, moment};

pub(crate) use self::surface::Surface;
use self::surface::{Beyond, Face, Facet};
use super::solid::Corner;
use super::{ContactManifold, Curvature, Frame, ManifoldPoint, NormalCarrier};

use super::cylinders;
use super::solid::Polyhedron;

pub(super) use self::rounds::round;

type V = Vector<f32, 3>;

/// Places within this part of an edge's length of it are on both sides. \[1\]
const ON_EDGE: f32 = 1e-4;

/// A hollow edge holds what is below it as far as this multiple of the depth beyond it, at most. \[1\]
const STEEPEST: f32 = 10.0;

/// Which part of a mesh a manifold is of: a side of a facet, an edge, a vertex, or all under a face of the shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    Facet { facet: u32, behind: bool },
    Edge(u32),
    Vertex(u32),
    Under(u32),
}

impl Part {
    fn number(self) -> u32 {
        match self {
            Self::Facet { facet, behind } => facet << 1 | u32::from(behind),
            Self::Edge(edge) => 1 << 30 | edge,
            Self::Vertex(vertex) => 2 << 30 | vertex,
            Self::Under(face) => 3 << 30 | face,
        }
    }

    /// How it and a shape of this radius, or a sharp one, are curved where they touch. \[m\]
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

/// What is found on the way through a mesh: one manifold for each part. The normals point out of the mesh.
#[derive(Default)]
pub(super) struct Gathered {
    manifolds: Vec<ContactManifold<3>>,
    count: usize,
    /// The triangles near the shape.
    near: Vec<u32>,
    /// What the shape is to the facets near it.
    facets: Vec<Above>,
    polygon: Vec<Corner<3>>,
    vertices: Vec<V>,
    faces: Vec<(V, f32)>,
    memory: Vec<Corner<3>>,
    /// The piece of the mesh that it touches, and whether on both sides.
    faced: Option<Faced>,
    both: bool,
    /// Of a round shape. \[m\]
    radius: f32,
}

/// What a shape is to one side of a facet.
#[derive(Clone, Debug)]
struct Above {
    facet: u32,
    behind: bool,
    /// How far its lowest point is above the plane. \[m\]
    low: f32,
    /// Of a solid: its face that looks there, and the corners of that one in the polygons.
    face: u32,
    corners: std::ops::Range<usize>,
    /// Of a round shape: which part of its core is over the facet.
    over: [f32; 2],
    /// A solid is farthest from a triangle of it: all that is over it counts, not only what has come by.
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

    /// Notes that the shape touches a side of a facet, or of what is around it.
    fn face(&mut self, facet: &Facet, side: f32) {
        let own = Faced { sheet: facet.sheet % SHEETS, side };
        self.both |= self.faced.is_some_and(|known| known.sheet == own.sheet && known != own);
        self.faced = Some(own);
    }

    /// The manifold of a part.
    fn of(&mut self, part: Part, normal: V) -> &mut ContactManifold<3> {
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

    fn has(&self, part: Part) -> bool {
        let number = part.number();
        self.manifolds[..self.count].iter().any(|touch| touch.part == number)
    }

    /// Reports the manifolds, reduced, with the shape as a and in the coordinates around the mesh's `frame`.
    pub(super) fn report(
        &mut self,
        frame: &Frame<3>,
        mesh_is_a: bool,
        report: &mut dyn FnMut(&ContactManifold<3>),
    ) {
        // Where the shape is told from a point's name in the next step.
        let name = if self.both { 0 } else { self.faced.map_or(0, Faced::name) };
        for touch in &mut self.manifolds[..self.count] {
            if touch.points.is_empty() {
                continue;
            }
            touch.reduce();
            touch.place(frame);
            touch.points.iter_mut().for_each(|point| point.feature |= name);
            if mesh_is_a {
                touch.exchange();
            }
            report(touch);
        }
    }
}

/// A piece of a mesh that a shape has touched a step ago, and on which side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Faced {
    sheet: u32,
    side: f32,
}

/// Pieces are told apart by numbers below this.
const SHEETS: u32 = 1 << 16;

/// Where the name of a piece begins in that of a point, behind two bits that are another's.
const FACED: u32 = 44;

impl Faced {
    fn name(self) -> u64 {
        (u64::from(self.sheet) << 2 | if self.side < 0.0 { 3 } else { 2 }) << FACED
    }

    /// What the name of a point tells.
    pub(super) fn of(feature: u64) -> Option<Self> {
        let name = feature >> FACED;
        let side = if name & 1 == 1 { -1.0 } else { 1.0 };
        let faced = Self { sheet: (name >> 2) as u32 % SHEETS, side };
        (feature >> 62 == 0 && name & 2 == 2).then_some(faced)
    }
}

/// Adds a point, once.
fn add(touch: &mut ContactManifold<3>, point: ManifoldPoint<3>) {
    if touch.points.iter().all(|known| known.feature != point.feature) {
        touch.points.push(point);
    }
}

/// A shape and a mesh: how far ahead contacts are looked for.
#[derive(Clone, Copy)]
pub(super) struct MeshQuery<'a> {
    pub(super) surface: &'a Surface,
    /// \[m\]
    pub(super) prediction: f32,
    /// How the shape moves against the mesh until contacts are searched again. \[m\]
    pub(super) motion: V,
    /// How far it comes by turning until then. \[m\]
    pub(super) turning: f32,
    /// What the shape has touched a step ago.
    pub(super) faced: Option<Faced>,
}

impl MeshQuery<'_> {
    /// The side of a facet that alone touches: that of a solid, or where the shape was a step ago. So what is pressed
    /// through an open mesh in between is pushed back.
    fn only_side(&self, facet: &Facet) -> Option<f32> {
        let faced = self.faced.filter(|faced| faced.sheet == facet.sheet % SHEETS);
        if facet.solid { Some(1.0) } else { faced.map(|faced| faced.side) }
    }

    /// The side of a facet that a shape with this center touches, and whether that is hidden from the center.
    fn side(&self, facet: &Facet, center: V) -> (f32, bool) {
        let height = facet.normal.dot(center) - facet.offset;
        let near = if height < 0.0 { -1.0 } else { 1.0 };
        let side = self.only_side(facet).unwrap_or(near);
        (side, side != near)
    }

    /// Whether a place is over a triangle, on a side of it (1 or -1) and at a `height` above it. \[m\] Beyond
    /// an edge where the mesh rises, it still is where it is below the mesh there; and where what moves there
    /// within the step may be turned towards the triangle.
    fn is_over(&self, face: &Face, facet: &Facet, side: f32, place: V, height: f32) -> bool {
        let corners = self.surface.corners(face);
        (0..3).all(|k| {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let outward: V = moment(to - from, facet.normal);
            let (beyond, squared) = (outward.dot(place - from), outward.dot(outward));
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

    /// Whether a place at a `height` above a triangle comes down on it, or to where it may. \[m\]
    fn comes_over(&self, face: &Face, facet: &Facet, side: f32, place: V, height: f32) -> bool {
        let approach = -side * facet.normal.dot(self.motion);
        height > 0.0
            && approach > 0.0
            && self.is_over(
                face,
                facet,
                side,
                place + self.motion * (height / approach).min(1.0),
                0.0,
            )
    }
}

/// Gathers where a box or a hull touches a mesh or is within `prediction` of it, in the frame of the mesh. Returns how
/// far they are apart at least. \[m\]
pub(super) fn polyhedron(
    ahead: MeshQuery<'_>,
    shape: &impl Polyhedron,
    frame: &Frame<3>,
    tree: &parry3d::partitioning::Bvh,
    gathered: &mut Gathered,
) -> f32 {
    solids::gather(ahead, &polyhedra::Seen { shape, frame }, tree, gathered)
}

/// The same of a cylinder. `before` is the feature of a point where they touched a step ago.
pub(super) fn cylinder(
    ahead: MeshQuery<'_>,
    cylinder: cylinders::Placed,
    before: Option<u64>,
    tree: &parry3d::partitioning::Bvh,
    gathered: &mut Gathered,
) -> f32 {
    let before = before.map(|name| name & ((1 << FACED) - 1));
    solids::gather(ahead, &cylinder::Seen { cylinder, before }, tree, gathered)
}

/// Where a mesh is near a half-space, in the frame of the mesh: its vertices. Returns how far they are apart.
pub(super) fn on_plane(
    surface: &Surface,
    (point, normal): (V, V),
    prediction: f32,
    touch: &mut ContactManifold<3>,
) -> f32 {
    let mut apart = prediction;
    touch.points.clear();
    (touch.part, touch.normal) = (0, normal);
    let used = surface.vertices.iter().zip(&surface.points).zip(0..);
    for ((_, &place), feature) in used.filter(|((vertex, _), _)| vertex.sharp) {
        let gap = normal.dot(place - point);
        apart = apart.min(gap);
        if gap <= prediction {
            touch.points.push(ManifoldPoint {
                on_a: place,
                on_b: place - normal * gap,
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
