//! The contact problem of a substep, saved before it is solved.

#[cfg(feature = "assembled")]
use drystone_solver::assembled::{Assembly, ProblemError};
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
    pub assembly: Assembly,
    /// The impacts since the last contact search, as the notes' equation (2): A gamma = b with
    /// b = t - J v*, for rigid contacts without friction.
    ///
    /// v* is the velocity v^- without the impulses of these impacts, and with all forces. A contact
    /// that closed has t = -c_r J v*, or 0 if it separates. A gap keeps its target.
    pub impacts: Assembly,
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
    /// c_r, 0 to 1. \[1\]
    pub restitution: f64,
    /// Impulse of the impacts since the last contact search. It counts as normal impulse for
    /// friction. v* contains it; the matrices do not. \[N s\]
    pub impact: f64,
}

impl<const L: usize, const A: usize> SavedSystem<L, A> {
    /// Returns true if a contact bounced since the last contact search.
    pub(crate) fn has_impacts(&self) -> bool {
        self.system.contacts.iter().any(|contact| contact.impact > 0.0)
    }
}

#[cfg(feature = "assembled")]
impl<const L: usize, const A: usize> SavedSystem<L, A> {
    /// Returns the system as matrices.
    ///
    /// # Errors
    /// Fails if a number is not finite.
    pub fn problem(&self) -> Result<SavedProblem, ProblemError> {
        let assembly = Assembly::of_system(&self.system)?;
        let impacts = Assembly::of_system(&self.impacts())?;
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
                    restitution: f64::from(manifold.restitution),
                    impact: f64::from(contact.impact),
                });
            }
        }
        let contacts = assembly.contacts.iter().filter_map(|&i| places[i].take()).collect();
        let substep = f64::from(self.substep);
        Ok(SavedProblem { assembly, impacts, contacts, width: L + A, substep })
    }

    /// Returns the system before the impacts, with their targets ([`SavedProblem::impacts`]).
    fn impacts(&self) -> System<f64, L, A> {
        let mut system: System<f64, L, A> = self.system.cast();
        for contact in &mut system.contacts {
            contact.impulse = Vector::ZERO;
            contact.impulse[0] = -contact.impact;
            (contact.compliance, contact.tangential_compliance) = (0.0, 0.0);
        }
        system.apply_impulses();
        for index in 0..system.manifolds.len() {
            system.manifolds[index].friction = 0.0;
            let manifold = system.manifolds[index];
            let twist = system.twist_of(&manifold);
            for contact in &mut system.contacts[manifold.points()] {
                let (u, open) = (contact.normal_velocity(&twist), contact.target[0].min(0.0));
                let closes = contact.impact > 0.0 || u < open;
                let bounce = (-manifold.restitution * u).max(0.0);
                (contact.impulse, contact.target) = (Vector::ZERO, Vector::ZERO);
                contact.target[0] = if closes { bounce } else { open };
            }
        }
        system
    }
}
