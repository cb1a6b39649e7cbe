//! Balance of joints and contacts in a few sweeps.
//!
//! Contacts see free bodies. A light body between a heavy load and the floor, or a finger that an arm
//! presses on a box, yields to them; then its joints drive it on. The velocity that these give to a body
//! after its contacts, as a mean over [`MEMORY`], is how fast it sinks into what it touches. Blows count
//! little, since [`JOLT`] bounds each value. A mechanism of which a body sinks faster than
//! [`MOST_SINKING`] is solved to a tolerance, together with its contacts, as all are in a bake. It is for
//! [`HOLD`], and as long as it stands. So is one that stands on something when its first step begins: it
//! starts with the forces that hold it. And one that a kinematic body leads, such as a hand: friction must
//! follow it.
//!
//! Contacts between joined bodies may bear against the joints. So a body that touches nothing else does not
//! sink, and a mechanism that folds, with such contacts, is solved so from its first step on.

use drystone_solver::{Real, Velocity};

/// Time over which velocities are averaged. \[s\]
const MEMORY: f32 = 0.2;

/// Largest velocity that counts in a substep, and largest mean velocity at which bodies do not sink. \[m/s\]
const JOLT: f32 = 0.05;
const MOST_SINKING: f32 = 0.01;

/// Speed of its fastest body up to which a mechanism stands. \[m/s\]
pub(crate) const MOVING: f32 = 0.1;

/// Time in motion for which a mechanism is solved to a tolerance after it has sunk, and after its first step.
/// \[s\]
const HOLD: f32 = 5.0;
const HOLD_FIRST: f32 = 1.0;

/// How the contacts and joints of a body balance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Balance<const L: usize, const A: usize> {
    /// Mean velocity that joints give to the body after its contacts. \[m/s, rad/s\]
    pub(crate) sinking: Velocity<f32, L, A>,
    /// Time since its mechanism sank, without that in which it stood; negative before the first step with
    /// joints. \[s\]
    pub(crate) since: f32,
}

impl<const L: usize, const A: usize> Balance<L, A> {
    /// That of a body before its first step with joints.
    pub(crate) const NEW: Self = Self { sinking: Velocity::ZERO, since: -1.0 };

    /// That of a body of a mechanism that touches nothing.
    pub(crate) const FREE: Self = Self { sinking: Velocity::ZERO, since: f32::MAX };

    /// Returns true if the mechanism of the body is to be solved to a tolerance.
    pub(crate) fn sinks(&self) -> bool {
        (0.0..HOLD).contains(&self.since)
    }

    /// Begins the balance of a body whose mechanism touches something. If it `stands` on that, it is solved to
    /// a tolerance at first; if it `folds`, until it has moved.
    pub(crate) fn begin(&mut self, stands: bool, folds: bool) {
        if self.since < 0.0 {
            self.since = match (stands, folds) {
                (true, true) => 0.0,
                (true, false) => HOLD - HOLD_FIRST,
                (false, _) => f32::MAX,
            };
        }
    }

    /// Lets a substep of `h` \[s\] pass, in which the mechanism `moves`. One that has sunk does not sink again
    /// while it stands.
    pub(crate) fn pass(&mut self, moves: bool, h: f32) {
        self.sinking = self.sinking * (1.0 - part(h));
        if moves || !(0.0..HOLD - HOLD_FIRST).contains(&self.since) {
            self.since += h;
        }
    }

    /// Notes what joints have given to the body in a substep of `h` \[s\]. Its surface is at `reach` \[m\].
    /// Returns true if it sinks.
    pub(crate) fn note(&mut self, change: &Velocity<f32, L, A>, reach: f32, h: f32) -> bool {
        let counts = (JOLT / speed(change, reach)).min(1.0);
        self.sinking += *change * (counts * part(h));
        speed(&self.sinking, reach) > MOST_SINKING
    }
}

/// Returns the part that a substep of `h` \[s\] has of a mean. \[1\]
fn part(h: f32) -> f32 {
    (h / MEMORY).min(1.0)
}

/// Returns a speed that the surface of a body reaches at this velocity, with its mean radius `reach`
/// \[m\]. \[m/s\]
pub(crate) fn speed<T: Real, const L: usize, const A: usize>(
    of: &Velocity<T, L, A>,
    reach: T,
) -> T {
    (of.linear.dot(of.linear) + of.angular.dot(of.angular) * reach * reach).sqrt()
}
