//! A scene in Jolt with its default settings.
#![allow(unsafe_code)]

use std::ptr::null;
use std::sync::Once;

use drystone_scene::{Body, Motion, Rotation, Scene, ShapeKind};
use oxijolt_sys as jolt;

use super::{Effort, Engine, Peer, Refusal, density, holds, solid, states_inertia};
use crate::hold::{Hold, HoldKind};
use crate::shapes::exact_space;

/// Object layers and broad-phase layers: static bodies, and bodies that move.
const FIXED: u32 = 0;
const MOVING: u32 = 1;
/// Radius of rounded edges, Jolt's default. \[m\]
const CONVEX_RADIUS: f32 = 0.05;
/// Fraction of its volume that a hull may lose where Jolt merges near points. \[1\]
const LOST_VOLUME: f64 = 1e-2;
/// Half of the width in which a plane collides, Jolt's default. \[m\]
const PLANE: f32 = 1000.0;
/// Memory for a step; Jolt takes more if it does not suffice. \[byte\]
const STEP_MEMORY: u32 = 64 << 20;
/// Maximum number of jobs, Jolt's default. \[1\]
const JOBS: u32 = 2048;

/// Largest limit of a hinge. \[rad\]
const HALF_TURN: f32 = std::f32::consts::PI;

/// A scene in Jolt.
pub(super) struct Jolt {
    system: *mut jolt::JPH_PhysicsSystem,
    jobs: *mut jolt::JPH_JobSystem,
    memory: *mut jolt::JPH_TempAllocator,
    bodies: Vec<jolt::JPH_BodyID>,
    collision_steps: i32,
}

impl Jolt {
    /// Builds the scene.
    ///
    /// # Errors
    /// Jolt does not support a shape or a body.
    pub(super) fn new(scene: &Scene, effort: Effort, threads: usize) -> Result<Self, Refusal> {
        static START: Once = Once::new();
        START.call_once(|| {
            // SAFETY: called once, before anything else of Jolt.
            unsafe { jolt::JPH_Init() };
        });
        let count = scene.bodies.len() as u32;
        // SAFETY: the system owns the layers and filters once it is made.
        let system = unsafe {
            let layers = jolt::JPH_BroadPhaseLayerInterfaceTable_Create(2, 2);
            let pairs = jolt::JPH_ObjectLayerPairFilterTable_Create(2);
            for (layer, broad) in [(FIXED, 0), (MOVING, 1)] {
                jolt::JPH_BroadPhaseLayerInterfaceTable_MapObjectToBroadPhaseLayer(
                    layers, layer, broad,
                );
                jolt::JPH_ObjectLayerPairFilterTable_EnableCollision(pairs, layer, MOVING);
            }
            let filter = jolt::JPH_ObjectVsBroadPhaseLayerFilterTable_Create(layers, 2, pairs, 2);
            jolt::JPH_PhysicsSystem_Create(&jolt::JPH_PhysicsSystemSettings {
                maxBodies: count.max(1024),
                numBodyMutexes: 0,
                maxBodyPairs: (16 * count).max(65_536),
                maxContactConstraints: (16 * count).max(10_240),
                _padding: 0,
                broadPhaseLayerInterface: layers,
                objectLayerPairFilter: pairs,
                objectVsBroadPhaseLayerFilter: filter,
            })
        };
        let pool = jolt::JobSystemThreadPoolConfig {
            maxJobs: JOBS,
            maxBarriers: 8,
            // The calling thread works, too.
            numThreads: threads as i32 - 1,
        };
        // SAFETY: the pool's settings live through the call.
        let (jobs, memory) = unsafe {
            let jobs = match threads {
                1 => jolt::JPH_JobSystemSingleThreaded_Create(JOBS),
                _ => jolt::JPH_JobSystemThreadPool_Create(&pool),
            };
            (jobs, jolt::JPH_TempAllocator_Create(STEP_MEMORY))
        };
        let collision_steps = if let Effort::Substeps(count) = effort { count as i32 } else { 1 };
        let mut engine = Self { system, jobs, memory, bodies: Vec::new(), collision_steps };
        // SAFETY: the system lives as long as the engine.
        unsafe { jolt::JPH_PhysicsSystem_SetGravity(system, &vector(&scene.gravity)) };
        for (index, body) in scene.bodies.iter().enumerate() {
            engine.add(index, body)?;
        }
        let holds = holds(scene)?;
        engine.separate(&holds);
        holds.iter().for_each(|hold| engine.join(scene, hold));
        // SAFETY: as above.
        unsafe { jolt::JPH_PhysicsSystem_OptimizeBroadPhase(system) };
        Ok(engine)
    }

