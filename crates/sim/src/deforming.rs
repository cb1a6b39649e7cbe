//! Triangle meshes whose vertices move: public methods, and the stages of a step.

use drystone_solver::{Vector, Velocity};

use crate::carriers::{Carrier, MeshMotion, SurfacePoint, fitted};
use crate::colliders::rotation_lever;
use crate::geometry::{Geometry, MAX_POINTS};
use crate::ids::ColliderId;
use crate::input::{self, InputError, MeshFault};
use crate::report::StepReport;
use crate::world::World;

/// Position of a frame that makes sure that the points of a manifold are not reused. \[m\]
const ELSEWHERE: f32 = 1e12;

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Returns the vertices of a triangle mesh in the frame of its shape, or `None` if the collider
    /// is unknown or no mesh. \[m\]
    pub fn vertices(&self, id: ColliderId) -> Option<Vec<Vector<f32, L>>> {
        let slot = id.slot(&self.colliders.slots, self.id())?;
        G::vertices(G::shape_of(&self.colliders.shapes[slot]))
    }

    /// Moves the vertices of a triangle mesh in the next step, which takes each in a straight line
    /// to its target. \[m\] Targets are in the frame of the shape, in the order of
    /// [`World::vertices`].
    ///
    /// Contacts on the mesh get the velocity of the surface, along the normal and across it: a
    /// floor that rises lifts what stands on it at its speed, and a cloth that slides drags it
    /// along. The body must be kinematic, and may move too. After the step the mesh is at rest
    /// until the next call. In a step of 0 s it stays where it is.
    ///
    /// Bodies can tunnel through a vertex that moves farther in a step than their thickness.
    /// Checkpoints have the vertices; read from bytes they have not ([`World::restore_vertices`]).
    ///
    /// ```
    /// use drystone::{Body, Motion, StepSettings, Vector, World3};
    /// use parry3d::shape::SharedShape;
    ///
    /// let mut world = World3::new(StepSettings::certified());
    /// world.gravity = [0.0, -9.81, 0.0].into();
    /// let corners = [[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.5]];
    /// let vertices = corners.map(parry3d::math::Vector::from).to_vec();
    /// let floor = SharedShape::trimesh(vertices, vec![[0, 2, 1]]).unwrap();
    /// let floor = world.add(Body::new(Motion::Kinematic, [0.0; 3], floor))?;
    /// let ball = SharedShape::ball(0.1);
    /// let ball = world.add(Body::new(Motion::Dynamic, [0.0, 0.1, 0.0], ball))?;
    /// let mesh = world.colliders(floor).next().unwrap();
    /// for step in 1..=30 {
    ///     let height = step as f32 / 60.0;
    ///     let raised = corners.map(|[x, y, z]| Vector([x, y + height, z]));
    ///     world.move_vertices(mesh, &raised)?;
    ///     world.step(1.0 / 60.0)?;
    /// }
    /// assert!((world.pose(ball).unwrap().translation.y - 0.6).abs() < 1e-3);
    /// # Ok::<(), drystone::InputError>(())
    /// ```
    ///
    /// # Errors
    /// The collider is unknown, no triangle mesh, or one of a body that is not kinematic; there are
    /// not as many targets as vertices, one is out of range, or a triangle would have no area.
    pub fn move_vertices(
        &mut self,
        id: ColliderId,
        targets: &[Vector<f32, L>],
    ) -> Result<(), InputError> {
        let slot = self.checked_mesh(id, targets)?;
        let body = self.colliders.body[slot] as usize;
        if self.bodies.can_be_moved(body) || self.bodies.is_static(body as u32) {
            return Err(InputError::Mesh(MeshFault::NotKinematic));
        }
        let start = G::vertices(G::shape_of(&self.colliders.shapes[slot])).unwrap_or_default();
        let collider = slot as u32;
        let motion = MeshMotion { collider, start, target: targets.to_vec(), dt: 0.0 };
        let motions = &mut self.colliders.mesh_motions;
        match motions.binary_search_by_key(&collider, |of| of.collider) {
            Ok(at) => motions[at] = motion,
            Err(at) => motions.insert(at, motion),
        }
        Ok(())
    }

    /// Places the vertices of a triangle mesh at once, without a velocity
    /// ([`World::move_vertices`]), and wakes all bodies near it. Bodies near the new vertices wake
    /// when the mesh touches them.
    ///
    /// # Errors
    /// Those of [`World::move_vertices`], except that the body may be static.
    pub fn set_vertices(
        &mut self,
        id: ColliderId,
        vertices: &[Vector<f32, L>],
    ) -> Result<(), InputError> {
        let slot = self.checked_mesh(id, vertices)?;
        let body = self.colliders.body[slot] as usize;
        if self.bodies.can_be_moved(body) {
            return Err(InputError::Mesh(MeshFault::NotKinematic));
        }
        self.wake_neighbors(body);
        self.colliders.mesh_motions.retain(|motion| motion.collider != slot as u32);
        // Once for the reach of the old vertices and once for that of the new ones.
        let origin = self.bodies.origin(body);
        self.bodies.set_origin(body, &origin);
        self.place_vertices(slot, vertices);
        self.bodies.set_origin(body, &origin);
        self.forget_points(slot as u32);
        let Self { bodies, colliders, broad_phase, .. } = self;
        colliders.update_body(body, bodies, broad_phase);
        self.sleep.mark_placed(body);
        self.definitions_changed();
        Ok(())
    }

    /// Gives a mesh the vertices that it had when the state was saved that the world has just been
    /// restored to ([`World::restore`]). Unlike [`World::set_vertices`] it wakes nothing: the next
    /// steps repeat those after the checkpoint. Only checkpoints from bytes need it.
    ///
    /// # Errors
    /// Those of [`World::set_vertices`].
    pub fn restore_vertices(
        &mut self,
        id: ColliderId,
        vertices: &[Vector<f32, L>],
    ) -> Result<(), InputError> {
        let slot = self.checked_mesh(id, vertices)?;
        self.place_vertices(slot, vertices);
        self.update_levers(slot as u32);
        self.definitions_changed();
        Ok(())
    }

    /// Makes the next search find the contact points on a mesh again.
    fn forget_points(&mut self, collider: u32) {
        let Self { contacts, sleep, .. } = self;
        for pair in contacts.pairs.iter().filter(|pair| pair.colliders.contains(&collider)) {
            let cache = if pair.is_sleeping { &mut sleep.cache } else { &mut contacts.cache };
            for manifold in &mut cache.manifolds[pair.manifolds()] {
                manifold.found_at.position = Vector([ELSEWHERE; L]);
            }
        }
    }

    /// Updates the levers of the pairs of a mesh whose body has another reach now.
    fn update_levers(&mut self, collider: u32) {
        let reach = &self.bodies.reach;
        for pair in self.contacts.pairs.iter_mut().filter(|pair| pair.colliders.contains(&collider))
        {
            pair.rotation_lever = rotation_lever(pair.bodies.map(|body| reach[body as usize].core));
        }
    }

    /// Returns the slot of a mesh that can have these vertices.
    fn checked_mesh(
        &self,
        id: ColliderId,
        vertices: &[Vector<f32, L>],
    ) -> Result<usize, InputError> {
        let refused = |fault| Err(InputError::Mesh(fault));
        let Some(slot) = id.slot(&self.colliders.slots, self.id()) else {
            return refused(MeshFault::Unknown);
        };
        let shape = G::shape_of(&self.colliders.shapes[slot]);
        let Some(own) = G::vertices(shape) else { return refused(MeshFault::NotAMesh) };
        if own.len() != vertices.len() {
            return refused(MeshFault::Vertices { expected: own.len(), found: vertices.len() });
        }
        vertices.iter().try_for_each(input::check_point)?;
        match G::flat_triangle(shape, vertices) {
            Some(triangle) => refused(MeshFault::FlatTriangle(triangle)),
            None => Ok(slot),
        }
    }

    /// Gives a mesh other vertices, of the right number, and updates the reach of its body.
    fn place_vertices(&mut self, slot: usize, vertices: &[Vector<f32, L>]) {
        let body = self.colliders.set_vertices(slot, vertices);
        self.bodies.reach[body] = self.colliders.reach(body);
    }

    /// Rejects vertices that would be too fast in a step of `dt` \[s\].
    pub(crate) fn check_mesh_motions(&self, dt: f32) -> Result<(), InputError> {
        let motions = self.colliders.mesh_motions.iter().filter(|_| dt > 0.0);
        motions.map(|motion| motion.longest() / dt).try_for_each(input::check_vertex_speed)
    }

    /// Begins the motion of meshes in a step of `dt` \[s\].
    pub(crate) fn begin_deforming(&mut self, dt: f32) {
        let Self { colliders, bodies, .. } = self;
        bodies.surface_speeds.clear();
        colliders.mesh_motions.retain(|motion| dt > 0.0 && motion.longest() > 0.0);
        if colliders.mesh_motions.is_empty() {
            return;
        }
        bodies.surface_speeds.resize(bodies.poses.len(), 0.0);
        for motion in &mut colliders.mesh_motions {
            motion.dt = dt;
            let body = colliders.body[motion.collider as usize] as usize;
            let speed = &mut bodies.surface_speeds[body];
            *speed = speed.max(motion.longest() / dt);
            bodies.rebuild_contacts(body);
        }
        self.definitions_changed();
    }

    /// Gives each manifold on a mesh that deforms a body that moves as the surface does there
    /// ([`carriers`](crate::carriers)). `part` is the part of the step that has passed. \[1\]
    /// Returns true if there are such manifolds, or were in the last search.
    pub(crate) fn attach_carriers(&mut self, part: f32) -> bool {
        let before = self.solver.carriers.clear(self.bodies.poses.len());
        if self.colliders.mesh_motions.is_empty() {
            return before;
        }
        for index in 0..self.contacts.pairs.len() {
            let pair = self.contacts.pairs[index];
            if pair.is_sleeping || pair.count == 0 {
                continue;
            }
            let moves = |side: &usize| self.colliders.mesh_motion(pair.colliders[*side]).is_some();
            if let Some(side) = [0, 1].into_iter().find(moves) {
                for manifold in pair.manifolds() {
                    self.attach_carrier(manifold, side, (pair.colliders[side], part));
                }
            }
        }
        before || !self.solver.carriers.own.is_empty()
    }

    /// Gives a manifold a carrier. The mesh is `collider`, of the body on this side.
    fn attach_carrier(&mut self, manifold: usize, side: usize, (collider, part): (u32, f32)) {
        let cached = self.contacts.cache.manifolds[manifold];
        let body = cached.bodies[side] as usize;
        let push_points = self.contacts.cache.points[cached.points()].iter();
        let push_points: Vec<_> = push_points.map(|point| point.push_point).collect();
        let share = 1.0 / push_points.len().max(1) as f32;
        let center = push_points.iter().fold(Vector::ZERO, |sum, point| sum + *point) * share;
        // From the center of mass of b; the arm is from that of the mesh's body.
        let arm = if side == 0 { center - cached.center_offset } else { center };
        let Some(velocity) = self.surface_velocity(manifold, side, (collider, part), arm) else {
            return;
        };
        let lever =
            push_points.iter().fold(0.0, |most, point| (*point - center).length().max(most));
        let number = self.bodies.poses.len() as u32;
        self.bodies.push_carrier(body, arm, velocity, lever);
        let cache = &mut self.contacts.cache;
        let own = &mut cache.manifolds[manifold];
        own.bodies[side] = number;
        if side == 0 {
            own.center_offset = center;
        } else {
            own.center_offset = cached.center_offset - center;
            for point in &mut cache.points[cached.points()] {
                point.push_point -= center;
            }
        }
        let carriers = &mut self.solver.carriers;
        carriers.push_points.extend(push_points);
        carriers.own.push(Carrier {
            body: body as u32,
            manifold: manifold as u32,
            side,
            arm,
            velocity,
            position: Vector::ZERO,
            center_offset: cached.center_offset,
        });
    }

    /// Returns the velocity of the surface of a mesh at a manifold, at an `arm` from the center of
    /// mass of its body. World axes.
    fn surface_velocity(
        &self,
        manifold: usize,
        side: usize,
        (collider, part): (u32, f32),
        arm: Vector<f32, L>,
    ) -> Option<Velocity<f32, L, A>> {
        let (colliders, bodies) = (&self.colliders, &self.bodies);
        let motion = colliders.mesh_motion(collider)?;
        let shape = G::shape_of(&colliders.shapes[collider as usize]);
        let local = G::frame(colliders.local_pose(collider as usize));
        let cached = &self.contacts.cache.manifolds[manifold];
        let body = cached.bodies[side] as usize;
        let (frame, own) = (&bodies.frames[body], bodies.velocities[body].cast::<f64>());
        let moving = |[at, velocity]: [Vector<f32, L>; 2]| {
            let arm_of_body = frame.direction(local.point(at)).cast::<f64>();
            let along = frame.direction(local.direction(velocity)).cast::<f64>();
            [arm_of_body - arm.cast(), own.at(arm_of_body) + along]
        };
        let mut points = [None; MAX_POINTS];
        let cached_points = &self.contacts.cache.points[cached.points()];
        for (point, cached) in points.iter_mut().zip(cached_points) {
            let on = if side == 0 { cached.on_a } else { cached.on_b };
            let near = motion.near::<G, A>(shape, local.local_point(on), part)?;
            let [[arm, velocity], corners @ ..] = near.map(moving);
            *point = Some(SurfacePoint { arm, velocity, corners });
        }
        let points: Vec<SurfacePoint<L>> = points.into_iter().flatten().collect();
        Some(fitted(&points))
    }

    /// Removes the carriers from the bodies and manifolds after the substeps of a search.
    pub(crate) fn detach_carriers(&mut self) {
        let Self { solver, contacts, bodies, .. } = self;
        let carriers = &mut solver.carriers;
        if carriers.own.is_empty() {
            return;
        }
        let mut push_points = carriers.push_points.iter();
        for (carrier, number) in carriers.own.iter_mut().zip(carriers.first..) {
            carrier.position = bodies.frames[number].position;
            let own = &mut contacts.cache.manifolds[carrier.manifold as usize];
            let of_carrier = own.bodies.iter_mut().find(|body| **body as usize == number);
            of_carrier.into_iter().for_each(|body| *body = carrier.body);
            own.center_offset = carrier.center_offset;
            // The points on the mesh have moved.
            own.found_at.position = Vector([ELSEWHERE; L]);
            let points = &mut contacts.cache.points[own.points()];
            for (point, push_point) in points.iter_mut().zip(&mut push_points) {
                point.push_point = *push_point;
            }
        }
        bodies.truncate(carriers.first);
    }

    /// Moves the vertices of meshes after a part of the step of `duration` \[s\]. `part` is the
    /// part of the step that has passed, 1 at its end.
    pub(crate) fn deform_meshes(&mut self, part: f32, duration: f32) {
        self.bodies.deform(duration);
        for index in 0..self.colliders.mesh_motions.len() {
            let motion = &self.colliders.mesh_motions[index];
            let (slot, at_end) = (motion.collider as usize, part >= 1.0);
            let vertices = if at_end { motion.target.clone() } else { motion.after(part) };
            self.place_vertices(slot, &vertices);
        }
    }

    /// Ends the motion of meshes in a step, and replaces carriers in its report.
    pub(crate) fn end_deforming(&mut self, report: &mut StepReport) {
        let carriers = &self.solver.carriers;
        if !carriers.own.is_empty() {
            for jam in &mut report.jams {
                jam.bodies.retain(|body| carriers.get(*body).is_none());
            }
        }
        for motion in std::mem::take(&mut self.colliders.mesh_motions) {
            self.update_levers(motion.collider);
        }
        self.bodies.surface_speeds.clear();
    }
}
