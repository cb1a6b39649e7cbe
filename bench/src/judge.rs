//! Quality of a run, judged in double precision from poses alone and independent of the engine.

use drystone_scene::{Body, Motion, Rotation, Scene};

/// A scene starts at rest if every dynamic body is nearer than this to another body. \[m\]
const TOUCH: f64 = 0.01;

/// Exact shapes of a scene.
pub(crate) struct Judge<'a> {
    scene: &'a Scene,
    pieces: Pieces,
}

enum Pieces {
    Flat(Vec<flat::JudgedShape>),
    Space(Vec<space::JudgedShape>),
}

impl<'a> Judge<'a> {
    /// Builds the shapes of a scene.
    ///
    /// # Errors
    /// A shape has no exact form.
    pub(crate) fn new(scene: &'a Scene) -> Result<Self, String> {
        let pieces = match scene.dimension {
            2 => Pieces::Flat(flat::pieces(scene)?),
            _ => Pieces::Space(space::pieces(scene)?),
        };
        Ok(Self { scene, pieces })
    }

    /// Returns the number of values per body in a list of poses.
    fn stride(&self) -> usize {
        if self.scene.dimension == 2 { 3 } else { 7 }
    }

    /// Returns the largest penetration depth of two bodies, one of them dynamic; `None` if a pose
    /// is not finite. \[m\]
    pub(crate) fn deepest(&self, poses: &[f32]) -> Option<f64> {
        if poses.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let mut deepest = 0.0f64;
        self.near(poses, 0.0, |_, distance| deepest = deepest.max(-distance));
        Some(deepest)
    }

    /// Returns the largest distance by which a joint misses a locked position; `None` if a pose is
    /// not finite. \[m\]
    pub(crate) fn gap(&self, poses: &[f32]) -> Option<f64> {
        if poses.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let gap = match &self.pieces {
            Pieces::Flat(_) => flat::gap(self.scene, poses),
            Pieces::Space(_) => space::gap(self.scene, poses),
        };
        Some(gap)
    }

    /// Returns the fraction of dynamic bodies that are near their initial position. Near is within
    /// `tolerance` \[m\], or within half of their smallest extent. \[1\]
    pub(crate) fn standing(&self, poses: &[f32], tolerance: Option<f64>) -> f64 {
        let mut half_sizes = vec![f64::INFINITY; self.scene.bodies.len()];
        let mut note = |body: usize, half: f64| half_sizes[body] = half_sizes[body].min(half);
        match &self.pieces {
            Pieces::Flat(pieces) => pieces.iter().for_each(|p| note(p.body, p.half_size())),
            Pieces::Space(pieces) => pieces.iter().for_each(|p| note(p.body, p.half_size())),
        }
        let (mut stand, mut count) = (0u32, 0u32);
        let placed = self.scene.bodies.iter().zip(poses.chunks_exact(self.stride()));
        for ((body, pose), half_size) in placed.zip(half_sizes) {
            if body.motion == Motion::Dynamic {
                let moved =
                    pose.iter().zip(&body.position).map(|(&x, y)| (f64::from(x) - y).powi(2));
                stand += u32::from(moved.sum::<f64>().sqrt() < tolerance.unwrap_or(half_size));
                count += 1;
            }
        }
        f64::from(stand) / f64::from(count.max(1))
    }

    /// Returns true if the scene is built to stand still: there is gravity, nothing moves, and
    /// every dynamic body touches another one.
    pub(crate) fn starts_at_rest(&self) -> bool {
        let still = |body: &Body| {
            let rates = body.linear_velocity.iter().chain(&body.angular_velocity);
            body.motion != Motion::Kinematic && rates.fold(0.0, |sum: f64, x| sum + x.abs()) == 0.0
        };
        let weightless = self.scene.gravity.iter().all(|&g| g == 0.0);
        if weightless || !self.scene.bodies.iter().all(still) {
            return false;
        }
        let mut touched: Vec<bool> =
            self.scene.bodies.iter().map(|body| body.motion != Motion::Dynamic).collect();
        let start: Vec<f32> = self.scene.bodies.iter().flat_map(start).collect();
        self.near(&start, TOUCH, |pair, _| pair.into_iter().for_each(|body| touched[body] = true));
        touched.into_iter().all(|touched| touched)
    }

    /// Reports each pair of bodies, one of them dynamic, that are nearer than `reach`, with their
    /// distance; overlap is negative. \[m\]
    fn near(&self, poses: &[f32], reach: f64, mut found: impl FnMut([usize; 2], f64)) {
        match &self.pieces {
            Pieces::Flat(pieces) => flat::near(self.scene, pieces, poses, reach, &mut found),
            Pieces::Space(pieces) => space::near(self.scene, pieces, poses, reach, &mut found),
        }
    }
}

