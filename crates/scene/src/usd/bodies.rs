//! Reads the bodies and colliders of a stage.

use std::collections::{BTreeMap, BTreeSet};

use super::super::description::{
    Body, Filter, Mass, Material, Motion, Rotation, Shape, ShapeKind, Track,
};
use super::super::error::{SceneError, Warning};
use super::super::graph::math::{self, Mat3, Quat};
use super::super::graph::{seen_from, unique};
use super::mass::{self, ColliderMass};
use super::motion::{self, BodyMotion, Transforms};
use super::prims::Prim;
use super::stage::Stage;
use super::transform::Pose;
use super::{filters, shapes, surfaces};

/// Returns the bodies of a stage by their prims, in the order of these.
pub(super) fn all(
    stage: &Stage<'_>,
    transforms: &Transforms,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<(usize, Body)>, SceneError> {
    let is_body = |prim: &Prim| prim.schemas.contains("PhysicsRigidBodyAPI");
    let mut colliders = Vec::new();
    // Colliders by the prim that carries them: the nearest body above, else the collider itself.
    let mut carried: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (index, prim) in stage.prims.iter().enumerate() {
        if is_body(prim) {
            carried.entry(index).or_default();
        }
        let collides = prim.schemas.contains("PhysicsCollisionAPI");
        if collides && stage.flag(prim, "physics:collisionEnabled")? != Some(false) {
            let body = stage.up(index).find(|(_, above)| is_body(above));
            carried.entry(body.map_or(index, |(body, _)| body)).or_default().push(index);
            colliders.push(index);
        }
    }
    let filters = filters::of(stage, &colliders, warnings)?;
    let filters = colliders.into_iter().zip(filters).collect();
    let builder = UsdBodies { stage, transforms, filters };
    let mut names = BTreeSet::new();
    let mut bodies = Vec::new();
    for (prim, colliders) in &carried {
        let body = builder.body(*prim, colliders, &mut names, warnings)?;
        bodies.extend(body.map(|body| (*prim, body)));
    }
    Ok(bodies)
}

struct UsdBodies<'s> {
    stage: &'s Stage<'s>,
    transforms: &'s Transforms,
    filters: BTreeMap<usize, Filter>,
}

