//! Drystone and rapier behind one face: one thread, friction as the scene says, nothing sleeps.

use drystone::geometry::{Geometry, Rigid3};
use drystone::scene::{Material, Motion};
use drystone::{Body, BodyId, Collider, StepReport, StepSettings, World3};
use drystone_solver::{Vector, Velocity};
use rapier3d::math::{Pose, Rotation};
use rapier3d::prelude::{
    ColliderBuilder, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle, Vector as V,
};

use crate::scenes::Scene;

/// Length of a step. \[s\]
const DT: f32 = 1.0 / 60.0;
/// \[m/s^2\]
const GRAVITY: [f32; 3] = [0.0, -9.81, 0.0];

/// Position and unit quaternion x, y, z, w of a body's origin.
pub(crate) type Placement = ([f32; 3], [f32; 4]);

/// A scene in an engine.
pub(crate) trait Engine {
    /// One step.
    fn step(&mut self);
    /// Where the bodies are, in the order of the scene.
    fn placements(&self) -> Vec<Placement>;
    /// Manifolds and contact points that the solver of the last step saw.
    fn contacts(&self) -> [usize; 2];
}

/// A scene in Drystone.
pub(crate) struct Drystone {
    world: World3,
    ids: Vec<BodyId>,
    pub(crate) report: StepReport,
}

impl Drystone {
    pub(crate) fn new(scene: &Scene, settings: StepSettings) -> Self {
        let mut world = World3::new(settings);
        world.gravity = Vector(GRAVITY);
        let material =
            Material { friction: scene.friction.into(), restitution: 0.0, ..Material::default() };
        let ids = scene.bodies.iter().map(|body| {
            let motion = if body.fixed { Motion::Static } else { Motion::Dynamic };
            let collider = Collider {
                density: body.density,
                material: material.clone(),
                ..Collider::new(body.form.shape())
            };
            world.add(Body {
                pose: Rigid3::pose(Vector(body.position), &body.rotation),
                velocity: Velocity { linear: Vector(body.velocity), angular: Vector::ZERO },
                colliders: vec![collider],
                ..Body::new(motion, body.position, body.form.shape())
            })
        });
        let ids = ids.collect();
        Self { world, ids, report: StepReport::default() }
    }
}

impl Engine for Drystone {
    fn step(&mut self) {
        self.report = self.world.step(DT);
    }

    fn placements(&self) -> Vec<Placement> {
        let poses = self.ids.iter().filter_map(|&id| self.world.pose(id));
        poses.map(|pose| (pose.translation.to_array(), pose.rotation.to_array())).collect()
    }

    fn contacts(&self) -> [usize; 2] {
        [self.report.manifolds, self.report.contacts]
    }
}

/// A scene in rapier.
pub(crate) struct Rapier {
    world: PhysicsWorld,
    handles: Vec<RigidBodyHandle>,
}

impl Rapier {
    pub(crate) fn new(scene: &Scene) -> Self {
        let mut world = PhysicsWorld { gravity: GRAVITY.into(), ..PhysicsWorld::default() };
        world.integration_parameters.dt = DT;
        let handles = scene.bodies.iter().map(|body| {
            let [x, y, z, w] = body.rotation;
            let rotation = Rotation::from_xyzw(x, y, z, w).normalize();
            let builder =
                if body.fixed { RigidBodyBuilder::fixed() } else { RigidBodyBuilder::dynamic() };
            let builder = builder
                .pose(Pose::from_parts(body.position.into(), rotation))
                .linvel(V::from(body.velocity))
                .can_sleep(false);
            let collider = ColliderBuilder::new(body.form.shape())
                .density(body.density)
                .friction(scene.friction)
                .restitution(0.0);
            world.insert(builder, collider).0
        });
        let handles = handles.collect();
        Self { world, handles }
    }
}

impl Engine for Rapier {
    fn step(&mut self) {
        self.world.step();
    }

    fn placements(&self) -> Vec<Placement> {
        let poses = self.handles.iter().map(|&handle| self.world.bodies[handle].position());
        poses.map(|pose| (pose.translation.to_array(), pose.rotation.to_array())).collect()
    }

    fn contacts(&self) -> [usize; 2] {
        let points = self
            .world
            .narrow_phase
            .contact_pairs()
            .flat_map(|pair| pair.solver_manifolds())
            .map(|manifold| manifold.data.solver_contacts.len())
            .filter(|&points| points > 0);
        points.fold([0, 0], |[manifolds, sum], points| [manifolds + 1, sum + points])
    }
}
