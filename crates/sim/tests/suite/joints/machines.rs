//! Machines: cranks, shafts, gears, ropes over pulleys, and loops.

use std::f64::consts::{PI, TAU};

use drystone::geometry::{Geometry, Rigid2, Rigid3};
use drystone::{Coordinate, Drive, Joint, JointAxis, World};
use drystone_solver::Vector;

use super::*;

/// A crank of 0.1 m that drives a slider along x over a rod of 0.3 m, at 4 pi rad/s. All bodies
/// have 1 kg.
struct SliderCrank {
    crank: f64,
    rod: f64,
    rate: f64,
}

const ENGINE: SliderCrank = SliderCrank { crank: 0.1, rod: 0.3, rate: 4.0 * PI };

impl SliderCrank {
    /// Returns position and velocity of the slider, and the slope and angular velocity of the rod.
    /// \[m, m/s, rad, rad/s\]
    fn state(&self, angle: f64) -> [f64; 4] {
        let Self { crank, rod, rate } = *self;
        let slope = -(crank * angle.sin() / rod).asin();
        let turn = -crank * angle.cos() * rate / (rod * slope.cos());
        let x = crank * angle.cos() + rod * slope.cos();
        [x, -crank * angle.sin() * rate - rod * slope.sin() * turn, slope, turn]
    }

    /// Returns the kinetic and the potential energy. \[J\]
    fn energy(&self, angle: f64) -> f64 {
        let Self { crank, rod, rate } = *self;
        let [_, slide, slope, turn] = self.state(angle);
        let moment = |length: f64| (0.25 * length * length + 1e-4) / 3.0;
        let center = [
            -crank * angle.sin() * rate - 0.5 * rod * slope.sin() * turn,
            crank * angle.cos() * rate + 0.5 * rod * slope.cos() * turn,
        ];
        let crank = (moment(crank) + 0.25 * crank * crank) * rate * rate;
        let rod = moment(rod) * turn * turn + center[0].powi(2) + center[1].powi(2);
        // Crank and rod have the same height.
        0.5 * (crank + rod + slide * slide) + ACCELERATION * self.crank * angle.sin()
    }
}

fn slider_crank<G: Rigid<L, A>, const L: usize, const A: usize>(preset: &Preset) {
    let SliderCrank { crank, rod, rate } = ENGINE;
    let mut world: World<G, L, A> = preset.world();
    let [x, _, _, turn] = ENGINE.state(0.0);
    let mass = |length: f64| block(1.0, [0.5 * length, 0.01, 0.01]);
    let mut arms = [
        bar([[0.0; 2], [crank, 0.0]], mass(crank)),
        bar([[crank, 0.0], [x, 0.0]], mass(rod)),
        ghost([x, 0.0, 0.0], block(1.0, [0.05, 0.03, 0.03])),
    ];
    arms[0].velocity = in_plane([0.0, 0.5 * crank * rate], rate);
    arms[1].velocity = in_plane([0.0, crank * rate + 0.5 * rod * turn], turn);
    let [arm, link, slider] = arms.map(|body| world.add(body).unwrap());
    let motor = pin([Some(arm), None], [0.0; 2]).drive(Drive::velocity(rate));
    let motor = world.join(motor).unwrap();
    world.join(pin([Some(link), Some(arm)], [crank, 0.0])).unwrap();
    world.join(pin([Some(slider), Some(link)], [x, 0.0])).unwrap();
    world.join(Joint::slider([Some(slider), None]).at(v(x as f32, 0.0, 0.0))).unwrap();
    let [mut gap, mut at, mut speed, mut torque, mut turned] = [0.0f64; 5];
    for step in 1..=300 {
        let report = world.step(DT).unwrap();
        let (angle, before) = (rate * f64::from(DT) * f64::from(step), f64::from(step - 1));
        let [x, slide, ..] = ENGINE.state(angle);
        let mean = ENGINE.energy(angle) - ENGINE.energy(rate * f64::from(DT) * before);
        let mean = mean / (rate * f64::from(DT));
        gap = gap.max(report.joint_gap[0]);
        at = at.max((f64::from(place(&world, slider)[0]) - x).abs());
        speed = speed.max((f64::from(velocity(&world, slider).linear[0]) - slide).abs());
        torque = torque.max((world.joint(motor).unwrap().torque - mean.abs()).abs());
        turned = turned.max((value(&world, motor) - angle).abs());
    }
    let name = format!("{L}D slider-crank");
    preset.below(&format!("{name}: gap"), gap, preset.gap);
    preset.below(&format!("{name}: angle"), turned, 0.2 * preset.part);
    preset.below(&format!("{name}: position"), at / crank, preset.part);
    preset.below(&format!("{name}: speed"), speed / (crank * rate), preset.part);
    preset.below(&format!("{name}: torque"), torque / 2.55237, preset.part);
}

