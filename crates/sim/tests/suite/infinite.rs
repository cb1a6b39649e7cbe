//! Tests of infinite masses and moments of inertia: values stay finite and agree with those of
//! large masses.

use crate::common::*;
use drystone::geometry::{Geometry, Rigid2, Rigid3};
use drystone::{Inertia, Joint, Motion, StepSettings, World, World3};
use drystone_solver::{SymmetricMatrix, Vector};

/// Drops a ball beside the middle of a plate of this mass \[kg\]. Its moment about its y axis is 1
/// kg m^2, and `others` are the other two; infinite ones leave it only this axis. Returns its
/// angular velocity about the world's z axis afterwards. \[rad/s\]
fn turned(
    settings: &StepSettings,
    mass: f32,
    others: f32,
    rotation: [f32; 4],
    gravity: bool,
) -> f32 {
    let mut world: World3 = if gravity { world() } else { weightless() };
    world.settings = settings.clone();
    let mut plate = dynamic([0.0, 1.0, 0.0], Rigid3::cuboid([0.5, 0.1, 0.5]), &surface(0.5, 0.0));
    plate.pose = Rigid3::pose(Vector([0.0, 1.0, 0.0]), &rotation);
    plate.gravity_factor = 0.0;
    let moments =
        |of: fn(f32) -> f32| SymmetricMatrix::diagonal(Vector([others, 1.0, others].map(of)));
    plate.inertia = Some(Inertia {
        mass,
        center: Vector::ZERO,
        moments: moments(|moment| if moment.is_finite() { moment } else { 0.0 }),
        inverse_moments: moments(|moment| 1.0 / moment),
    });
    let plate = world.add(plate).unwrap();
    let ball = weighing(dynamic([0.3, 1.7, 0.0], Rigid3::ball(0.1), &surface(0.5, 0.0)), 1.0);
    world.add(moving(ball, [0.0, if gravity { 0.0 } else { -1.5 }, 0.0])).unwrap();
    for _ in 0..40 {
        let report = world.step(DT).unwrap();
        let measure = world.measure();
        assert!(measure.finite && measure.kinetic_energy.is_finite(), "{mass} kg");
        if let Some(certified) = report.certified {
            assert!(certified.error.is_finite() && certified.failed == 0, "{certified:?}");
        }
    }
    velocity(&world, plate).angular[2]
}

/// A wheel of infinite mass, infinite moments or both rotates after an impact like one with 1e6 for
/// both, within 1 %. Its axis is level or tilted.
#[test]
fn infinite_masses_are_as_large_ones() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    for settings in [StepSettings::certified(), StepSettings::quality(), StepSettings::realtime()] {
        for rotation in [[half, 0.0, 0.0, half], [0.6, 0.1, 0.05, 0.78]] {
            for gravity in [true, false] {
                let large = turned(&settings, 1e6, 1e6, rotation, gravity);
                for (mass, others) in
                    [(f32::INFINITY, f32::INFINITY), (1e6, f32::INFINITY), (f32::INFINITY, 1e6)]
                {
                    let infinite = turned(&settings, mass, others, rotation, gravity);
                    assert_within("turning of the wheel [rad/s]", infinite, large, 0.01);
                }
            }
        }
    }
}

/// Islands with bodies of infinite mass, free, on an axis or locked, stay finite, and so do their
/// certificates. A box falls onto each body.
#[test]
fn islands_without_mass_are_finite() {
    for settings in [StepSettings::certified(), StepSettings::realtime()] {
        let mut world: World3 = world();
        world.settings = StepSettings { certify: true, ..settings };
        add_floor(&mut world, &surface(0.5, 0.0));
        for (i, moments) in [[1.0, 1.0, 1.0], [0.0, 1.0, 0.0], [0.0; 3]].into_iter().enumerate() {
            let shape = Rigid3::cuboid([0.5, 0.1, 0.3]);
            let mut wheel = dynamic([3.0 * i as f32, 0.11, 0.0], shape, &surface(0.5, 0.2));
            wheel.pose = Rigid3::pose(wheel_place(i), &[0.1, 0.0, 0.2, 0.97]);
            wheel.velocity.angular = Vector([0.0, 0.0, -1.0]);
            let moments = Vector(moments);
            wheel.inertia = Some(Inertia {
                mass: f32::INFINITY,
                center: Vector::ZERO,
                moments: SymmetricMatrix::diagonal(moments),
                inverse_moments: SymmetricMatrix::diagonal(moments),
            });
            world.add(wheel).unwrap();
            let box_on_it = Rigid3::cuboid([0.1; 3]);
            world.add(dynamic([3.0 * i as f32, 0.6, 0.0], box_on_it, &surface(0.5, 0.2))).unwrap();
        }
        for step in 0..60 {
            let report = world.step(DT).unwrap();
            assert!(world.measure().finite, "step {step}");
            let error = report.certified.map_or(0.0, |certified| certified.error);
            assert!(error.is_finite(), "step {step}: {error}");
        }
    }
}

