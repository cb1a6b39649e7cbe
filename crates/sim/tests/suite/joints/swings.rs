//! Pendulums of rods and points, springs and ropes.

use std::f64::consts::{FRAC_PI_2, TAU};

use drystone::geometry::{Particles, Rigid2, Rigid3};
use drystone::{Coordinate, Drive, Joint, JointAxis, World};
use drystone_solver::Vector;

use super::*;

/// Returns the bar of length `length` that hangs from a point at an angle. \[m, rad\]
fn hung<G: Rigid<L, A>, const L: usize, const A: usize>(
    from: [f64; 2],
    length: f64,
    angle: f64,
) -> ([f64; 2], Body<G, L, A>) {
    let end = [from[0] + length * angle.sin(), from[1] - length * angle.cos()];
    (end, bar([from, end], thin_rod(1.0, length)))
}

fn pendulum<G: Rigid<L, A>, const L: usize, const A: usize>(
    preset: &Preset,
    degrees: f64,
    expected: f64,
) {
    let mut world: World<G, L, A> = preset.world();
    let body = world.add(hung([0.0; 2], 1.0, degrees.to_radians()).1).unwrap();
    let joint = world.join(pin([Some(body), None], [0.0; 2])).unwrap();
    let start = energy(&world);
    let (mut speeds, mut worst, mut gap, mut force) = (Vec::new(), 0.0f64, 0.0f64, 0.0f64);
    for _ in 0..1200 {
        let report = world.step(DT).unwrap();
        speeds.push(speed(&world, joint));
        worst = worst.max((energy(&world) - start).abs());
        gap = gap.max(report.joint_gap[0]);
        force = force.max(world.joint(joint).unwrap().force);
    }
    let name = format!("{L}D pendulum {degrees}");
    preset.check(&format!("{name}: period"), period(&speeds), expected);
    preset.below(&format!("{name}: energy"), worst / (0.5 * ACCELERATION), preset.energy);
    preset.below(&format!("{name}: gap"), gap, preset.gap);
    // m g (1 + 3/2 (1 - cos a)) at the bottom.
    let bottom = ACCELERATION * (1.0 + 1.5 * (1.0 - degrees.to_radians().cos()));
    preset.check(&format!("{name}: force"), force, bottom);
}

/// A thin rod of 1 m swings with the period 4 K(sin(a/2)) / sqrt(3 g/2).
#[test]
fn a_pendulum_keeps_its_period_and_its_energy() {
    for preset in Preset::both() {
        for (degrees, expected) in [(90.0, 1.93333), (150.0, 2.88640)] {
            pendulum::<Rigid2, 2, 1>(&preset, degrees, expected);
            pendulum::<Rigid3, 3, 3>(&preset, degrees, expected);
        }
    }
}

fn double_pendulum<G: Rigid<L, A>, const L: usize, const A: usize>(preset: &Preset) {
    let mut world: World<G, L, A> = preset.world();
    let (elbow, upper) = hung([0.0; 2], 0.5, FRAC_PI_2);
    let bodies = [upper, hung(elbow, 0.5, FRAC_PI_2).1].map(|body| world.add(body).unwrap());
    world.join(pin([Some(bodies[0]), None], [0.0; 2])).unwrap();
    world.join(pin([Some(bodies[1]), Some(bodies[0])], elbow)).unwrap();
    let start = energy(&world);
    let mut worst = 0.0f64;
    let expected = [[0.0554857, -0.504547], [-1.35026, -1.87848]];
    for step in 1..=1200 {
        world.step(DT).unwrap();
        worst = worst.max((energy(&world) - start).abs());
        if step == 30 || step == 60 {
            for (i, body) in bodies.into_iter().enumerate() {
                let name = format!("{L}D double pendulum {i} after {step} frames");
                let (found, expected) = (hanging(&world, body), expected[step / 30 - 1][i]);
                preset.check_of(&name, found, expected, FRAC_PI_2);
            }
        }
    }
    // From level, m g l/2 (1 + 3) are below.
    preset.below(&format!("{L}D double pendulum: energy"), worst / ACCELERATION, preset.energy);
}

