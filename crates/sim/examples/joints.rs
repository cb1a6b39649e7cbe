//! Joints: a hundred links carry 1000 kg, and a motor opens and closes a door:
//! `cargo run --release -p drystone --example joints`

use drystone::{Body, Drive, Joint, Motion, StepSettings, World3};
use parry3d::shape::SharedShape;

const STEP: f32 = 1.0 / 60.0;

fn main() {
    // Bodies that sleep would not move, but their joints would tell no force.
    let settings = StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() };
    let mut world = World3::new(settings);
    world.gravity = [0.0, -9.81, 0.0].into();

    // Cubes of 0.1 m and 1 kg, each on a ball joint below the one before; the first on the world.
    let cube = SharedShape::cuboid(0.05, 0.05, 0.05);
    let (mut above, mut joints) = (None, Vec::new());
    for link in 0..100 {
        let top = -0.1 * link as f32;
        let body = Body::new(Motion::Dynamic, [0.0, top - 0.05, 0.0], cube.clone());
        let body = world.add(body).unwrap();
        joints.push(world.join(Joint::ball([Some(body), above]).at([0.0, top, 0.0])).unwrap());
        above = Some(body);
    }
    let weight = SharedShape::cuboid(0.5, 0.5, 0.5);
    let weight = world.add(Body::new(Motion::Dynamic, [0.0, -10.5, 0.0], weight)).unwrap();
    world.join(Joint::ball([Some(weight), above]).at([0.0, -10.0, 0.0])).unwrap();

    // A door of 64 kg that turns about a vertical line, at 1 rad/s and with 20 N m at most.
    let door = SharedShape::cuboid(0.4, 1.0, 0.02);
    let door = world.add(Body::new(Motion::Dynamic, [3.4, 0.0, 0.0], door)).unwrap();
    let hinge = Joint::hinge([Some(door), None]).at([3.0, 0.0, 0.0]).about([0.0, 1.0, 0.0]);
    let opening = Drive::velocity(1.0).at_most(20.0);
    let hinge = world.join(hinge.limits(0.0..=1.5).drive(opening)).unwrap();

    for step in 0..360 {
        if step == 180 {
            world.drive(hinge, Drive::velocity(-1.0).at_most(20.0)).unwrap();
        }
        let report = world.step(STEP).unwrap();
        if step % 60 == 59
            && let (Some(top), Some(state)) = (world.joint(joints[0]), world.joint(hinge))
        {
            // The last axis of a hinge is its angle.
            let angle = state.values[state.values.len() - 1];
            println!("{:.0} s: the door is open by {angle:.3} rad", (step + 1) as f32 * STEP);
            println!("     {:.0} N at the top of the chain", top.force);
            println!("     joints miss by {:.4} mm at most", 1e3 * report.joint_gap[0]);
        }
    }
}
