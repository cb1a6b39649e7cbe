//! Bodies that turn fast in their joints: at a steady rate, at once after a blow, and beyond half a turn
//! in a substep.

use drystone::geometry::Rigid3;
use drystone::{Body, Coordinate, Drive, Joint, JointAxis, JointId, World};
use drystone_solver::Vector;

use super::*;

type World3 = World<Rigid3, 3, 3>;

/// A rod turns about a hinge at its end: the hinge bears hundreds of its weights, and takes no energy.
#[test]
fn a_rod_about_its_end_keeps_its_energy() {
    for preset in Preset::both() {
        for (speed, axis) in [(20.0, 2), (100.0, 2), (100.0, 1), (300.0, 2)] {
            let mut world: World3 = preset.weightless();
            let body = world.add(ghost([0.5, 0.0, 0.0], block(1.0, [0.5, 0.05, 0.05]))).unwrap();
            let mut about = Vector([0.0f32; 3]);
            about[axis] = 1.0;
            world.join(Joint::hinge([Some(body), None]).about(about.0)).unwrap();
            let turn = about * speed as f32;
            let linear = Vector([0.0, turn[2] * 0.5, turn[1] * -0.5]);
            world.set_velocity(body, drystone_solver::Velocity { linear, angular: turn }).unwrap();
            let start = world.measure().kinetic_energy;
            let mut gap = 0.0f64;
            for _ in 0..120 {
                gap = gap.max(world.step(DT).unwrap().joint_gap[0]);
            }
            let lost = (world.measure().kinetic_energy / start - 1.0).abs();
            preset.below(&format!("energy lost at {speed} rad/s"), lost, 0.01);
            preset.below("gap", gap, 1e-4);
        }
    }
}

/// Returns a ball of 20 cm on a hinge about z, which turns at a speed \[rad/s\].
fn spinning(preset: &Preset, speed: f64, axis: JointAxis) -> (World3, JointId) {
    let mut world: World3 = preset.weightless();
    let body: Body<Rigid3, 3, 3> = ghost([0.0; 3], inertia(1.0, [0.016; 3]));
    let body = world.add(body).unwrap();
    let hinge = Joint::hinge([Some(body), None]).about([0.0, 0.0, 1.0]).along(axis);
    let joint = world.join(hinge).unwrap();
    world.set_velocity(body, in_plane([0.0; 2], speed)).unwrap();
    (world, joint)
}

/// Turns are counted at any speed, and a limit after many of them stops the body.
#[test]
fn fast_turns_are_counted() {
    for preset in Preset::both() {
        for speed in [-50.0, 300.0, 1000.0, -1000.0, 5000.0] {
            let free = JointAxis::free(Coordinate::Twist);
            let (mut world, joint) = spinning(&preset, speed, free);
            run(&mut world, 1.0);
            let turned = *world.joint(joint).unwrap().values.last().unwrap();
            preset.check(&format!("angle after a second at {speed} rad/s"), turned, speed);

            let end = speed * 0.2;
            let limits = if end > 0.0 { [f64::NEG_INFINITY, end] } else { [end, f64::INFINITY] };
            let (mut world, joint) =
                spinning(&preset, speed, JointAxis::limited(Coordinate::Twist, limits));
            run(&mut world, 1.0);
            let state = world.joint(joint).unwrap();
            preset.check("where it stops", *state.values.last().unwrap(), end);
            preset.below("its speed there", state.speeds.last().unwrap().abs(), 1e-3 * speed.abs());
        }
    }
}

