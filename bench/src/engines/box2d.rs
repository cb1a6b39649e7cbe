//! A scene in Box2D with its default world.
#![allow(unsafe_code)]

use boxdd_sys::ffi as b2;
use drystone_scene::{Body, Motion, Rotation, Scene, ShapeKind};

use super::{Effort, Engine, Peer, Refusal, density, flat_solid, holds, soft_step, states_inertia};
use crate::hold::{Hold, HoldKind};

/// Number of substeps that Box2D's manual recommends. \[1\]
const SUBSTEPS: u32 = 4;
/// Half width and half depth of the box that replaces a half-space. \[m\]
const HALFSPACE: [f32; 2] = [100.0, 5.0];
/// Fraction of its area that a polygon may lose where Box2D merges near points. \[1\]
const LOST_AREA: f64 = 1e-2;

/// A scene in Box2D.
pub(super) struct Box2d {
    world: b2::b2WorldId,
    bodies: Vec<b2::b2BodyId>,
    substeps: i32,
}

impl Box2d {
    /// Builds the scene.
    ///
    /// # Errors
    /// Box2D does not support a shape.
    pub(super) fn new(scene: &Scene, effort: Effort, threads: usize) -> Result<Self, Refusal> {
        // SAFETY: no arguments.
        let mut settings = unsafe { b2::b2DefaultWorldDef() };
        settings.gravity = vector(&scene.gravity);
        settings.enableSleep = false;
        settings.workerCount = threads as i32;
        let mut substeps = SUBSTEPS;
        if let Some((count, hertz)) = soft_step(effort) {
            substeps = count;
            settings.contactHertz = hertz;
        }
        // SAFETY: the settings started as the library's own and live through the call.
        let world = unsafe { b2::b2CreateWorld(&settings) };
        let mut engine = Self { world, bodies: Vec::new(), substeps: substeps as i32 };
        for (index, body) in scene.bodies.iter().enumerate() {
            engine.add(index, body)?;
        }
        let holds = holds(scene)?;
        if !holds.is_empty() {
            // SAFETY: the settings are the library's own; the world lives as long as self.
            let fixed = unsafe { b2::b2CreateBody(world, &b2::b2DefaultBodyDef()) };
            holds.iter().for_each(|hold| engine.join(fixed, hold));
        }
        Ok(engine)
    }

    fn add(&mut self, index: usize, body: &Body) -> Result<(), Refusal> {
        // SAFETY: no arguments.
        let mut settings = unsafe { b2::b2DefaultBodyDef() };
        settings.type_ = match body.motion {
            Motion::Static => b2::b2BodyType_b2_staticBody,
            Motion::Kinematic => b2::b2BodyType_b2_kinematicBody,
            Motion::Dynamic => b2::b2BodyType_b2_dynamicBody,
        };
        settings.position = vector(&body.position);
        settings.rotation = rotation(&body.rotation);
        settings.gravityScale = body.gravity_factor as f32;
        settings.enableSleep = false;
        // SAFETY: the world lives as long as self.
        let id = unsafe { b2::b2CreateBody(self.world, &settings) };
        self.bodies.push(id);
        let mut of_shapes = 0.0;
        if body.motion == Motion::Dynamic {
            of_shapes = density(body, flat_solid::volume(index, body)?);
        }
        for part in &body.shapes {
            // SAFETY: no arguments.
            let mut settings = unsafe { b2::b2DefaultShapeDef() };
            settings.density = of_shapes as f32;
            settings.material.friction = part.material.friction as f32;
            settings.material.restitution = part.material.restitution as f32;
            let place = b2::b2Transform { p: vector(&part.position), q: rotation(&part.rotation) };
            add_shape(id, &settings, &part.kind, place)
                .map_err(|why| Refusal::body(index, body, why))?;
        }
        if states_inertia(body) {
            let stated = flat_solid::stated(index, body)?;
            let mass = b2::b2MassData {
                mass: stated.mass() as f32,
                center: vector(&stated.local_com.to_array()),
                rotationalInertia: stated.principal_inertia() as f32,
            };
            // SAFETY: the body is in the world.
            unsafe { b2::b2Body_SetMassData(id, mass) };
        }
        let spin = body.angular_velocity.first().copied().unwrap_or(0.0) as f32;
        // Set after the mass, these are the velocities of the center of mass.
        // SAFETY: the body is in the world.
        unsafe {
            b2::b2Body_SetLinearVelocity(id, vector(&body.linear_velocity));
            b2::b2Body_SetAngularVelocity(id, spin);
        }
        Ok(())
    }

