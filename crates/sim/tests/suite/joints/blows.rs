//! Blows on bodies from which others hang, without restitution: they stop, and do not come back.

use drystone::geometry::{Geometry, Rigid3};
use drystone::{Joint, StepSettings, World};

use super::*;

type World3 = World<Rigid3, 3, 3>;

/// Returns the settings of all three presets.
fn all() -> [Preset; 3] {
    let [bake, real_time] = Preset::both();
    let quality = Preset { name: "quality", settings: StepSettings::quality(), ..bake.clone() };
    [bake, real_time, quality]
}

/// A table of 40 kg falls on legs that are fixed to it. They stop it within a few millimeters, and it stays
/// there.
#[test]
fn a_table_lands_on_its_legs() {
    const HALF: f32 = 0.36;
    for preset in all() {
        for (mass, height) in [(0.3, 0.5f32), (1.0, 0.5), (1.0, 0.05), (10.0, 1.0)] {
            let mut world: World3 = preset.world();
            add_floor(&mut world, &surface(0.5, 0.0));
            let mut add = |at, half, mass| {
                let part = dynamic(at, Rigid3::cuboid(half), &surface(0.5, 0.0));
                world.add(weighing(part, mass)).unwrap()
            };
            let top = add([0.0, height + 2.0 * HALF + 0.03, 0.0], [0.6, 0.03, 0.4], 40.0);
            let corners = [[-0.5, -0.3], [0.5, -0.3], [-0.5, 0.3], [0.5, 0.3]];
            let legs = corners.map(|[x, z]| {
                (add([x, height + HALF, z], [0.03, HALF, 0.03], mass), [x, height + 2.0 * HALF, z])
            });
            for (leg, at) in legs {
                world.join(Joint::fixed([Some(leg), Some(top)]).at(at)).unwrap();
            }
            let foot = |world: &World3| place(world, legs[0].0)[1] - HALF;
            let (mut lowest, mut highest, mut landed) = (f32::INFINITY, 0.0f32, false);
            for _ in 0..180 {
                world.step(DT).unwrap();
                lowest = lowest.min(foot(&world));
                landed |= foot(&world) < 1e-3;
                highest = if landed { highest.max(foot(&world)) } else { 0.0 };
            }
            let of = format!("of a table on legs of {mass} kg from {height} m");
            preset.below(&format!("overlap {of}"), f64::from(-lowest), 0.01);
            preset.below(&format!("rise {of}"), f64::from(highest), 0.01);
        }
    }
}

/// A rod on a hinge strikes a stop at any distance from the hinge, and stays there.
#[test]
fn a_rod_stays_at_a_stop() {
    for preset in all() {
        for (at, speed) in
            [0.3f64, 0.5, 0.67, 0.95].into_iter().flat_map(|at| [1.0, 3.0].map(|own| (at, own)))
        {
            let mut world: World3 = preset.weightless();
            let mut rod = weighing(
                dynamic([0.5, 0.0, 0.0], Rigid3::cuboid([0.5, 0.02, 0.02]), &surface(0.0, 0.0)),
                1.0,
            );
            rod.velocity = in_plane([0.0, 0.5 * speed], speed);
            let rod = world.add(rod).unwrap();
            world.join(pin([Some(rod), None], [0.0; 2])).unwrap();
            // The rod reaches it after a tenth of a radian.
            let (sine, cosine) = 0.1f64.sin_cos();
            let stop = [at * cosine - 0.12 * sine, at * sine + 0.12 * cosine, 0.0];
            let stop = stop.map(|own| own as f32);
            let stop = body(Motion::Static, stop, Rigid3::ball(0.1), &surface(0.0, 0.0));
            world.add(stop).unwrap();
            let mut back = 0.0f64;
            for _ in 0..60 {
                world.step(DT).unwrap();
                back = back.max(f64::from(-velocity(&world, rod).angular[2]));
            }
            let of = format!("speed back from a stop at {at} m, struck at {speed} rad/s");
            // A few sweeps stop to within 0.1 m/s.
            let least = if preset.settings.tolerance > 0.0 { 0.0 } else { 0.1 / at };
            preset.below(&of, back, 0.05 * speed + least);
            let turned = f64::from(Rigid3::frame(&world.pose(rod).unwrap()).axes[0][1]).asin();
            preset.below(&format!("way past the stop at {at} m"), turned - 0.1, 0.03);
        }
    }
}