/// A load hangs by a hinge on a clip that a rope holds, lighter by a factor of hundreds and of the size
/// of a thumb: when the rope is taut, the clip turns at once, and stays in its joints.
#[test]
fn a_heavy_load_hangs_on_a_small_clip() {
    let preset = Preset::bake();
    for (size, mass) in [(0.5, 400.0), (1.0, 30.0), (1.0, 400.0), (10.0, 400.0)] {
        let mut world: World3 = preset.world();
        let at = |place: [f64; 3]| place.map(|x| x * size);
        let clip = ghost([0.0; 3], block(0.3, at([0.005, 0.004, 0.003])));
        let load = ghost(at([0.006, -0.01, 0.0]), block(mass, at([0.004, 0.006, 0.006])));
        let [clip, load] = [clip, load].map(|body| world.add(body).unwrap());
        let pose = |at: [f64; 3]| Rigid3::pose(Vector(at.map(|x| x as f32)), &[0.0, 0.0, 0.0, 1.0]);
        let rope = Joint::rope([None, Some(clip)], 0.03 * size);
        world.join(rope.in_bodies([pose(at([0.02, 0.02, 0.0])), pose([0.0; 3])])).unwrap();
        let hinge = Joint::hinge([Some(clip), Some(load)]).about([0.7, -0.5, 0.4]);
        world.join(hinge.at(at([0.006, -0.005, 0.004]).map(|x| x as f32))).unwrap();
        let energy = |world: &World3| {
            let now = world.measure();
            now.kinetic_energy + now.potential_energy
        };
        let (start, mut most, mut gap) = (energy(&world), f64::NEG_INFINITY, 0.0f64);
        for _ in 0..180 {
            gap = gap.max(world.step(DT).unwrap().joint_gap[0]);
            most = most.max(energy(&world));
        }
        let of = format!("{mass} kg on a clip of {size} cm");
        preset.below(&format!("gap of {of}"), gap, 1e-4 * size.max(1.0));
        preset.below("energy from nothing", most - start, 1e-3 * mass * ACCELERATION * 0.05 * size);
    }
}

/// A chain that hangs at rest does not move when steps become shorter or longer.
#[test]
fn steps_of_any_length_follow_each_other() {
    for preset in Preset::both() {
        let mut world: World3 = preset.world();
        let mut above = None;
        for link in 0..6 {
            let y = -0.1 - 0.2 * f64::from(link);
            let mass = if link == 5 { 50.0 } else { 0.5 };
            let body = world.add(ghost([0.0, y, 0.0], block(mass, [0.02, 0.1, 0.02]))).unwrap();
            world.join(Joint::ball([Some(body), above]).at([0.0, y as f32 + 0.1, 0.0])).unwrap();
            above = Some(body);
        }
        let mut fastest = 0.0f64;
        for step in 0..240 {
            let dt = [DT, 0.1 * DT, 2.0 * DT, 0.01 * DT, 0.5 * DT][step % 5];
            world.step(dt).unwrap();
            fastest =
                fastest.max(f64::from(world.velocity(above.unwrap()).unwrap().linear.length()));
        }
        preset.below("speed of a chain at rest", fastest, 0.01);
    }
}

/// Forces of joints last when steps change their length: a beam rests on a spring and dry friction.
#[test]
fn forces_last_in_steps_of_any_length() {
    for preset in Preset::both() {
        let mut world: World3 = preset.world();
        let beam = world.add(ghost([0.5, 0.0, 0.0], block(20.0, [0.5, 0.05, 0.05]))).unwrap();
        let (drives, friction) = (vec![Drive::spring(0.0, 1e4, 1e3)], 60.0);
        let axis = JointAxis { drives, friction, ..JointAxis::free(Coordinate::Twist) };
        let hinge = Joint::hinge([Some(beam), None]).about([0.0, 0.0, 1.0]).along(axis);
        let hinge = world.join(hinge).unwrap();
        run(&mut world, 4.0);
        let (rest, mut off, mut time) = (value(&world, hinge), 0.0f64, 0.0);
        for step in 0..480 {
            let dt = [DT, 0.1 * DT, 2.0 * DT, 0.01 * DT, 0.5 * DT][step % 5];
            world.step(dt).unwrap();
            time += f64::from(dt);
            // Dry friction yields at 1e-5 rad/s.
            off = off.max((value(&world, hinge) - rest).abs() - 1e-5 * time);
        }
        preset.below("angle away from rest", off, 1e-5);
    }
}
