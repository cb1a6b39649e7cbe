//! Search for joints whose locks and limits no velocities can meet, as those of bars in a loop that
//! cannot close.
//!
//! It takes place right after the solve of a substep: the relaxing gives the rows other targets.

use drystone_solver::System;
use drystone_solver::jam;

use crate::certifier::MISSED;
use crate::geometry::Geometry;
use crate::joint::rows::Role;
use crate::report::StepReport;
use crate::world::World;

/// Returns true for rows that must reach their targets: those that are neither springs nor motors.
fn is_rigid(role: &Role) -> bool {
    matches!(role, Role::Lock(_, None) | Role::Limit(_, None))
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Looks for jams if a joint misses its targets. Returns false if none does.
    pub(crate) fn find_joint_jams(&mut self, report: &mut StepReport) -> bool {
        if self.joints_miss() <= MISSED && !self.solver.joints.are_apart() {
            return false;
        }
        let mut contacts = self.bodies.without_contacts();
        self.solver.lanes.unpack(&mut contacts);
        let mut system: System<f64, L, A> = contacts.cast();
        let joints = &self.solver.joints;
        system.joints.clone_from(&joints.mechanisms.joints);
        system.axes.clone_from(&joints.mechanisms.axes);
        joints.ask_for_repair(&mut system.axes);
        for (&slot, joint) in joints.acting().iter().zip(&joints.mechanisms.joints) {
            let rows = &joints.records[slot as usize].rows;
            for (axis, row) in system.axes[joint.axes()].iter_mut().zip(rows) {
                if !is_rigid(&row.role) {
                    axis.law.bounds = [0.0; 2];
                }
            }
        }
        let mut jams = self.solver.certifier.joint_jams(&system);
        let acting = self.solver.joints.acting();
        for joint in jams.iter_mut().flat_map(|jam| &mut jam.joints) {
            *joint = acting[*joint as usize];
        }
        report.jams = jams;
        true
    }

    /// Returns the largest velocity by which a lock or a limit misses its target. \[m/s, rad/s\]
    fn joints_miss(&self) -> f64 {
        let joints = &self.solver.joints;
        let mut worst = 0.0f64;
        for (&slot, joint) in joints.acting().iter().zip(&joints.mechanisms.joints) {
            let [a, b] = joint.bodies.map(|body| self.bodies.velocities[body as usize].cast());
            let axes = joints.mechanisms.axes[joint.axes()].iter();
            for (axis, row) in axes.zip(&joints.records[slot as usize].rows) {
                if is_rigid(&row.role) && axis.effective_mass > 0.0 {
                    worst = worst.max(jam::missing_along(&axis.law, axis.velocity(&a, &b)).abs());
                }
            }
        }
        worst
    }
}
