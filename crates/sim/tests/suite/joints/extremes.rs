//! Joints where a step goes wrong first: loads of a thousand times the links, whips, impacts on legs
//! and glue, joints that fold up, static bodies.

use drystone::geometry::Rigid3;
use drystone::{Breaking, Joint, Material, World};
use drystone_solver::{Vector, Velocity};

use super::*;

type World3 = World<Rigid3, 3, 3>;

/// Returns kinetic plus potential energy. \[J\]
fn energy(world: &World3) -> f64 {
    let measure = world.measure();
    measure.kinetic_energy + measure.potential_energy
}

/// Hangs a chain of `count` links of 1 kg and `length` \[m\] from a point, at an angle \[rad\] from
/// straight down. A load of this mass \[kg\] follows, if it is not 0. `push` is a velocity across
/// the plane. \[m/s\]
fn hang(
    world: &mut World3,
    (above, count, length): (Option<BodyId>, usize, f64),
    (load, angle, push): (f64, f64, f64),
) -> Vec<BodyId> {
    let at = |way: f64| [way * angle.sin(), -way * angle.cos()];
    let (mut before, mut ids) = (above, Vec::new());
    for i in 0..count + usize::from(load > 0.0) {
        let top = length * i as f64;
        let (mass, own, half) = if i < count { (1.0, length, 0.02) } else { (load, 0.5, 0.25) };
        let inertia = block(mass, [0.5 * own, half, half]);
        let mut body = bar([at(top), at(top + own)], inertia);
        body.velocity.linear = Vector([0.0, 0.0, (push * top) as f32]);
        let id = world.add(body).unwrap();
        let [x, y] = at(top).map(|own| own as f32);
        // The frame is turned, so that rounding moves the chain out of its plane.
        let joint = Joint::ball([Some(id), before]).at([x, y, 0.0]).about([0.0, 0.0, 1.0]);
        world.join(joint).unwrap();
        (before, ids) = (Some(id), [ids, vec![id]].concat());
    }
    ids
}

/// Takes steps for `seconds`. Returns the largest gap \[m\] and the largest rise of the energy \[J\].
fn watch(world: &mut World3, seconds: f64) -> [f64; 2] {
    let (start, mut worst) = (energy(world), [0.0f64; 2]);
    for _ in 0..(seconds / f64::from(DT)).round() as usize {
        let report = world.step(DT).unwrap();
        assert!(report.not_finite.is_empty(), "{:?}", report.not_finite);
        let rise = energy(world) - start;
        worst = [worst[0].max(report.joint_gap[0]), worst[1].max(rise)];
    }
    worst
}

/// Ten links of 1 kg carry 1000 kg, let go at 30 degrees with a push across. Explicit moments of
/// their pulls would let them explode within a step.
#[test]
fn a_heavy_chain_swings_in_space() {
    for preset in Preset::both() {
        let mut world: World3 = preset.world();
        let angle = 30.0f64.to_radians();
        hang(&mut world, (None, 10, 0.5), (1000.0, angle, 0.1));
        let swing = 1000.0 * ACCELERATION * 5.0 * (1.0 - angle.cos());
        let [gap, rise] = watch(&mut world, 4.0);
        preset.below("gap of a heavy chain", gap, 2.0 * preset.gap);
        preset.below("rise of its energy", rise / swing, 1e-3);
    }
}

/// Thirty links fall like a whip. At the crack they turn by more than a radian within a substep of
/// the setting.
#[test]
fn a_whip_cracks_and_stays_whole() {
    for preset in Preset::both() {
        let mut world: World3 = preset.world();
        hang(&mut world, (None, 30, 0.1), (0.0, 90.0f64.to_radians(), 0.05));
        let [gap, rise] = watch(&mut world, 3.0);
        preset.below("gap of a whip", gap, 20.0 * preset.gap);
        preset.below("rise of its energy", rise / (30.0 * ACCELERATION * 1.5), preset.energy);
    }
}

