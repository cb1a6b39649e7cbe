//! Loads of joints: chains, loads that break them, weights on them.

use drystone::geometry::{Rigid2, Rigid3};
use drystone::{Breaking, Drive, Joint, Material, StepSettings, World};

use super::*;

/// Returns the slopes of the links of a hanging chain, and its horizontal force \[N\]:
/// tan(slope) = V/H with the mean vertical force V of the link.
fn hanging_chain(count: usize, length: f64, weight: f64, span: f64) -> (Vec<f64>, f64) {
    let slopes = |force: f64| -> Vec<f64> {
        let middle = 0.5 * (count as f64 - 1.0);
        (0..count).map(|i| (weight * (i as f64 - middle) / force).atan()).collect()
    };
    let wide = |force: f64| slopes(force).iter().map(|slope| length * slope.cos()).sum::<f64>();
    let (mut low, mut high) = (1.0, 1e6);
    for _ in 0..100 {
        let middle: f64 = 0.5 * (low + high);
        if wide(middle) < span { low = middle } else { high = middle }
    }
    (slopes(low), low)
}

fn catenary<G: Rigid<L, A>, const L: usize, const A: usize>(preset: &Preset) {
    let (slopes, level) = hanging_chain(100, 0.1, ACCELERATION, 8.0);
    assert!((level - 331.767).abs() < 1e-3, "{level}");
    let mut world: World<G, L, A> = preset.world();
    let (mut at, mut before, mut joints) = ([0.0; 2], None, Vec::new());
    let mut middle = None;
    for (i, slope) in slopes.into_iter().enumerate() {
        let next = [at[0] + 0.1 * slope.cos(), at[1] + 0.1 * slope.sin()];
        let id = world.add(bar([at, next], thin_rod(1.0, 0.1))).unwrap();
        let joint = if L == 3 {
            Joint::ball([Some(id), before]).at(v(at[0] as f32, at[1] as f32, 0.0))
        } else {
            pin([Some(id), before], at)
        };
        joints.push(world.join(joint).unwrap());
        (at, before) = (next, Some(id));
        if i == 49 {
            middle = Some((id, at[1]));
        }
    }
    let end = Joint::ball([before, None]).at(v(at[0] as f32, at[1] as f32, 0.0));
    joints.push(world.join(end).unwrap());
    // The joints give way by their stretch first, and the chain swings a little.
    run(&mut world, 2.0);
    let mut worst = [0.0f64; 3];
    let mut gap = 0.0f64;
    for _ in 0..60 {
        let report = world.step(DT).unwrap();
        gap = gap.max(report.joint_gap[0]);
        let force = |i: usize| world.joint(joints[i]).unwrap().force;
        let (link, lowest) = middle.unwrap();
        let sag = f64::from(place(&world, link)[1]) + 0.05 * heading(&world, link).sin();
        for (worst, (found, expected)) in
            worst.iter_mut().zip([(force(50), 331.767), (force(0), 592.165), (sag, -2.65452)])
        {
            *worst = worst.max((found / expected - 1.0).abs());
        }
        assert!((lowest + 2.65452).abs() < 1e-4, "{lowest}");
    }
    let name = format!("{L}D catenary");
    preset.below(&format!("{name}: level force"), worst[0], preset.part);
    preset.below(&format!("{name}: force at the end"), worst[1], preset.part);
    preset.below(&format!("{name}: sag"), worst[2], preset.part);
    preset.below(&format!("{name}: gap"), gap, preset.gap);
}

/// A chain of 100 links of 0.1 m over 8 m keeps its shape and bears what statics say.
#[test]
fn a_hanging_chain_bears_its_weight() {
    for preset in Preset::both() {
        catenary::<Rigid2, 2, 1>(&preset);
        catenary::<Rigid3, 3, 3>(&preset);
    }
}

