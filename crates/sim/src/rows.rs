//! Between manifolds and the contact system: what the solver is given, and what it gives back.

use drystone_solver::team::{Team, chunks_with_parts};
use drystone_solver::{Contact, InverseMass, Manifold, System, Vector, Velocity, contact_frame};

use crate::bodies::Bodies;
use crate::cache::{Point, Record, Records};
use crate::geometry::Geometry;

/// Manifolds that a thread takes at once.
const CHUNK: usize = 256;

/// Fills the manifolds and contacts of `system` from the records of this step, which lasts
/// `dt` \[s\].
pub(crate) fn rows<G: Geometry<L, A>, const L: usize, const A: usize>(
    records: &Records<L>,
    bodies: &Bodies<G, L, A>,
    dt: f32,
    team: &Team,
    system: &mut System<f32, L, A>,
) {
    let System { velocities, masses, manifolds, contacts, .. } = system;
    manifolds.resize_with(records.manifolds.len(), Manifold::default);
    contacts.resize_with(records.points.len(), Contact::default);
    let points = |record: &Record<L>| record.count as usize;
    let chunks = chunks_with_parts(&records.manifolds, CHUNK, contacts, points);
    let chunks = chunks.zip(manifolds.chunks_mut(CHUNK));
    let (velocities, masses) = (&velocities[..], &masses[..]);
    team.for_each(records.manifolds.len() > 2 * CHUNK, chunks, |((part, contacts), manifolds)| {
        let mut contacts = contacts.iter_mut();
        for (record, manifold) in part.iter().zip(manifolds) {
            let own = contacts.by_ref().take(record.count as usize);
            *manifold = row(record, records, bodies, dt, (velocities, masses), own);
        }
    });
}

/// The manifold of a record; fills its contacts.
fn row<'a, G: Geometry<L, A>, const L: usize, const A: usize>(
    record: &Record<L>,
    records: &Records<L>,
    bodies: &Bodies<G, L, A>,
    dt: f32,
    (velocities, masses): (&[Velocity<f32, L, A>], &[InverseMass<f32, L, A>]),
    contacts: impl Iterator<Item = &'a mut Contact<f32, L>>,
) -> Manifold<f32, L> {
    let [a, b] = record.bodies.map(|body| &bodies.frames[body as usize]);
    let apart = bodies.apart(record.bodies);
    // A body that carries others round gives them the velocity of where they are at half the
    // step; that of the start would throw them outward.
    let [v_a, v_b] = record.bodies.map(|body| velocities[body as usize].linear);
    let [fixed_a, fixed_b] = record.bodies.map(|body| masses[body as usize] == InverseMass::FIXED);
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
    for (point, contact) in points.iter().zip(contacts) {
        let mut impulse = manifold.to_frame(point.impulse);
        impulse[0] = impulse[0].max(0.0);
        let mut gap = manifold.to_frame(point.slip);
        gap[0] = point.gap;
        let place = manifold.to_frame(middle(point) - center);
        *contact = Contact { place, gap, impulse, ..Contact::default() };
    }
    manifold
}

/// Impulses and slips back into the records.
pub(crate) fn remember<const L: usize, const A: usize>(
    system: &System<f32, L, A>,
    displacements: &[Velocity<f32, L, A>],
    hold: f32,
    team: &Team,
    records: &mut Records<L>,
) {
    let count = |manifold: &Manifold<f32, L>| manifold.count as usize;
    let chunks = chunks_with_parts(&system.manifolds, CHUNK, &mut records.points, count);
    team.for_each(system.manifolds.len() > 2 * CHUNK, chunks, |(manifolds, points)| {
        let mut points = points.iter_mut();
        for manifold in manifolds {
            let [a, b] = manifold.bodies.map(|body| &displacements[body as usize]);
            let moved = manifold.twist(a, b);
            for (contact, point) in system.contacts[manifold.points()].iter().zip(&mut points) {
                point.impulse = manifold.to_world(contact.impulse);
                let slip = contact.gap + contact.relative_velocity(&moved);
                let mut slip = contact.held_slip(manifold.friction, hold, slip);
                slip[0] = 0.0;
                point.slip = manifold.to_world(slip);
            }
        }
    });
}