/// The slider of a crank that turns evenly has its position and speed, and the motor the torque
/// that changes the kinetic energy, T = dE/d(angle).
#[test]
fn a_slider_crank_moves_as_its_geometry_and_takes_its_torque() {
    let [x, speed, ..] = ENGINE.state(PI / 4.0);
    assert!((x - 0.362258).abs() < 1e-6 && (speed + 1.10409).abs() < 1e-5, "{x}, {speed}");
    for (degrees, torque) in [(30.0f64, 2.55237), (60.0, 1.41482), (135.0, -1.70883)] {
        let energies = [-1e-4, 1e-4].map(|by| ENGINE.energy(degrees.to_radians() + by));
        let found = (energies[1] - energies[0]) / 2e-4;
        assert!((found - torque).abs() < 1e-5, "{degrees}: {found}");
    }
    for preset in Preset::both() {
        slider_crank::<Rigid2, 2, 1>(&preset);
        slider_crank::<Rigid3, 3, 3>(&preset);
    }
}

/// Returns the corner of a four-bar linkage between coupler and rocker. The base has 1 m, the crank
/// 0.3, the coupler 0.9, the rocker 0.7.
fn corner(crank: [f64; 2]) -> [f64; 2] {
    let across = [1.0 - crank[0], -crank[1]];
    let length = across[0].hypot(across[1]);
    let along = (0.81 - 0.49 + length * length) / (2.0 * length);
    let off = (0.81 - along * along).sqrt();
    let unit = across.map(|own| own / length);
    [crank[0] + unit[0] * along - unit[1] * off, crank[1] + unit[1] * along + unit[0] * off]
}

/// Returns the angle of the rocker from the x axis. \[rad\]
fn rocker(angle: f64) -> f64 {
    let corner = corner([0.3 * angle.cos(), 0.3 * angle.sin()]);
    corner[1].atan2(corner[0] - 1.0)
}

fn four_bar<G: Rigid<L, A>, const L: usize, const A: usize>(preset: &Preset) {
    let mut world: World<G, L, A> = preset.world();
    let crank = [0.3, 0.0];
    let corner = corner(crank);
    let ends = [[[0.0; 2], crank], [crank, corner], [[1.0, 0.0], corner]];
    let [arm, coupler, swing] = ends.map(|ends| world.add(bar(ends, thin_rod(1.0, 0.5))).unwrap());
    let motor = pin([Some(arm), None], [0.0; 2]).drive(Drive::velocity(TAU));
    world.join(motor).unwrap();
    world.join(pin([Some(coupler), Some(arm)], crank)).unwrap();
    world.join(pin([Some(swing), Some(coupler)], corner)).unwrap();
    let hinge = world.join(pin([Some(swing), None], [1.0, 0.0])).unwrap();
    let (mut worst, mut gap) = (0.0f64, 0.0f64);
    let name = format!("{L}D four-bar");
    let mut swings = [f64::MAX, f64::MIN];
    for step in 1..=300 {
        let report = world.step(DT).unwrap();
        gap = gap.max(report.joint_gap[0]);
        let found = heading(&world, swing).to_degrees();
        worst =
            worst.max((found - rocker(TAU * f64::from(DT) * f64::from(step)).to_degrees()).abs());
        swings = [swings[0].min(found), swings[1].max(found)];
        if step == 10 {
            preset.check(&format!("{name}: rocker at 60"), found, 95.1957);
            let ratio = speed(&world, hinge) / TAU;
            preset.check(&format!("{name}: ratio at 60"), ratio, 0.240884);
        }
    }
    preset.check(&format!("{name}: least angle"), swings[0], 92.0467);
    preset.check(&format!("{name}: largest angle"), swings[1], 143.818);
    preset.below(&format!("{name}: angle"), worst / 51.8, preset.part);
    preset.below(&format!("{name}: gap"), gap, preset.gap);
}