    fn add(&mut self, index: usize, body: &Body) -> Result<(), Refusal> {
        let refuse = |why: &str| Refusal::body(index, body, why);
        let surface = |shape: &drystone_scene::Shape| {
            [shape.material.friction as f32, shape.material.restitution as f32]
        };
        let [friction, restitution] = body.shapes.first().map_or([0.0; 2], surface);
        if body.shapes.iter().any(|shape| surface(shape) != [friction, restitution]) {
            return Err(refuse("has shapes of different materials, and Jolt one for a body"));
        }
        let (motion, layer) = match body.motion {
            Motion::Static => (jolt::JPH_MotionType_Static, FIXED),
            Motion::Kinematic => (jolt::JPH_MotionType_Kinematic, MOVING),
            Motion::Dynamic => (jolt::JPH_MotionType_Dynamic, MOVING),
        };
        let mut of_shapes = 1.0;
        if body.motion == Motion::Dynamic {
            of_shapes = density(body, solid::volume(index, body)?);
        }
        let mut shape =
            body_shape(body, of_shapes).map_err(|why| Refusal::body(index, body, why))?;
        let stated = match states_inertia(body) {
            true => Some(solid::stated(index, body)?),
            false => None,
        };
        // A kinematic body turns about its origin, as in the scene.
        let center = match (&stated, body.motion) {
            (Some(stated), _) => Some(vector(&stated.local_com.to_array())),
            (None, Motion::Kinematic) => Some(vector(&[])),
            _ => None,
        };
        if let Some(center) = center {
            shape = shape.centered(center);
        }
        // SAFETY: the settings are made, used and destroyed here; the shape lives until then, and
        // the body keeps it alive afterwards.
        let id = unsafe {
            let settings = jolt::JPH_BodyCreationSettings_Create3(
                shape.0,
                &vector(&body.position),
                &rotation(&body.rotation),
                motion,
                layer,
            );
            jolt::JPH_BodyCreationSettings_SetFriction(settings, friction);
            jolt::JPH_BodyCreationSettings_SetRestitution(settings, restitution);
            jolt::JPH_BodyCreationSettings_SetLinearDamping(settings, 0.0);
            jolt::JPH_BodyCreationSettings_SetAngularDamping(settings, 0.0);
            jolt::JPH_BodyCreationSettings_SetAllowSleeping(settings, false);
            jolt::JPH_BodyCreationSettings_SetGravityFactor(settings, body.gravity_factor as f32);
            let [linear, angular] = [&body.linear_velocity, &body.angular_velocity];
            jolt::JPH_BodyCreationSettings_SetLinearVelocity(settings, &vector(linear));
            jolt::JPH_BodyCreationSettings_SetAngularVelocity(settings, &vector(angular));
            if let Some(stated) = &stated {
                let inertia = stated.reconstruct_inertia_matrix().to_cols_array_2d();
                let column = |[x, y, z]: [f64; 3]| jolt::JPH_Vec4 {
                    x: x as f32,
                    y: y as f32,
                    z: z as f32,
                    w: 0.0,
                };
                let last = jolt::JPH_Vec4 { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
                let [x, y, z] = inertia.map(column);
                jolt::JPH_BodyCreationSettings_SetOverrideMassProperties(
                    settings,
                    jolt::JPH_OverrideMassProperties_MassAndInertiaProvided,
                );
                jolt::JPH_BodyCreationSettings_SetMassPropertiesOverride(
                    settings,
                    &jolt::JPH_MassProperties {
                        mass: stated.mass() as f32,
                        inertia: jolt::JPH_Mat4 { column: [x, y, z, last] },
                    },
                );
            }
            let bodies = jolt::JPH_PhysicsSystem_GetBodyInterface(self.system);
            let active = match body.motion {
                Motion::Static => jolt::JPH_Activation_DontActivate,
                _ => jolt::JPH_Activation_Activate,
            };
            let id = jolt::JPH_BodyInterface_CreateAndAddBody(bodies, settings, active);
            jolt::JPH_BodyCreationSettings_Destroy(settings);
            id
        };
        self.bodies.push(id);
        Ok(())
    }

    /// Keeps bodies that a joint holds from colliding, unless it says that they do. The bodies of a
    /// mechanism are a collision group.
    fn separate(&mut self, holds: &[Hold]) {
        let mut first: Vec<usize> = (0..self.bodies.len()).collect();
        let root = |first: &[usize], mut body: usize| {
            while first[body] != body {
                body = first[body];
            }
            body
        };
        let pairs: Vec<[usize; 2]> = holds
            .iter()
            .filter(|hold| !hold.collide)
            .filter_map(|hold| Some([hold.bodies[0]?, hold.bodies[1]?]))
            .collect();
        for [a, b] in &pairs {
            let [a, b] = [*a, *b].map(|body| root(&first, body));
            first[a.max(b)] = a.min(b);
        }
        let mut members = vec![Vec::new(); first.len()];
        let mut places = vec![0; first.len()];
        for body in 0..first.len() {
            let own = root(&first, body);
            places[body] = members[own].len() as u32;
            members[own].push(body);
        }
        let mut tables: Vec<*mut jolt::JPH_GroupFilterTable> =
            vec![std::ptr::null_mut(); first.len()];
        for [a, b] in pairs {
            let own = root(&first, a);
            // SAFETY: the table is made before its first use; groups keep it alive.
            unsafe {
                if tables[own].is_null() {
                    tables[own] = jolt::JPH_GroupFilterTable_Create(members[own].len() as u32);
                }
                jolt::JPH_GroupFilterTable_DisableCollision(tables[own], places[a], places[b]);
            }
        }
        for (own, members) in members.iter().enumerate().filter(|(own, _)| !tables[*own].is_null())
        {
            for &body in members {
                let group = jolt::JPH_CollisionGroup {
                    groupFilter: tables[own].cast(),
                    groupID: own as u32,
                    subGroupID: places[body],
                };
                // SAFETY: the body is in the system; the group lives through the call.
                unsafe {
                    let bodies = jolt::JPH_PhysicsSystem_GetBodyInterface(self.system);
                    jolt::JPH_BodyInterface_SetCollisionGroup(bodies, self.bodies[body], &group);
                }
            }
        }
    }

    fn join(&mut self, scene: &Scene, hold: &Hold) {
        let [(point_1, x_1, y_1), (point_2, x_2, y_2)] = [0, 1].map(|i| {
            let frame = exact_space::pose(&hold.frames[i].position, &hold.frames[i].rotation);
            let body = hold.bodies[i].map(|index| &scene.bodies[index]);
            let at = body
                .map_or(frame, |body| exact_space::pose(&body.position, &body.rotation) * frame);
            let axis =
                |along: [f64; 3]| vector(&(at.rotation * exact_space::vector(&along)).to_array());
            let point = vector(&at.translation.to_array());
            (point, axis([1.0, 0.0, 0.0]), axis([0.0, 1.0, 0.0]))
        });
        let [lower, upper] =
            hold.limits.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]).map(|limit| limit as f32);
        let [speed, most] =
            hold.motor.map_or([0.0; 2], |of| [of.velocity, of.max_force].map(|x| x as f32));
        let space = jolt::JPH_ConstraintSpace_WorldSpace;
        // SAFETY: the settings are the library's own, in place, and live through the calls; the
        // bodies are in the system, which keeps the constraint.
        unsafe {
            let [body_1, body_2] = hold.bodies.map(|body| match body {
                Some(index) => {
                    jolt::JPH_PhysicsSystem_GetBodyPtr(self.system, self.bodies[index]).cast_mut()
                }
                None => jolt::JPH_Body_GetFixedToWorldBody(),
            });
            let constraint: *mut jolt::JPH_Constraint = match hold.kind {
                HoldKind::Fixed => {
                    let mut of = std::mem::zeroed();
                    jolt::JPH_FixedConstraintSettings_Init(&mut of);
                    (of.space, of.point1, of.point2) = (space, point_1, point_2);
                    (of.axisX1, of.axisX2) = (x_1, x_2);
                    (of.axisY1, of.axisY2) = (y_1, y_2);
                    jolt::JPH_FixedConstraint_Create(&of, body_1, body_2).cast()
                }
                HoldKind::Ball => {
                    let mut of = std::mem::zeroed();
                    jolt::JPH_PointConstraintSettings_Init(&mut of);
                    (of.space, of.point1, of.point2) = (space, point_1, point_2);
                    jolt::JPH_PointConstraint_Create(&of, body_1, body_2).cast()
                }
                HoldKind::Hinge => {
                    let mut of = std::mem::zeroed();
                    jolt::JPH_HingeConstraintSettings_Init(&mut of);
                    (of.space, of.point1, of.point2) = (space, point_1, point_2);
                    (of.hingeAxis1, of.hingeAxis2) = (x_1, x_2);
                    (of.normalAxis1, of.normalAxis2) = (y_1, y_2);
                    (of.limitsMin, of.limitsMax) = (lower.max(-HALF_TURN), upper.min(HALF_TURN));
                    (of.motorSettings.minTorqueLimit, of.motorSettings.maxTorqueLimit) =
                        (-most, most);
                    let hinge = jolt::JPH_HingeConstraint_Create(&of, body_1, body_2);
                    if hold.motor.is_some() {
                        jolt::JPH_HingeConstraint_SetMotorState(
                            hinge,
                            jolt::JPH_MotorState_Velocity,
                        );
                        jolt::JPH_HingeConstraint_SetTargetAngularVelocity(hinge, speed);
                    }
                    hinge.cast()
                }
                HoldKind::Slider => {
                    let mut of = std::mem::zeroed();
                    jolt::JPH_SliderConstraintSettings_Init(&mut of);
                    (of.space, of.point1, of.point2) = (space, point_1, point_2);
                    (of.sliderAxis1, of.sliderAxis2) = (x_1, x_2);
                    (of.normalAxis1, of.normalAxis2) = (y_1, y_2);
                    if hold.limits.is_some() {
                        (of.limitsMin, of.limitsMax) = (lower, upper);
                    }
                    (of.motorSettings.minForceLimit, of.motorSettings.maxForceLimit) =
                        (-most, most);
                    let slider = jolt::JPH_SliderConstraint_Create(&of, body_1, body_2);
                    if hold.motor.is_some() {
                        jolt::JPH_SliderConstraint_SetMotorState(
                            slider,
                            jolt::JPH_MotorState_Velocity,
                        );
                        jolt::JPH_SliderConstraint_SetTargetVelocity(slider, speed);
                    }
                    slider.cast()
                }
            };
            jolt::JPH_PhysicsSystem_AddConstraint(self.system, constraint);
        }
    }
}

