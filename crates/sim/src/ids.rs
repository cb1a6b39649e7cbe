//! [`BodyId`] and [`ColliderId`]: names of things that come and go, and the [`Slots`] behind them.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicU32, Ordering};

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
            /// The identifier of the content of a slot.
            pub(crate) fn new(slots: &Slots, index: usize, world: u32) -> Self {
                Self { index: index as u32, generation: slots.generations[index], world }
            }

            /// Slot: index into arrays over all slots. Where nothing was removed, the order of adding.
            pub fn index(self) -> usize {
                self.index as usize
            }

            /// Its slot, unless the content is another by now, or the world is.
            pub(crate) fn slot(self, slots: &Slots, world: u32) -> Option<usize> {
                let index = self.index as usize;
                let current = slots.generations.get(index) == Some(&self.generation);
                (current && self.world == world).then_some(index)
            }
        }
    };
}

id! {
    /// Identifies a body of a world. No world takes the identifier of a body that was removed, or that of another world.
    BodyId
}

id! {
    /// Identifies a collider of a world: one shape of a body. It becomes stale with its body.
    ColliderId
}

/// A number that no other world of this process has.
pub(crate) fn new_world() -> u32 {
    static WORLDS: AtomicU32 = AtomicU32::new(0);
    WORLDS.fetch_add(1, Ordering::Relaxed)
}

/// Slots of which the lowest free one is taken first, so that indices depend on the order of calls alone.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slots {
    /// Odd while the slot is taken; each change adds one.
    generations: Vec<u32>,
    free: BinaryHeap<Reverse<u32>>,
}

impl Slots {
    /// Number of slots, free ones included.
    pub(crate) fn len(&self) -> usize {
        self.generations.len()
    }

    /// Generation of each slot: odd while it is taken.
    pub(crate) fn generations(&self) -> &[u32] {
        &self.generations
    }

    /// True if the slot is taken.
    pub(crate) fn is_taken(&self, index: usize) -> bool {
        self.generations[index] % 2 == 1
    }

    /// Takes the lowest free slot, or a new one behind all others.
    pub(crate) fn take(&mut self) -> usize {
        let index = self.free.pop().map_or(self.generations.len(), |Reverse(index)| index as usize);
        match self.generations.get_mut(index) {
            Some(generation) => *generation = generation.wrapping_add(1),
            None => self.generations.push(1),
        }
        index
    }

    /// Makes the identifiers of a slot stale. It is not taken again before it is [released](Self::release).
    pub(crate) fn vacate(&mut self, index: usize) {
        debug_assert!(self.is_taken(index), "a slot in use");
        self.generations[index] = self.generations[index].wrapping_add(1);
    }

    /// Lets a vacated slot be taken again.
    pub(crate) fn release(&mut self, index: usize) {
        self.free.push(Reverse(index as u32));
    }
}

/// Sets the value of a slot in an array over all slots, of which this one may be the next.
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
