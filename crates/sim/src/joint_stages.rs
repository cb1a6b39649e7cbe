//! The stages of a substep that concern [`Joints`](crate::joints::Joints), on a world.

use drystone_solver::{InverseMass, Velocity};

use crate::bodies::Bodies;
use crate::geometry::Geometry;
use crate::joint::linkage::Taming;
use crate::joint::places::BodyPlaces;
use crate::joint::record::WORLD;
use crate::report::StepReport;
use crate::solving::ConstraintSolver;
use crate::step_scratch::StepScratch;
use crate::world::World;

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Begins a step of `dt` \[s\]: bodies that move wake those that they are joined to.
    pub(crate) fn begin_joints(&mut self, dt: f32) {
        self.wake_along_joints();
        self.solver.joints.begin_step(&self.bodies.inverse_masses, f64::from(dt));
    }

    /// Wakes the bodies that joints connect with bodies that move, directly or through others.
    pub(crate) fn wake_along_joints(&mut self) {
        let mut goes_on = self.sleep.count() > 0;
        while std::mem::take(&mut goes_on) {
            for slot in 0..self.solver.joints.records.len() {
                if !self.solver.joints.slots.is_taken(slot) {
                    continue;
                }
                let bodies = self.solver.joints.records[slot].bodies;
                let members = bodies.into_iter().filter(|body| *body != WORLD);
                let is_active = |body: u32| self.sleep.is_active(&self.bodies, body as usize);
                if members.clone().any(is_active) {
                    members.for_each(|body| goes_on |= self.wake_slot(body as usize));
                }
            }
        }
    }

    /// Finds the joints of awake bodies.
    pub(crate) fn choose_joints(&mut self) {
        let gravity = f64::from(self.gravity.length());
        let joints = &mut self.solver.joints;
        if joints.choose(&self.bodies, gravity) {
            let has_joint = &mut self.bodies.has_joint;
            has_joint.clear();
            has_joint.resize(self.bodies.poses.len(), false);
            joints.pairs().flatten().for_each(|body| has_joint[body as usize] = true);
        }
        if !joints.is_idle() {
            let StepScratch { touched, met, .. } = &mut self.scratch;
            for of_bodies in [&mut *touched, &mut *met] {
                of_bodies.clear();
                of_bodies.resize(self.bodies.poses.len(), false);
            }
            for pair in self.contacts.cache.pairs() {
                let [a, b] = pair.map(|body| body as usize);
                for (body, other) in [(a, b), (b, a)] {
                    touched[body] = self.bodies.is_dynamic(body);
                    met[body] |= touched[body] && !self.bodies.has_joint[other];
                }
            }
            joints.find_touching(|body| [touched[body as usize], met[body as usize]]);
        }
    }

    /// Computes J of the joints at the places of the bodies, for substeps of `h` \[s\].
    pub(crate) fn renew_joints(&mut self, h: f32) {
        if self.solver.joints.is_idle() {
            return;
        }
        for body in 0..self.bodies.has_joint.len() {
            if A == 3 && self.bodies.has_joint[body] {
                let moments = self.bodies.inertia[body].inverse_moments;
                let frame = G::frame(&self.bodies.poses[body]);
                if self.bodies.inverse_masses[body].linear > 0.0 || self.bodies.is_dynamic(body) {
                    self.bodies.inverse_masses[body].angular = frame.tensor(moments);
                }
            }
        }
        let settings = &self.settings;
        let numbers = [h, settings.stretch, settings.max_repair_speed].map(f64::from);
        let displacements = &self.scratch.displacements;
        let at = BodyPlaces { bodies: &self.bodies, displacements };
        self.solver.joints.renew(&at, numbers);
    }

    /// Finds the springs that stand at the start of a substep, and the velocities that they give to bodies.
    pub(crate) fn begin_springs(&mut self) {
        let StepScratch { springs: [springs, _], spring_gains, touched, .. } = &mut self.scratch;
        let masses = &self.bodies.inverse_masses;
        self.solver.joints.find_standing(masses, touched, springs);
        spring_gains.clear();
        for row in springs {
            spring_gains.resize(masses.len(), Velocity::ZERO);
            for (body, pull) in row.pulls() {
                let inverse: InverseMass<f64, L, A> = masses[body].cast();
                spring_gains[body] += inverse.velocity(&pull).cast();
            }
        }
    }

    /// Adds half of the difference between the springs that stand now and those at the start of the
    /// substep, (J'^T s' - J^T s) / 2: the solve gave all of the latter.
    pub(crate) fn end_springs(&mut self) {
        let Bodies { velocities, inverse_masses, .. } = &mut self.bodies;
        let StepScratch { springs, spring_pulls: pulls, prospective, ledger, touched, .. } =
            &mut self.scratch;
        let joints = &self.solver.joints;
        // Those that broke in the solve gave nothing.
        springs[0].retain(|row| !joints.records[row.slot as usize].broken);
        joints.find_standing(inverse_masses, touched, &mut springs[1]);
        if springs.iter().all(|own| own.is_empty()) {
            return;
        }
        pulls.resize(velocities.len(), Velocity::ZERO);
        for (rows, share) in springs.iter_mut().zip([-0.5, 0.5]) {
            for row in rows {
                row.axis.impulse *= share;
                row.pulls().for_each(|(body, pull)| pulls[body] += pull);
            }
        }
        for body in springs.iter().flatten().flat_map(|row| row.bodies) {
            let body = body as usize;
            let pull = std::mem::replace(&mut pulls[body], Velocity::ZERO);
            let inverse: InverseMass<f64, L, A> = inverse_masses[body].cast();
            let gain = inverse.velocity(&pull).cast();
            velocities[body] += gain;
            prospective[body] += gain;
        }
        if self.settings.ledger {
            ledger.record_joints(springs.iter().flatten().cloned());
        }
    }

    /// Adds the joint impulses of the previous substep, and sets the targets of the joints.
    pub(crate) fn warm_start_joints(&mut self, h: f32) {
        if self.solver.joints.is_idle() {
            return;
        }
        self.stiffen_pulled(h);
        let StepScratch { displacements, prospective, .. } = &self.scratch;
        let exact = self.settings.tolerance > 0.0;
        self.solver.joints.warm_start(&mut self.bodies, displacements, prospective, exact);
    }

    /// Gives bodies that hang in pulling joints the inertia with which they follow the pull
    /// ([`tension`](crate::joint::tension)), for the solve of the substep.
    fn stiffen_pulled(&mut self, h: f32) {
        let displacements = &self.scratch.displacements;
        let at = BodyPlaces { bodies: &self.bodies, displacements };
        self.solver.joints.find_surpluses(&at, f64::from(h));
        self.scratch.true_masses.clear();
        let surpluses = std::mem::take(&mut self.solver.joints.surpluses);
        for &(body, surplus) in &surpluses {
            let index = body as usize;
            let mass = self.bodies.mass(index).angular;
            let mut stiffened = mass;
            for (own, more) in stiffened.0.iter_mut().zip(&surplus.0) {
                *own += *more;
            }
            let Some(inverse) = stiffened.inverse() else { continue };
            let masses = &mut self.bodies.inverse_masses[index];
            self.scratch.true_masses.push((body, *masses));
            masses.angular = inverse.cast();
            for velocity in
                [&mut self.bodies.velocities[index], &mut self.scratch.prospective[index]]
            {
                velocity.angular = (inverse * (mass * velocity.angular.cast())).cast();
            }
        }
        self.solver.joints.surpluses = surpluses;
        if !self.scratch.true_masses.is_empty() {
            self.solver.joints.stiffen(&self.bodies.inverse_masses);
            self.follow_masses();
        }
    }

    /// Restores the inertia of the bodies that [`stiffen_pulled`](Self::stiffen_pulled) changed.
    pub(crate) fn unstiffen(&mut self) {
        for (body, masses) in self.scratch.true_masses.drain(..) {
            self.bodies.inverse_masses[body as usize] = masses;
        }
    }

    /// Passes changed masses on to the certificates.
    pub(crate) fn follow_masses(&mut self) {
        self.solver.with_system(&mut self.bodies, |solver, _| {
            solver.certifier.island_solver.follow(&solver.system);
        });
    }

    /// Solves the joints to their targets.
    pub(crate) fn solve_joints(&mut self) {
        self.solver.joints.solve(&mut self.bodies.velocities);
    }

    /// Sets the targets again for the paths that contacts have left. Returns true if that changes
    /// the solution. If the joints are solved `alone`, it has been.
    pub(crate) fn aim_joints_again(&mut self, alone: bool) -> bool {
        self.solver.joints.aim_again(&mut self.bodies, &self.scratch.displacements, alone)
    }

    /// Solves the mechanisms whose targets have been set again.
    pub(crate) fn solve_aiming_joints(&mut self) {
        self.solver.joints.solve_aiming(&mut self.bodies.velocities);
    }

    /// Returns true if locks add energy and got other targets: the substep is to be solved again.
    pub(crate) fn tame_joints(&mut self, taming: Taming) -> bool {
        let Bodies { velocities, inverse_masses, .. } = &self.bodies;
        let prospective = &self.scratch.prospective;
        self.solver.joints.tame(taming, velocities, prospective, inverse_masses)
    }

    /// Breaks the joints that bear more than their strength. Returns true if there were any.
    pub(crate) fn snap_joints(&mut self) -> bool {
        let Bodies { velocities, inverse_masses, .. } = &mut self.bodies;
        self.solver.joints.snap(velocities, inverse_masses)
    }

    /// Stores the joint impulses of the solve. From then on the velocities without contacts include
    /// them.
    pub(crate) fn keep_joint_impulses(&mut self) {
        let joints = &mut self.solver.joints;
        if !joints.is_idle() {
            joints.keep_solved();
            if self.settings.ledger {
                self.scratch.ledger.record_joints(joints.ledger_rows());
            }
            let prospective = &mut self.scratch.prospective;
            joints.mechanisms.apply(prospective, &self.bodies.inverse_masses);
            self.unstiffen();
        }
    }

    /// Solves the joints for the velocities at the end of a substep.
    pub(crate) fn relax_joints(&mut self) {
        if self.solver.joints.is_idle() {
            return;
        }
        self.solve_joints();
        let ConstraintSolver { joints, .. } = &mut self.solver;
        joints.mechanisms.apply(&mut self.scratch.prospective, &self.bodies.inverse_masses);
        if self.settings.ledger {
            self.scratch.ledger.record_joints(joints.ledger_rows());
        }
        joints.keep_relaxed();
    }

    /// Ends a step of `dt` \[s\]: joints break, and the report gets the worst gap.
    pub(crate) fn end_joints(&mut self, dt: f32, report: &mut StepReport) {
        report.broken = self.solver.joints.break_overloaded();
        if !report.broken.is_empty() {
            self.pair_again();
        }
        if !self.solver.joints.is_idle() {
            self.solver.joints.last_step = f64::from(dt);
            report.joint_gap = self.solver.joints.worst(&self.body_places());
        }
    }

    /// Returns the places of the bodies after a step.
    pub(crate) fn body_places(&self) -> BodyPlaces<'_, G, L, A> {
        BodyPlaces { bodies: &self.bodies, displacements: &[] }
    }
}
