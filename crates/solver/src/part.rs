//! [`SubSystem`]: some manifolds of a system as a system of their own, in `f64`.

use crate::island::Islands;
use crate::mechanism::Mechanisms;
use crate::{Joint, Scalar, System, Velocity};

/// Index of a body that is not in the part.
const NONE: u32 = u32::MAX;

/// Copy of some manifolds of a system and their bodies.
#[derive(Clone, Debug, Default)]
pub(crate) struct SubSystem<const L: usize, const A: usize> {
    pub(crate) system: System<f64, L, A>,
    /// Velocities of its bodies at the time of the copy.
    pub(crate) start: Vec<Velocity<f64, L, A>>,
    /// Indices of its manifolds in the whole system.
    pub(crate) manifolds: Vec<u32>,
    /// Indices of its joints in the whole system.
    pub(crate) joints: Vec<u32>,
    /// Indices of its bodies in the whole system.
    pub(crate) bodies: Vec<u32>,
    /// For each body of the whole system, its index in the part or [`NONE`].
    inside: Vec<u32>,
    /// For each manifold of the whole system, whether it is in the part.
    holds: Vec<bool>,
}

impl<const L: usize, const A: usize> SubSystem<L, A> {
    /// Removes everything, and sizes the part for pieces of `whole`.
    pub(crate) fn clear<T: Scalar>(&mut self, whole: &System<T, L, A>) {
        for body in self.bodies.drain(..) {
            self.inside[body as usize] = NONE;
        }
        for manifold in self.manifolds.drain(..) {
            self.holds[manifold as usize] = false;
        }
        self.inside.resize(whole.velocities.len(), NONE);
        self.holds.resize(whole.manifolds.len(), false);
        self.start.clear();
        self.system.velocities.clear();
        self.system.masses.clear();
        self.system.manifolds.clear();
        self.system.contacts.clear();
        self.system.joints.clear();
        self.system.axes.clear();
        self.joints.clear();
    }

    /// Returns true if a manifold of the whole system is in the part.
    pub(crate) fn holds(&self, manifold: usize) -> bool {
        self.holds[manifold]
    }

    /// Returns true if a body of the whole system is in the part.
    pub(crate) fn has(&self, body: u32) -> bool {
        self.inside[body as usize] != NONE
    }

    /// Returns the velocity of a body in the part, or else in the whole system.
    pub(crate) fn velocity<T: Scalar>(
        &self,
        whole: &System<T, L, A>,
        body: u32,
    ) -> Velocity<T, L, A> {
        match self.inside[body as usize] {
            NONE => whole.velocities[body as usize],
            inside => self.system.velocities[inside as usize].cast(),
        }
    }

    /// Copies a manifold of the whole system into the part.
    pub(crate) fn add<T: Scalar>(&mut self, whole: &System<T, L, A>, index: usize) {
        let mut manifold = whole.manifolds[index].cast();
        manifold.bodies = manifold.bodies.map(|body| self.admit(whole, body));
        manifold.first = self.system.contacts.len() as u32;
        let points = &whole.contacts[whole.manifolds[index].points()];
        self.system.contacts.extend(points.iter().map(|contact| contact.cast()));
        self.system.manifolds.push(manifold);
        self.manifolds.push(index as u32);
        self.holds[index] = true;
    }

    /// Copies the manifolds and joints of an island into the part.
    pub(crate) fn add_island<T: Scalar>(
        &mut self,
        whole: &System<T, L, A>,
        islands: &Islands,
        island: u32,
    ) {
        for (index, manifold) in whole.manifolds.iter().enumerate() {
            if islands.of_pair(manifold.bodies) == island {
                self.add(whole, index);
            }
        }
        for (index, joint) in whole.joints.iter().enumerate() {
            if islands.of_pair(joint.bodies) == island {
                self.add_joint(whole, index);
            }
        }
    }

    /// Copies a joint of the whole system into the part.
    pub(crate) fn add_joint<T: Scalar>(&mut self, whole: &System<T, L, A>, index: usize) {
        let mut joint = whole.joints[index];
        joint.bodies = joint.bodies.map(|body| self.admit(whole, body));
        joint.first = self.system.axes.len() as u32;
        let axes = &whole.axes[whole.joints[index].axes()];
        self.system.axes.extend(axes.iter().map(|axis| axis.cast()));
        self.system.joints.push(joint);
        self.joints.push(index as u32);
    }

    /// Copies the joints of an island into the part. Their bodies are those of the whole system.
    pub(crate) fn add_mechanisms<T: Scalar>(
        &mut self,
        whole: &System<T, L, A>,
        mechanisms: &Mechanisms<L, A>,
        islands: &Islands,
        island: u32,
    ) {
        for (index, joint) in mechanisms.joints.iter().enumerate() {
            if islands.of_pair(joint.bodies) == island {
                let bodies = joint.bodies.map(|body| self.admit(whole, body));
                self.system.add_joint(bodies, &mechanisms.axes[joint.axes()]);
                self.joints.push(index as u32);
            }
        }
    }

    /// Returns the index in the whole system of each contact of the part.
    pub(crate) fn contacts<T: Scalar>(
        &self,
        whole: &System<T, L, A>,
    ) -> impl Iterator<Item = usize> {
        self.manifolds.iter().flat_map(|&index| whole.manifolds[index as usize].points())
    }

    /// Returns the index of each row of a joint of the part, where these are all joints.
    pub(crate) fn axes(&self, all: &[Joint]) -> impl Iterator<Item = usize> {
        self.joints.iter().flat_map(|&index| all[index as usize].axes())
    }

    fn admit<T: Scalar>(&mut self, whole: &System<T, L, A>, body: u32) -> u32 {
        let at = body as usize;
        if self.inside[at] == NONE {
            let velocity = whole.velocities[at].cast();
            self.inside[at] = self.system.add_body(velocity, whole.masses[at].cast());
            self.start.push(velocity);
            self.bodies.push(body);
        }
        self.inside[at]
    }
}
