//! The quantities v, t, gamma, epsilon and b of the bodies and contacts of a system, as columns.

use super::matrices::{Column, jacobian};
use crate::{Contact, Scalar, System};

/// Returns v: (v, omega) of every body, in order. \[m/s, rad/s\]
pub fn velocities<T: Scalar, const L: usize, const A: usize>(system: &System<T, L, A>) -> Column {
    let width = L + A;
    Column::from_fn(width * system.velocities.len(), |row| {
        let (velocity, i) = (&system.velocities[row / width], row % width);
        if i < L { velocity.linear[i].to_f64() } else { velocity.angular[i - L].to_f64() }
    })
}

fn of_contacts<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    value: impl Fn(&Contact<T, L>) -> T,
) -> Column {
    Column::from_fn(system.contacts.len(), |i| value(&system.contacts[i]).to_f64())
}

/// Returns t: the normal velocity that each contact should have after the step. \[m/s\]
pub fn targets<T: Scalar, const L: usize, const A: usize>(system: &System<T, L, A>) -> Column {
    of_contacts(system, |contact| contact.target[0])
}

/// Returns gamma: the accumulated normal impulses. \[N s\]
pub fn impulses<T: Scalar, const L: usize, const A: usize>(system: &System<T, L, A>) -> Column {
    of_contacts(system, |contact| contact.impulse[0])
}

/// Returns the accumulated impulses along the frame of each contact, normal first. The transpose of
/// [`friction_jacobian`](super::friction_jacobian) maps them to the bodies. \[N s\]
pub fn friction_impulses<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
) -> Column {
    Column::from_fn(L * system.contacts.len(), |row| {
        system.contacts[row / L].impulse[row % L].to_f64()
    })
}

/// Returns epsilon: the diagonal of E. \[1/kg\]
pub fn compliance<T: Scalar, const L: usize, const A: usize>(system: &System<T, L, A>) -> Column {
    of_contacts(system, |contact| contact.compliance)
}

/// Returns b = t - J v for the current velocities. \[m/s\]
///
/// This is the b of the problem while the velocities are the prospective ones, before any impulse
/// has been applied to them. With t = -c_r J v it is the notes' -(1 + c_r) J v.
pub fn rhs<T: Scalar, const L: usize, const A: usize>(system: &System<T, L, A>) -> Column {
    targets(system) - jacobian(system) * velocities(system)
}
