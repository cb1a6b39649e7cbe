//! [`Carriers`]: bodies of no shape that stand for the surfaces of meshes that deform.
//!
//! The surface at a contact of such a mesh does not move as one body with the mesh. So each
//! manifold on it gets a kinematic body of its own, which moves as the surface does there. Every
//! stage from rows to relax then treats the contact as one with a kinematic body: its target, its
//! gap and slip in later substeps, impacts, certificates and the ledger. Carriers follow the bodies
//! of the world in all arrays, and are there only from the rows of a search to the end of its
//! substeps.
//!
//! The motion of a carrier is fitted to that of the surface. At its center it is the mean over the
//! contact points, interpolated from the vertices. With arms r and velocities u relative to the
//! center, its rotation is the omega that minimizes the sum of |u - omega x r|^2 over the points. A
//! small weight on the vertices of their triangles decides where the points leave it open.

use drystone_solver::{SymmetricMatrix, Vector, Velocity};

use crate::geometry::Geometry;

/// Weight of the vertices of triangles beside the contact points, for the same arms. \[1\]
const VERTICES: f64 = 1e-3;

/// Bodies that stand for surfaces in the last contact search.
pub(crate) struct Carriers<const L: usize, const A: usize> {
    /// Number of bodies of the world, which is the index of the first carrier.
    pub(crate) first: usize,
    pub(crate) own: Vec<Carrier<L, A>>,
    /// Push points of their manifolds as measured from the bodies. \[m\]
    pub(crate) push_points: Vec<Vector<f32, L>>,
}

/// A body that stands for the surface at a manifold.
#[derive(Clone, Copy)]
pub(crate) struct Carrier<const L: usize, const A: usize> {
    /// Body of the mesh.
    pub(crate) body: u32,
    pub(crate) manifold: u32,
    /// Side of the mesh in the manifold, 0 or 1.
    pub(crate) side: usize,
    /// Vector from the center of mass of the body to the carrier. \[m\]
    pub(crate) arm: Vector<f32, L>,
    pub(crate) velocity: Velocity<f32, L, A>,
    /// Its position after the substeps of the search. \[m\]
    pub(crate) position: Vector<f32, L>,
    /// Vector from b to a as measured between the bodies. \[m\]
    pub(crate) center_offset: Vector<f32, L>,
}

impl<const L: usize, const A: usize> Default for Carriers<L, A> {
    fn default() -> Self {
        Self { first: 0, own: Vec::new(), push_points: Vec::new() }
    }
}

impl<const L: usize, const A: usize> Carriers<L, A> {
    /// Forgets the carriers of the last search. Returns true if there were any.
    pub(crate) fn clear(&mut self, bodies: usize) -> bool {
        let any = !self.own.is_empty();
        self.first = bodies;
        self.own.clear();
        self.push_points.clear();
        any
    }

    /// Returns the carrier with this index among the bodies, if it is one.
    pub(crate) fn get(&self, body: u32) -> Option<&Carrier<L, A>> {
        self.own.get((body as usize).checked_sub(self.first)?)
    }

    /// Returns the body of the mesh for a carrier, or the body itself.
    pub(crate) fn body_of(&self, body: u32) -> u32 {
        self.get(body).map_or(body, |carrier| carrier.body)
    }
}

/// A point of the surface at a contact: its arm from the center of the carrier \[m\], its velocity
/// \[m/s\], and those of the vertices of its triangle.
#[derive(Clone, Copy)]
pub(crate) struct SurfacePoint<const L: usize> {
    pub(crate) arm: Vector<f64, L>,
    pub(crate) velocity: Vector<f64, L>,
    pub(crate) corners: [[Vector<f64, L>; 2]; 3],
}

/// Returns the velocity of a carrier, at its center, for the contact points of its manifold.
pub(crate) fn fitted<const L: usize, const A: usize>(
    points: &[SurfacePoint<L>],
) -> Velocity<f32, L, A> {
    let share = 1.0 / points.len().max(1) as f64;
    let mean = |of: fn(&SurfacePoint<L>) -> Vector<f64, L>| {
        points.iter().fold(Vector::ZERO, |sum: Vector<f64, L>, point| sum + of(point)) * share
    };
    let (center, linear) = (mean(|point| point.arm), mean(|point| point.velocity));
    let own = || points.iter().map(|point| [point.arm - center, point.velocity - linear]);
    let around = || {
        points.iter().flat_map(|point| {
            point
                .corners
                .iter()
                .map(|[arm, velocity]| [*arm - point.arm, *velocity - point.velocity])
        })
    };
    let size = |of: &mut dyn Iterator<Item = [Vector<f64, L>; 2]>| -> f64 {
        of.map(|[arm, _]| arm.dot(arm)).sum()
    };
    let (points, corners) = (size(&mut own()), size(&mut around()));
    let weight =
        if points > 0.0 { VERTICES * points / corners.max(f64::MIN_POSITIVE) } else { 1.0 };
    let mut fit = RotationFit::<A>::default();
    own().for_each(|[arm, velocity]| fit.add(arm, velocity, 1.0));
    around().for_each(|[arm, velocity]| fit.add(arm, velocity, weight));
    let angular = fit.solve();
    let turning = Velocity::<f64, L, A> { linear: Vector::ZERO, angular };
    Velocity { linear: linear - turning.at(center), angular }.cast()
}

