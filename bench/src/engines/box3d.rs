//! A scene in Box3D with its default world.
#![allow(unsafe_code)]

use boxddd_sys::ffi as b3;
use drystone_scene::{Body, Motion, Rotation, Scene, ShapeKind};

use super::{Effort, Engine, Peer, Refusal, density, holds, soft_step, solid, states_inertia};
use crate::hold::{Hold, HoldKind};

/// Number of substeps that Box3D's manual recommends. \[1\]
const SUBSTEPS: u32 = 4;
/// Half width and half depth of the box that replaces a half-space. \[m\]
const HALFSPACE: [f32; 2] = [100.0, 5.0];
/// Fraction of its volume that a hull may lose where Box3D merges near points. \[1\]
const LOST_VOLUME: f64 = 1e-2;
const ONE: b3::b3Vec3 = b3::b3Vec3 { x: 1.0, y: 1.0, z: 1.0 };

/// Takes z to x, x to y and y to z: Box3D's hinges turn about z.
const Z_TO_X: b3::b3Quat = b3::b3Quat { v: b3::b3Vec3 { x: 0.5, y: 0.5, z: 0.5 }, s: 0.5 };

/// A scene in Box3D.
pub(super) struct Box3d {
    world: b3::b3WorldId,
    bodies: Vec<b3::b3BodyId>,
    meshes: Vec<*mut b3::b3MeshData>,
    substeps: i32,
}

impl Box3d {
    /// Builds the scene.
    ///
    /// # Errors
    /// Box3D does not support a shape.
    pub(super) fn new(scene: &Scene, effort: Effort, threads: usize) -> Result<Self, Refusal> {
        // SAFETY: no arguments.
        let mut settings = unsafe { b3::b3DefaultWorldDef() };
        settings.gravity = vector(&scene.gravity);
        settings.enableSleep = false;
        settings.workerCount = threads as u32;
        let mut substeps = SUBSTEPS;
        if let Some((count, hertz)) = soft_step(effort) {
            substeps = count;
            settings.contactHertz = hertz;
        }
        // SAFETY: the settings started as the library's own and live through the call.
        let world = unsafe { b3::b3CreateWorld(&settings) };
        let mut engine =
            Self { world, bodies: Vec::new(), meshes: Vec::new(), substeps: substeps as i32 };
        for (index, body) in scene.bodies.iter().enumerate() {
            engine.add(index, body)?;
        }
        let holds = holds(scene)?;
        if !holds.is_empty() {
            // SAFETY: the settings are the library's own; the world lives as long as self.
            let fixed = unsafe { b3::b3CreateBody(world, &b3::b3DefaultBodyDef()) };
            holds.iter().for_each(|hold| engine.join(fixed, hold));
        }
        Ok(engine)
    }

    fn add(&mut self, index: usize, body: &Body) -> Result<(), Refusal> {
        // SAFETY: no arguments.
        let mut settings = unsafe { b3::b3DefaultBodyDef() };
        settings.type_ = match body.motion {
            Motion::Static => b3::b3BodyType_b3_staticBody,
            Motion::Kinematic => b3::b3BodyType_b3_kinematicBody,
            Motion::Dynamic => b3::b3BodyType_b3_dynamicBody,
        };
        settings.position = vector(&body.position);
        settings.rotation = rotation(&body.rotation);
        settings.gravityScale = body.gravity_factor as f32;
        settings.enableSleep = false;
        // SAFETY: the world lives as long as self.
        let id = unsafe { b3::b3CreateBody(self.world, &settings) };
        self.bodies.push(id);
        let mut of_shapes = 0.0;
        if body.motion == Motion::Dynamic {
            of_shapes = density(body, solid::volume(index, body)?);
        }
        for part in &body.shapes {
            // SAFETY: no arguments.
            let mut settings = unsafe { b3::b3DefaultShapeDef() };
            settings.density = of_shapes as f32;
            settings.baseMaterial.friction = part.material.friction as f32;
            settings.baseMaterial.restitution = part.material.restitution as f32;
            let place = b3::b3Transform { p: vector(&part.position), q: rotation(&part.rotation) };
            self.add_shape(id, &settings, &part.kind, place)
                .map_err(|why| Refusal::body(index, body, why))?;
        }
        if states_inertia(body) {
            let stated = solid::stated(index, body)?;
            let [cx, cy, cz] = stated
                .reconstruct_inertia_matrix()
                .to_cols_array_2d()
                .map(|column| vector(&column));
            let mass = b3::b3MassData {
                mass: stated.mass() as f32,
                center: vector(&stated.local_com.to_array()),
                inertia: b3::b3Matrix3 { cx, cy, cz },
            };
            // SAFETY: the body is in the world.
            unsafe { b3::b3Body_SetMassData(id, mass) };
        }
        // Set after the mass, these are the velocities of the center of mass.
        // SAFETY: the body is in the world.
        unsafe {
            b3::b3Body_SetLinearVelocity(id, vector(&body.linear_velocity));
            b3::b3Body_SetAngularVelocity(id, vector(&body.angular_velocity));
        }
        Ok(())
    }

