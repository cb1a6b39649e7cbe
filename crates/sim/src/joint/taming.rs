//! Taming of locks that add energy: where rows are nearly dependent, they need any speed to end on their
//! places.

use drystone_solver::Velocity;
use drystone_solver::mechanism::{MechanismPart, of_batch};

use super::linkage::Linkage;
use super::rows::{Role, RowParams, RowPlan};
use crate::bodies::BodyView;
use crate::geometry::Geometry;

/// Energy that the locks of a mechanism add in a substep, as a part of what it has, beyond which their
/// targets are wrong. \[1\]
const MOST_GAIN: f64 = 0.5;

/// The same where joints gape: there all of it is wrong. \[1\]
const GAPING_GAIN: f64 = 0.02;

/// Energy that soft locks may add at most by their targets, as a part of what the mechanism has; and that
/// beyond which these are taken out. \[1\]
const SOFTENED: f64 = 0.005;
const TAMED: f64 = 1e-4;

/// Gap of a lock, as a part of the size of its mechanism, beyond which locks soften: at smaller ones they
/// can do without curve and repair. \[1\]
const GAPING: f64 = 1e-4;

/// Compliance of a lock over its mobility with which it does next to nothing. \[1\]
const LIMP: f64 = 1e3;

/// Speed that locks may give a mechanism at rest. \[m/s\]
const LEAST_SPEED: f64 = 1.0;

/// Ways in which locks that add energy are [tamed](Linkage::tame).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Taming {
    /// They yield.
    Soften,
    /// They leave out curve and repair.
    Stop,
}

impl<const L: usize, const A: usize> Linkage<L, A> {
    /// Tames the locks if they add energy to bodies that would move at the `prospective` velocities.
    /// Returns true if so.
    ///
    /// Rows of a net in one plane are nearly dependent: its links would need any speed to end on
    /// their places. Targets of zero add no energy, but gaps stay. Locks with compliances eps and targets t
    /// add t^2 / (2 eps) at most, and soft ones leave out what only such a speed could reach. So where
    /// joints gape locks soften first, unless they add energy still.
    pub(crate) fn tame<G: Geometry<L, A>>(
        &self,
        taming: Taming,
        part: &mut MechanismPart<'_, L, A>,
        at: &BodyView<'_, G, L, A>,
        prospective: &[Velocity<f32, L, A>],
    ) -> bool {
        let least = |speed: f64| 0.5 * self.mass * speed * speed;
        // Locks that work less than this harm no mechanism, whatever its energy.
        let before = |body: u32| of_batch(prospective, at.first, body).cast::<f64>();
        let after = |body: u32| at.velocity(body).cast::<f64>();
        let work = self.work(part, |body| before(body) + after(body));
        if work <= least(LEAST_SPEED) {
            return false;
        }
        let (mut energy, mut gain) = (0.0, 0.0);
        for &body in &self.members {
            let own = at.inverse_mass(body).cast::<f64>().mass();
            let [before, after] = [before(body), after(body)].map(|of| 0.5 * own.squared(&of));
            energy += before;
            gain += after - before;
        }
        let repaired = if self.is_apart { 0.0 } else { self.repair_speed(part, at) };
        let speed = repaired.max(LEAST_SPEED);
        let gapes = self.gapes(at);
        let most = match taming {
            Taming::Soften if gapes => GAPING_GAIN * energy + least(speed),
            Taming::Soften => MOST_GAIN * energy + least(speed),
            Taming::Stop => TAMED * energy,
        };
        if work.min(gain) <= most {
            return false;
        }
        let rows = || self.records.iter().flat_map(|record| &record.rows).zip(&self.params);
        let is_lock = |(row, params): (&RowPlan, &RowParams)| {
            row.role.is_rigid_lock() && params.mobility > 0.0
        };
        let locks = part.axes.iter().zip(rows()).filter(|(_, row)| is_lock(*row));
        let wanted = locks.map(|(axis, (_, of))| axis.law.targets[0].powi(2) / of.mobility);
        let softness = (wanted.sum::<f64>() / (2.0 * SOFTENED * energy)).min(LIMP);
        let taming = if gapes { taming } else { Taming::Stop };
        for (axis, (_, params)) in part.axes.iter_mut().zip(rows()).filter(|(_, row)| is_lock(*row))
        {
            let law = &mut axis.law;
            match taming {
                Taming::Soften => law.compliance = law.compliance.max(softness * params.mobility),
                Taming::Stop => law.targets = [0.0; 2],
            }
        }
        true
    }

    /// Returns true if joints make loops and a position misses its lock far.
    fn gapes<G: Geometry<L, A>>(&self, at: &BodyView<'_, G, L, A>) -> bool {
        if !self.has_loops(at) {
            return false;
        }
        let rows = self.records.iter().flat_map(|record| record.rows.iter().zip(&record.states));
        let gaps = rows.map(|(plan, state)| match plan.role {
            Role::Lock(at, None) if !plan.coordinate.is_angle() => (state.value - at).abs(),
            _ => 0.0,
        });
        let [low, high] = self.extent(at);
        gaps.fold(0.0, f64::max) > GAPING * (high - low).length()
    }

    /// Returns the work of the rigid locks in the substep, gamma J (v + v') / 2, where `sum` is v + v'
    /// of a body. \[J\]
    fn work(
        &self,
        part: &MechanismPart<'_, L, A>,
        sum: impl Fn(u32) -> Velocity<f64, L, A>,
    ) -> f64 {
        let (mut work, mut axes) = (0.0, part.axes.iter());
        for (record, joint) in self.records.iter().zip(part.joints) {
            let [a, b] = joint.bodies.map(|body| sum(body) * 0.5);
            for (plan, axis) in record.rows.iter().zip(&mut axes) {
                if plan.role.is_rigid_lock() {
                    work += axis.impulse * axis.velocity(&a, &b);
                }
            }
        }
        work
    }
}
