//! Equivalence tests: matrices and sweeps, `f64` and `f32`, any order of contacts, and a scene and
//! its mirror image lead to one answer.

use crate::common::counting::Counting;
use crate::common::{Random, Recipe, Scene, assert_all_close, random_scene};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use drystone_solver::certificate::{Certificate, CertificateScratch, certify};
use drystone_solver::island::Islands;
use drystone_solver::lanes::coloring::Coloring;
use drystone_solver::lanes::{
    CachedImpulse, GatherLanes, Instructions, LaneSlots, LaneSystem, ManifoldSource, Reuse, WIDTH,
};
use drystone_solver::law::{Cone, Law};
use drystone_solver::thread_pool::{Divide, ThreadPool};
use drystone_solver::{
    Contact, InverseMass, Manifold, Repair, SymmetricMatrix, System, Vector, Velocity, pgs,
};
use proptest::prelude::*;

fn any_scene<const L: usize, const A: usize>(random: &mut Random) -> Scene<L, A> {
    let recipe = Recipe {
        bodies: 2 + random.below(5),
        manifolds: 1 + random.below(8),
        points: 4,
        walls: true,
    };
    random_scene(random, recipe)
}

fn flat<const L: usize, const A: usize>(system: &System<f64, L, A>) -> Vec<f64> {
    system.velocities.iter().flat_map(|v| v.linear.0.into_iter().chain(v.angular.0)).collect()
}

fn normals<const L: usize, const A: usize>(system: &System<f64, L, A>) -> Vec<f64> {
    system.contacts.iter().map(|contact| contact.impulse[0]).collect()
}

#[cfg(feature = "assembled")]
mod assembled {
    use super::*;
    use drystone_solver::assembled::{
        compliance, gauss_seidel, impulses, inverse_mass, jacobian, rhs, soften, system_matrix,
        velocities,
    };

    /// Compares sweeps: gamma_i <- max(0, gamma_i + m_eff (t_i - v_n)) is row i of projected
    /// Gauss-Seidel on A + E.
    fn sweep_by_sweep<const L: usize, const A: usize>(seed: u64, softness: f64) {
        let random = &mut Random(seed);
        let mut system = any_scene::<L, A>(random).system;
        system.prepare(softness);
        let a = soften(&system_matrix(&system), &compliance(&system));
        let (b, v) = (rhs(&system), velocities(&system));
        // The sweeps start from arbitrary impulses, before the system has applied them to the
        // velocities.
        for contact in &mut system.contacts {
            contact.impulse[0] = random.within(0.0, 1.0);
        }
        let mut gamma = impulses(&system);
        system.apply_impulses();
        for _ in 0..8 {
            pgs::sweep_normals(&mut system);
            gauss_seidel::projected_sweep(&a, &b, &mut gamma);
            assert_all_close(normals(&system), gamma.iter().copied(), 1e-9);
            let moved = jacobian(&system).transpose() * &gamma;
            let after = &v + inverse_mass(&system) * moved;
            assert_all_close(flat(&system), after.iter().copied(), 1e-9);
        }
    }

    proptest! {
        #[test]
        fn sweeps_of_rigid_contacts(seed in any::<u64>()) {
            in_all_four!(sweep_by_sweep, seed, 0.0);
        }

        #[test]
        fn sweeps_of_soft_contacts(seed in any::<u64>(), softness in 0.01..0.8) {
            in_all_four!(sweep_by_sweep, seed, softness);
        }
    }
}

/// Sweeps in `f32` equal sweeps in `f64` up to the rounding of `f32`.
fn single_precision<const L: usize, const A: usize>(seed: u64) {
    let mut single: System<f32, L, A> = any_scene::<L, A>(&mut Random(seed)).system.cast();
    let mut double: System<f64, L, A> = single.cast();
    for _ in 0..4 {
        pgs::sweep(&mut single);
        pgs::sweep(&mut double);
    }
    let single: System<f64, L, A> = single.cast();
    assert_all_close(flat(&single), flat(&double), 1e-4);
    assert_all_close(normals(&single), normals(&double), 1e-4);
}

const REPAIR: Repair<f32> =
    Repair { dt: 0.01, rate: 0.2, slop: 0.001, max_repair_speed: 1.0, stick_rate: 20.0 };

/// Returns a system after three substeps in packed form.
fn packed<const L: usize, const A: usize>(
    instructions: Instructions,
    system: &System<f32, L, A>,
    displacements: &[Velocity<f32, L, A>],
) -> System<f32, L, A> {
    let mut system = system.clone();
    let mut packed = LaneSystem::<L, A>::with(instructions);
    packed.pack(&system, &system.masses, 0.1);
    let v = &mut system.velocities;
    for _ in 0..3 {
        let mut whole = packed.whole(&mut []);
        whole.apply_impulses(v);
        whole.sweep_normals_to_targets(v, displacements, false, &REPAIR);
        packed.set_targets(displacements, None, &REPAIR);
        let mut whole = packed.whole(&mut []);
        whole.sweep_normals(v);
        whole.relax(v, false, None);
    }
    packed.unpack(&mut system);
    assert_eq!(f64::from(packed.residual(&system.velocities)), system.residual(true));
    let deepest = system.contacts.iter().map(|contact| -contact.gap[0]).fold(0.0, f32::max);
    assert_eq!(packed.overlap(), deepest);
    system
}