/// A four-bar linkage swings between its two dead centers.
#[test]
fn a_four_bar_linkage_moves_as_its_geometry() {
    assert!((rocker(PI / 3.0).to_degrees() - 95.1957).abs() < 1e-4);
    for preset in Preset::both() {
        four_bar::<Rigid2, 2, 1>(&preset);
        four_bar::<Rigid3, 3, 3>(&preset);
    }
}

/// Two shafts bent by 30 degrees: a Hooke joint turns the second one unevenly,
/// w_2/w_1 = cos b / (1 - sin^2 b cos^2 q), q = 0 with the pin of the first across the bend; a
/// `universal` joint turns it evenly.
#[test]
fn shafts_turn_by_the_law_of_their_joint() {
    for preset in Preset::both() {
        shafts(&preset, true);
        shafts(&preset, false);
    }
}

fn shafts(preset: &Preset, is_even: bool) {
    let bend = 30.0f64.to_radians();
    let along = [bend.cos() as f32, bend.sin() as f32, 0.0];
    let mut world: World<Rigid3, 3, 3> = preset.weightless();
    let mut first = ghost([-0.5, 0.0, 0.0], inertia(1.0, [0.1; 3]));
    let mut second = bar([[0.0; 2], [bend.cos(), bend.sin()]], inertia(1.0, [0.1; 3]));
    // The pin of the second shaft is along z, across the bend.
    let ratio = if is_even { 1.0 } else { bend.cos() };
    first.velocity.angular = Vector([TAU as f32, 0.0, 0.0]);
    second.velocity.angular = Vector(along.map(|own| own * (TAU * ratio) as f32));
    let [first, second] = [first, second].map(|body| world.add(body).unwrap());
    let motor = Joint::hinge([Some(first), None]).drive(Drive::velocity(TAU));
    let motor = world.join(motor).unwrap();
    let out = world.join(Joint::hinge([Some(second), None]).about(along)).unwrap();
    let mut joint = Joint::universal([Some(second), Some(first)]);
    if !is_even {
        joint.axes[3] = JointAxis::locked(Coordinate::Cardan(0), 0.0);
    }
    let end = |x: f32| Rigid3::pose(Vector([x, 0.0, 0.0]), &[0.0, 0.0, 0.0, 1.0]);
    world.join(joint.in_bodies([end(-0.5), end(0.5)])).unwrap();
    let (mut worst, mut gap, mut ratios) = (0.0f64, [0.0f64; 2], [f64::MAX, f64::MIN]);
    for _ in 0..240 {
        let report = world.step(DT).unwrap();
        gap = [0, 1].map(|i: usize| gap[i].max(report.joint_gap[i]));
        let ratio = speed(&world, out) / speed(&world, motor);
        let law = bend.cos() / (1.0 - (bend.sin() * value(&world, motor).sin()).powi(2));
        worst = worst.max((ratio - if is_even { 1.0 } else { law }).abs());
        ratios = [ratios[0].min(ratio), ratios[1].max(ratio)];
    }
    let name = if is_even { "universal" } else { "Hooke" };
    let range = if is_even { [1.0; 2] } else { [0.866025, 1.15470] };
    preset.check(&format!("{name}: least ratio"), ratios[0], range[0]);
    preset.check(&format!("{name}: largest ratio"), ratios[1], range[1]);
    preset.below(&format!("{name}: ratio"), worst, preset.part);
    preset.below(&format!("{name}: gap"), gap[0], preset.gap);
    preset.below(&format!("{name}: angle"), gap[1], 1e-4);
}

