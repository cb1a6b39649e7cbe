//! Bodies that are joined and collide: contacts that the locks hold bear nothing, and others do.

use drystone::geometry::{Geometry, Rigid2, Rigid3};
use drystone::{Joint, World};

use super::*;

/// Returns kinetic plus potential energy. \[J\]
fn energy<G: Dimension<L, A>, const L: usize, const A: usize>(world: &World<G, L, A>) -> f64 {
    let measure = world.measure();
    measure.kinetic_energy + measure.potential_energy
}

/// Hangs two blocks below a third that stands, each by a hinge at an edge that it shares with the
/// one above, at the right and at the left. The hinges are inside the edges by a part of the blocks'
/// half extent. Blocks collide with those they hang from. Returns the largest gap over the half
/// extent, and the largest rise of the energy over m g times it.
fn hang_from_edges<G: Rigid<L, A>, const L: usize, const A: usize>(
    preset: &Preset,
    (half, inset): (f64, f64),
) -> [f64; 2] {
    let mut world: World<G, L, A> = preset.world();
    let scaled = |by: f64| (by * half) as f32;
    let mut before = None;
    for i in 0..3 {
        let motion = if i == 0 { Motion::Static } else { Motion::Dynamic };
        let position = v(0.0, -scaled(2.0 * i as f64), 0.0);
        let mut body =
            Body::new(motion, position, G::cuboid(v(scaled(1.0), scaled(1.0), scaled(1.0))));
        body.inertia = Some(block(1.0, [half; 3]));
        let id = world.add(body).unwrap();
        if let Some(before) = before {
            let side = if i == 1 { 1.0 - inset } else { inset - 1.0 };
            let anchor = v(scaled(side), scaled(1.0 - 2.0 * i as f64), scaled(0.02));
            let joint = Joint::hinge([Some(before), Some(id)]).at(anchor).colliding();
            let joint = if A == 3 { joint.about(v(0.0, 0.0, 1.0)) } else { joint };
            world.join(joint).unwrap();
        }
        before = Some(id);
    }
    let (start, mut worst) = (energy(&world), [0.0f64; 2]);
    for _ in 0..240 {
        let report = world.step(DT).unwrap();
        worst[0] = worst[0].max(report.joint_gap[0]);
        worst[1] = worst[1].max((energy(&world) - start) / (ACCELERATION * half));
    }
    worst
}

/// At an edge that is an axis, contact and lock hold the same point: they would press against each
/// other with hundreds of times the weight, and throw the blocks.
#[test]
fn blocks_hang_from_edges_that_touch() {
    for preset in Preset::both() {
        for half in [0.05, 0.25, 2.0] {
            for inset in [0.0, 1e-4, 1e-3, 1e-2, 0.1] {
                let place = (half, inset);
                let both = [
                    hang_from_edges::<Rigid3, 3, 3>(&preset, place),
                    hang_from_edges::<Rigid2, 2, 1>(&preset, place),
                ];
                for [gap, rise] in both {
                    let name = format!("blocks of {half} m hinged {inset} from their edges");
                    preset.below(&format!("gap of {name}"), gap, 20.0 * preset.gap);
                    preset.below(&format!("energy of {name}"), rise, preset.energy);
                }
            }
        }
    }
}

/// Two blocks that overlap by half are welded, and fall on the ground as one body. Once the weld is
/// off, they come apart by repair.
#[test]
fn welded_blocks_overlap_until_they_are_parted() {
    for preset in Preset::both() {
        let mut world: World<Rigid3, 3, 3> = preset.world();
        let ground = Rigid3::halfspace([0.0, 1.0, 0.0]);
        world.add(Body::new(Motion::Static, [0.0; 3], ground)).unwrap();
        let ids = [0.0, 0.5].map(|x| {
            let shape = Rigid3::cuboid([0.5; 3]);
            world.add(Body::new(Motion::Dynamic, [x, 0.55, 0.0], shape)).unwrap()
        });
        let joint = world.join(Joint::fixed(ids.map(Some)).colliding()).unwrap();
        let apart = |world: &World<Rigid3, 3, 3>| {
            let [a, b] = ids.map(|id| Rigid3::frame(&world.pose(id).unwrap()).position);
            f64::from((b - a).length())
        };
        for _ in 0..60 {
            world.step(DT).unwrap();
        }
        preset.below("motion of a weld", (apart(&world) - 0.5).abs(), 10.0 * preset.gap);
        preset.below("speed of a weld", world.measure().kinetic_energy, 1e-4);
        world.enable_joint(joint, false).unwrap();
        for _ in 0..300 {
            world.step(DT).unwrap();
        }
        assert!(apart(&world) > 0.98, "{} m apart", apart(&world));
        preset.below("speed of repair", world.measure().kinetic_energy, 1e-2);
    }
}
