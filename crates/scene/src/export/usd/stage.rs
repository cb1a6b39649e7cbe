//! Writes a scene of Drystone's own format as a stage. Reading it gives the same bodies and
//! joints.
//!
//! Data that UsdPhysics cannot express goes into attributes of the namespace `drystone:`, which
//! other programs ignore:
//!
//! - times and settings of the scene;
//! - rules by which surfaces combine, and resistance to rolling and spinning;
//! - infinite masses and moments, and gravity factors;
//! - collision systems;
//! - normals of half-spaces that do not point along +y;
//! - accuracy and number of pieces of a convex decomposition;
//! - coordinates, friction, softness and further drives of joints.
//!
//! Damping and surface velocities use PhysX's schemas.

use std::io;
use std::path::Path;

use super::super::mesh::hull_triangles;
use super::prim::{PrimWriter, list, quoted, space, tuple};
use super::shape::deform;
use super::{Prims, StageHead, write_stage};
use crate::description::{Body, Filter, Motion, Rotation, Scene, Shape, ShapeKind, Track};
use crate::engine::Engine;
use crate::write::own_words;

/// Parent of the collision groups, below the root prim.
pub(super) const GROUPS: &str = "Groups";

/// A scene as a stage.
pub struct StageWriter {
    world: PrimWriter,
    /// Last time of all tracks. \[s\]
    end: f64,
    frames_per_second: f64,
}

impl StageWriter {
    /// Converts a scene.
    ///
    /// # Errors
    /// If the scene contains something that a stage cannot express. The message says what to do
    /// about it.
    pub fn new(scene: &Scene, engine: &dyn Engine) -> Result<Self, String> {
        if scene.dimension != 3 {
            return Err("is a scene in 2D; a stage is in 3D".to_owned());
        }
        let prims = Prims::new(scene, engine);
        let mut world = prims.world();
        if let Some(physics) = world.children.first_mut() {
            physics.set("custom string drystone:scene", quoted(&own_words(&alone(scene))));
            if let Some(name) = &scene.name {
                physics.metadata.push(format!("displayName = {}", quoted(name)));
            }
        }
        world.children.extend(groups(scene, &prims.names));
        let mut end = 0.0_f64;
        for (index, body) in scene.bodies.iter().enumerate() {
            let mut prim = prims.body(index);
            own(&mut prim, body, engine)
                .map_err(|why| format!("{} {why}", scene.name_of(index)))?;
            let tracks = body.shapes.iter().filter_map(|shape| shape.kind.vertex_track());
            let ends = tracks.map(|track| &track.times).chain([&body.track.times]);
            end = ends.filter_map(|times| times.last().copied()).fold(end, f64::max);
            world.children.push(prim);
        }
        world.children.extend(prims.joints()?);
        let frames_per_second = super::rounded(1.0 / scene.time_step);
        Ok(Self { world, end, frames_per_second })
    }

    /// Writes the stage as `.usda`. A time code is a second.
    ///
    /// # Errors
    /// Those of [`write_whole`](crate::write_whole).
    pub fn write(&self, path: &Path) -> io::Result<()> {
        let (ends, frames) = ([0.0, self.end], self.frames_per_second);
        let head = StageHead { ends, frames, ..StageHead::default() };
        write_stage(path, &head, std::slice::from_ref(&self.world))
    }
}

/// Returns a scene without its bodies and joints, which have prims of their own.
fn alone(scene: &Scene) -> Scene {
    Scene {
        name: None,
        dimension: scene.dimension,
        gravity: scene.gravity.clone(),
        time_step: scene.time_step,
        track: scene.track.clone(),
        steps: scene.steps,
        bodies_as: scene.bodies_as,
        bodies: Vec::new(),
        joints: Vec::new(),
        solver: scene.solver.clone(),
    }
}

/// Adds data to the prim of a body that a plain export omits. The error says why the body cannot be
/// written.
fn own(prim: &mut PrimWriter, body: &Body, engine: &dyn Engine) -> Result<(), String> {
    if body.name.is_none() {
        prim.metadata.push("displayName = \"\"".to_owned());
    }
    if body.motion == Motion::Static {
        // A disabled rigid body keeps its shapes together as one body.
        prim.schemas.extend(["PhysicsRigidBodyAPI", "PhysicsMassAPI"]);
        prim.set("bool physics:rigidBodyEnabled", 0);
        super::mass(prim, 3, &body.mass);
        super::velocity(prim, body);
    }
    if body.gravity_factor != 1.0 {
        prim.set("custom double drystone:gravityFactor", body.gravity_factor);
    }
    if body.mass.mass.is_some_and(f64::is_infinite) {
        prim.set("custom double drystone:mass", f64::INFINITY);
    }
    if let Some([x, y, z]) = body.mass.inertia.as_deref()
        && [x, y, z].iter().any(|moment| moment.is_infinite())
    {
        prim.set("custom double3 drystone:diagonalInertia", tuple(&[x, y, z]));
        if let Some([a, b, c, w]) = body.mass.inertia_rotation {
            prim.set("custom quatd drystone:principalAxes", tuple(&[w, a, b, c]));
        }
    }
    follow(prim, &body.track);
    for (prim, shape) in prim.children.iter_mut().zip(&body.shapes) {
        exact(prim, shape, body.motion, engine)?;
    }
    Ok(())
}

