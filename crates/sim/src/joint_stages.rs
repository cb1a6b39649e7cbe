//! The stages of a substep that concern [`Joints`](crate::joints::Joints), on a world.

use drystone_solver::InverseMass;

use crate::balance::{Balance, MOVING, speed};
use crate::bodies::BodyView;
use crate::geometry::Geometry;
use crate::joint::record::WORLD;
use crate::report::StepReport;
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

    /// Finds the joints of awake bodies. Returns true if there are others than before.
    pub(crate) fn choose_joints(&mut self) -> bool {
        let gravity = f64::from(self.gravity.length());
        let joints = &mut self.solver.joints;
        let rejoined = joints.choose(&self.bodies, gravity);
        if rejoined {
            let has_joint = &mut self.bodies.has_joint;
            has_joint.clear();
            has_joint.resize(self.bodies.poses.len(), false);
            joints.pairs().flatten().for_each(|body| has_joint[body as usize] = true);
        }
        if !joints.is_idle() {
            let touched = &mut self.scratch.touched;
            touched.clear();
            touched.resize(self.bodies.poses.len(), [false; 2]);
            for pair in self.contacts.cache.pairs() {
                let loads = !joints.joins_colliding(pair);
                for body in pair {
                    let [is_touched, is_loaded] = &mut touched[body as usize];
                    *is_touched = self.bodies.is_dynamic(body as usize);
                    *is_loaded |= *is_touched && loads;
                }
            }
            joints.find_touching(|body| touched[body as usize]);
            self.find_exact();
        }
        rejoined
    }

    /// Finds the mechanisms that are solved to a tolerance.
    pub(crate) fn find_exact(&mut self) {
        let all = self.settings.tolerance > 0.0;
        if !all {
            self.begin_balances();
        }
        let bodies = &mut self.bodies;
        bodies.is_exact.clear();
        bodies.is_exact.resize(bodies.poses.len(), false);
        for linkage in &mut self.solver.joints.linkages {
            linkage.moves = linkage.members.iter().any(|&body| {
                let own = body as usize;
                let is_fast = || speed(&bodies.velocities[own], bodies.reach[own].core) > MOVING;
                bodies.is_dynamic(own) && is_fast()
            });
            let is_due = |&body: &u32| match bodies.is_dynamic(body as usize) {
                true => bodies.balances[body as usize].sinks(),
                false => !bodies.is_static(body),
            };
            linkage.exact = all || linkage.touches && linkage.members.iter().any(is_due);
            if linkage.exact {
                for &body in &linkage.members {
                    bodies.is_exact[body as usize] = bodies.has_joint[body as usize];
                }
            }
        }
    }

    /// Begins the balances of bodies with new joints, and ends those of mechanisms that touch nothing.
    fn begin_balances(&mut self) {
        let (linkages, balances) = (&self.solver.joints.linkages, &mut self.bodies.balances);
        let masses = &self.bodies.inverse_masses;
        let moves = |body: &&u32| masses[**body as usize] != InverseMass::FIXED;
        let mut members = linkages.iter().flat_map(|of| &of.members).filter(moves);
        let mut stands = Vec::new();
        if members.any(|&body| balances[body as usize] == Balance::NEW) {
            let mut of_body = vec![usize::MAX; masses.len()];
            for (index, linkage) in linkages.iter().enumerate() {
                let own = linkage.members.iter().filter(moves);
                own.for_each(|&body| of_body[body as usize] = index);
            }
            stands.resize(linkages.len(), false);
            let joints = &self.solver.joints;
            let pairs = self.contacts.cache.pairs().filter(|pair| !joints.joins_colliding(*pair));
            let pairs = pairs.map(|pair| pair.map(|body| of_body[body as usize]));
            for of in pairs.filter(|[a, b]| a != b).flatten() {
                stands.get_mut(of).into_iter().for_each(|stands| *stands = true);
            }
        }
        for (index, linkage) in linkages.iter().enumerate() {
            let folds = linkage.records.iter().any(|record| record.collide);
            for &body in linkage.members.iter().filter(moves) {
                let own = &mut balances[body as usize];
                if linkage.touches {
                    own.begin(stands.get(index) == Some(&true), folds);
                } else {
                    *own = Balance::FREE;
                }
            }
        }
    }

    /// Finds the bodies whose M^-1 has changed since the rows of their contacts were read. That of bodies with
    /// joints turns with them in each substep, also while they keep their manifolds.
    pub(crate) fn find_renewed(&mut self) {
        let StepScratch { read_masses, renewed, .. } = &mut self.scratch;
        renewed.clear();
        if self.solver.joints.exist() {
            let now = &self.bodies.inverse_masses;
            let is_other = |(body, mass)| read_masses.get(body) != Some(mass);
            renewed.extend(now.iter().enumerate().map(is_other));
            read_masses.clone_from(now);
        }
    }

    /// Keeps what a part changes of the bodies.
    pub(crate) fn keep_part(&mut self) {
        let (kept, bodies) = (&mut self.scratch.part, &self.bodies);
        kept.poses.clone_from(&bodies.poses);
        kept.velocities.clone_from(&bodies.velocities);
        kept.contact_gains.clone_from(&bodies.contact_gains);
        kept.balances.clone_from(&bodies.balances);
        kept.inverse_masses.clone_from(&bodies.inverse_masses);
        kept.spin_states.clone_from(&bodies.spin_states);
    }

    /// Takes a part back whose contacts have not been written to the cache. Its rows are to be built again.
    pub(crate) fn take_part_back(&mut self) {
        let (kept, bodies) = (&mut self.scratch.part, &mut self.bodies);
        std::mem::swap(&mut kept.poses, &mut bodies.poses);
        std::mem::swap(&mut kept.velocities, &mut bodies.velocities);
        std::mem::swap(&mut kept.contact_gains, &mut bodies.contact_gains);
        std::mem::swap(&mut kept.balances, &mut bodies.balances);
        std::mem::swap(&mut kept.inverse_masses, &mut bodies.inverse_masses);
        std::mem::swap(&mut kept.spin_states, &mut bodies.spin_states);
        self.solver.lanes.forget();
    }

    /// Passes changed masses on to the certificates.
    pub(crate) fn follow_masses(&mut self) {
        self.solver.with_system(&mut self.bodies, |solver, _| {
            solver.certifier.island_solver.follow(&solver.system);
        });
    }

    /// Ends a step of `dt` \[s\]: joints break, and the report gets the worst gap.
    pub(crate) fn end_joints(&mut self, dt: f32, report: &mut StepReport) {
        report.broken = self.solver.joints.break_overloaded();
        for index in 0..report.broken.len() {
            self.pair_again(report.broken[index].joint);
        }
        if !self.solver.joints.is_idle() {
            self.solver.joints.last_step = f64::from(dt);
            report.joint_gap = self.solver.joints.worst(&self.body_places());
        }
    }

    /// Returns the bodies after a step as joints see them.
    pub(crate) fn body_places(&self) -> BodyView<'_, G, L, A> {
        self.bodies.view(&[])
    }
}