/// Returns the initial pose of a body in the format of engines.
fn start(body: &Body) -> Vec<f32> {
    let turn: &[f64] = match &body.rotation {
        Rotation::Angle(angle) => std::slice::from_ref(angle),
        Rotation::Quaternion(q) => q,
    };
    body.position.iter().chain(turn).map(|&x| x as f32).collect()
}

/// The judge in 2D and in 3D.
macro_rules! judge {
    ($name:ident: $parry:ident, $shapes:ident, $stride:literal, $placed:expr) => {
        mod $name {
            use std::collections::HashSet;

            use drystone_scene::{Coordinate, JointAxis, Motion, Rotation, Scene, ShapeKind};
            use $parry::bounding_volume::BoundingVolume;
            use $parry::math::Pose;
            use $parry::query::contact;
            use $parry::shape::SharedShape;

            use crate::shapes::$shapes::{pose, shape};

            /// A shape of a body.
            pub(super) struct JudgedShape {
                pub(super) body: usize,
                local: Pose,
                shape: SharedShape,
                boundless: bool,
            }

            impl JudgedShape {
                /// Returns half of the smallest extent of the bounding box. \[m\]
                pub(super) fn half_size(&self) -> f64 {
                    self.shape.compute_local_aabb().half_extents().min_element()
                }
            }

            pub(super) fn pieces(scene: &Scene) -> Result<Vec<JudgedShape>, String> {
                let mut pieces = Vec::new();
                for (body, of) in scene.bodies.iter().enumerate() {
                    for (number, part) in of.shapes.iter().enumerate() {
                        let shape = shape(&part.kind)
                            .map_err(|why| format!("body {body}, shape {number}: {why}"))?;
                        let local = pose(&part.position, &part.rotation);
                        let boundless = matches!(part.kind, ShapeKind::Halfspace { .. });
                        pieces.push(JudgedShape { body, local, shape, boundless });
                    }
                }
                Ok(pieces)
            }

            pub(super) fn gap(scene: &Scene, poses: &[f32]) -> f64 {
                let placed: fn(&[f32; $stride]) -> ([f64; $stride], Rotation) = $placed;
                let (bodies, _) = poses.as_chunks::<$stride>();
                let mut gap = 0.0f64;
                for joint in scene.joints.iter().filter(|joint| joint.enabled) {
                    let [a, b] = [0, 1].map(|side| {
                        let frame = &joint.frames[side];
                        let frame = pose(&frame.position, &frame.rotation);
                        joint.bodies[side].map_or(frame, |body| {
                            let (position, rotation) = placed(&bodies[body]);
                            pose(&position, &rotation) * frame
                        })
                    });
                    let offset = b.inv_mul(&a).translation;
                    let missed = |axis: &JointAxis| {
                        let [low, high] = axis.limits?;
                        let value = match axis.coordinate {
                            Coordinate::Linear(i) => offset[i],
                            Coordinate::Distance => offset.length(),
                            _ => return None,
                        };
                        (low == high).then(|| (value - low).powi(2))
                    };
                    let squared: f64 = joint.axes.iter().filter_map(missed).sum();
                    gap = gap.max(squared.sqrt());
                }
                gap
            }

            pub(super) fn near(
                scene: &Scene,
                pieces: &[JudgedShape],
                poses: &[f32],
                reach: f64,
                found: &mut impl FnMut([usize; 2], f64),
            ) {
                let placed: fn(&[f32; $stride]) -> ([f64; $stride], Rotation) = $placed;
                let (bodies, _) = poses.as_chunks::<$stride>();
                let poses: Vec<Pose> = pieces
                    .iter()
                    .map(|piece| {
                        let (position, rotation) = placed(&bodies[piece.body]);
                        pose(&position, &rotation) * piece.local
                    })
                    .collect();
                let boxes: Vec<_> = pieces
                    .iter()
                    .zip(&poses)
                    .map(|(piece, pose)| piece.shape.compute_aabb(pose).loosened(0.5 * reach))
                    .collect();
                let mut order: Vec<usize> = (0..pieces.len()).collect();
                order.sort_by(|&a, &b| boxes[a].mins.x.total_cmp(&boxes[b].mins.x));
                // Bodies that a joint keeps from colliding may overlap.
                let apart: HashSet<[usize; 2]> = scene
                    .joints
                    .iter()
                    .filter(|joint| !joint.collide)
                    .filter_map(|joint| Some([joint.bodies[0]?, joint.bodies[1]?]))
                    .flat_map(|[a, b]| [[a, b], [b, a]])
                    .collect();
                let moves =
                    |piece: usize| scene.bodies[pieces[piece].body].motion == Motion::Dynamic;
                for (place, &first) in order.iter().enumerate() {
                    let rest = order[place + 1..].iter();
                    for &second in rest.take_while(|&&b| boxes[b].mins.x <= boxes[first].maxs.x) {
                        if pieces[first].body == pieces[second].body
                            || apart.contains(&[pieces[first].body, pieces[second].body])
                            || !(moves(first) || moves(second))
                            || !boxes[first].intersects(&boxes[second])
                        {
                            continue;
                        }
                        // parry misplaces a half-space that is the second shape.
                        let [a, b] = match pieces[second].boundless {
                            true => [second, first],
                            false => [first, second],
                        };
                        let (shape_a, shape_b) = (&*pieces[a].shape, &*pieces[b].shape);
                        if let Ok(Some(nearest)) =
                            contact(&poses[a], shape_a, &poses[b], shape_b, reach)
                        {
                            found([pieces[a].body, pieces[b].body], nearest.dist);
                        }
                    }
                }
            }
        }
    };
}