    fn join(&mut self, fixed: b2::b2BodyId, hold: &Hold) {
        let [a, b] = hold.bodies.map(|body| body.map_or(fixed, |index| self.bodies[index]));
        let [at_a, at_b] = [0, 1].map(|i| &hold.frames[i]).map(|frame| b2::b2Transform {
            p: vector(&frame.position),
            q: rotation(&frame.rotation),
        });
        let place = |base: &mut b2::b2JointDef| {
            (base.bodyIdA, base.bodyIdB, base.localFrameA, base.localFrameB) = (a, b, at_a, at_b);
            base.collideConnected = hold.collide;
        };
        let [lower, upper] = hold.limits.unwrap_or_default().map(|limit| limit as f32);
        let [speed, most] =
            hold.motor.map_or([0.0; 2], |of| [of.velocity, of.max_force].map(|x| x as f32));
        // SAFETY: the settings started as the library's own and live through the calls; both
        // bodies are in the world, which lives as long as self.
        unsafe {
            match hold.kind {
                HoldKind::Fixed => {
                    let mut settings = b2::b2DefaultWeldJointDef();
                    place(&mut settings.base);
                    b2::b2CreateWeldJoint(self.world, &settings);
                }
                HoldKind::Ball | HoldKind::Hinge => {
                    let mut settings = b2::b2DefaultRevoluteJointDef();
                    place(&mut settings.base);
                    settings.enableLimit = hold.limits.is_some();
                    (settings.lowerAngle, settings.upperAngle) = (lower, upper);
                    settings.enableMotor = hold.motor.is_some();
                    (settings.motorSpeed, settings.maxMotorTorque) = (speed, most);
                    b2::b2CreateRevoluteJoint(self.world, &settings);
                }
                HoldKind::Slider => {
                    let mut settings = b2::b2DefaultPrismaticJointDef();
                    place(&mut settings.base);
                    settings.enableLimit = hold.limits.is_some();
                    (settings.lowerTranslation, settings.upperTranslation) = (lower, upper);
                    settings.enableMotor = hold.motor.is_some();
                    (settings.motorSpeed, settings.maxMotorForce) = (speed, most);
                    b2::b2CreatePrismaticJoint(self.world, &settings);
                }
            }
        }
    }
}

fn add_shape(
    body: b2::b2BodyId,
    settings: &b2::b2ShapeDef,
    kind: &ShapeKind,
    place: b2::b2Transform,
) -> Result<(), String> {
    let polygon = match kind {
        ShapeKind::Sphere { radius } => {
            let circle = b2::b2Circle { center: place.p, radius: *radius as f32 };
            // SAFETY: the body is in a world; settings and circle live through the call.
            unsafe { b2::b2CreateCircleShape(body, settings, &circle) };
            return Ok(());
        }
        ShapeKind::Capsule { radius, half_height } => {
            let ends = [-half_height, *half_height].map(|y| at(&place, [0.0, y as f32]));
            let capsule =
                b2::b2Capsule { center1: ends[0], center2: ends[1], radius: *radius as f32 };
            // SAFETY: the body is in a world; settings and capsule live through the call.
            unsafe { b2::b2CreateCapsuleShape(body, settings, &capsule) };
            return Ok(());
        }
        ShapeKind::Box { half_extents } => {
            let half = vector(half_extents);
            // SAFETY: values only.
            unsafe { b2::b2MakeOffsetBox(half.x, half.y, place.p, place.q) }
        }
        ShapeKind::Halfspace { normal } => {
            let [x, y] = [normal[0], normal[1]].map(|along| along as f32);
            let length = x.hypot(y);
            let up = b2::b2Rot { c: y / length, s: -x / length };
            let turn = b2::b2Rot {
                c: place.q.c * up.c - place.q.s * up.s,
                s: place.q.s * up.c + place.q.c * up.s,
            };
            let [width, depth] = HALFSPACE;
            let middle = at(&place, [-depth * x / length, -depth * y / length]);
            // SAFETY: values only.
            unsafe { b2::b2MakeOffsetBox(width, depth, middle, turn) }
        }
        ShapeKind::ConvexHull { points } => hull(kind, points, place)?,
        _ => return Err("not a shape of Box2D".to_string()),
    };
    // SAFETY: the body is in a world; settings and polygon live through the call.
    unsafe { b2::b2CreatePolygonShape(body, settings, &polygon) };
    Ok(())
}

