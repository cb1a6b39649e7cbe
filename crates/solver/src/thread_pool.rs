//! [`ThreadPool`]: persistent threads that work on one job together and wait for each other without
//! locks.
//!
//! A sweep over blocks of independent contacts takes some microseconds for each color. That is too
//! short to dispatch tasks and collect them. So all threads walk through the same sweep, each over
//! its share of each color, and wait at a barrier after each color ([`Worker::barrier`]). Between
//! two sweeps, threads poll for the next job for a moment, then sleep.
//!
//! Without the feature `threads`, a pool has no threads but its caller.
#![allow(unsafe_code)]

use std::marker::PhantomData;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use helpers::{Common, Helpers};

/// Least number of grains of work for each worker.
const SHARE: usize = 8;

/// Number of items of half a microsecond each, from which one worker alone takes longer than all
/// workers with a barrier.
const MEETING: usize = 4;

/// Threads that work together. Without helper threads the caller works alone.
#[derive(Debug)]
pub struct ThreadPool {
    helpers: Helpers,
    /// True if no work is worth sharing.
    rests: AtomicBool,
}

/// One thread of a pool during a job.
#[derive(Debug)]
pub struct Worker<'a> {
    index: usize,
    count: usize,
    common: Option<&'a Common>,
}

impl ThreadPool {
    /// Starts a pool of `threads` threads, including the caller; fewer if no more can be started.
    pub fn new(threads: usize) -> Self {
        Self { helpers: Helpers::new(threads.max(1)), rests: AtomicBool::new(false) }
    }

    /// Returns the number of processors that this process may use; 1 if it is unknown, or without
    /// the feature `threads`.
    pub fn processors() -> usize {
        helpers::processors()
    }

    /// Returns the number of threads, including the caller.
    pub fn threads(&self) -> usize {
        self.helpers.threads()
    }

    /// Sets whether the caller works alone from now on: then no work is useful to share.
    pub fn rest(&self, rests: bool) {
        self.rests.store(rests, Ordering::Relaxed);
    }

    /// Returns whether so many grains of work are enough to share.
    pub fn is_useful(&self, pieces: usize) -> bool {
        pieces >= SHARE * self.threads() && !self.rests.load(Ordering::Relaxed)
    }

    /// Returns whether `items` are enough to share, with `piece` of them to a grain, and how many
    /// each worker then takes. The shares are large, so that they stay in the cache of the core
    /// that took them the last time.
    pub fn share(&self, items: usize, piece: usize) -> (bool, usize) {
        let useful = self.is_useful(items / piece);
        (useful, items.div_ceil(if useful { self.threads() } else { 1 }).max(1))
    }

    /// Runs `job` once on each worker and returns when all are done. The caller runs it alone if a
    /// pool is not `useful`, and within another job.
    pub fn run(&self, useful: bool, job: &(dyn Fn(&Worker<'_>) + Sync)) {
        if useful { self.helpers.run(job) } else { job(&Worker::ALONE) }
    }

    /// Hands out `items` one after the other to whichever worker is free. The caller works alone if
    /// a pool is not `useful`.
    pub fn for_each<T: Send>(
        &self,
        useful: bool,
        items: impl Iterator<Item = T> + Send,
        work: impl Fn(T) + Sync,
    ) {
        if !useful || self.threads() == 1 {
            return items.for_each(work);
        }
        let items = Mutex::new(items);
        self.run(useful, &|_| {
            let next = || items.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some(item) = next() {
                work(item);
            }
        });
    }
}

impl Default for ThreadPool {
    fn default() -> Self {
        Self::new(1)
    }
}

impl Worker<'_> {
    const ALONE: Self = Self { index: 0, count: 1, common: None };

    /// Returns the number of workers.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns whether this worker does the work that cannot be shared.
    pub fn is_first(&self) -> bool {
        self.index == 0
    }

    /// Returns whether there are other workers, and so many items of half a microsecond each are
    /// worth a barrier.
    #[inline(always)]
    pub fn shares(&self, items: usize) -> bool {
        self.count > 1 && items >= MEETING
    }

    /// Returns the part of some items that this worker takes.
    pub fn part(&self, items: Range<usize>) -> Range<usize> {
        self.part_after(0, items)
    }

    /// Returns the part that this worker takes of items that follow `before` items of another kind.
    /// A worker that had fewer of those than others gets more of these.
    #[inline(always)]
    pub fn part_after(&self, before: usize, items: Range<usize>) -> Range<usize> {
        let all = before + items.len();
        let end = |of: usize| all * of / self.count - before * of / self.count;
        let start = (0..=self.index).map(end).fold(0, usize::max);
        items.start + start..items.start + start.max(end(self.index + 1))
    }

    /// Waits until all workers have arrived here.
    ///
    /// # Panics
    /// Another worker has panicked.
    pub fn barrier(&self) {
        if let Some(common) = self.common {
            common.barrier(self.count);
        }
    }
}

/// Helper threads, and what they share.
#[cfg(feature = "threads")]
mod helpers {
    use std::num::NonZero;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
    use std::sync::{Arc, Mutex, PoisonError};
    use std::thread::{self, JoinHandle, Thread};

