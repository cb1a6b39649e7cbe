//! The shapes of the bodies: their poses, their boxes in the broad phase, and the properties of
//! pairs.

use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{Vector, Velocity};

use crate::bodies::{Bodies, Collider, GRAIN, SurfaceVelocity, extent, smallest};
use crate::body::{Filter, Material, Motion};
use crate::broad_phase::BroadPhase;
use crate::cache::Pair;
use crate::carriers::MeshMotion;
use crate::geometry::{Bounds, Frame, Geometry, Reach};
use crate::ids::{Slots, put};
use crate::joints::Joints;
use crate::sleep::Sleep;
use crate::travel::TravelBound;

/// Relative rounding error of boxes, as a fraction of their distance from the origin. \[1\]
const ROUNDING: f32 = 1e-6;

/// No collider.
const NONE: u32 = u32::MAX;

/// The shapes of all bodies, one array per property.
#[derive(Clone)]
pub(crate) struct Colliders<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) slots: Slots,
    /// Slots to be released as soon as no pair refers to them.
    vacated: Vec<u32>,
    /// First shape of each body, and for each shape the next one of the same body.
    first: Vec<u32>,
    next: Vec<u32>,
    pub(crate) user_data: Vec<u128>,
    pub(crate) body: Vec<u32>,
    pub(crate) shapes: Vec<G::Prepared>,
    /// Smallest extent of each solid; infinite for shapes without volume. \[m\]
    thickness: Vec<f32>,
    /// True if any body has ever had several shapes.
    compounds: bool,
    /// Poses in the frame of the body's center of mass.
    local: Vec<G::Pose>,
    /// Poses rotated with the body, relative to its center of mass.
    pub(crate) poses: Vec<G::Pose>,
    /// Distinct materials and filters, the number of shapes that use each, and the unused entries.
    /// Shapes that are added one after the other share an entry if theirs are equal. `surface` has
    /// the entry of each shape.
    surfaces: Vec<(Material, Filter)>,
    uses: Vec<u32>,
    unused: Vec<u32>,
    surface: Vec<u32>,
    /// True if any shape has ever had a restitution.
    pub(crate) has_restitution: bool,
    /// True if any shape has ever had a rolling or spinning resistance.
    pub(crate) has_resistance: bool,
    /// Surface velocities. The array may be shorter; further shapes have none.
    belts: Vec<Option<Belt<G, L, A>>>,
    /// By chunk: shapes that have left their boxes in the broad phase, and the boxes that they
    /// need.
    outgrown: Vec<Vec<(u32, Bounds<L>)>>,
    /// A shape has a margin in its box while the sum of its body's path, its displacement ahead and
    /// the search distance is less than this. \[m\]
    margin_until: Vec<f64>,
    /// Meshes whose vertices move in the next step, by collider.
    pub(crate) mesh_motions: Vec<MeshMotion<L>>,
}

