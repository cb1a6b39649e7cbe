//! Audit of a bake: measures overlaps and passages from shapes and poses, independently of
//! contacts.
//!
//! A certificate bounds the error of the contacts that a step solved. It says nothing about
//! contacts that were not found. The audit therefore uses shapes and poses only. It measures the
//! penetration depth of shapes in sampled frames (GJK and EPA in `f64`, between certified bounds). It checks
//! whether the center of a convex shape passed through a surface between two frames. It finds
//! bodies that ended below everything that could have carried them.

mod passage;
mod separation;
mod shape;
mod vector;

use std::collections::{BTreeMap, BTreeSet};

use parry3d::bounding_volume::{Aabb, BoundingVolume};
use parry3d::partitioning::{Bvh, BvhBuildStrategy};
use serde::Serialize;

use crate::recording::Recording;
use crate::recording::pose::frame_pose;
use drystone::StepSettings;
use drystone_scene::{Joint, Motion, Scene, Shape, ShapeKind};
use shape::{CoreShape, ShapePose, SupportShape, overlap};
use vector::{Vec3, dot, minus, norm};

/// Maximum number of frames in which overlaps are measured.
const FRAMES: usize = 64;
/// Maximum number of shape pairs measured, summed over these frames.
const MOST_PAIRS: usize = 1 << 17;
/// Maximum number of center paths that are followed; each leads from one frame to the next.
const STEPS: usize = 1 << 22;
/// Accepted overlap as a fraction of the thinner shape's least width. \[1\]
const PART: f64 = 0.02;
/// Accepted overlap as a multiple of the allowed sag of contacts. \[1\]
const SAGS: f64 = 5.0;
/// Maximum number of overlaps and of passages that are kept; further ones are dropped.
const KEPT: usize = 1000;

/// Result of the audit of a bake.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Audit {
    /// Number of frames in which overlaps were measured.
    pub frames: usize,
    /// Number of shape pairs measured, summed over these frames.
    pub pairs: usize,
    /// Number of intervals between frames over which centers were followed.
    pub followed: usize,
    /// Deepest overlap in the first frame, before anything moved.
    pub start: Option<Overlap>,
    /// Deepest overlap in any measured frame.
    pub deepest: Option<Overlap>,
    /// Pairs of bodies that overlap by more than is accepted, deepest first.
    pub overlaps: Vec<Overlap>,
    /// Bodies that passed through a surface of another body, in the order of their frames.
    pub passages: Vec<Passage>,
    /// Dynamic bodies that ended entirely below everything that could have carried them.
    pub fallen: Vec<usize>,
    /// Bodies of `fallen` that have a mesh, or all where meshes deform. The audit follows neither,
    /// so these bodies may have passed through something.
    pub unfollowed: Vec<usize>,
}

/// Overlap of two bodies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overlap {
    /// Indices of the bodies in the scene.
    pub bodies: [usize; 2],
    /// Penetration depth: the shortest translation that separates them. \[m\]
    pub depth: f64,
    /// Accepted depth for this pair in this frame. \[m\]
    pub accepted: f64,
    /// Frame in which the overlap was measured.
    pub frame: usize,
}

/// Passage of the center of a convex shape through a surface of another body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Passage {
    /// The body that moved through, and the body it passed through.
    pub bodies: [usize; 2],
    /// First followed frame in which the center was on the other side.
    pub frame: usize,
}

impl Audit {
    /// True if no fault was found that contacts should have prevented. Bodies of `fallen` that were
    /// followed and passed through nothing fell off an edge, which is no fault.
    pub fn is_clean(&self) -> bool {
        self.overlaps.is_empty() && self.passages.is_empty() && self.unfollowed.is_empty()
    }
}