/// Returns a system with random gaps and enough manifolds for many blocks.
fn crowd<const L: usize, const A: usize>(random: &mut Random) -> System<f64, L, A> {
    let recipe = Recipe {
        bodies: 2 + random.below(40),
        manifolds: 1 + random.below(100),
        points: 4,
        walls: true,
    };
    let mut system = random_scene::<L, A>(random, recipe).system;
    for contact in &mut system.contacts {
        contact.gap = random.vector() * 0.01;
    }
    system
}

/// Sweeps in lanes give the bits of sweeps over single contacts in the order of the lanes, for
/// every lane type.
fn lanes_and_scalars<const L: usize, const A: usize>(seed: u64) {
    let random = &mut Random(seed);
    let mut scene = crowd::<L, A>(random);
    for contact in &mut scene.contacts {
        contact.impulse = random.vector();
        contact.impulse[0] = contact.impulse[0].abs();
    }
    let displacements: Vec<Velocity<f64, L, A>> = (scene.velocities.iter())
        .map(|_| Velocity { linear: random.vector() * 0.001, angular: random.vector() * 0.001 })
        .collect();
    let single = |v: &Velocity<f64, L, A>| Velocity {
        linear: v.linear.map(|x| x as f32),
        angular: v.angular.map(|x| x as f32),
    };
    let displacements: Vec<_> = displacements.iter().map(single).collect();
    let system: System<f32, L, A> = scene.cast();

    let mut coloring = Coloring::default();
    coloring.assign(
        system.velocities.len(),
        system.manifolds.iter().map(|manifold| (manifold.bodies, manifold.count)),
        |body| system.masses[body as usize] != InverseMass::FIXED,
    );
    let mut order: Vec<usize> = (0..system.manifolds.len()).collect();
    order.sort_by_key(|&i| coloring.places[i]);
    let mut scalar = System { manifolds: Vec::new(), contacts: Vec::new(), ..system.clone() };
    for &i in &order {
        let manifold = system.manifolds[i];
        scalar.add_manifold(manifold, &system.contacts[manifold.points()]);
    }
    scalar.prepare(0.1);
    for _ in 0..3 {
        scalar.set_targets(&displacements, &REPAIR);
        scalar.apply_impulses();
        pgs::sweep_coming(&mut scalar);
        pgs::sweep_coming(&mut scalar);
        pgs::relax(&mut scalar);
    }

    for instructions in Instructions::available() {
        let lanes = packed(instructions, &system, &displacements);
        assert_eq!(lanes.velocities, scalar.velocities);
        for (place, &i) in order.iter().enumerate() {
            let (there, here) = (system.manifolds[i], scalar.manifolds[place]);
            assert_eq!(lanes.contacts[there.points()], scalar.contacts[here.points()]);
        }
    }
}

/// The result does not depend on where in its plane a manifold has its center. A single point at
/// the center, which feels no rotation, gives the same result as one elsewhere.
fn centers_anywhere<const L: usize, const A: usize>(seed: u64) {
    let random = &mut Random(seed);
    let recipe = Recipe { bodies: 60, manifolds: 200, points: 1 + seed as usize % 2, walls: true };
    let mut own: System<f64, L, A> = random_scene::<L, A>(random, recipe).system;
    own.prepare(0.1);
    let mut shifted = own.clone();
    let mut alone = 0;
    for manifold in &mut shifted.manifolds {
        let mut by: Vector<f64, L> = random.vector() * 0.3;
        by[0] = 0.0;
        alone += usize::from(manifold.count == 1);
        manifold.frame.arms = manifold.frame.arms.map(|arm| arm + manifold.frame.to_world(by));
        for contact in &mut shifted.contacts[manifold.points()] {
            contact.offset -= by;
        }
    }
    assert!(alone > 50, "{alone} have a point alone");
    shifted.prepare(0.1);
    for system in [&mut own, &mut shifted] {
        for _ in 0..3 {
            pgs::sweep(system);
            pgs::sweep_coming(system);
            pgs::relax(system);
        }
    }
    for (a, b) in own.velocities.iter().zip(&shifted.velocities) {
        let apart = *a - *b;
        assert!(apart.dot(&apart) <= 1e-20 * (1.0 + a.dot(a)), "{a:?} and {b:?}");
    }
}

/// Points at different heights need separate manifolds.
#[test]
#[should_panic(expected = "points in one plane")]
fn a_point_off_the_plane_is_refused() {
    let mut system: System<f64, 3, 3> = System::new();
    let off = Contact { offset: Vector([1e-3, 0.0, 0.0]), ..Contact::default() };
    system.add_manifold(Manifold::default(), &[Contact::default(), off]);
}

#[test]
fn a_center_is_anywhere() {
    for seed in 0..6 {
        in_all_four!(centers_anywhere, seed);
    }
}

/// A source of which some manifolds are kept and some have changed.
struct Keeping<'a, const L: usize, const A: usize> {
    system: &'a System<f32, L, A>,
    reuse: Vec<Reuse>,
    /// True if the keys are those of the last call.
    same: bool,
    /// True if the source reports the fixed bodies that have zero velocity.
    standing: bool,
    /// Number of lanes that were read.
    taken: AtomicUsize,
}

