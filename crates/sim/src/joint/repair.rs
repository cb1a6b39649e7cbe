//! Repair of joints that are far from their places: it moves bodies, and gives them no velocity.
//!
//! Where a lock misses its place by little, its target repairs it ([`rows`](super::rows)), and relaxing
//! takes the velocity out again, along the J of the new places. Far from there J turns within a substep,
//! and some of the velocity would stay: bodies that were joined 5 cm apart kept 260 rad/s. So such a
//! mechanism is solved for its velocities without repair. Then its bodies move by h w, where w has the least
//! kinetic energy among the velocities that repair,
//!
//! ```text
//! J w = r      r = c (q_0 - q) / h, at most as fast as the speed of repair
//! ```
//!
//! Rows that are nearly dependent ask for any speed. So w is scaled down to the energy of the mechanism at
//! the speed that the worst of its joints asks for.

use drystone_solver::law::Interval;
use drystone_solver::mechanism::MechanismPart;
use drystone_solver::{Axis, Vector};

use super::linkage::{Linkage, REPAIR};
use super::rows::{Role, RowParams};
use crate::bodies::BodyView;
use crate::geometry::Geometry;
use crate::motion::MovingBodies;

/// Largest rotation of a body by the repair of a substep. \[rad\]
const MOST_TURN: f64 = 0.1;

/// Speed below which repair lets bodies sleep. \[m/s\]
const STILL: f64 = 1e-3;

impl<const L: usize, const A: usize> Linkage<L, A> {
    /// Moves the bodies of joints that are far from their places towards these. Returns the energy by which
    /// it lifts them in this `gravity`, if it moves any. \[m/s^2, J\]
    pub(crate) fn repair<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        part: &mut MechanismPart<'_, L, A>,
        gravity: Vector<f32, L>,
    ) -> Option<f64> {
        self.repairs = false;
        if !self.is_apart {
            return None;
        }
        self.kept.clear();
        self.kept.extend(part.axes.iter().map(|axis| (axis.law, axis.impulse)));
        let laws = self.rows().zip(&self.params).map(|((record, plan, state), params)| {
            let law = plan.role.repairing_law(state.value, params);
            if record.broken { Interval { bounds: [0.0; 2], ..law } } else { law }
        });
        for (axis, law) in part.axes.iter_mut().zip(laws) {
            (axis.law, axis.impulse) = (law, 0.0);
        }
        part.stop();
        part.solve();
        self.expected.clear();
        self.expected.extend((0..self.members.len()).map(|index| part.velocity(index)));
        for (axis, (law, impulse)) in part.axes.iter_mut().zip(&self.kept) {
            (axis.law, axis.impulse) = (*law, *impulse);
        }
        let share = self.share_of_repair(part, &bodies.view());
        let (by, mut lifted) = ((share * self.substep) as f32, 0.0);
        for (&body, velocity) in self.members.iter().zip(&self.expected) {
            let mobility = f64::from(bodies.view().inverse_mass(body).linear);
            if mobility > 0.0
                && let Some(index) = bodies.view().index(body)
            {
                bodies.displace(index, *velocity * by);
                let pull = bodies.properties.gravity_on(body as usize, gravity);
                lifted -= f64::from(pull.dot(velocity.linear * by)) / mobility;
                let speed = velocity.linear.length() + velocity.angular.length();
                self.repairs |= share * f64::from(speed) > STILL;
            }
        }
        Some(lifted)
    }

    /// Adds the speed of repair to the targets of its rows.
    pub(crate) fn ask_for_repair(&self, axes: &mut [Axis<f64, L, A>]) {
        let rows = self.rows().zip(&self.params).filter(|_| self.is_apart);
        for (axis, ((_, plan, state), params)) in axes.iter_mut().zip(rows) {
            let [low, high] = plan.role.repairing_law(state.value, params).targets;
            let (up, down) = if low == high { (low, high) } else { (low.max(0.0), high.min(0.0)) };
            axis.law.targets[0] += up;
            axis.law.targets[1] += down;
        }
    }

    /// Returns the part of the expected velocities by which repair moves bodies.
    fn share_of_repair<G: Geometry<L, A>>(
        &self,
        part: &MechanismPart<'_, L, A>,
        at: &BodyView<'_, G, L, A>,
    ) -> f64 {
        let (mut energy, mut fastest) = (0.0, 0.0f64);
        for (&body, velocity) in self.members.iter().zip(&self.expected) {
            let mass = at.inverse_mass(body).cast::<f64>().mass();
            energy += mass.squared(&velocity.cast::<f64>());
            fastest = fastest.max(f64::from(velocity.angular.length()));
        }
        let most = self.mass * self.repair_speed(part, at).powi(2);
        let slower = if energy > most { (most / energy).sqrt() } else { 1.0 };
        let turn = slower * fastest * self.substep;
        if turn > MOST_TURN { slower * MOST_TURN / turn } else { slower }
    }

    /// Returns the greatest speed that the repair of a joint asks for by its rigid locks and limits together.
    /// An angle turns all members about the joint. \[m/s\]
    pub(super) fn repair_speed<G: Geometry<L, A>>(
        &self,
        part: &MechanismPart<'_, L, A>,
        at: &BodyView<'_, G, L, A>,
    ) -> f64 {
        let (mut fastest, mut rows) = (0.0f64, part.axes.iter().zip(&self.params));
        let places = self.sides.iter().zip(&self.arms);
        for ((record, joint), (sides, arms)) in self.records.iter().zip(part.joints).zip(places) {
            let unit = joint.bodies.map(|body| f64::from(at.inverse_mass(body).linear));
            let side = record.first_side();
            let anchor = self.here[sides[side]].position + arms[side];
            let distances = self.here.iter().map(|at| (at.position - anchor).length());
            let farthest = distances.fold(0.0, f64::max);
            let mut squares = [0.0; 2];
            for ((plan, state), (axis, params)) in
                record.rows.iter().zip(&record.states).zip(&mut rows)
            {
                let RowParams { h, mobility, repair: [_, most], .. } = *params;
                let repaired = (REPAIR * plan.role.miss(state.value) / h).min(most);
                if mobility > 0.0 && repaired > 0.0 {
                    let reach = (unit.iter().sum::<f64>() / mobility).sqrt();
                    let more = if axis.is_turn() { farthest } else { 0.0 };
                    squares[usize::from(axis.is_turn())] += (repaired * (reach + more)).powi(2);
                }
            }
            fastest = fastest.max(squares.map(f64::sqrt).iter().sum());
        }
        fastest
    }
}

impl Role {
    /// Returns the law of a row in the repair of a mechanism that stands still.
    fn repairing_law(&self, value: f64, params: &RowParams) -> Interval<f64> {
        let RowParams { h, repair: [_, speed], compliance, .. } = *params;
        let repaired = |gap: f64| (REPAIR * gap / h).max(-speed).min(speed);
        let (targets, bounds) = match self {
            Self::Lock(at, None) => ([repaired(at - value); 2], [-f64::INFINITY, f64::INFINITY]),
            Self::Limit([low, high], None) => {
                let [up, down] = [low - value, high - value];
                let up = if up > 0.0 { repaired(up) } else { up / h };
                let down = if down < 0.0 { repaired(down) } else { down / h };
                ([up, down], [-f64::INFINITY, f64::INFINITY])
            }
            _ => ([0.0; 2], [0.0; 2]),
        };
        Interval { targets, bounds, compliance }
    }
}
