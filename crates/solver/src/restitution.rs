//! Bouncing: target velocities from the pre-step velocity, and collisions one manifold at a time.

use crate::{Real, Scalar, System, Velocity};

/// t_i = max(t_i, -c_r v_i^-) where a contact approached faster than `threshold` \[m/s\] before the
/// step: the notes' restitution hypothesis, combined with overlap repair by maximum.
///
/// `before` are the velocities before the step's forces, not the prospective ones: otherwise
/// every resting contact would bounce off gravity. An open contact bounces only if that approach
/// closes it within the step (its t_i is -gap / h), else it keeps its target.
pub fn set_targets<T: Real, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    before: &[Velocity<T, L, A>],
    threshold: T,
) {
    for manifold in &system.manifolds {
        let [a, b] = manifold.bodies.map(|body| &before[body as usize]);
        for contact in &mut system.contacts[manifold.points()] {
            let approach = -contact.normal_velocity(manifold, a, b);
            let repair = contact.target[0];
            let bounce = repair.max(manifold.restitution * approach);
            contact.target[0] = (approach - threshold.max(-repair)).choose(bounce, repair);
        }
    }
}

/// Sweeps over the points of one manifold within a collision.
const MANIFOLD_SWEEPS: usize = 10;

/// The most points of a manifold that collide at once.
const MAX_POINTS: usize = 4;

/// Resolves collisions manifold by manifold until none that closes in this step approaches faster
/// than `threshold` \[m/s\], or `rounds` have passed. Returns the number of collisions.
///
/// Within a manifold the points collide together (equation (2) with gamma >= 0); between manifolds
/// one after the other, each from the velocities that the last one left, as the notes' isolated
/// collisions (1). So a blow passes through a row of touching balls. Kinetic energy never grows:
/// a collision changes it by 1/2 gamma . (u- + u+), and gamma is scaled down where that is positive.
///
/// Contacts that do not bounce are left to the sweeps. The impulses go into
/// [`Contact::impact`](crate::Contact::impact).
///
/// A blow comes at a time tau within the step of length `dt` \[s\], which then moves the bodies all
/// of `dt` with the velocity after it; `displacements` are put back by tau times the change of
/// velocity. tau = (1 - c_r) gap / approach + c_r dt / 2: the time of contact for c_r = 0, half
/// the step for c_r = 1. For a ball that falls by steps v' = v - g dt, x' = x + v' dt, which keep
/// v^2 / 2 + g x - g v dt / 2, that is the one tau by which each bounce takes this energy to
/// c_r^2 of itself.
pub fn collide<T: Scalar, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    displacements: &mut [Velocity<T, L, A>],
    dt: T,
    threshold: T,
    rounds: usize,
) -> usize {
    let mut collisions = 0;
    for _ in 0..rounds {
        let before = collisions;
        for index in 0..system.manifolds.len() {
            if system.manifolds[index].restitution > T::ZERO {
                let blow = collide_manifold(system, index, dt, threshold);
                if let Some(Blow { bodies, lost }) = blow {
                    for (body, lost) in bodies.into_iter().zip(lost) {
                        displacements[body as usize] += lost;
                    }
                    collisions += 1;
                }
            }
        }
        if collisions == before {
            break;
        }
    }
    collisions
}

/// A collision that took place.
struct Blow<T: Real, const L: usize, const A: usize> {
    bodies: [u32; 2],
    /// What the bodies have moved by before it, less what the velocities after it make of that time.
    lost: [Velocity<T, L, A>; 2],
}

fn collide_manifold<T: Scalar, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    index: usize,
    dt: T,
    threshold: T,
) -> Option<Blow<T, L, A>> {
    let manifold = system.manifolds[index];
    let masses = system.masses_of(&manifold);
    let before = system.velocities_of(&manifold);
    let points = &mut system.contacts[manifold.points()];
    let count = points.len().min(MAX_POINTS);
    let mut u_before = [T::ZERO; MAX_POINTS];
    let mut target = [T::ZERO; MAX_POINTS];
    // gap / approach of the point that closes first, in steps.
    let mut contact_time = T::ONE;
    let mut closing = false;
    for i in 0..count {
        let u = points[i].normal_velocity(&manifold, &before[0], &before[1]);
        let open = points[i].target[0].min(T::ZERO);
        u_before[i] = u;
        target[i] = open;
        if u < open && u < -threshold {
            target[i] = -manifold.restitution * u;
            contact_time = contact_time.min(open / u);
            closing = true;
        }
    }
    if !closing {
        return None;
    }
    let [mut a, mut b] = before;
    let mut gamma = [T::ZERO; MAX_POINTS];
    for _ in 0..MANIFOLD_SWEEPS {
        for i in 0..count {
            let u = points[i].normal_velocity(&manifold, &a, &b);
            let next = (gamma[i] + points[i].effective_mass * (target[i] - u)).max(T::ZERO);
            points[i].apply(manifold.normal() * (next - gamma[i]), &masses, &mut a, &mut b);
            gamma[i] = next;
        }
    }
    // Delta T = s gamma . u- + s^2/2 gamma^T A gamma <= 0  <=>  s <= -2 gamma . u- / gamma^T A gamma.
    let (mut work, mut quadratic) = (T::ZERO, T::ZERO);
    for i in 0..count {
        let u = points[i].normal_velocity(&manifold, &a, &b);
        work += gamma[i] * u_before[i];
        quadratic += gamma[i] * (u - u_before[i]);
    }
    let limit = quadratic.choose(T::from_f64(-2.0) * work / quadratic, T::ONE);
    let scale = T::ONE.min(limit.max(T::ZERO));
    [a, b] = before;
    for i in 0..count {
        points[i].impact += gamma[i] * scale;
        points[i].apply(manifold.normal() * (gamma[i] * scale), &masses, &mut a, &mut b);
    }
    system.velocities[manifold.bodies[0] as usize] = a;
    system.velocities[manifold.bodies[1] as usize] = b;
    let half = T::from_f64(0.5);
    let bounce = manifold.restitution;
    let tau = ((T::ONE - bounce) * contact_time + bounce * half) * dt;
    let lost = [(before[0] - a) * tau, (before[1] - b) * tau];
    Some(Blow { bodies: manifold.bodies, lost })
}