    fn add_shape(
        &mut self,
        body: b3::b3BodyId,
        settings: &b3::b3ShapeDef,
        kind: &ShapeKind,
        place: b3::b3Transform,
    ) -> Result<(), String> {
        match kind {
            ShapeKind::Sphere { radius } => {
                let sphere = b3::b3Sphere { center: place.p, radius: *radius as f32 };
                // SAFETY: the body is in the world; settings and sphere live through the call.
                unsafe { b3::b3CreateSphereShape(body, settings, &sphere) };
            }
            ShapeKind::Capsule { radius, half_height } => {
                let [center1, center2] =
                    [-half_height, *half_height].map(|y| at(&place, [0.0, y as f32, 0.0]));
                let capsule = b3::b3Capsule { center1, center2, radius: *radius as f32 };
                // SAFETY: the body is in the world; settings and capsule live through the call.
                unsafe { b3::b3CreateCapsuleShape(body, settings, &capsule) };
            }
            ShapeKind::Box { half_extents } => {
                let half = vector(half_extents);
                add_box(body, settings, half, place);
            }
            ShapeKind::Halfspace { normal } => {
                let normal = vector(normal);
                let length = normal.x.hypot(normal.y).hypot(normal.z);
                let [x, y, z] = [normal.x, normal.y, normal.z].map(|along| along / length);
                let [width, depth] = HALFSPACE;
                let middle = at(&place, [x, y, z].map(|along| -depth * along));
                let turn = product(&place.q, &upright([x, y, z]));
                let half = b3::b3Vec3 { x: width, y: depth, z: width };
                add_box(body, settings, half, b3::b3Transform { p: middle, q: turn });
            }
            ShapeKind::ConvexHull { points } => {
                let volume = crate::shapes::exact_space::shape(kind)?.mass_properties(1.0).mass();
                add_hull(body, settings, points, place, volume)?;
            }
            ShapeKind::Trimesh { vertices, triangles, .. } => {
                let mut vertices: Vec<_> =
                    vertices.iter().map(|v| at(&place, v.map(|x| x as f32))).collect();
                let mut indices: Vec<i32> =
                    triangles.iter().flatten().map(|&vertex| vertex as i32).collect();
                let definition = b3::b3MeshDef {
                    vertices: vertices.as_mut_ptr(),
                    indices: indices.as_mut_ptr(),
                    materialIndices: std::ptr::null_mut(),
                    weldTolerance: 0.0,
                    vertexCount: vertices.len() as i32,
                    triangleCount: triangles.len() as i32,
                    weldVertices: false,
                    useMedianSplit: false,
                    identifyEdges: true,
                };
                // SAFETY: pointers and counts belong to lists that live through the call.
                let mesh = unsafe { b3::b3CreateMesh(&definition, std::ptr::null_mut(), 0) };
                if mesh.is_null() {
                    return Err("a mesh that Box3D does not take".to_string());
                }
                self.meshes.push(mesh);
                // SAFETY: the body is in the world; the mesh outlives the world.
                unsafe { b3::b3CreateMeshShape(body, settings, mesh, ONE) };
            }
            ShapeKind::Cylinder { .. } => {
                return Err("a cylinder, which Box3D does not have".to_string());
            }
        }
        Ok(())
    }

