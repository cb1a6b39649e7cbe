//! [`WorldKind`]: rigid bodies or particles, in the plane or in space.

use drystone_scene::{BodiesAs, Scene};

/// Kind of a world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorldKind {
    /// Rigid bodies in the plane.
    Rigid2,
    /// Rigid bodies in space.
    Rigid3,
    /// Particles in the plane.
    Particles2,
    /// Particles in space.
    Particles3,
}

impl WorldKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Rigid2, Self::Rigid3, Self::Particles2, Self::Particles3];

    /// Returns the kind of world that a scene needs.
    pub fn of(scene: &Scene) -> Self {
        match (scene.dimension, scene.bodies_as) {
            (2, BodiesAs::Rigid) => Self::Rigid2,
            (2, BodiesAs::Particles) => Self::Particles2,
            (_, BodiesAs::Rigid) => Self::Rigid3,
            (_, BodiesAs::Particles) => Self::Particles3,
        }
    }

    /// Returns the number of dimensions: 2 or 3.
    pub fn dimension(self) -> usize {
        if matches!(self, Self::Rigid2 | Self::Particles2) { 2 } else { 3 }
    }

    /// Returns true if bodies are particles, which never rotate.
    pub fn has_particles(self) -> bool {
        matches!(self, Self::Particles2 | Self::Particles3)
    }

    /// Returns how many numbers a pose has: 7 in 3D, 3 in 2D.
    pub fn pose_numbers(self) -> usize {
        drystone::geometry::pose_numbers(self.dimension())
    }

    /// Returns how many numbers a velocity or a force has: 6 in 3D, 3 in 2D.
    pub fn velocity_numbers(self) -> usize {
        if self.dimension() == 3 { 6 } else { 3 }
    }
}
