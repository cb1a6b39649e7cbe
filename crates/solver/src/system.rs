//! [`System`]: bodies and contacts of one step, as a plain value.

use crate::contact::{RIGID, SOFT};
use crate::{
    Axis, Contact, InverseMass, Joint, Manifold, Mobility, Real, Repair, Scalar, Vector, Velocity,
};

/// The contact problem of a step.
///
/// Bodies have velocities **v** and inverse masses M^-1. At each of k contacts they touch, or
/// nearly touch, along a unit normal n that points from body b towards body a. Find impulses γ
/// (gamma) such that after the step every contact separates at its target velocity or faster. No
/// contact pulls, and none pushes if it separates faster than its target:
///
/// ```text
/// 1.  v_n = J v                                relative velocity along each normal, positive
///                                              when separating
/// 2.  v⁺ = v + M⁻¹ Jᵀ γ                        impulses change velocities
/// 3.  t = max(−c_r v_n⁻, c_d d)                target of v_n: restitution, or overlap repair
/// 4.  A γ = b,  A = J M⁻¹ Jᵀ,  b = t − J v     impulses that reach the target exactly
/// 5.  0 ≤ γ  ⊥  A γ − b ≥ 0                    contacts only push, and those that separate faster
///                                              than their target do not push at all
/// 6.  γ_i ← max(0, γ_i + m_eff (t_i − v_i))    for each contact in turn, repeatedly
///     v ← v + M⁻¹ J_iᵀ Δγ_i
/// ```
///
/// Here v are the velocities without contacts (prospective), v⁻ those before the step's forces,
/// and m_eff = 1 / A_ii. With the compliance ε, A γ + ε γ stands for A γ.
///
/// | Equation | In code | Module |
/// |---|---|---|
/// | v_n = J_i v | [`ConstraintFrame::twist`](crate::ConstraintFrame::twist), [`Contact::normal_velocity`] | constraint, contact |
/// | v += M^-1 J_i^T p | [`Contact::add_wrench`], [`ConstraintFrame::apply`](crate::ConstraintFrame::apply) | contact, constraint |
/// | m_eff | [`Mobility::of`], [`Contact::prepare`] | constraint, contact |
/// | r x n, omega x r | [`moment`](crate::moment), [`spin`](crate::spin) | vector |
/// | t: overlap and gap | [`System::set_targets`] | system |
/// | t: restitution | [`set_targets`](crate::restitution::set_targets) | restitution |
/// | belts, rolling resistance | [`SurfaceEffects`](crate::SurfaceEffects) | surface |
/// | collisions, isolated as in (1) or together | [`collide`](crate::restitution::collide) | restitution |
/// | one Gauss-Seidel sweep, step 6 | [`sweep`](crate::pgs::sweep) | pgs |
/// | v += M^-1 J^T gamma | [`System::apply_impulses`] | system |
/// | residual of 5 | [`System::residual`] | system |
/// | J, M^-1, A, b as matrices; A gamma = b, (2) | `assembled` (feature `assembled`) | assembled |
///
/// `T` is the number type ([`Real`]), `L` and `A` are the linear and angular dimensions of a body:
/// (2, 0) and (3, 0) are particles, (2, 1) and (3, 3) rigid bodies. The same source serves all.
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
    pub joints: Vec<Joint>,
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

    /// Adds a joint of these bodies with these rows.
    pub fn add_joint(&mut self, bodies: [u32; 2], axes: &[Axis<T, L, A>]) {
        let first = self.axes.len() as u32;
        self.joints.push(Joint { bodies, first, count: axes.len() as u32 });
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

    /// Returns the relative motion of the bodies of a manifold ([`ConstraintFrame::twist`](crate::ConstraintFrame::twist)).
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
            for axis in &mut self.axes[joint.axes()] {
                axis.prepare(&masses);
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
            for axis in &self.axes[joint.axes()] {
                for (body, jacobian) in joint.bodies.into_iter().zip(&axis.jacobian) {
                    let body = body as usize;
                    let gain = self.masses[body].velocity(&(*jacobian * axis.impulse));
                    self.velocities[body] += gain;
                }
            }
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
            joints: self.joints.clone(),
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
            for axis in &self.axes[joint.axes()] {
                let velocity = axis.velocity(&a, &b);
                let error = match LAW {
                    RIGID => axis.residual::<true>(velocity),
                    _ => axis.residual::<false>(velocity),
                };
                worst = error.max(worst);
            }
        }
        worst.to_f64()
    }
}