    fn join(&mut self, fixed: b3::b3BodyId, hold: &Hold) {
        let [a, b] = hold.bodies.map(|body| body.map_or(fixed, |index| self.bodies[index]));
        let turned = |q: b3::b3Quat| match hold.kind {
            HoldKind::Hinge => product(&q, &Z_TO_X),
            _ => q,
        };
        let [at_a, at_b] = [0, 1].map(|i| &hold.frames[i]).map(|frame| b3::b3Transform {
            p: vector(&frame.position),
            q: turned(rotation(&frame.rotation)),
        });
        let place = |base: &mut b3::b3JointDef| {
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
                    let mut settings = b3::b3DefaultWeldJointDef();
                    place(&mut settings.base);
                    b3::b3CreateWeldJoint(self.world, &settings);
                }
                HoldKind::Ball => {
                    let mut settings = b3::b3DefaultSphericalJointDef();
                    place(&mut settings.base);
                    b3::b3CreateSphericalJoint(self.world, &settings);
                }
                HoldKind::Hinge => {
                    let mut settings = b3::b3DefaultRevoluteJointDef();
                    place(&mut settings.base);
                    settings.enableLimit = hold.limits.is_some();
                    (settings.lowerAngle, settings.upperAngle) = (lower, upper);
                    settings.enableMotor = hold.motor.is_some();
                    (settings.motorSpeed, settings.maxMotorTorque) = (speed, most);
                    b3::b3CreateRevoluteJoint(self.world, &settings);
                }
                HoldKind::Slider => {
                    let mut settings = b3::b3DefaultPrismaticJointDef();
                    place(&mut settings.base);
                    settings.enableLimit = hold.limits.is_some();
                    (settings.lowerTranslation, settings.upperTranslation) = (lower, upper);
                    settings.enableMotor = hold.motor.is_some();
                    (settings.motorSpeed, settings.maxMotorForce) = (speed, most);
                    b3::b3CreatePrismaticJoint(self.world, &settings);
                }
            }
        }
    }
}

fn add_box(
    body: b3::b3BodyId,
    settings: &b3::b3ShapeDef,
    half: b3::b3Vec3,
    place: b3::b3Transform,
) {
    // SAFETY: values only.
    let hull = unsafe { b3::b3MakeTransformedBoxHull(half.x, half.y, half.z, place) };
    // SAFETY: the body is in the world; settings and hull live through the call.
    unsafe { b3::b3CreateHullShape(body, settings, &hull.base) };
}

fn add_hull(
    body: b3::b3BodyId,
    settings: &b3::b3ShapeDef,
    points: &[Vec<f64>],
    place: b3::b3Transform,
    volume: f64,
) -> Result<(), String> {
    let points: Vec<_> = points.iter().map(|point| vector(point)).collect();
    let most = b3::B3_MAX_HULL_VERTICES as i32;
    // SAFETY: pointer and count belong to one list, which lives through the call.
    let hull = unsafe { b3::b3CreateHull(points.as_ptr(), points.len() as i32, most) };
    if hull.is_null() {
        return Err(format!("a hull of {} points that Box3D does not take", points.len()));
    }
    // SAFETY: the hull is not null, and is destroyed once, after its last use: shapes have copies.
    let kept = unsafe {
        let kept = (*hull).volume;
        b3::b3CreateTransformedHullShape(body, settings, hull, place, ONE);
        b3::b3DestroyHull(hull);
        kept
    };
    if f64::from(kept) < (1.0 - LOST_VOLUME) * volume {
        return Err(format!("a hull of {volume} m^3, of which Box3D keeps {kept} m^3"));
    }
    Ok(())
}

