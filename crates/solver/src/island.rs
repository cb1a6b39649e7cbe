//! Islands: sets of movable bodies connected by contacts and joints. Each is an independent problem.

use crate::{InverseMass, Real, System};

/// Index instead of an island for bodies that are fixed or have no contacts.
pub const NONE: u32 = u32::MAX;

/// Assignment of bodies to islands.
#[derive(Clone, Debug, Default)]
pub struct Islands {
    /// Island of each body, or [`NONE`]. Islands are numbered in the order of their first bodies.
    pub of_body: Vec<u32>,
    /// Number of islands.
    pub count: usize,
    /// For each body, one of the same island with a lower index, or the body itself.
    parents: Vec<u32>,
}

impl Islands {
    /// Finds the islands of a system.
    pub fn find<T: Real, const L: usize, const A: usize>(&mut self, system: &System<T, L, A>) {
        self.join(&system.masses, system.pairs());
    }

    /// Finds the islands of bodies with these masses, where these pairs touch.
    pub fn join<T: Real, const L: usize, const A: usize>(
        &mut self,
        masses: &[InverseMass<T, L, A>],
        pairs: impl Iterator<Item = [u32; 2]>,
    ) {
        let bodies = masses.len();
        let moves = |body: u32| masses[body as usize] != InverseMass::FIXED;
        self.parents.clear();
        self.parents.extend(0..bodies as u32);
        self.of_body.clear();
        self.of_body.resize(bodies, NONE);
        for [a, b] in pairs {
            for body in [a, b].into_iter().filter(|&body| moves(body)) {
                // Marks the body as touched; islands are numbered below.
                self.of_body[body as usize] = 0;
            }
            if moves(a) && moves(b) {
                let (a, b) = (self.root(a), self.root(b));
                self.parents[a.max(b) as usize] = a.min(b);
            }
        }
        self.count = 0;
        for body in 0..bodies as u32 {
            if self.of_body[body as usize] == NONE {
                continue;
            }
            let root = self.root(body);
            if root == body {
                self.of_body[body as usize] = self.count as u32;
                self.count += 1;
            } else {
                self.of_body[body as usize] = self.of_body[root as usize];
            }
        }
    }

    /// Keeps the islands of these bodies, which are numbered anew.
    pub fn keep(&mut self, bodies: impl Iterator<Item = u32>) {
        // The new number of each island.
        let Self { of_body, count, parents: kept } = self;
        kept.clear();
        kept.resize(*count, NONE);
        for body in bodies {
            if let Some(kept) = kept.get_mut(of_body[body as usize] as usize) {
                *kept = 0;
            }
        }
        *count = 0;
        for kept in kept.iter_mut().filter(|kept| **kept != NONE) {
            *kept = *count as u32;
            *count += 1;
        }
        for of in of_body {
            *of = kept.get(*of as usize).copied().unwrap_or(NONE);
        }
    }

    /// Returns the island of a contact between these bodies.
    pub fn of_pair(&self, bodies: [u32; 2]) -> u32 {
        let [a, b] = bodies.map(|body| self.of_body[body as usize]);
        a.min(b)
    }

    fn root(&mut self, mut body: u32) -> u32 {
        while self.parents[body as usize] != body {
            let parent = self.parents[body as usize];
            // Path halving shortens later searches.
            self.parents[body as usize] = self.parents[parent as usize];
            body = self.parents[body as usize];
        }
        body
    }
}