/// A shape that is released when it is dropped.
struct Shape(*mut jolt::JPH_Shape);

impl Shape {
    fn new(shape: *mut jolt::JPH_Shape, what: &str) -> Result<Self, String> {
        if shape.is_null() {
            Err(format!("{what} that Jolt does not take"))
        } else {
            Ok(Self(shape))
        }
    }

    /// Returns the shape with another center of mass.
    fn centered(self, center: jolt::JPH_Vec3) -> Self {
        let mut own = vector(&[]);
        // SAFETY: the shape is not null; the new shape keeps it alive.
        unsafe {
            jolt::JPH_Shape_GetCenterOfMass(self.0, &mut own);
            let offset =
                jolt::JPH_Vec3 { x: center.x - own.x, y: center.y - own.y, z: center.z - own.z };
            Self(jolt::JPH_OffsetCenterOfMassShape_Create(&offset, self.0).cast())
        }
    }
}

impl Drop for Shape {
    fn drop(&mut self) {
        // SAFETY: not null, and released once.
        unsafe { jolt::JPH_Shape_Destroy(self.0) };
    }
}

fn body_shape(body: &Body, density: f64) -> Result<Shape, String> {
    let mut parts = Vec::with_capacity(body.shapes.len());
    for part in &body.shapes {
        let at = (vector(&part.position), rotation(&part.rotation));
        parts.push((shape(&part.kind, density as f32)?, at));
    }
    if let [(_, (position, rotation))] = parts.as_slice() {
        let turned = [rotation.x, rotation.y, rotation.z];
        let moved = [position.x, position.y, position.z];
        if turned == [0.0; 3] && moved == [0.0; 3] {
            return Ok(parts.remove(0).0);
        }
    }
    // SAFETY: the settings are made, used and destroyed here; the compound keeps the parts alive.
    unsafe {
        if let [(part, (position, rotation))] = parts.as_slice() {
            let shape = jolt::JPH_RotatedTranslatedShape_Create(position, rotation, part.0);
            return Shape::new(shape.cast(), "a shape out of place");
        }
        let settings = jolt::JPH_StaticCompoundShapeSettings_Create();
        for (part, (position, rotation)) in &parts {
            jolt::JPH_CompoundShapeSettings_AddShape2(
                settings.cast(),
                position,
                rotation,
                part.0,
                0,
            );
        }
        let compound = jolt::JPH_StaticCompoundShape_Create(settings);
        jolt::JPH_ShapeSettings_Destroy(settings.cast());
        Shape::new(compound.cast(), "a compound")
    }
}

