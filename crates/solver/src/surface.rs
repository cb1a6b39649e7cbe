//! [`SurfaceEffects`]: conveyor belts, and resistance to rolling and spinning.
//!
//! A belt adds its velocity to the slip that friction acts against:
//!
//! ```text
//! t_T = -stick_rate slip - c      c: surface velocity of a relative to b, along the tangents
//! ```
//!
//! It is part of the target, so every method and the certificate treat it as any target. The slip
//! of a sticking point is measured relative to the belt, so it does not grow with the motion of the
//! belt.
//!
//! Resistance is an angular impulse tau between the two bodies, with omega their relative angular
//! velocity:
//!
//! ```text
//! rolling   |tau_T| <= rho P      tau_T <- project onto the disc (tau_T - omega_T / w)
//! spinning  |tau_n| <= sigma P    P: sum of the normal impulses of the manifold's points
//! ```
//!
//! This models a support whose force acts up to rho ahead of the contact. A solid ball of radius r
//! decelerates at rho g / (1.4 r), and stays at rest on slopes up to atan(rho / r). While a substep
//! is solved tau is a given torque, that of the previous substep; it is updated afterwards. The
//! certificate is for the problem with that torque.

use crate::lanes::Lanes;
use crate::{ConstraintFrame, Contact, InverseMass, Real, Vector, Velocity};

/// Motion of the surfaces of a manifold's two bodies, and their resistance to rotation relative to
/// each other.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SurfaceEffects<T: Real, const L: usize, const A: usize> {
    /// Surface velocity of a relative to b, in addition to the motion of the bodies: at the
    /// manifold's center, in its frame. Only the tangential components and rotation about the
    /// normal are used. \[m/s, rad/s\]
    pub belt: Velocity<T, L, A>,
    /// Rolling resistance rho. \[m\]
    pub rolling: T,
    /// Spinning resistance sigma, about the normal. \[m\]
    pub spinning: T,
    /// tau: the accumulated angular impulse on a, in the frame. \[N m s\]
    pub torque: Vector<T, A>,
}

impl<T: Real, const L: usize, const A: usize> Default for SurfaceEffects<T, L, A> {
    fn default() -> Self {
        Self::NONE
    }
}

impl<T: Real, const L: usize, const A: usize> SurfaceEffects<T, L, A> {
    /// Surfaces that neither move nor resist.
    pub const NONE: Self =
        Self { belt: Velocity::ZERO, rolling: T::ZERO, spinning: T::ZERO, torque: Vector::ZERO };

    /// Returns the belt of a contact frame whose surfaces move at these velocities relative to
    /// their bodies. The velocities are given at the centers of mass, like those of bodies.
    pub fn belt(
        frame: &ConstraintFrame<T, L>,
        [a, b]: [&Velocity<T, L, A>; 2],
    ) -> Velocity<T, L, A> {
        let mut belt = frame.twist(a, b);
        belt.linear[0] = T::ZERO;
        // Rotation about other axes than the normal would lift the contact; in 2D there is no
        // rotation about the normal.
        for axis in A / 3..A {
            belt.angular[axis] = T::ZERO;
        }
        belt
    }

    /// Subtracts the belt velocity times `target` \[1\] from the target of a contact, and adds its
    /// motion in `time` \[s\] to the slip.
    #[inline(always)]
    pub(crate) fn run(&self, contact: &mut Contact<T, L>, target: T, time: T) {
        let velocity = contact.relative_velocity(&self.belt);
        for i in 1..L {
            contact.target[i] -= velocity[i] * target;
            contact.gap[i] += velocity[i] * time;
        }
    }

    /// Returns the wrench of tau.
    #[inline(always)]
    pub(crate) fn wrench(torque: Vector<T, A>) -> Velocity<T, L, A> {
        Velocity { linear: Vector::ZERO, angular: torque }
    }

    /// Changes tau so that the relative rotation stops, within the limits for the normal impulses
    /// `pressed` \[N s\]. Applies the change to the bodies.
    #[inline(always)]
    pub fn resist(
        &mut self,
        frame: &ConstraintFrame<T, L>,
        masses: &[InverseMass<T, L, A>; 2],
        pressed: T,
        [a, b]: [&mut Velocity<T, L, A>; 2],
    ) {
        if A == 0 {
            return;
        }
        let mut turning = frame.twist(a, b).angular;
        let [own, other] = [frame.tensor(masses[0].angular), frame.tensor(masses[1].angular)];
        let entry = |i, j| own.entry(i, j) + other.entry(i, j);
        let before = self.torque;
        let one = |wanted: T, most: T| wanted.max(-most).min(most);
        let share = |w: T| w.choose(T::ONE / w, T::ZERO);
        if A == 1 {
            let wanted = before[0] - turning[0] * share(entry(0, 0));
            self.torque[0] = one(wanted, self.rolling * pressed);
        } else {
            let wanted = before[0] - turning[0] * share(entry(0, 0));
            self.torque[0] = one(wanted, self.spinning * pressed);
            let spun = self.torque[0] - before[0];
            // 1 / (largest eigenvalue of the tangential block), so that no direction overshoots.
            let half = T::from_f64(0.5);
            let (p, q, r) = (entry(1, 1), entry(1, 2), entry(2, 2));
            let (mean, half_difference) = ((p + r) * half, (p - r) * half);
            let mass = share(mean + (half_difference * half_difference + q * q).sqrt());
            let mut squared = T::NEG_ZERO;
            for i in 1..A {
                turning[i] += entry(i, 0) * spun;
                self.torque[i] -= turning[i] * mass;
                squared += self.torque[i] * self.torque[i];
            }
            let (length, radius) = (squared.sqrt(), self.rolling * pressed);
            let scale = (length - radius).choose(radius / length, T::ONE);
            for i in 1..A {
                self.torque[i] = self.torque[i] * scale;
            }
        }
        frame.apply(&Self::wrench(self.torque - before), masses, a, b);
    }
}

impl<V: Lanes, const L: usize, const A: usize> SurfaceEffects<V, L, A> {
    /// Stores the effects of one manifold in a lane.
    pub(crate) fn set(&mut self, lane: usize, own: &SurfaceEffects<f32, L, A>) {
        for i in 0..L {
            self.belt.linear[i].set(lane, own.belt.linear[i]);
        }
        for i in 0..A {
            self.belt.angular[i].set(lane, own.belt.angular[i]);
            self.torque[i].set(lane, own.torque[i]);
        }
        self.rolling.set(lane, own.rolling);
        self.spinning.set(lane, own.spinning);
    }

    /// Returns the effects of the manifold in a lane.
    pub(crate) fn get(&self, lane: usize) -> SurfaceEffects<f32, L, A> {
        let mut own = SurfaceEffects::NONE;
        for i in 0..L {
            own.belt.linear[i] = self.belt.linear[i].get(lane);
        }
        for i in 0..A {
            own.belt.angular[i] = self.belt.angular[i].get(lane);
            own.torque[i] = self.torque[i].get(lane);
        }
        own.rolling = self.rolling.get(lane);
        own.spinning = self.spinning.get(lane);
        own
    }
}
