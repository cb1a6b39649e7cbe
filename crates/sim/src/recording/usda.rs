//! Writes a scene and its recording as OpenUSD text, for Houdini, Maya, Omniverse, Blender and
//! others.

mod materials;
mod prim;
mod scene;
mod shape;

use std::collections::HashSet;
use std::io;
use std::path::Path;

use rayon::prelude::*;

use super::pose::{dot, lerp, normalized, pose_at, slerp};
use super::sampling::{Track, sample_rate, sample_times, tracks};
use super::{Recording, Sampling, write_whole};
use crate::scene::{Body, Mass, Motion, Scene, SurfaceVelocity};
use materials::Materials;
use prim::{Prim, quoted, tuple};
pub use scene::Stage;

/// Writes a scene as a stage with the schemas of UsdPhysics: an `Xform` per body, moved by time
/// samples, with its shapes below it. Time code 0 is the initial state.
///
/// Units are meters and kilograms, with +y up. 2D scenes lie in the plane z = 0, 0.5 m thick. A
/// name that is no valid prim name becomes the display name.
///
/// # Errors
/// If the recording has other bodies or is not finite, or the file cannot be written. An existing
/// file then stays unchanged.
pub fn write(
    path: &Path,
    scene: &Scene,
    recording: &Recording,
    options: &Sampling,
) -> io::Result<()> {
    recording.must_have(scene.bodies.len(), scene.dimension)?;
    let times = sample_times(recording, options);
    let rate = rounded(sample_rate(recording, options));
    let codes: Vec<f64> = times.iter().map(|time| rounded(time * rate)).collect();
    let names = identifiers(scene);
    let materials = Materials::of(scene);
    let bodies: Vec<Prim> = (scene.bodies.par_iter().zip(&names).enumerate())
        .map(|(index, (body, name))| {
            let pose = |time| pose_at(recording, index, time);
            let mut prim = body_prim(scene, index, body, name, &materials);
            if !times.is_empty() {
                let (positions, rotations) = tracks(&times, pose, mixed, options, index)?;
                move_prim(&mut prim, &codes, &positions, &rotations);
            }
            Ok(prim)
        })
        .collect::<io::Result<_>>()?;
    let mut world = Prim::new("Xform", "World");
    world.metadata.push("kind = \"component\"".to_owned());
    world.children.push(physics(scene));
    world.children.extend(materials.prim());
    world.children.extend(bodies);
    let ends = [codes.first(), codes.last()].map(|code| code.copied().unwrap_or(0.0));
    write_stage(path, &world, ends, rate, rate)
}

/// Writes a stage with the prim `world`, from time code `start` to `end`, with `frames` frames and
/// `codes` time codes per second.
fn write_stage(
    path: &Path,
    world: &Prim,
    [start, end]: [f64; 2],
    frames: f64,
    codes: f64,
) -> io::Result<()> {
    write_whole(path, |out| {
        writeln!(out, "#usda 1.0\n(")?;
        let creator = concat!("Drystone ", env!("CARGO_PKG_VERSION"));
        writeln!(out, "    customLayerData = {{\n        string creator = \"{creator}\"\n    }}")?;
        writeln!(out, "    defaultPrim = \"World\"\n    endTimeCode = {end}")?;
        writeln!(out, "    framesPerSecond = {frames}\n    kilogramsPerUnit = 1")?;
        writeln!(out, "    metersPerUnit = 1\n    startTimeCode = {start}")?;
        writeln!(out, "    timeCodesPerSecond = {codes}\n    upAxis = \"Y\"\n)\n")?;
        world.write(out, 0)
    })
}

/// Rounds to nine decimals, which removes the errors of divisions, so that frames have whole time
/// codes.
fn rounded(x: f64) -> f64 {
    (x * 1e9).round() / 1e9
}

/// Returns a prim name for each body, unique among its siblings: ASCII letters, digits and
/// underscores, without a leading digit.
fn identifiers(scene: &Scene) -> Vec<String> {
    let mut taken = HashSet::from([PHYSICS, materials::SCOPE, scene::GROUPS].map(str::to_owned));
    let one = |(index, body): (usize, &Body)| {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let mut name: String = body.name.as_deref().unwrap_or("body").chars().map(plain).collect();
        if !name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            name.insert(0, '_');
        }
        if body.name.is_none() || taken.contains(&name) {
            name = format!("{name}_{index}");
        }
        while !taken.insert(name.clone()) {
            name.push('_');
        }
        name
    };
    scene.bodies.iter().enumerate().map(one).collect()
}

const PHYSICS: &str = "PhysicsScene";

fn physics(scene: &Scene) -> Prim {
    let mut prim = Prim::new("PhysicsScene", PHYSICS);
    let strength = scene.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
    let direction = space(&scene.gravity).map(|g| if strength > 0.0 { g / strength } else { 0.0 });
    prim.set("vector3f physics:gravityDirection", tuple(&direction));
    prim.set("float physics:gravityMagnitude", strength);
    prim
}

/// Returns a vector in 3D: missing components are 0.
fn space(vector: &[f64]) -> [f64; 3] {
    std::array::from_fn(|i| vector.get(i).copied().unwrap_or(0.0))
}