/// Measures a bake of a scene.
///
/// The accepted overlap of two shapes is a sum:
/// - their overlap at the start;
/// - five times the sag of the settings;
/// - 2 % of the thinner shape's least width;
/// - their relative motion in a substep;
/// - without a tolerance, the deepest penetration of the contacts of that step, since contacts are
///   then softer than the sag says.
///
/// `known` holds the deepest penetration of contacts for each frame \[m\], or is empty.
///
/// The work is bounded. The audit measures at most 64 frames, evenly spread over the bake, and
/// 131 072 pairs of shapes. It follows at most 4 million center paths. It does not measure two
/// triangle meshes against each other. It does not follow meshes, and does not look for passages
/// through dynamic bodies and through meshes that deform.
pub fn audit(
    scene: &Scene,
    recording: &Recording,
    settings: &StepSettings,
    known: &[f64],
) -> Audit {
    let mut audit = Audit::default();
    let Some(last) = recording.frames().checked_sub(1) else { return audit };
    let mut stage = AuditScene::new(scene, recording);
    stage.measure(last, (settings, known), &mut audit);
    stage.follow(last, &mut audit);
    stage.left(last, &mut audit);
    audit
}

/// Returns the dynamic body that gained most mechanical energy between two frames, and its gain
/// \[J\]. The result serves to name the body: velocities are differences of recorded poses, and the
/// inertia is that of a ball with the reach of the body.
pub fn gained_most(
    scene: &Scene,
    recording: &Recording,
    masses: &[f64],
    [from, to]: [usize; 2],
) -> Option<(usize, f64)> {
    let stage = AuditScene::new(scene, recording);
    let dynamic = |body: &usize| scene.bodies[*body].motion == Motion::Dynamic;
    let gain = |body: usize| {
        let reach = stage.reach(body);
        let [before, after] = [from, to].map(|frame| stage.energy(frame, body, reach));
        (body, masses.get(body).copied().unwrap_or(f64::NAN) * (after - before))
    };
    let gains = (0..scene.bodies.len()).filter(dynamic).map(gain);
    gains.filter(|(_, gain)| gain.is_finite()).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// A shape with its indices in the scene.
struct Actor {
    body: usize,
    shape: usize,
    form: SupportShape,
}

struct AuditScene<'a> {
    scene: &'a Scene,
    recording: &'a Recording,
    actors: Vec<Actor>,
    /// Pairs of bodies that a joint keeps from colliding, the smaller index first.
    separated: BTreeSet<[usize; 2]>,
}

/// World poses and bounding boxes of all shapes in a frame.
struct FrameState {
    poses: Vec<ShapePose>,
    bounds: Vec<Option<Aabb>>,
}

impl<'a> AuditScene<'a> {
    fn new(scene: &'a Scene, recording: &'a Recording) -> Self {
        let mut actors = Vec::new();
        for (body, of) in scene.bodies.iter().enumerate() {
            for (shape, of) in of.shapes.iter().enumerate() {
                let form = SupportShape::new(of, scene.dimension);
                actors.extend(form.map(|form| Actor { body, shape, form }));
            }
        }
        let separated = scene.joints.iter().filter(|joint| joint.enabled && !joint.collide);
        let pair = |joint: &Joint| Some([joint.bodies[0]?, joint.bodies[1]?]);
        let separated = separated.filter_map(pair).map(|[a, b]| [a.min(b), a.max(b)]).collect();
        Self { scene, recording, actors, separated }
    }

    /// Gives the meshes that deform their vertices in a frame.
    fn deform(&mut self, frame: usize) {
        let time = frame as f64 * self.recording.frame_time;
        for actor in &mut self.actors {
            let shape = &self.scene.bodies[actor.body].shapes[actor.shape];
            let ShapeKind::Trimesh { triangles, vertex_track: Some(track), .. } = &shape.kind
            else {
                continue;
            };
            let (vertices, triangles) = (track.at(time), triangles.clone());
            let kind =
                ShapeKind::Trimesh { vertices, triangles, decomposition: None, vertex_track: None };
            let form = SupportShape::new(&Shape { kind, ..shape.clone() }, self.scene.dimension);
            if let Some(form) = form {
                actor.form = form;
            }
        }
    }

    /// Returns true if the shape of an actor deforms.
    fn deforms(&self, actor: usize) -> bool {
        let Actor { body, shape, .. } = self.actors[actor];
        self.scene.bodies[body].shapes[shape].kind.vertex_track().is_some()
    }

