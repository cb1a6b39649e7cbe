//! Motion of bodies: attributes of UsdPhysics, and animated transforms.

use super::super::description::{Motion, SurfaceVelocity, Track};
use super::super::error::{SceneError, Warning};
use super::super::graph::track;
use super::super::graph::{FAR, FAST};
use super::prims::Prim;
use super::stage::Stage;
use super::transform::{Pose, Transform};
use super::xform;
use crate::graph::math::{self, Mat3, Quat, Vec3};

/// Largest magnitude of the factor on gravity.
const MOST_GRAVITY: f64 = 1e6;
/// Largest coordinate of a force. \[N\]
const MOST_FORCE: f64 = 1e20;
/// Largest difference of an exact value from that of the stage, relative to it. \[1\]
const SLACK: f64 = 1e-6;
/// Largest damping rate. \[1/s\]
const STRONGEST: f64 = 1e6;

/// Transforms of all prims.
pub(super) struct Transforms {
    own: Vec<Transform>,
    /// Transforms to the stage, at the default time.
    pub(super) world: Vec<Pose>,
}

impl Transforms {
    pub(super) fn read(stage: &Stage<'_>) -> Result<Self, SceneError> {
        let mut transforms = Self { own: Vec::new(), world: Vec::new() };
        for prim in &stage.prims {
            let own = xform::read(stage, prim)?;
            let above = prim.parent.filter(|_| !own.reset);
            let above = above.and_then(|above| transforms.world.get(above)).copied();
            let world = above.unwrap_or(Pose::REST).after(&own.at(None));
            let numbers = world.map.linear.iter().flatten().chain(&world.map.shift);
            if !numbers.copied().all(|x| x.abs() <= FAR) {
                let accepted = format!("accepted: coordinates and scales up to {FAR:e}");
                return Err(stage.wrong(
                    prim,
                    "the transform in the stage",
                    String::new(),
                    &accepted,
                ));
            }
            transforms.world.push(world);
            transforms.own.push(own);
        }
        Ok(transforms)
    }

    /// Returns the transform of a prim relative to its parent.
    pub(super) fn own(&self, prim: usize) -> Option<&Transform> {
        self.own.get(prim)
    }

    pub(super) fn of(&self, prim: usize) -> Pose {
        self.world.get(prim).copied().unwrap_or(Pose::REST)
    }

    /// Returns the parent of a prim if the prim's transform is relative to it.
    pub(super) fn parent(&self, stage: &Stage<'_>, prim: usize) -> Option<usize> {
        let reset = self.own.get(prim).is_some_and(|own| own.reset);
        stage.prim(prim).and_then(|prim| prim.parent).filter(|_| !reset)
    }

    /// Returns a prim and the ancestors that its transform depends on, upwards.
    pub(super) fn chain(&self, stage: &Stage<'_>, prim: usize) -> Vec<usize> {
        std::iter::successors(Some(prim), |at| self.parent(stage, *at)).collect()
    }

    /// Returns the pose of a prim relative to its ancestor `top`. `None` if its transform does not
    /// depend on `top`.
    fn within(&self, stage: &Stage<'_>, prim: usize, top: usize) -> Option<Pose> {
        let mut pose = Pose::REST;
        for at in self.chain(stage, prim) {
            if at == top {
                return Some(pose);
            }
            pose = self.own.get(at).map_or(pose, |own| own.at(None).after(&pose));
        }
        None
    }

    /// Returns position and rotation, relative to the prim `top`, of the pose `inner` of a prim.
    pub(super) fn seen_from(
        &self,
        stage: &Stage<'_>,
        (prim, inner): (usize, Pose),
        top: usize,
    ) -> (Vec3, Quat) {
        if let Some(pose) = self.within(stage, prim, top) {
            let pose = pose.after(&inner);
            return (pose.map.shift, pose.turn);
        }
        let (top, own) = (self.of(top), self.of(prim).after(&inner));
        let away = math::sub(own.map.shift, top.map.shift);
        let place =
            math::inverse(top.map.linear).map_or(away, |inverse| math::apply(inverse, away));
        let turn = math::quat_mul(math::conjugate(top.turn), own.turn);
        (place, math::quat_unit(turn).unwrap_or(math::NO_TURN))
    }