/// A chain hangs on a static body as on the world, to rounding, and leaves it where it is.
#[test]
fn a_static_body_holds_like_the_world() {
    for preset in Preset::both() {
        let [free, held] = [false, true].map(|is_held| {
            let mut world: World3 = preset.world();
            let wall = Body::new(Motion::Static, [0.0, 0.5, 0.0], Rigid3::cuboid([0.1; 3]));
            let wall = world.add(wall).unwrap();
            let above = is_held.then_some(wall);
            let ids = hang(&mut world, (above, 10, 0.5), (1000.0, 0.3, 0.0));
            run(&mut world, 1.0);
            assert_eq!(place(&world, wall), Vector([0.0, 0.5, 0.0]));
            ids.iter().map(|&id| place(&world, id)).collect::<Vec<_>>()
        });
        for (own, other) in free.iter().zip(&held) {
            let apart = f64::from((*own - *other).length());
            preset.below("apart", apart, 1e-5);
        }
    }
}

/// 500 kg on two legs with knees land on the floor at 4 m/s. The energy never rises.
#[test]
fn a_load_on_legs_lands() {
    let preset = Preset::bake();
    let mut world: World3 = preset.world();
    let floor = Body::new(Motion::Static, [0.0, -0.5, 0.0], Rigid3::cuboid([50.0, 0.5, 50.0]));
    world.add(floor).unwrap();
    let part = |world: &mut World3, at: [f32; 3], half: [f32; 3], mass: f64| {
        let mut body = dynamic(at, Rigid3::cuboid(half), &Material::default());
        body.inertia = Some(block(mass, half.map(f64::from)));
        body.velocity.linear = Vector([0.0, -4.0, 0.0]);
        world.add(body).unwrap()
    };
    let torso = part(&mut world, [0.0, 1.2, 0.0], [0.1, 0.3, 0.2], 500.0);
    for z in [-0.1, 0.1] {
        let thigh = part(&mut world, [0.0, 0.69, z], [0.06, 0.2, 0.06], 8.0);
        let shin = part(&mut world, [0.0, 0.27, z], [0.05, 0.2, 0.05], 4.0);
        world.join(Joint::ball([Some(thigh), Some(torso)]).at([0.0, 0.9, z])).unwrap();
        let knee = Joint::hinge([Some(shin), Some(thigh)]).at([0.0, 0.48, z]);
        world.join(knee.about([0.0, 0.0, 1.0]).limits(-2.4..=0.0)).unwrap();
    }
    let [gap, rise] = watch(&mut world, 1.5);
    preset.below("gap of a leg", gap, 1e-3);
    preset.below("rise of the energy", rise / (0.5 * 500.0 * 16.0), 1e-3);
}

/// Parts of a figure 1.8 m tall: center and half-extents \[m\], and mass \[kg\].
type Part = ([f32; 3], [f32; 3], f64);

/// A figure whose torso has 500 kg falls on its feet, and over, at any speed. Its legs turn fast where
/// they are stopped, and bear 200 times their weight between the torso and the floor.
#[test]
fn a_heavy_figure_stays_whole() {
    for preset in Preset::both() {
        let is_bake = preset.name == "bake";
        let most = if is_bake { [5e-4, 0.15] } else { [1.5e-3, 0.5] };
        for speed in [0.0, 0.1, 0.2, 0.4, 0.7, 1.0] {
            let [gap, angle] = heavy_figure(&preset, [speed, 0.0, 0.5 * speed]);
            preset.below(&format!("gap of a heavy figure at {speed} m/s"), gap, most[0]);
            preset.below("angle off its hinges", angle.to_degrees(), most[1]);
        }
    }
}