impl UsdBodies<'_> {
    fn body(
        &self,
        index: usize,
        colliders: &[usize],
        names: &mut BTreeSet<String>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<Body>, SceneError> {
        let stage = self.stage;
        let Some(prim) = stage.prim(index) else { return Ok(None) };
        let is_body = prim.schemas.contains("PhysicsRigidBodyAPI");
        let parent = self.transforms.parent(stage, index);
        let above = parent.map_or(Pose::REST, |parent| self.transforms.of(parent));
        let moving = if is_body {
            let carries =
                |(i, p): (usize, &Prim)| i != index && p.schemas.contains("PhysicsRigidBodyAPI");
            if parent.is_some() && stage.up(index).any(carries) {
                let what = "a body below another moves on its own: the one above does not carry it";
                stage.warn(prim, what, warnings);
            }
            motion::of(stage, prim, above)?
        } else {
            BodyMotion::AT_REST
        };
        let driven = self.transforms.driven(stage, index);
        let motion = match moving.motion {
            Motion::Static if driven => Motion::Kinematic,
            motion => motion,
        };
        let follows = motion == Motion::Kinematic && (driven || self.transforms.held(index));
        if driven && !follows {
            let what = "its animation is not played: contacts move it; physics:kinematicEnabled \
                        lets the animation do so";
            stage.warn(prim, what, warnings);
        }
        let pose = self.transforms.of(index);
        let rest = self.transforms.scale(stage, index);
        let (mut shapes, mut densities) = (Vec::new(), Vec::new());
        for collider in colliders {
            if let Some((shape, density)) =
                self.shape((index, rest), *collider, motion, warnings)?
            {
                shapes.push(shape);
                densities.push((*collider, density));
            }
        }
        if shapes.is_empty() && (motion == Motion::Dynamic || !is_body) {
            if is_body {
                stage.warn(prim, "it has no collider that acts: it is not simulated", warnings);
            }
            return Ok(None);
        }
        let parts: Vec<_> = shapes
            .iter()
            .zip(&densities)
            .map(|(shape, (prim, density))| ColliderMass { prim: *prim, shape, density: *density })
            .collect();
        let mass = if is_body {
            mass::of(stage, index, &parts, motion, rest, warnings)?
        } else {
            Mass::default()
        };
        let track =
            if follows { self.transforms.track(stage, index, prim)? } else { Track::default() };
        let units = stage.units;
        let motion = if follows && moving.released { Motion::Dynamic } else { motion };
        let (linear, angular) = match motion {
            _ if follows && !moving.released => ([0.0; 3], [0.0; 3]),
            _ => (moving.linear, moving.angular),
        };
        let name = prim.label.as_deref().unwrap_or(&prim.name);
        Ok(Some(Body {
            name: (!name.is_empty()).then(|| unique(name, &prim.path, names)),
            motion,
            position: units.length(pose.map.shift).into(),
            rotation: Rotation::Quaternion(units.turn(pose.turn)),
            linear_velocity: linear.into(),
            angular_velocity: angular.into(),
            mass,
            gravity_factor: moving.gravity,
            linear_damping: moving.damping[0],
            angular_damping: moving.damping[1],
            force: moving.force.into(),
            start_asleep: moving.start_asleep,
            surface_velocity: motion::surface(stage, prim, warnings)?,
            shapes,
            track,
        }))
    }

    /// Returns the shape of a collider in the frame of its body, and the density of its material.
    fn shape(
        &self,
        (body, rest): (usize, Mat3),
        index: usize,
        motion: Motion,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<(Shape, Option<f64>)>, SceneError> {
        let stage = self.stage;
        let Some(prim) = stage.prim(index) else { return Ok(None) };
        if index != body
            && self.transforms.driven(stage, index)
            && !self.transforms.driven(stage, body)
        {
            let what = "its animation inside of a body is not simulated: its collider keeps its \
                        place on the body";
            stage.warn(prim, what, warnings);
        }
        let map = self.transforms.scale(stage, index);
        let Some((kind, axis)) = shapes::read(stage, prim, map, motion, warnings)? else {
            return Ok(None);
        };
        let (place, turn) = self.transforms.seen_from(stage, (index, Pose::REST), body);
        let place = if rest == math::IDENTITY { place } else { math::apply(rest, place) };
        let own = turn;
        let turn = match (turn, axis) {
            (turn, math::NO_TURN) => turn,
            (math::NO_TURN, axis) => axis,
            (turn, axis) => math::quat_mul(turn, axis),
        };
        let surface = surfaces::of(stage, index, warnings)?;
        let density = surface.as_ref().and_then(|surface| surface.density);
        let runs = if index == body { None } else { motion::surface(stage, prim, warnings)? };
        let (kind, turn) = self.tilted(prim, kind, turn)?;
        let runs = runs.map(|runs| seen_from(runs, own, turn));
        let shape = Shape {
            kind,
            position: place.into(),
            rotation: Rotation::Quaternion(turn),
            material: surface.map_or_else(Material::default, |surface| surface.material),
            surface_velocity: runs,
            filter: self.filters.get(&index).copied().unwrap_or_default(),
        };
        Ok(Some((shape, density)))
    }

    /// Restores the exact normal and rotation of a half-space exported from the own format, unless
    /// somebody turned it since.
    fn tilted(
        &self,
        prim: &Prim,
        kind: ShapeKind,
        turn: Quat,
    ) -> Result<(ShapeKind, Quat), SceneError> {
        let stage = self.stage;
        let normal = stage.vector::<3>(prim, "drystone:normal", 2.0)?;
        let own = stage.vector::<4>(prim, "drystone:orient", 2.0)?;
        if let (ShapeKind::Halfspace { .. }, Some(normal), Some([w, x, y, z])) =
            (&kind, normal, own)
        {
            let stated = math::quat_mul([x, y, z, w], math::from_up(normal));
            // Within the rounding of single precision.
            if stated.iter().zip(turn).all(|(a, b)| (a - b).abs() <= 1e-6) {
                return Ok((ShapeKind::Halfspace { normal: normal.into() }, [x, y, z, w]));
            }
        }
        Ok((kind, turn))
    }
}