    use super::Worker;

    /// Polls of a flag before a waiting thread yields: some 30 microseconds. Where there are fewer
    /// processors than threads, threads yield at once.
    const LOOKS: u32 = 512;

    /// Yields of a waiting thread before it sleeps: about a millisecond.
    const YIELDS: u32 = 2048;

    /// A job as the threads see it. It lives as long as [`Helpers::run`] waits for it.
    type Job = *const (dyn Fn(&Worker<'_>) + Sync);

    /// Returns the number of processors that this process may use.
    pub(super) fn processors() -> usize {
        thread::available_parallelism().map_or(1, NonZero::get)
    }

    /// The threads of a pool besides its caller.
    #[derive(Debug)]
    pub(super) struct Helpers {
        common: Arc<Common>,
        handles: Vec<JoinHandle<()>>,
    }

    #[derive(Debug)]
    pub(super) struct Common {
        threads: usize,
        /// Polls of a flag before a waiting thread yields.
        looks: u32,
        /// Current job, and the number of jobs so far.
        job: Mutex<Option<Task>>,
        jobs: AtomicUsize,
        /// Helpers that are still running the job.
        busy: AtomicUsize,
        /// Number of arrivals at barriers in the job.
        arrived: AtomicUsize,
        /// True if a worker has panicked, so that nobody waits for it any more.
        broken: AtomicBool,
        ended: AtomicBool,
        /// True if a job is running.
        taken: AtomicBool,
    }

    #[derive(Clone, Copy, Debug)]
    struct Task(Job);

    // SAFETY: the job is `Sync`, and `Helpers::run` keeps it alive while helpers use it.
    unsafe impl Send for Task {}

    impl Helpers {
        /// Starts helpers for a pool of `wanted` threads.
        pub(super) fn new(wanted: usize) -> Self {
            // Some threads may fail to start, so all are started before they are counted.
            let (ready, mut started) = (Arc::new(Mutex::new(None::<Arc<Common>>)), Vec::new());
            for index in 1..wanted {
                let ready = Arc::clone(&ready);
                let name = format!("contacts {index}");
                let helper = thread::Builder::new().name(name).spawn(move || {
                    let common = loop {
                        let common = ready.lock().unwrap_or_else(PoisonError::into_inner).clone();
                        match common {
                            Some(common) => break common,
                            None => thread::park(),
                        }
                    };
                    common.serve(index);
                });
                match helper {
                    Ok(helper) => started.push(helper),
                    Err(_) => break,
                }
            }
            let threads = started.len() + 1;
            let common = Arc::new(Common {
                threads,
                looks: if threads <= processors() { LOOKS } else { 0 },
                job: Mutex::new(None),
                jobs: AtomicUsize::new(0),
                busy: AtomicUsize::new(0),
                arrived: AtomicUsize::new(0),
                broken: AtomicBool::new(false),
                ended: AtomicBool::new(false),
                taken: AtomicBool::new(false),
            });
            *ready.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&common));
            started.iter().map(JoinHandle::thread).for_each(Thread::unpark);
            Self { common, handles: started }
        }

        pub(super) fn threads(&self) -> usize {
            self.common.threads
        }

        /// Runs a job on all threads, or on the caller alone within another job.
        pub(super) fn run(&self, job: &(dyn Fn(&Worker<'_>) + Sync)) {
            let common = &*self.common;
            // The load detects a nested job without moving a cache line between cores.
            let is_taken = || {
                common.taken.load(Ordering::Relaxed) || common.taken.swap(true, Ordering::Acquire)
            };
            if self.handles.is_empty() || is_taken() {
                return job(&Worker::ALONE);
            }
            // SAFETY: only the lifetime is erased. `job` outlives this call, which neither returns
            // nor unwinds before `busy` says that no helper uses the job any more.
            let task = unsafe { std::mem::transmute::<&(dyn Fn(&Worker<'_>) + Sync), Job>(job) };
            *common.job.lock().unwrap_or_else(PoisonError::into_inner) = Some(Task(task));
            common.broken.store(false, Ordering::Relaxed);
            common.arrived.store(0, Ordering::Relaxed);
            common.busy.store(self.handles.len(), Ordering::Relaxed);
            common.jobs.fetch_add(1, Ordering::Release);
            self.handles.iter().map(JoinHandle::thread).for_each(Thread::unpark);
            let own = catch_unwind(AssertUnwindSafe(|| job(&common.worker(0))));
            if own.is_err() {
                common.broken.store(true, Ordering::Release);
            }
            common.wait(|| common.busy.load(Ordering::Acquire) == 0, || {});
            let broken = common.broken.load(Ordering::Acquire);
            common.taken.store(false, Ordering::Release);
            match own {
                Err(panic) => std::panic::resume_unwind(panic),
                Ok(()) => assert!(!broken, "a thread of the pool has panicked"),
            }
        }
    }

    impl Drop for Helpers {
        fn drop(&mut self) {
            self.common.ended.store(true, Ordering::Release);
            for helper in self.handles.drain(..) {
                helper.thread().unpark();
                // The helper has already reported its panic.
                let _ = helper.join();
            }
        }
    }

    impl Common {
        fn worker(&self, index: usize) -> Worker<'_> {
            Worker { index, count: self.threads, common: Some(self) }
        }

        /// Waits for an event that is expected soon: polls, then yields, then calls `sleep`
        /// repeatedly.
        fn wait(&self, happened: impl Fn() -> bool, sleep: impl Fn()) {
            for _ in 0..self.looks {
                if happened() {
                    return;
                }
                std::hint::spin_loop();
            }
            for _ in 0..YIELDS {
                if happened() {
                    return;
                }
                thread::yield_now();
            }
            while !happened() {
                sleep();
                thread::yield_now();
            }
        }

        /// Runs jobs on a helper thread until the pool ends.
        fn serve(&self, index: usize) {
            let mut done = 0;
            loop {
                let ended = || self.ended.load(Ordering::Acquire);
                self.wait(|| self.jobs.load(Ordering::Acquire) != done || ended(), thread::park);
                if ended() {
                    return;
                }
                done += 1;
                let task = *self.job.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(Task(job)) = task {
                    // SAFETY: `Helpers::run` waits for `busy`, which counts this helper.
                    let job = unsafe { &*job };
                    if catch_unwind(AssertUnwindSafe(|| job(&self.worker(index)))).is_err() {
                        self.broken.store(true, Ordering::Release);
                    }
                }
                self.busy.fetch_sub(1, Ordering::Release);
            }
        }

        /// Waits until all `count` workers have arrived at a barrier ([`Worker::barrier`]).
        pub(super) fn barrier(&self, count: usize) {
            let before = self.arrived.fetch_add(1, Ordering::AcqRel);
            let all = (before / count + 1) * count;
            let broken = || self.broken.load(Ordering::Acquire);
            self.wait(|| self.arrived.load(Ordering::Acquire) >= all || broken(), || {});
            assert!(!broken(), "another thread of the pool has panicked");
        }
    }
}

/// No helper threads.
#[cfg(not(feature = "threads"))]
mod helpers {
    use super::Worker;

    /// Nobody shares anything.
    #[derive(Debug)]
    pub(super) enum Common {}

    impl Common {
        pub(super) fn barrier(&self, _count: usize) {
            match *self {}
        }
    }

    #[derive(Debug)]
    pub(super) struct Helpers;

    impl Helpers {
        pub(super) fn new(_wanted: usize) -> Self {
            Self
        }

        pub(super) fn threads(&self) -> usize {
            1
        }

        pub(super) fn run(&self, job: &(dyn Fn(&Worker<'_>) + Sync)) {
            job(&Worker::ALONE);
        }
    }

    pub(super) fn processors() -> usize {
        1
    }
}

/// A value made of consecutive elements, which can be split among threads.
pub trait Divide: Sized {
    /// Returns the number of elements.
    fn count(&self) -> usize;

    /// Returns the first `count` elements, and the others.
    ///
    /// # Panics
    /// There are fewer than `count` elements.
    fn split_at(self, count: usize) -> (Self, Self);

    /// Splits the value into at most `parts` parts of equal size, of which the last may be smaller.
    fn divide(self, parts: usize) -> impl Iterator<Item = Self> {
        let size = self.count().div_ceil(parts.max(1)).max(1);
        let mut left = Some(self);
        std::iter::from_fn(move || {
            let all = left.take().filter(|all| all.count() > 0)?;
            let size = size.min(all.count());
            let (first, others) = all.split_at(size);
            left = Some(others);
            Some(first)
        })
    }
}

/// Splits `items` into chunks of `size`, each with its slice of `parts`. Every item has `count` of
/// the parts, which are ordered by item.
pub fn chunks_with_parts<'a, T, U>(
    items: &'a [T],
    size: usize,
    parts: &'a mut [U],
    count: impl Fn(&T) -> usize + 'a,
) -> impl Iterator<Item = (&'a [T], &'a mut [U])> {
    let mut left = parts;
    items.chunks(size.max(1)).map(move |chunk| {
        let own = chunk.iter().map(&count).sum();
        let (own, later) = std::mem::take(&mut left).split_at_mut(own);
        left = later;
        (chunk, own)
    })
}

/// A slice whose elements several threads use at once, each thread its own. The elements are
/// numbered from any number on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DisjointSlice<'a, T> {
    /// Address of element 0, even if the slice begins later.
    zero: *mut T,
    first: usize,
    end: usize,
    lifetime: PhantomData<&'a mut [T]>,
}

// SAFETY: it is a `&mut [T]` of which each thread uses different elements, as `get_mut` demands.
unsafe impl<T: Send + Sync> Send for DisjointSlice<'_, T> {}
// SAFETY: as above.
unsafe impl<T: Send + Sync> Sync for DisjointSlice<'_, T> {}

impl<'a, T> DisjointSlice<'a, T> {
    /// Makes a slice for reading, on which `get_mut` must not be used.
    pub(crate) fn reading(first: usize, slice: &'a [T]) -> Self {
        let zero = slice.as_ptr().cast_mut().wrapping_sub(first);
        Self { zero, first, end: first + slice.len(), lifetime: PhantomData }
    }

    pub(crate) fn new(first: usize, slice: &'a mut [T]) -> Self {
        let zero = slice.as_mut_ptr().wrapping_sub(first);
        Self { zero, first, end: first + slice.len(), lifetime: PhantomData }
    }

    /// Makes a slice for reading with the same numbering, on which `get_mut` must not be used.
    pub(crate) fn beside(&self, slice: &'a [T]) -> Self {
        Self::reading(self.first, slice)
    }

    pub(crate) fn len(&self) -> usize {
        self.end - self.first
    }

    /// # Panics
    /// Some of these elements are not in the slice.
    #[inline(always)]
    pub(crate) fn check(&self, numbers: Range<usize>) {
        // Separate assertions, so that no flags have to be combined.
        assert!(self.first <= numbers.start);
        assert!(numbers.start <= numbers.end);
        assert!(numbers.end <= self.end);
    }

    /// Returns the address of an element, even if it is not in the slice.
    #[inline(always)]
    pub(crate) fn place(&self, number: u32) -> *mut T {
        self.zero.wrapping_add(number as usize)
    }

    /// Returns these elements.
    ///
    /// # Safety
    /// Nobody else uses these elements at the same time.
    #[inline(always)]
    #[allow(clippy::mut_from_ref)]
    pub(crate) unsafe fn get_mut(&self, numbers: Range<usize>) -> &mut [T] {
        self.check(numbers.clone());
        let start = self.zero.wrapping_add(numbers.start);
        // SAFETY: the elements are within the slice, and the caller keeps others away from them.
        unsafe { std::slice::from_raw_parts_mut(start, numbers.len()) }
    }
}