/// Returns the largest gap \[m\] and angle \[rad\] of the joints of a figure with this velocity in
/// two seconds.
fn heavy_figure(preset: &Preset, velocity: [f32; 3]) -> [f64; 2] {
    let mut world: World3 = preset.world();
    let floor = Body::new(Motion::Static, [0.0, -0.5, 0.0], Rigid3::cuboid([50.0, 0.5, 50.0]));
    world.add(floor).unwrap();
    let mut part = |(at, half, mass): Part| {
        let at = [at[0], at[1] + 2.0, at[2]];
        let mut body = dynamic(at, Rigid3::cuboid(half), &Material::default());
        body.inertia = Some(block(mass, half.map(f64::from)));
        body.velocity.linear = Vector(velocity);
        world.add(body).unwrap()
    };
    let pelvis = part(([0.0; 3], [0.1, 0.08, 0.15], 12.0));
    let torso = part(([0.0, 0.33, 0.0], [0.1, 0.24, 0.17], 500.0));
    let head = part(([0.0, 0.72, 0.0], [0.09, 0.12, 0.09], 5.0));
    let limbs = [1.0, -1.0].map(|side| {
        let thigh = part(([0.0, -0.29, 0.09 * side], [0.06, 0.2, 0.06], 8.0));
        let shin = part(([0.0, -0.71, 0.09 * side], [0.05, 0.2, 0.05], 4.0));
        let arm = part(([0.0, 0.4, 0.22 * side], [0.04, 0.15, 0.04], 2.5));
        let hand = part(([0.0, 0.08, 0.22 * side], [0.035, 0.15, 0.035], 2.0));
        (side, [thigh, shin, arm, hand])
    });
    let ball =
        |bodies: [BodyId; 2], [y, z]: [f32; 2]| Joint::ball(bodies.map(Some)).at([0.0, y + 2.0, z]);
    let hinge = |bodies: [BodyId; 2], [y, z]: [f32; 2], range| {
        let hinge = Joint::hinge(bodies.map(Some)).at([0.0, y + 2.0, z]);
        hinge.about([0.0, 0.0, 1.0]).limits(range)
    };
    world.join(ball([torso, pelvis], [0.085, 0.0])).unwrap();
    world.join(ball([head, torso], [0.585, 0.0])).unwrap();
    for (side, [thigh, shin, arm, hand]) in limbs {
        world.join(ball([thigh, pelvis], [-0.085, 0.09 * side])).unwrap();
        world.join(hinge([shin, thigh], [-0.5, 0.09 * side], -2.4..=0.0)).unwrap();
        world.join(ball([arm, torso], [0.555, 0.22 * side])).unwrap();
        world.join(hinge([hand, arm], [0.24, 0.22 * side], 0.0..=2.4)).unwrap();
    }
    let mut worst = [0.0f64; 2];
    for _ in 0..120 {
        let gap = world.step(DT).unwrap().joint_gap;
        worst = [0, 1].map(|i| worst[i].max(gap[i]));
    }
    worst
}

/// Nets of balls that are held to their neighbors lie in one plane, where their rows are nearly
/// dependent. They are let go, from starts that hardly differ. They stay together, and gain no energy.
#[test]
fn a_net_in_one_plane_holds() {
    for preset in Preset::both() {
        for (start, by_corners) in (0..3u8).flat_map(|start| [(start, true), (start, false)]) {
            let size = if start == 0 { 0.1 } else { 1.0 };
            let mut world: World3 = preset.world();
            world.gravity[1] *= 1.0 + 1e-5 * f32::from(start);
            net(&mut world, size, by_corners);
            let (mut gap, mut least, mut gained) = (0.0f64, f64::INFINITY, 0.0f64);
            for _ in 0..180 {
                gap = gap.max(world.step(DT).unwrap().joint_gap[0]);
                let now = energy(&world);
                least = least.min(now);
                gained = gained.max(now - least);
            }
            let held = if by_corners { "corners" } else { "an edge" };
            let name = format!("a net of {size} m held by {held}");
            let most = if preset.name == "bake" { 1e-3 } else { 8e-3 };
            preset.below(&format!("gap of {name}"), gap, most * f64::from(size));
            // 90 kg, which can fall by the width of the net.
            let part = gained / (90.0 * ACCELERATION * 10.0 * f64::from(size));
            preset.below(&format!("energy from nothing of {name}"), part, 0.005);
        }
    }
}