    fn body(&self, frame: usize, body: usize) -> ShapePose {
        let pose = frame_pose(self.recording, frame, body);
        ShapePose::new(pose.position, pose.rotation)
    }

    fn pose(&self, frame: usize, actor: usize) -> ShapePose {
        let actor = &self.actors[actor];
        actor.form.placed(&self.body(frame, actor.body))
    }

    /// Returns the largest distance of a point of the body from its origin. \[m\]
    fn reach(&self, body: usize) -> f64 {
        let own = self.actors.iter().filter(|actor| actor.body == body);
        let far = own.map(|actor| {
            norm(actor.form.placed(&ShapePose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0])).position)
                + actor.form.reach
        });
        far.fold(0.0, f64::max)
    }

    /// Returns the energy of a body per unit mass, v^2 / 2 + (2/5) (r omega)^2 / 2 - g . x.
    /// Velocities are those that led to the frame; for frame 0 they are the initial ones.
    /// \[m^2/s^2\]
    fn energy(&self, frame: usize, body: usize, reach: f64) -> f64 {
        let [from, to] = [frame.saturating_sub(1), frame].map(|frame| self.body(frame, body));
        let (dt, gravity) = self.scene.terms_of((self.recording.start + frame).saturating_sub(1));
        let rate = if dt > 0.0 { 1.0 / dt } else { 0.0 };
        let start = &self.scene.bodies[body];
        let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let mut speed = norm(minus(to.position, from.position)) * rate;
        // For a small rotation the squared changes of the axes sum to 2 angle^2.
        let turned: f64 = (0..3).map(|i| minus(to.axes[i], from.axes[i])).map(|d| dot(d, d)).sum();
        let mut spin = reach * rate * (turned / 2.0).sqrt();
        if frame == 0 {
            speed = length(&start.linear_velocity);
            spin = reach * length(&start.angular_velocity);
        }
        let factor = start.gravity_factor;
        let height: f64 = gravity.iter().zip(to.position).map(|(g, x)| -g * factor * x).sum();
        0.5 * speed * speed + 0.2 * spin * spin + height
    }

    fn state(&self, frame: usize) -> FrameState {
        let poses: Vec<_> = (0..self.actors.len()).map(|of| self.pose(frame, of)).collect();
        let both = self.actors.iter().zip(&poses);
        let bounds = both.map(|(actor, pose)| actor.form.bounds(pose)).collect();
        FrameState { poses, bounds }
    }

    fn poses(&self, frame: usize, actors: &[usize]) -> Vec<ShapePose> {
        actors.iter().map(|&of| self.pose(frame, of)).collect()
    }

    /// Returns the tree over the boxes that hold each of some shapes at both of its poses.
    fn tree(&self, actors: &[usize], [from, to]: &[Vec<ShapePose>; 2]) -> Bvh {
        let boxes = actors.iter().zip(from.iter().zip(to)).map(|(&of, (from, to))| {
            let [from, to] = [from, to].map(|pose| self.actors[of].form.bounds(pose));
            from.zip(to).map_or(Aabb::new_invalid(), |(from, to)| from.merged(&to))
        });
        Bvh::from_iter(BvhBuildStrategy::Binned, boxes.enumerate())
    }

    fn motion(&self, actor: usize) -> Motion {
        self.scene.bodies[self.actors[actor].body].motion
    }

    /// Returns true if two shapes can collide: different bodies, one of them dynamic, filters that
    /// match, and no joint that keeps them from it. Such joints count also after they have broken.
    fn meet(&self, a: usize, b: usize) -> bool {
        let dynamic = [a, b].into_iter().any(|of| self.motion(of) == Motion::Dynamic);
        let (x, y) = (&self.actors[a], &self.actors[b]);
        let shape = |of: &Actor| &self.scene.bodies[of.body].shapes[of.shape];
        let pair = [x.body.min(y.body), x.body.max(y.body)];
        let apart = x.body != y.body && !self.separated.contains(&pair);
        dynamic && apart && shape(x).filter.collides(&shape(y).filter)
    }

    /// Returns up to `most` pairs of shapes whose bounding boxes overlap. A half-space pairs with
    /// every bounded shape.
    fn pairs(&self, state: &FrameState, most: usize) -> Vec<[usize; 2]> {
        let count = self.actors.len();
        // The tree wants consecutive indices; half-spaces have no box.
        let (boxed, boxes): (Vec<usize>, Vec<Aabb>) =
            state.bounds.iter().enumerate().filter_map(|(i, of)| Some((i, (*of)?))).unzip();
        let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        let mut pairs = Vec::new();
        for a in 0..count {
            let Some(around) = &state.bounds[a] else {
                let others = (0..count).filter(|&b| self.meet(a, b));
                let others = others.filter(|&b| state.bounds[b].is_some());
                let room = most - pairs.len();
                pairs.extend(others.map(|b| [a, b]).take(room));
                continue;
            };
            let near = tree.intersect_aabb(around).map(|leaf| boxed[leaf as usize]);
            let mut near: Vec<usize> = near.filter(|&b| b > a && self.meet(a, b)).collect();
            near.sort_unstable();
            near.dedup();
            let room = most - pairs.len();
            pairs.extend(near.into_iter().map(|b| [a, b]).take(room));
            if pairs.len() >= most {
                break;
            }
        }
        pairs
    }

    /// Measures overlaps in frames spread over the bake, including the first and the last.
    fn measure(
        &mut self,
        last: usize,
        (settings, known): (&StepSettings, &[f64]),
        audit: &mut Audit,
    ) {
        let mut at_the_start = BTreeMap::new();
        let mut worst: BTreeMap<[usize; 2], Overlap> = BTreeMap::new();
        let mut intervals = (FRAMES - 1).min(last);
        let mut sample = 0;
        while sample <= intervals && audit.pairs < MOST_PAIRS {
            let frame = (sample * last).checked_div(intervals).unwrap_or(0);
            self.deform(frame);
            let state = self.state(frame);
            let pairs = self.pairs(&state, MOST_PAIRS - audit.pairs);
            if sample == 0 {
                let affordable = MOST_PAIRS / pairs.len().max(1);
                intervals = intervals.min(affordable.saturating_sub(1).max(1)).min(last);
            }
            audit.frames += 1;
            audit.pairs += pairs.len();
            for [a, b] in pairs {
                let [x, y] = [a, b].map(|of| (&self.actors[of].form, &state.poses[of]));
                let Some(depth) = overlap(x, y) else { continue };
                let bodies = [a, b].map(|of| self.actors[of].body);
                let soft = if settings.tolerance > 0.0 { None } else { known.get(frame) };
                let allowed = self.accepted([a, b], frame, settings) + soft.copied().unwrap_or(0.0);
                if frame == 0 {
                    at_the_start.insert([a, b], depth);
                }
                let start = at_the_start.get(&[a, b]).copied().unwrap_or(0.0);
                let found = Overlap { bodies, depth, accepted: allowed + start, frame };
                if audit.deepest.as_ref().is_none_or(|known| depth > known.depth) {
                    audit.deepest = Some(found.clone());
                    if frame == 0 {
                        audit.start = Some(found.clone());
                    }
                }
                let excess = |of: &Overlap| of.depth - of.accepted;
                if excess(&found) > 0.0 {
                    let known = worst.entry(bodies).or_insert_with(|| found.clone());
                    if excess(&found) > excess(known) {
                        *known = found;
                    }
                }
            }
            sample += 1;
        }
        let mut inside: Vec<_> = worst.into_values().collect();
        inside.sort_by(|a, b| b.depth.total_cmp(&a.depth));
        inside.truncate(KEPT);
        audit.overlaps = inside;
    }

    /// Returns the accepted overlap of two shapes in a frame, without that of the start. \[m\]
    fn accepted(&self, pair: [usize; 2], frame: usize, settings: &StepSettings) -> f64 {
        let thin = pair.map(|of| self.actors[of].form.thickness);
        let thin = thin[0].min(thin[1]);
        let part = if thin.is_finite() { PART * thin } else { 0.0 };
        let before = frame.saturating_sub(1);
        // Displacement since the frame before, and a bound on the displacement by rotation.
        let moved = |of: usize| {
            let [from, to] = [before, frame].map(|frame| self.pose(frame, of));
            let turned: f64 = (0..3).map(|i| norm(minus(to.axes[i], from.axes[i]))).sum();
            let reach = self.actors[of].form.reach;
            let arm = if reach.is_finite() { reach * turned } else { 0.0 };
            (minus(to.position, from.position), arm)
        };
        let [(x, turn_x), (y, turn_y)] = pair.map(moved);
        let path = norm(minus(x, y)) + turn_x + turn_y;
        part + SAGS * f64::from(settings.sag) + path / f64::from(settings.substeps.max(1))
    }

    /// Follows the centers of dynamic convex shapes from frame to frame, and finds passages through
    /// static and kinematic shapes.
    fn follow(&self, last: usize, audit: &mut Audit) {
        let all = 0..self.actors.len();
        let (walkers, obstacles): (Vec<usize>, Vec<usize>) =
            all.partition(|&of| self.motion(of) == Motion::Dynamic);
        let convex = |of: &usize| !matches!(self.actors[*of].form.core, CoreShape::Mesh(_));
        let walkers: Vec<usize> = walkers.into_iter().filter(convex).collect();
        let obstacles: Vec<usize> = obstacles.into_iter().filter(|&of| !self.deforms(of)).collect();
        if walkers.is_empty() || obstacles.is_empty() || last == 0 {
            return;
        }
        let stride = (walkers.len() * last).div_ceil(STEPS).max(1);
        let mut obstacles = Obstacles::new(self, obstacles);
        let mut seen = BTreeSet::new();
        let mut centers: Vec<Vec3> = walkers.iter().map(|&of| self.pose(0, of).position).collect();
        let mut frame = 0;
        while frame < last {
            frame = (frame + stride).min(last);
            audit.followed += 1;
            obstacles.advance(frame);
            for (walker, center) in walkers.iter().zip(&mut centers) {
                let from = std::mem::replace(center, self.pose(frame, *walker).position);
                for obstacle in obstacles.passed(*walker, [from, *center]) {
                    let bodies = [*walker, obstacle].map(|of| self.actors[of].body);
                    if seen.insert(bodies) && audit.passages.len() < KEPT {
                        audit.passages.push(Passage { bodies, frame });
                    }
                }
            }
        }
    }

    /// Finds dynamic bodies that end entirely below all static and kinematic shapes, by more than
    /// their own height.
    fn left(&self, last: usize, audit: &mut Audit) {
        let gravity: Vec3 =
            std::array::from_fn(|i| self.scene.gravity.get(i).copied().unwrap_or(0.0));
        let strength = norm(gravity);
        if strength <= 0.0 {
            return;
        }
        let up = gravity.map(|g| -g / strength);
        // Lowest and highest coordinate along `up`.
        let ends = |of: usize, frame: usize| {
            let pose = self.pose(frame, of);
            let form = &self.actors[of].form;
            let reach = |sign: f64| form.support(pose.local_direction(up.map(|x| x * sign)));
            let center = dot(pose.position, up);
            [center - reach(-1.0), center + reach(1.0)]
        };
        let all = || 0..self.actors.len();
        let fixed = all().filter(|&of| self.motion(of) != Motion::Dynamic);
        // Nothing falls past the edge of a half-space; passages through it are found elsewhere.
        let finite = fixed.clone().all(|of| self.actors[of].form.reach.is_finite());
        let floor = fixed.map(|of| ends(of, last)[0].min(ends(of, 0)[0])).reduce(f64::min);
        let Some(floor) = floor.filter(|_| finite) else { return };
        let mut highest: BTreeMap<usize, [f64; 2]> = BTreeMap::new();
        for of in all().filter(|&of| self.motion(of) == Motion::Dynamic) {
            let [low, high] = ends(of, last);
            let known = highest.entry(self.actors[of].body).or_insert([low, high]);
            *known = [known[0].min(low), known[1].max(high)];
        }
        let below = |[low, high]: [f64; 2]| high + (high - low) < floor;
        // A body that began below the floor was put there on purpose.
        let began = |body: usize| {
            let shapes = all().filter(|&of| self.actors[of].body == body);
            shapes.map(|of| ends(of, 0)[1]).fold(f64::NEG_INFINITY, f64::max) >= floor
        };
        let left = highest.into_iter().filter(|(body, ends)| below(*ends) && began(*body));
        audit.fallen = left.map(|(body, _)| body).collect();
        let has_mesh = |body: usize| {
            let mut shapes = self.actors.iter().filter(|of| of.body == body);
            shapes.any(|of| matches!(of.form.core, CoreShape::Mesh(_)))
        };
        // Neither were passages through meshes that deform.
        let deforms = (0..self.actors.len()).any(|of| self.deforms(of));
        let unfollowed = |body: &usize| deforms || has_mesh(*body);
        audit.unfollowed = audit.fallen.iter().copied().filter(unfollowed).collect();
    }
}