fn wheel_place(i: usize) -> Vector<f32, 3> {
    Vector([3.0 * i as f32, 0.2, 0.0])
}

/// Moves a body of infinite mass and finite moments onto a static one, and asserts that all values
/// stay finite.
fn moves_on<G: Rigid<L, A>, const L: usize, const A: usize>(shape: G::Shape, inverse_moment: f32) {
    for settings in [StepSettings::certified(), StepSettings::quality(), StepSettings::realtime()] {
        let mut world = World::<G, L, A>::new(settings);
        let rough = surface(0.5, 0.3);
        world
            .add(body(Motion::Static, v(0.0, -2.16, 0.0), G::cuboid(v(3.2, 1.6, 3.2)), &rough))
            .unwrap();
        let start = dynamic(v(0.013, 0.0, 0.007), shape.clone(), &rough);
        let mut heavy = moving(start, v(-3.776, -1.3, 0.4));
        heavy.velocity.angular[0] = -0.0085;
        heavy.inertia = Some(Inertia {
            mass: f32::INFINITY,
            center: Vector::ZERO,
            moments: SymmetricMatrix::diagonal(Vector([1.0 / inverse_moment; A])),
            inverse_moments: SymmetricMatrix::diagonal(Vector([inverse_moment; A])),
        });
        world.add(heavy).unwrap();
        for step in 0..24 {
            world.step(1.0 / 24.0).unwrap();
            assert!(world.measure().finite, "{L}D, step {step}");
        }
    }
}

/// Bodies of infinite mass that can rotate stay finite for 24 steps as they move onto a static box.
#[test]
fn unstoppable_bodies_that_turn_stay_finite() {
    moves_on::<Rigid2, 2, 1>(Rigid2::ball(0.152), 1.19);
    moves_on::<Rigid3, 3, 3>(Rigid3::ball(0.152), 1.19);
    moves_on::<Rigid2, 2, 1>(Rigid2::capsule(0.2, 0.1), 3.0);
    moves_on::<Rigid3, 3, 3>(Rigid3::capsule(0.2, 0.1), 3.0);
    moves_on::<Rigid2, 2, 1>(Rigid2::cuboid([0.2; 2]), 3.0);
    moves_on::<Rigid3, 3, 3>(Rigid3::cuboid([0.2; 3]), 3.0);
}

/// Joints do not turn a body about its locked axes, whatever they bear: it hangs on a beam from a rail, or from
/// the world, with its principal axes turned.
#[test]
fn joints_respect_locked_axes() {
    type Join = fn([Option<drystone::BodyId>; 2]) -> Joint<Rigid3, 3, 3>;
    let joins: [Join; 4] = [Joint::fixed, Joint::ball, Joint::hinge, Joint::universal];
    for settings in [StepSettings::certified(), StepSettings::quality(), StepSettings::realtime()] {
        for (free, (arm, rail)) in (0..7).flat_map(|free| {
            [([2.0, 1.0, 0.5], false), ([10.0, 0.0, 0.3], true)].map(|at| (free, at))
        }) {
            for join in joins {
                let mut world: World3 = world();
                world.settings = settings.clone();
                let mut load = dynamic(arm, Rigid3::ball(0.3), &surface(0.5, 0.0));
                let turn = [0.34, 0.51, 0.07, 0.79];
                load.pose = Rigid3::pose(Vector(arm), &turn);
                let inverse = |axis: usize| if free & 1 << axis == 0 { 0.0 } else { 10.0 };
                let moments = [0, 1, 2].map(inverse);
                load.inertia = Some(Inertia {
                    mass: 1.0,
                    center: Vector::ZERO,
                    moments: SymmetricMatrix::diagonal(Vector(moments.map(|own| own * 0.01))),
                    inverse_moments: SymmetricMatrix::diagonal(Vector(moments)),
                });
                let load = world.add(load).unwrap();
                let mut beam = dynamic([0.0; 3], Rigid3::cuboid([0.1; 3]), &surface(0.5, 0.0));
                beam.motion = if rail { Motion::Dynamic } else { Motion::Static };
                let beam = world.add(weighing(beam, 1.0)).unwrap();
                if rail {
                    let slider = Joint::slider([Some(beam), None]).at([0.0; 3]);
                    world.join(slider.about([0.0, 1.0, 0.0])).unwrap();
                }
                world.join(join([Some(load), Some(beam)]).at([0.0; 3])).unwrap();
                for _ in 0..60 {
                    let report = world.step(DT).unwrap();
                    assert!(report.not_finite.is_empty(), "{free} {arm:?}");
                }
                let axes = Rigid3::frame(&world.pose(load).unwrap()).axes;
                let omega = velocity(&world, load).angular;
                for axis in (0..3).filter(|axis| free & 1 << axis == 0) {
                    let about = axes[axis].dot(omega).abs();
                    assert_below(
                        &format!("turn about axis {axis} of {free} at {arm:?}"),
                        about,
                        1e-3,
                    );
                }
            }
        }
    }
}