/// A motor of 2 N m brings 0.5 kg m^2 to 10 rad/s in 2.5 s and over 12.5 rad; friction of 2 N m
/// stops it as it was started.
#[test]
fn a_motor_starts_and_friction_stops_a_wheel() {
    for preset in Preset::both() {
        let mut world: World<Rigid3, 3, 3> = preset.weightless();
        let body = world.add(ghost([0.0; 3], inertia(1.0, [0.5; 3]))).unwrap();
        let motor = Drive::velocity(10.0).at_most(2.0);
        let hinge = world.join(Joint::hinge([Some(body), None]).drive(motor)).unwrap();
        run(&mut world, 1.25);
        preset.check("motor: half of the time", speed(&world, hinge), 5.0);
        preset.check("motor: torque", world.joint(hinge).unwrap().torque, 2.0);
        run(&mut world, 1.25);
        preset.check("motor: speed", speed(&world, hinge), 10.0);
        preset.check("motor: angle", value(&world, hinge), 12.5);
        run(&mut world, 1.0);
        preset.check("motor: speed held", speed(&world, hinge), 10.0);
        preset.check("motor: angle held", value(&world, hinge), 22.5);
        let mut axes = world.joint_axes(hinge).unwrap().to_vec();
        let last = axes.len() - 1;
        (axes[last].drives, axes[last].friction) = (Vec::new(), 2.0);
        world.set_joint_axes(hinge, axes).unwrap();
        run(&mut world, 1.25);
        preset.check("friction: half of the time", speed(&world, hinge), 5.0);
        run(&mut world, 2.0);
        preset.below("friction: speed", speed(&world, hinge).abs(), 1e-5);
        preset.check("friction: angle", value(&world, hinge), 35.0);
    }
}

/// Returns the acceleration of a body along y by its way in `seconds`, and the force of a joint.
fn pulled(preset: &Preset, masses: [f64; 2], ratio: f64) -> ([f64; 2], f64) {
    let mut world: World<Rigid3, 3, 3> = preset.world();
    let bodies = [0, 1].map(|side: usize| {
        let x = side as f64 * 2.0 - 1.0;
        world.add(ghost([x, -2.0, 0.0], inertia(masses[side], [0.1; 3]))).unwrap()
    });
    let points = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
    let pulley = JointAxis::locked(Coordinate::Pulley { points, ratio }, 2.0 + 2.0 * ratio);
    let still = Rigid3::pose(Vector::ZERO, &[0.0, 0.0, 0.0, 1.0]);
    let joint = Joint::general(bodies.map(Some), vec![pulley]).in_bodies([still; 2]);
    let joint = world.join(joint).unwrap();
    run(&mut world, 0.5);
    let seconds = f64::from(DT) * 30.0;
    let ways = bodies.map(|body| f64::from(place(&world, body)[1]) + 2.0);
    (ways.map(|way| -2.0 * way / (seconds * seconds)), world.joint(joint).unwrap().force)
}

/// Masses over a pulley: 3 and 2 kg on one rope; 3 kg on one, 4 kg on a double one.
#[test]
fn masses_over_a_pulley_accelerate() {
    for preset in Preset::both() {
        for (masses, ratio, accelerations, force) in [
            ([3.0, 2.0], 1.0, [1.96200, -1.96200], 23.5440),
            ([3.0, 4.0], 2.0, [2.45250, -1.22625], 22.0725),
        ] {
            let (found, tension) = pulled(&preset, masses, ratio);
            let name = format!("pulley {ratio}");
            preset.check(&format!("{name}: a"), found[0], accelerations[0]);
            preset.check(&format!("{name}: b"), found[1], accelerations[1]);
            preset.check(&format!("{name}: force"), tension, force);
        }
    }
}

