//! [`Manifold`] and [`Contact`]: the contact points of two bodies, with their common frame and
//! arms. A soft contact has a compliance epsilon; a visit projects friction onto Coulomb's disc.

use std::ops::Range;

use crate::body::{TwistAxes, all_axes};
use crate::vector::add_moment;
use crate::{Cast, ConstraintFrame, Mobility, Real, Scalar, Vector, Velocity};

/// Contact law with overlap repair and compliance: w = v_n - t + epsilon gamma.
pub(crate) const SOFT: u8 = 0;

/// Contact law without overlap repair and compliance.
pub(crate) const RIGID: u8 = 1;

/// Contact law without compliance at contacts that are open.
pub(crate) const RIGID_APART: u8 = 2;

/// The quantities shared by the contact points of two bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Manifold<T: Real, const L: usize> {
    /// Normal, tangents and arms. The center may be any point near the contact points.
    pub frame: ConstraintFrame<T, L>,
    /// Coulomb coefficient mu. \[1\]
    pub friction: T,
    /// Restitution c_r, 0..1. \[1\]
    pub restitution: T,
    /// Upper limit of epsilon of its points; infinite by default. \[1/kg\]
    pub compliance: T,
    /// Radii of curvature of the surfaces of a and b at the contact; 0 for a flat or sharp
    /// one. \[m\]
    pub radii: [T; 2],
    /// Fractions of the rotations of a and b that the normal follows. They are (1, 0) on a face of
    /// a, (0, 1) on a face of b, (1/2, 1/2) across two edges, and (0, 0) along the line through two
    /// centers of curvature. \[1\]
    pub normal_share: [T; 2],
    /// Bodies a and b, as indices into [`System::velocities`](crate::System::velocities).
    pub bodies: [u32; 2],
    /// Index of its first point in [`System::contacts`](crate::System::contacts).
    pub first: u32,
    /// Number of its points.
    pub count: u32,
}

impl<T: Real, const L: usize> Default for Manifold<T, L> {
    /// Returns a manifold without friction, restitution or points.
    fn default() -> Self {
        Self {
            bodies: [0, 0],
            frame: ConstraintFrame::default(),
            friction: T::ZERO,
            restitution: T::ZERO,
            compliance: T::from_f64(f64::INFINITY),
            radii: [T::ZERO; 2],
            normal_share: [T::from_f64(0.5); 2],
            first: 0,
            count: 0,
        }
    }
}

impl<T: Scalar, const L: usize> Manifold<T, L> {
    /// Converts to another number type.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> Manifold<U, L> {
        self.part(0)
    }
}

impl<T: Real, const L: usize> Manifold<T, L> {
    /// Converts one [part](Cast::part) to another number type.
    #[inline(always)]
    pub(crate) fn part<U: Real>(&self, index: usize) -> Manifold<U, L>
    where
        T: Cast<U>,
    {
        Manifold {
            bodies: self.bodies,
            frame: self.frame.part(index),
            friction: self.friction.part(index),
            restitution: self.restitution.part(index),
            compliance: self.compliance.part(index),
            radii: [self.radii[0].part(index), self.radii[1].part(index)],
            normal_share: [self.normal_share[0].part(index), self.normal_share[1].part(index)],
            first: self.first,
            count: self.count,
        }
    }

    /// Returns the unit normal n, from b towards a.
    #[inline(always)]
    pub fn normal(&self) -> Vector<T, L> {
        self.frame.axes[0]
    }

    /// Returns the range of its points in the contacts of its system.
    #[inline(always)]
    pub fn points(&self) -> Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }
}

