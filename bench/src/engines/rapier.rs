//! A scene in rapier2d or rapier3d with default parameters.

use drystone_scene::Scene;

use super::{Effort, Engine, Refusal, follow, soft_step};

/// Damping of motors that keep their velocity. \[N s/m, or N m s/rad\]
const MOTOR: f32 = 1e6;

/// Builds a scene in rapier2d.
pub(super) fn flat(
    scene: &Scene,
    effort: Effort,
    threads: usize,
) -> Result<Box<dyn Engine>, Refusal> {
    Ok(follow(in_2d::Rapier::new(scene, effort, threads)?, scene))
}

/// Builds a scene in rapier3d.
pub(super) fn space(
    scene: &Scene,
    effort: Effort,
    threads: usize,
) -> Result<Box<dyn Engine>, Refusal> {
    Ok(follow(in_3d::Rapier::new(scene, effort, threads)?, scene))
}

/// The engine in 2D and in 3D.
macro_rules! rapier {
    ($name:ident: $rapier:ident, $shapes:ident, $solids:ident, $spin:expr, $mass:expr, $pose:expr) => {
        mod $name {
            use drystone_scene::{Body, Motion, Rotation, Scene};
            use $rapier::prelude::{
                AngVector, CoefficientCombineRule, ColliderBuilder, GenericJoint, JointAxesMask,
                JointAxis, MassProperties, MotorModel, PhysicsWorld, Pose, RigidBodyBuilder,
                RigidBodyHandle,
            };

            use super::super::$solids as solids;
            use super::super::{Effort, Engine, Peer, Refusal, density, holds, states_inertia};
            use super::MOTOR;
            use crate::hold::{Hold, HoldKind};
            use crate::shapes::$shapes::{pose, shape, vector};

            pub(super) struct Rapier {
                world: PhysicsWorld,
                bodies: Vec<RigidBodyHandle>,
            }

            impl Rapier {
                pub(super) fn new(
                    scene: &Scene,
                    effort: Effort,
                    threads: usize,
                ) -> Result<Self, Refusal> {
                    let mut world =
                        PhysicsWorld { gravity: vector(&scene.gravity), ..PhysicsWorld::default() };
                    if let Some((substeps, hertz)) = super::soft_step(effort) {
                        let parameters = &mut world.integration_parameters;
                        parameters.num_solver_iterations = substeps as usize;
                        parameters.contact_softness.natural_frequency = hertz;
                        parameters.static_contact_softness.natural_frequency = 2.0 * hertz;
                    }
                    #[cfg(feature = "rapier-parallel")]
                    world
                        .configure_thread_pool(threads)
                        .map_err(|error| Refusal::new("threads", error.to_string()))?;
                    #[cfg(not(feature = "rapier-parallel"))]
                    if threads > 1 {
                        let why = "rapier is built for one; build with --features rapier-parallel";
                        return Err(Refusal::new("threads", why));
                    }
                    let mut bodies = Vec::with_capacity(scene.bodies.len());
                    for (index, body) in scene.bodies.iter().enumerate() {
                        bodies.push(insert(&mut world, index, body)?);
                    }
                    let holds = holds(scene)?;
                    if !holds.is_empty() {
                        let fixed = world.bodies.insert(RigidBodyBuilder::fixed());
                        holds.iter().for_each(|hold| join(&mut world, &bodies, fixed, hold));
                    }
                    Ok(Self { world, bodies })
                }
            }

            fn insert(
                world: &mut PhysicsWorld,
                index: usize,
                body: &Body,
            ) -> Result<RigidBodyHandle, Refusal> {
                let spin: fn(&[f64]) -> AngVector = $spin;
                let builder = match body.motion {
                    Motion::Dynamic => RigidBodyBuilder::dynamic(),
                    Motion::Static => RigidBodyBuilder::fixed(),
                    Motion::Kinematic if body.track.times.is_empty() => {
                        RigidBodyBuilder::kinematic_velocity_based()
                    }
                    Motion::Kinematic => RigidBodyBuilder::kinematic_position_based(),
                };
                let mut builder = builder
                    .pose(pose(&body.position, &body.rotation))
                    .linvel(vector(&body.linear_velocity))
                    .angvel(spin(&body.angular_velocity))
                    .gravity_scale(body.gravity_factor as f32)
                    .can_sleep(false);
                let mut of_shapes = 0.0;
                if states_inertia(body) {
                    let mass: fn(&solids::MassProperties) -> MassProperties = $mass;
                    builder =
                        builder.additional_mass_properties(mass(&solids::stated(index, body)?));
                } else if body.motion == Motion::Kinematic {
                    // A kinematic body turns about its origin, as in the scene.
                    builder =
                        builder.additional_mass_properties(MassProperties::from_ball(1.0, 1.0));
                } else if body.motion == Motion::Dynamic {
                    of_shapes = density(body, solids::volume(index, body)?);
                }
                let handle = world.bodies.insert(builder);
                for part in &body.shapes {
                    let shape = shape(&part.kind).map_err(|why| Refusal::body(index, body, why))?;
                    let collider = ColliderBuilder::new(shape)
                        .position(pose(&part.position, &part.rotation))
                        .density(of_shapes as f32)
                        .friction(part.material.friction as f32)
                        .restitution(part.material.restitution as f32)
                        .friction_combine_rule(CoefficientCombineRule::GeometricMean)
                        .restitution_combine_rule(CoefficientCombineRule::Max);
                    world.colliders.insert_with_parent(collider, handle, &mut world.bodies);
                }
                Ok(handle)
            }

            fn join(
                world: &mut PhysicsWorld,
                bodies: &[RigidBodyHandle],
                fixed: RigidBodyHandle,
                hold: &Hold,
            ) {
                let (locked, free) = match hold.kind {
                    HoldKind::Fixed => (JointAxesMask::LOCKED_FIXED_AXES, JointAxis::AngX),
                    HoldKind::Ball => (JointAxesMask::LIN_AXES, JointAxis::AngX),
                    HoldKind::Hinge => (JointAxesMask::LOCKED_REVOLUTE_AXES, JointAxis::AngX),
                    HoldKind::Slider => (JointAxesMask::LOCKED_PRISMATIC_AXES, JointAxis::LinX),
                };
                let mut joint = GenericJoint::new(locked);
                let [first, second] =
                    [0, 1].map(|i| pose(&hold.frames[i].position, &hold.frames[i].rotation));
                joint.set_local_frame1(first).set_local_frame2(second);
                joint.set_contacts_enabled(hold.collide);
                if let Some(limits) = hold.limits {
                    joint.set_limits(free, limits.map(|limit| limit as f32));
                }
                if let Some(motor) = hold.motor {
                    joint.set_motor_model(free, MotorModel::ForceBased);
                    joint.set_motor_velocity(free, motor.velocity as f32, MOTOR);
                    joint.set_motor_max_force(free, motor.max_force as f32);
                }
                let [first, second] = hold.bodies.map(|body| body.map_or(fixed, |i| bodies[i]));
                world.insert_impulse_joint(first, second, joint);
            }

            impl Engine for Rapier {
                fn step(&mut self, dt: f32) -> Result<(), Refusal> {
                    self.world.integration_parameters.dt = dt;
                    self.world.step();
                    Ok(())
                }

                fn write_poses(&self, out: &mut Vec<f32>) {
                    let write: fn(&Pose, &mut Vec<f32>) = $pose;
                    for &body in &self.bodies {
                        write(self.world.bodies[body].position(), out);
                    }
                }
            }

            impl Peer for Rapier {
                fn move_to(&mut self, body: usize, position: &[f64], rotation: &Rotation, _: f32) {
                    let body = &mut self.world.bodies[self.bodies[body]];
                    body.set_next_kinematic_position(pose(position, rotation));
                }
            }
        }
    };
}

rapier!(
    in_2d: rapier2d, flat, flat_solid,
    |spin| spin.first().copied().unwrap_or(0.0) as f32,
    |stated| MassProperties::new(
        stated.local_com.as_vec2(),
        stated.mass() as f32,
        stated.principal_inertia() as f32,
    ),
    |pose, out| {
        out.extend(pose.translation.to_array());
        out.push(pose.rotation.angle());
    }
);
rapier!(
    in_3d: rapier3d, space, solid,
    |spin| vector(spin),
    |stated| MassProperties::with_inertia_matrix(
        stated.local_com.as_vec3(),
        stated.mass() as f32,
        stated.reconstruct_inertia_matrix().as_mat3(),
    ),
    |pose, out| {
        out.extend(pose.translation.to_array());
        out.extend(pose.rotation.to_array());
    }
);