/// A joint under weight W gives way by `stretch` W / (weight of the mechanism) at most. For 100
/// links of 1 kg that carry 1000 kg the sum is 96.4 times the setting. It is half of this at least.
#[test]
fn a_chain_under_a_heavy_load_stretches_by_the_setting() {
    for preset in Preset::both() {
        let mut world: World<Rigid3, 3, 3> = preset.world();
        let (mut before, mut joints) = (None, Vec::new());
        for i in 0..=100 {
            let top = -0.1 * i as f64;
            let (mass, length) = if i < 100 { (1.0, 0.1) } else { (1000.0, 0.5) };
            let half = if i < 100 { 0.02 } else { 0.25 };
            let own = block(mass, [0.5 * length, half, half]);
            let id = world.add(bar([[0.0, top], [0.0, top - length]], own)).unwrap();
            let joint = Joint::ball([Some(id), before]).at([0.0, top as f32, 0.0]);
            joints.push(world.join(joint).unwrap());
            before = Some(id);
        }
        run(&mut world, 2.0);
        let sum: f64 = joints.iter().map(|&id| world.joint(id).unwrap().gap).sum();
        let expected = 96.4091 * f64::from(preset.settings.stretch);
        preset.below("stretch of a heavy chain", sum, expected);
        preset.below("half of the stretch", 0.5 * expected, sum);
        let force = world.joint(joints[0]).unwrap().force;
        preset.check("force of a heavy chain", force, 1100.0 * ACCELERATION);
    }
}

/// 10 kg hang on a joint that breaks at 98.2 N, and fall from one that breaks at 98.0 N.
#[test]
fn a_joint_breaks_beyond_its_strength() {
    for preset in Preset::both() {
        for force in [98.2, 98.0] {
            let mut world: World<Rigid2, 2, 1> = preset.world();
            let body = world.add(ghost([0.0, -0.5, 0.0], inertia(10.0, [1.0; 3]))).unwrap();
            let joint =
                Joint::ball([Some(body), None]).breaking(Breaking { force, ..Breaking::NEVER });
            let joint = world.join(joint).unwrap();
            let (mut broken, mut held) = (Vec::new(), 0.0);
            for step in 1..=120 {
                let own = world.step(DT).unwrap().broken;
                if !own.is_empty() {
                    held = f64::from(DT) * f64::from(step);
                }
                broken.extend(own);
            }
            let is_broken = world.joint(joint).unwrap().broken;
            assert_eq!(is_broken, force < 98.1);
            assert_eq!(broken.len(), usize::from(is_broken));
            let time = if is_broken { 120.0 * f64::from(DT) - held } else { 0.0 };
            let way = f64::from(place(&world, body)[1]) + 0.5;
            let expected = -0.5 * ACCELERATION * time * time;
            preset.check_of(&format!("strength {force}"), way, expected, 20.0);
        }
    }
}

/// 1 kg at 1 m that accelerates by 1 rad/s^2 pulls with sqrt(t^4 + 1) N. It breaks a joint of 100 N
/// at 9.99975 s, whatever the number of substeps.
#[test]
fn when_a_joint_breaks_does_not_depend_on_substeps() {
    for preset in Preset::both() {
        for substeps in [2, 4, 8, 16, 32] {
            let preset = Preset {
                settings: StepSettings { substeps, ..preset.settings.clone() },
                ..preset.clone()
            };
            let mut world: World<Rigid2, 2, 1> = preset.weightless();
            let body = world.add(ghost([1.0, 0.0, 0.0], inertia(1.0, [0.1; 3]))).unwrap();
            let motor = Drive::velocity(1e3).at_most(1.1);
            let joint = pin([Some(body), None], [0.0; 2]).drive(motor);
            let joint = joint.breaking(Breaking { force: 100.0, ..Breaking::NEVER });
            world.join(joint).unwrap();
            let mut steps = 1;
            while steps < 650 && world.step(DT).unwrap().broken.is_empty() {
                steps += 1;
            }
            // The mean over the step from 599 to 600 frames is the first above 100 N, or the next.
            println!("{}, {substeps} substeps: {steps} steps", preset.name);
            assert!((600..=601).contains(&steps), "{} of {substeps} substeps", preset.name);
        }
    }
}

