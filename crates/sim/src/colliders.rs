//! The shapes of the bodies: where they are, what is near them, and what they make of a pair.

use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{Vector, Velocity};

use crate::bodies::{Bodies, Collider, GRAIN, SurfaceMotion, extent, smallest};
use crate::body::{Combine, Filter, Material, Motion};
use crate::broad_phase::BroadPhase;
use crate::cache::Pair;
use crate::geometry::{Bounds, Frame, Geometry};
use crate::ids::{Slots, put};
use crate::sleep::Sleep;
use crate::travel::TravelBound;

/// Boxes are known to this part of how far they are from the origin. \[1\]
const ROUNDING: f32 = 1e-6;

/// No collider.
const NONE: u32 = u32::MAX;

/// The shapes of all bodies, one array per property.
#[derive(Clone)]
pub(crate) struct Colliders<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) slots: Slots,
    /// Slots that are released once no pair names them any more.
    vacated: Vec<u32>,
    /// The first shape of each body, and the next of the same body for each shape.
    first: Vec<u32>,
    next: Vec<u32>,
    pub(crate) user_data: Vec<u128>,
    pub(crate) body: Vec<u32>,
    pub(crate) shapes: Vec<G::Collider>,
    /// Smallest extent of a solid; unlimited for what has no volume. \[m\]
    thickness: Vec<f32>,
    /// Whether any body has ever had several shapes.
    compounds: bool,
    /// In the frame of the body's center of mass.
    local: Vec<G::Pose>,
    /// Turned with the body, seen from its center of mass.
    pub(crate) poses: Vec<G::Pose>,
    /// What shapes that were added one after the other have in common, how many shapes have it, and which of them each
    /// shape has.
    surfaces: Vec<(Material, Filter)>,
    uses: Vec<u32>,
    unused: Vec<u32>,
    surface: Vec<u32>,
    /// Whether any of them has ever bounced.
    pub(crate) bounce: bool,
    /// Whether any of them has ever resisted rolling or spinning.
    pub(crate) resist: bool,
    /// How surfaces run; of none where there are no more.
    belts: Vec<Option<Belt<G, L, A>>>,
    /// By chunk: shapes that have outgrown their boxes in the broad phase, and the room that they need.
    outgrown: Vec<Vec<(u32, Bounds<L>)>>,
    /// As long as the path of its body, its way ahead and what is looked beyond add up to less, a shape
    /// has room in its box. \[m\]
    room_until: Vec<f64>,
}