impl<const L: usize, const A: usize> ManifoldSource<L> for Keeping<'_, L, A> {
    fn count(&self) -> usize {
        self.system.count()
    }

    fn key(&self, manifold: u32) -> ([u32; 2], u32) {
        self.system.key(manifold)
    }

    fn same_keys(&self) -> bool {
        self.same
    }

    fn reuse(&self, manifold: u32) -> Reuse {
        self.reuse[manifold as usize]
    }

    fn stands(&self, body: u32) -> bool {
        self.standing && self.system.velocities[body as usize] == Velocity::ZERO
    }

    fn take<V: GatherLanes>(
        &self,
        seats: &LaneSlots<'_>,
        manifold: &mut Manifold<V, L>,
        points: &mut [Contact<V, L>],
    ) {
        self.taken.fetch_add(size_of::<V>() / size_of::<f32>(), Ordering::Relaxed);
        self.system.take(seats, manifold, points);
    }
}

/// Steps `system` with the packed system `keeping` and with one packed from scratch, and checks
/// that the results are equal. Returns the number of lanes that `keeping` read.
fn step_both<const L: usize, const A: usize>(
    keeping: &mut LaneSystem<L, A>,
    seen: &System<f32, L, A>,
    (reuse, same): (Vec<Reuse>, bool),
    softness: f32,
    system: &mut System<f32, L, A>,
) -> usize {
    let rows = Keeping { system: seen, reuse, same, standing: false, taken: AtomicUsize::new(0) };
    keeping.pack(&rows, &system.masses, softness);
    let mut anew = LaneSystem::<L, A>::new();
    anew.pack(&*system, &system.masses, softness);
    let moved =
        |v: &Velocity<f32, L, A>| Velocity { linear: v.linear * 0.01, angular: v.angular * 0.01 };
    let displacements: Vec<_> = system.velocities.iter().map(moved).collect();
    let mut traces = vec![CachedImpulse::default(); system.contacts.len()];
    let [after, kept] = [&mut anew, keeping].map(|packed| {
        let (mut velocities, mut whole) = (system.velocities.clone(), packed.whole(&mut traces));
        whole.sweep_normals_to_targets(&mut velocities, &displacements, false, &REPAIR);
        whole.relax(&mut velocities, false, None);
        whole.trace(&displacements, REPAIR.stick_rate);
        let mut after = System { velocities, ..system.clone() };
        packed.unpack(&mut after);
        after
    });
    assert_eq!(after, kept);
    for (contact, trace) in after.contacts.iter().zip(&traces) {
        assert_eq!((contact.gap, contact.impulse), (trace.gap, trace.impulse));
    }
    *system = after;
    rows.taken.into_inner()
}

/// Kept manifolds are not read again, and have the bits of manifolds that are written to the cache
/// and packed again. They are read again after a change of softness, when one of few manifolds is
/// removed, and after [`LaneSystem::forget`].
fn kept_and_anew<const L: usize, const A: usize>(seed: u64) {
    let random = &mut Random(seed);
    let mut system: System<f32, L, A> = crowd::<L, A>(random).cast();
    let mut keeping = LaneSystem::<L, A>::new();
    for round in 0..6 {
        let softness = if round < 3 { 0.1 } else { 0.2 };
        let mut seen = system.clone();
        match round {
            // All manifolds are kept, so the changed friction is not read.
            2 => seen.manifolds.iter_mut().for_each(|manifold| manifold.friction += 1.0),
            4 => {
                let last = system.manifolds.pop().unwrap();
                system.contacts.truncate(last.first as usize);
                seen.clone_from(&system);
            }
            5 => {
                system.manifolds.iter_mut().for_each(|manifold| manifold.friction += 1.0);
                seen.clone_from(&system);
                keeping.forget();
            }
            _ => {}
        }
        let reuse = (0..seen.manifolds.len() as u32).map(|number| match random.below(64) {
            0 if round == 1 => Reuse::New,
            1 if round == 1 => Reuse::Changed(number),
            _ => Reuse::Kept(number),
        });
        let reuse = reuse.collect();
        let same = !matches!(round, 0 | 4);
        let taken = step_both(&mut keeping, &seen, (reuse, same), softness, &mut system);
        if !matches!(round, 1 | 4) && !system.manifolds.is_empty() {
            assert_eq!(taken == 0, round == 2, "round {round}: {taken} lanes");
        }
    }
}

