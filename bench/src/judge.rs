//! What came of a run, judged from poses alone; knows no engine.

use parry3d_f64::math::{Pose, Rotation};
use parry3d_f64::query::contact;
use parry3d_f64::shape::SharedShape;

use crate::engines::Placement;
use crate::scenes::Scene;

/// The shapes of a scene in double precision.
pub(crate) struct Judge<'a> {
    scene: &'a Scene,
    shapes: Vec<SharedShape>,
}

impl<'a> Judge<'a> {
    pub(crate) fn new(scene: &'a Scene) -> Self {
        Self { scene, shapes: scene.bodies.iter().map(|body| body.form.exact()).collect() }
    }

    /// Deepest overlap of any two bodies of which one can move: the shortest way apart. \[m\]
    pub(crate) fn deepest(&self, placements: &[Placement]) -> f64 {
        let poses: Vec<Pose> = placements.iter().map(pose).collect();
        let boxes: Vec<_> =
            self.shapes.iter().zip(&poses).map(|(shape, pose)| shape.compute_aabb(pose)).collect();
        let mut order: Vec<usize> = (0..boxes.len()).collect();
        order.sort_by(|&a, &b| boxes[a].mins.x.total_cmp(&boxes[b].mins.x));
        let mut deepest = 0.0f64;
        for (place, &a) in order.iter().enumerate() {
            let reached = order[place + 1..].iter();
            for &b in reached.take_while(|&&b| boxes[b].mins.x <= boxes[a].maxs.x) {
                let fixed = self.scene.bodies[a].fixed && self.scene.bodies[b].fixed;
                let apart = boxes[a].mins.cmpgt(boxes[b].maxs) | boxes[b].mins.cmpgt(boxes[a].maxs);
                if fixed || apart.any() {
                    continue;
                }
                let found = contact(&poses[a], &*self.shapes[a], &poses[b], &*self.shapes[b], 0.0);
                if let Ok(Some(found)) = found {
                    deepest = deepest.max(-found.dist);
                }
            }
        }
        deepest
    }

    /// Share of the bodies that can move that are within half their size of where they started.
    pub(crate) fn standing(&self, placements: &[Placement]) -> f64 {
        let bodies = self.scene.bodies.iter().zip(placements).filter(|(body, _)| !body.fixed);
        let (mut stand, mut count) = (0, 0);
        for (body, (position, _)) in bodies {
            let moved = position.iter().zip(&body.position).map(|(x, y)| f64::from(x - y).powi(2));
            stand += usize::from(moved.sum::<f64>().sqrt() < body.form.half_size());
            count += 1;
        }
        f64::from(stand as u32) / f64::from(count)
    }
}

fn pose(placement: &Placement) -> Pose {
    let [x, y, z, w] = placement.1.map(f64::from);
    Pose::from_parts(placement.0.map(f64::from).into(), Rotation::from_xyzw(x, y, z, w).normalize())
}
