//! Between manifolds and the contact system: what the solver is given, and what it gives back.

use drystone_solver::{Contact, InverseMass, Manifold, System, Vector, Velocity, contact_frame};

use crate::bodies::Bodies;
use crate::cache::{Point, Records};
use crate::geometry::Geometry;

/// Fills the manifolds and contacts of `system` from the records of this step, which lasts
/// `dt` \[s\].
pub(crate) fn rows<G: Geometry<L, A>, const L: usize, const A: usize>(
    records: &Records<L>,
    bodies: &Bodies<G, L, A>,
    dt: f32,
    system: &mut System<f32, L, A>,
) {
    system.manifolds.clear();
    system.contacts.clear();
    for record in &records.manifolds {
        let [a, b] = record.bodies.map(|body| &bodies.frames[body as usize]);
        let apart = bodies.apart(record.bodies);
        // A body that carries others round gives them the velocity of where they are at half the
        // step; that of the start would throw them outward.
        let [v_a, v_b] = record.bodies.map(|body| system.velocities[body as usize].linear);
        let [fixed_a, fixed_b] =
            record.bodies.map(|body| system.masses[body as usize] == InverseMass::FIXED);
        let halfway = (v_a - v_b) * (0.5 * dt);
        let ahead_a = if fixed_a { -halfway } else { Vector::ZERO };
        let ahead_b = if fixed_b { halfway } else { Vector::ZERO };
        // Both bodies are pushed at the same point, midway between the surfaces: so the pair
        // keeps its angular momentum.
        let middle = |point: &Point<L>| (a.direction(point.on_a) + b.direction(point.on_b)) * 0.5;
        let points = records.points_of(record);
        let sum = points.iter().fold(Vector::ZERO, |sum, point| sum + middle(point));
        let center = sum * (1.0 / points.len().max(1) as f32);
        let manifold = Manifold {
            bodies: record.bodies,
            frame: contact_frame(record.normal),
            arms: [center - apart * 0.5 + ahead_a, center + apart * 0.5 + ahead_b],
            friction: record.friction,
            restitution: record.restitution,
            compliance: f32::INFINITY,
            first: record.first,
            count: record.count,
        };
        for point in points {
            let mut impulse = manifold.to_frame(point.impulse);
            impulse[0] = impulse[0].max(0.0);
            let mut gap = manifold.to_frame(point.slip);
            gap[0] = point.gap;
            let place = manifold.to_frame(middle(point) - center);
            system.contacts.push(Contact { place, gap, impulse, ..Contact::default() });
        }
        system.manifolds.push(manifold);
    }
}

/// Impulses and slips back into the records.
pub(crate) fn remember<const L: usize, const A: usize>(
    system: &System<f32, L, A>,
    displacements: &[Velocity<f32, L, A>],
    hold: f32,
    records: &mut Records<L>,
) {
    for manifold in &system.manifolds {
        let [a, b] = manifold.bodies.map(|body| &displacements[body as usize]);
        let moved = manifold.twist(a, b);
        let contacts = &system.contacts[manifold.points()];
        for (point, contact) in records.points[manifold.points()].iter_mut().zip(contacts) {
            point.impulse = manifold.to_world(contact.impulse);
            let slip = contact.gap + contact.relative_velocity(&moved);
            let mut slip = contact.held_slip(manifold.friction, hold, slip);
            slip[0] = 0.0;
            point.slip = manifold.to_world(slip);
        }
    }
}
