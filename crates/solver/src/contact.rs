//! A contact point, and the manifold of points that share two bodies and a frame.

use crate::{Cast, InverseMass, Real, Repair, Scalar, Vector, Velocity, moment};

/// What the points of a manifold share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manifold<T: Real, const L: usize> {
    /// The bodies a and b, indices into [`System::velocities`](crate::System::velocities).
    pub bodies: [u32; 2],
    /// The contact frame, orthonormal: the normal n first, from b towards a, then the tangents.
    pub frame: [Vector<T, L>; L],
    /// Coulomb coefficient mu. \[1\]
    pub friction: T,
    /// Restitution c_r, 0..1. \[1\]
    pub restitution: T,
    /// The largest epsilon of its points; by default infinite. \[1/kg\]
    pub compliance: T,
    /// The first of its points in [`System::contacts`](crate::System::contacts).
    pub first: u32,
    /// How many points it has.
    pub count: u32,
}

impl<T: Real, const L: usize> Default for Manifold<T, L> {
    /// Without friction, bounce or points.
    fn default() -> Self {
        Self {
            bodies: [0, 0],
            frame: [Vector::ZERO; L],
            friction: T::ZERO,
            restitution: T::ZERO,
            compliance: T::from_f64(f64::INFINITY),
            first: 0,
            count: 0,
        }
    }
}

impl<T: Real, const L: usize> Manifold<T, L> {
    /// The same in another number.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> Manifold<U, L>
    where
        T: Cast<U>,
    {
        let mut frame = [Vector::ZERO; L];
        for (axis, own) in frame.iter_mut().zip(&self.frame) {
            *axis = own.cast();
        }
        Manifold {
            bodies: self.bodies,
            frame,
            friction: self.friction.cast(),
            restitution: self.restitution.cast(),
            compliance: self.compliance.cast(),
            first: self.first,
            count: self.count,
        }
    }

    /// The unit normal n, from b towards a.
    #[inline(always)]
    pub fn normal(&self) -> Vector<T, L> {
        self.frame[0]
    }

    /// Where its points are in the contacts of its system.
    #[inline(always)]
    pub fn points(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    /// Components of a world vector along the frame: normal first.
    #[inline(always)]
    pub fn to_frame(&self, world: Vector<T, L>) -> Vector<T, L> {
        let mut components = Vector::ZERO;
        for i in 0..L {
            components[i] = self.frame[i].dot(world);
        }
        components
    }

    /// The world vector with these components along the frame.
    #[inline(always)]
    pub fn to_world(&self, components: Vector<T, L>) -> Vector<T, L> {
        let mut world = Vector::ZERO;
        for i in 0..L {
            world += self.frame[i] * components[i];
        }
        world
    }
}

/// One point of contact. Vectors of `L` components other than the anchors are in the manifold's
/// frame: component 0 along the normal, the others along the tangents.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contact<T: Real, const L: usize> {
    /// r_a: the point minus the center of mass of a. \[m\]
    pub anchor_a: Vector<T, L>,
    /// r_b: the same point minus the center of mass of b. \[m\]
    pub anchor_b: Vector<T, L>,
    /// Normal: distance between the surfaces, negative when they overlap (-d of the notes).
    /// Tangents: how far a has slipped on b since the point began to stick. \[m\]
    pub gap: Vector<T, L>,
    /// The relative velocity wanted after the step. \[m/s\]
    pub target: Vector<T, L>,
    /// gamma: the accumulated impulse; along the normal never negative, along the tangents
    /// never more than mu times that. \[N s\]
    pub impulse: Vector<T, L>,
    /// Impulse of the collisions of this step, apart from `impulse`. \[N s\]
    pub impact: T,
    /// m_eff = 1 / (A_ii + epsilon) along the normal. \[kg\]
    pub effective_mass: T,
    /// One over the largest eigenvalue of the tangents' block of A. \[kg\]
    pub tangential_mass: T,
    /// epsilon: normal velocity given way per impulse; 0 is rigid. \[1/kg\]
    pub compliance: T,
}

impl<T: Real, const L: usize> Contact<T, L> {
    /// The same in another number.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> Contact<U, L>
    where
        T: Cast<U>,
    {
        Contact {
            anchor_a: self.anchor_a.cast(),
            anchor_b: self.anchor_b.cast(),
            gap: self.gap.cast(),
            target: self.target.cast(),
            impulse: self.impulse.cast(),
            impact: self.impact.cast(),
            effective_mass: self.effective_mass.cast(),
            tangential_mass: self.tangential_mass.cast(),
            compliance: self.compliance.cast(),
        }
    }

    /// J_i v: velocity of a against b at this point, in the frame. \[m/s\]
    #[inline(always)]
    pub fn relative_velocity<const A: usize>(
        &self,
        manifold: &Manifold<T, L>,
        a: &Velocity<T, L, A>,
        b: &Velocity<T, L, A>,
    ) -> Vector<T, L> {
        manifold.to_frame(a.at(self.anchor_a) - b.at(self.anchor_b))
    }

    /// v_n: the component along the normal, positive when separating. \[m/s\]
    #[inline(always)]
    pub fn normal_velocity<const A: usize>(
        &self,
        manifold: &Manifold<T, L>,
        a: &Velocity<T, L, A>,
        b: &Velocity<T, L, A>,
    ) -> T {
        manifold.normal().dot(a.at(self.anchor_a) - b.at(self.anchor_b))
    }

