//! Exact convex hulls: no tolerance decides on which side of a plane a point lies.
//!
//! The algorithm is quickhull (Barber, Dobkin and Huhdanpaa 1996) with exact predicates (Shewchuk
//! 1997). A new point replaces the faces that it is above, and also those in whose plane it lies.
//! So no triangle is degenerate, and coplanar or collinear points need no special case.

use std::collections::{HashMap, VecDeque};

use drystone_solver::{Vector, moment};
use robust::{Coord3D, orient3d};

/// A triangle of the hull.
struct HullTriangle {
    /// Counter-clockwise seen from outside.
    corners: [u32; 3],
    /// The facets beyond the edges from each corner to the next.
    neighbors: [u32; 3],
    /// Points above the facet that belong to no other facet.
    above: Vec<u32>,
    removed: bool,
}

/// Marks a missing neighbor.
const NONE: u32 = u32::MAX;

/// Returns the triangles of the hull of points \[m\], counter-clockwise seen from outside. Returns
/// `None` if the points are coplanar or not finite.
pub(super) fn hull(points: &[Vector<f32, 3>]) -> Option<Vec<[u32; 3]>> {
    if points.len() < 4 || points.iter().any(|point| point.0.iter().any(|x| !x.is_finite())) {
        return None;
    }
    let mut hull = ExactHull { points, facets: Vec::new() };
    let simplex = hull.simplex()?;
    for skip in 0..4 {
        let [a, b, c] = [1, 2, 3].map(|i| simplex[(skip + i) % 4]);
        // The fourth point is below.
        let corners = if hull.side([a, b, c], simplex[skip]) < 0.0 { [a, b, c] } else { [a, c, b] };
        hull.facets.push(HullTriangle {
            corners,
            neighbors: [NONE; 3],
            above: Vec::new(),
            removed: false,
        });
    }
    hull.join(&[0, 1, 2, 3]);
    let rest = (0..points.len() as u32).filter(|point| !simplex.contains(point));
    hull.sort(rest.collect(), &[0, 1, 2, 3]);
    let mut due: VecDeque<u32> = (0..4).collect();
    while let Some(facet) = due.pop_front() {
        if let Some(point) = hull.farthest(facet) {
            due.extend(hull.add(point, facet));
        }
    }
    Some(hull.facets.iter().filter(|facet| !facet.removed).map(|facet| facet.corners).collect())
}

struct ExactHull<'a> {
    points: &'a [Vector<f32, 3>],
    facets: Vec<HullTriangle>,
}