/// The static and kinematic shapes in two frames that follow each other.
struct Obstacles<'a> {
    stage: &'a AuditScene<'a>,
    /// Shapes with boxes, and half-spaces.
    boxed: Vec<usize>,
    planes: Vec<usize>,
    /// True if a shape with a box is kinematic.
    moves: bool,
    /// Poses of both kinds of shapes in each of the two frames.
    walls: [Vec<ShapePose>; 2],
    grounds: [Vec<ShapePose>; 2],
    /// Tree over boxes that hold a shape in both frames.
    around: Bvh,
}

impl<'a> Obstacles<'a> {
    /// Collects the obstacles in the first frame.
    fn new(stage: &'a AuditScene<'a>, all: Vec<usize>) -> Self {
        let (boxed, planes): (Vec<usize>, Vec<usize>) =
            all.into_iter().partition(|&of| stage.actors[of].form.reach.is_finite());
        let poses = |of: &[usize]| [0, 0].map(|frame| stage.poses(frame, of));
        let (walls, grounds) = (poses(&boxed), poses(&planes));
        let moves = boxed.iter().any(|&of| stage.motion(of) == Motion::Kinematic);
        let around = stage.tree(&boxed, &walls);
        Self { stage, boxed, planes, moves, walls, grounds, around }
    }