    /// Returns the linear map from a prim's space to meters, without its rotation.
    pub(super) fn scale(&self, stage: &Stage<'_>, prim: usize) -> Mat3 {
        let scale = self.of(prim).scale;
        let meters = stage.units.meters;
        if meters == 1.0 { scale } else { scale.map(|column| math::scale(column, meters)) }
    }

    /// Returns true if an animation of the prim or of an ancestor moves it.
    pub(super) fn driven(&self, stage: &Stage<'_>, prim: usize) -> bool {
        let moves = |at: &usize| self.own.get(*at).is_some_and(Transform::moves);
        self.chain(stage, prim).iter().any(moves)
    }

    /// Returns true if the prim has time samples of its own, even if they never move it.
    pub(super) fn held(&self, prim: usize) -> bool {
        self.own.get(prim).is_some_and(Transform::has_keys)
    }

    /// Returns the poses over time of a prim in the scene, as it and its ancestors move.
    pub(super) fn track(
        &self,
        stage: &Stage<'_>,
        index: usize,
        prim: &Prim,
    ) -> Result<Track, SceneError> {
        let chain = self.chain(stage, index);
        let movers: Vec<_> = chain.iter().filter_map(|at| self.own.get(*at)).collect();
        let units = stage.units;
        let keys: Vec<f64> =
            movers.iter().flat_map(|own| own.codes()).map(|code| units.seconds(code)).collect();
        let moving = movers.iter().filter(|own| own.moves()).count();
        let first = movers.first().is_some_and(|own| own.moves());
        let exact = moving <= 1 && first && movers.iter().all(|own| own.straight());
        let times = track::times(keys, exact).map_err(|(length, accepted)| {
            let value = format!("{length} s long");
            stage.wrong(prim, "the animation", value, &format!("accepted: {accepted}"))
        })?;
        let track = track::of(times, |time| {
            let code = units.start + time * units.rate;
            let world = movers.iter().fold(Pose::REST, |pose, own| own.at(Some(code)).after(&pose));
            (units.length(world.map.shift), units.turn(world.turn))
        });
        match track.positions.iter().flatten().find(|x| !(-FAR..=FAR).contains(*x)) {
            None => Ok(track),
            Some(far) => {
                let accepted = format!("accepted: coordinates up to {FAR:e} m");
                Err(stage.wrong(prim, "an animated position", far.to_string(), &accepted))
            }
        }
    }
}

/// Motion of a body.
pub(super) struct BodyMotion {
    pub(super) motion: Motion,
    pub(super) linear: Vec3,
    pub(super) angular: Vec3,
    pub(super) gravity: f64,
    /// Linear and angular damping rates. \[1/s\]
    pub(super) damping: [f64; 2],
    /// Constant force. \[N\]
    pub(super) force: Vec3,
    pub(super) start_asleep: bool,
    /// True if a body that follows its animation is released at its end.
    pub(super) released: bool,
}

impl BodyMotion {
    pub(super) const AT_REST: Self = Self {
        motion: Motion::Static,
        linear: [0.0; 3],
        angular: [0.0; 3],
        gravity: 1.0,
        damping: [0.0; 2],
        force: [0.0; 3],
        start_asleep: false,
        released: false,
    };
}

/// Reads the motion of a body from UsdPhysics. `above` is the pose of its parent.
pub(super) fn of(stage: &Stage<'_>, prim: &Prim, above: Pose) -> Result<BodyMotion, SceneError> {
    const ANGULAR: &str = "physics:angularVelocity";
    let flag = |name: &str| stage.flag(prim, name);
    let motion = if flag("physics:rigidBodyEnabled")? == Some(false) {
        Motion::Static
    } else if flag("physics:kinematicEnabled")? == Some(true) {
        Motion::Kinematic
    } else {
        Motion::Dynamic
    };
    // Velocities are given in the space of the prim's parent.
    let linear = stage.vector::<3>(prim, "physics:velocity", FAST)?.unwrap_or_default();
    let degrees = stage.vector::<3>(prim, ANGULAR, FAST)?.unwrap_or_default();
    let straight = above == Pose::REST;
    let linear = if straight { linear } else { math::apply(above.map.linear, linear) };
    let exact = stage.vector::<3>(prim, "drystone:angularVelocity", FAST)?;
    let angular = exact_or(exact, degrees.map(f64::to_radians));
    let angular = if straight { angular } else { math::turn(above.turn, angular) };
    let gravity = stage.number(prim, "drystone:gravityFactor", -MOST_GRAVITY, MOST_GRAVITY)?;
    Ok(BodyMotion {
        motion,
        linear: stage.units.length(linear),
        angular: stage.units.direction(angular),
        gravity: if flag("physxRigidBody:disableGravity")? == Some(true) {
            0.0
        } else {
            gravity.unwrap_or(1.0)
        },
        damping: damping(stage, prim)?,
        force: stage
            .units
            .direction(stage.vector::<3>(prim, "drystone:force", MOST_FORCE)?.unwrap_or_default()),
        start_asleep: motion == Motion::Dynamic && flag("physics:startsAsleep")? == Some(true),
        released: flag("drystone:released")? == Some(true),
    })
}