/// Manifolds are added to and removed from a packed system whose other manifolds mostly keep their
/// blocks. Returns the number of lanes that a pool of `members` threads reads in each round. In the
/// last rounds some manifolds also change their friction.
fn come_and_go(members: usize) -> Vec<usize> {
    let random = &mut Random(11);
    let recipe = Recipe { bodies: 2700, manifolds: 4500, points: 4, walls: true };
    let whole: System<f32, 3, 3> = random_scene::<3, 3>(random, recipe).system.cast();
    let mut system = whole.clone();
    // The index in `system` of each manifold of `whole`.
    let mut numbers: Vec<Option<u32>> = (0..whole.manifolds.len() as u32).map(Some).collect();
    let mut keeping = LaneSystem::<3, 3>::new();
    keeping.set_pool(Arc::new(ThreadPool::new(members)));
    let mut taken = Vec::new();
    for round in 0..30 {
        let mut next = System { manifolds: Vec::new(), contacts: Vec::new(), ..system.clone() };
        let mut reuse = Vec::new();
        let (come, go) = if round < 2 { (1, 0) } else { (2, random.below(8)) };
        for (number, manifold) in numbers.iter_mut().zip(&whole.manifolds) {
            let gone = number.is_none();
            if gone && random.below(come) > 0 || !gone && random.below(4500) < go {
                *number = None;
                continue;
            }
            let (from, old) = match *number {
                Some(old) => (&system, &system.manifolds[old as usize]),
                None => (&whole, manifold),
            };
            let mut own = *old;
            reuse.push(match *number {
                Some(number) if round > 20 && random.below(16) == 0 => {
                    own.friction += 0.1;
                    Reuse::Changed(number)
                }
                Some(number) if round > 0 => Reuse::Kept(number),
                _ => Reuse::New,
            });
            *number = Some(next.manifolds.len() as u32);
            next.add_manifold(own, &from.contacts[old.points()]);
        }
        system = next;
        let seen = system.clone();
        taken.push(step_both(&mut keeping, &seen, (reuse, false), 0.1, &mut system));
    }
    taken
}

#[test]
fn blocks_stay_while_others_come_and_go() {
    let taken = come_and_go(1);
    println!("lanes taken in: {taken:?}");
    assert_eq!(taken[1], 0);
    assert!(taken[10..20].iter().sum::<usize>() < 10 * taken[0] / 10, "{taken:?}");
    assert_eq!(come_and_go(2), taken);
}

/// Returns all bodies as one island.
fn all_as_one<const L: usize, const A: usize>(system: &System<f32, L, A>) -> Islands {
    let mut islands = Islands::default();
    (islands.of_body, islands.count) = (vec![0; system.velocities.len()], 1);
    islands
}

/// Thread pools of every size give the bits of one thread, with enough blocks to be shared among
/// the threads. Covers packing, sweeps and conjugate iterations.
fn threads_and_one<const L: usize, const A: usize>(seed: u64) {
    let random = &mut Random(seed);
    let recipe = Recipe { bodies: 1200, manifolds: 4500, points: 4, walls: true };
    let start: System<f32, L, A> = random_scene::<L, A>(random, recipe).system.cast();
    let still = vec![Velocity::ZERO; start.velocities.len()];
    let by = |members: usize| {
        let mut system = start.clone();
        let mut lanes = LaneSystem::new();
        lanes.set_pool(Arc::new(ThreadPool::new(members)));
        lanes.pack(&system, &system.masses, 0.1);
        for _ in 0..2 {
            lanes.whole(&mut []).apply_impulses(&mut system.velocities);
            lanes.set_targets(&still, None, &REPAIR);
            let mut whole = lanes.whole(&mut []);
            whole.sweep_normals(&mut system.velocities);
            whole.relax(&mut system.velocities, false, None);
        }
        lanes.set_islands(&all_as_one(&system));
        lanes.begin_conjugate();
        for _ in 0..3 {
            lanes.conjugate(&mut system.velocities, &[false]);
        }
        lanes.unpack(&mut system);
        system
    };
    let alone = by(1);
    assert_ne!(alone.velocities, start.velocities);
    for members in [2, 3, 5] {
        assert_eq!(by(members), alone, "{members} members");
    }
}

#[test]
fn thread_pools_of_any_size_and_one() {
    in_all_four!(threads_and_one, 11);
}

/// Returns 100 crowds, with the bodies of one crowd after those of the other. Most crowds stand on
/// one ground, which is body 0; the others have their own walls.
fn crowds<const L: usize, const A: usize>(random: &mut Random) -> System<f32, L, A> {
    let mut all: System<f32, L, A> = System::new();
    all.add_body(Velocity::ZERO, InverseMass::FIXED);
    for number in 0..100 {
        let own: System<f32, L, A> = crowd::<L, A>(random).cast();
        let first = all.velocities.len() as u32;
        let grounded =
            |body: u32| number % 5 > 0 && own.masses[body as usize] == InverseMass::FIXED;
        for (velocity, mass) in own.velocities.iter().zip(&own.masses) {
            all.add_body(*velocity, *mass);
        }
        for manifold in &own.manifolds {
            let bodies = manifold.bodies.map(|body| if grounded(body) { 0 } else { first + body });
            let points = &own.contacts[manifold.points()];
            all.add_manifold(Manifold { bodies, ..*manifold }, points);
        }
    }
    all
}