    /// t: the velocity that the contact should have after the step. `a` and `b` are what the bodies
    /// have moved since the gap was measured.
    ///
    /// Overlap: min(c_d max(0, d - slop), push speed). Gap s: -s/h, so that it closes and no more.
    /// Slip of a sticking point: -hold slip, which returns it to where it stuck.
    #[inline(always)]
    pub fn set_target<const A: usize>(
        &mut self,
        manifold: &Manifold<T, L>,
        a: &Velocity<T, L, A>,
        b: &Velocity<T, L, A>,
        repair: &Repair<T>,
    ) {
        let gap = self.gap + self.relative_velocity(manifold, a, b);
        let overlap = T::ZERO.max(-gap[0] - repair.slop);
        let push = (overlap * repair.rate / repair.dt).min(repair.push_speed);
        self.target = gap * -repair.hold;
        self.target[0] = gap[0].choose(-gap[0] / repair.dt, push);
    }

    /// v += M^-1 J_i^T p for a world impulse `p` on a, and its opposite on b. \[N s\]
    #[inline(always)]
    pub fn apply<const A: usize>(
        &self,
        p: Vector<T, L>,
        masses: &[InverseMass<T, L, A>; 2],
        a: &mut Velocity<T, L, A>,
        b: &mut Velocity<T, L, A>,
    ) {
        *a += masses[0].response(self.anchor_a, p);
        *b -= masses[1].response(self.anchor_b, p);
    }

    /// epsilon over A_ii + epsilon: 0 rigid, towards 1 ever softer. \[1\]
    #[inline(always)]
    pub fn softness(&self) -> T {
        self.compliance * self.effective_mass
    }

    /// epsilon_T: how the sweeps soften friction, by the same part as the normal. \[1/kg\]
    #[inline(always)]
    pub fn tangential_compliance(&self) -> T {
        let softness = self.softness();
        let per_mass = softness / (T::ONE - softness);
        self.tangential_mass.choose(per_mass / self.tangential_mass, T::ZERO)
    }

    /// The slip that is kept of `slip` \[m\]: no more than what friction, as a spring that gives
    /// way like the normal does, can hold at the present normal impulse.
    pub fn held_slip(&self, friction: T, hold: T, slip: Vector<T, L>) -> Vector<T, L> {
        let softness = self.softness();
        let stiffness = self.tangential_mass * hold * (T::ONE - softness);
        let limit = friction * self.impulse[0] * softness;
        self.onto_disc(stiffness.choose(limit / stiffness, T::ZERO), slip)
    }

    /// What a unit impulse along axis `i` of the frame adds to the velocity along axis `j`: an entry
    /// of this contact's block of A. \[1/kg\]
    #[inline(always)]
    fn entry<const A: usize>(
        &self,
        manifold: &Manifold<T, L>,
        masses: &[InverseMass<T, L, A>; 2],
        i: usize,
        j: usize,
    ) -> T {
        let (p, n) = (manifold.frame[i], manifold.frame[j]);
        masses[0].between(self.anchor_a, p, n) + masses[1].between(self.anchor_b, p, n)
    }

    /// Sets the effective masses from the anchors, the frame and the inverse masses:
    /// m_eff = (m_a^-1 + m_b^-1 + (r_a x n) . W_a (r_a x n) + (r_b x n) . W_b (r_b x n) + epsilon)^-1
    /// (the notes' rigid m_eff, with I^-1 on r x n). Where nothing can move, they are 0.
    ///
    /// `softness` is epsilon over A_ii + epsilon: 0 rigid, towards 1 ever softer; the manifold may
    /// have it stiffer.
    #[inline(always)]
    pub fn prepare<const A: usize>(
        &mut self,
        manifold: &Manifold<T, L>,
        masses: &[InverseMass<T, L, A>; 2],
        softness: T,
    ) {
        let stiff = T::ONE - softness;
        let a_ii = self.entry(manifold, masses, 0, 0);
        self.compliance = (a_ii * softness / stiff).min(manifold.compliance);
        self.effective_mass = a_ii.choose(T::ONE / (a_ii + self.compliance), T::ZERO);
        let largest = match L {
            2 => self.entry(manifold, masses, 1, 1),
            3 => {
                let half = T::from_f64(0.5);
                let p = self.entry(manifold, masses, 1, 1);
                let q = self.entry(manifold, masses, 1, 2);
                let r = self.entry(manifold, masses, 2, 2);
                let (mean, half_difference) = ((p + r) * half, (p - r) * half);
                mean + (half_difference * half_difference + q * q).sqrt()
            }
            _ => T::ZERO,
        };
        self.tangential_mass = largest.choose(T::ONE / largest, T::ZERO);
    }
}

/// An orthonormal frame with `normal` first; equal normals give equal frames.
pub fn contact_frame<T: Scalar, const L: usize>(normal: Vector<T, L>) -> [Vector<T, L>; L] {
    let mut frame = [normal; L];
    match L {
        2 => {
            frame[1] = Vector(std::array::from_fn(|i| if i == 0 { -normal[1] } else { normal[0] }))
        }
        3 => {
            // The axis least along the normal, made orthogonal to it.
            let mut least = 0;
            for i in 1..L {
                if (normal[i] * normal[i]) < normal[least] * normal[least] {
                    least = i;
                }
            }
            let mut axis = Vector::ZERO;
            axis[least] = T::ONE;
            let across = axis - normal * normal[least];
            frame[1] = across * (T::ONE / across.length());
            frame[2] = moment(frame[0], frame[1]);
        }
        _ => {}
    }
    frame
}
