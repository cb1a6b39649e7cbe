//! The shapes of the bodies: where they are, what is near them, and what they make of a pair.

use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{Vector, Velocity};

use crate::bodies::{Bodies, Collider, GRAIN, SurfaceMotion};
use crate::broad_phase::BroadPhase;
use crate::cache::Pair;
use crate::geometry::{Bounds, Frame, Geometry};
use crate::scene::{Combine, Filter, Material, Motion};
use crate::sleep::Sleep;
use crate::travel::TravelBound;

/// Boxes are known to this part of how far they are from the origin. \[1\]
const ROUNDING: f32 = 1e-6;

/// The shapes of all bodies, one array per property.
pub(crate) struct Colliders<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) body: Vec<u32>,
    pub(crate) shapes: Vec<G::Collider>,
    /// Smallest extent of a solid; unlimited for what has no volume. \[m\]
    thickness: Vec<f32>,
    /// Shapes that each body has had, and the most of any body.
    counts: Vec<u32>,
    most: u32,
    /// In the frame of the body's center of mass.
    local: Vec<G::Pose>,
    /// Turned with the body, seen from its center of mass.
    pub(crate) poses: Vec<G::Pose>,
    /// What shapes that were added one after the other have in common, and which of them each shape has.
    surfaces: Vec<(Material, Filter)>,
    surface: Vec<u32>,
    /// Whether any of them has ever bounced.
    pub(crate) bounce: bool,
    /// Whether any of them has ever resisted rolling or spinning.
    pub(crate) resist: bool,
    /// How surfaces run; of none where there are no more.
    belts: Vec<Option<Belt<G, L, A>>>,
    pub(crate) removed: Vec<bool>,
    /// By chunk: shapes that have outgrown their boxes in the broad phase, and the room that they need.
    outgrown: Vec<Vec<(u32, Bounds<L>)>>,
    /// As long as the path of its body, its way ahead and what is looked beyond add up to less, a shape
    /// has room in its box. \[m\]
    room_until: Vec<f64>,
}