fn shape(kind: &ShapeKind, density: f32) -> Result<Shape, String> {
    // Maximum radius of rounded edges; thin shapes have room for less.
    let radius = |half: f32| CONVEX_RADIUS.min(0.5 * half);
    // SAFETY: values and lists that live through the calls; settings are destroyed after use.
    let shape = unsafe {
        match kind {
            ShapeKind::Sphere { radius } => {
                Shape::new(jolt::JPH_SphereShape_Create(*radius as f32).cast(), "a sphere")
            }
            ShapeKind::Box { half_extents } => {
                let half = vector(half_extents);
                let thinnest = half.x.min(half.y).min(half.z);
                Shape::new(jolt::JPH_BoxShape_Create(&half, radius(thinnest)).cast(), "a box")
            }
            ShapeKind::Capsule { radius, half_height } => Shape::new(
                jolt::JPH_CapsuleShape_Create(*half_height as f32, *radius as f32).cast(),
                "a capsule",
            ),
            ShapeKind::Cylinder { radius: wide, half_height } => {
                let (wide, high) = (*wide as f32, *half_height as f32);
                let settings =
                    jolt::JPH_CylinderShapeSettings_Create(high, wide, radius(high.min(wide)));
                let shape = jolt::JPH_CylinderShapeSettings_CreateShape(settings);
                jolt::JPH_ShapeSettings_Destroy(settings.cast());
                Shape::new(shape.cast(), "a cylinder")
            }
            ShapeKind::ConvexHull { points } => {
                let points: Vec<_> = points.iter().map(|point| vector(point)).collect();
                let settings = jolt::JPH_ConvexHullShapeSettings_Create(
                    points.as_ptr(),
                    points.len() as u32,
                    CONVEX_RADIUS,
                );
                let hull = jolt::JPH_ConvexHullShapeSettings_CreateShape(settings);
                jolt::JPH_ShapeSettings_Destroy(settings.cast());
                let hull = Shape::new(hull.cast(), &format!("a hull of {} points", points.len()))?;
                let volume = crate::shapes::exact_space::shape(kind)?.mass_properties(1.0).mass();
                let kept = jolt::JPH_Shape_GetVolume(hull.0);
                if f64::from(kept) < (1.0 - LOST_VOLUME) * volume {
                    return Err(format!("a hull of {volume} m^3, of which Jolt keeps {kept} m^3"));
                }
                Ok(hull)
            }
            ShapeKind::Halfspace { normal } => {
                let normal = vector(normal);
                let length = normal.x.hypot(normal.y).hypot(normal.z);
                let [x, y, z] = [normal.x, normal.y, normal.z].map(|along| along / length);
                let plane = jolt::JPH_Plane { normal: jolt::JPH_Vec3 { x, y, z }, distance: 0.0 };
                let shape = jolt::JPH_PlaneShape_Create(&plane, null(), PLANE);
                return Shape::new(shape.cast(), "a half-space");
            }
            ShapeKind::Trimesh { vertices, triangles, .. } => {
                let vertices: Vec<_> = vertices.iter().map(|vertex| vector(vertex)).collect();
                let triangles: Vec<_> = triangles
                    .iter()
                    .map(|&[i1, i2, i3]| jolt::JPH_IndexedTriangle {
                        i1,
                        i2,
                        i3,
                        materialIndex: 0,
                        userData: 0,
                    })
                    .collect();
                let settings = jolt::JPH_MeshShapeSettings_Create2(
                    vertices.as_ptr(),
                    vertices.len() as u32,
                    triangles.as_ptr(),
                    triangles.len() as u32,
                );
                let shape = jolt::JPH_MeshShapeSettings_CreateShape(settings);
                jolt::JPH_ShapeSettings_Destroy(settings.cast());
                return Shape::new(shape.cast(), "a mesh");
            }
        }
    }?;
    // SAFETY: all shapes but planes and meshes, which returned above, are convex.
    unsafe { jolt::JPH_ConvexShape_SetDensity(shape.0.cast(), density) };
    Ok(shape)
}

