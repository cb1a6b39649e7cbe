//! Tests of joints against closed forms: motion, forces and energy, as for bakes and in real time.

mod apart;
mod blows;
mod drives;
mod extremes;
mod held;
mod loads;
mod machines;
mod rests;
mod spins;
mod springs;
mod swings;
mod tops;
mod world;

use drystone::geometry::Geometry;
use drystone::{Body, BodyId, Dimension, Inertia, Joint, JointId, Motion, StepSettings, World};
use drystone_solver::{SymmetricMatrix, Vector, Velocity};

use crate::common::*;

/// Gravitational acceleration. \[m/s^2\]
pub(super) const ACCELERATION: f64 = 9.81;

/// Settings under test, and the error that they may have.
#[derive(Clone)]
pub(super) struct Preset {
    pub(super) name: &'static str,
    pub(super) settings: StepSettings,
    /// Largest error of a period, a speed or a force, as a part of it. \[1\]
    pub(super) part: f64,
    /// Largest change of an energy, as a part of what the mechanism can convert. \[1\]
    pub(super) energy: f64,
    /// Largest gap of a machine that moves. \[m\]
    pub(super) gap: f64,
}

impl Preset {
    pub(super) fn bake() -> Self {
        let settings = StepSettings::certified();
        Self { name: "bake", settings, part: 0.005, energy: 0.01, gap: 1e-5 }
    }

    pub(super) fn real_time() -> Self {
        let settings = StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() };
        Self { name: "real time", settings, part: 0.03, energy: 0.02, gap: 1e-4 }
    }

    pub(super) fn both() -> [Self; 2] {
        [Self::bake(), Self::real_time()]
    }

    /// Returns an empty world with gravity along -y.
    pub(super) fn world<G: Dimension<L, A>, const L: usize, const A: usize>(
        &self,
    ) -> World<G, L, A> {
        let mut world = self.weightless();
        world.gravity = Vector(v(0.0, -GRAVITY, 0.0));
        world
    }

    pub(super) fn weightless<G: Dimension<L, A>, const L: usize, const A: usize>(
        &self,
    ) -> World<G, L, A> {
        World::new(self.settings.clone())
    }

    /// Compares a measured value with the expected one.
    #[track_caller]
    pub(super) fn check(&self, what: &str, measured: f64, expected: f64) {
        self.check_of(what, measured, expected, expected.abs());
    }

    /// Compares a measured value with the expected one; the error is a part of `scale`.
    #[track_caller]
    pub(super) fn check_of(&self, what: &str, measured: f64, expected: f64, scale: f64) {
        let error = (measured - expected) / scale;
        let found = format!("{}, {what}: {measured}, expected {expected}", self.name);
        println!("{found}, error {:.5} %", 100.0 * error);
        assert!(error.abs() <= self.part, "{found}");
    }

    /// Requires an error to be at most `bound`.
    #[track_caller]
    pub(super) fn below(&self, what: &str, measured: f64, bound: f64) {
        let found = format!("{}, {what}: {measured:e}, at most {bound:e}", self.name);
        println!("{found}");
        assert!(measured <= bound, "{found}");
    }
}

/// Returns an inertia with these principal moments about x, y and z; in the plane that about z.
pub(super) fn inertia<const L: usize, const A: usize>(
    mass: f64,
    moments: [f64; 3],
) -> Inertia<L, A> {
    let own = |i: usize| moments[if A == 1 { 2 } else { i }] as f32;
    let moments = Vector(std::array::from_fn(own));
    Inertia {
        mass: mass as f32,
        center: Vector::ZERO,
        moments: SymmetricMatrix::diagonal(moments),
        inverse_moments: SymmetricMatrix::diagonal(Vector(moments.0.map(|own| 1.0 / own))),
    }
}

/// Part of the moment of a rod across its axis that it has about its axis. \[1\]
pub(super) const ROD: f64 = 2e-3;

/// Returns the inertia of a thin rod along x.
pub(super) fn thin_rod<const L: usize, const A: usize>(mass: f64, length: f64) -> Inertia<L, A> {
    let across = mass * length * length / 12.0;
    inertia(mass, [ROD * across, across, across])
}

