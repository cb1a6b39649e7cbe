//! The contacts and joints of a substep, saved before they are solved.

#[cfg(feature = "assembled")]
use drystone_solver::assembled::{Assembly, ProblemError};
use drystone_solver::{System, Vector};

use crate::bodies::BodyView;
use crate::geometry::Geometry;
use crate::joint::record::WORLD;
use crate::joint::rows::{Role, RowPlan};
use crate::joints::Joints;

/// Input of the solver in a substep.
#[derive(Clone, Debug)]
pub struct SavedSystem<const L: usize, const A: usize> {
    /// The contacts and joints: prospective velocities, targets, and the impulses of the substep
    /// before as an initial guess that is not applied yet. Body i is slot i of the world.
    pub system: System<f64, L, A>,
    /// Name and rows of each joint of the system.
    pub joints: Vec<SavedJoint>,
    /// Centers of mass, from which the anchors of contacts are measured. \[m\]
    pub positions: Vec<Vector<f32, L>>,
    /// Length of the substep. \[s\]
    pub substep: f32,
}

/// A joint of a saved system.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedJoint {
    /// Slot of the joint in the world; a scene's joints are in its order.
    pub joint: u32,
    /// Slots of bodies a and b in the world; absent for the world itself.
    pub bodies: [Option<u32>; 2],
    /// Origin of frame a in the world. \[m\]
    pub point: Vec<f64>,
    /// Its rows, in order.
    pub rows: Vec<SavedRow>,
}

/// A row of a saved joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SavedRow {
    /// Index of its coordinate in [`Joint::axes`](crate::Joint::axes).
    pub axis: usize,
    /// Kind of the row.
    pub kind: RowKind,
}

/// Kind of a row of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowKind {
    /// Keeps a value.
    Lock,
    /// Keeps between two values.
    Limit,
    /// Spring or motor.
    Drive,
    /// Dry friction.
    Friction,
}

impl RowKind {
    /// Returns its name in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lock => "lock",
            Self::Limit => "limit",
            Self::Drive => "drive",
            Self::Friction => "friction",
        }
    }

    fn of(role: &Role) -> Self {
        match role {
            Role::Lock(..) => Self::Lock,
            Role::Limit(..) => Self::Limit,
            Role::Drive(_) => Self::Drive,
            Role::Friction(_) => Self::Friction,
        }
    }
}

/// A saved system as matrices, for any dimension. Feature `assembled`.
#[cfg(feature = "assembled")]
#[derive(Clone, Debug)]
pub struct SavedProblem {
    /// M, J, v*, t, epsilon, mu and gamma_0, and the rows of joints.
    pub assembly: Assembly,
    /// The impacts since the last contact search, as the notes' equation (2): A gamma = b with
    /// b = t - J v*, for rigid contacts without friction.
    ///
    /// v* is the velocity v^- without the impulses of these impacts, and with all forces. A contact
    /// that closed has t = -c_r J v*, or 0 if it separates. A gap keeps its target. Rows of joints
    /// are left out: impacts are resolved in turns with locks.
    pub impacts: Assembly,
    /// The contacts of the assembly, in its order.
    pub contacts: Vec<SavedContact>,
    /// The joints with rows in the assembly, in its order; those that nothing moves are left out.
    pub joints: Vec<SavedJoint>,
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
    /// Takes the contacts of a system without joints, and the rows of the joints that act.
    pub(crate) fn new<G: Geometry<L, A>>(
        contacts: &System<f32, L, A>,
        joints: &Joints<L, A>,
        at: &BodyView<'_, G, L, A>,
        substep: f32,
    ) -> Self {
        let mut system: System<f64, L, A> = contacts.cast();
        system.joints.clone_from(&joints.mechanisms.joints);
        system.axes.clone_from(&joints.mechanisms.axes);
        let saved = |&slot: &u32| {
            let record = &joints.records[slot as usize];
            let frame = at.of(record.bodies[0]).of(&record.frames[0]);
            let row = |plan: &RowPlan| SavedRow { axis: plan.axis, kind: RowKind::of(&plan.role) };
            SavedJoint {
                joint: slot,
                bodies: record.bodies.map(|body| (body != WORLD).then_some(body)),
                point: frame.position.0[..L].to_vec(),
                rows: record.rows.iter().map(row).collect(),
            }
        };
        Self {
            system,
            joints: joints.acting().iter().map(saved).collect(),
            positions: at.properties.frames.iter().map(|frame| frame.position).collect(),
            substep,
        }
    }

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
        let mut places = vec![None; self.system.contacts.len()];
        for manifold in &self.system.manifolds {
            for i in manifold.points() {
                let contact = &self.system.contacts[i];
                let center = self.positions[manifold.bodies[0] as usize].cast();
                places[i] = Some(SavedContact {
                    bodies: manifold.bodies,
                    point: (center + manifold.frame.anchors(contact.offset)[0]).0.to_vec(),
                    frame: manifold.frame.axes.map(|axis: Vector<f64, L>| axis.0.to_vec()).to_vec(),
                    restitution: manifold.restitution,
                    impact: contact.impact,
                });
            }
        }
        let contacts = assembly.contacts.iter().filter_map(|&i| places[i].take()).collect();
        let joints = self.moved_joints(&assembly);
        let substep = f64::from(self.substep);
        Ok(SavedProblem { assembly, impacts, contacts, joints, width: L + A, substep })
    }

    /// Returns the joints with the rows that are in an assembly of the system.
    fn moved_joints(&self, assembly: &Assembly) -> Vec<SavedJoint> {
        let mut kept = assembly.rows.axes.iter().copied().peekable();
        let mut joints = Vec::new();
        for (joint, saved) in self.system.joints.iter().zip(&self.joints) {
            let rows = joint.axes().zip(&saved.rows);
            let rows: Vec<_> =
                rows.filter_map(|(index, row)| kept.next_if_eq(&index).map(|_| *row)).collect();
            if !rows.is_empty() {
                joints.push(SavedJoint { rows, ..saved.clone() });
            }
        }
        joints
    }

    /// Returns the contacts before the impacts, with their targets ([`SavedProblem::impacts`]).
    fn impacts(&self) -> System<f64, L, A> {
        let mut system = self.system.clone();
        system.joints.clear();
        system.axes.clear();
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
