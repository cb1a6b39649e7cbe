//! [`System`]: bodies and contacts of one step, as a plain value.

use crate::contact::{RIGID, SOFT};
use crate::{
    Axis, Contact, InverseMass, Joint, Manifold, Mobility, Real, Repair, Scalar, Vector, Velocity,
};

/// The contact problem of a step:
///
/// find gamma >= 0 with w = J v+ - t + epsilon gamma >= 0, gamma . w = 0, v+ = v + M^-1 J^T gamma.
///
/// This is the notes' A gamma - b >= 0 with b = t - J v, where v are the prospective velocities.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct System<T: Real, const L: usize, const A: usize> {
    /// v of each body: prospective velocity before solving, v+ after.
    pub velocities: Vec<Velocity<T, L, A>>,
    /// M^-1 of each body.
    pub masses: Vec<InverseMass<T, L, A>>,
    /// Manifolds, in the order in which a sweep visits them.
    pub manifolds: Vec<Manifold<T, L>>,
    /// Points of the manifolds, manifold by manifold.
    pub contacts: Vec<Contact<T, L>>,
    /// Joints, which a sweep visits after the manifolds.
    pub joints: Vec<Joint<T, L>>,
    /// Rows of the joints, joint by joint.
    pub axes: Vec<Axis<T, L, A>>,
}

impl<T: Real, const L: usize, const A: usize> System<T, L, A> {
    /// Creates a system without bodies and contacts.
    pub fn new() -> Self {
        Self {
            velocities: Vec::new(),
            masses: Vec::new(),
            manifolds: Vec::new(),
            contacts: Vec::new(),
            joints: Vec::new(),
            axes: Vec::new(),
        }
    }

    /// Adds a body and returns its index.
    pub fn add_body(&mut self, velocity: Velocity<T, L, A>, mass: InverseMass<T, L, A>) -> u32 {
        self.velocities.push(velocity);
        self.masses.push(mass);
        self.velocities.len() as u32 - 1
    }

    /// Adds a manifold with these points, and sets its `first` and `count`.
    ///
    /// # Panics
    /// A point is not in the manifold's tangent plane ([`Contact::offset`]).
    pub fn add_manifold(&mut self, mut manifold: Manifold<T, L>, points: &[Contact<T, L>]) {
        assert!(points.iter().all(|point| point.offset[0] == T::ZERO), "points in one plane");
        manifold.first = self.contacts.len() as u32;
        manifold.count = points.len() as u32;
        self.manifolds.push(manifold);
        self.contacts.extend_from_slice(points);
    }

    /// Adds a joint with these rows, and sets its `first` and `count`.
    pub fn add_joint(&mut self, mut joint: Joint<T, L>, axes: &[Axis<T, L, A>]) {
        joint.first = self.axes.len() as u32;
        joint.count = axes.len() as u32;
        self.joints.push(joint);
        self.axes.extend_from_slice(axes);
    }

    /// Returns the pair of bodies of each manifold, then of each joint.
    pub fn pairs(&self) -> impl Iterator<Item = [u32; 2]> + Clone {
        let manifolds = self.manifolds.iter().map(|manifold| manifold.bodies);
        manifolds.chain(self.joints.iter().map(|joint| joint.bodies))
    }

    /// Returns the inverse masses of the two bodies of a manifold.
    #[inline(always)]
    pub fn masses_of(&self, manifold: &Manifold<T, L>) -> [InverseMass<T, L, A>; 2] {
        manifold.bodies.map(|body| self.masses[body as usize])
    }

    /// Returns the velocities of the two bodies of a manifold.
    #[inline(always)]
    pub fn velocities_of(&self, manifold: &Manifold<T, L>) -> [Velocity<T, L, A>; 2] {
        manifold.bodies.map(|body| self.velocities[body as usize])
    }

    /// Sets the velocities of the two bodies of a manifold.
    #[inline(always)]
    pub(crate) fn set_velocities(
        &mut self,
        manifold: &Manifold<T, L>,
        velocities: [Velocity<T, L, A>; 2],
    ) {
        for (body, velocity) in manifold.bodies.into_iter().zip(velocities) {
            self.velocities[body as usize] = velocity;
        }
    }

    /// Returns the relative motion of the bodies of a manifold ([`ConstraintFrame::twist`]).
    #[inline(always)]
    pub fn twist_of(&self, manifold: &Manifold<T, L>) -> Velocity<T, L, A> {
        let [a, b] = self.velocities_of(manifold);
        manifold.frame.twist(&a, &b)
    }