/// A contact point. Vectors are in the manifold's frame: component 0 along the normal, the others
/// along the tangents.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Contact<T: Real, const L: usize> {
    /// Offset from the manifold's center, in the plane of the tangents: component 0 is 0, so that
    /// friction has no moment that tilts the plane. \[m\]
    pub offset: Vector<T, L>,
    /// Normal: distance between the surfaces, negative when they overlap (-d of the notes).
    /// Tangents: slip of a on b since the point began to stick. \[m\]
    pub gap: Vector<T, L>,
    /// Relative velocity to reach by the end of the step. \[m/s\]
    pub target: Vector<T, L>,
    /// gamma: the accumulated impulse. The normal component is never negative. The tangential part
    /// is never larger than mu times the sum of the normal component and `impact`. \[N s\]
    pub impulse: Vector<T, L>,
    /// Impulse of the collisions of this step, not part of `impulse`. \[N s\]
    pub impact: T,
    /// m_eff = 1 / (A_ii + epsilon) along the normal. \[kg\]
    pub effective_mass: T,
    /// 1 / (largest eigenvalue of the tangential block of A). \[kg\]
    pub tangential_mass: T,
    /// epsilon: normal velocity yielded per impulse; 0 is rigid. \[1/kg\]
    pub compliance: T,
    /// epsilon_T: compliance of friction; the sweeps soften both by the same fraction. \[1/kg\]
    pub tangential_compliance: T,
}

/// Conversion of overlaps and gaps to target velocities
/// ([`System::set_targets`](crate::System::set_targets)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repair<T> {
    /// Step h over which the velocities act. \[s\]
    pub dt: T,
    /// c_d h, 0..1: fraction of an overlap that one step repairs. \[1\]
    pub rate: T,
    /// Overlap that is not repaired. \[m\]
    pub slop: T,
    /// Largest repair velocity. \[m/s\]
    pub max_repair_speed: T,
    /// Rate at which the slip of a sticking point is undone, per second. \[1/s\]
    pub stick_rate: T,
}

impl<T: Scalar, const L: usize> Contact<T, L> {
    /// Converts to another number type.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> Contact<U, L> {
        self.part(0)
    }
}

impl<T: Real, const L: usize> Contact<T, L> {
    /// Converts one [part](Cast::part) to another number type.
    #[inline(always)]
    pub(crate) fn part<U: Real>(&self, index: usize) -> Contact<U, L>
    where
        T: Cast<U>,
    {
        Contact {
            offset: self.offset.part(index),
            gap: self.gap.part(index),
            target: self.target.part(index),
            impulse: self.impulse.part(index),
            impact: self.impact.part(index),
            effective_mass: self.effective_mass.part(index),
            tangential_mass: self.tangential_mass.part(index),
            compliance: self.compliance.part(index),
            tangential_compliance: self.tangential_compliance.part(index),
        }
    }

    /// Returns J_i v: the velocity of a relative to b at this point, from the manifold's
    /// twist. \[m/s\]
    #[inline(always)]
    pub fn relative_velocity<const A: usize>(&self, twist: &Velocity<T, L, A>) -> Vector<T, L> {
        let mut u = twist.linear;
        u[0] = self.normal_velocity(twist);
        // Velocity in the tangent plane from rotation about the normal.
        if A == 3 {
            u[1] -= twist.angular[0] * self.offset[2];
            u[2] += twist.angular[0] * self.offset[1];
        }
        u
    }

    /// Returns v_n: the normal component of the relative velocity, positive when
    /// separating. \[m/s\]
    #[inline(always)]
    pub fn normal_velocity<const A: usize>(&self, twist: &Velocity<T, L, A>) -> T {
        twist.at(self.offset)[0]
    }

    /// Adds the components `axes` of an impulse \[N s\] at this point to a wrench.
    #[inline(always)]
    pub fn add_wrench<const A: usize>(
        &self,
        axes: Range<usize>,
        impulse: Vector<T, L>,
        wrench: &mut Velocity<T, L, A>,
    ) {
        for axis in axes {
            wrench.linear[axis] += impulse[axis];
            match axis {
                0 => add_moment(self.offset, 0, impulse[0], &mut wrench.angular),
                // Moment about the normal from impulses in the tangent plane.
                1 if A == 3 => wrench.angular[0] -= self.offset[2] * impulse[1],
                2 if A == 3 => wrench.angular[0] += self.offset[1] * impulse[2],
                _ => {}
            }
        }
    }

