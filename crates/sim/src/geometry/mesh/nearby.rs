//! The triangles of a mesh close to a point.

use drystone_solver::moment;

use super::ON_EDGE;
use super::surface::{Facet, MeshFace, MeshTopology};
use crate::geometry::{Ball, Vec3};

/// A triangle is steep if the cosine between its normal and a direction is less than this. \[1\] A
/// body above others has contacts of its own with them.
const GENTLE: f32 = 0.95;

impl MeshTopology {
    /// Returns those of some triangles that reach into a ball.
    fn within<'a>(
        &'a self,
        triangles: impl Iterator<Item = u32> + 'a,
        ball: Ball<3>,
    ) -> impl Iterator<Item = &'a MeshFace> {
        let faces = triangles.filter_map(|index| self.faces[index as usize].as_ref());
        faces.filter(move |face| {
            let (nearest, _) = self.nearest(face, 1.0, ball.center);
            (nearest - ball.center).length() <= ball.radius
        })
    }

    /// True if some of these triangles reach into a ball.
    pub(in crate::geometry) fn reaches(
        &self,
        triangles: impl Iterator<Item = u32>,
        ball: Ball<3>,
    ) -> bool {
        self.within(triangles, ball).next().is_some()
    }

    /// Returns the farthest point along a unit vector d among the center of a ball, and the ends of
    /// the ways uphill from there on the steep ones of some triangles. Uphill is along d. Returns
    /// `None` if a way leads out of the ball.
    pub(in crate::geometry) fn top_within(
        &self,
        triangles: impl Iterator<Item = u32>,
        d: Vec3,
        ball: Ball<3>,
    ) -> Option<Vec3> {
        let mut best = ball.center;
        for face in self.within(triangles, ball) {
            let Facet { normal, offset, .. } = self.facets[face.facet as usize];
            let across = normal.dot(d);
            if across.abs() > GENTLE {
                continue;
            }
            let start = ball.center - normal * (normal.dot(ball.center) - offset);
            let uphill = d - normal * across;
            let uphill = uphill * (1.0 / uphill.length());
            let Some(way) = self.way(face, start, uphill) else { continue };
            if way > ball.radius {
                return None;
            }
            let top = start + uphill * way;
            best = if d.dot(top) > d.dot(best) { top } else { best };
        }
        Some(best)
    }

    /// Returns the length of the way on a triangle from a point in its plane along a unit vector.
    /// \[m\]
    fn way(&self, face: &MeshFace, start: Vec3, along: Vec3) -> Option<f32> {
        let normal = self.facets[face.facet as usize].normal;
        let corners = self.corners(face);
        let [mut first, mut last] = [0.0f32, f32::INFINITY];
        for k in 0..3 {
            let side = corners[(k + 1) % 3] - corners[k];
            let outward: Vec3 = moment(side, normal);
            let (left, rise) = (-outward.dot(start - corners[k]), outward.dot(along));
            let squared = outward.dot(outward);
            if rise * rise <= ON_EDGE * ON_EDGE * squared {
                // It runs along this side.
                if left < -ON_EDGE * squared {
                    return None;
                }
            } else if rise > 0.0 {
                last = last.min(left / rise);
            } else {
                first = first.max(left / rise);
            }
        }
        (last >= first.max(0.0)).then_some(last)
    }

    /// Calls `found` with the outward normals of those of some triangles that reach into a ball. A
    /// triangle of an open mesh has two.
    pub(in crate::geometry) fn normals_within(
        &self,
        triangles: impl Iterator<Item = u32>,
        ball: Ball<3>,
        mut found: impl FnMut(Vec3),
    ) {
        for face in self.within(triangles, ball) {
            let facet = &self.facets[face.facet as usize];
            found(facet.normal);
            if !facet.solid {
                found(-facet.normal);
            }
        }
    }
}
