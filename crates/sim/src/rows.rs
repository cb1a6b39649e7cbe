//! Between records and the contact system: what the solver is given, and what it gives back.

use drystone_solver::lanes::Lanes;
use drystone_solver::team::{Team, chunks_with_parts};
use drystone_solver::wide::{Rows, Wide, set};
use drystone_solver::{Contact, InverseMass, Manifold, System, Vector, contact_frame};

use crate::bodies::Bodies;
use crate::cache::Records;
use crate::certifier::Stiffness;
use crate::geometry::Geometry;

/// Manifolds that a thread takes at once.
const CHUNK: usize = 256;

/// The records of a step of length `dt` \[s\] as manifolds.
pub(crate) struct RowsOf<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) records: &'a Records<L>,
    pub(crate) bodies: &'a Bodies<G, L, A>,
    /// Velocities and masses.
    pub(crate) system: &'a System<f32, L, A>,
    pub(crate) stiffness: Stiffness<'a>,
    pub(crate) dt: f32,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Rows<L> for RowsOf<'_, G, L, A> {
    fn outlines(&self) -> impl Iterator<Item = ([u32; 2], u32)> {
        self.records.manifolds.iter().map(|record| (record.bodies, record.count))
    }

    /// In world axes, the slip where the target will be.
    fn put<V: Lanes>(
        &self,
        index: usize,
        lane: usize,
        manifold: &mut Manifold<V, L>,
        points: &mut [Contact<V, L>],
    ) {
        let System { velocities, masses, .. } = self.system;
        let record = &self.records.manifolds[index];
        let own = self.records.points_of(record);
        let sum = own.iter().fold(Vector::ZERO, |sum, point| sum + point.middle);
        let center = sum * (1.0 / own.len().max(1) as f32);
        let mut arms = [center - self.bodies.apart(record.bodies), center];
        // A body that carries others round gives them the velocity of where they are at half the
        // step; that of the start would throw them outward.
        let [v_a, v_b] = record.bodies.map(|body| velocities[body as usize].linear);
        for (side, ahead) in [v_b - v_a, v_a - v_b].into_iter().enumerate() {
            if masses[record.bodies[side] as usize] == InverseMass::FIXED {
                arms[side] += ahead * (0.5 * self.dt);
            }
            set(&mut manifold.arms[side], lane, &arms[side]);
        }
        set(&mut manifold.frame[0], lane, &record.normal);
        manifold.friction.set(lane, record.friction);
        manifold.restitution.set(lane, record.restitution);
        manifold.compliance.set(lane, self.stiffness.compliance(record.bodies));
        for (wide, point) in points.iter_mut().zip(own) {
            set(&mut wide.place, lane, &(point.middle - center));
            wide.gap[0].set(lane, point.gap);
            set(&mut wide.target, lane, &point.slip);
            set(&mut wide.impulse, lane, &point.impulse);
        }
    }

    #[inline(always)]
    fn finish<V: Lanes>(manifold: &mut Manifold<V, L>, points: &mut [Contact<V, L>]) {
        manifold.frame = contact_frame(manifold.frame[0]);
        for contact in points {
            contact.place = manifold.to_frame(contact.place);
            let slip = manifold.to_frame(contact.target);
            for i in 1..L {
                contact.gap[i] = slip[i];
            }
            contact.impulse = manifold.to_frame(contact.impulse);
            contact.impulse[0] = contact.impulse[0].max(V::ZERO);
        }
    }
}

/// Impulses and slips back into the records.
pub(crate) fn remember<const L: usize, const A: usize>(
    wide: &Wide<L, A>,
    team: &Team,
    records: &mut Records<L>,
) {
    let Records { manifolds, points } = records;
    let useful = manifolds.len() > 2 * CHUNK;
    let chunks = chunks_with_parts(manifolds, CHUNK, points, |record| record.count as usize);
    team.for_each(useful, chunks.enumerate(), |(chunk, (manifolds, points))| {
        let mut points = points.iter_mut();
        for index in (CHUNK * chunk..).take(manifolds.len()) {
            let mut own = points.by_ref().take(manifolds[index - CHUNK * chunk].count as usize);
            wide.traces(index, |trace| {
                if let Some(point) = own.next() {
                    (point.impulse, point.slip) = (trace.impulse, trace.slip);
                }
            });
        }
    });
}