/// g|^2 of each island is the sum over its own contacts, whichever lanes hold them. After some
/// islands are done, the velocities of all bodies still agree with the impulses of their contacts.
fn gradients_by_island<const L: usize, const A: usize>(seed: u64) {
    let start = crowds::<L, A>(&mut Random(seed));
    let mut islands = Islands::default();
    islands.find(&start);
    let mut lanes = LaneSystem::new();
    lanes.pack(&start, &start.masses, 0.1);
    lanes.set_islands(&islands);
    lanes.set_targets(&vec![Velocity::ZERO; start.velocities.len()], None, &REPAIR);
    lanes.begin_conjugate();
    let mut system = start.clone();
    lanes.whole(&mut []).apply_impulses(&mut system.velocities);
    lanes.conjugate(&mut system.velocities, &vec![false; islands.count]);
    lanes.unpack(&mut system);
    let mut expected = vec![0.0_f64; islands.count];
    for manifold in &system.manifolds {
        let Some(own) = expected.get_mut(islands.of_pair(manifold.bodies) as usize) else {
            continue;
        };
        for point in manifold.points() {
            let (before, after) = (&start.contacts[point], &system.contacts[point]);
            let g = before.impulse - after.impulse;
            if after.effective_mass > 0.0 {
                *own += f64::from(g.dot(g) / after.effective_mass);
            }
        }
    }
    let moved = expected.iter().filter(|size| **size > 0.0).count();
    assert!(moved >= 40, "{moved} of {}", islands.count);
    for (&found, &size) in lanes.gradients().iter().zip(&expected) {
        assert!((f64::from(found) - size).abs() <= 1e-5 * size, "{found} and {size}");
    }
    // Islands are done only after they have search directions.
    for iteration in 0..5 {
        let done = |island| iteration > 1 && island % 3 == 0;
        let done: Vec<bool> = (0..islands.count).map(done).collect();
        lanes.conjugate(&mut system.velocities, &done);
    }
    lanes.unpack(&mut system);
    let energy = |(velocity, mass): (&Velocity<f32, L, A>, &InverseMass<f32, L, A>)| {
        mass.mass().squared(&velocity.cast())
    };
    let energy: f64 = system.velocities.iter().zip(&system.masses).map(energy).sum();
    let defect = certify(&system, &start.velocities).defect;
    assert!(defect <= 1e-11 * energy, "{defect} J of {energy}");
}

/// Iterations over some islands do not change a bit of the others, whichever lanes hold them.
fn iterations_over_some_islands<const L: usize, const A: usize>(seed: u64) {
    let start = crowds::<L, A>(&mut Random(seed));
    let mut islands = Islands::default();
    islands.find(&start);
    let is_kept = |body: usize| islands.of_body[body].is_multiple_of(3);
    let bodies: Vec<_> = (0..).take(start.velocities.len()).collect();
    let kept: Vec<u32> = bodies.into_iter().filter(|&body| is_kept(body as usize)).collect();
    let mut some = islands.clone();
    some.keep(kept.into_iter());
    let mut lanes = LaneSystem::new();
    lanes.pack(&start, &start.masses, 0.1);
    lanes.set_islands(&some);
    lanes.set_targets(&vec![Velocity::ZERO; start.velocities.len()], None, &REPAIR);
    lanes.begin_conjugate();
    let mut system = start.clone();
    for _ in 0..3 {
        lanes.conjugate(&mut system.velocities, &vec![false; some.count]);
    }
    lanes.unpack(&mut system);
    let mut changed = [0; 2];
    for (body, (before, after)) in start.velocities.iter().zip(&system.velocities).enumerate() {
        changed[usize::from(is_kept(body))] += u32::from(before != after);
    }
    for manifold in &system.manifolds {
        let own = islands.of_pair(manifold.bodies).is_multiple_of(3);
        for point in manifold.points() {
            let (before, after) = (&start.contacts[point], &system.contacts[point]);
            changed[usize::from(own)] += u32::from(before.impulse != after.impulse);
        }
    }
    assert_eq!(changed[0], 0);
    assert!(changed[1] > 100, "{changed:?}");
}

#[test]
fn iterations_over_some_islands_leave_the_others() {
    in_all_four!(iterations_over_some_islands, 18);
}

#[test]
fn gradients_belong_to_islands() {
    in_all_four!(gradients_by_island, 17);
}

