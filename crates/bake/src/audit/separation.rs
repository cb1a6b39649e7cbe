//! Signed separation of convex sets in `f64`, between certified bounds.
//!
//! A convex set D has the support function h(n) = max n . x over its points x. D is the Minkowski
//! difference of two shapes here, and n a unit vector. If the origin is inside D, the penetration
//! depth is the minimum of h over all n. If it is outside, the minimum is minus the distance. So
//! h(n) is an upper bound for every n, and a negative value proves that the shapes are disjoint.
//! GJK bounds the minimum from below if the origin is outside, and EPA if it is inside.
//!
//! Disjoint shapes that are rounded by balls need the distance of their cores, since the radii then
//! decide. Both searches take few points for polyhedra. For a cylinder around the origin, each
//! direction across its axis is a minimum, and the lower bound converges slowly.

use super::vector::{Vec3, cross, dot, minus, norm, scaled, tangents, unit};

/// Accepted difference of both bounds, relative to the size of D. \[1\]
const TOLERANCE: f64 = 1e-10;
/// Distance from the boundary of D, relative to its size, up to which GJK has no direction. \[1\]
const TOUCHING: f64 = 1e-9;
/// Rounding of points of D, relative to its size. \[1\]
const ROUNDING: f64 = 1e-13;
/// Maximum number of support points of each search.
const POINTS: usize = 256;

/// A convex set, given by its support points.
pub(super) struct ConvexSet<F> {
    /// Returns the point of the set that is farthest along a direction.
    pub(super) farthest: F,
    /// Largest extent of the coordinates of the set. \[m\]
    pub(super) size: f64,
}

/// Bounds of the minimum of the support function.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// Lower bound. \[m\]
    pub(super) low: f64,
    /// Value along `normal`, an upper bound. \[m\]
    pub(super) high: f64,
    pub(super) normal: Vec3,
}

impl Bounds {
    fn lower_to(&mut self, value: f64, normal: Vec3) {
        if value < self.high {
            (self.high, self.normal) = (value, normal);
        }
    }
}

/// Point of a simplex nearest to the origin, and the vertices that span it.
struct Nearest {
    point: Vec3,
    vertices: Vec<Vec3>,
}

impl<F: Fn(Vec3) -> Vec3> ConvexSet<F> {
    /// Bounds the minimum of the support function. Both bounds agree to 1e-10 of the size, unless
    /// the search ends early: for an upper bound below `least`, or after 256 support points.
    ///
    /// `guesses` are unit vectors that are likely to be the direction of the minimum.
    pub(super) fn bounds(&self, guesses: &[Vec3], least: f64) -> Bounds {
        let mut bounds = Bounds { low: f64::NEG_INFINITY, high: f64::INFINITY, normal: [0.0; 3] };
        for &n in guesses {
            bounds.lower_to(dot((self.farthest)(n), n), n);
        }
        if bounds.high < least || self.approach(&mut bounds, least) {
            return bounds;
        }
        self.expand(&mut bounds);
        if bounds.high - bounds.low > TOLERANCE * self.size {
            self.descend(&mut bounds);
        }
        bounds
    }

    /// Walks to the point of the set nearest to the origin (GJK). Returns false if the origin is
    /// inside, or so near that the direction to that point is rounding. Ends as soon as the upper
    /// bound is below `least`.
    fn approach(&self, bounds: &mut Bounds, least: f64) -> bool {
        let mut simplex: Vec<Vec3> = Vec::new();
        let start = if bounds.high < f64::INFINITY { bounds.normal } else { [1.0, 0.0, 0.0] };
        let mut point = (self.farthest)(start);
        simplex.push(point);
        for _ in 0..POINTS {
            let distance = norm(point);
            if distance <= TOUCHING * self.size {
                return false;
            }
            let Some(n) = unit(scaled(point, -1.0)) else { return false };
            let added = (self.farthest)(n);
            bounds.lower_to(dot(added, n), n);
            bounds.low = bounds.low.max(-distance);
            if bounds.high < least || bounds.high - bounds.low <= TOLERANCE * self.size {
                return true;
            }
            simplex.push(added);
            let Some(nearest) = nearest(&simplex) else { return false };
            // Rounding ends the descent.
            if norm(nearest.point) >= distance {
                return bounds.high < 0.0;
            }
            (point, simplex) = (nearest.point, nearest.vertices);
        }
        bounds.high < 0.0
    }

    /// Grows a polytope inside the set towards its boundary where that is nearest (EPA). The
    /// nearest plane of a face gives the lower bound, which holds if the origin is inside.
    fn expand(&self, bounds: &mut Bounds) {
        let Some(mut polytope) = self.tetrahedron(bounds) else { return };
        for _ in 0..POINTS {
            let Some(nearest) = polytope.nearest() else { break };
            let face = &polytope.faces[nearest];
            let (normal, offset) = (face.normal, face.offset);
            let added = (self.farthest)(normal);
            let value = dot(added, normal);
            bounds.lower_to(value, normal);
            bounds.low = offset.min(bounds.high);
            if bounds.high - offset <= TOLERANCE * self.size {
                return;
            }
            polytope.add(added, nearest, ROUNDING * self.size);
        }
    }