/// Two wheels of 0.1 and 0.4 kg m^2 with a ratio of 2 or 2.5; a pinion that pushes a rack; a nut on
/// a screw. All run for many turns.
#[test]
fn gears_racks_and_screws_accelerate_and_keep_their_ratio() {
    for preset in Preset::both() {
        for ratio in [2.0, 2.5, -0.3] {
            gears(&preset, ratio);
        }
        rack(&preset);
        screw(&preset);
    }
}

/// Two wheels with a gear on a housing that a motor yaws, or that tumbles end over end across their axis:
/// their angles keep the ratio over several turns of the housing.
#[test]
fn gears_hold_on_housings_that_turn() {
    for preset in Preset::both() {
        for (ratio, about) in
            [(1.0, [0.0f32, 1.0, 0.0]), (-2.5, [0.0, 0.6, 0.8]), (3.0, [0.0, 0.0, 1.0])]
        {
            let mut world: World<Rigid3, 3, 3> = preset.weightless();
            let housing = world.add(ghost([0.0; 3], block(20.0, [0.3, 0.3, 0.3]))).unwrap();
            let hinge = Joint::hinge([Some(housing), None]).about(about);
            let turned = world.join(hinge.drive(Drive::velocity(3.0))).unwrap();
            let spin = [0.0, 1.0].map(|part: f64| if part == 0.0 { 8.0 } else { -8.0 / ratio });
            let parts = [0, 1].map(|side: usize| {
                let x = [-0.2, 0.2][side];
                let mut wheel = ghost([x, 0.0, 0.0], block(1.0, [0.05, 0.1, 0.1]));
                // The wheels start with the housing at rest.
                wheel.velocity.angular = Vector([spin[side] as f32, 0.0, 0.0]);
                let wheel = world.add(wheel).unwrap();
                let joint = Joint::hinge([Some(wheel), Some(housing)]).at([x as f32, 0.0, 0.0]);
                (wheel, world.join(joint).unwrap())
            });
            let axis = JointAxis::locked(Coordinate::Gear { ratio }, 0.0);
            let gear = Joint::general(parts.map(|(wheel, _)| Some(wheel)), vec![axis]);
            world.join(gear).unwrap();
            let mut worst = 0.0f64;
            for _ in 0..360 {
                world.step(DT).unwrap();
                let [a, b] = parts.map(|(_, joint)| value(&world, joint));
                worst = worst.max((a + ratio * b).abs());
            }
            let name = format!("gear {ratio} on a housing about {about:?}");
            let turns = value(&world, turned);
            assert!(turns.abs() > 15.0, "{name}: {turns} rad");
            preset.below(&name, worst, 2e-3);
        }
    }
}

