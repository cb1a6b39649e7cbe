//! The contact problem of a substep, saved before it is solved.

use drystone_solver::{System, Vector};

/// Input of the solver in a substep.
#[derive(Clone, Debug)]
pub struct SavedSystem<const L: usize, const A: usize> {
    /// The contact system: prospective velocities, targets, and the impulses of the substep before
    /// as an initial guess that is not applied yet. Body i is slot i of the world.
    pub system: System<f32, L, A>,
    /// Centers of mass, from which the anchors of contacts are measured. \[m\]
    pub positions: Vec<Vector<f32, L>>,
    /// Length of the substep. \[s\]
    pub substep: f32,
}

/// A saved system as matrices, for any dimension. Feature `assembled`.
#[cfg(feature = "assembled")]
#[derive(Clone, Debug)]
pub struct SavedProblem {
    /// M, J, v*, t, epsilon, mu and gamma_0.
    pub assembly: drystone_solver::assembled::Assembly,
    /// The contacts of the assembly, in its order.
    pub contacts: Vec<SavedContact>,
    /// Number of velocity components of a body: linear and angular.
    pub width: usize,
    /// Length of the substep. \[s\]
    pub substep: f64,
}

/// Position and frame of a contact.
#[cfg(feature = "assembled")]
#[derive(Clone, Debug)]
pub struct SavedContact {
    /// Slots of bodies a and b in the world; a scene's bodies are in its order.
    pub bodies: [u32; 2],
    /// Contact point in the world. \[m\]
    pub point: Vec<f64>,
    /// The contact frame: the unit normal from b to a, then the tangents.
    pub frame: Vec<Vec<f64>>,
    /// Impulse of an impact in this substep. It counts as normal impulse for friction, and the
    /// matrices do not contain it. \[N s\]
    pub impact: f64,
}

#[cfg(feature = "assembled")]
impl<const L: usize, const A: usize> SavedSystem<L, A> {
    /// Returns the system as matrices.
    ///
    /// # Errors
    /// Fails if a number is not finite.
    pub fn problem(&self) -> Result<SavedProblem, drystone_solver::assembled::ProblemError> {
        let assembly = drystone_solver::assembled::Assembly::of_system(&self.system)?;
        let numbers = |v: Vector<f32, L>| v.0.map(f64::from).to_vec();
        let mut places = vec![None; self.system.contacts.len()];
        for manifold in &self.system.manifolds {
            for i in manifold.points() {
                let contact = &self.system.contacts[i];
                let center = self.positions[manifold.bodies[0] as usize];
                places[i] = Some(SavedContact {
                    bodies: manifold.bodies,
                    point: numbers(center + manifold.frame.anchors(contact.offset)[0]),
                    frame: manifold.frame.axes.map(numbers).to_vec(),
                    impact: f64::from(contact.impact),
                });
            }
        }
        let contacts = assembly.contacts.iter().filter_map(|&i| places[i].take()).collect();
        Ok(SavedProblem { assembly, contacts, width: L + A, substep: f64::from(self.substep) })
    }
}
