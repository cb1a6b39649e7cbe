//! Contacts that a joint holds: points at which two bodies touch, and whose gap the locks of a joint
//! between the same bodies determine.
//!
//! Such are all contacts of welded bodies, and those on the axis of a hinge. The normal row J_c of
//! the contact depends on the rows J of the locks, so no impulse of it changes a velocity that the
//! locks allow. It would only bear against them, with as much force as the compliance of both lets
//! a gap of rounding errors make. So these contacts are opened: they take no impulse.
//!
//! ```text
//! m_c = J_c M^-1 J_c^T - J_c M^-1 J^T (J M^-1 J^T)^-1 J M^-1 J_c^T  <  HELD J_c M^-1 J_c^T
//! ```

use drystone_solver::lanes::{FAR, Reuse};
use drystone_solver::{InverseMass, Vector, Velocity};

use crate::cache::{self, CachedManifold, Pair, deepest_first};
use crate::geometry::Geometry;
use crate::joint::coordinates::{Vec3, cross};
use crate::joint::places::flattened;
use crate::joint::record::WORLD;
use crate::world::World;

/// A contact is held if the locks leave less than this fraction of its mobility: it is nearer to the
/// axis of a hinge than about a hundredth of its distance from the centers of mass. \[1\]
const HELD: f64 = 1e-4;

/// A lock of which other locks leave less than this fraction is one of them. \[1\]
const DEPENDENT: f64 = 1e-9;

/// Rows of J of two bodies.
type Rows<const L: usize, const A: usize> = [Velocity<f64, L, A>; 2];

/// Largest number of independent rows: two bodies have twelve velocities.
const MOST_ROWS: usize = 12;

/// The velocities that the locks of joints between two bodies stop, as rows orthonormal by M^-1.
struct LockedRows<const L: usize, const A: usize> {
    masses: [InverseMass<f64, L, A>; 2],
    rows: [Rows<L, A>; MOST_ROWS],
    count: usize,
}

impl<const L: usize, const A: usize> LockedRows<L, A> {
    /// Returns p M^-1 q^T.
    fn product(&self, p: &Rows<L, A>, q: &Rows<L, A>) -> f64 {
        (0..2).map(|side| p[side].dot(&self.masses[side].velocity(&q[side]))).sum()
    }

    /// Returns the part of a row that the locks leave, with the fraction of its mobility.
    fn rest(&self, row: &Rows<L, A>) -> (Rows<L, A>, f64) {
        let (mut rest, whole) = (*row, self.product(row, row));
        for own in &self.rows[..self.count] {
            let part = self.product(&rest, own);
            rest = [0, 1].map(|side| rest[side] - own[side] * part);
        }
        let left = self.product(&rest, &rest);
        (rest, if whole > 0.0 { left / whole } else { 0.0 })
    }

    /// Adds a lock, unless it depends on the others.
    fn add(&mut self, row: &Rows<L, A>) {
        let (rest, fraction) = self.rest(row);
        if fraction > DEPENDENT && self.count < MOST_ROWS {
            let scale = 1.0 / self.product(&rest, &rest).sqrt();
            self.rows[self.count] = rest.map(|own| own * scale);
            self.count += 1;
        }
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Opens the contacts that joints hold, in manifolds that have changed.
    pub(crate) fn open_held_contacts(&mut self) {
        if !self.solver.joints.has_locked() {
            return;
        }
        for index in 0..self.contacts.pairs.len() {
            let pair = self.contacts.pairs[index];
            if pair.count == 0 || pair.is_sleeping {
                continue;
            }
            let is_kept = |of: &Reuse| matches!(of, Reuse::Kept(_));
            if self.contacts.cache.reuse[pair.manifolds()].iter().all(is_kept) {
                continue;
            }
            let Some(locked) = self.locked_rows(&pair) else { continue };
            for manifold in pair.manifolds() {
                self.open_held_points(manifold, &locked);
            }
        }
    }

    /// Returns the rows of the locks between the bodies of a pair, or `None` if there are none.
    fn locked_rows(&self, pair: &Pair) -> Option<LockedRows<L, A>> {
        let (bodies, joints) = (&self.bodies, &self.solver.joints);
        let of = |body: u32| if bodies.is_static(body) { WORLD } else { body };
        let all = joints.locked_between(pair.bodies.map(of));
        if all.is_empty() {
            return None;
        }
        let masses = pair.bodies.map(|body| bodies.inverse_masses[body as usize].cast());
        let rows = [[Velocity::ZERO; 2]; MOST_ROWS];
        let (mut locked, at) = (LockedRows { masses, rows, count: 0 }, self.body_places());
        for &(_, slot) in all {
            let record = &joints.records[slot as usize];
            let places = record.places(|body| at.of(body));
            for plan in record.rows.iter().filter(|row| row.role.is_rigid_lock()) {
                let found = places.evaluate(&plan.coordinate, &places.axes());
                let mut row = [Velocity::ZERO; 2];
                for (side, own) in found.rows.iter().enumerate() {
                    if let Some(to) = pair.bodies.iter().position(|&of| of == record.bodies[side]) {
                        row[to] = flattened(own);
                    }
                }
                locked.add(&row);
            }
        }
        Some(locked)
    }

    /// Opens the points of a manifold whose gaps the locks determine.
    fn open_held_points(&mut self, manifold: usize, locked: &LockedRows<L, A>) {
        let cache = &mut self.contacts.cache;
        let of: CachedManifold<L> = cache.manifolds[manifold];
        let mut opened = false;
        for point in of.points() {
            let row = normal_row(&of, cache.points[point].push_point);
            if cache.impulses[point].gap[0] < FAR && locked.rest(&row).1 < HELD {
                cache.impulses[point] = cache::open(FAR);
                opened = true;
            }
        }
        if opened {
            cache.reuse[manifold] = cache.reuse[manifold].changed();
            deepest_first(&mut cache.points[of.points()], &mut cache.impulses[of.points()]);
        }
    }
}

/// Returns the normal row of J of a point of a manifold, given from the center of mass of b.
fn normal_row<const L: usize, const A: usize>(
    manifold: &CachedManifold<L>,
    point: Vector<f32, L>,
) -> Rows<L, A> {
    let normal = spatial(manifold.normal);
    let row = |arm: Vector<f32, L>| {
        flattened(&Velocity { linear: normal, angular: cross(spatial(arm), normal) })
    };
    [row(point - manifold.center_offset), row(point) * -1.0]
}

fn spatial<const L: usize>(vector: Vector<f32, L>) -> Vec3 {
    let mut out = Vec3::ZERO;
    (0..L).for_each(|i| out[i] = f64::from(vector[i]));
    out
}