fn vector(of: &[f64]) -> jolt::JPH_Vec3 {
    let axis = |i: usize| of.get(i).copied().unwrap_or(0.0) as f32;
    jolt::JPH_Vec3 { x: axis(0), y: axis(1), z: axis(2) }
}

fn rotation(of: &Rotation) -> jolt::JPH_Quat {
    match of {
        Rotation::Quaternion(q) => {
            let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
            let [x, y, z, w] = q.map(|x| (x / length) as f32);
            jolt::JPH_Quat { x, y, z, w }
        }
        Rotation::Angle(_) => jolt::JPH_Quat { x: 0.0, y: 0.0, z: 0.0, w: 1.0 },
    }
}

impl Engine for Jolt {
    fn step(&mut self, dt: f32) -> Result<(), Refusal> {
        // SAFETY: system, memory and jobs live as long as self.
        let fault = unsafe {
            jolt::JPH_PhysicsSystem_Update2(
                self.system,
                dt,
                self.collision_steps,
                self.memory,
                self.jobs,
            )
        };
        match fault {
            jolt::JPH_PhysicsUpdateError_None => Ok(()),
            code => {
                Err(Refusal::new("jolt", format!("has no room for all contacts (code {code})")))
            }
        }
    }

    fn write_poses(&self, out: &mut Vec<f32>) {
        for &body in &self.bodies {
            let mut p = vector(&[]);
            let mut q = rotation(&Rotation::Angle(0.0));
            // SAFETY: the body is in the system, which lives as long as self.
            unsafe {
                let bodies = jolt::JPH_PhysicsSystem_GetBodyInterface(self.system);
                jolt::JPH_BodyInterface_GetPositionAndRotation(bodies, body, &mut p, &mut q);
            }
            out.extend([p.x, p.y, p.z, q.x, q.y, q.z, q.w]);
        }
    }
}

impl Peer for Jolt {
    fn move_to(&mut self, body: usize, position: &[f64], turn: &Rotation, dt: f32) {
        let (mut p, mut q) = (vector(position), rotation(turn));
        // SAFETY: the body is in the system, which lives as long as self.
        unsafe {
            let bodies = jolt::JPH_PhysicsSystem_GetBodyInterface(self.system);
            jolt::JPH_BodyInterface_MoveKinematic(bodies, self.bodies[body], &mut p, &mut q, dt);
        }
    }
}

impl Drop for Jolt {
    fn drop(&mut self) {
        // SAFETY: made in `new`, and not used after; the system destroys its bodies.
        unsafe {
            jolt::JPH_PhysicsSystem_Destroy(self.system);
            jolt::JPH_JobSystem_Destroy(self.jobs);
            jolt::JPH_TempAllocator_Destroy(self.memory);
        }
    }
}
