//! [`ConstraintSolver`]: the contact solver of a world, and its state from step to step.

use drystone_solver::System;
use drystone_solver::lanes::LaneSystem;
use drystone_solver::restitution::ImpactSolver;

use crate::bodies::Bodies;
use crate::carriers::Carriers;
use crate::certifier::Certifier;
use crate::geometry::Geometry;
use crate::joints::Joints;
use crate::surfaces::SurfaceStates;

/// Contact solver of a world.
pub(crate) struct ConstraintSolver<const L: usize, const A: usize> {
    /// The contacts, sixteen per block.
    pub(crate) lanes: LaneSystem<L, A>,
    pub(crate) joints: Joints<L, A>,
    pub(crate) certifier: Certifier<L, A>,
    pub(crate) impacts: ImpactSolver<L, A>,
    pub(crate) surfaces: SurfaceStates<L, A>,
    pub(crate) carriers: Carriers<L, A>,
    /// Copy of the contacts one by one, for stages that need them. While [lent](Self::with_system),
    /// it holds the velocities and masses of the bodies; otherwise those arrays are empty.
    pub(crate) system: System<f32, L, A>,
}

impl<const L: usize, const A: usize> Default for ConstraintSolver<L, A> {
    fn default() -> Self {
        Self {
            lanes: LaneSystem::new(),
            joints: Joints::default(),
            certifier: Certifier::default(),
            impacts: ImpactSolver::default(),
            surfaces: SurfaceStates::default(),
            carriers: Carriers::default(),
            system: System::new(),
        }
    }
}

impl<const L: usize, const A: usize> ConstraintSolver<L, A> {
    /// Moves velocities and masses of the bodies to the system while `work` runs.
    pub(crate) fn with_system<G: Geometry<L, A>, R>(
        &mut self,
        bodies: &mut Bodies<G, L, A>,
        work: impl FnOnce(&mut Self, &Bodies<G, L, A>) -> R,
    ) -> R {
        let exchange = |solver: &mut Self, bodies: &mut Bodies<G, L, A>| {
            std::mem::swap(&mut solver.system.velocities, &mut bodies.velocities);
            std::mem::swap(&mut solver.system.masses, &mut bodies.inverse_masses);
        };
        exchange(self, bodies);
        let done = work(self, bodies);
        exchange(self, bodies);
        done
    }
}
