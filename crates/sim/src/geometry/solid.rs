//! [`Solid`]: convex solids with flat faces for contact detection. Implemented here for boxes, and
//! for hulls in 2D.

use std::array::from_fn;

use drystone_solver::{Vector, moment};

/// A convex solid with flat faces, in its own frame.
pub(super) trait Solid<const L: usize> {
    /// Returns the farthest vertex along `direction`.
    fn support(&self, direction: Vector<f32, L>) -> Vector<f32, L>;

    /// Returns the number of faces (2D: sides).
    fn faces(&self) -> usize;

    /// Returns the outward unit normal of a face, and a point of its plane.
    fn face(&self, index: usize) -> (Vector<f32, L>, Vector<f32, L>);

    /// Returns the number of edges (2D: sides).
    fn edges(&self) -> usize;

    /// Returns the ends of an edge.
    fn edge(&self, index: usize) -> [Vector<f32, L>; 2];

    /// Returns the edges around a face, and perhaps others.
    fn around(&self, face: usize) -> impl Iterator<Item = usize> {
        let _ = face;
        0..self.edges()
    }

    /// Appends the vertices of a face, in order around it.
    fn corners(&self, face: usize, out: &mut Vec<Corner<L>>);

    /// Calls `side` with each plane through a side of a face. The arguments are a point of the
    /// plane, and a vector out of the face, about as long as the face. `memory` is scratch memory
    /// for its corners.
    fn sides(
        &self,
        face: usize,
        memory: &mut Vec<Corner<L>>,
        mut side: impl FnMut(Vector<f32, L>, Vector<f32, L>),
    ) {
        memory.clear();
        self.corners(face, memory);
        let normal = self.face(face).0;
        for (i, corner) in memory.iter().enumerate() {
            let (start, end) = (corner.position, memory[(i + 1) % memory.len()].position);
            // In 2D, the sides of a face are its ends.
            side(start, if L == 2 { start - end } else { moment(end - start, normal) });
        }
    }

    /// Returns the face whose normal is closest to `direction`, among those at the farthest vertex.
    /// On a hull with a sharp corner, another face may have a closer normal and be behind.
    fn facing(&self, direction: Vector<f32, L>) -> usize {
        let farthest = self.support(direction);
        let mut best = (f32::NEG_INFINITY, 0);
        for index in 0..self.faces() {
            let (normal, vertex) = self.face(index);
            let along = normal.dot(direction);
            let arm = farthest - vertex;
            if along > best.0 && normal.dot(arm) >= -1e-4 * arm.length() {
                best = (along, index);
            }
        }
        best.1
    }
}

/// A solid with numbered vertices and edges.
pub(super) trait Polyhedron: Solid<3> {
    /// Appends the vertices. A corner's feature is the index of its vertex.
    fn vertices(&self, out: &mut Vec<Vector<f32, 3>>);

    /// Returns the indices of the vertices at the ends of an edge.
    fn ends(&self, edge: usize) -> [usize; 2];

    /// Returns the two faces at an edge.
    fn flanks(&self, edge: usize) -> [usize; 2];
}

/// A vertex of a polygon that is clipped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner<const L: usize> {
    pub(super) position: Vector<f32, L>,
    /// Identifies its source: a vertex, or an edge cut by a side.
    pub(super) feature: u32,
    /// Height above the clipping plane, times the length of that plane's normal. \[m\]
    pub(super) height: f32,
}

impl<const L: usize> Corner<L> {
    pub(super) fn new(position: Vector<f32, L>, feature: u32) -> Self {
        Self { position, feature, height: 0.0 }
    }
}

/// A box of any dimension, given by its half extents. \[m\]
#[derive(Clone, Copy, Debug)]
pub(super) struct Cuboid<const L: usize>(pub(super) Vector<f32, L>);

impl<const L: usize> Solid<L> for Cuboid<L> {
    fn support(&self, direction: Vector<f32, L>) -> Vector<f32, L> {
        Vector(from_fn(|i| self.0[i].copysign(direction[i])))
    }

    fn faces(&self) -> usize {
        2 * L
    }

    fn face(&self, index: usize) -> (Vector<f32, L>, Vector<f32, L>) {
        let sign = if index < L { 1.0 } else { -1.0 };
        (along(index % L, sign), self.0 * sign)
    }

    fn edges(&self) -> usize {
        L << (L - 1)
    }

    fn edge(&self, index: usize) -> [Vector<f32, L>; 2] {
        // The upper bits are the axis along the edge; each lower bit is the side on another axis.
        let axis = index >> (L - 1);
        let mut from = self.0;
        from[axis] = -self.0[axis];
        for other in 1..L {
            let i = (axis + other) % L;
            from[i] = if index >> (other - 1) & 1 == 0 { -self.0[i] } else { self.0[i] };
        }
        let mut to = from;
        to[axis] = self.0[axis];
        [from, to]
    }