/// Two thin rods of 0.5 m that are let go level, against an integration with steps of 0.1 ms.
#[test]
fn a_double_pendulum_follows_its_equations() {
    for preset in Preset::both() {
        double_pendulum::<Rigid2, 2, 1>(&preset);
        double_pendulum::<Rigid3, 3, 3>(&preset);
    }
}

fn point_pendulum<G: RoundShapes<L, A>, const L: usize, const A: usize>(preset: &Preset) {
    let mut world: World<G, L, A> = preset.world();
    let body = world.add(ghost([1.0, 0.0, 0.0], inertia(1.0, [1.0; 3]))).unwrap();
    let joint = Joint::distance([Some(body), None], 1.0).in_bodies(frames::<G, L, A>());
    let joint = world.join(joint).unwrap();
    let start = energy(&world);
    let (mut speeds, mut worst, mut force) = (Vec::new(), 0.0f64, 0.0f64);
    for _ in 0..1200 {
        world.step(DT).unwrap();
        speeds.push(f64::from(place(&world, body)[0]));
        worst = worst.max((energy(&world) - start).abs());
        force = force.max(world.joint(joint).unwrap().force);
    }
    let name = format!("{L}D point on a distance");
    preset.check(&format!("{name}: period"), period(&speeds), 2.36784);
    preset.below(&format!("{name}: energy"), worst / ACCELERATION, preset.energy);
    preset.check(&format!("{name}: force"), force, 3.0 * ACCELERATION);
}

/// Returns frames at the centers of two bodies.
fn frames<G: Geometry<L, A>, const L: usize, const A: usize>() -> [G::Pose; 2] {
    [0, 1].map(|_| G::pose(Vector::ZERO, &[0.0, 0.0, 0.0, 1.0][..if A == 3 { 4 } else { 0 }]))
}

fn rope<G: RoundShapes<L, A>, const L: usize, const A: usize>(preset: &Preset) {
    let mut world: World<G, L, A> = preset.world();
    let body = world.add(ghost([0.0, -0.5, 0.0], inertia(1.0, [1.0; 3]))).unwrap();
    let joint = Joint::rope([Some(body), None], 1.0).in_bodies(frames::<G, L, A>());
    let joint = world.join(joint).unwrap();
    let (mut longest, mut slack) = (0.0f64, 0.0f64);
    for step in 0..180 {
        world.step(DT).unwrap();
        longest = longest.max(value(&world, joint));
        if step < 18 {
            slack = slack.max(world.joint(joint).unwrap().force);
        }
    }
    let state = world.joint(joint).unwrap();
    let name = format!("{L}D rope");
    preset.below(&format!("{name}: slack force"), slack, 0.0);
    preset.below(&format!("{name}: length"), longest - 1.0, preset.gap);
    preset.below(&format!("{name}: speed at rest"), state.speeds[0].abs(), 1e-3);
    preset.check(&format!("{name}: force"), state.force, ACCELERATION);
}

/// A particle on a distance swings by 4 K(sin(45)) sqrt(l/g). A rope lets it fall for its length.
#[test]
fn particles_swing_on_distances_and_hang_on_ropes() {
    for preset in Preset::both() {
        point_pendulum::<Particles, 2, 0>(&preset);
        point_pendulum::<Particles, 3, 0>(&preset);
        point_pendulum::<Rigid3, 3, 3>(&preset);
        rope::<Particles, 2, 0>(&preset);
        rope::<Particles, 3, 0>(&preset);
        rope::<Rigid2, 2, 1>(&preset);
    }
}

/// Returns the times and values of the maxima of samples, by parabolas.
fn peaks(samples: &[f64]) -> Vec<[f64; 2]> {
    let triples = samples.windows(3).enumerate();
    let top = triples.filter(|(_, of)| of[0] < of[1] && of[1] >= of[2]);
    top.map(|(i, of)| {
        let (slope, bend) = (0.5 * (of[2] - of[0]), of[0] - 2.0 * of[1] + of[2]);
        let time = (i as f64 + 2.0 - slope / bend) * f64::from(DT);
        [time, of[1] - 0.5 * slope * slope / bend]
    })
    .collect()
}