    /// Makes a tetrahedron of support points. Returns `None` for a flat set, whose depth is zero,
    /// with the bounds set.
    fn tetrahedron(&self, bounds: &mut Bounds) -> Option<Polytope> {
        let flat = 8.0 * ROUNDING * self.size;
        let ends = |n: Vec3| [n, scaled(n, -1.0)].map(|n| (self.farthest)(n));
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let long = |ends: &[Vec3; 2]| norm(minus(ends[0], ends[1]));
        let [a, b] = axes.map(ends).into_iter().max_by(|x, y| long(x).total_cmp(&long(y)))?;
        let along = unit(minus(b, a)).unwrap_or(axes[0]);
        let sides = tangents(along);
        let aside = |p: &Vec3| norm(cross(minus(*p, a), along));
        let c = sides
            .iter()
            .flat_map(|side| ends(*side))
            .max_by(|x, y| aside(x).total_cmp(&aside(y)))?;
        let normal = unit(cross(minus(b, a), minus(c, a))).filter(|_| aside(&c) > flat);
        let thin = normal.map_or(vec![sides[0], sides[1]], |n| vec![n]);
        let mut widths = Vec::new();
        for n in thin {
            let found = ends(n);
            bounds.lower_to(dot(found[0], n), n);
            bounds.lower_to(-dot(found[1], n), scaled(n, -1.0));
            widths.push((dot(minus(found[0], found[1]), n), found));
        }
        let (width, [over, under]) = *widths.iter().min_by(|x, y| x.0.total_cmp(&y.0))?;
        if width <= flat {
            bounds.low = bounds.low.max(bounds.high - width);
            return None;
        }
        let n = normal?;
        let height = |p: Vec3| dot(minus(p, a), n);
        let d = if height(over) >= -height(under) { over } else { under };
        Some(Polytope::new([a, b, c, d]))
    }

    /// Improves the upper bound where the lower one has not converged, by search around the normal.
    fn descend(&self, bounds: &mut Bounds) {
        let mut step = 0.1;
        for _ in 0..POINTS {
            let (from, [t, u]) = (bounds.high, tangents(bounds.normal));
            let center = bounds.normal;
            for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                let moved = |i: usize| center[i] + step * (x * t[i] + y * u[i]);
                let Some(n) = unit(std::array::from_fn(moved)) else { continue };
                bounds.lower_to(dot((self.farthest)(n), n), n);
            }
            if bounds.high >= from - ROUNDING * self.size {
                step *= 0.5;
            }
            if step < 1e-9 {
                break;
            }
        }
    }
}

/// Returns the point of the simplex of one to four vertices that is nearest to the origin. Returns
/// `None` if the origin is inside.
fn nearest(simplex: &[Vec3]) -> Option<Nearest> {
    let count = simplex.len();
    if let &[a, b, c, d] = simplex
        && encloses([a, b, c, d])
    {
        return None;
    }
    let mut best = Nearest { point: [f64::INFINITY; 3], vertices: Vec::new() };
    let mut least = f64::INFINITY;
    let mut consider = |point: Option<Vec3>, vertices: &[Vec3]| {
        // A larger simplex has to be nearer by more than rounding.
        if let Some(point) = point.filter(|p| norm(*p) < least * (1.0 - 1e-15)) {
            least = norm(point);
            best = Nearest { point, vertices: vertices.to_vec() };
        }
    };
    for i in 0..count {
        consider(Some(simplex[i]), &[simplex[i]]);
    }
    for i in 0..count {
        for j in 0..i {
            let ends = [simplex[j], simplex[i]];
            consider(on_segment(ends), &ends);
        }
    }
    for i in 0..count {
        for j in 0..i {
            for k in 0..j {
                let corners = [simplex[k], simplex[j], simplex[i]];
                consider(on_triangle(corners), &corners);
            }
        }
    }
    Some(best)
}

/// Returns the projection of the origin if it is inside the segment.
fn on_segment([a, b]: [Vec3; 2]) -> Option<Vec3> {
    let along = minus(b, a);
    let (length, part) = (dot(along, along), -dot(a, along));
    let inside = length > 0.0 && part > 0.0 && part < length;
    // From the nearer end, so that rounding is relative to the shorter vector.
    let near = if part < 0.5 * length { a } else { b };
    inside.then(|| minus(near, scaled(along, dot(near, along) / length)))
}

/// Returns the projection of the origin if it is inside the triangle.
fn on_triangle([a, b, c]: [Vec3; 3]) -> Option<Vec3> {
    let normal = unit(cross(minus(b, a), minus(c, a)))?;
    let sides = [cross(a, b), cross(b, c), cross(c, a)].map(|side| dot(side, normal));
    let near = [a, b, c].into_iter().min_by(|p, q| norm(*p).total_cmp(&norm(*q)))?;
    sides.iter().all(|side| *side > 0.0).then(|| scaled(normal, dot(near, normal)))
}