/// Adds a level net of 100 balls of 1 kg, `size` \[m\] from each other. It is held by its corners or an edge.
fn net(world: &mut World3, size: f32, by_corners: bool) {
    let mut ids = Vec::new();
    for (i, j) in (0..10u8).flat_map(|j| (0..10u8).map(move |i| (i, j))) {
        let is_held = if by_corners { i % 9 == 0 && j % 9 == 0 } else { j == 0 };
        let motion = if is_held { Motion::Static } else { Motion::Dynamic };
        let at = |x: f32, z: f32| [x * size, 0.0, z * size];
        let [x, z] = [i, j].map(f32::from);
        let mut ball = Body::new(motion, at(x, z), Rigid3::ball(0.4 * size));
        ball.inertia = (!is_held).then(|| block(1.0, [0.4 * f64::from(size); 3]));
        ids.push(world.add(ball).unwrap());
        let own = ids.len() - 1;
        let mut hold = |other: usize, at: [f32; 3]| {
            if by_corners || !is_held {
                let pair = [Some(ids[own]), Some(ids[other])];
                world.join(Joint::ball(pair).at(at)).unwrap();
            }
        };
        if i > 0 {
            hold(own - 1, at(x - 0.5, z));
        }
        if j > 0 {
            hold(own - 10, at(x, z - 0.5));
        }
    }
}

/// Bodies on arms of many lengths start far from where an angle or a position is locked, with nothing
/// or with a chain that hangs from them. The locks take them there, which adds energy, and hold them.
#[test]
fn locks_take_bodies_to_their_places() {
    let locks = [("hinge", 0.5), ("hinge", -2.5), ("slider", 0.6)];
    for preset in Preset::both() {
        for arm in [0.0, 0.1, 1.0, 10.0] {
            for (kind, lock) in locks {
                for links in [0, 4] {
                    let mut world: World3 = preset.world();
                    let mut body = Body::new(Motion::Dynamic, [arm, 0.0, 0.0], Rigid3::ball(0.2));
                    body.inertia = Some(block(1.0, [0.3, 0.2, 0.1]));
                    let id = world.add(body).unwrap();
                    let pair = [Some(id), None];
                    let joint = match kind {
                        "hinge" => Joint::hinge(pair).about([0.0, 0.0, 1.0]),
                        _ => Joint::slider(pair).about([1.0, 0.0, 0.0]),
                    };
                    world.join(joint.at([0.0; 3]).limits(lock..=lock)).unwrap();
                    let mut before = id;
                    for i in 0..links {
                        let y = -0.5 * i as f32;
                        let mut link =
                            Body::new(Motion::Dynamic, [arm, y - 0.25, 0.0], Rigid3::ball(0.1));
                        link.inertia = Some(block(1.0, [0.05, 0.25, 0.05]));
                        let link = world.add(link).unwrap();
                        let joint = Joint::ball([Some(link), Some(before)]).at([arm, y, 0.0]);
                        world.join(joint).unwrap();
                        before = link;
                    }
                    let mut gap = [0.0f64; 2];
                    for _ in 0..240 {
                        gap = world.step(DT).unwrap().joint_gap;
                    }
                    let name = format!("{kind} of {arm} m to {lock}, {links} links");
                    let is_long = preset.name == "real time" && arm > 1.0;
                    let most = if is_long { 2e-3 } else { 1e-3 };
                    preset.below(&format!("gap of a {name}"), gap[0], most);
                    preset.below(
                        &format!("angle of a {name}"),
                        gap[1],
                        1e-3 * f64::from(arm).max(1.0),
                    );
                }
            }
        }
    }
}

/// A ball of 500 kg on six links of 2 kg, let go at 58.4 to 61.1 degrees, swings into a wall of bricks, in
/// long steps. The links come slack and are pulled straight again; bricks turn them far in a substep.
#[test]
fn a_heavy_ball_on_links_breaks_a_wall() {
    for preset in Preset::both() {
        let mut missed = 0;
        let is_bake = preset.name == "bake";
        for later in [-7i8, -5, -4, -2, 0, 1, 4, 5] {
            let angle = std::f32::consts::FRAC_PI_3 + 0.004 * f32::from(later);
            let [gap, error] = break_a_wall(&preset, angle);
            let name = format!("chain with a heavy ball from {angle}");
            preset.below(&format!("gap of a {name}"), gap, if is_bake { 1e-4 } else { 2e-3 });
            if is_bake {
                // One step of two of them may miss the tolerance, by chance of their motion: it does
                // for 5 to 7 of 31 angles.
                preset.below(&format!("error of a {name}"), error, 1e-2);
                missed += u32::from(error > 1e-3);
            }
        }
        preset.below("chains that miss the tolerance", f64::from(missed), 2.0);
    }
}