    /// Sets the effective masses of every contact ([`Contact::prepare`]), and of every row of a joint
    /// ([`Axis::prepare`]).
    pub fn prepare(&mut self, softness: T) {
        for manifold in &self.manifolds {
            let mobility = Mobility::of(&manifold.frame, &self.masses_of(manifold));
            for contact in &mut self.contacts[manifold.points()] {
                contact.prepare(manifold, &mobility, softness);
            }
        }
        for joint in &self.joints {
            let masses = joint.bodies.map(|body| self.masses[body as usize]);
            let mobility = Mobility::of(&joint.frame, &masses);
            for axis in &mut self.axes[joint.axes()] {
                axis.prepare(&mobility);
            }
        }
    }

    /// Sets t: the velocity that each contact should have after the step. `displacements` are those
    /// of the bodies since the gaps were measured.
    pub fn set_targets(&mut self, displacements: &[Velocity<T, L, A>], repair: &Repair<T>) {
        for manifold in &self.manifolds {
            let [a, b] = manifold.bodies.map(|body| &displacements[body as usize]);
            let moved = manifold.frame.twist(a, b);
            for contact in &mut self.contacts[manifold.points()] {
                contact.set_target(&moved, repair);
            }
        }
    }

    /// Adds the impulses of the contacts to the velocities: v += M^-1 J^T gamma.
    pub fn apply_impulses(&mut self) {
        for index in 0..self.manifolds.len() {
            self.change(index, |_, contact| contact.impulse);
        }
        for joint in &self.joints {
            let mut wrench = Velocity::ZERO;
            for axis in &self.axes[joint.axes()] {
                wrench += axis.direction * axis.impulse;
            }
            let [a, b] = joint.bodies.map(|body| body as usize);
            let [to_a, from_b] = joint.frame.momenta(&wrench);
            self.velocities[a] += self.masses[a].velocity(&to_a);
            self.velocities[b] -= self.masses[b].velocity(&from_b);
        }
    }

    /// Adds impulses to the velocities: v += M^-1 J^T p, with p from `impulse` for each contact of
    /// a manifold and its index. \[N s\]
    #[inline(always)]
    pub(crate) fn change(
        &mut self,
        manifold: usize,
        mut impulse: impl FnMut(usize, &mut Contact<T, L>) -> Vector<T, L>,
    ) {
        let manifold = self.manifolds[manifold];
        let mut wrench = Velocity::ZERO;
        for (index, contact) in manifold.points().zip(&mut self.contacts[manifold.points()]) {
            let impulse = impulse(index, contact);
            contact.add_wrench(0..L, impulse, &mut wrench);
        }
        let [mut a, mut b] = self.velocities_of(&manifold);
        manifold.frame.apply(&wrench, &self.masses_of(&manifold), &mut a, &mut b);
        self.set_velocities(&manifold, [a, b]);
    }
}

impl<T: Scalar, const L: usize, const A: usize> System<T, L, A> {
    /// Converts to another number type.
    pub fn cast<U: Real>(&self) -> System<U, L, A> {
        System {
            velocities: self.velocities.iter().map(Velocity::cast).collect(),
            masses: self.masses.iter().map(InverseMass::cast).collect(),
            manifolds: self.manifolds.iter().map(Manifold::cast).collect(),
            contacts: self.contacts.iter().map(Contact::cast).collect(),
            joints: self.joints.iter().map(Joint::cast).collect(),
            axes: self.axes.iter().map(Axis::cast).collect(),
        }
    }

    /// Returns the residual of the contact laws: the largest velocity error over all contacts, of
    /// |min(gamma / m_eff, w)| along the normal and of the friction projection. \[m/s\]
    ///
    /// It is zero exactly at a solution. `rigid` leaves out compliance and overlap repair, as
    /// [`relax`](crate::pgs::relax) does.
    pub fn residual(&self, rigid: bool) -> f64 {
        if rigid { self.residual_of::<{ RIGID }>() } else { self.residual_of::<SOFT>() }
    }

    fn residual_of<const LAW: u8>(&self) -> f64 {
        let mut worst = T::ZERO;
        for manifold in &self.manifolds {
            let twist = self.twist_of(manifold);
            for contact in &self.contacts[manifold.points()] {
                worst = contact.residual::<A, LAW>(manifold.friction, &twist).max(worst);
            }
        }
        for joint in &self.joints {
            let [a, b] = joint.bodies.map(|body| self.velocities[body as usize]);
            let twist = joint.frame.twist(&a, &b);
            for axis in &self.axes[joint.axes()] {
                let error = match LAW {
                    RIGID => axis.residual::<true>(&twist),
                    _ => axis.residual::<false>(&twist),
                };
                worst = error.max(worst);
            }
        }
        worst.to_f64()
    }
}