    fn around(&self, face: usize) -> impl Iterator<Item = usize> {
        (0..self.edges()).filter(move |edge| {
            let other = (face % L + L - (edge >> (L - 1))) % L;
            other > 0 && (edge >> (other - 1) & 1 == 1) == (face < L)
        })
    }

    fn sides(
        &self,
        face: usize,
        _: &mut Vec<Corner<L>>,
        mut side: impl FnMut(Vector<f32, L>, Vector<f32, L>),
    ) {
        for other in 1..L {
            let axis = (face + other) % L;
            for sign in [1.0, -1.0] {
                let point = along(axis, sign * self.0[axis]);
                side(point, point * 2.0);
            }
        }
    }

    fn facing(&self, direction: Vector<f32, L>) -> usize {
        let farther = |best, axis| {
            let (most, along): (f32, f32) = (direction[best], direction[axis]);
            if along.abs() > most.abs() { axis } else { best }
        };
        let axis = (1..L).fold(0, farther);
        if direction[axis] > 0.0 { axis } else { axis + L }
    }

    fn corners(&self, face: usize, out: &mut Vec<Corner<L>>) {
        let axis = face % L;
        let sign = if face < L { 1.0 } else { -1.0 };
        let u = (axis + 1) % L;
        // Counter-clockwise seen from outside, as [`Solid::sides`] needs them.
        let around: &[(f32, f32)] = match (L, sign > 0.0) {
            (2, true) => &[(-1.0, 0.0), (1.0, 0.0)],
            (2, false) => &[(1.0, 0.0), (-1.0, 0.0)],
            (_, true) => &[(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)],
            (_, false) => &[(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)],
        };
        for &(s, t) in around {
            let signs: [f32; L] = from_fn(|i| {
                if i == axis {
                    sign
                } else if i == u {
                    s
                } else {
                    t
                }
            });
            let position = Vector(from_fn(|i| self.0[i] * signs[i]));
            let bits: [u32; L] = from_fn(|i| u32::from(signs[i] > 0.0) << i);
            out.push(Corner::new(position, bits.iter().sum()));
        }
    }
}

impl Polyhedron for Cuboid<3> {
    fn vertices(&self, out: &mut Vec<Vector<f32, 3>>) {
        let half = self.0;
        let side = |vertex: usize, axis: usize| {
            if vertex >> axis & 1 == 1 { half[axis] } else { -half[axis] }
        };
        out.extend((0..8).map(|vertex| Vector(from_fn(|axis| side(vertex, axis)))));
    }

    fn ends(&self, edge: usize) -> [usize; 2] {
        let (axis, [j, k]) = across(edge);
        let from = (edge & 1) << j | (edge >> 1 & 1) << k;
        [from, from | 1 << axis]
    }

    fn flanks(&self, edge: usize) -> [usize; 2] {
        let (_, axes) = across(edge);
        from_fn(|other| if edge >> other & 1 == 1 { axes[other] } else { axes[other] + 3 })
    }
}

/// Returns the axis along an edge of a box, and the other two.
fn across(edge: usize) -> (usize, [usize; 2]) {
    let axis = edge >> 2;
    (axis, [(axis + 1) % 3, (axis + 2) % 3])
}

/// Returns a vector along an axis. Each number is computed separately, as corners are: reading a
/// vector as a whole after writing a part of it stalls.
fn along<const L: usize>(axis: usize, length: f32) -> Vector<f32, L> {
    Vector(from_fn(|i| if i == axis { length } else { 0.0 }))
}

impl Solid<2> for parry2d::shape::ConvexPolygon {
    fn support(&self, direction: Vector<f32, 2>) -> Vector<f32, 2> {
        farthest(self.points(), direction.0.into(), |p, d| p.dot(d)).to_array().into()
    }

    fn faces(&self) -> usize {
        self.points().len()
    }

    fn face(&self, index: usize) -> (Vector<f32, 2>, Vector<f32, 2>) {
        (self.normals()[index].to_array().into(), self.points()[index].to_array().into())
    }

    fn edges(&self) -> usize {
        self.faces()
    }

    fn edge(&self, index: usize) -> [Vector<f32, 2>; 2] {
        [index, (index + 1) % self.faces()].map(|end| self.points()[end].to_array().into())
    }

    fn corners(&self, face: usize, out: &mut Vec<Corner<2>>) {
        for index in [face, (face + 1) % self.points().len()] {
            let position = self.points()[index].to_array().into();
            out.push(Corner::new(position, index as u32));
        }
    }
}

fn farthest<V: Copy>(points: &[V], direction: V, dot: impl Fn(V, V) -> f32) -> V {
    let mut best = (f32::NEG_INFINITY, 0);
    for (i, point) in points.iter().enumerate() {
        let along = dot(*point, direction);
        if along > best.0 {
            best = (along, i);
        }
    }
    points[best.1]
}
