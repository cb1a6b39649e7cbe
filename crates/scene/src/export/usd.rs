//! Writes scenes as OpenUSD text, for Houdini, Maya, Omniverse, Blender and others.

mod joint;
mod materials;
mod prim;
mod shape;
mod stage;

use std::collections::HashSet;
use std::io;
use std::path::Path;

use crate::description::{Body, Mass, Motion, Scene, SurfaceVelocity};
use crate::engine::Engine;
use crate::usd::StageUnits;
use crate::whole::write_whole;
use materials::Materials;
use prim::space;
pub use prim::{PrimWriter, list, quoted, tuple};
use shape::Look;
pub use shape::deform;
pub use stage::StageWriter;

const PHYSICS: &str = "PhysicsScene";

/// Prims of a scene with the schemas of UsdPhysics: an `Xform` per body, with its shapes below it.
///
/// Units are meters and kilograms, with +y up. 2D scenes lie in the plane z = 0, 0.5 m thick. A
/// name that is no valid prim name becomes the display name.
pub struct Prims<'a> {
    scene: &'a Scene,
    engine: &'a dyn Engine,
    names: Vec<String>,
    materials: Materials<'a>,
}

impl<'a> Prims<'a> {
    /// Names the prims of a scene.
    pub fn new(scene: &'a Scene, engine: &'a dyn Engine) -> Self {
        Self { scene, engine, names: identifiers(scene), materials: Materials::of(scene) }
    }

    /// Returns the root prim, with gravity and materials.
    pub fn world(&self) -> PrimWriter {
        let mut world = PrimWriter::new("Xform", "World");
        world.metadata.push("kind = \"component\"".to_owned());
        world.children.push(self.physics());
        world.children.extend(self.materials.prim());
        world
    }

    /// Returns the prim with all joints, whose bodies are those of [`body`](Self::body); `None` if
    /// there are no joints.
    ///
    /// # Errors
    /// If a joint has two axes with the same coordinate.
    pub fn joints(&self) -> Result<Option<PrimWriter>, String> {
        let names = names(
            self.scene.joints.iter().map(|joint| joint.name.as_deref()),
            "joint",
            HashSet::new(),
        );
        let paths: Vec<_> = self.names.iter().map(|name| format!("/World/{name}")).collect();
        let mut scope = PrimWriter::new("Scope", joint::SCOPE);
        for (index, (joint, name)) in self.scene.joints.iter().zip(&names).enumerate() {
            let prim = joint::prim(joint, name, &paths).map_err(|why| match &joint.name {
                Some(name) => format!("joint '{name}' {why}"),
                None => format!("joint {index} {why}"),
            })?;
            scope.children.push(prim);
        }
        Ok((!scope.children.is_empty()).then_some(scope))
    }

    fn physics(&self) -> PrimWriter {
        let gravity = &self.scene.gravity;
        let mut prim = PrimWriter::new("PhysicsScene", PHYSICS);
        let strength = gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
        let direction = space(gravity).map(|g| if strength > 0.0 { g / strength } else { 0.0 });
        prim.set("vector3f physics:gravityDirection", tuple(&direction));
        prim.set("float physics:gravityMagnitude", strength);
        prim
    }

    /// Returns the prim of a body with its shapes, at its position in the scene.
    pub fn body(&self, index: usize) -> PrimWriter {
        let (body, name) = (&self.scene.bodies[index], &self.names[index]);
        let dimension = self.scene.dimension;
        let mut prim = PrimWriter::new("Xform", name);
        if let Some(own) = body.name.as_ref().filter(|own| *own != name) {
            prim.metadata.push(format!("displayName = {}", quoted(own)));
        }
        if body.motion != Motion::Static {
            prim.schemas.extend(["PhysicsRigidBodyAPI", "PhysicsMassAPI"]);
            mass(&mut prim, dimension, &body.mass);
            velocity(&mut prim, body);
            let follows = !body.track.times.is_empty();
            if body.motion == Motion::Kinematic || follows {
                prim.set("bool physics:kinematicEnabled", 1);
            }
            if body.motion == Motion::Dynamic && follows {
                prim.set("custom bool drystone:released", 1);
            }
            if body.start_asleep {
                prim.set("bool physics:startsAsleep", 1);
            }
            if body.force.iter().any(|x| *x != 0.0) {
                prim.set("custom double3 drystone:force", tuple(&space(&body.force)));
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
        prim.place(space(&body.position), body.rotation.quaternion(), [1.0; 3]);
        let look = Look { dimension, body: index, motion: body.motion, engine: self.engine };
        let shapes = body.shapes.iter().enumerate().map(|(number, of)| {
            let mut prim = shape::prim(&look, of, number);
            self.materials.bind(&mut prim, &of.material);
            if let Some(motion) = &of.surface_velocity {
                run(&mut prim, &shape::seen_from_prim(motion, of));
            }
            prim
        });
        prim.children = shapes.collect();
        prim
    }
}

/// Returns a prim name for each body.
fn identifiers(scene: &Scene) -> Vec<String> {
    let taken = [PHYSICS, materials::SCOPE, stage::GROUPS, joint::SCOPE].map(str::to_owned);
    names(scene.bodies.iter().map(|body| body.name.as_deref()), "body", HashSet::from(taken))
}

/// Returns a prim name for each of these names, unique among them and those taken: ASCII letters,
/// digits and underscores, without a leading digit.
fn names<'n>(
    all: impl Iterator<Item = Option<&'n str>>,
    kind: &str,
    mut taken: HashSet<String>,
) -> Vec<String> {
    let one = |(index, own): (usize, Option<&str>)| {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let mut name: String = own.unwrap_or(kind).chars().map(plain).collect();
        if !name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            name.insert(0, '_');
        }
        if own.is_none() || taken.contains(&name) {
            name = format!("{name}_{index}");
        }
        while !taken.insert(name.clone()) {
            name.push('_');
        }
        name
    };
    all.enumerate().map(one).collect()
}