/// Returns the prim of a body with its shapes, at its position in the scene.
fn body_prim(
    scene: &Scene,
    index: usize,
    body: &Body,
    name: &str,
    materials: &Materials<'_>,
) -> Prim {
    let mut prim = Prim::new("Xform", name);
    if let Some(own) = body.name.as_ref().filter(|own| *own != name) {
        prim.metadata.push(format!("displayName = {}", quoted(own)));
    }
    if body.motion != Motion::Static {
        prim.schemas.extend(["PhysicsRigidBodyAPI", "PhysicsMassAPI"]);
        mass(&mut prim, scene.dimension, &body.mass);
        velocity(&mut prim, body);
        if body.motion == Motion::Kinematic {
            prim.set("bool physics:kinematicEnabled", 1);
        }
    }
    if body.linear_damping != 0.0 || body.angular_damping != 0.0 {
        prim.schemas.push("PhysxRigidBodyAPI");
        prim.set("float physxRigidBody:angularDamping", body.angular_damping);
        prim.set("float physxRigidBody:linearDamping", body.linear_damping);
    }
    if let Some(motion) = &body.surface_velocity {
        run(&mut prim, motion);
    }
    prim.place(space(&body.position), shape::quaternion(body.rotation), [1.0; 3]);
    let dimension = scene.dimension;
    let shapes = body.shapes.iter().enumerate().map(|(number, of)| {
        let mut prim = shape::prim(of, dimension, number, index, body.motion);
        materials.bind(&mut prim, &of.material);
        if let Some(motion) = &of.surface_velocity {
            run(&mut prim, &shape::seen_from_prim(motion, of));
        }
        prim
    });
    prim.children = shapes.collect();
    prim
}

/// Sets the mass properties that do not follow from the shapes.
fn mass(prim: &mut Prim, dimension: usize, mass: &Mass) {
    match mass.mass {
        Some(mass) if mass.is_finite() => prim.set("float physics:mass", mass),
        Some(_) => {}
        None if dimension == 2 => {
            let density = mass.density.unwrap_or(1000.0) / shape::THICKNESS;
            prim.set("float physics:density", density);
        }
        // Without a density, OpenUSD uses the same default.
        None => mass.density.into_iter().for_each(|x| prim.set("float physics:density", x)),
    }
    if let Some(center) = &mass.center {
        prim.set("point3f physics:centerOfMass", tuple(&space(center)));
    }
    if let Some([x, y, z]) = mass.inertia.as_deref()
        && [x, y, z].iter().all(|moment| moment.is_finite())
    {
        prim.set("float3 physics:diagonalInertia", tuple(&[x, y, z]));
        if let Some([a, b, c, w]) = mass.inertia_rotation {
            prim.set("quatf physics:principalAxes", tuple(&[w, a, b, c]));
        }
    }
}

fn velocity(prim: &mut Prim, body: &Body) {
    let angular = turning(&body.angular_velocity);
    prim.set("vector3f physics:angularVelocity", tuple(&angular.map(degrees)));
    prim.set("vector3f physics:velocity", tuple(&space(&body.linear_velocity)));
}

/// Returns an angular velocity in 3D.
fn turning(angular: &[f64]) -> [f64; 3] {
    match angular {
        [about_z] => [0.0, 0.0, *about_z],
        vector => space(vector),
    }
}

/// Sets the surface velocity of a prim, in PhysX's schema.
fn run(prim: &mut Prim, motion: &SurfaceVelocity) {
    prim.schemas.push("PhysxSurfaceVelocityAPI");
    let angular = turning(&motion.angular).map(degrees);
    prim.set("vector3f physxSurfaceVelocity:surfaceAngularVelocity", tuple(&angular));
    prim.set("vector3f physxSurfaceVelocity:surfaceVelocity", tuple(&space(&motion.linear)));
    prim.set("bool physxSurfaceVelocity:surfaceVelocityEnabled", 1);
    let local = i32::from(motion.local);
    prim.set("bool physxSurfaceVelocity:surfaceVelocityLocalSpace", local);
}

/// Converts an angle to degrees such that converting it back gives the same radians in single
/// precision.
fn degrees(angle: f64) -> f64 {
    let near = angle.to_degrees();
    let same = |degrees: &f64| degrees.to_radians() as f32 == angle as f32;
    [near, near.next_up(), near.next_down()].into_iter().find(same).unwrap_or(near)
}

/// Sets the pose of a prim from its recording: time samples, or a single value if it is constant.
fn move_prim(prim: &mut Prim, codes: &[f64], positions: &Track<3>, rotations: &Track<4>) {
    // OpenUSD computes the angle from w alone. In single precision, w is 1 up to a milliradian.
    let turned = |q: [f32; 4]| {
        let [x, y, z, w] = normalized(q.map(f64::from)).map(|x| (x * 1e12).round() / 1e12);
        tuple(&[w, x, y, z])
    };
    prim.follow("double3 xformOp:translate", codes, positions, |x| tuple(&x));
    prim.follow("quatd xformOp:orient", codes, rotations, turned);
}

/// Interpolates rotations as OpenUSD does: near ones along a straight line without normalization,
/// with the angle computed from w alone. Near the identity, w differs from 1 only to second order.
/// The error there is up to half the angle between the two rotations (`GfSlerp`,
/// `GfRotation::SetQuat`).
fn mixed(a: [f64; 4], b: [f64; 4], part: f64) -> [f64; 4] {
    const NEAR: f64 = 1e-5;
    let (a, b) = (normalized(a), normalized(b));
    if 1.0 - dot(a, b) > NEAR {
        return slerp(a, b, part);
    }
    let [x, y, z, w] = lerp(a, b, part);
    let sine = (1.0 - w * w).max(0.0).sqrt();
    let length = dot([x, y, z], [x, y, z]).sqrt();
    let long = if length > 0.0 { sine / length } else { 0.0 };
    [x * long, y * long, z * long, w]
}

#[cfg(test)]
mod tests;