/// Surface velocity of a shape.
#[derive(Clone)]
struct Belt<G: Geometry<L, A>, const L: usize, const A: usize> {
    motion: SurfaceVelocity<L, A>,
    /// Frame in which it is given, relative to the body's center of mass.
    frame: G::Pose,
    /// True if it belongs to the shape, not to the body.
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
            has_restitution: false,
            has_resistance: false,
            belts: Vec::new(),
            outgrown: Vec::new(),
            margin_until: Vec::new(),
            mesh_motions: Vec::new(),
        }
    }

    /// Returns the motion of the vertices of a mesh in this step, if they move.
    pub(crate) fn mesh_motion(&self, collider: u32) -> Option<&MeshMotion<L>> {
        let found = self.mesh_motions.binary_search_by_key(&collider, |of| of.collider);
        found.ok().map(|at| &self.mesh_motions[at])
    }

    /// Gives a mesh other vertices, if they are as many. Returns its body.
    pub(crate) fn set_vertices(&mut self, id: usize, vertices: &[Vector<f32, L>]) -> usize {
        if let Some(shape) = G::with_vertices(G::shape_of(&self.shapes[id]), vertices) {
            self.shapes[id] = G::prepare(shape);
            self.margin_until[id] = 0.0;
        }
        self.body[id] as usize
    }

    /// Returns the reach of the shapes of a body from its center of mass.
    pub(crate) fn reach(&self, body: usize) -> Reach {
        let own =
            |id: u32| G::reach(G::shape_of(&self.shapes[id as usize]), &self.local[id as usize]);
        self.of_body(body).fold(Reach::default(), |all, id| all.joined(&own(id)))
    }

    /// Returns the pose of a shape in the frame of its body's center of mass.
    pub(crate) fn local_pose(&self, id: usize) -> &G::Pose {
        &self.local[id]
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
        self.has_restitution |= collider.material.restitution > 0.0;
        let resistance =
            [collider.material.rolling_resistance, collider.material.spinning_resistance];
        self.has_resistance |= A > 0 && resistance.iter().any(|of| *of > 0.0);
        let surface = self.intern((collider.material, collider.filter));
        let thickness = smallest(&extent::<G, L, A>(&collider.shape, None));
        put(&mut self.next, slot, next);
        put(&mut self.user_data, slot, collider.user_data);
        put(&mut self.body, slot, body as u32);
        put(&mut self.thickness, slot, thickness);
        put(&mut self.shapes, slot, G::prepare(collider.shape));
        put(&mut self.local, slot, local);
        put(&mut self.poses, slot, turned);
        put(&mut self.surface, slot, surface);
        put(&mut self.margin_until, slot, 0.0);
        let belt = collider.surface_velocity;
        self.set_belt(slot, belt.map(|motion| Belt { motion, frame: local, own: true }));
    }

    /// Returns the index of a material and filter among those in use, and counts the use.
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

    /// Sets the surface velocity of a body whose origin is at `frame` relative to its center of
    /// mass. Shapes with a surface velocity of their own keep it.
    pub(crate) fn set_surface_velocity(
        &mut self,
        body: usize,
        motion: Option<SurfaceVelocity<L, A>>,
        frame: G::Pose,
    ) {
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

    /// Returns true if a body has several shapes.
    pub(crate) fn is_compound(&self, body: u32) -> bool {
        let first = self.first_of(body as usize);
        first != NONE && self.next[first as usize] != NONE
    }

    /// Returns true if any body may have several shapes.
    pub(crate) fn has_compounds(&self) -> bool {
        self.compounds
    }

    /// Returns true if neither surface of a pair has a surface velocity or resists rolling or
    /// spinning.
    pub(crate) fn is_plain(&self, pair: [u32; 2]) -> bool {
        let runs = |id: &u32| self.belts.get(*id as usize).is_some_and(Option::is_some);
        !pair.iter().any(runs) && self.resistance(pair) == [0.0; 2]
    }

    /// Returns true if any surface may have a surface velocity or resist rolling or spinning.
    pub(crate) fn has_surfaces(&self) -> bool {
        self.has_resistance || !self.belts.is_empty()
    }

    /// Returns the surface velocity of a shape, at the center of mass of its body. World axes.
    pub(crate) fn belt(&self, bodies: &Bodies<G, L, A>, id: usize) -> Velocity<f32, L, A> {
        let Some(Some(belt)) = self.belts.get(id) else { return Velocity::ZERO };
        let body = self.body[id] as usize;
        let turned = turn::<G, L, A>(&belt.frame, &bodies.poses[body], &bodies.frames[body]);
        belt.motion.seen_from(&G::frame(&turned))
    }

    /// Returns the rolling and spinning resistance of a pair: the larger of the two shapes. \[m\]
    pub(crate) fn resistance(&self, pair: [u32; 2]) -> [f32; 2] {
        if !self.has_resistance {
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

    /// Returns the shapes of a body in reverse order of addition.
    pub(crate) fn of_body(&self, body: usize) -> impl Iterator<Item = u32> + use<'_, G, L, A> {
        let mut at = self.first_of(body);
        std::iter::from_fn(move || {
            let collider = at;
            at = *self.next.get(collider as usize)?;
            Some(collider)
        })
    }

    /// Removes the shapes of a body. Their slots become free at the next [release](Self::release).
    pub(crate) fn remove(&mut self, body: usize, broad_phase: &mut BroadPhase<L>) {
        let mut collider = self.first_of(body);
        while collider != NONE {
            let slot = collider as usize;
            self.slots.vacate(slot);
            self.vacated.push(collider);
            self.shapes[slot] = G::placeholder();
            self.mesh_motions.retain(|motion| motion.collider != collider);
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

    /// Releases the slots of removed shapes, when no pair refers to them any more.
    pub(crate) fn release(&mut self) {
        self.vacated.drain(..).for_each(|slot| self.slots.release(slot as usize));
    }

    /// Updates the poses of all shapes, those of sleeping bodies included, from the poses of their
    /// bodies.
    pub(crate) fn update_poses(&mut self, bodies: &Bodies<G, L, A>) {
        self.margin_until.fill(0.0);
        let parts = self.poses.iter_mut().zip(&self.local).zip(&self.body);
        for ((turned, local), &body) in parts {
            let body = body as usize;
            *turned = turn::<G, L, A>(local, &bodies.poses[body], &bodies.frames[body]);
        }
    }

    /// Updates the poses and boxes of the shapes of a body.
    pub(crate) fn update_body(
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
            self.margin_until[at] = 0.0;
            let shape = G::shape_of(&self.shapes[at]);
            broad_phase.update(collider, &bounds::<G, L, A>(shape, &self.poses[at], frame));
        }
    }

    /// Returns the pose of a shape relative to its body's center of mass, as of the body's current
    /// pose.
    pub(crate) fn current_pose(&self, bodies: &Bodies<G, L, A>, shape: usize) -> G::Pose {
        let body = self.body[shape] as usize;
        turn::<G, L, A>(&self.local[shape], &bodies.poses[body], &bodies.frames[body])
    }

    /// Returns the bounding box of a shape at its body's current pose.
    pub(crate) fn current_bounds(&self, bodies: &Bodies<G, L, A>, shape: usize) -> Bounds<L> {
        let (pose, body) = (self.current_pose(bodies, shape), self.body[shape] as usize);
        bounds::<G, L, A>(G::shape_of(&self.shapes[shape]), &pose, &bodies.frames[body])
    }

    /// Returns the current boxes of the shapes that the tree does not find at their current poses
    /// ([`BroadPhase::index`]).
    pub(crate) fn outside(
        &self,
        bodies: &Bodies<G, L, A>,
        broad_phase: &BroadPhase<L>,
    ) -> Vec<(u32, Bounds<L>)> {
        let outside = |shape: usize| {
            let (body, settled) = (self.body[shape] as usize, broad_phase.is_settled(shape));
            let is_static = bodies.motion[body] == Some(Motion::Static);
            if settled && (is_static || bodies.path_lengths[body] < self.margin_until[shape]) {
                return None;
            }
            let bounds = self.current_bounds(bodies, shape);
            let is_found = settled && broad_phase.margin(shape, &bounds) >= 0.0;
            (!is_found).then_some((shape as u32, bounds))
        };
        (0..self.slots.len())
            .filter(|shape| self.slots.is_taken(*shape))
            .filter_map(outside)
            .collect()
    }

    /// Updates the poses of the shapes of awake bodies. Enlarges their boxes in the broad phase if
    /// they lack a margin for the displacement ahead (`travel`) and `reach` \[m\] beyond.
    pub(crate) fn follow(
        &mut self,
        broad_phase: &mut BroadPhase<L>,
        bodies: &Bodies<G, L, A>,
        sleep: &Sleep<L>,
        travel: &[TravelBound<L>],
        reach: f32,
        pool: &ThreadPool,
    ) {
        let Self { slots, body, shapes, thickness, local, poses, outgrown, margin_until, .. } =
            self;
        let (useful, share) = pool.share(body.len(), GRAIN);
        outgrown.resize_with(body.len().div_ceil(share), Vec::new);
        let clearances = outgrown.iter_mut().zip(margin_until.chunks_mut(share));
        let parts = poses.chunks_mut(share).zip(clearances).enumerate();
        pool.for_each(useful, parts, |(part, (poses, (outgrown, margin_until)))| {
            outgrown.clear();
            for (id, (turned, margin_until)) in
                (share * part..).zip(poses.iter_mut().zip(margin_until))
            {
                let body = body[id] as usize;
                let moves = bodies.motion[body] != Some(Motion::Static);
                if !moves || !slots.is_taken(id) || sleep.is_sleeping(body) {
                    continue;
                }
                let (frame, ahead) = (&bodies.frames[body], travel[body].linear);
                let reach = reach + travel[body].swing(thickness[id]) + travel[body].deformed;
                *turned = turn::<G, L, A>(&local[id], &bodies.poses[body], frame);
                if bodies.path_lengths[body] + f64::from(ahead.length() + reach) < *margin_until {
                    continue;
                }
                let bounds = bounds::<G, L, A>(G::shape_of(&shapes[id]), turned, frame);
                let far = bounds.min.length() + bounds.max.length();
                let margin = broad_phase.margin(id, &bounds) - ROUNDING * far;
                *margin_until = bodies.path_lengths[body] + f64::from(margin);
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
                if broad_phase.margin(id, &needed) < 0.0 {
                    // Adds the displacement once more. So a shape that keeps its velocity needs no
                    // update in the next step.
                    outgrown.push((id as u32, swept(needed)));
                    *margin_until = 0.0;
                }
            }
        });
        for (id, bounds) in outgrown.iter().flatten() {
            broad_phase.update(*id, bounds);
        }
    }

    /// Returns the pair of two shapes, or `None` if they do not collide.
    pub(crate) fn pair(&self, bodies: &Bodies<G, L, A>, pair: [u32; 2]) -> Option<Pair> {
        let [a, b] = pair.map(|id| id as usize);
        let owners = [self.body[a], self.body[b]];
        let moved = owners.iter().any(|&body| bodies.can_be_moved(body as usize));
        let [(p, own), (q, other)] = [a, b].map(|id| &self.surfaces[self.surface[id] as usize]);
        if owners[0] == owners[1] || !moved || !own.collides(other) {
            return None;
        }
        Some(Pair {
            colliders: pair,
            bodies: owners,
            friction: p.friction_with(q) as f32,
            restitution: p.restitution_with(q) as f32,
            thickness: self.thickness[a].min(self.thickness[b]),
            rotation_lever: rotation_lever(owners.map(|body| bodies.reach[body as usize].core)),
            may_meet_at_corners: pair.iter().any(|&id| G::has_edges(&self.shapes[id as usize]))
                && pair.iter().all(|&id| G::is_bounded(&self.shapes[id as usize])),
            is_open: pair.iter().any(|&id| G::is_open(&self.shapes[id as usize])),
            is_curved: pair.iter().any(|&id| G::is_curved(&self.shapes[id as usize])),
            is_sleeping: false,
            clearance: 0.0,
            first: 0,
            count: 0,
        })
    }
}

/// Copy of bodies, colliders and joints. Its state is that of their last change; a checkpoint holds the
/// current one.
pub(crate) struct Definitions<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) bodies: Bodies<G, L, A>,
    pub(crate) colliders: Colliders<G, L, A>,
    pub(crate) joints: Joints<L, A>,
}