fn gears(preset: &Preset, ratio: f64) {
    let mut world: World<Rigid3, 3, 3> = preset.weightless();
    let wheels = [(0.0, 0.1), (1.0, 0.4)].map(|(z, moment)| {
        world.add(ghost([0.0, 0.0, z], inertia(1.0, [0.1, 0.1, moment]))).unwrap()
    });
    let hinges = [0, 1].map(|side: usize| {
        let at = [0.0, 0.0, side as f32];
        let hinge = Joint::hinge([Some(wheels[side]), None]).at(at).about([0.0, 0.0, 1.0]);
        world.join(hinge).unwrap()
    });
    let axis = JointAxis::locked(Coordinate::Gear { ratio }, 0.0);
    let gear = Joint::general(wheels.map(Some), vec![axis]).about([0.0, 0.0, 1.0]);
    world.join(gear).unwrap();
    let (expected, mut gap) = (1.0 / (0.1 + 0.4 / (ratio * ratio)), 0.0f64);
    for step in 1..=300 {
        world.add_force(wheels[0], in_plane([0.0; 2], 1.0)).unwrap();
        let report = world.step(DT).unwrap();
        gap = gap.max(report.joint_gap[1]);
        if step == 30 {
            let rate = speed(&world, hinges[0]) / (30.0 * f64::from(DT));
            preset.check(&format!("gear {ratio}: acceleration"), rate, expected);
        }
    }
    let [a, b] = hinges.map(|hinge| value(&world, hinge));
    preset.check(&format!("gear {ratio}: angle"), a, 0.5 * expected * 25.0);
    preset.check(&format!("gear {ratio}: other angle"), b, -a / ratio);
    preset.below(&format!("gear {ratio}: miss"), gap, 1e-3);
}

fn rack(preset: &Preset) {
    let mut world: World<Rigid3, 3, 3> = preset.weightless();
    let pinion = world.add(ghost([0.0; 3], inertia(1.0, [0.1, 0.1, 0.05]))).unwrap();
    let rod = world.add(ghost([0.0, -0.1, 0.0], inertia(2.0, [0.1; 3]))).unwrap();
    let hinge = Joint::hinge([Some(pinion), None]).about([0.0, 0.0, 1.0]);
    let hinge = world.join(hinge).unwrap();
    let slider = world.join(Joint::slider([Some(rod), None]).at([0.0, -0.1, 0.0])).unwrap();
    let axis = JointAxis::locked(Coordinate::Rack { radius: 0.1 }, 0.0);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let about_z = Rigid3::pose(Vector::ZERO, &[0.0, -half, 0.0, half]);
    let still = Rigid3::pose(Vector::ZERO, &[0.0, 0.0, 0.0, 1.0]);
    let rack = Joint::general([Some(pinion), Some(rod)], vec![axis]).in_bodies([about_z, still]);
    world.join(rack).unwrap();
    let mut gap = 0.0f64;
    for _ in 0..180 {
        world.add_force(rod, in_plane([10.0, 0.0], 0.0)).unwrap();
        gap = gap.max(world.step(DT).unwrap().joint_gap[0]);
    }
    let state = world.joint(slider).unwrap();
    let (rate, way) = (state.speeds[0] / 3.0, state.values[0]);
    preset.check("rack: acceleration", rate, 1.42857);
    preset.check("rack: way", way, 0.5 * 1.42857 * 9.0);
    preset.check("rack: angle", value(&world, hinge).abs(), way / 0.1);
    preset.below("rack: miss", gap, 1e-4);
}

fn screw(preset: &Preset) {
    let mut world: World<Rigid3, 3, 3> = preset.weightless();
    let nut = world.add(ghost([0.0; 3], inertia(2.0, [1e-3; 3]))).unwrap();
    let mut joint = Joint::piston([Some(nut), None]);
    joint.axes.push(JointAxis::locked(Coordinate::Screw { pitch: 0.1 }, 0.0));
    let joint = world.join(joint).unwrap();
    let mut gap = 0.0f64;
    for _ in 0..120 {
        world.add_force(nut, in_plane([10.0, 0.0], 0.0)).unwrap();
        gap = gap.max(world.step(DT).unwrap().joint_gap[0]);
    }
    // m + I (2 pi / pitch)^2.
    let expected = 10.0 / (2.0 + 1e-3 * (TAU / 0.1).powi(2));
    let state = world.joint(joint).unwrap();
    preset.check("screw: acceleration", state.speeds[0] / 2.0, expected);
    preset.check("screw: way", state.values[0], 2.0 * expected);
    preset.check("screw: turns", state.values[5] / TAU, state.values[0] / 0.1);
    preset.below("screw: miss", gap, 1e-4);
}