/// 2 kg on 200 N/m and 4 N s/m swing with T = 2 pi / (w sqrt(1 - zeta^2)), and each swing is
/// exp(-zeta w T) of the one before.
#[test]
fn a_spring_swings_and_fades_as_its_equation() {
    for preset in Preset::both() {
        let drive = Drive::spring(0.1, 200.0, 4.0);
        let omega = 10.0;
        let by_frequency = Drive::frequency(0.1, omega / TAU, 0.1);
        for (name, drive) in [("stiffness", drive), ("frequency", by_frequency)] {
            let mut world: World<Rigid3, 3, 3> = preset.weightless();
            let body = ghost([0.0; 3], inertia(2.0, [0.1; 3]));
            let body = world.add(body).unwrap();
            let slider = Joint::slider([Some(body), None]).drive(drive);
            let slider = world.join(slider).unwrap();
            let mut samples = Vec::new();
            for _ in 0..180 {
                world.step(DT).unwrap();
                samples.push(world.joint(slider).unwrap().values[0] - 0.1);
            }
            let peaks = peaks(&samples);
            let period = (peaks[3][0] - peaks[0][0]) / 3.0;
            let ratio = (peaks[3][1] / peaks[0][1]).cbrt();
            preset.check(&format!("spring by {name}: period"), period, 0.631484);
            preset.check(&format!("spring by {name}: ratio"), ratio, 0.531802);
        }
    }
}

/// 1 kg half a meter from a hinge is slowed by its damping, whatever its moment about its own center:
/// the hinge makes it heavier than a free body. I dw/dt = -d w with I = 0.25 m + I_0.
#[test]
fn damping_slows_what_locks_hold() {
    for preset in Preset::both() {
        for (own, stiffness) in [(0.01, 1e-3), (0.001, 1e-3), (0.001, 0.0)] {
            let mut world: World<Rigid3, 3, 3> = preset.weightless();
            let mut body = ghost([0.5, 0.0, 0.0], inertia(1.0, [own; 3]));
            body.velocity.linear = Vector([0.0, 0.5, 0.0]);
            body.velocity.angular = Vector([0.0, 0.0, 1.0]);
            let body = world.add(body).unwrap();
            let hinge = Joint::hinge([Some(body), None]).at([0.0; 3]).about([0.0, 0.0, 1.0]);
            let hinge = world.join(hinge.drive(Drive::spring(0.0, stiffness, 1.0))).unwrap();
            run(&mut world, 0.5);
            let moment = 0.25 + own;
            let expected = moment * (1.0 - (-0.5f64 / moment).exp());
            let angle = value(&world, hinge);
            preset.check(&format!("damped with {own} kg m^2, {stiffness} N m"), angle, expected);
        }
    }
}

/// 1 kg on a spring without damping, along the line of two points, keeps its amplitude.
#[test]
fn a_spring_without_damping_keeps_its_energy() {
    for preset in Preset::both() {
        let mut world: World<Particles, 3, 0> = preset.world();
        let body = world.add(ghost([0.0, -1.0, 0.0], inertia(1.0, [1.0; 3]))).unwrap();
        let spring = Joint::spring([Some(body), None], Drive::spring(1.0, 100.0, 0.0));
        let spring = world.join(spring.in_bodies(frames::<Particles, 3, 0>())).unwrap();
        let mut samples = Vec::new();
        for _ in 0..1200 {
            world.step(DT).unwrap();
            samples.push(value(&world, spring) - 1.0 - ACCELERATION / 100.0);
        }
        let peaks = peaks(&samples);
        let (first, last) = (peaks[0], peaks[peaks.len() - 1]);
        let period = (last[0] - first[0]) / (peaks.len() - 1) as f64;
        preset.check("free spring: period", period, TAU / 10.0);
        preset.check("free spring: amplitude", first[1], ACCELERATION / 100.0);
        let lost = (last[1] / first[1] - 1.0).abs();
        preset.below("free spring: change of the amplitude", lost, preset.energy);
    }
}