impl ExactHull<'_> {
    fn at(&self, point: u32) -> Vector<f64, 3> {
        Vector(self.points[point as usize].0.map(f64::from))
    }

    /// Returns a positive number if a point is above the plane through three others, and 0 if it is
    /// in the plane.
    fn side(&self, [a, b, c]: [u32; 3], point: u32) -> f64 {
        let [a, b, c, d] = [a, b, c, point].map(|of| {
            let [x, y, z] = self.points[of as usize].0;
            Coord3D { x, y, z }
        });
        -orient3d(a, b, c, d)
    }

    /// Returns four points that span a volume, far from each other.
    fn simplex(&self) -> Option<[u32; 4]> {
        let all = || 0..self.points.len() as u32;
        let most =
            |value: &dyn Fn(u32) -> f64| all().max_by(|&p, &q| value(p).total_cmp(&value(q)));
        let squared = |v: Vector<f64, 3>| v.dot(v);
        let a = most(&|p| -self.at(p)[0])?;
        let b = most(&|p| squared(self.at(p) - self.at(a)))?;
        let edge = self.at(b) - self.at(a);
        let area = |p: u32| -> Vector<f64, 3> { moment(edge, self.at(p) - self.at(a)) };
        let c = most(&|p| squared(area(p)))?;
        let normal = area(c);
        let volume = |p: u32| normal.dot(self.at(p) - self.at(a)).abs();
        let d = most(&volume)?;
        if self.side([a, b, c], d) != 0.0 {
            return Some([a, b, c, d]);
        }
        // Rounding has hidden a point that is out of the plane.
        let d = all().find(|&p| self.side([a, b, c], p) != 0.0)?;
        Some([a, b, c, d])
    }

    /// Links new facets to each other and closes the surface.
    fn join(&mut self, facets: &[u32]) {
        let mut open = HashMap::new();
        for &facet in facets {
            let corners = self.facets[facet as usize].corners;
            for i in 0..3 {
                if self.facets[facet as usize].neighbors[i] != NONE {
                    continue;
                }
                let [from, to] = [corners[i], corners[(i + 1) % 3]];
                if let Some((other, j)) = open.remove(&[to, from]) {
                    self.facets[facet as usize].neighbors[i] = other;
                    let other: &mut HullTriangle = &mut self.facets[other as usize];
                    other.neighbors[j] = facet;
                } else {
                    open.insert([from, to], (facet, i));
                }
            }
        }
    }

    /// Assigns each point to the first of these facets that it is above. A point above none of them
    /// is inside the hull. Seen from outside, the line from it to a facet that it was above
    /// enters through a new one.
    fn sort(&mut self, points: Vec<u32>, facets: &[u32]) {
        for point in points {
            let above = |&facet: &u32| self.side(self.facets[facet as usize].corners, point) > 0.0;
            if let Some(own) = facets.iter().copied().find(above) {
                self.facets[own as usize].above.push(point);
            }
        }
    }

    /// Returns the point farthest above a facet, among those assigned to it.
    fn farthest(&self, facet: u32) -> Option<u32> {
        let facet = &self.facets[facet as usize];
        let [a, b, c] = facet.corners.map(|corner| self.at(corner));
        let area: Vector<f64, 3> = moment(b - a, c - a);
        let height = |&point: &u32| area.dot(self.at(point) - a);
        facet.above.iter().copied().max_by(|p, q| height(p).total_cmp(&height(q)))
    }

    /// Adds a point above a facet. Returns the new facets.
    fn add(&mut self, point: u32, seen_first: u32) -> Vec<u32> {
        // Collect the connected facets that the point is above, or in the plane of.
        let mut seen = vec![seen_first];
        self.facets[seen_first as usize].removed = true;
        let mut horizon = Vec::new();
        let mut at = 0;
        while at < seen.len() {
            let HullTriangle { corners, neighbors, .. } = self.facets[seen[at] as usize];
            for i in 0..3 {
                let beyond = neighbors[i];
                if self.facets[beyond as usize].removed {
                    continue;
                }
                if self.side(self.facets[beyond as usize].corners, point) >= 0.0 {
                    self.facets[beyond as usize].removed = true;
                    seen.push(beyond);
                } else {
                    horizon.push(([corners[i], corners[(i + 1) % 3]], beyond));
                }
            }
            at += 1;
        }
        // Facets beyond the horizon may have been collected since.
        horizon.retain(|(_, beyond)| !self.facets[*beyond as usize].removed);
        let first = self.facets.len() as u32;
        for ([from, to], beyond) in horizon {
            let own = self.facets.len() as u32;
            let other = &mut self.facets[beyond as usize];
            for i in 0..3 {
                if other.corners[i] == to && other.corners[(i + 1) % 3] == from {
                    other.neighbors[i] = own;
                }
            }
            self.facets.push(HullTriangle {
                corners: [from, to, point],
                neighbors: [beyond, NONE, NONE],
                above: Vec::new(),
                removed: false,
            });
        }
        let fresh: Vec<u32> = (first..self.facets.len() as u32).collect();
        self.join(&fresh);
        let mut orphans = Vec::new();
        for facet in seen {
            orphans.append(&mut self.facets[facet as usize].above);
        }
        orphans.retain(|&orphan| orphan != point);
        self.sort(orphans, &fresh);
        fresh
    }
}