/// Writes the keys of a track as time samples.
fn follow(prim: &mut PrimWriter, track: &Track) {
    if track.times.is_empty() {
        return;
    }
    let samples = |values: &mut dyn Iterator<Item = String>| {
        let all: Vec<_> =
            track.times.iter().zip(values).map(|(t, v)| format!("{t}: {v}")).collect();
        format!("{{ {} }}", all.join(", "))
    };
    let places = samples(&mut track.positions.iter().map(|position| tuple(position)));
    let turns = samples(&mut track.rotations.iter().map(|rotation| {
        let [x, y, z, w] = rotation.quaternion();
        tuple(&[w, x, y, z])
    }));
    prim.set("double3 xformOp:translate.timeSamples", places);
    prim.set("quatd xformOp:orient.timeSamples", turns);
}

/// Sets the exact points of meshes and hulls, in their order, and the exact normal and rotation of
/// half-spaces.
fn exact(
    prim: &mut PrimWriter,
    shape: &Shape,
    motion: Motion,
    engine: &dyn Engine,
) -> Result<(), String> {
    let (points, triangles): (Vec<Vec<f64>>, Vec<u32>) = match &shape.kind {
        ShapeKind::Trimesh { vertices, triangles, .. } => {
            let points = vertices.iter().map(|vertex| vertex.to_vec()).collect();
            (points, triangles.as_flattened().to_vec())
        }
        ShapeKind::ConvexHull { points } => {
            let single: Vec<_> = points.iter().map(|p| space(p).map(|x| x as f32)).collect();
            let triangles =
                hull_triangles(&single, engine).ok_or("has a hull without triangles")?;
            (points.clone(), triangles)
        }
        ShapeKind::Halfspace { normal } => {
            if motion != Motion::Static {
                return Err("moves a half-space, and endless planes of a stage stand still".into());
            }
            let normal = space(normal);
            if normal != [0.0, 1.0, 0.0]
                && let Rotation::Quaternion([x, y, z, w]) = shape.rotation
            {
                prim.set("custom double3 drystone:normal", tuple(&normal));
                prim.set("custom quatd drystone:orient", tuple(&[w, x, y, z]));
            }
            return Ok(());
        }
        _ => return Ok(()),
    };
    prim.set("int[] faceVertexCounts", list(triangles.chunks_exact(3).map(|_| 3)));
    prim.set("int[] faceVertexIndices", list(triangles.iter()));
    prim.set("point3f[] points", list(points.iter().map(|point| tuple(point))));
    if let Some(track) = shape.kind.vertex_track() {
        deform(prim, track.times.iter().copied().zip(track.points.iter().cloned()));
    }
    Ok(())
}

/// Returns a collision group for each filter; `None` if all shapes have the default filter.
fn groups(scene: &Scene, names: &[String]) -> Option<PrimWriter> {
    let mut filters: Vec<(Filter, Vec<String>)> = Vec::new();
    for (body, name) in scene.bodies.iter().zip(names) {
        for (number, shape) in body.shapes.iter().enumerate() {
            let path = format!("</World/{name}/Shape_{number}>");
            match filters.iter_mut().find(|(filter, _)| *filter == shape.filter) {
                Some((_, paths)) => paths.push(path),
                None => filters.push((shape.filter, vec![path])),
            }
        }
    }
    if filters.iter().all(|(filter, _)| *filter == Filter::default()) {
        return None;
    }
    let mut scope = PrimWriter::new("Scope", GROUPS);
    scope.children = filters
        .iter()
        .enumerate()
        .map(|(index, (filter, paths))| {
            let mut prim = PrimWriter::new("PhysicsCollisionGroup", format!("Group_{index}"));
            prim.schemas.push("CollectionAPI:colliders");
            prim.set("rel collection:colliders:includes", list(paths.iter()));
            let apart =
                filters.iter().enumerate().filter(|(_, (other, _))| !filter.collides(other));
            let apart = apart.map(|(other, _)| format!("</World/{GROUPS}/Group_{other}>"));
            prim.set("rel physics:filteredGroups", list(apart));
            let bits = |mask: u64| list((0..64).filter(move |bit: &u32| mask >> bit & 1 == 1));
            prim.set("custom int[] drystone:systems", bits(filter.systems));
            prim.set("custom int[] drystone:notCollidesWith", bits(!filter.collides_with));
            let unnamed = i32::from(filter.collides_with_unnamed);
            prim.set("custom bool drystone:collidesWithUnnamed", unnamed);
            prim
        })
        .collect();
    Some(scope)
}
