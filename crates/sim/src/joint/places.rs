//! Where the bodies of joints are, in space and in `f64`.

use drystone_solver::{Vector, Velocity};

use super::coordinates::{Place, Turn, Vec3};
use super::record::WORLD;
use crate::bodies::BodyView;
use crate::geometry::Geometry;

pub(crate) fn in_space<const N: usize>(vector: Vector<f32, N>) -> Vec3 {
    let mut out = Vec3::ZERO;
    for i in 0..N {
        // In the plane, rotation is about z.
        out[if N == 1 { 2 } else { i }] = f64::from(vector[i]);
    }
    out
}

/// Returns a pose as a place.
pub(crate) fn place<G: Geometry<L, A>, const L: usize, const A: usize>(pose: &G::Pose) -> Place {
    Place { position: in_space(G::frame(pose).position), turn: Turn::normalized(G::rotation(pose)) }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> BodyView<'_, G, L, A> {
    /// Returns the rotation of a body of the batch.
    pub(crate) fn turn(&self, body: u32) -> Option<Turn> {
        Some(Turn::normalized(G::rotation(&self.poses[self.index(body)?])))
    }

    /// Returns the place of a center of mass and the axes of its body, or that of the world. The body is
    /// in the batch.
    pub(crate) fn of(&self, body: u32) -> Place {
        if body == WORLD {
            return Place::ORIGIN;
        }
        let body = body as usize;
        let index = body - self.first;
        let mut position = in_space(self.properties.frames[body].position);
        position += in_space(self.properties.position_remainders[body]);
        let mut turned = Vec3::ZERO;
        if let Some(moved) = self.displacements.get(index) {
            position += in_space(moved.linear);
            turned = in_space(moved.angular) - in_space(self.spin_states[index].followed);
        }
        let pose = Turn::normalized(G::rotation(&self.poses[index]));
        Place { position, turn: Turn::by(turned).of(&pose) }
    }
}

/// Returns a row in the dimension of a world.
#[inline(always)]
pub(crate) fn flattened<const L: usize, const A: usize>(
    row: &Velocity<f64, 3, 3>,
) -> Velocity<f64, L, A> {
    let mut flat = Velocity::ZERO;
    (0..L).for_each(|i| flat.linear[i] = row.linear[i]);
    (0..A).for_each(|i| flat.angular[i] = row.angular[if A == 1 { 2 } else { i }]);
    flat
}