/// Metadata of a stage.
#[derive(Clone, Copy, Debug)]
pub struct StageHead<'a> {
    /// First and last time code.
    pub ends: [f64; 2],
    /// Frames per second. \[1/s\]
    pub frames: f64,
    /// Time codes per second. \[1/s\]
    pub codes: f64,
    /// Units and up axis.
    pub units: StageUnits,
    /// Name of the default prim, if there is one.
    pub default_prim: Option<&'a str>,
    /// Path of the weaker layer below this one, if there is one.
    pub sublayer: Option<&'a str>,
}

impl Default for StageHead<'_> {
    /// A stage with the default prim `World` at the time code 0, one of which takes a second.
    fn default() -> Self {
        Self {
            ends: [0.0; 2],
            frames: 1.0,
            codes: 1.0,
            units: StageUnits::METERS,
            default_prim: Some("World"),
            sublayer: None,
        }
    }
}

/// Writes a stage with these root prims.
///
/// # Errors
/// Those of [`write_whole`].
pub fn write_stage(path: &Path, head: &StageHead<'_>, roots: &[PrimWriter]) -> io::Result<()> {
    let StageHead { ends: [start, end], frames, codes, units, .. } = *head;
    let up = if units.z_up { "Z" } else { "Y" };
    let (meters, kilograms) = (units.meters, units.kilograms);
    write_whole(path, |out| {
        writeln!(out, "#usda 1.0\n(")?;
        let creator = concat!("Drystone ", env!("CARGO_PKG_VERSION"));
        writeln!(out, "    customLayerData = {{\n        string creator = \"{creator}\"\n    }}")?;
        if let Some(name) = head.default_prim {
            writeln!(out, "    defaultPrim = {}", quoted(name))?;
        }
        writeln!(out, "    endTimeCode = {end}")?;
        writeln!(out, "    framesPerSecond = {frames}\n    kilogramsPerUnit = {kilograms}")?;
        writeln!(out, "    metersPerUnit = {meters}\n    startTimeCode = {start}")?;
        if let Some(path) = head.sublayer {
            writeln!(out, "    subLayers = [\n        {}\n    ]", asset(path))?;
        }
        writeln!(out, "    timeCodesPerSecond = {codes}\n    upAxis = \"{up}\"\n)\n")?;
        roots.iter().try_for_each(|root| root.write(out, 0))
    })
}

/// Formats the path of a file as OpenUSD requires.
fn asset(path: &str) -> String {
    let marks = if path.contains('@') { "@@@" } else { "@" };
    format!("{marks}{}{marks}", path.replace("@@@", "\\@@@"))
}

/// Rounds to nine decimals, which removes the errors of divisions, so that frames have whole time
/// codes.
pub fn rounded(x: f64) -> f64 {
    (x * 1e9).round() / 1e9
}

/// Sets the mass properties that do not follow from the shapes.
fn mass(prim: &mut PrimWriter, dimension: usize, mass: &Mass) {
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

fn velocity(prim: &mut PrimWriter, body: &Body) {
    let names = ["physics:angularVelocity", "drystone:angularVelocity"];
    set_turning(prim, names, turning(&body.angular_velocity));
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
fn run(prim: &mut PrimWriter, motion: &SurfaceVelocity) {
    prim.schemas.push("PhysxSurfaceVelocityAPI");
    let names = ["physxSurfaceVelocity:surfaceAngularVelocity", "drystone:surfaceAngularVelocity"];
    set_turning(prim, names, turning(&motion.angular));
    prim.set("vector3f physxSurfaceVelocity:surfaceVelocity", tuple(&space(&motion.linear)));
    prim.set("bool physxSurfaceVelocity:surfaceVelocityEnabled", 1);
    let local = i32::from(motion.local);
    prim.set("bool physxSurfaceVelocity:surfaceVelocityLocalSpace", local);
}

/// Sets an angular velocity in degrees, and that in radians in an attribute of its own where the
/// reader would round. \[rad/s\]
fn set_turning(prim: &mut PrimWriter, [name, own]: [&str; 2], angular: [f64; 3]) {
    let found = angular.map(|rate| inverse(rate, rate.to_degrees(), f64::to_radians));
    prim.set(format!("vector3f {name}"), tuple(&found.map(|(written, _)| written)));
    if !found.iter().all(|(_, exact)| *exact) {
        prim.set(format!("custom double3 {own}"), tuple(&angular));
    }
}

/// Returns a number near `guess` that `back` converts to `value`, if there is one, and whether there
/// is. Of two numbers, the shorter one is taken.
fn inverse(value: f64, guess: f64, back: fn(f64) -> f64) -> (f64, bool) {
    let round = (guess * 1e9).round() / 1e9;
    let found = [round, guess, guess.next_up(), guess.next_down()]
        .into_iter()
        .find(|written| back(*written) == value);
    (found.unwrap_or(guess), found.is_some())
}
