//! The allocator of the tests, which counts.

#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The system's allocator, which counts the allocations of each thread.
struct Counter;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
    /// True if the next allocation prints its backtrace.
    static TRAP: Cell<bool> = const { Cell::new(false) };
    /// Largest size of an allocation since the last reset. \[byte\]
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

fn count(size: usize) {
    LARGEST.with(|largest| largest.set(largest.get().max(size)));
    let count = COUNT.with(Cell::get) + 1;
    COUNT.with(|all| all.set(count));
    if TRAP.with(|trap| trap.replace(false)) {
        eprintln!("{}", std::backtrace::Backtrace::force_capture());
        COUNT.with(|all| all.set(count));
    }
}

// SAFETY: every call is passed on to the system's allocator unchanged. Counting allocates only for
// a backtrace, and TRAP is cleared by then.
unsafe impl GlobalAlloc for Counter {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counter = Counter;

/// Returns the number of allocations that `work` makes on this thread.
pub(crate) fn allocations(mut work: impl FnMut()) -> usize {
    let before = COUNT.with(Cell::get);
    TRAP.with(|trap| trap.set(true));
    work();
    TRAP.with(|trap| trap.set(false));
    COUNT.with(Cell::get) - before
}

/// Returns the size of the largest allocation that `work` makes on this thread. \[byte\]
pub(crate) fn largest(work: impl FnOnce()) -> usize {
    LARGEST.with(|largest| largest.set(0));
    work();
    LARGEST.with(Cell::get)
}

/// The allocator counts allocations and reports the size of the largest one.
#[test]
fn the_counter_counts() {
    assert_eq!(largest(|| drop(vec![0u8; 12_345])), 12_345);
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))), 1);
    assert_eq!(allocations(|| ()), 0);
}