    /// Goes on to a later frame.
    fn advance(&mut self, frame: usize) {
        let Self { stage, boxed, planes, walls, grounds, .. } = self;
        *grounds = [std::mem::take(&mut grounds[1]), stage.poses(frame, planes)];
        if self.moves {
            *walls = [std::mem::take(&mut walls[1]), stage.poses(frame, boxed)];
            self.around = stage.tree(boxed, walls);
        }
    }

    /// Returns the obstacles through which the center of a shape passes on a path between the two
    /// frames, in order.
    fn passed(&self, walker: usize, path: [Vec3; 2]) -> Vec<usize> {
        let [from, to] = path;
        let low = std::array::from_fn(|i| from[i].min(to[i]));
        let high = std::array::from_fn(|i| from[i].max(to[i]));
        let passes = |obstacle: usize, [before, after]: &[Vec<ShapePose>; 2], i: usize| {
            let ends = passage::seen(path, [&before[i], &after[i]]);
            self.stage.meet(walker, obstacle)
                && passage::passes(&self.stage.actors[obstacle].form, ends)
        };
        let around = shape::loose(low, high);
        let near = self.around.intersect_aabb(&around).map(|i| i as usize);
        let walls = near.filter(|&i| passes(self.boxed[i], &self.walls, i));
        let grounds = (0..self.planes.len()).filter(|&i| passes(self.planes[i], &self.grounds, i));
        let mut through: Vec<usize> =
            walls.map(|i| self.boxed[i]).chain(grounds.map(|i| self.planes[i])).collect();
        through.sort_unstable();
        through
    }
}