/// Returns the exact vector where it agrees with the stated one: nobody has changed the latter.
fn exact_or(exact: Option<Vec3>, stated: Vec3) -> Vec3 {
    let same = |exact: &Vec3| {
        exact.iter().zip(stated).all(|(a, b)| *a == b || (a - b).abs() <= SLACK * b.abs())
    };
    exact.filter(same).unwrap_or(stated)
}

/// Reads linear and angular damping in PhysX's schema. Where it is applied without values, they are
/// 0 and 0.05. \[1/s\]
fn damping(stage: &Stage<'_>, prim: &Prim) -> Result<[f64; 2], SceneError> {
    let number = |name: &str| stage.number(prim, name, 0.0, STRONGEST);
    let applied = prim.schemas.contains("PhysxRigidBodyAPI");
    let usual = if applied { 0.05 } else { 0.0 };
    Ok([
        number("physxRigidBody:linearDamping")?.unwrap_or(0.0),
        number("physxRigidBody:angularDamping")?.unwrap_or(usual),
    ])
}

/// Reads the surface velocity of a prim in PhysX's schema, in the frame of the prim.
pub(super) fn surface(
    stage: &Stage<'_>,
    prim: &Prim,
    warnings: &mut Vec<Warning>,
) -> Result<Option<SurfaceVelocity>, SceneError> {
    const LINEAR: &str = "physxSurfaceVelocity:surfaceVelocity";
    const ANGULAR: &str = "physxSurfaceVelocity:surfaceAngularVelocity";
    let flag = |name: &str| stage.flag(prim, name);
    let linear = stage.vector::<3>(prim, LINEAR, FAST)?;
    let degrees = stage.vector::<3>(prim, ANGULAR, FAST)?;
    if !prim.schemas.contains("PhysxSurfaceVelocityAPI") {
        if linear.is_some() || degrees.is_some() {
            let what = "its surface velocity does not act without PhysxSurfaceVelocityAPI";
            stage.warn(prim, what, warnings);
        }
        return Ok(None);
    }
    let sampled = |name: &&&str| {
        let samples = prim.properties.get(**name).and_then(|of| of.samples.as_ref());
        samples.is_some_and(|samples| samples.len() > 1)
    };
    if let Some(name) = [LINEAR, ANGULAR].iter().find(sampled) {
        stage.warn(prim, format!("{name} changes with time: its first value acts"), warnings);
    }
    if flag("physxSurfaceVelocity:surfaceVelocityEnabled")? == Some(false) {
        return Ok(None);
    }
    let local = flag("physxSurfaceVelocity:surfaceVelocityLocalSpace")? != Some(false);
    let (units, meters) = (stage.units, stage.units.meters);
    let (linear, degrees) = (linear.unwrap_or_default(), degrees.unwrap_or_default());
    let exact = stage.vector::<3>(prim, "drystone:surfaceAngularVelocity", FAST)?;
    let angular = exact_or(exact, degrees.map(f64::to_radians));
    let (linear, angular) = if local {
        (if meters == 1.0 { linear } else { math::scale(linear, meters) }, angular)
    } else {
        (units.length(linear), units.direction(angular))
    };
    Ok(Some(SurfaceVelocity { linear: linear.into(), angular: angular.into(), local }))
}
