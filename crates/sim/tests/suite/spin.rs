//! Tests of free rotation: it keeps energy and angular momentum at any speed, and follows the exact
//! solution.

use crate::common::*;
use drystone::geometry::{Frame, Geometry, Rigid3};
use drystone::{BodyId, Inertia, StepSettings, World3};
use drystone_solver::{SymmetricMatrix, Vector, Velocity};

/// A body with these principal moments \[kg m^2\] that rotates freely.
struct Top {
    world: World3,
    id: BodyId,
    moments: [f64; 3],
}

impl Top {
    fn new(settings: StepSettings, moments: [f32; 3], rotation: [f32; 4], omega: [f32; 3]) -> Self {
        let mut world = World3::new(settings);
        let mut top = dynamic([0.0; 3], Rigid3::cuboid([0.1; 3]), &surface(0.5, 0.0));
        top.pose = Rigid3::pose(Vector::ZERO, &rotation);
        top.velocity = Velocity { linear: Vector::ZERO, angular: Vector(omega) };
        top.inertia = Some(Inertia {
            mass: 1.0,
            center: Vector::ZERO,
            moments: SymmetricMatrix::diagonal(Vector(moments)),
            inverse_moments: SymmetricMatrix::diagonal(Vector(moments.map(|moment| 1.0 / moment))),
        });
        let id = world.add(top).unwrap();
        Self { world, id, moments: moments.map(f64::from) }
    }

    /// Returns the axes of the body, orthonormal to `f64`.
    fn axes(&self) -> [[f64; 3]; 3] {
        let Frame { axes, .. } = Rigid3::frame(&self.world.pose(self.id).unwrap());
        let [x, y, _] = axes.map(|axis| axis.0.map(f64::from));
        let x = scaled(x, 1.0 / dot(x, x).sqrt());
        let y = sum(y, scaled(x, -dot(x, y)));
        let y = scaled(y, 1.0 / dot(y, y).sqrt());
        [x, y, cross(x, y)]
    }

    /// Returns the angular velocity along the body's own axes. \[rad/s\]
    fn seen(&self) -> [f64; 3] {
        let omega = velocity(&self.world, self.id).angular.0.map(f64::from);
        self.axes().map(|axis| dot(axis, omega))
    }

    /// Returns the energy \[J\], and the angular momentum in world axes \[kg m^2/s\].
    fn invariants(&self) -> (f64, [f64; 3]) {
        let (seen, axes) = (self.seen(), self.axes());
        let mut momentum = [0.0; 3];
        let mut energy = 0.0;
        for i in 0..3 {
            energy += 0.5 * self.moments[i] * seen[i] * seen[i];
            momentum = sum(momentum, scaled(axes[i], self.moments[i] * seen[i]));
        }
        (energy, momentum)
    }