/// Solving each batch through all substeps, one after the other or on several threads, gives the
/// bits of substeps over the whole system.
fn batches_and_whole<const L: usize, const A: usize>(seed: u64) {
    let random = &mut Random(seed);
    let mut system = crowds::<L, A>(random);
    let mut lanes = LaneSystem::new();
    for round in 0..3 {
        let displacements: Vec<Velocity<f32, L, A>> = (system.velocities.iter())
            .map(|v| Velocity { linear: v.linear * 0.01, angular: v.angular * 0.01 })
            .collect();
        let reuse = vec![Reuse::New; system.manifolds.len()];
        let rows = Keeping {
            system: &system,
            reuse,
            same: false,
            standing: true,
            taken: AtomicUsize::new(0),
        };
        lanes.pack(&rows, &system.masses, 0.1);
        let mut side_by_side = lanes.clone();
        let mut anew = LaneSystem::new();
        anew.pack(&system, &system.masses, 0.1);
        let mut join = [0; 2];
        let mut by = |lanes: &mut LaneSystem<L, A>, divided: bool, members: usize| {
            let mut after = system.clone();
            let mut traces = vec![CachedImpulse::default(); system.contacts.len()];
            let whole = lanes.whole(&mut traces);
            let parts = if divided { whole.count() } else { 1 };
            assert!(!divided || parts > 2, "{parts} batches");
            let (mut v, mut moved) = (&mut after.velocities[..], &displacements[..]);
            let mut batches = Vec::new();
            for batch in whole.divide(parts) {
                let (own, later) = v.split_at_mut(batch.bodies().len());
                let (own_moved, later_moved) = moved.split_at(own.len());
                (v, moved) = (later, later_moved);
                batches.push((batch, own, own_moved));
            }
            assert!(v.is_empty(), "each body is in a batch");
            if let [(first, ..), (second, ..), ..] = &batches[..] {
                join = [first.bodies().end as u32 - 1, second.bodies().start as u32];
            }
            ThreadPool::new(members).for_each(
                true,
                batches.into_iter(),
                |(mut batch, v, moved)| {
                    for _ in 0..3 {
                        batch.apply_impulses(v);
                        batch.sweep_normals_to_targets(v, moved, false, &REPAIR);
                        batch.sweep_normals(v);
                        batch.sweep(v);
                        batch.relax(v, false, None);
                    }
                    batch.trace(moved, REPAIR.stick_rate);
                },
            );
            lanes.unpack(&mut after);
            (after, traces)
        };
        let expected = by(&mut anew, false, 1);
        assert_eq!(by(&mut lanes, true, 1), expected);
        assert_eq!(by(&mut side_by_side, true, 3), expected);
        system = expected.0;
        if round == 1 {
            // A manifold between two batches: the system has to be partitioned differently.
            let manifold = Manifold { bodies: join, ..system.manifolds[0] };
            let points = system.contacts[manifold.points()].to_vec();
            for body in join {
                system.masses[body as usize] = InverseMass::default();
                system.masses[body as usize].linear = 1.0;
            }
            system.add_manifold(manifold, &points);
        }
    }
}

#[test]
fn batches_equal_the_whole() {
    in_all_four!(batches_and_whole, 5);
}

/// Returns the certificate of all contacts together, once computed in lanes and once contact by
/// contact.
fn certified<const L: usize, const A: usize>(
    instructions: Instructions,
    start: &System<f32, L, A>,
) -> [Certificate; 2] {
    let mut system = start.clone();
    let mut packed = LaneSystem::<L, A>::with(instructions);
    packed.pack(&system, &system.masses, 0.1);
    let still = vec![Velocity::ZERO; system.velocities.len()];
    packed.whole(&mut []).apply_impulses(&mut system.velocities);
    packed.set_targets(&still, None, &REPAIR);
    packed.whole(&mut []).sweep(&mut system.velocities);
    let islands = all_as_one(&system);
    packed.set_islands(&islands);
    packed.begin_conjugate();
    for _ in 0..3 {
        packed.conjugate(&mut system.velocities, &[false]);
    }
    packed.unpack(&mut system);
    let mut scratch = CertificateScratch::default();
    scratch.set_masses(&system);
    let prospective = &start.velocities;
    let v = &system.velocities;
    let at_hand = packed.certify::<false, false>(v, prospective, &islands, &mut scratch)[0];
    let lanes = packed.certify::<true, true>(v, prospective, &islands, &mut scratch)[0];
    let one = certify(&system, prospective);
    // The velocity changes along conjugate directions agree with the impulses of the contacts.
    let energy = |(velocity, mass): (&Velocity<f32, L, A>, &InverseMass<f32, L, A>)| {
        mass.mass().squared(&velocity.cast())
    };
    let energy: f64 = v.iter().zip(&system.masses).map(energy).sum();
    let Certificate { duality_gap: gap, defect, .. } = at_hand;
    assert!(defect <= 1e-11 * energy, "{defect} J of {energy}");
    let expected = losses(&system.cast()) + defect;
    assert!((gap - expected).abs() <= 1e-9 * expected, "{gap} and {expected}");
    assert!(lanes.error() <= at_hand.error() * (1.0 + 1e-9), "the line begins at hand");
    [lanes, one]
}

/// G without the defect, for the current impulses: summed by its definition, one contact after the
/// other.
fn losses<const L: usize, const A: usize>(system: &System<f64, L, A>) -> f64 {
    let mut sum = 0.0;
    for manifold in &system.manifolds {
        let twist = system.twist_of(manifold);
        for contact in &system.contacts[manifold.points()] {
            let law = Cone::of(manifold, contact);
            let (u, r) = (contact.relative_velocity(&twist), law.clamp(contact.impulse));
            if contact.effective_mass > 0.0 {
                sum += law.shifted(u, r).loss(u, r);
            }
        }
    }
    sum
}

fn certificates_agree<const L: usize, const A: usize>(seed: u64) {
    let random = &mut Random(seed);
    let mut scene = crowd::<L, A>(random);
    for contact in &mut scene.contacts {
        contact.impulse = Vector::ZERO;
    }
    let start: System<f32, L, A> = scene.cast();
    let [lanes, one] = certified(Instructions::Portable, &start);
    let numbers = |of: &Certificate| {
        let sums = [of.duality_gap, of.defect, of.mass, of.complementarity];
        [&sums[..], &[of.natural_residual, of.approach_error, of.cone]].concat()
    };
    for (lanes, one) in numbers(&lanes).into_iter().zip(numbers(&one)) {
        assert!((lanes - one).abs() <= 1e-9 * one.abs() + 1e-15, "seed {seed}: {lanes} and {one}");
    }
    for instructions in Instructions::available() {
        assert_eq!(certified(instructions, &start), [lanes, one], "seed {seed}: {instructions:?}");
    }
}