/// How the surface of a shape runs.
struct Belt<G: Geometry<L, A>, const L: usize, const A: usize> {
    motion: SurfaceMotion<L, A>,
    /// What it is given in, in the frame of the body's center of mass.
    frame: G::Pose,
    /// Whether it is that of the shape, not of its body.
    own: bool,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Colliders<G, L, A> {
    pub(crate) fn new() -> Self {
        Self {
            body: Vec::new(),
            shapes: Vec::new(),
            thickness: Vec::new(),
            counts: Vec::new(),
            most: 0,
            local: Vec::new(),
            poses: Vec::new(),
            surfaces: Vec::new(),
            surface: Vec::new(),
            bounce: false,
            resist: false,
            belts: Vec::new(),
            removed: Vec::new(),
            outgrown: Vec::new(),
            room_until: Vec::new(),
        }
    }

    /// Adds a shape to a body, at this pose in the frame of its center of mass.
    pub(crate) fn add(
        &mut self,
        body: usize,
        collider: Collider<G, L, A>,
        local: G::Pose,
        bodies: &Bodies<G, L, A>,
        broad_phase: &mut BroadPhase<L>,
    ) {
        let frame = &bodies.frames[body];
        let turned = turn::<G, L, A>(&local, &bodies.poses[body], frame);
        broad_phase.add(&bounds::<G, L, A>(&collider.shape, &turned, frame));
        self.body.push(body as u32);
        self.thickness.push(smallest(&extent::<G, L, A>(&collider.shape, None)));
        self.shapes.push(G::collider(collider.shape));
        self.counts.resize(self.counts.len().max(body + 1), 0);
        self.counts[body] += 1;
        self.most = self.most.max(self.counts[body]);
        self.bounce |= collider.material.restitution > 0.0;
        let resistance =
            [collider.material.rolling_resistance, collider.material.spinning_resistance];
        self.resist |= A > 0 && resistance.iter().any(|of| *of > 0.0);
        if let Some(motion) = collider.surface_velocity {
            self.set_belt(self.body.len() - 1, Some(Belt { motion, frame: local, own: true }));
        }
        self.local.push(local);
        self.poses.push(turned);
        let surface = (collider.material, collider.filter);
        if self.surfaces.last() != Some(&surface) {
            self.surfaces.push(surface);
        }
        self.surface.push(self.surfaces.len() as u32 - 1);
        self.removed.push(false);
        self.room_until.push(0.0);
    }

    fn set_belt(&mut self, id: usize, belt: Option<Belt<G, L, A>>) {
        if self.belts.len() <= id && belt.is_some() {
            self.belts.resize_with(id + 1, || None);
        }
        if let Some(own) = self.belts.get_mut(id) {
            *own = belt;
        }
    }

    /// Has the surface of a body run, whose origin is at `frame` in that of its center of mass; but for shapes
    /// that have a motion of their own.
    pub(crate) fn run(&mut self, body: usize, motion: Option<SurfaceMotion<L, A>>, frame: G::Pose) {
        for id in 0..self.body.len() {
            let own =
                self.belts.get(id).is_some_and(|belt| belt.as_ref().is_some_and(|belt| belt.own));
            if self.body[id] == body as u32 && !self.removed[id] && !own {
                self.set_belt(id, motion.map(|motion| Belt { motion, frame, own: false }));
            }
        }
    }

    /// A body may have several shapes.
    pub(crate) fn is_compound(&self, body: u32) -> bool {
        self.counts.get(body as usize).is_some_and(|&count| count > 1)
    }

    /// Some body may have several shapes.
    pub(crate) fn has_compounds(&self) -> bool {
        self.most > 1
    }

    /// Neither of two surfaces runs or resists rolling.
    pub(crate) fn is_plain(&self, pair: [u32; 2]) -> bool {
        let runs = |id: &u32| self.belts.get(*id as usize).is_some_and(Option::is_some);
        !pair.iter().any(runs) && self.resistance(pair) == [0.0; 2]
    }

    /// Whether a surface may run or resist rolling.
    pub(crate) fn has_surfaces(&self) -> bool {
        self.resist || !self.belts.is_empty()
    }

    /// How the surface of a shape runs, as a velocity at the center of mass of its body. World axes.
    pub(crate) fn belt(&self, bodies: &Bodies<G, L, A>, id: usize) -> Velocity<f32, L, A> {
        let Some(Some(belt)) = self.belts.get(id) else { return Velocity::ZERO };
        let body = self.body[id] as usize;
        let turned = turn::<G, L, A>(&belt.frame, &bodies.poses[body], &bodies.frames[body]);
        belt.motion.seen_from(&G::frame(&turned))
    }

    /// How two shapes resist rolling and spinning: as the one does that does so more. \[m\]
    pub(crate) fn resistance(&self, pair: [u32; 2]) -> [f32; 2] {
        if !self.resist {
            return [0.0; 2];
        }
        let [p, q] = pair.map(|id| &self.surfaces[self.surface[id as usize] as usize].0);
        [
            p.rolling_resistance.max(q.rolling_resistance) as f32,
            p.spinning_resistance.max(q.spinning_resistance) as f32,
        ]
    }

    /// Removes the shapes of a body.
    pub(crate) fn remove(&mut self, body: usize, broad_phase: &mut BroadPhase<L>) {
        for (id, (owner, removed)) in self.body.iter().zip(&mut self.removed).enumerate() {
            if *owner == body as u32 && !*removed {
                *removed = true;
                broad_phase.remove(id as u32);
            }
        }
    }

    /// Turns all shapes with their bodies, also of those that sleep, wherever they were before.
    pub(crate) fn place(&mut self, bodies: &Bodies<G, L, A>) {
        self.room_until.fill(0.0);
        let parts = self.poses.iter_mut().zip(&self.local).zip(&self.body);
        for ((turned, local), &body) in parts {
            let body = body as usize;
            *turned = turn::<G, L, A>(local, &bodies.poses[body], &bodies.frames[body]);
        }
    }

    /// Turns the shapes of what is awake with their bodies, and enlarges the boxes of those that have not
    /// enough room where they can get to, and `reach` \[m\] beyond.
    pub(crate) fn follow(
        &mut self,
        broad_phase: &mut BroadPhase<L>,
        bodies: &Bodies<G, L, A>,
        sleep: &Sleep<L>,
        travel: &[TravelBound<L>],
        reach: f32,
        pool: &ThreadPool,
    ) {
        let Self { body, shapes, thickness, local, poses, removed, outgrown, room_until, .. } =
            self;
        let (useful, share) = pool.share(body.len(), GRAIN);
        outgrown.resize_with(body.len().div_ceil(share), Vec::new);
        let rooms = outgrown.iter_mut().zip(room_until.chunks_mut(share));
        let parts = poses.chunks_mut(share).zip(rooms).enumerate();
        pool.for_each(useful, parts, |(part, (poses, (outgrown, room_until)))| {
            outgrown.clear();
            for (id, (turned, room_until)) in (share * part..).zip(poses.iter_mut().zip(room_until))
            {
                let body = body[id] as usize;
                let moves = bodies.motion[body] != Some(Motion::Static);
                if removed[id] || !moves || sleep.is_sleeping(body) {
                    continue;
                }
                let (frame, ahead) = (&bodies.frames[body], travel[body].linear);
                let reach = reach + travel[body].swing(thickness[id]);
                *turned = turn::<G, L, A>(&local[id], &bodies.poses[body], frame);
                if bodies.paths[body] + f64::from(ahead.length() + reach) < *room_until {
                    continue;
                }
                let bounds = bounds::<G, L, A>(G::shape_of(&shapes[id]), turned, frame);
                let far = bounds.min.length() + bounds.max.length();
                let room = broad_phase.room(id, &bounds) - ROUNDING * far;
                *room_until = bodies.paths[body] + f64::from(room);
                let swept = |Bounds { mut min, mut max }: Bounds<L>| {
                    for i in 0..L {
                        min[i] += ahead[i].min(0.0);
                        max[i] += ahead[i].max(0.0);
                    }
                    Bounds { min, max }
                };
                let reach = Vector([reach; L]);
                let grown = Bounds { min: bounds.min - reach, max: bounds.max + reach };
                let needed = swept(grown);
                if broad_phase.room(id, &needed) < 0.0 {
                    // As far again: what goes on as it does need not ask in the next step.
                    outgrown.push((id as u32, swept(needed)));
                    *room_until = 0.0;
                }
            }
        });
        for (id, bounds) in outgrown.iter().flatten() {
            broad_phase.update(*id, bounds);
        }
    }

    /// What two shapes are to each other; none, if they do not collide.
    pub(crate) fn pair(&self, bodies: &Bodies<G, L, A>, pair: [u32; 2]) -> Option<Pair> {
        let [a, b] = pair.map(|id| id as usize);
        let owners = [self.body[a], self.body[b]];
        let moved = owners.iter().any(|&body| bodies.is_dynamic(body as usize));
        let [(p, own), (q, other)] = [a, b].map(|id| &self.surfaces[self.surface[id] as usize]);
        if owners[0] == owners[1] || !moved || !own.collides(other) {
            return None;
        }
        let friction = Combine::of(p.friction_combine, q.friction_combine, p.friction, q.friction);
        let bounce =
            Combine::of(p.restitution_combine, q.restitution_combine, p.restitution, q.restitution);
        Some(Pair {
            colliders: pair,
            bodies: owners,
            friction: friction as f32,
            restitution: bounce as f32,
            thickness: self.thickness[a].min(self.thickness[b]),
            lever: lever(owners.map(|body| bodies.reach[body as usize].core)),
            corners: pair.iter().any(|&id| G::has_corners(&self.shapes[id as usize]))
                && pair.iter().all(|&id| G::has_ends(&self.shapes[id as usize])),
            sheet: pair.iter().any(|&id| G::is_sheet(&self.shapes[id as usize])),
            rolls: pair.iter().any(|&id| G::rolls(&self.shapes[id as usize])),
            rests: false,
            room: 0.0,
            first: 0,
            count: 0,
        })
    }
}

/// The pose of a shape as seen from its body's center of mass, turned with the body.
fn turn<G: Geometry<L, A>, const L: usize, const A: usize>(
    local: &G::Pose,
    body: &G::Pose,
    frame: &Frame<L>,
) -> G::Pose {
    G::compose(&G::advance(body, -frame.position, Vector::ZERO), local)
}

/// The box of a shape in the world.
fn bounds<G: Geometry<L, A>, const L: usize, const A: usize>(
    shape: &G::Shape,
    turned: &G::Pose,
    frame: &Frame<L>,
) -> Bounds<L> {
    let Bounds { min, max } = G::bounds(shape, turned);
    Bounds { min: min + frame.position, max: max + frame.position }
}

/// The box around a solid in its own frame, or at a pose; none around what has no volume.
fn extent<G: Geometry<L, A>, const L: usize, const A: usize>(
    shape: &G::Shape,
    pose: Option<&G::Pose>,
) -> Option<Bounds<L>> {
    let own = || G::pose(Vector::ZERO, &[]);
    let has_volume = G::mass(shape, 1.0).mass > 0.0;
    has_volume.then(|| G::bounds(shape, pose.unwrap_or(&own())))
}

/// The smallest extent of a box; unlimited of none. \[m\]
fn smallest<const L: usize>(bounds: &Option<Bounds<L>>) -> f32 {
    let extents = bounds.as_ref().map(|bounds| (bounds.max - bounds.min).0);
    extents.into_iter().flatten().fold(f32::INFINITY, f32::min)
}

/// The smallest extent of all shapes of a body together, in its frame; of a single shape in its own. \[m\]
pub(crate) fn thickness<G: Geometry<L, A>, const L: usize, const A: usize>(
    colliders: &[Collider<G, L, A>],
) -> f32 {
    let pose = |collider: &Collider<G, L, A>| (colliders.len() > 1).then_some(collider.pose);
    let each = colliders.iter();
    let each = each.filter_map(|of| extent::<G, L, A>(&of.shape, pose(of).as_ref()));
    smallest(&each.reduce(|all, own| Bounds {
        min: Vector(std::array::from_fn(|i| all.min[i].min(own.min[i]))),
        max: Vector(std::array::from_fn(|i| all.max[i].max(own.max[i]))),
    }))
}

/// [`Pair::lever`]: when b turns, the points of a near it are farther out than its own, by the size of a; once
/// for the way to the center of a, once for a's turning against b, and what a gap may add. As large as can be for
/// what turns and is where it was: infinite, it would make no number of bodies that do not turn.
pub(crate) fn lever([reach_a, reach_b]: [f32; 2]) -> f32 {
    if reach_b > 0.0 { (2.0 * reach_a + 1.5 * reach_b) / reach_b } else { f32::MAX }
}