/// Returns the pose of a shape relative to its body's center of mass, rotated with the body.
fn turn<G: Geometry<L, A>, const L: usize, const A: usize>(
    local: &G::Pose,
    body: &G::Pose,
    frame: &Frame<L>,
) -> G::Pose {
    G::compose(&G::advance(body, -frame.position, Vector::ZERO), local)
}

/// Returns the bounding box of a shape in the world.
fn bounds<G: Geometry<L, A>, const L: usize, const A: usize>(
    shape: &G::Shape,
    turned: &G::Pose,
    frame: &Frame<L>,
) -> Bounds<L> {
    let Bounds { min, max } = G::bounds(shape, turned);
    Bounds { min: min + frame.position, max: max + frame.position }
}

/// Returns [`Pair::rotation_lever`]. When b rotates, the points of a near it are farther out than
/// its own by up to the size of a. That size counts twice: for the path to the center of a, and for
/// the rotation of a relative to b. The rest allows for a gap. The result is finite even for b that
/// cannot rotate a surface: infinity times zero would be NaN.
pub(crate) fn rotation_lever([reach_a, reach_b]: [f32; 2]) -> f32 {
    if reach_b > 0.0 { (2.0 * reach_a + 1.5 * reach_b) / reach_b } else { f32::MAX }
}