/// A frame of a link: its axes in columns, and its origin.
type Frame = ([[f64; 3]; 3], [f64; 3]);

/// Returns the frame that follows by a turn about z, a way along x and a twist about x.
fn following((axes, origin): &Frame, turn: f64, length: f64, twist: f64) -> Frame {
    let combine = |by: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|i| (0..3).map(|k| axes[k][i] * by[k]).sum())
    };
    let (s, c) = turn.sin_cos();
    let (t, d) = twist.sin_cos();
    let x = combine([c, s, 0.0]);
    let y = combine([-s * d, c * d, t]);
    let z = combine([s * t, -c * t, d]);
    ([x, y, z], std::array::from_fn(|i| origin[i] + length * x[i]))
}

/// Bennett's loop: four skew hinges move although 20 rows hold three bodies;
/// tan(a/2) tan(b/2) = sin((B + A)/2) / sin((B - A)/2) for the twists A and B.
#[test]
fn a_bennett_loop_moves() {
    let twists = [30.0f64.to_radians(), 0.8f64.asin()];
    let constant = (0.5 * (twists[1] + twists[0])).sin() / (0.5 * (twists[1] - twists[0])).sin();
    assert!((constant - 3.30940).abs() < 1e-4, "{constant}");
    let other = |a: f64| 2.0 * (constant / (0.5 * a).tan()).atan();
    let (a, b) = (PI / 2.0, other(PI / 2.0));
    assert!((b.to_degrees() - 146.374).abs() < 1e-3, "{}", b.to_degrees());
    let turns = [a, b, -a, -b];
    let mut frames: Vec<Frame> =
        vec![([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3])];
    for i in 0..4 {
        let last = &frames[i];
        frames.push(following(last, turns[i], [0.5, 0.8][i % 2], twists[i % 2]));
    }
    let closure = (0..3).map(|i| frames[4].1[i].abs()).fold(0.0, f64::max);
    assert!(closure < 1e-9, "{closure}");
    for preset in Preset::both() {
        let (mut world, joints) = loop_of(&preset, &frames);
        let mut worst = [0.0f64; 2];
        for _ in 0..60 {
            let gap = world.step(DT).unwrap().joint_gap;
            worst = [0, 1].map(|i: usize| worst[i].max(gap[i]));
        }
        let turned = [0, 1].map(|i: usize| value(&world, joints[i]));
        preset.check("Bennett: driven angle", (a + turned[0]).to_degrees(), 120.0);
        preset.check("Bennett: other angle", (b + turned[1]).to_degrees(), 124.747);
        preset.check("Bennett: other way", turned[1].to_degrees(), 124.747 - 146.374);
        preset.below("Bennett: gap", worst[0], preset.gap);
        preset.below("Bennett: angle", worst[1], 1e-4);
    }
}

/// Returns hinges about the z axes of these frames, between the links from one to the next; the
/// last link is the world. The first is driven.
fn loop_of(preset: &Preset, frames: &[Frame]) -> (World<Rigid3, 3, 3>, Vec<JointId>) {
    let single = |of: [f64; 3]| of.map(|own| own as f32);
    let mut world: World<Rigid3, 3, 3> = preset.weightless();
    let links: Vec<BodyId> = (1..4)
        .map(|i| {
            let middle = std::array::from_fn(|k| 0.5 * (frames[i - 1].1[k] + frames[i].1[k]));
            world.add(ghost(middle, inertia(1.0, [0.05; 3]))).unwrap()
        })
        .collect();
    let hinge = |i: usize| {
        let bodies = [links.get(i).copied(), i.checked_sub(1).map(|i| links[i])];
        let hinge = Joint::hinge(bodies).at(single(frames[i].1)).about(single(frames[i].0[2]));
        if i == 0 { hinge.drive(Drive::velocity(PI / 6.0)) } else { hinge }
    };
    let joints = (0..4).map(|i| world.join(hinge(i)).unwrap()).collect();
    (world, joints)
}