/// Returns the largest gap of a joint, and the largest certified error \[m/s\].
fn break_a_wall(preset: &Preset, angle: f32) -> [f64; 2] {
    let mut world: World3 = preset.world();
    let ground = Rigid3::halfspace([0.0, 1.0, 0.0]);
    world.add(Body::new(Motion::Static, [0.0; 3], ground)).unwrap();
    let half = [0.2, 0.1, 0.1];
    for (row, column) in (0..5u8).flat_map(|row| (0..16u8).map(move |column| (row, column))) {
        let shift = if row % 2 == 0 { -0.25 } else { 0.25 };
        let x = 0.4 * (f32::from(column) - 7.5 + shift);
        let at = [x, 0.1 + 0.2 * f32::from(row), 0.0];
        world.add(dynamic(at, Rigid3::cuboid(half), &Material::default())).unwrap();
    }
    let at = |s: f32| [0.0, 3.85 - s * angle.cos(), -s * angle.sin()];
    let mut part = |s: f32, radius: f32, mass: f64| {
        let mut body = dynamic(at(s), Rigid3::ball(radius), &Material::default());
        body.inertia = Some(block(mass, [f64::from(radius); 3]));
        world.add(body).unwrap()
    };
    let mut parts: Vec<_> = (0..6u8).map(|i| part(0.25 + 0.5 * f32::from(i), 0.05, 2.0)).collect();
    parts.push(part(3.25, 0.25, 500.0));
    world.join(Joint::ball([Some(parts[0]), None]).at(at(0.0))).unwrap();
    for (i, pair) in (1..7u8).zip(parts.windows(2)) {
        let pair = [Some(pair[1]), Some(pair[0])];
        world.join(Joint::ball(pair).at(at(0.5 * f32::from(i)))).unwrap();
    }
    let mut worst = [0.0f64; 2];
    for _ in 0..72 {
        let report = world.step(1.0 / 24.0).unwrap();
        let error = report.certified.map_or(0.0, |of| of.error);
        worst = [worst[0].max(report.joint_gap[0]), worst[1].max(error)];
    }
    worst
}

/// A free chain of universal joints tumbles and folds up: its angles pass the place where twist and
/// swing are not defined. It stays finite and gains no energy.
#[test]
fn universal_joints_fold_up() {
    for preset in Preset::both() {
        let mut world: World3 = preset.weightless();
        let mut random = Random(5);
        let ids: Vec<BodyId> = (0..7)
            .map(|i| {
                let mut body = ghost([0.4 * i as f64, 0.0, 0.0], block(1.0, [0.2, 0.1, 0.05]));
                let (linear, angular) = (random.vector(1.0), random.vector(3.0));
                body.velocity = Velocity { linear: Vector(linear), angular: Vector(angular) };
                world.add(body).unwrap()
            })
            .collect();
        for (i, pair) in ids.windows(2).enumerate() {
            let joint = Joint::universal([Some(pair[0]), Some(pair[1])]);
            world.join(joint.at([0.4 * i as f32 + 0.2, 0.0, 0.0])).unwrap();
        }
        run(&mut world, DT);
        let before = energy(&world);
        let [gap, rise] = watch(&mut world, 10.0);
        preset.below("gap of a folding chain", gap, 1e-3);
        preset.below("rise of its energy", rise / before, preset.energy);
    }
}