    /// Returns J_i^T e: the wrench of a unit impulse along an axis of the frame.
    #[inline(always)]
    pub(crate) fn unit_wrench<const A: usize>(&self, axis: usize) -> Velocity<T, L, A> {
        let mut unit = Vector::ZERO;
        unit[axis] = T::ONE;
        let mut wrench = Velocity::NEG_ZERO;
        self.add_wrench(axis..axis + 1, unit, &mut wrench);
        wrench
    }

    /// Sets t: the velocity that the contact should have after the step. `moved` is the twist of
    /// the bodies' displacements since the gap was measured.
    ///
    /// Overlap d: t_n = min(c_d max(0, d - slop), push speed). Gap s: t_n = -s/h, which just closes
    /// it. Slip of a sticking point: t_T = -stick_rate slip, which returns it to where it stuck.
    #[inline(always)]
    pub fn set_target<const A: usize>(&mut self, moved: &Velocity<T, L, A>, repair: &Repair<T>) {
        let gap = self.gap + self.relative_velocity(moved);
        let overlap = T::ZERO.max(-gap[0] - repair.slop);
        let push = (overlap * (repair.rate / repair.dt)).min(repair.max_repair_speed);
        self.target = gap * -repair.stick_rate;
        self.target[0] = gap[0].choose(gap[0] * (-T::ONE / repair.dt), push);
    }

    /// Returns the bias: the part of the normal target that repairs an overlap, at least 0. It
    /// moves the bodies in a substep, and the relaxing sweep takes it out of their velocities.
    /// \[m/s\]
    #[inline(always)]
    pub fn bias(&self) -> T {
        self.target[0].max(T::ZERO)
    }

    /// Returns the normal target without the [`bias`](Self::bias), at most 0: the approach that
    /// just closes a gap. \[m/s\]
    #[inline(always)]
    pub fn unbiased_target(&self) -> T {
        self.target[0].min(T::ZERO)
    }

    /// Returns epsilon / (A_ii + epsilon): 0 is rigid, 1 the limit of softness. \[1\]
    #[inline(always)]
    pub fn softness(&self) -> T {
        self.compliance * self.effective_mass
    }

    /// Limits the slip in `gap` to what friction can hold at the current normal impulse, as a
    /// spring as soft as the normal. \[m\]
    #[inline(always)]
    pub fn held_slip(&self, friction: T, stick_rate: T, gap: Vector<T, L>) -> Vector<T, L> {
        let softness = self.softness();
        let stiffness = self.tangential_mass * stick_rate * (T::ONE - softness);
        let limit = friction * self.impulse[0] * softness;
        self.onto_disc(stiffness.choose(limit / stiffness, T::ZERO), gap)
    }

    /// Returns the velocity along axis `j` of the frame from a unit impulse along axis `i`: an
    /// entry of this contact's block of A. \[1/kg\]
    #[inline(always)]
    fn entry<const A: usize, const B: usize>(
        &self,
        mobility: &Mobility<T, L, A>,
        i: usize,
        j: usize,
    ) -> T {
        let mut twist: Velocity<T, L, B> = Velocity::NEG_ZERO;
        let from = TwistAxes { linear: i..i + 1, angular: 0..B };
        mobility.add(&from, &self.unit_wrench(i), &all_axes::<L, B>(), &mut twist);
        self.relative_velocity(&twist)[j]
    }

    /// Sets the effective masses and compliances from the manifold's mobility, with
    ///
    /// m_eff = (m_a^-1 + m_b^-1 + (r_a x n) . W_a (r_a x n)
    ///          + (r_b x n) . W_b (r_b x n) + epsilon)^-1
    ///
    /// (the notes' rigid m_eff, with I^-1 applied to r x n). They are 0 if nothing can move.
    ///
    /// `softness` is epsilon / (A_ii + epsilon): 0 is rigid, 1 the limit of softness. The
    /// manifold's compliance limits epsilon.
    #[inline(always)]
    pub fn prepare<const A: usize>(
        &mut self,
        manifold: &Manifold<T, L>,
        mobility: &Mobility<T, L, A>,
        softness: T,
    ) {
        self.prepare_felt::<A, A>(manifold, mobility, softness);
    }

