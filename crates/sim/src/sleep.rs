//! Sleep: steps leave out islands that have held still for a while, until something touches or
//! moves them. It only saves time: bodies must also stay at rest without it.

use drystone_solver::island::{self, Islands};
use drystone_solver::{Vector, Velocity};

use crate::bodies::Bodies;
use crate::body::Motion;
use crate::cache::{ManifoldCache, Pair};
use crate::geometry::Geometry;

/// Marks the absence of a body.
const NONE: u32 = u32::MAX;

/// A body holds still if the speed of each of its points is below this. \[m/s\]
const STILL: f32 = 0.005;

/// Sleeping bodies, and the manifolds between them.
#[derive(Default)]
pub(crate) struct Sleep<const L: usize> {
    /// By body: time for which it has held still. \[s\]
    pub(crate) still: Vec<f32>,
    /// By body: group with which it fell asleep, or 0 if it is awake.
    pub(crate) group: Vec<u32>,
    /// By body: next body of the same group. Groups are circular lists.
    next: Vec<u32>,
    /// Number of sleeping bodies.
    count: usize,
    /// Gravity of the last step. A change wakes all bodies. \[m/s^2\]
    pub(crate) last_gravity: Vector<f32, L>,
    /// Setting `sleep_delay` of the last step. All bodies wake when it becomes 0. \[s\]
    pub(crate) last_delay: f32,
    /// Static and kinematic bodies that were added or moved since the last contact search. They may
    /// touch sleeping bodies.
    pub(crate) placed: Vec<u32>,
    /// Manifolds of the sleeping pairs.
    pub(crate) cache: ManifoldCache<L>,
    islands: Islands,
    /// By island: true if all of it holds still; and its last body that has fallen asleep.
    ready: Vec<bool>,
    members: Vec<u32>,
}

impl<const L: usize> Sleep<L> {
    /// Restores the state of a checkpoint.
    pub(crate) fn resumed(
        still: Vec<f32>,
        group: Vec<u32>,
        placed: Vec<u32>,
        cache: ManifoldCache<L>,
    ) -> Self {
        let (awake, next) = (vec![0; group.len()], vec![NONE; group.len()]);
        let mut resumed = Self { still, group: awake, next, placed, cache, ..Self::default() };
        let groups = group.iter().copied().max().unwrap_or(0) as usize;
        let mut members = vec![NONE; groups + 1];
        for (body, &group) in group.iter().enumerate().filter(|(_, group)| **group != 0) {
            resumed.enter(body, group, &mut members[group as usize]);
        }
        resumed
    }

    /// Makes room for a body and resets its state.
    pub(crate) fn reset(&mut self, body: usize) {
        let bodies = self.group.len().max(body + 1);
        self.still.resize(bodies, 0.0);
        self.group.resize(bodies, 0);
        self.next.resize(bodies, NONE);
        (self.still[body], self.group[body]) = (0.0, 0);
    }

    /// Adds a body to a group. `member` is a body of the group, if any, and becomes the added one.
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

    /// Puts a body to sleep alone.
    pub(crate) fn enter_alone(&mut self, body: usize) {
        if self.group[body] == 0 {
            let group = 1 + self.group.iter().copied().max().unwrap_or(0);
            self.enter(body, group, &mut { NONE });
        }
    }

    /// Records that a static or kinematic body was added or moved.
    pub(crate) fn mark_placed(&mut self, body: usize) {
        if !self.placed.contains(&(body as u32)) {
            self.placed.push(body as u32);
        }
    }

    pub(crate) fn is_sleeping(&self, body: usize) -> bool {
        self.group[body] != 0
    }

    /// Returns the number of sleeping bodies.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Returns true if a body may touch something new: it is dynamic and awake, or kinematic or held
    /// and moves or deforms.
    pub(crate) fn is_active<G: Geometry<L, A>, const A: usize>(
        &self,
        bodies: &Bodies<G, L, A>,
        body: usize,
    ) -> bool {
        match bodies.motion[body] {
            Some(Motion::Dynamic) if !bodies.held[body] => !self.is_sleeping(body),
            None | Some(Motion::Static) => false,
            _ => bodies.velocities[body] != Velocity::ZERO || bodies.surface_speed(body) > 0.0,
        }
    }

    /// Wakes all bodies that fell asleep with this one, and calls `woken` with each. Returns true
    /// if it slept.
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

    /// Puts pairs to sleep that `are_active` does not name, and moves their manifolds to the cache of
    /// sleeping pairs.
    pub(crate) fn put_to_sleep(
        &mut self,
        pairs: &mut [Pair],
        cache: &ManifoldCache<L>,
        are_active: impl Fn([u32; 2]) -> bool,
    ) {
        // Pairs that woke have left unused entries. The cache is compacted when these are more than
        // half of it.
        let kept: u32 = pairs.iter().filter(|pair| pair.is_sleeping).map(|pair| pair.count).sum();
        if self.cache.manifolds.len() > 2 * kept as usize {
            let old = std::mem::take(&mut self.cache);
            for pair in pairs.iter_mut().filter(|pair| pair.is_sleeping) {
                self.cache.take_pair(pair, &old);
            }
        }
        for pair in pairs.iter_mut().filter(|pair| !pair.is_sleeping) {
            if !are_active(pair.bodies) {
                self.cache.take_pair(pair, cache);
                pair.is_sleeping = true;
            }
        }
    }

    /// Updates the time for which bodies have held still, after a step of `dt` \[s\]. Puts islands
    /// to sleep if all their bodies have held still for `delay` \[s\]. `touching` are the pairs of
    /// bodies of the manifolds. `runs` tells whether a surface of a manifold has a surface
    /// velocity: a driven island stays awake. Returns true if any body fell asleep.
    pub(crate) fn fall_asleep<G: Geometry<L, A>, const A: usize>(
        &mut self,
        bodies: &mut Bodies<G, L, A>,
        (touching, runs): (impl Iterator<Item = [u32; 2]> + Clone, impl Fn(usize) -> bool),
        dt: f32,
        delay: f32,
    ) -> bool {
        let mut tired = false;
        for (body, velocity) in bodies.velocities.iter().enumerate() {
            let speed =
                velocity.linear.length() + velocity.angular.length() * bodies.reach[body].all;
            let still = &mut self.still[body];
            *still = if speed < STILL { *still + dt } else { 0.0 };
            tired |= *still >= delay && bodies.is_dynamic(body) && self.group[body] == 0;
        }
        if !tired {
            return false;
        }
        self.islands.join(&bodies.inverse_masses, touching.clone());
        let of_body = &self.islands.of_body;
        self.ready.clear();
        self.ready.resize(self.islands.count, true);
        for (body, &island) in of_body.iter().enumerate() {
            if let Some(ready) = self.ready.get_mut(island as usize) {
                *ready &= self.still[body] >= delay;
            }
        }
        for (number, pair) in touching.enumerate() {
            let carried = runs(number)
                || pair.iter().any(|&body| {
                    of_body[body as usize] == island::NONE
                        && (bodies.velocities[body as usize] != Velocity::ZERO
                            || bodies.surface_speed(body as usize) > 0.0)
                });
            if carried && let Some(ready) = self.ready.get_mut(self.islands.of_pair(pair) as usize)
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
                bodies.velocities[body] = Velocity::ZERO;
            }
        }
        self.count > asleep
    }
}
