//! Time of the sweep alone per manifold, beside the limits of the machine.

use std::hint::black_box;
use std::time::Instant;

use drystone_solver::certificate::CertificateScratch;
use drystone_solver::island::Islands;
use drystone_solver::lanes::{Instructions, LaneSystem, Lanes, Portable, WIDTH};
use drystone_solver::{
    ConstraintFrame, Contact, InverseMass, Manifold, Mobility, Real, Repair, SymmetricMatrix,
    System, Vector, Velocity, contact_frame, pgs,
};

use crate::counting::Counting;

/// Numbers of manifolds that fit in the second-level cache, and that fit in no cache.
const COUNTS: [usize; 2] = [512, 200_000];

/// Visits to manifolds per measurement.
const VISITS: usize = 20_000_000;

/// Prints a table of all systems.
pub(crate) fn run() {
    let [operations, bytes] = [peak(), bandwidth()];
    println!(
        "This machine, one core: {operations:.1} products and sums of f32 per ns in {WIDTH} lanes, \
         {bytes:.1} bytes per ns from memory.\n"
    );
    println!(
        "| system | points | sweep | operations | cached ns | of peak | from memory ns | bytes | of bandwidth |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let limits = [operations, bytes];
    case::<3, 3>("rigid, 3D", 4, limits);
    case::<3, 3>("rigid, 3D", 1, limits);
    case::<2, 1>("rigid, 2D", 2, limits);
    case::<3, 0>("particles, 3D", 1, limits);
    case::<2, 0>("particles, 2D", 1, limits);
    println!("\n| pass over manifolds of 4 points, 3D, cached | ns per manifold |");
    println!("|---|---|");
    for (name, least) in passes() {
        println!("| {name} | {least:.1} |");
    }
}

/// Measures the passes of a certified step over its contacts; each time is the least of all rounds.
/// \[ns per manifold\]
fn passes() -> [(&'static str, f64); 6] {
    let count = COUNTS[0];
    let system = row::<f32, 3, 3>(count, 4);
    let still = vec![Velocity::ZERO; system.velocities.len()];
    let repair = Repair { dt: 2e-3, rate: 0.2, slop: 0.0, max_repair_speed: 1.0, stick_rate: 20.0 };
    let (mut lanes, mut islands, mut scratch) =
        (LaneSystem::new(), Islands::default(), CertificateScratch::default());
    islands.find(&system);
    scratch.set_masses(&system);
    let mut velocities = system.velocities.clone();
    let before = velocities.clone();
    let mut out = [
        ("packing and effective masses", f64::INFINITY),
        ("warm start", f64::INFINITY),
        ("targets", f64::INFINITY),
        ("iteration of conjugate gradients", f64::INFINITY),
        ("certificate, impulses at hand", f64::INFINITY),
        ("certificate, best impulses on the line", f64::INFINITY),
    ];
    for _ in 0..500 {
        velocities.clone_from(&before);
        let mut passes = out.iter_mut();
        let mut time = |work: &mut dyn FnMut()| {
            let start = Instant::now();
            work();
            let taken = 1e9 * start.elapsed().as_secs_f64() / count as f64;
            if let Some((_, least)) = passes.next() {
                *least = least.min(taken);
            }
        };
        time(&mut || lanes.pack(&system, &system.masses, 0.1));
        time(&mut || lanes.whole(&mut []).apply_impulses(&mut velocities));
        time(&mut || lanes.set_targets(&still, None, &repair));
        lanes.set_islands(&islands);
        lanes.begin_conjugate();
        // The first iteration has no search direction yet.
        lanes.conjugate(&mut velocities, &[false]);
        time(&mut || lanes.conjugate(&mut velocities, &[false]));
        time(&mut || {
            black_box(lanes.certify::<false, false>(&velocities, &before, &islands, &mut scratch));
        });
        time(&mut || {
            black_box(lanes.certify::<false, true>(&velocities, &before, &islands, &mut scratch));
        });
    }
    out
}

fn case<const L: usize, const A: usize>(name: &str, points: usize, [peak, bandwidth]: [f64; 2]) {
    for (sweep, friction) in [("normals", false), ("normals and friction", true)] {
        let operations = operations::<L, A>(points, friction) as f64;
        let bytes = bytes::<L, A>(points) as f64;
        let [cached, streamed] = COUNTS.map(|count| time::<L, A>(count, points, friction));
        println!(
            "| {name} | {points} | {sweep} | {operations} | {cached:.1} | {:.0} % | {streamed:.1} | \
             {bytes} | {:.0} % |",
            100.0 * operations / peak / cached,
            100.0 * bytes / bandwidth / streamed,
        );
    }
}

/// Makes a row of bodies in which each touches the next with a manifold of `points` points.
fn row<T: Real, const L: usize, const A: usize>(count: usize, points: usize) -> System<T, L, A> {
    let mut system = System::new();
    let number = T::from_f64;
    for i in 0..=count {
        let mut angular = SymmetricMatrix::ZERO;
        for k in 0..A {
            angular.0[k][k] = number(6.0 + 0.1 * k as f64);
        }
        let mut linear = Vector::ZERO;
        linear[0] = number(0.1 * (i as f64).sin());
        linear[1] = number(-0.1);
        system.add_body(
            Velocity { linear, angular: Vector::ZERO },
            InverseMass { linear: T::ONE, angular },
        );
    }
    let mut up = Vector::<f64, L>::ZERO;
    up[1] = 1.0;
    let axes = contact_frame(up).map(|axis| Vector(axis.0.map(number)));
    let arm = |side: f64| {
        let mut arm = Vector::ZERO;
        arm[1] = number(0.5 * side);
        arm
    };
    let corners = [[0.5, 0.5], [-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]];
    let contacts: Vec<Contact<T, L>> = (corners[..points].iter())
        .map(|corner| {
            let mut contact = Contact::default();
            // A single point is at the center.
            if A > 0 && points > 1 {
                for i in 1..L {
                    contact.offset[i] = number(corner[i - 1]);
                }
            }
            contact
        })
        .collect();
    for i in 0..count as u32 {
        let bodies = [i + 1, i];
        let friction = number(0.5);
        let frame = ConstraintFrame { axes, arms: [arm(-1.0), arm(1.0)] };
        system.add_manifold(Manifold { bodies, frame, friction, ..Manifold::default() }, &contacts);
    }
    system
}

/// Returns the least time of a sweep. \[ns per manifold\]
fn time<const L: usize, const A: usize>(count: usize, points: usize, friction: bool) -> f64 {
    let system = row::<f32, L, A>(count, points);
    let mut lanes = LaneSystem::new();
    lanes.pack(&system, &system.masses, 0.1);
    let mut velocities = system.velocities.clone();
    let mut least = f64::INFINITY;
    for _ in 0..VISITS / count {
        velocities.clone_from(&system.velocities);
        let mut whole = lanes.whole(&mut []);
        let start = Instant::now();
        if friction {
            whole.sweep(&mut velocities);
        } else {
            whole.sweep_normals(&mut velocities);
        }
        least = least.min(start.elapsed().as_secs_f64());
    }
    black_box(&velocities);
    1e9 * least / count as f64
}

/// Returns the bytes that a visit reads and writes in memory: contact points, shared data of the
/// manifold, and two bodies. Symmetric matrices count by half. Rotational data does not count for a
/// single point, which is at the center.
fn bytes<const L: usize, const A: usize>(points: usize) -> usize {
    let half = |n: usize| n * (n + 1) / 2;
    let turning = if points > 1 { L * A + half(A) } else { 0 };
    let masses = 2 * (1 + half(A));
    let shared = L * L + 2 * L + 1 + masses + half(L) + turning;
    // Impulses and velocities are written back.
    let point = size_of::<Contact<f32, L>>() + L * size_of::<f32>();
    points * point + shared * size_of::<f32>() + 4 * size_of::<Velocity<f32, L, A>>()
}

/// Counts the arithmetic operations of a visit.
fn operations<const L: usize, const A: usize>(points: usize, friction: bool) -> u64 {
    let mut system = row::<Counting, L, A>(1, points);
    system.prepare(Counting(0.1));
    let manifold = system.manifolds[0];
    let masses = system.masses_of(&manifold);
    let known = Counting::during(|| {
        black_box(Mobility::of(&manifold.frame, &masses));
    });
    let sweep = if friction { pgs::sweep } else { pgs::sweep_normals };
    Counting::during(|| sweep(&mut system)) - known
}

/// Measures products and sums per nanosecond, with [`WIDTH`] lanes and enough independent chains.
/// \[1/ns\]
fn peak() -> f64 {
    #[cfg(target_arch = "x86_64")]
    if Instructions::available().contains(&Instructions::Avx2) {
        return rate::<drystone_solver::lanes::Avx2>();
    }
    rate::<Portable>()
}

fn rate<V: Lanes>() -> f64 {
    const CHAINS: usize = 6;
    const ROUNDS: usize = 10_000;
    let mut best = 0.0f64;
    for _ in 0..2000 {
        let start = Instant::now();
        let sums = V::run(
            #[inline(always)]
            || {
                let factor = V::from_array([black_box(0.999); WIDTH]);
                let mut sums = [V::ONE; CHAINS];
                for _ in 0..ROUNDS {
                    for sum in &mut sums {
                        *sum = *sum * factor + V::ONE;
                    }
                }
                sums
            },
        );
        black_box(sums);
        let operations = (2 * CHAINS * ROUNDS * WIDTH) as f64;
        best = best.max(operations / (1e9 * start.elapsed().as_secs_f64()));
    }
    best
}

/// Measures the bytes read per nanosecond from memory beyond all caches. \[1/ns\]
fn bandwidth() -> f64 {
    let numbers = vec![1u64; 1 << 25];
    let mut best = 0.0f64;
    for part in (0..4).flat_map(|_| numbers.chunks(1 << 17)) {
        let start = Instant::now();
        black_box(part.iter().fold(0u64, |sum, x| sum.wrapping_add(*x)));
        best = best.max(size_of_val(part) as f64 / (1e9 * start.elapsed().as_secs_f64()));
    }
    best
}
