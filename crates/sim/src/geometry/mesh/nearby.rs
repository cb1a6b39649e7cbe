//! The triangles of a mesh close to a point.

use super::surface::{MeshFace, MeshTopology};
use crate::geometry::{Ball, Vec3};

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

    /// Returns an upper bound of d . x over those parts of some triangles that are in a ball. \[m\]
    /// d is a unit vector. The bound is exact for a triangle that has its farthest corner in the
    /// ball, or that fills its section of the ball.
    pub(in crate::geometry) fn extent_within(
        &self,
        triangles: impl Iterator<Item = u32>,
        d: Vec3,
        ball: Ball<3>,
    ) -> Option<f32> {
        let heights = self.within(triangles, ball).map(|face| {
            let farthest = self.corners(face).map(|corner| d.dot(corner));
            let facet = &self.facets[face.facet as usize];
            let height = facet.normal.dot(ball.center) - facet.offset;
            let across = facet.normal.dot(d);
            let slope = (1.0 - across * across).max(0.0).sqrt();
            let radius = (ball.radius * ball.radius - height * height).max(0.0).sqrt();
            let section = d.dot(ball.center) - height * across + radius * slope;
            farthest.into_iter().fold(f32::NEG_INFINITY, f32::max).min(section)
        });
        heights.reduce(f32::max)
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