fn vector(of: &[f64]) -> b3::b3Vec3 {
    let axis = |i: usize| of.get(i).copied().unwrap_or(0.0) as f32;
    b3::b3Vec3 { x: axis(0), y: axis(1), z: axis(2) }
}

fn rotation(of: &Rotation) -> b3::b3Quat {
    match of {
        Rotation::Quaternion([x, y, z, w]) => {
            let length = (x * x + y * y + z * z + w * w).sqrt();
            b3::b3Quat { v: vector(&[x / length, y / length, z / length]), s: (w / length) as f32 }
        }
        Rotation::Angle(_) => b3::b3Quat { v: vector(&[]), s: 1.0 },
    }
}

/// Returns the shortest rotation from +y to a unit vector.
fn upright([x, y, z]: [f32; 3]) -> b3::b3Quat {
    let s = (0.5 * (1.0 + y)).max(0.0).sqrt();
    if s < 1e-4 {
        return b3::b3Quat { v: vector(&[1.0]), s: 0.0 };
    }
    b3::b3Quat { v: b3::b3Vec3 { x: 0.5 * z / s, y: 0.0, z: -0.5 * x / s }, s }
}

fn product(p: &b3::b3Quat, q: &b3::b3Quat) -> b3::b3Quat {
    let turned = cross(&p.v, &q.v);
    let along = |a: f32, b: f32, c: f32| p.s * b + q.s * a + c;
    b3::b3Quat {
        v: b3::b3Vec3 {
            x: along(p.v.x, q.v.x, turned.x),
            y: along(p.v.y, q.v.y, turned.y),
            z: along(p.v.z, q.v.z, turned.z),
        },
        s: p.s * q.s - p.v.x * q.v.x - p.v.y * q.v.y - p.v.z * q.v.z,
    }
}

fn cross(a: &b3::b3Vec3, b: &b3::b3Vec3) -> b3::b3Vec3 {
    b3::b3Vec3 { x: a.y * b.z - a.z * b.y, y: a.z * b.x - a.x * b.z, z: a.x * b.y - a.y * b.x }
}

fn at(place: &b3::b3Transform, [x, y, z]: [f32; 3]) -> b3::b3Vec3 {
    let v = b3::b3Vec3 { x, y, z };
    let first = cross(&place.q.v, &v);
    let second = cross(&place.q.v, &first);
    let turned = |v: f32, first: f32, second: f32| v + 2.0 * (place.q.s * first + second);
    b3::b3Vec3 {
        x: place.p.x + turned(x, first.x, second.x),
        y: place.p.y + turned(y, first.y, second.y),
        z: place.p.z + turned(z, first.z, second.z),
    }
}

impl Engine for Box3d {
    fn step(&mut self, dt: f32) -> Result<(), Refusal> {
        // SAFETY: the world lives as long as self.
        unsafe { b3::b3World_Step(self.world, dt, self.substeps) };
        Ok(())
    }

    fn write_poses(&self, out: &mut Vec<f32>) {
        for &body in &self.bodies {
            // SAFETY: the body is in the world, which lives as long as self.
            let (p, q) = unsafe { (b3::b3Body_GetPosition(body), b3::b3Body_GetRotation(body)) };
            out.extend([p.x, p.y, p.z, q.v.x, q.v.y, q.v.z, q.s]);
        }
    }
}

impl Peer for Box3d {
    fn move_to(&mut self, body: usize, position: &[f64], turn: &Rotation, dt: f32) {
        let target = b3::b3Transform { p: vector(position), q: rotation(turn) };
        // SAFETY: the body is in the world, which lives as long as self.
        unsafe { b3::b3Body_SetTargetTransform(self.bodies[body], target, dt, true) };
    }
}

impl Drop for Box3d {
    fn drop(&mut self) {
        // SAFETY: made in `new`, and not used after; the world is destroyed before its meshes.
        unsafe {
            b3::b3DestroyWorld(self.world);
            for &mesh in &self.meshes {
                b3::b3DestroyMesh(mesh);
            }
        }
    }
}