#[test]
fn certificates_of_lanes_and_one() {
    for seed in 0..100 {
        in_all_four!(certificates_agree, seed);
    }
}

/// Certificates of many islands have the same bits on one thread and on several. The check repeats
/// with a thread pool that has already been used.
fn certificates_by_threads<const L: usize, const A: usize>(seed: u64) {
    let start = crowds::<L, A>(&mut Random(seed));
    let mut islands = Islands::default();
    islands.find(&start);
    let of = |members: usize| {
        let (mut lanes, mut system, mut scratch) =
            (LaneSystem::new(), start.clone(), CertificateScratch::default());
        lanes.set_pool(Arc::new(ThreadPool::new(members)));
        lanes.pack(&start, &start.masses, 0.1);
        assert!(start.manifolds.len() >= 8 * members * WIDTH, "enough to share");
        lanes.set_islands(&islands);
        lanes.set_targets(&vec![Velocity::ZERO; start.velocities.len()], None, &REPAIR);
        lanes.begin_conjugate();
        lanes.whole(&mut []).apply_impulses(&mut system.velocities);
        scratch.set_masses(&start);
        let mut all = Vec::new();
        for _ in 0..3 {
            lanes.conjugate(&mut system.velocities, &vec![false; islands.count]);
            let (v, prospective) = (&system.velocities, &start.velocities);
            all.extend_from_slice(lanes.certify::<false, false>(
                v,
                prospective,
                &islands,
                &mut scratch,
            ));
            all.extend_from_slice(lanes.certify::<true, true>(
                v,
                prospective,
                &islands,
                &mut scratch,
            ));
        }
        all
    };
    let expected = of(1);
    let missing = expected.iter().filter(|of| of.duality_gap > 0.0).count();
    assert!(4 * missing > expected.len(), "{missing} of {} islands are not solved", expected.len());
    for members in 2..=4 {
        assert_eq!(of(members), expected, "{members} threads");
    }
}

#[test]
fn certificates_do_not_depend_on_the_threads() {
    in_all_four!(certificates_by_threads, 23);
}

/// No two manifolds of a block move the same body, and blocks are filled from lane 0 on.
#[test]
fn a_block_moves_each_body_once() {
    let random = &mut Random(7);
    // Body 1 has more manifolds than there are colors.
    let pairs: Vec<([u32; 2], u32)> = (0..300)
        .map(|i| {
            let other = 2 + random.below(40) as u32;
            let body = if i % 3 == 0 { 1 } else { random.below(other as usize) as u32 };
            ([body, other], 1 + random.below(4) as u32)
        })
        .collect();
    let moves = |body: u32| body != 0;
    let mut coloring = Coloring::default();
    coloring.assign(42, pairs.iter().copied(), moves);
    let blocks = coloring.points.len();
    let mut lanes = vec![[false; WIDTH]; blocks];
    let mut longest = vec![0; blocks];
    let mut bodies = vec![Vec::new(); blocks];
    for (&place, &(pair, points)) in coloring.places.iter().zip(&pairs) {
        let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
        assert!(!std::mem::replace(&mut lanes[block][lane], true));
        longest[block] = points.max(longest[block]);
        bodies[block].extend(pair.into_iter().filter(|&body| moves(body)));
    }
    assert_eq!(longest, coloring.points);
    for (lanes, mut bodies) in lanes.into_iter().zip(bodies) {
        assert!(lanes[0] && lanes.is_sorted_by(|a, b| a >= b));
        let count = bodies.len();
        bodies.sort_unstable();
        bodies.dedup();
        assert_eq!(bodies.len(), count);
    }
}

/// A soft system has a unique solution, so sweeps in any order converge to it.
fn any_order<const L: usize, const A: usize>(seed: u64) {
    let random = &mut Random(seed);
    let mut system = any_scene::<L, A>(random).system;
    system.prepare(0.2);
    let mut shuffled = System { manifolds: Vec::new(), contacts: Vec::new(), ..system.clone() };
    let mut order: Vec<usize> = (0..system.manifolds.len()).collect();
    for i in (1..order.len()).rev() {
        order.swap(i, random.below(i + 1));
    }
    for &i in &order {
        let manifold = system.manifolds[i];
        let mut points = system.contacts[manifold.points()].to_vec();
        points.reverse();
        shuffled.add_manifold(manifold, &points);
    }
    for _ in 0..1500 {
        pgs::sweep_normals(&mut system);
        pgs::sweep_normals(&mut shuffled);
    }
    assert_all_close(flat(&system), flat(&shuffled), 1e-9);
    for (place, &i) in order.iter().enumerate() {
        let (here, there) = (system.manifolds[i], shuffled.manifolds[place]);
        let mut expected = normals(&system)[here.points()].to_vec();
        expected.reverse();
        assert_all_close(normals(&shuffled)[there.points()].to_vec(), expected, 1e-9);
    }
}