/// A ball of 50 kg hits glued walls at 15 m/s: glue breaks, no energy appears, and nothing flies
/// faster than the ball. It breaks through where the glue is weak; locks that held until the end of
/// the step would throw it back.
#[test]
fn a_ball_breaks_a_glued_wall() {
    let [bake, real_time] = Preset::both();
    let small =
        [1.0, 4.0, 10.0, 20.0].map(|times| [(&bake, 4, 4, times), (&real_time, 4, 4, times)]);
    for (preset, columns, rows, times) in small.into_iter().flatten().chain([(&bake, 8, 6, 1.0)]) {
        let mut world: World3 = preset.world();
        let floor = Body::new(Motion::Static, [0.0, -0.5, 0.0], Rigid3::cuboid([50.0, 0.5, 50.0]));
        world.add(floor).unwrap();
        let at = |column: usize, row: usize| [0.4 * column as f32, 0.1 + 0.2 * row as f32, 0.0];
        let brick = Rigid3::cuboid([0.2, 0.1, 0.1]);
        let mut ids = Vec::new();
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |at| (row, at))) {
            let body = dynamic(at(column, row), brick.clone(), &Material::default());
            ids.push(world.add(body).unwrap());
            let own = *ids.last().unwrap();
            let left = (column > 0).then(|| (ids[ids.len() - 2], [-0.2, 0.0]));
            let below = (row > 0).then(|| (ids[ids.len() - 1 - columns], [0.0, -0.1]));
            for (other, [x, y]) in left.into_iter().chain(below) {
                let [at_x, at_y, _] = at(column, row);
                let glue = Joint::fixed([Some(own), Some(other)]).at([at_x + x, at_y + y, 0.0]);
                let breaking =
                    Breaking { force: 2000.0 * times, torque: 200.0 * times, ..Breaking::NEVER };
                world.join(Joint { collide: true, ..glue.breaking(breaking) }).unwrap();
            }
        }
        let middle = 0.2 * (columns - 1) as f32;
        let mut ball = dynamic([middle, 0.5, 1.0], Rigid3::ball(0.2), &Material::default());
        ball.inertia = Some(inertia(50.0, [0.8; 3]));
        ball.velocity.linear = Vector([0.0, 0.0, -15.0]);
        let ball = world.add(ball).unwrap();
        let start = 0.5 * 50.0 * 15.0f64.powi(2);
        let [_, rise] = watch(&mut world, 1.0);
        preset.below("rise of the energy", rise / start, preset.energy);
        preset.below("fastest", world.measure().fastest, 15.0 + ACCELERATION);
        let joints: Vec<_> = world.joints().collect();
        let broken = joints.iter().filter(|&&id| world.joint(id).unwrap().broken).count();
        println!("{}, {times}: {broken} of {} broke", preset.name, joints.len());
        if times == 1.0 {
            let through = -f64::from(world.velocity(ball).unwrap().linear[2]);
            preset.below("speed of a ball behind the wall", 2.0, through);
        }
        assert!(broken > 0 || times > 4.0);
    }
}

/// A ball of 500 kg at 15 m/s drives one of two glued blocks into the other. The glue breaks in the
/// middle of a step. From then on the blocks touch: contacts from the next step on let one pass 0.15 m
/// into the other.
#[test]
fn what_breaks_apart_collides_within_the_step() {
    for preset in Preset::both() {
        let mut world: World3 = preset.weightless();
        let cube = |x: f32| dynamic([x, 0.0, 0.0], Rigid3::cuboid([0.2; 3]), &Material::default());
        let ids = [0.0, 0.4].map(|x| world.add(cube(x)).unwrap());
        let breaking = Breaking { force: 100.0, ..Breaking::NEVER };
        let glue = Joint::fixed(ids.map(Some)).at([0.2, 0.0, 0.0]).breaking(breaking);
        let glue = world.join(glue).unwrap();
        let mut ball = dynamic([-0.45, 0.0, 0.0], Rigid3::ball(0.2), &Material::default());
        ball.inertia = Some(inertia(500.0, [8.0; 3]));
        ball.velocity.linear = Vector([15.0, 0.0, 0.0]);
        world.add(ball).unwrap();
        let mut overlap = 0.0f32;
        for _ in 0..10 {
            world.step(DT).unwrap();
            let [first, second] = ids.map(|id| place(&world, id)[0]);
            overlap = overlap.max(0.4 - (second - first));
        }
        assert!(world.joint(glue).unwrap().broken);
        let h = f64::from(DT) / f64::from(preset.settings.substeps);
        preset.below("overlap of the blocks", f64::from(overlap), 15.0 * h);
    }
}