/// A ball of 1 kg hits a block that glue of 1 kN holds to the world. In 1/240 s glue takes 4.2 N s: it
/// breaks at 20 m/s and holds at 3, in long steps and in short ones.
#[test]
fn a_blow_breaks_glue_in_steps_of_any_length() {
    for substeps in [8, 16] {
        for (rate, speed) in [(24, 3.0), (24, 20.0), (60, 3.0), (60, 20.0), (240, 3.0), (240, 20.0)]
        {
            let count = substeps * 60 / rate;
            let settings = StepSettings { substeps: count.max(1), ..StepSettings::certified() };
            let mut world: World<Rigid3, 3, 3> = World::new(settings);
            let block = dynamic([0.0; 3], Rigid3::cuboid([0.2; 3]), &Material::default());
            let block = world.add(block).unwrap();
            let breaking = Breaking { force: 1000.0, ..Breaking::NEVER };
            let glue = Joint::fixed([Some(block), None]).breaking(breaking);
            let glue = world.join(glue).unwrap();
            let mut ball = dynamic([-0.6, 0.0, 0.0], Rigid3::ball(0.2), &Material::default());
            ball.inertia = Some(inertia(1.0, [0.02; 3]));
            ball.velocity.linear = Vector([speed, 0.0, 0.0]);
            world.add(ball).unwrap();
            for _ in 0..rate / 2 {
                world.step(1.0 / rate as f32).unwrap();
            }
            let is_broken = world.joint(glue).unwrap().broken;
            assert_eq!(is_broken, speed > 5.0, "{substeps}, {rate} per second, {speed} m/s");
        }
    }
}

/// A body of 1 kg falls into a rope or onto the limit of a slider, which it reaches anywhere in a step. A thread
/// takes next to nothing of its momentum, and an impulse breaks what it exceeds, however long steps are.
#[test]
fn a_blow_breaks_limits_anywhere_in_a_step() {
    for (preset, rate) in Preset::both()
        .into_iter()
        .flat_map(|preset| [24.0f64, 60.0, 240.0].map(|rate| (preset.clone(), rate)))
    {
        for (part, slides) in (0..25u8).flat_map(|part| [(part, true), (part, false)]) {
            let length = 0.5 + 0.02 * f64::from(part);
            let momentum = (2.0 * ACCELERATION * length).sqrt();
            let fall = |breaking: Breaking| -> (bool, f64) {
                let mut world: World<Rigid3, 3, 3> = preset.world();
                let mut body = Body::new(Motion::Dynamic, [0.0; 3], Rigid3::ball(0.1));
                body.inertia = Some(block(1.0, [0.1; 3]));
                let id = world.add(body).unwrap();
                let pair = [Some(id), None];
                let joint = if slides {
                    Joint::slider(pair).at([0.0; 3]).about([0.0, -1.0, 0.0]).limits(-1.0..=length)
                } else {
                    Joint::rope(pair, length).at([0.0; 3])
                };
                let joint = world.join(joint.breaking(breaking)).unwrap();
                let steps = (0.7 * rate).round();
                for _ in 0..steps as usize {
                    world.step((1.0 / rate) as f32).unwrap();
                }
                let speed = f64::from(world.velocity(id).unwrap().linear[1]);
                (world.joint(joint).unwrap().broken, speed + ACCELERATION * steps / rate)
            };
            let what = |of: &str| format!("{of} at {rate} Hz, {length} m, slides: {slides}");
            let (broken, taken) = fall(Breaking { force: 1.0, ..Breaking::NEVER });
            assert!(broken, "{}", what("thread"));
            preset.below(&what("part of a momentum taken"), taken.abs() / momentum, 0.03);
            let (broken, _) = fall(Breaking { impulse: 0.9 * momentum, ..Breaking::NEVER });
            assert!(broken, "{}, {}", preset.name, what("less than the momentum"));
            let (broken, _) = fall(Breaking { impulse: 1.2 * momentum, ..Breaking::NEVER });
            assert!(!broken, "{}, {}", preset.name, what("more than the momentum"));
            let (broken, _) = fall(Breaking { force: 100.0, ..Breaking::NEVER });
            assert!(broken, "{}, {}", preset.name, what("a force"));
        }
    }
}