fn hull(
    kind: &ShapeKind,
    points: &[Vec<f64>],
    place: b2::b2Transform,
) -> Result<b2::b2Polygon, String> {
    let most = b2::B2_MAX_POLYGON_VERTICES as usize;
    if points.len() > most {
        return Err(format!("a hull of {} points; Box2D takes at most {most}", points.len()));
    }
    let area = crate::shapes::exact_flat::shape(kind)?.mass_properties(1.0).mass();
    let points: Vec<_> = points.iter().map(|point| vector(point)).collect();
    // SAFETY: pointer and count belong to one list, which lives through the call.
    let hull = unsafe { b2::b2ComputeHull(points.as_ptr(), points.len() as i32) };
    if hull.count == 0 {
        return Err("a hull that Box2D does not take".to_string());
    }
    // SAFETY: the hull is valid, since it has points, and lives through the calls.
    let (polygon, kept) = unsafe {
        let polygon = b2::b2MakeOffsetPolygon(&hull, place.p, place.q);
        (polygon, b2::b2ComputePolygonMass(&polygon, 1.0).mass)
    };
    if f64::from(kept) < (1.0 - LOST_AREA) * area {
        return Err(format!("a hull of {area} m^2, of which Box2D keeps {kept} m^2"));
    }
    Ok(polygon)
}

fn vector(of: &[f64]) -> b2::b2Vec2 {
    let axis = |i: usize| of.get(i).copied().unwrap_or(0.0) as f32;
    b2::b2Vec2 { x: axis(0), y: axis(1) }
}

fn rotation(of: &Rotation) -> b2::b2Rot {
    let angle = if let Rotation::Angle(angle) = of { *angle } else { 0.0 };
    b2::b2Rot { c: angle.cos() as f32, s: angle.sin() as f32 }
}

fn at(place: &b2::b2Transform, [x, y]: [f32; 2]) -> b2::b2Vec2 {
    let b2::b2Rot { c, s } = place.q;
    b2::b2Vec2 { x: place.p.x + c * x - s * y, y: place.p.y + s * x + c * y }
}

impl Engine for Box2d {
    fn step(&mut self, dt: f32) -> Result<(), Refusal> {
        // SAFETY: the world lives as long as self.
        unsafe { b2::b2World_Step(self.world, dt, self.substeps) };
        Ok(())
    }

    fn write_poses(&self, out: &mut Vec<f32>) {
        for &body in &self.bodies {
            // SAFETY: the body is in the world, which lives as long as self.
            let (p, q) = unsafe { (b2::b2Body_GetPosition(body), b2::b2Body_GetRotation(body)) };
            out.extend([p.x, p.y, q.s.atan2(q.c)]);
        }
    }
}

impl Peer for Box2d {
    fn move_to(&mut self, body: usize, position: &[f64], turn: &Rotation, dt: f32) {
        let target = b2::b2Transform { p: vector(position), q: rotation(turn) };
        // SAFETY: the body is in the world, which lives as long as self.
        unsafe { b2::b2Body_SetTargetTransform(self.bodies[body], target, dt, true) };
    }
}

impl Drop for Box2d {
    fn drop(&mut self) {
        // SAFETY: made in `new`, and not used after.
        unsafe { b2::b2DestroyWorld(self.world) };
    }
}