/// Five elastic balls of 1 kg hang side by side on rods of 1 m. The first falls from 40 degrees: the
/// last one rises, the others hang still, and so on for 6 s. The energy stays.
#[test]
fn a_blow_passes_through_a_cradle() {
    for preset in Preset::both() {
        let mut world: World3 = preset.world();
        let material = Material { restitution: 1.0, friction: 0.0, ..Material::default() };
        let apart = |i: usize| 0.2001 * i as f32;
        let ids = [0, 1, 2, 3, 4].map(|i| {
            let angle = if i == 0 { 40.0f32.to_radians() } else { 0.0 };
            let at = [apart(i) - angle.sin(), -angle.cos(), 0.0];
            let mut ball = dynamic(at, Rigid3::ball(0.1), &material);
            ball.inertia = Some(inertia(1.0, [0.004; 3]));
            let id = world.add(ball).unwrap();
            world.join(Joint::ball([Some(id), None]).at([apart(i), 0.0, 0.0])).unwrap();
            id
        });
        let start = energy(&world);
        let (mut highest, mut inner) = ([0.0f64; 2], 0.0f64);
        for step in 0..360 {
            world.step(DT).unwrap();
            let angle = |i: usize| f64::from(place(&world, ids[i])[0] - apart(i)).asin();
            // By half swings of 1.03 s, of which the first begins in the middle.
            let side = (step + 31) / 62 % 2;
            let outer = if side == 0 { -angle(0) } else { angle(4) };
            highest[side] = highest[side].max(if step > 62 { outer } else { 0.0 });
            inner = inner.max((1..4).map(|i| angle(i).abs()).fold(0.0, f64::max));
        }
        for (name, highest) in ["first", "last"].into_iter().zip(highest) {
            let angle = highest.to_degrees();
            preset.check(&format!("height of the {name} ball"), angle, 39.5);
        }
        preset.below("swing of the others", inner.to_degrees(), 0.5);
        let lost = (start - energy(&world)) / (ACCELERATION * (1.0 - 40.0f64.to_radians().cos()));
        preset.below("lost energy", lost.abs(), 0.05);
    }
}

/// An elastic ball of 1 kg at 2 m/s hits two halves of 0.5 kg that are locked to each other; a third
/// ball touches the second half. The blow passes through the lock to it within the step: without
/// that it would get 2/3 m/s in a bake. Locks take energy, else it would get all 2 m/s.
#[test]
fn a_blow_passes_through_a_lock() {
    for preset in Preset::both() {
        let mut world: World3 = preset.weightless();
        let material = Material { restitution: 1.0, friction: 0.0, ..Material::default() };
        let mut add = |x: f32, mass: f64, speed: f32| {
            let mut ball = dynamic([x, 0.0, 0.0], Rigid3::ball(0.1), &material);
            ball.inertia = Some(inertia(mass, [0.004 * mass; 3]));
            ball.velocity.linear = Vector([speed, 0.0, 0.0]);
            world.add(ball).unwrap()
        };
        let first = add(-0.3, 1.0, 2.0);
        let halves = [add(0.0, 0.5, 0.0), add(0.3, 0.5, 0.0)];
        let last = add(0.5001, 1.0, 0.0);
        world.join(Joint::fixed(halves.map(Some)).at([0.15, 0.0, 0.0])).unwrap();
        run(&mut world, 0.5);
        let speed = |id| f64::from(world.velocity(id).unwrap().linear[0]);
        let momentum = speed(first) + 0.5 * halves.map(speed).iter().sum::<f64>() + speed(last);
        preset.check("momentum behind a lock", momentum, 2.0);
        preset.below("speed behind a lock", 0.85, speed(last));
        assert!(speed(first) < speed(last));
    }
}
