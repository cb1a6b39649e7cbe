//! [`BodyId`] and [`ColliderId`]: identifiers of bodies and colliders, and the [`Slots`] behind
//! them.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicU32, Ordering};

/// Returns a pair with the smaller index first.
pub(crate) fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Defines a public identifier: a slot, the generation of its content, and the world.
macro_rules! id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name {
            index: u32,
            generation: u32,
            world: u32,
        }

        impl $name {
            /// Returns the identifier of the content of a slot.
            pub(crate) fn new(slots: &Slots, index: usize, world: u32) -> Self {
                Self { index: index as u32, generation: slots.generations[index], world }
            }

            /// Returns its slot: the index into arrays over all slots. While nothing has been
            /// removed, slots follow the order of addition.
            pub fn index(self) -> usize {
                self.index as usize
            }

            /// Returns its slot, or `None` if the slot has other content by now or the world
            /// differs.
            pub(crate) fn slot(self, slots: &Slots, world: u32) -> Option<usize> {
                let index = self.index as usize;
                let current = slots.generations.get(index) == Some(&self.generation);
                (current && self.world == world).then_some(index)
            }
        }
    };
}

id! {
    /// Identifier of a body. It is invalid after the body is removed, and in other worlds.
    BodyId
}

id! {
    /// Identifier of a collider: one shape of a body. It is invalid after the body is removed, and
    /// in other worlds.
    ColliderId
}

id! {
    /// Identifier of a joint. It is invalid after the joint is removed, and in other worlds.
    JointId
}

/// Returns a number that no other world of this process has.
pub(crate) fn new_world() -> u32 {
    static WORLDS: AtomicU32 = AtomicU32::new(0);
    WORLDS.fetch_add(1, Ordering::Relaxed)
}

/// Slots with generations. The lowest free slot is taken first, so indices depend only on the order
/// of calls.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slots {
    /// Generation of each slot: odd while it is taken, plus one at each change.
    generations: Vec<u32>,
    free: BinaryHeap<Reverse<u32>>,
}

impl Slots {
    /// Returns the number of slots, free ones included.
    pub(crate) fn len(&self) -> usize {
        self.generations.len()
    }

    /// Returns the generation of each slot: odd while it is taken.
    pub(crate) fn generations(&self) -> &[u32] {
        &self.generations
    }

    /// Returns true if the slot is taken.
    pub(crate) fn is_taken(&self, index: usize) -> bool {
        self.generations[index] % 2 == 1
    }

    /// Takes the lowest free slot, or appends one, and returns its index.
    pub(crate) fn take(&mut self) -> usize {
        let index = self.free.pop().map_or(self.generations.len(), |Reverse(index)| index as usize);
        match self.generations.get_mut(index) {
            Some(generation) => *generation = generation.wrapping_add(1),
            None => self.generations.push(1),
        }
        index
    }

    /// Invalidates the identifiers of a slot. The slot stays unused until it is
    /// [released](Self::release).
    pub(crate) fn vacate(&mut self, index: usize) {
        debug_assert!(self.is_taken(index), "a slot in use");
        self.generations[index] = self.generations[index].wrapping_add(1);
    }

    /// Makes a vacated slot free.
    pub(crate) fn release(&mut self, index: usize) {
        self.free.push(Reverse(index as u32));
    }
}

/// Sets the value of a slot in an array over all slots. The slot may be the next one.
pub(crate) fn put<T>(all: &mut Vec<T>, index: usize, value: T) {
    match all.get_mut(index) {
        Some(own) => *own = value,
        None => {
            debug_assert_eq!(all.len(), index, "the next slot");
            all.push(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_free_slot_is_taken_and_old_identifiers_are_stale() {
        let mut slots = Slots::default();
        let taken: Vec<usize> = (0..4).map(|_| slots.take()).collect();
        assert_eq!(taken, [0, 1, 2, 3]);
        let [old, other] = [1, 2].map(|index| BodyId::new(&slots, index, 7));
        [3, 1].into_iter().for_each(|index| slots.vacate(index));
        assert_eq!(slots.take(), 4, "none was released");
        [3, 1].into_iter().for_each(|index| slots.release(index));
        assert_eq!([slots.take(), slots.take()], [1, 3]);
        assert_eq!(
            [old.slot(&slots, 7), other.slot(&slots, 7), other.slot(&slots, 8)],
            [None, Some(2), None]
        );
    }
}