/// Returns the inertia of a box with these half-extents.
pub(super) fn block<const L: usize, const A: usize>(mass: f64, half: [f64; 3]) -> Inertia<L, A> {
    let [x, y, z] = half.map(|half| mass * half * half / 3.0);
    inertia(mass, [y + z, x + z, x + y])
}

/// Returns a body that touches nothing.
pub(super) fn ghost<G: RoundShapes<L, A>, const L: usize, const A: usize>(
    position: [f64; 3],
    inertia: Inertia<L, A>,
) -> Body<G, L, A> {
    let [x, y, z] = position.map(|own| own as f32);
    let mut body = Body::new(Motion::Dynamic, v(x, y, z), G::ball(0.01));
    body.colliders.clear();
    body.inertia = Some(inertia);
    body
}

/// Returns a body at rest along the line between two points of the plane of x and y. Its x axis
/// points to the second one.
pub(super) fn bar<G: Rigid<L, A>, const L: usize, const A: usize>(
    [from, to]: [[f64; 2]; 2],
    inertia: Inertia<L, A>,
) -> Body<G, L, A> {
    let center = [0, 1].map(|i: usize| 0.5 * (from[i] + to[i]));
    let mut body = ghost([center[0], center[1], 0.0], inertia);
    let angle = (to[1] - from[1]).atan2(to[0] - from[0]);
    body.pose = G::turned(v(center[0] as f32, center[1] as f32, 0.0), angle as f32);
    body
}

/// Returns a velocity in the plane of x and y.
pub(super) fn in_plane<const L: usize, const A: usize>(
    [x, y]: [f64; 2],
    angular: f64,
) -> Velocity<f32, L, A> {
    let own = |i: usize| if A == 1 || i == 2 { angular as f32 } else { 0.0 };
    Velocity {
        linear: Vector(v(x as f32, y as f32, 0.0)),
        angular: Vector(std::array::from_fn(own)),
    }
}

/// Returns a hinge about z at a point of the plane of x and y.
pub(super) fn pin<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: [Option<BodyId>; 2],
    [x, y]: [f64; 2],
) -> Joint<G, L, A> {
    Joint::hinge(bodies).at(v(x as f32, y as f32, 0.0)).about(v(0.0, 0.0, 1.0))
}

/// Returns the angle of the x axis of a body in the plane of x and y, from the x axis. \[rad\]
pub(super) fn heading<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: BodyId,
) -> f64 {
    let axis = G::frame(&world.pose(id).unwrap()).axes[0];
    f64::from(axis[1]).atan2(f64::from(axis[0]))
}

/// Returns the angle of the x axis of a body from straight down. \[rad\]
pub(super) fn hanging<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: BodyId,
) -> f64 {
    let axis = G::frame(&world.pose(id).unwrap()).axes[0];
    f64::from(axis[0]).atan2(-f64::from(axis[1]))
}

/// Returns the value of the last axis of a joint. \[m, or rad\]
pub(super) fn value<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: JointId,
) -> f64 {
    *world.joint(id).unwrap().values.last().unwrap()
}

/// Returns the speed of the last axis of a joint. \[m/s, or rad/s\]
pub(super) fn speed<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: JointId,
) -> f64 {
    *world.joint(id).unwrap().speeds.last().unwrap()
}

/// Returns the times at which samples, one per frame from `DT` on, change their sign, by linear
/// interpolation. \[s\]
pub(super) fn crossings(samples: &[f64]) -> Vec<f64> {
    let pairs = samples.windows(2).enumerate();
    pairs
        .filter(|(_, pair)| (pair[0] < 0.0) != (pair[1] < 0.0))
        .map(|(i, pair)| (i as f64 + 1.0 + pair[0] / (pair[0] - pair[1])) * f64::from(DT))
        .collect()
}

/// Returns the mean period of samples that change their sign twice in each. \[s\]
pub(super) fn period(samples: &[f64]) -> f64 {
    let times = crossings(samples);
    let count = (times.len() - 1) / 2 * 2;
    2.0 * (times[count] - times[0]) / count as f64
}