/// How the surface of a shape runs.
#[derive(Clone)]
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
            slots: Slots::default(),
            vacated: Vec::new(),
            first: Vec::new(),
            next: Vec::new(),
            user_data: Vec::new(),
            body: Vec::new(),
            shapes: Vec::new(),
            thickness: Vec::new(),
            compounds: false,
            local: Vec::new(),
            poses: Vec::new(),
            surfaces: Vec::new(),
            uses: Vec::new(),
            unused: Vec::new(),
            surface: Vec::new(),
            bounce: false,
            resist: false,
            belts: Vec::new(),
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
        let slot = self.slots.take();
        let frame = &bodies.frames[body];
        let turned = turn::<G, L, A>(&local, &bodies.poses[body], frame);
        broad_phase.insert(slot as u32, &bounds::<G, L, A>(&collider.shape, &turned, frame));
        self.first.resize(self.first.len().max(body + 1), NONE);
        self.compounds |= self.first[body] != NONE;
        let next = std::mem::replace(&mut self.first[body], slot as u32);
        self.bounce |= collider.material.restitution > 0.0;
        let resistance =
            [collider.material.rolling_resistance, collider.material.spinning_resistance];
        self.resist |= A > 0 && resistance.iter().any(|of| *of > 0.0);
        let surface = self.intern((collider.material, collider.filter));
        let thickness = smallest(&extent::<G, L, A>(&collider.shape, None));
        put(&mut self.next, slot, next);
        put(&mut self.user_data, slot, collider.user_data);
        put(&mut self.body, slot, body as u32);
        put(&mut self.thickness, slot, thickness);
        put(&mut self.shapes, slot, G::collider(collider.shape));
        put(&mut self.local, slot, local);
        put(&mut self.poses, slot, turned);
        put(&mut self.surface, slot, surface);
        put(&mut self.room_until, slot, 0.0);
        let belt = collider.surface_velocity;
        self.set_belt(slot, belt.map(|motion| Belt { motion, frame: local, own: true }));
    }

    /// Where a surface is among those that shapes have in common.
    fn intern(&mut self, surface: (Material, Filter)) -> u32 {
        let last = self.surfaces.len().wrapping_sub(1);
        if self.surfaces.last() == Some(&surface) && self.uses[last] > 0 {
            self.uses[last] += 1;
            return last as u32;
        }
        let index = self.unused.pop().map_or(self.surfaces.len(), |index| index as usize);
        put(&mut self.surfaces, index, surface);
        put(&mut self.uses, index, 1);
        index as u32
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
        let mut collider = self.first_of(body);
        while collider != NONE {
            let id = collider as usize;
            let own =
                self.belts.get(id).is_some_and(|belt| belt.as_ref().is_some_and(|belt| belt.own));
            if !own {
                self.set_belt(id, motion.map(|motion| Belt { motion, frame, own: false }));
            }
            collider = self.next[id];
        }
    }

    /// Whether a body has several shapes.
    pub(crate) fn is_compound(&self, body: u32) -> bool {
        let first = self.first_of(body as usize);
        first != NONE && self.next[first as usize] != NONE
    }

    /// Whether any body may have several shapes.
    pub(crate) fn has_compounds(&self) -> bool {
        self.compounds
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

    fn first_of(&self, body: usize) -> u32 {
        self.first.get(body).copied().unwrap_or(NONE)
    }

    /// The shapes of a body, the last that was added first.
    pub(crate) fn of_body(&self, body: usize) -> impl Iterator<Item = u32> + use<'_, G, L, A> {
        let mut at = self.first_of(body);
        std::iter::from_fn(move || {
            let collider = at;
            at = *self.next.get(collider as usize)?;
            Some(collider)
        })
    }

    /// Removes the shapes of a body. Their slots are taken again after the next [release](Self::release).
    pub(crate) fn remove(&mut self, body: usize, broad_phase: &mut BroadPhase<L>) {
        let mut collider = self.first_of(body);
        while collider != NONE {
            let slot = collider as usize;
            self.slots.vacate(slot);
            self.vacated.push(collider);
            self.shapes[slot] = G::nothing();
            self.set_belt(slot, None);
            let surface = self.surface[slot];
            self.uses[surface as usize] -= 1;
            if self.uses[surface as usize] == 0 {
                self.unused.push(surface);
            }
            broad_phase.remove(collider);
            collider = self.next[slot];
        }
        if let Some(first) = self.first.get_mut(body) {
            *first = NONE;
        }
    }

    /// Lets the slots of removed shapes be taken again: no pair names them.
    pub(crate) fn release(&mut self) {
        self.vacated.drain(..).for_each(|slot| self.slots.release(slot as usize));
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

    /// Turns the shapes of a body with it, and gives them boxes where they are.
    pub(crate) fn place_body(
        &mut self,
        body: usize,
        bodies: &Bodies<G, L, A>,
        broad_phase: &mut BroadPhase<L>,
    ) {
        let (pose, frame) = (&bodies.poses[body], &bodies.frames[body]);
        let own: Vec<u32> = self.of_body(body).collect();
        for collider in own {
            let at = collider as usize;
            self.poses[at] = turn::<G, L, A>(&self.local[at], pose, frame);
            self.room_until[at] = 0.0;
            let shape = G::shape_of(&self.shapes[at]);
            broad_phase.update(collider, &bounds::<G, L, A>(shape, &self.poses[at], frame));
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
        let Self { slots, body, shapes, thickness, local, poses, outgrown, room_until, .. } = self;
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
                if !moves || !slots.is_taken(id) || sleep.is_sleeping(body) {
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

/// Bodies and colliders as they were added. Their state is that of when they last changed: a checkpoint has the numbers.
pub(crate) struct Definitions<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) bodies: Bodies<G, L, A>,
    pub(crate) colliders: Colliders<G, L, A>,
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

/// [`Pair::lever`]: when b turns, the points of a near it are farther out than its own, by the size of a; once
/// for the way to the center of a, once for a's turning against b, and what a gap may add. As large as can be for
/// what turns and is where it was: infinite, it would make no number of bodies that do not turn.
pub(crate) fn lever([reach_a, reach_b]: [f32; 2]) -> f32 {
    if reach_b > 0.0 { (2.0 * reach_a + 1.5 * reach_b) / reach_b } else { f32::MAX }
}