judge!(flat: parry2d_f64, exact_flat, 3, |&[x, y, angle]| (
    [x, y, 0.0].map(f64::from),
    Rotation::Angle(angle.into())
));
judge!(space: parry3d_f64, exact_space, 7, |&[x, y, z, i, j, k, w]| (
    [x, y, z, 0.0, 0.0, 0.0, 0.0].map(f64::from),
    Rotation::Quaternion([i, j, k, w].map(f64::from))
));

#[cfg(test)]
mod tests {
    use std::path::Path;

    use drystone_bake::read_json;

    use super::*;
    use crate::made::made;

    fn scene(text: &str) -> Scene {
        read_json(Path::new("test.json"), text).unwrap().scene
    }

    fn overlap(text: &str) -> f64 {
        let scene = scene(text);
        let start: Vec<f32> = scene.bodies.iter().flat_map(start).collect();
        Judge::new(&scene).unwrap().deepest(&start).unwrap()
    }

    #[test]
    fn overlap_is_the_shortest_way_apart() {
        let boxes = r#"{"bodies": [
            {"shapes": [{"type": "box", "half_extents": [0.5, 0.5, 0.5]}]},
            {"position": [0.5, 0.875, 0], "shapes": [{"type": "box", "half_extents": [0.5, 0.5, 0.5]}]}
        ]}"#;
        assert!((overlap(boxes) - 0.125).abs() < 1e-9);
        let squares = r#"{"dimension": 2, "bodies": [
            {"shapes": [{"type": "box", "half_extents": [0.5, 0.5]}]},
            {"position": [0.75, 0.5], "shapes": [{"type": "box", "half_extents": [0.5, 0.5]}]}
        ]}"#;
        assert!((overlap(squares) - 0.25).abs() < 1e-9);
    }

    #[test]
    fn half_spaces_overlap_wherever_they_are_in_the_list() {
        let ball = r#"{"position": [3, 2.4375, 0], "shapes": [{"type": "sphere", "radius": 0.5}]}"#;
        let floor = r#"{"motion": "static", "position": [0, 2, 0],
            "shapes": [{"type": "halfspace", "normal": [0, 1, 0]}]}"#;
        for pair in [[ball, floor], [floor, ball]] {
            let depth = overlap(&format!(r#"{{"bodies": [{}]}}"#, pair.join(",")));
            assert!((depth - 0.0625).abs() < 1e-9, "{depth}");
        }
    }

    #[test]
    fn poses_that_are_not_finite_have_no_overlap() {
        let case = made("stack_30").unwrap();
        let judge = Judge::new(&case.scene).unwrap();
        assert_eq!(judge.deepest(&[f32::NAN; 7 * 31]), None);
    }

    #[test]
    fn stacks_start_at_rest_and_piles_do_not() {
        for (name, rest) in [
            ("stack_30", true),
            ("pyramid_20_2d", true),
            ("arch", true),
            ("dominoes_200", false),
            ("disk_pile_1000_2d", false),
        ] {
            let case = made(name).unwrap();
            let judge = Judge::new(&case.scene).unwrap();
            assert_eq!(judge.starts_at_rest(), rest, "{name}");
            let start: Vec<f32> = case.scene.bodies.iter().flat_map(start).collect();
            assert_eq!(judge.standing(&start, None), 1.0, "{name}");
        }
    }
}