/// The normal equations of the rotation.
struct RotationFit<const A: usize> {
    matrix: SymmetricMatrix<f64, A>,
    side: Vector<f64, A>,
}

impl<const A: usize> Default for RotationFit<A> {
    fn default() -> Self {
        Self { matrix: SymmetricMatrix::ZERO, side: Vector::ZERO }
    }
}

impl<const A: usize> RotationFit<A> {
    fn add<const L: usize>(&mut self, arm: Vector<f64, L>, velocity: Vector<f64, L>, weight: f64) {
        let moved: [Vector<f64, L>; A] = std::array::from_fn(|axis| {
            let mut unit: Velocity<f64, L, A> = Velocity::ZERO;
            unit.angular[axis] = 1.0;
            unit.at(arm)
        });
        for i in 0..A {
            self.side[i] += weight * moved[i].dot(velocity);
            for j in 0..A {
                self.matrix.0[i][j] += weight * moved[i].dot(moved[j]);
            }
        }
    }

    fn solve(&self) -> Vector<f64, A> {
        self.matrix.inverse().map_or(Vector::ZERO, |inverse| inverse * self.side)
    }
}

/// A triangle mesh whose vertices move in the next step.
#[derive(Clone)]
pub(crate) struct MeshMotion<const L: usize> {
    pub(crate) collider: u32,
    /// Vertices at the start and at the end of the step, in the frame of the shape. \[m\]
    pub(crate) start: Vec<Vector<f32, L>>,
    pub(crate) target: Vec<Vector<f32, L>>,
    /// Length of the step. \[s\]
    pub(crate) dt: f32,
}

impl<const L: usize> MeshMotion<L> {
    /// Returns the largest path of a vertex. \[m\]
    pub(crate) fn longest(&self) -> f32 {
        let paths = self.start.iter().zip(&self.target).map(|(from, to)| (*to - *from).length());
        paths.fold(0.0, f32::max)
    }

    /// Returns the vertices after a part of the step. \[m\]
    pub(crate) fn after(&self, part: f32) -> Vec<Vector<f32, L>> {
        let moved = |(from, to): (&Vector<f32, L>, &Vector<f32, L>)| *from + (*to - *from) * part;
        self.start.iter().zip(&self.target).map(moved).collect()
    }

    /// Returns position and velocity of a vertex, after a part of the step.
    fn vertex(&self, index: u32, part: f32) -> [Vector<f32, L>; 2] {
        let [from, to] = [&self.start, &self.target]
            .map(|of| of.get(index as usize).copied().unwrap_or_default());
        [from + (to - from) * part, (to - from) * (1.0 / self.dt)]
    }

    /// Returns the motion of the surface near a point of the mesh, in the frame of the shape. The
    /// arms are positions there. `None` if the shape is no mesh.
    pub(crate) fn near<G: Geometry<L, A>, const A: usize>(
        &self,
        shape: &G::Shape,
        point: Vector<f32, L>,
        part: f32,
    ) -> Option<[[Vector<f32, L>; 2]; 4]> {
        let place = G::nearest_on_mesh(shape, point)?;
        let corners = place.corners.map(|corner| self.vertex(corner, part));
        let weighted = |of: usize| {
            let parts = corners.iter().zip(place.weights);
            parts.fold(Vector::ZERO, |sum, (corner, weight)| sum + corner[of] * weight)
        };
        let [a, b, c] = corners;
        Some([[weighted(0), weighted(1)], a, b, c])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::Random;

    /// Points of a rigid motion have that motion as their fit, however few they are.
    #[test]
    fn rigid_motion_is_fitted_exactly() {
        let mut random = Random(4);
        for count in [1, 2, 3, 4] {
            let motion: Velocity<f64, 3, 3> =
                Velocity { linear: random.vector().cast(), angular: random.vector().cast() };
            let points: Vec<SurfacePoint<3>> = (0..count)
                .map(|_| {
                    let arm: Vector<f64, 3> = random.vector().cast();
                    let corners = [0; 3].map(|_| {
                        let corner = arm + random.vector().cast();
                        [corner, motion.at(corner)]
                    });
                    SurfacePoint { arm, velocity: motion.at(arm), corners }
                })
                .collect();
            let found: Velocity<f32, 3, 3> = fitted(&points);
            let [linear, angular] =
                [found.linear - motion.linear.cast(), found.angular - motion.angular.cast()];
            assert!(linear.length() + angular.length() < 1e-5, "{count}: {linear:?} {angular:?}");
        }
    }
}
