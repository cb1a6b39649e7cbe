//! Solving to a tolerance: what a step keeps for its certificates.

use drystone_solver::certificate::{Certificate, Memory};
use drystone_solver::island::Islands;
use drystone_solver::ladder::{self, Outcome};
use drystone_solver::solution::Goal;
use drystone_solver::wide::Wide;
use drystone_solver::{System, Velocity};

use crate::settings::StepSettings;

/// Islands, and the memory of their certificates.
#[derive(Default)]
pub(crate) struct Certifier<const L: usize, const A: usize> {
    /// The velocities of a substep without the impulses of its contacts.
    pub(crate) prospective: Vec<Velocity<f32, L, A>>,
    islands: Islands,
    memory: Memory<L, A>,
    certificates: Vec<Certificate>,
    weights: Vec<f32>,
}

impl<const L: usize, const A: usize> Certifier<L, A> {
    /// Finds the islands of a part of a step, and makes contacts so stiff that one which carries the
    /// weight W \[N\] of its island sinks by the sag: stiffness k = W / sag, and by the implicit
    /// form of a spring that repairs the part c of its depth per substep h, epsilon = c / (h^2 k).
    pub(crate) fn stiffen(
        &mut self,
        system: &mut System<f32, L, A>,
        weight: impl Fn(usize) -> f32,
        settings: &StepSettings,
        h: f32,
    ) {
        self.islands.find(system);
        self.weights.clear();
        self.weights.resize(self.islands.count, 0.0);
        for (body, &island) in self.islands.of_body.iter().enumerate() {
            if let Some(sum) = self.weights.get_mut(island as usize) {
                *sum += weight(body);
            }
        }
        for manifold in &mut system.manifolds {
            let island = self.islands.of_pair(manifold.bodies) as usize;
            let weight = self.weights.get(island).copied().unwrap_or(0.0);
            manifold.compliance = settings.repair * settings.sag / (h * h * weight);
        }
    }

    /// Brings what the sweeps have left within the tolerance.
    pub(crate) fn refine(
        &mut self,
        system: &mut System<f32, L, A>,
        wide: &mut Wide<L, A>,
        settings: &StepSettings,
    ) -> Outcome {
        wide.unpack(system);
        let goal =
            Goal { tolerance: f64::from(settings.tolerance), budget: settings.budget as usize };
        let (memory, certificates) = (&mut self.memory, &mut self.certificates);
        let islands = &self.islands;
        let outcome =
            ladder::refine(system, &self.prospective, islands, &goal, memory, certificates);
        if outcome.climbed.iter().sum::<usize>() + outcome.failed > 0 {
            wide.take_impulses(system);
        }
        outcome
    }
}
