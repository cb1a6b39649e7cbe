//! Locks that add energy: where rows are nearly dependent, they need any speed to end on their places.

use drystone_solver::Velocity;
use drystone_solver::mechanism::{MechanismPart, of_batch};

use super::linkage::Linkage;
use crate::bodies::BodyView;
use crate::geometry::Geometry;

/// Energy that the locks of a mechanism may add in a substep, as a part of what it has. \[1\]
const MOST_GAIN: f64 = 0.02;

/// Height by which they may lift a mechanism at rest, as a part of its size. \[1\]
const MOST_LIFT: f64 = 0.005;

/// The same energy, and the speed that they may give a mechanism at rest, where contacts push joints without loops
/// and a few sweeps must do: joints pass on what these leave. \[1, m/s\]
const PASSED_GAIN: f64 = 0.5;
const PASSED_SPEED: f64 = 1.0;

impl<const L: usize, const A: usize> Linkage<L, A> {
    /// Returns true if the locks add energy to bodies that would move at the `prospective` velocities, more
    /// than a repair may, in an `exact` solve or another.
    ///
    /// Rows of a net in one plane are nearly dependent, as those of a chain pulled straight: its links
    /// would need any speed to end on their places. Their paths bend less in a shorter substep.
    pub(crate) fn adds_energy<G: Geometry<L, A>>(
        &self,
        part: &MechanismPart<'_, L, A>,
        at: &BodyView<'_, G, L, A>,
        prospective: &[Velocity<f32, L, A>],
    ) -> bool {
        let before = |body: u32| of_batch(prospective, at.first, body).cast::<f64>();
        let after = |body: u32| at.velocity(body).cast::<f64>();
        let work = self.work(part, |body| before(body) + after(body));
        let of_speed = |speed: f64| 0.5 * self.mass * speed * speed;
        let (part_of_all, least) = if self.touches && !self.exact && !self.has_loops(at) {
            (PASSED_GAIN, of_speed(PASSED_SPEED))
        } else {
            (MOST_GAIN, MOST_LIFT * self.size / self.compliance)
        };
        if work <= least {
            return false;
        }
        let (mut energy, mut gain) = (0.0, 0.0);
        for &body in &self.members {
            let own = at.inverse_mass(body).cast::<f64>().mass();
            let [before, after] = [before(body), after(body)].map(|of| 0.5 * own.squared(&of));
            energy += before;
            gain += after - before;
        }
        let excess = work.min(gain) - part_of_all * energy;
        excess > least && (self.is_apart || excess > of_speed(self.repair_speed(part, at)))
    }

    /// Lets locks and limits leave out curve and repair: then they only take energy.
    pub(crate) fn stop_locks(&self, part: &mut MechanismPart<'_, L, A>) {
        let rows = self.records.iter().flat_map(|record| &record.rows).zip(&self.params);
        for (axis, (row, params)) in part.axes.iter_mut().zip(rows) {
            if row.role.is_rigid() && params.mobility > 0.0 {
                let [low, high] = axis.law.targets;
                axis.law.targets = [low.min(0.0), high.max(0.0)];
                if row.role.is_rigid_lock() {
                    axis.law.targets = [0.0; 2];
                }
            }
        }
    }

    /// Returns the work of the rigid locks and limits in the substep, gamma J (v + v') / 2, where `sum` is
    /// v + v' of a body. \[J\]
    fn work(
        &self,
        part: &MechanismPart<'_, L, A>,
        sum: impl Fn(u32) -> Velocity<f64, L, A>,
    ) -> f64 {
        let (mut work, mut axes) = (0.0, part.axes.iter());
        for (record, joint) in self.records.iter().zip(part.joints) {
            let [a, b] = joint.bodies.map(|body| sum(body) * 0.5);
            for (plan, axis) in record.rows.iter().zip(&mut axes) {
                if plan.role.is_rigid() {
                    work += axis.impulse * axis.velocity(&a, &b);
                }
            }
        }
        work
    }
}
