//! Sleep: islands that have held still for a while are left out of steps until something touches or
//! moves them. An economy, never a cure: everything must hold still without it.

use drystone_solver::island::{self, Islands};
use drystone_solver::{System, Velocity};

use crate::bodies::Bodies;
use crate::cache::{ManifoldCache, Pair};
use crate::geometry::Geometry;
use crate::scene::Motion;

/// A body holds still below this speed of any of its points. \[m/s\]
const STILL: f32 = 0.005;

/// Who sleeps, and what was between the sleepers.
#[derive(Default)]
pub(crate) struct Sleep<const L: usize> {
    /// How long each body has held still. \[s\]
    pub(crate) still: Vec<f32>,
    /// The group that each body fell asleep with; 0: it is awake.
    pub(crate) group: Vec<u32>,
    /// Of the pairs that rest.
    pub(crate) records: ManifoldCache<L>,
    islands: Islands,
    /// Of each island: whether all of it holds still.
    ready: Vec<bool>,
}

impl<const L: usize> Sleep<L> {
    /// That of a world that goes on.
    pub(crate) fn resumed(still: Vec<f32>, group: Vec<u32>) -> Self {
        Self { still, group, ..Self::default() }
    }

    /// Makes room for a body, or forgets what was in its place.
    pub(crate) fn reset(&mut self, body: usize) {
        let bodies = self.group.len().max(body + 1);
        self.still.resize(bodies, 0.0);
        self.group.resize(bodies, 0);
        (self.still[body], self.group[body]) = (0.0, 0);
    }

    pub(crate) fn is_sleeping(&self, body: usize) -> bool {
        self.group[body] != 0
    }

    /// Whether anything sleeps.
    pub(crate) fn is_used(&self) -> bool {
        self.group.iter().any(|&group| group != 0)
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

    /// Wakes all that fell asleep with a body; returns whether it slept.
    pub(crate) fn wake(&mut self, body: usize) -> bool {
        let group = self.group[body];
        if group == 0 {
            return false;
        }
        for (of, still) in self.group.iter_mut().zip(&mut self.still) {
            if *of == group {
                (*of, *still) = (0, 0.0);
            }
        }
        true
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
        let mut any = false;
        for (body, &island) in of_body.iter().enumerate() {
            if self.ready.get(island as usize) == Some(&true) {
                self.group[body] = first + island;
                system.velocities[body] = Velocity::ZERO;
                any = true;
            }
        }
        any
    }
}