/// Thin rods whose ball joint is at their end circle about the vertical. Their moment about their
/// own axis counts: w^2 = m g l / (2 cos a (I_pivot - I_axis)).
#[test]
fn a_conical_pendulum_circles() {
    let (tilt, length) = (30.0f64.to_radians(), 1.0);
    let moment = (1.0 - ROD / 4.0) / 3.0;
    let rate = (ACCELERATION * length / (2.0 * tilt.cos() * moment)).sqrt();
    for preset in Preset::both() {
        let mut world: World<Rigid3, 3, 3> = preset.world();
        let mut body = hung([0.0; 2], length, tilt).1;
        body.velocity.angular = Vector([0.0, rate as f32, 0.0]);
        body.velocity.linear = Vector([0.0, 0.0, (-rate * 0.5 * tilt.sin()) as f32]);
        let body = world.add(body).unwrap();
        let joint = world.join(Joint::ball([Some(body), None]).at([0.0; 3])).unwrap();
        let (mut turned, mut before, mut tilts) = (0.0, 0.0, [f64::MAX, 0.0f64]);
        for _ in 0..600 {
            world.step(DT).unwrap();
            let at = place(&world, body).cast::<f64>();
            let azimuth = (-at[2]).atan2(at[0]);
            turned += (azimuth - before + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
            before = azimuth;
            let own = (at[0].hypot(at[2])).atan2(-at[1]);
            tilts = [tilts[0].min(own), tilts[1].max(own)];
        }
        preset.check("conical: rate", turned / (600.0 * f64::from(DT)), 4.12206);
        preset.check("conical: least tilt", tilts[0], tilt);
        preset.check("conical: largest tilt", tilts[1], tilt);
        preset.check("conical: force", world.joint(joint).unwrap().force, 10.6902);
    }
}

/// A rod on a level cone, or on a wall, of 30 degrees rests on it with the torque m g l/2 cos 30.
#[test]
fn a_cone_and_a_wall_hold_a_rod() {
    let most = 30.0f64.to_radians();
    let limits = [
        JointAxis::limited(Coordinate::Cone, [0.0, most]),
        JointAxis::limited(Coordinate::EllipticCone([most, most]), [0.0, 1.0]),
        JointAxis::limited(Coordinate::EllipticCone([2.0 * most, most]), [0.0, 1.0]),
        JointAxis::limited(Coordinate::Swing(2), [-most, f64::INFINITY]),
        JointAxis::limited(Coordinate::Cardan(2), [-most, most]),
        JointAxis::limited(Coordinate::Rotation, [0.0, most]),
    ];
    for preset in Preset::both() {
        for limit in &limits {
            let mut world: World<Rigid3, 3, 3> = preset.world();
            let body = world.add(bar([[0.0; 2], [1.0, 0.0]], thin_rod(1.0, 1.0))).unwrap();
            let mut ball = Joint::ball([Some(body), None]);
            ball.axes.push(limit.clone());
            let joint = world.join(ball).unwrap();
            run(&mut world, 3.0);
            let name = format!("cone {:?}", limit.coordinate);
            let state = world.joint(joint).unwrap();
            preset.check(&format!("{name}: torque"), state.torque, 4.24785);
            preset.check(&format!("{name}: angle"), heading(&world, body), -most);
            preset.below(&format!("{name}: miss"), state.angle, 1e-4);
            let spin = velocity(&world, body).angular.length();
            preset.below(&format!("{name}: spin"), f64::from(spin), 1e-2);
        }
    }
}

/// An arm lies against narrow and wide limits of the angles of its ball joint, with a load at its end or
/// without. It stays within them, and gains no energy: the line of a narrow cone turns all around in a substep.
#[test]
fn limits_between_directions_hold_heavy_arms() {
    for preset in Preset::both() {
        for (most, length) in
            [1e-3, 1e-2, 0.1, 1.0].into_iter().flat_map(|most| [(most, 0.03), (most, 1.0)])
        {
            for (load, rate) in [(0.0, 24.0), (0.0, 60.0), (5.0, 24.0), (5.0, 60.0f32)] {
                let ellipse = Coordinate::EllipticCone([most, 0.3 * most]);
                let mut limits = vec![
                    JointAxis::limited(Coordinate::Cone, [0.0, most]),
                    JointAxis::limited(ellipse, [0.0, 1.0]),
                ];
                // Twists of light arms trade places with swings of heavy ones.
                if load == 0.0 || length == 1.0 && most >= 0.1 {
                    limits.push(JointAxis::limited(Coordinate::Rotation, [0.0, most]));
                }
                for limit in limits {
                    let name = format!(
                        "{:?} of {most} rad, {length} m, {load} kg, {rate} per second",
                        limit.coordinate
                    );
                    let [miss, gained] = arm_on(&preset, limit, length, (load, rate));
                    preset.below(&format!("miss of {name}"), miss, 0.02);
                    preset.below(&format!("energy from nothing of {name}"), gained, 0.1);
                }
            }
        }
    }
}

/// Lets an arm of 1 kg fall aside on a limit of its ball joint for 2 s. Returns by how much it misses the limit
/// \[rad\], and the energy that it gains, as a part of that of a fall by the length of the arm.
fn arm_on(preset: &Preset, limit: JointAxis, length: f64, (load, rate): (f64, f32)) -> [f64; 2] {
    let mut world: World<Rigid3, 3, 3> = preset.world();
    world.gravity = Vector([0.0, -8.609, 4.703]);
    let half = [0.5 * length, 0.05 * length, 0.1 * length];
    let arm = world.add(ghost([half[0], 0.0, 0.0], block(1.0, half))).unwrap();
    let mut ball = Joint::ball([Some(arm), None]).at([0.0; 3]);
    ball.axes.push(limit);
    let joint = world.join(ball).unwrap();
    if load > 0.0 {
        let moment = 0.4 * load * (0.1 * length).powi(2);
        let at = [length, -0.3 * length, 0.0];
        let load = world.add(ghost(at, inertia(load, [moment; 3]))).unwrap();
        let pair = [Some(load), Some(arm)];
        world.join(Joint::ball(pair).at([length as f32, 0.0, 0.0])).unwrap();
    }
    let (mut miss, mut least, mut gained) = (0.0f64, f64::INFINITY, 0.0f64);
    for _ in 0..(2.0 * rate) as usize {
        world.step(1.0 / rate).unwrap();
        miss = miss.max(world.joint(joint).unwrap().angle);
        let now = energy(&world);
        least = least.min(now);
        gained = gained.max(now - least);
    }
    [miss, gained / ((1.0 + load) * ACCELERATION * length)]
}

/// Short double pendulums whip around. Substeps that come and go with their speed would take their energy.
#[test]
fn whipping_pendulums_keep_their_energy() {
    for preset in Preset::both() {
        for (length, rate) in [(0.1, 24.0f32), (0.5, 24.0), (0.01, 60.0)] {
            let most = if preset.name == "bake" { 0.1 } else { 0.5 };
            let mut world: World<Rigid2, 2, 1> = preset.world();
            let (elbow, upper) = hung([0.0; 2], length, FRAC_PI_2);
            let (_, lower) = hung(elbow, length, FRAC_PI_2);
            let [upper, lower] = [upper, lower].map(|own| world.add(own).unwrap());
            world.join(pin([Some(upper), None], [0.0; 2])).unwrap();
            world.join(pin([Some(upper), Some(lower)], elbow)).unwrap();
            let start = energy(&world);
            for _ in 0..(10.0 * rate) as usize {
                world.step(1.0 / rate).unwrap();
            }
            let loss = (start - energy(&world)).abs() / (ACCELERATION * length);
            preset.below(&format!("energy of links of {length} m"), loss, most);
        }
    }
}

/// Locks give way by a part of the size of their mechanism: those of a small one take no energy.
#[test]
fn small_pendulums_keep_their_energy() {
    for preset in Preset::both() {
        // In real time a substep does not resolve what is shorter.
        let least = if preset.name == "bake" { 0.01 } else { 0.1 };
        for length in [least, 0.1, 1.0] {
            let mut world: World<Rigid2, 2, 1> = preset.world();
            let body = world.add(hung([0.0; 2], length, FRAC_PI_2).1).unwrap();
            world.join(pin([Some(body), None], [0.0; 2])).unwrap();
            let start = energy(&world);
            run(&mut world, 5.0);
            let loss = (start - energy(&world)).abs() / (0.5 * ACCELERATION * length);
            preset.below(&format!("energy of a pendulum of {length} m"), loss, 0.02);
        }
    }
}
