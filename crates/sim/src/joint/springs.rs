//! Springs that stand: what they give to bodies at the start of a substep and at its end
//! ([`rows`](super::rows)).

use drystone_solver::mechanism::MechanismPart;
use drystone_solver::{InverseMass, Velocity};

use super::linkage::Linkage;
use super::rows::{Role, RowParams, RowState};
use crate::bodies::BodyView;
use crate::geometry::Geometry;
use crate::ledger::JointRow;
use crate::motion::MovingBodies;

/// Largest rotation of a body by half of what a spring that stands gives it in a substep. \[rad\]
const MOST_TURNED: f64 = 0.01;

/// Largest acceleration by such a spring of a body that touches others. \[m/s^2\]
const MOST_PUSHED: f64 = 400.0;

impl<const L: usize, const A: usize> Linkage<L, A> {
    /// Finds the springs that stand at the start of a substep, and adds the velocities that they give to
    /// bodies.
    pub(crate) fn begin_springs<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        part: &MechanismPart<'_, L, A>,
    ) {
        // Where joints and contacts bear them in an exact solve, what is left of them is bounded.
        self.bounded = !(self.exact && self.touches);
        // These give nothing at the end of a substep.
        self.find_rows(0, Role::constant, &bodies.view(), part);
        self.displace_by_rows(bodies);
        self.find_standing(0, &bodies.view(), part);
        self.displace_by_rows(bodies);
    }

    /// Adds what the rows that act at the start of a substep give to bodies.
    fn displace_by_rows<G: Geometry<L, A>>(&self, bodies: &mut MovingBodies<'_, G, L, A>) {
        for (_, row) in &self.springs[0] {
            for (body, pull) in row.pulls() {
                let Some(index) = bodies.view().index(body) else { continue };
                let inverse: InverseMass<f64, L, A> = bodies.masses[index].cast();
                bodies.standing_gains[index] += inverse.velocity(&pull).cast();
            }
        }
    }

    /// Adds half of the difference between the springs that stand now and those at the start of the
    /// substep, (J'^T s' - J^T s) / 2: the solve gave all of the latter.
    pub(crate) fn end_springs<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        part: &MechanismPart<'_, L, A>,
    ) {
        // Those that broke in the solve gave nothing.
        let records = &self.records;
        self.springs[0].retain(|(joint, _)| !records[*joint].broken);
        self.find_standing(1, &bodies.view(), part);
        if self.springs.iter().all(|own| own.is_empty()) {
            return;
        }
        let Self { springs, wrenches, sides, members, .. } = self;
        for (rows, share) in springs.iter_mut().zip([-0.5, 0.5]) {
            for (joint, row) in rows {
                row.axis.impulse *= share;
                for (side, (_, pull)) in sides[*joint].into_iter().zip(row.pulls()) {
                    wrenches[side] += pull;
                }
            }
        }
        for (&body, wrench) in members.iter().zip(wrenches) {
            let pull = std::mem::replace(wrench, Velocity::ZERO);
            let Some(index) = bodies.view().index(body).filter(|_| pull != Velocity::ZERO) else {
                continue;
            };
            let inverse: InverseMass<f64, L, A> = bodies.masses[index].cast();
            let gain = inverse.velocity(&pull).cast();
            bodies.velocities[index] += gain;
            bodies.prospective[index] += gain;
        }
    }

    /// Finds the springs that stand, with their impulses where the bodies are: at the start of a substep,
    /// 0, or at its end, 1.
    fn find_standing<G: Geometry<L, A>>(
        &mut self,
        when: usize,
        at: &BodyView<'_, G, L, A>,
        part: &MechanismPart<'_, L, A>,
    ) {
        let standing = |role: &Role, state: &RowState, params: &RowParams| {
            if role.is_spring() { role.standing(state.value, state.solved, params) } else { 0.0 }
        };
        self.find_rows(when, standing, at, part);
    }

    /// Finds rows with impulses other than zero.
    ///
    /// If `bounded`, one that turns a body is counted up to [`MOST_TURNED`], one that pushes a body which
    /// others touch up to [`MOST_PUSHED`].
    fn find_rows<G: Geometry<L, A>>(
        &mut self,
        when: usize,
        impulse_of: impl Fn(&Role, &RowState, &RowParams) -> f64,
        at: &BodyView<'_, G, L, A>,
        part: &MechanismPart<'_, L, A>,
    ) {
        let Self { springs, records, params, sides, touched, bounded, .. } = self;
        let found = &mut springs[when];
        found.clear();
        let mut rows = params.iter().zip(&*part.axes);
        for (index, (record, joint)) in records.iter().zip(part.joints).enumerate() {
            let own = record.rows.iter().zip(&record.states).zip(&mut rows);
            for ((plan, state), (params, axis)) in own {
                let impulse = impulse_of(&plan.role, state, params);
                if record.broken || impulse == 0.0 {
                    continue;
                }
                // Parts of the largest gains that count, per impulse.
                let parts = sides[index].into_iter().zip(joint.bodies).zip(&axis.jacobian);
                let parts = parts.map(|((side, body), jacobian)| {
                    let inverse: InverseMass<f64, L, A> = at.inverse_mass(body).cast();
                    let gain = inverse.velocity(jacobian);
                    let pushed = if touched[side] { gain.linear.length() } else { 0.0 };
                    let turned = 0.5 * params.h * gain.angular.length() / MOST_TURNED;
                    turned.max(pushed / (params.h * MOST_PUSHED))
                });
                let part = parts.fold(0.0, f64::max) * impulse.abs();
                let mut axis = *axis;
                axis.impulse = impulse * if *bounded && part > 1.0 { 1.0 / part } else { 1.0 };
                let is_drive = matches!(plan.role, Role::Drive(_));
                let row = JointRow { bodies: joint.bodies, axis, is_drive };
                found.push((index, row));
            }
        }
    }
}
