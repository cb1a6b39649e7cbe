//! Threads that work together: everything is done once, in order, whatever happens.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use drystone_solver::team::Team;

/// Shares are as many as members, or one where there is too little to share.
#[test]
fn shares_cover_all_items() {
    for members in [1, 2, 3, 8] {
        let team = Team::new(members);
        for items in [0, 1, 7, 100, 1000, 10_001] {
            let (useful, share) = team.share(items, 10);
            let shares = items.div_ceil(share);
            assert_eq!(useful, items >= 80 * members, "{items} items, {members} members");
            assert!(shares <= if useful { members } else { 1 }, "{shares} shares of {items} items");
            assert!(!useful || shares == members);
        }
    }
}

#[test]
fn every_member_does_a_job_once_and_parts_cover_it() {
    for members in [1, 2, 3, 8] {
        let team = Team::new(members);
        assert_eq!(team.members(), members);
        for count in [0, 1, 7, 1000] {
            let done: Vec<_> = (0..count).map(|_| AtomicUsize::new(0)).collect();
            team.run(true, &|member| {
                for item in member.part(0..count) {
                    done[item].fetch_add(1, Ordering::Relaxed);
                }
            });
            assert!(done.iter().all(|times| times.load(Ordering::Relaxed) == 1));
        }
    }
}

/// Of kinds that are shared out one after the other everybody has about as many in all, in order, and each once.
#[test]
fn what_some_had_less_of_they_have_more_of_later() {
    let kinds = [1, 3, 0, 5, 1, 1, 13, 2];
    for members in 1..=8 {
        let team = Team::new(members);
        let (done, loads) = (Mutex::new(Vec::new()), Mutex::new(Vec::new()));
        team.run(true, &|member| {
            let (mut before, mut load) = (0, 0);
            for (kind, count) in kinds.into_iter().enumerate() {
                let part = member.part_after(before, 100 * kind..100 * kind + count);
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
        assert!(most <= Some(all.div_ceil(members) + members / 5), "{most:?} of {members}");
    }
}

#[test]
fn nobody_goes_on_before_all_have_met() {
    let team = Team::new(4);
    let steps: Vec<_> = (0..200).map(|_| AtomicUsize::new(0)).collect();
    team.run(true, &|member| {
        for step in &steps {
            step.fetch_add(1, Ordering::Relaxed);
            member.meet();
            assert_eq!(step.load(Ordering::Relaxed), 4);
        }
    });
}

#[test]
fn items_are_handed_out_once() {
    let team = Team::new(3);
    let seen = Mutex::new(Vec::new());
    team.for_each(true, 0..500, |item| seen.lock().unwrap().push(item));
    let mut seen = seen.into_inner().unwrap();
    seen.sort_unstable();
    assert!(seen.into_iter().eq(0..500));
}

#[test]
fn a_job_within_a_job_is_done_alone() {
    let team = Arc::new(Team::new(2));
    let done = AtomicUsize::new(0);
    team.run(true, &|_| {
        team.run(true, &|member| {
            assert_eq!(member.part(0..9), 0..9);
            member.meet();
            done.fetch_add(1, Ordering::Relaxed);
        });
    });
    assert_eq!(done.into_inner(), 2);
}

/// A panic of any member reaches the caller, who then has a team that works.
#[test]
fn a_panic_is_passed_on() {
    let team = Team::new(3);
    for culprit in 0..3 {
        let panicked = catch_unwind(AssertUnwindSafe(|| {
            team.run(true, &|member| {
                assert_ne!(member.part(0..3).start, culprit, "on purpose");
                member.meet();
            });
        }));
        assert!(panicked.is_err(), "member {culprit}");
        let done = AtomicUsize::new(0);
        team.run(true, &|member| {
            member.meet();
            done.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(done.into_inner(), 3);
    }
}
