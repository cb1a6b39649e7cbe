//! [`Partition`]: bodies and manifolds divided into batches. Each batch is solved through all
//! substeps before the next, while it is in the cache of a core.

use std::ops::Range;

/// Approximate memory of a batch: half of a small level-2 cache. \[bytes\]
pub(crate) const BATCH: usize = 1 << 18;

/// Steps after which a system that could not be divided is tried again.
const PATIENCE: u32 = 16;

/// Extent of a batch: consecutive bodies that no constraint couples to others, with their manifolds.
///
/// Batches are cut in the order of the bodies, where no manifold or joint crosses the cut. So passes over
/// bodies stay passes over slices. The batch of a manifold does not change its result by a bit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct BatchRange {
    pub(crate) bodies: Range<usize>,
    /// Ranges among all colors, blocks and points.
    pub(crate) colors: Range<usize>,
    pub(crate) blocks: Range<usize>,
    pub(crate) points: Range<usize>,
}

/// A manifold as partitioning and coloring see it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ConstraintKey {
    pub(crate) bodies: [u32; 2],
    /// True if each body can be moved. Bodies that cannot may have many manifolds of one color.
    pub(crate) moving: [bool; 2],
    /// Batch of the first body that couples its manifolds.
    pub(crate) batch: u16,
    pub(crate) points: u32,
}

/// Memory of a body, a manifold, a point and a joint with its body. \[bytes\]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sizes {
    pub(crate) body: usize,
    pub(crate) manifold: usize,
    pub(crate) point: usize,
    pub(crate) joint: usize,
}

impl Sizes {
    /// Sizes with which everything fits into one batch.
    pub(crate) const NONE: Self = Self { body: 0, manifold: 0, point: 0, joint: 0 };
}

/// Assignment of bodies to batches.
#[derive(Clone, Debug, Default)]
pub(crate) struct Partition {
    /// End of the bodies of each batch, and these ends in a new partition.
    ends: Vec<u32>,
    anew: Vec<u32>,
    /// Batch of each body.
    of_body: Vec<u16>,
    /// For each body, the last body that a constraint couples it to, and the memory of the body and
    /// of the constraints counted with it.
    joined: Vec<(u32, u32)>,
    /// Steps since a division was last tried, while all bodies are one batch.
    waited: u32,
}

impl Partition {
    /// Returns the number of batches.
    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Returns the bodies of a batch.
    pub(crate) fn bodies(&self, batch: usize) -> Range<usize> {
        let first = if batch == 0 { 0 } else { self.ends[batch - 1] };
        first as usize..self.ends[batch] as usize
    }

    /// Returns whether the partition needs no update while bodies and manifolds are the same. With
    /// a single batch, each call counts as a step towards the next try.
    pub(crate) fn rests(&mut self) -> bool {
        let due = self.len() == 1 && self.waited + 1 == PATIENCE;
        self.waited += u32::from(self.len() == 1 && !due);
        !due
    }

    /// Divides the bodies into batches, tells each manifold its batch, and returns whether batches
    /// have changed. Batches stay as they are where that is good enough.
    ///
    /// Each body is given by whether it can be moved and whether it couples its manifolds. A body
    /// that does not couple them does not restrict the cuts. `points` is the number of points of
    /// all manifolds.
    pub(crate) fn update(
        &mut self,
        of_bodies: &[[bool; 2]],
        keys: &mut [ConstraintKey],
        points: usize,
        (joints, sizes): (&[[u32; 2]], Sizes),
    ) -> bool {
        let bodies = of_bodies.len();
        let all = bodies * sizes.body + keys.len() * sizes.manifold + points * sizes.point;
        let all = all + joints.len() * sizes.joint;
        let whole = self.ends == [bodies as u32];
        self.waited = if whole { (self.waited + 1) % PATIENCE } else { 0 };
        if all <= 2 * BATCH || self.waited > 0 {
            self.anew.clear();
            self.anew.push(bodies as u32);
            if whole {
                return false;
            }
        } else {
            let of_key = |of: &ConstraintKey| sizes.manifold + sizes.point * of.points as usize;
            let keys_of = keys.iter().map(|of| (of.bodies, of_key(of)));
            let all = keys_of.chain(joints.iter().map(|of| (*of, sizes.joint)));
            self.join(of_bodies, all, sizes.body);
            if self.divide() {
                self.tell(of_bodies, keys);
                return false;
            }
        }
        std::mem::swap(&mut self.ends, &mut self.anew);
        self.of_body.clear();
        for (batch, &end) in self.ends.iter().enumerate() {
            self.of_body.resize(end as usize, u16::try_from(batch).unwrap_or(u16::MAX));
        }
        self.tell(of_bodies, keys);
        true
    }

    /// Finds how far constraints couple each body. They are given by their bodies and their memory.
    fn join(
        &mut self,
        bodies: &[[bool; 2]],
        constraints: impl Iterator<Item = ([u32; 2], usize)>,
        body: usize,
    ) {
        let joins = |body: u32| bodies[body as usize][1];
        self.joined.clear();
        self.joined.resize(bodies.len(), (0, body as u32));
        for ([a, b], memory) in constraints {
            let both = joins(a) && joins(b);
            let (low, high) = if both {
                (a.min(b), a.max(b))
            } else if joins(a) {
                (a, a)
            } else {
                (b, b)
            };
            let (last, size) = &mut self.joined[low as usize];
            *last = (*last).max(high);
            *size += memory as u32;
        }
    }

    /// Finds new ends for batches that are large enough. Returns whether the old ends are as good.
    fn divide(&mut self) -> bool {
        self.anew.clear();
        let (mut last, mut size) = (0, 0);
        let mut old = self.ends.iter().copied().peekable();
        let mut crossed = false;
        for (body, &(to, own)) in (0..).zip(&self.joined) {
            last = last.max(to);
            size += own as usize;
            let open = last <= body;
            crossed |= old.next_if_eq(&(body + 1)).is_some() && !open;
            if open && size >= BATCH && self.anew.len() < usize::from(u16::MAX) {
                self.anew.push(body + 1);
                size = 0;
            }
        }
        let bodies = self.joined.len() as u32;
        if self.anew.last() != Some(&bodies) {
            self.anew.push(bodies);
        }
        !crossed && self.ends.last() == Some(&bodies) && 2 * self.ends.len() >= self.anew.len()
    }

    fn tell(&self, bodies: &[[bool; 2]], keys: &mut [ConstraintKey]) {
        for key in keys {
            let [a, b] = key.bodies;
            let own = if bodies[a as usize][1] { a } else { b };
            key.batch = self.of_body[own as usize];
        }
    }
}
