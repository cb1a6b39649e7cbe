//! Islands: bodies that contacts join, apart from what nothing can move. Each is a problem of its
//! own.

use crate::{InverseMass, Real, System};

/// No island: of bodies that nothing can move, or that touch nothing.
pub const NONE: u32 = u32::MAX;

/// Which island each body belongs to.
#[derive(Clone, Debug, Default)]
pub struct Islands {
    /// Islands are numbered in the order of their first bodies.
    pub of_body: Vec<u32>,
    /// How many there are.
    pub count: usize,
    /// A body of the same island with a lower index, or the body itself.
    parents: Vec<u32>,
}

impl Islands {
    /// Finds the islands of a system.
    pub fn find<T: Real, const L: usize, const A: usize>(&mut self, system: &System<T, L, A>) {
        self.join(&system.masses, system.manifolds.iter().map(|manifold| manifold.bodies));
    }

    /// Finds the islands of bodies with these masses, of which these pairs touch.
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
                // Touched: numbered below.
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

    /// The island of a contact between these bodies.
    pub fn of_pair(&self, bodies: [u32; 2]) -> u32 {
        let [a, b] = bodies.map(|body| self.of_body[body as usize]);
        a.min(b)
    }

    fn root(&mut self, mut body: u32) -> u32 {
        while self.parents[body as usize] != body {
            let parent = self.parents[body as usize];
            // Halves the way for the next who asks.
            self.parents[body as usize] = self.parents[parent as usize];
            body = self.parents[body as usize];
        }
        body
    }
}