/// Mirrors a vector across the plane x = 0.
fn reflected<const N: usize>(mut vector: Vector<f64, N>) -> Vector<f64, N> {
    vector[0] = -vector[0];
    vector
}

/// Mirrors an angular velocity. A rotation whose plane is parallel to the mirror keeps its sense.
fn turned<const A: usize>(omega: Vector<f64, A>) -> Vector<f64, A> {
    if A == 3 { reflected(-omega) } else { -omega }
}

fn mirrored<const L: usize, const A: usize>(system: &System<f64, L, A>) -> System<f64, L, A> {
    let mut mirror = system.clone();
    for velocity in &mut mirror.velocities {
        *velocity =
            Velocity { linear: reflected(velocity.linear), angular: turned(velocity.angular) };
    }
    for mass in &mut mirror.masses {
        // R W R with R = diag(turned(1)): entries that couple the first axis to the others change
        // sign.
        let sign = turned(Vector([1.0; A]));
        let entry = |i: usize, j: usize| mass.angular.0[i][j] * sign[i] * sign[j];
        let rows = std::array::from_fn(|i| Vector(std::array::from_fn(|j| entry(i, j))));
        mass.angular = SymmetricMatrix(rows);
    }
    for manifold in &mut mirror.manifolds {
        manifold.frame.axes = manifold.frame.axes.map(reflected);
        manifold.frame.arms = manifold.frame.arms.map(reflected);
        // The mirror image of a right-handed frame is left-handed. Reversing its last axis makes it
        // right-handed again.
        manifold.frame.axes[L - 1] = -manifold.frame.axes[L - 1];
    }
    for contact in &mut mirror.contacts {
        contact.offset[L - 1] = -contact.offset[L - 1];
    }
    mirror
}

/// The mirror image of a system gives the mirror image of its answer, friction included.
fn mirror<const L: usize, const A: usize>(seed: u64) {
    let mut system = any_scene::<L, A>(&mut Random(seed)).system;
    let mut image = mirrored(&system);
    image.prepare(0.1);
    system.prepare(0.1);
    for _ in 0..6 {
        pgs::sweep(&mut system);
        pgs::sweep(&mut image);
    }
    assert_all_close(flat(&mirrored(&image)), flat(&system), 1e-12);
    assert_all_close(normals(&image), normals(&system), 1e-12);
}

/// Exchanging bodies a and b of each contact changes nothing if the frame is rotated accordingly.
fn exchange<const L: usize, const A: usize>(seed: u64) {
    let mut system = any_scene::<L, A>(&mut Random(seed)).system;
    let mut exchanged = system.clone();
    for manifold in &mut exchanged.manifolds {
        manifold.bodies.reverse();
        manifold.frame.arms.reverse();
        // Rotates by half a turn: about the last tangent in 3D, about the point in 2D.
        for axis in &mut manifold.frame.axes[..2] {
            *axis = -*axis;
        }
    }
    for contact in &mut exchanged.contacts {
        for i in 0..2 {
            contact.offset[i] = -contact.offset[i];
        }
    }
    exchanged.prepare(0.0);
    for _ in 0..6 {
        pgs::sweep(&mut system);
        pgs::sweep(&mut exchanged);
    }
    assert_all_close(flat(&exchanged), flat(&system), 1e-10);
}

proptest! {
    #[test]
    fn f32_and_f64(seed in any::<u64>()) {
        in_all_four!(single_precision, seed);
    }

    #[test]
    fn lanes_and_one(seed in any::<u64>()) {
        in_all_four!(lanes_and_scalars, seed);
        in_all_four!(kept_and_anew, seed);
    }

    #[test]
    fn order_of_contacts(seed in any::<u64>()) {
        in_all_four!(any_order, seed);
    }

    #[test]
    fn mirror_images(seed in any::<u64>()) {
        in_all_four!(mirror, seed);
    }

    #[test]
    fn bodies_a_and_b_exchanged(seed in any::<u64>()) {
        in_all_four!(exchange, seed);
    }
}

/// Counts the operations of a sweep over `contacts` contacts that all act on one body. This is the
/// worst case for a method that searches for the contacts of a body.
fn operations<const L: usize, const A: usize>(
    contacts: usize,
    sweep: fn(&mut System<Counting, L, A>),
) -> u64 {
    let random = &mut Random(7);
    let mut scene = Scene::<L, A>::new();
    let hub = scene.ball(Vector::ZERO, 1.0);
    for _ in 0..contacts {
        let position = random.unit();
        let ball = scene.ball(position, 1.0);
        scene.touch([hub, ball], -position, &[position * 0.5]);
    }
    scene.system.prepare(0.0);
    let mut system: System<Counting, L, A> = scene.system.cast();
    Counting::during(|| sweep(&mut system))
}

fn linear_cost<const L: usize, const A: usize>() {
    for sweep in [pgs::sweep, pgs::sweep_normals, pgs::relax] as [fn(&mut System<_, L, A>); 3] {
        let one = operations(1, sweep);
        assert!(one > 0);
        for contacts in [2, 10, 50, 1000] {
            assert_eq!(operations(contacts, sweep), contacts as u64 * one);
        }
    }
}

#[test]
fn a_sweep_costs_the_same_for_every_contact() {
    in_all_four!(linear_cost);
}