    /// Returns the largest relative changes of energy and angular momentum in some steps.
    fn drift(&mut self, steps: usize, dt: f32) -> [f64; 2] {
        let (energy, momentum) = self.invariants();
        let mut worst = [0.0f64; 2];
        for _ in 0..steps {
            self.world.step(dt).unwrap();
            let (now, turned) = self.invariants();
            let apart = sum(turned, scaled(momentum, -1.0));
            let changes =
                [(now / energy - 1.0).abs(), (dot(apart, apart) / dot(momentum, momentum)).sqrt()];
            worst = [0, 1].map(|i| worst[i].max(changes[i]));
        }
        worst
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn scaled(a: [f64; 3], by: f64) -> [f64; 3] {
    a.map(|x| x * by)
}

/// Integrates Euler's equations for the angular velocity in body axes, and the axes, by the method
/// of Runge and Kutta.
fn exact(moments: [f64; 3], state: [[f64; 3]; 4], seconds: f64, steps: usize) -> [[f64; 3]; 4] {
    let rate = |[omega, x, y, z]: [[f64; 3]; 4]| {
        let turn = |i: usize| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            (moments[j] - moments[k]) / moments[i] * omega[j] * omega[k]
        };
        // The angular velocity in world axes.
        let spin = sum(sum(scaled(x, omega[0]), scaled(y, omega[1])), scaled(z, omega[2]));
        [[turn(0), turn(1), turn(2)], cross(spin, x), cross(spin, y), cross(spin, z)]
    };
    let h = seconds / steps as f64;
    let ahead = |state: [[f64; 3]; 4], rate: [[f64; 3]; 4], by: f64| {
        std::array::from_fn(|i| sum(state[i], scaled(rate[i], by)))
    };
    let mut state = state;
    for _ in 0..steps {
        let first = rate(state);
        let second = rate(ahead(state, first, 0.5 * h));
        let third = rate(ahead(state, second, 0.5 * h));
        let fourth = rate(ahead(state, third, h));
        for (by, part) in [(1.0, first), (2.0, second), (2.0, third), (1.0, fourth)] {
            state = ahead(state, part, by * h / 6.0);
        }
    }
    state
}

/// Returns the angle between the body and its exact motion \[rad\], and the relative error of its
/// angular velocity.
fn error(top: &Top, start: [[f64; 3]; 4], seconds: f64) -> [f64; 2] {
    let speed = dot(start[0], start[0]).sqrt();
    let [omega, x, y, z] = exact(top.moments, start, seconds, (400.0 * speed * seconds) as usize);
    let apart = sum(omega, scaled(top.seen(), -1.0));
    let axes = top.axes();
    let trace = dot(axes[0], x) + dot(axes[1], y) + dot(axes[2], z);
    let angle = (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos();
    [angle, dot(apart, apart).sqrt() / speed]
}

fn start(top: &Top) -> [[f64; 3]; 4] {
    let [x, y, z] = top.axes();
    [top.seen(), x, y, z]
}

/// Returns the moments of a solid ellipsoid whose axes differ by a factor of up to `spread`.
fn ellipsoid(random: &mut Random, spread: f32) -> [f32; 3] {
    let [a, b, c] = std::array::from_fn(|_| spread.powf(random.between(-1.0, 0.0)));
    [b * b + c * c, a * a + c * c, a * a + b * b]
}

/// Needles, discs and all between keep energy and angular momentum within 1e-4 for 1.5 s. The
/// energy of slender bodies has a wider bound, see below. They rotate at 0.01 to 1000 rad/s, with
/// 24 to 240 steps per second.
#[test]
fn free_bodies_keep_energy_and_momentum() {
    let mut random = Random(3);
    let mut worst = [0.0f64; 2];
    for case in 0..120 {
        let moments = ellipsoid(&mut random, [3.0, 30.0, 1000.0][case % 3]);
        let settings = [StepSettings::realtime(), StepSettings::quality()][case / 3 % 2].clone();
        let rate = [24.0, 60.0, 240.0][case / 6 % 3];
        let speed = 10.0f32.powf(random.between(-2.0, 3.0));
        let omega = random.vector(speed);
        let mut top = Top::new(settings, moments, random.quaternion(), omega);
        let changes = top.drift((1.5 * rate) as usize, 1.0 / rate);
        worst = [0, 1].map(|i| worst[i].max(changes[i]));
        // The rounding of a slender body's angular velocity limits how well its energy is known.
        let spread = moments.iter().fold(0.0f32, |all, own| all.max(*own))
            / moments.iter().fold(f32::MAX, |all, own| all.min(*own));
        let seen = f64::from(1e-4 + 3e-6 * spread.sqrt());
        assert!(
            changes[0] < seen && changes[1] < 1e-4,
            "{moments:?} at {omega:?} rad/s, {rate} steps a second: {changes:?}"
        );
    }
    println!("changes of energy and angular momentum: {worst:?}");
}

/// A tool at 120 rad/s, a needle and a slow panel keep energy and angular momentum for a minute
/// within 1e-3.
#[test]
fn a_minute_of_free_rotation_does_not_drift() {
    for (moments, omega, settings, rate) in [
        ([1.0, 10.0, 10.5], [12.0, 119.0, 12.0], StepSettings::realtime(), 60.0),
        ([1.0, 10.0, 10.5], [6.0, 60.0, 6.0], StepSettings::realtime(), 24.0),
        ([1e-6, 1.0, 1.0], [200.0, 0.1, 0.2], StepSettings::realtime(), 60.0),
        ([0.3, 1.0, 1.2], [0.1, 0.05, 0.02], StepSettings::realtime(), 60.0),
        ([0.3, 1.0, 1.2], [0.1, 0.05, 0.02], StepSettings::quality(), 60.0),
        ([0.3, 1.0, 1.2], [0.01, 0.005, 0.002], StepSettings::quality(), 24.0),
    ] {
        let mut top = Top::new(settings, moments, [0.0, 0.6, 0.0, 0.8], omega);
        let changes = top.drift((60.0 * rate) as usize, 1.0 / rate);
        println!("{moments:?} at {omega:?} rad/s: {changes:?}");
        assert!(changes.iter().all(|change| *change < 1e-3), "{moments:?}, {omega:?}: {changes:?}");
    }
}

/// Ten turns of a tumble about the middle axis follow the exact solution within 0.06 rad.
#[test]
fn a_tumble_follows_the_exact_solution() {
    for (settings, rate, speed) in [
        (StepSettings::quality(), 60.0, 6.0),
        (StepSettings::realtime(), 60.0, 6.0),
        (StepSettings::realtime(), 60.0, 60.0),
        (StepSettings::realtime(), 24.0, 200.0),
    ] {
        let omega = [0.02 * speed, speed, 0.01 * speed];
        let mut top = Top::new(settings, [0.1, 0.26, 0.34], [0.0, 0.0, 0.0, 1.0], omega);
        let start = start(&top);
        let steps = (std::f32::consts::TAU * 10.0 / speed * rate).ceil() as usize;
        (0..steps).for_each(|_| drop(top.world.step(1.0 / rate).unwrap()));
        let seconds = steps as f64 * f64::from(1.0 / rate);
        let [angle, part] = error(&top, start, seconds);
        println!("{speed} rad/s: {angle} rad, {part} of the angular velocity");
        // Rounding of the rotation in each substep shifts the next tumble.
        assert!(angle < 0.06 && part < 0.06, "{speed} rad/s: {angle} rad, {part}");
    }
}

/// Free rotation is of second order: its error is below the square of the angle per substep, plus
/// 5e-5 rad.
#[test]
fn free_rotation_is_of_second_order() {
    let errors = [2, 4, 8, 16, 32, 64].map(|substeps| {
        let settings = StepSettings { substeps, ..StepSettings::realtime() };
        let mut top = Top::new(settings, [0.1, 0.26, 0.34], [0.0, 0.6, 0.0, 0.8], [1.0, 4.0, 2.0]);
        let start = start(&top);
        (0..60).for_each(|_| drop(top.world.step(1.0 / 20.0).unwrap()));
        error(&top, start, 60.0 * f64::from(1.0f32 / 20.0))[0]
    });
    println!("errors with 2 to 64 substeps: {errors:?} rad");
    for (error, doubled) in errors.into_iter().zip(0..) {
        let turn = 21.0_f64.sqrt() / f64::from(20 << (doubled + 1));
        // 5e-5 rad is left for rounding of the rotation.
        assert!(error < turn * turn + 5e-5, "{errors:?}");
    }
}

/// A symmetric top precesses about its angular momentum at L / I, at any speed. The error is below
/// 1e-4 of the angle it has turned by, plus 1e-4 rad.
#[test]
fn a_symmetric_top_is_exact() {
    for (speed, rate) in [(3.0f32, 60.0f32), (60.0, 60.0), (200.0, 24.0)] {
        let omega = [0.8 * speed, 0.6 * speed, 0.0];
        let settings = StepSettings::realtime();
        let mut top = Top::new(settings, [0.3, 0.1, 0.3], [0.0, 0.0, 0.0, 1.0], omega);
        let start = start(&top);
        (0..60).for_each(|_| drop(top.world.step(1.0 / rate).unwrap()));
        let turned = speed * 60.0 / rate;
        let [angle, part] = error(&top, start, 60.0 * f64::from(1.0 / rate));
        println!("{speed} rad/s, turned by {turned} rad: {angle} rad, {part}");
        assert!(angle < 1e-4 * f64::from(turned) + 1e-4 && part < 1e-3, "{speed}: {angle}, {part}");
    }
}
