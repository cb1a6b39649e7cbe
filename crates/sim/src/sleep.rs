//! Sleep: islands that have held still for a while are left out of steps until something touches or
//! moves them. An economy, never a cure: everything must hold still without it.

use drystone_solver::island::{self, Islands};
use drystone_solver::{System, Velocity};

use crate::bodies::Bodies;
use crate::body::Motion;
use crate::cache::{ManifoldCache, Pair};
use crate::geometry::Geometry;

/// No body.
const NONE: u32 = u32::MAX;

/// A body holds still below this speed of any of its points. \[m/s\]
const STILL: f32 = 0.005;

/// Who sleeps, and what was between the sleepers.
#[derive(Default)]
pub(crate) struct Sleep<const L: usize> {
    /// How long each body has held still. \[s\]
    pub(crate) still: Vec<f32>,
    /// The group that each body fell asleep with; 0: it is awake.
    pub(crate) group: Vec<u32>,
    /// The next body of the same group; the groups are rings.
    next: Vec<u32>,
    /// Number of bodies that sleep.
    count: usize,
    /// Static and kinematic bodies that were added or moved since contacts were last searched for: they may touch
    /// sleepers.
    pub(crate) placed: Vec<u32>,
    /// Manifolds of the pairs that sleep.
    pub(crate) records: ManifoldCache<L>,
    islands: Islands,
    /// Of each island: whether all of it holds still, and a body that has fallen asleep.
    ready: Vec<bool>,
    members: Vec<u32>,
}

impl<const L: usize> Sleep<L> {
    /// Resumes from the state of a checkpoint.
    pub(crate) fn resumed(
        still: Vec<f32>,
        group: Vec<u32>,
        placed: Vec<u32>,
        records: ManifoldCache<L>,
    ) -> Self {
        let (awake, next) = (vec![0; group.len()], vec![NONE; group.len()]);
        let mut resumed = Self { still, group: awake, next, placed, records, ..Self::default() };
        let groups = group.iter().copied().max().unwrap_or(0) as usize;
        let mut members = vec![NONE; groups + 1];
        for (body, &group) in group.iter().enumerate().filter(|(_, group)| **group != 0) {
            resumed.enter(body, group, &mut members[group as usize]);
        }
        resumed
    }

    /// Makes room for a body, or forgets what was in its place.
    pub(crate) fn reset(&mut self, body: usize) {
        let bodies = self.group.len().max(body + 1);
        self.still.resize(bodies, 0.0);
        self.group.resize(bodies, 0);
        self.next.resize(bodies, NONE);
        (self.still[body], self.group[body]) = (0.0, 0);
    }

    /// Puts a body into a group, of which `member` is one if there is any.
    fn enter(&mut self, body: usize, group: u32, member: &mut u32) {
        let own = body as u32;
        self.group[body] = group;
        self.count += 1;
        if *member == NONE {
            self.next[body] = own;
        } else {
            self.next[body] = std::mem::replace(&mut self.next[*member as usize], own);
        }
        *member = own;
    }

    /// Notes that a static or kinematic body is where it was not before.
    pub(crate) fn place(&mut self, body: usize) {
        if !self.placed.contains(&(body as u32)) {
            self.placed.push(body as u32);
        }
    }

    pub(crate) fn is_sleeping(&self, body: usize) -> bool {
        self.group[body] != 0
    }

    /// Number of bodies that sleep.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Whether a body may touch what was not touched before: it moves, or can be moved.
    pub(crate) fn is_active<G: Geometry<L, A>, const A: usize>(
        &self,
        bodies: &Bodies<G, L, A>,
        velocities: &[Velocity<f32, L, A>],
        body: usize,
    ) -> bool {
        match bodies.motion[body] {
            Some(Motion::Dynamic) => !self.is_sleeping(body),
            Some(Motion::Kinematic) => velocities[body] != Velocity::ZERO,
            _ => false,
        }
    }

    /// Wakes all bodies that fell asleep with this one, and calls `woken` with each; returns whether it slept.
    pub(crate) fn wake(&mut self, body: usize, mut woken: impl FnMut(usize)) -> bool {
        if self.group[body] == 0 {
            return false;
        }
        let mut member = body;
        loop {
            (self.group[member], self.still[member]) = (0, 0.0);
            self.count -= 1;
            woken(member);
            member = self.next[member] as usize;
            if member == body {
                return true;
            }
        }
    }

    /// Puts pairs to rest of which neither body is active; their records move here.
    pub(crate) fn rest_pairs(
        &mut self,
        pairs: &mut [Pair],
        records: &ManifoldCache<L>,
        active: impl Fn(u32) -> bool,
    ) {
        // What has been woken since has left holes: they go when they are half of all.
        let kept: u32 = pairs.iter().filter(|pair| pair.rests).map(|pair| pair.count).sum();
        if self.records.manifolds.len() > 2 * kept as usize {
            let old = std::mem::take(&mut self.records);
            for pair in pairs.iter_mut().filter(|pair| pair.rests) {
                self.records.take_pair(pair, &old);
            }
        }
        for pair in pairs.iter_mut().filter(|pair| !pair.rests) {
            if !pair.bodies.into_iter().any(&active) {
                self.records.take_pair(pair, records);
                pair.rests = true;
            }
        }
    }

    /// Counts how long bodies have held still, `dt` \[s\] longer now, and puts islands to sleep all of
    /// whose bodies have for `delay` \[s\]; `touching` are the pairs that do, and of
    /// which number the surface `runs`: what is driven does not sleep. Returns whether any were.
    pub(crate) fn fall_asleep<G: Geometry<L, A>, const A: usize>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        system: &mut System<f32, L, A>,
        (touching, runs): (impl Iterator<Item = [u32; 2]> + Clone, impl Fn(usize) -> bool),
        dt: f32,
        delay: f32,
    ) -> bool {
        let mut tired = false;
        for (body, velocity) in system.velocities.iter().enumerate() {
            let speed =
                velocity.linear.length() + velocity.angular.length() * bodies.reach[body].all;
            let still = &mut self.still[body];
            *still = if speed < STILL { *still + dt } else { 0.0 };
            tired |= *still >= delay && bodies.is_dynamic(body) && self.group[body] == 0;
        }
        if !tired {
            return false;
        }
        self.islands.join(&system.masses, touching.clone());
        let of_body = &self.islands.of_body;
        self.ready.clear();
        self.ready.resize(self.islands.count, true);
        for (body, &island) in of_body.iter().enumerate() {
            if let Some(ready) = self.ready.get_mut(island as usize) {
                *ready &= self.still[body] >= delay;
            }
        }
        for (number, bodies) in touching.enumerate() {
            let carried = runs(number)
                || bodies.iter().any(|&body| {
                    of_body[body as usize] == island::NONE
                        && system.velocities[body as usize] != Velocity::ZERO
                });
            if carried
                && let Some(ready) = self.ready.get_mut(self.islands.of_pair(bodies) as usize)
            {
                *ready = false;
            }
        }
        let first = 1 + self.group.iter().copied().max().unwrap_or(0);
        let asleep = self.count;
        self.members.clear();
        self.members.resize(self.islands.count, NONE);
        for body in 0..self.group.len() {
            let island = self.islands.of_body[body];
            if self.ready.get(island as usize) == Some(&true) {
                let mut member = self.members[island as usize];
                self.enter(body, first + island, &mut member);
                self.members[island as usize] = member;
                system.velocities[body] = Velocity::ZERO;
            }
        }
        self.count > asleep
    }
}
