//! Tests of the thread pool: every item is processed once, and a panic leaves the pool usable.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use drystone_solver::thread_pool::ThreadPool;

/// There are as many shares as threads, or at most one if there are too few items to share.
#[test]
fn shares_cover_all_items() {
    for threads in [1, 2, 3, 8] {
        let pool = ThreadPool::new(threads);
        for items in [0, 1, 7, 100, 1000, 10_001] {
            let (useful, share) = pool.share(items, 10);
            let shares = items.div_ceil(share);
            assert_eq!(useful, items >= 80 * threads, "{items} items, {threads} threads");
            assert!(shares <= if useful { threads } else { 1 }, "{shares} shares of {items} items");
            assert!(!useful || shares == threads);
        }
    }
}

#[test]
fn every_worker_does_a_job_once_and_parts_cover_it() {
    for threads in [1, 2, 3, 8] {
        let pool = ThreadPool::new(threads);
        assert_eq!(pool.threads(), threads);
        for count in [0, 1, 7, 1000] {
            let done: Vec<_> = (0..count).map(|_| AtomicUsize::new(0)).collect();
            pool.run(true, &|worker| {
                for item in worker.part(0..count) {
                    done[item].fetch_add(1, Ordering::Relaxed);
                }
            });
            assert!(done.iter().all(|times| times.load(Ordering::Relaxed) == 1));
        }
    }
}

/// When several ranges are split one after the other, all workers get about the same total, and
/// each item goes to one worker.
#[test]
fn shares_even_out_over_several_ranges() {
    let kinds = [1, 3, 0, 5, 1, 1, 13, 2];
    for threads in 1..=8 {
        let pool = ThreadPool::new(threads);
        let (done, loads) = (Mutex::new(Vec::new()), Mutex::new(Vec::new()));
        pool.run(true, &|worker| {
            let (mut before, mut load) = (0, 0);
            for (kind, count) in kinds.into_iter().enumerate() {
                let part = worker.part_after(before, 100 * kind..100 * kind + count);
                load += part.len();
                before += count;
                done.lock().unwrap().extend(part);
            }
            loads.lock().unwrap().push(load);
        });
        let mut done = done.into_inner().unwrap();
        done.sort_unstable();
        assert!(
            done.into_iter().eq(kinds
                .into_iter()
                .enumerate()
                .flat_map(|(of, count)| 100 * of..100 * of + count))
        );
        let (all, most) = (26usize, loads.into_inner().unwrap().into_iter().max());
        assert!(most <= Some(all.div_ceil(threads) + threads / 5), "{most:?} of {threads}");
    }
}

#[test]
fn no_worker_passes_a_barrier_before_all_arrive() {
    let pool = ThreadPool::new(4);
    let steps: Vec<_> = (0..200).map(|_| AtomicUsize::new(0)).collect();
    pool.run(true, &|worker| {
        for step in &steps {
            step.fetch_add(1, Ordering::Relaxed);
            worker.barrier();
            assert_eq!(step.load(Ordering::Relaxed), 4);
        }
    });
}

#[test]
fn items_are_handed_out_once() {
    let pool = ThreadPool::new(3);
    let seen = Mutex::new(Vec::new());
    pool.for_each(true, 0..500, |item| seen.lock().unwrap().push(item));
    let mut seen = seen.into_inner().unwrap();
    seen.sort_unstable();
    assert!(seen.into_iter().eq(0..500));
}

#[test]
fn a_nested_job_runs_on_one_thread() {
    let pool = Arc::new(ThreadPool::new(2));
    let done = AtomicUsize::new(0);
    pool.run(true, &|_| {
        pool.run(true, &|worker| {
            assert_eq!(worker.part(0..9), 0..9);
            worker.barrier();
            done.fetch_add(1, Ordering::Relaxed);
        });
    });
    assert_eq!(done.into_inner(), 2);
}

/// A panic in any worker reaches the caller, and the pool still works afterwards.
#[test]
fn a_panic_is_passed_on() {
    let pool = ThreadPool::new(3);
    for culprit in 0..3 {
        let panicked = catch_unwind(AssertUnwindSafe(|| {
            pool.run(true, &|worker| {
                assert_ne!(worker.part(0..3).start, culprit, "on purpose");
                worker.barrier();
            });
        }));
        assert!(panicked.is_err(), "worker {culprit}");
        let done = AtomicUsize::new(0);
        pool.run(true, &|worker| {
            worker.barrier();
            done.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(done.into_inner(), 3);
    }
}