/// Returns true if the origin is inside the tetrahedron.
fn encloses([a, b, c, d]: [Vec3; 4]) -> bool {
    let volume = |p: Vec3, q: Vec3, r: Vec3| dot(p, cross(q, r));
    let parts = [volume(b, d, c), volume(a, c, d), volume(a, d, b), volume(a, b, c)];
    parts.iter().all(|part| *part > 0.0) || parts.iter().all(|part| *part < 0.0)
}

struct Face {
    vertices: [usize; 3],
    /// Face across the edge from each vertex to the next.
    neighbors: [usize; 3],
    /// Outward unit normal.
    normal: Vec3,
    /// Distance of its plane from the origin, negative if the origin is outside. Infinite for a
    /// face that is covered, that has no area, or that cannot be grown. \[m\]
    offset: f64,
    is_covered: bool,
}

/// Convex hull of support points.
struct Polytope {
    points: Vec<Vec3>,
    faces: Vec<Face>,
}

/// Edge of a face that is kept, on the border of the faces that a new point covers.
struct BorderEdge {
    ends: [usize; 2],
    face: usize,
}

impl Polytope {
    fn new([a, b, c, d]: [Vec3; 4]) -> Self {
        let outward = dot(cross(minus(b, a), minus(c, a)), minus(d, a)) < 0.0;
        let points = if outward { vec![a, b, c, d] } else { vec![a, c, b, d] };
        let mut polytope = Self { points, faces: Vec::new() };
        polytope.cover([0, 1, 2], [1, 2, 3]);
        polytope.cover([0, 3, 1], [3, 2, 0]);
        polytope.cover([1, 3, 2], [1, 3, 0]);
        polytope.cover([2, 3, 0], [2, 1, 0]);
        polytope
    }

    fn cover(&mut self, vertices: [usize; 3], neighbors: [usize; 3]) {
        let [a, b, c] = vertices.map(|i| self.points[i]);
        let normal = unit(cross(minus(b, a), minus(c, a)));
        let near = [a, b, c].into_iter().min_by(|p, q| norm(*p).total_cmp(&norm(*q))).unwrap_or(a);
        let offset = normal.map_or(f64::INFINITY, |n| dot(near, n));
        let normal = normal.unwrap_or([0.0; 3]);
        self.faces.push(Face { vertices, neighbors, normal, offset, is_covered: false });
    }

    /// Returns the face with the nearest plane; `None` if no face can be grown.
    fn nearest(&self) -> Option<usize> {
        let live = (0..self.faces.len()).filter(|&i| self.faces[i].offset < f64::INFINITY);
        live.min_by(|&i, &j| self.faces[i].offset.total_cmp(&self.faces[j].offset))
    }

    /// Returns the height of a point over the plane of a face. \[m\]
    fn height(&self, point: Vec3, face: usize) -> f64 {
        let face = &self.faces[face];
        dot(minus(point, self.points[face.vertices[0]]), face.normal)
    }

    /// Adds a point beyond the plane of a face.
    fn add(&mut self, point: Vec3, face: usize, rounding: f64) {
        let is_known = self.points.iter().any(|known| norm(minus(*known, point)) <= rounding);
        if is_known || self.height(point, face) <= rounding {
            self.faces[face].offset = f64::INFINITY;
            return;
        }
        let border = self.uncover(point, face, rounding);
        self.points.push(point);
        let (last, first) = (self.points.len() - 1, self.faces.len());
        let starts: Vec<usize> = border.iter().map(|edge| edge.ends[0]).collect();
        let after = |end| starts.iter().position(|&start| start == end).unwrap_or(0);
        for (i, BorderEdge { ends: [a, b], face }) in border.iter().enumerate() {
            let (next, before) = (after(*b), border.iter().position(|edge| edge.ends[1] == *a));
            self.cover([*a, *b, last], [*face, first + next, first + before.unwrap_or(0)]);
            let kept = &mut self.faces[*face];
            let shared =
                (0..3).find(|&k| kept.vertices[k] == *b && kept.vertices[(k + 1) % 3] == *a);
            kept.neighbors[shared.unwrap_or(0)] = first + i;
        }
    }

    /// Drops the faces around `face` from which the point is visible, and returns their border.
    fn uncover(&mut self, point: Vec3, face: usize, rounding: f64) -> Vec<BorderEdge> {
        let (mut border, mut pending) = (Vec::new(), vec![face]);
        self.faces[face].is_covered = true;
        let mut seen = Vec::new();
        while let Some(face) = pending.pop() {
            seen.push(face);
            self.faces[face].offset = f64::INFINITY;
            for next in self.faces[face].neighbors {
                if !self.faces[next].is_covered && self.height(point, next) > rounding {
                    self.faces[next].is_covered = true;
                    pending.push(next);
                }
            }
        }
        for face in seen {
            let Face { vertices, neighbors, .. } = self.faces[face];
            for k in 0..3 {
                if !self.faces[neighbors[k]].is_covered {
                    let ends = [vertices[k], vertices[(k + 1) % 3]];
                    border.push(BorderEdge { ends, face: neighbors[k] });
                }
            }
        }
        border
    }
}