    /// Prepares a point that depends on `B` components of rotation
    /// ([`ConstraintFrame::twist_felt`]).
    #[inline(always)]
    pub(crate) fn prepare_felt<const A: usize, const B: usize>(
        &mut self,
        manifold: &Manifold<T, L>,
        mobility: &Mobility<T, L, A>,
        softness: T,
    ) {
        let stiff = T::ONE - softness;
        let entry = |i, j| self.entry::<A, B>(mobility, i, j);
        let a_ii = entry(0, 0);
        let largest = match L {
            2 => entry(1, 1),
            3 => {
                let half = T::from_f64(0.5);
                let (p, q, r) = (entry(1, 1), entry(1, 2), entry(2, 2));
                let (mean, half_difference) = ((p + r) * half, (p - r) * half);
                mean + (half_difference * half_difference + q * q).sqrt()
            }
            _ => T::ZERO,
        };
        self.compliance = (a_ii * softness / stiff).min(manifold.compliance);
        self.effective_mass = a_ii.choose(T::ONE / (a_ii + self.compliance), T::ZERO);
        self.tangential_mass = largest.choose(T::ONE / largest, T::ZERO);
        let softness = self.softness();
        self.tangential_compliance = largest * (softness / (T::ONE - softness));
    }

    /// Returns w = v_n - t + epsilon gamma. A [`RIGID`] contact has neither overlap repair nor
    /// epsilon. A [`RIGID_APART`] contact has no epsilon while it is open, so that bodies do not
    /// penetrate those they fall on. \[m/s\]
    #[inline(always)]
    pub(crate) fn excess<const LAW: u8>(&self, v_n: T) -> T {
        let target = self.target[0];
        match LAW {
            RIGID => v_n - self.unbiased_target(),
            RIGID_APART => {
                v_n - target + (-target).choose(T::ZERO, self.compliance * self.impulse[0])
            }
            _ => v_n - target + self.compliance * self.impulse[0],
        }
    }

    /// Returns the residual of the contact laws: the larger of |min(gamma / m_eff, w)| along the
    /// normal and the residual of the friction projection. \[m/s\]
    #[inline(always)]
    pub(crate) fn residual<const A: usize, const LAW: u8>(
        &self,
        friction: T,
        twist: &Velocity<T, L, A>,
    ) -> T {
        let u = self.relative_velocity(twist);
        let normal = (self.impulse[0] / self.effective_mass).min(self.excess::<LAW>(u[0]));
        let slip = (self.friction_step(friction, u) - self.impulse).length() / self.tangential_mass;
        let slip = self.tangential_mass.choose(slip, T::ZERO);
        self.effective_mass.choose(normal.max(-normal).max(slip), T::ZERO)
    }

    /// Returns the impulse after a step against the slip velocity, projected onto Coulomb's disc of
    /// radius mu (gamma_n + impact) (in 2D: an interval). `u` is the relative velocity in the
    /// frame.
    #[inline(always)]
    pub(crate) fn friction_step(&self, friction: T, u: Vector<T, L>) -> Vector<T, L> {
        let mut tangential = self.impulse;
        for i in 1..L {
            tangential[i] -= self.tangential_mass * (u[i] - self.target[i]);
        }
        let kept = T::ONE - self.softness();
        for i in 1..L {
            tangential[i] = tangential[i] * kept;
        }
        self.onto_disc(friction * (self.impulse[0] + self.impact), tangential)
    }

    /// Scales the tangential components of `v` down to the disc of this radius.
    #[inline(always)]
    pub(crate) fn onto_disc(&self, radius: T, v: Vector<T, L>) -> Vector<T, L> {
        let mut out = v;
        if L == 2 {
            out[1] = v[1].max(-radius).min(radius);
            return out;
        }
        let mut squared = T::NEG_ZERO;
        for i in 1..L {
            squared += v[i] * v[i];
        }
        let length = squared.sqrt();
        let scale = (length - radius).choose(radius / length, T::ONE);
        for i in 1..L {
            out[i] = v[i] * scale;
        }
        out
    }
}
