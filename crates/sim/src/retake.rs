//! Substeps that are taken back: those in which joints would turn so far that their targets miss the
//! path. The rest of the step then has shorter ones.
//!
//! A blow can turn a light body fast within one substep: a rope that becomes taut, a limit that stops a
//! heavy load. How fast it turns is known only when the substep has been solved.

use crate::geometry::Geometry;
use crate::world::World;

/// Rotation of an arm of a joint in a substep beyond which it is taken back: twice that for which steps
/// are planned. \[rad\]
const WIDE_TURN: f64 = 0.2;

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Keeps velocities and displacements, which a substep changes before its bodies move.
    pub(crate) fn keep_start(&mut self) {
        let start = &mut self.scratch.start;
        start.velocities.clone_from(&self.bodies.velocities);
        start.prospective.clone_from(&self.scratch.prospective);
        start.displacements.clone_from(&self.scratch.displacements);
        start.contact_gains.clone_from(&self.bodies.contact_gains);
    }

    /// Takes a substep of `h` \[s\] back that has been solved if joints would turn too far in it. Returns
    /// the rate at which they would \[rad/s\], or `None` if the substep stays.
    pub(crate) fn take_back(&mut self, h: f32) -> Option<f64> {
        let (h, gravity) = (f64::from(h), f64::from(self.gravity.length()));
        let turn = self.solver.joints.largest_turn(&self.bodies, [h, WIDE_TURN], gravity);
        if turn <= WIDE_TURN {
            return None;
        }
        self.unstiffen();
        let start = &self.scratch.start;
        self.bodies.velocities.clone_from(&start.velocities);
        self.scratch.prospective.clone_from(&start.prospective);
        self.scratch.displacements.clone_from(&start.displacements);
        self.bodies.contact_gains.clone_from(&start.contact_gains);
        Some(turn / h)
    }
}
