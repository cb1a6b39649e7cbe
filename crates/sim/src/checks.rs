//! Checks of changes to bodies before the changes are made: the errors that the setters of a world
//! would return.
//!
//! A setter changes nothing if it fails. A program that changes several bodies at once checks all
//! changes first, and then either makes all or none.

use drystone_solver::Velocity;

use crate::body::Motion;
use crate::geometry::Geometry;
use crate::ids::BodyId;
use crate::input::{self, InputError};
use crate::world::World;

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Checks a call of [`World::set_pose`], and changes nothing.
    ///
    /// # Errors
    /// Those of the call.
    pub fn check_set_pose(&self, id: BodyId, pose: &G::Pose) -> Result<(), InputError> {
        self.check_known(id)?;
        input::check_pose::<G, L, A>(pose)
    }

    /// Checks a call of [`World::set_velocity`], and changes nothing.
    ///
    /// # Errors
    /// Those of the call.
    pub fn check_set_velocity(
        &self,
        id: BodyId,
        velocity: &Velocity<f32, L, A>,
    ) -> Result<(), InputError> {
        self.check_moving(id)?;
        input::check_velocity(velocity)
    }

    /// Checks a call of [`World::move_to`], and changes nothing.
    ///
    /// # Errors
    /// Those of the call.
    pub fn check_move_to(&self, id: BodyId, target: &G::Pose, dt: f32) -> Result<(), InputError> {
        self.check_moving(id)?;
        input::check_pose::<G, L, A>(target)?;
        input::check_time(dt)?;
        input::check_velocity(&self.bodies.velocity_to(id.index(), target, dt))
    }

    /// Checks a call of [`World::add_force`], and changes nothing.
    ///
    /// # Errors
    /// Those of the call.
    pub fn check_add_force(
        &self,
        id: BodyId,
        force: &Velocity<f32, L, A>,
    ) -> Result<(), InputError> {
        self.check_known(id)?;
        input::check_force(force)
    }

    /// Rejects an unknown body.
    fn check_known(&self, id: BodyId) -> Result<(), InputError> {
        self.velocity(id).map(|_| ()).ok_or(InputError::UnknownBody)
    }

    /// Rejects an unknown or a static body.
    fn check_moving(&self, id: BodyId) -> Result<(), InputError> {
        self.check_known(id)?;
        let is_static = self.bodies.motion[id.index()] == Some(Motion::Static);
        if is_static { Err(InputError::Static) } else { Ok(()) }
    }
}
