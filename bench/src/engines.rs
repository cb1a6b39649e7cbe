//! All engines behind one face. Each gets the same scene; nothing sleeps.

#[cfg(feature = "box2d")]
mod box2d;
#[cfg(feature = "box3d")]
mod box3d;
mod drystone;
#[cfg(feature = "jolt")]
mod jolt;
mod rapier;

use std::fmt;
use std::str::FromStr;

use ::drystone::scene::{BodiesAs, Body, Combine, Filter, Material, Motion, Scene};
use clap::ValueEnum;

pub(crate) use self::drystone::Drystone;

/// A scene in an engine.
pub(crate) trait Engine {
    /// One step of `dt` \[s\].
    ///
    /// # Errors
    /// The engine could not do all that the step needs.
    fn step(&mut self, dt: f32) -> Result<(), Refusal>;

    /// Appends the poses of all bodies of the scene, in its order: 3D px py pz qx qy qz qw,
    /// 2D px py angle. \[m, rad\]
    fn write_poses(&self, out: &mut Vec<f32>);
}

/// Why an engine does not run a scene.
#[derive(Debug, thiserror::Error)]
#[error("{item}: {reason}")]
pub(crate) struct Refusal {
    item: String,
    reason: String,
}

impl Refusal {
    fn new(item: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { item: item.into(), reason: reason.into() }
    }

    fn body(index: usize, body: &Body, reason: impl Into<String>) -> Self {
        Self::new(body.name.clone().unwrap_or_else(|| format!("body {index}")), reason)
    }
}

/// The engines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    Drystone,
    Rapier2d,
    Rapier3d,
    Box2d,
    Box3d,
    Jolt,
}

impl Kind {
    /// All engines, in the order of the table.
    pub(crate) const ALL: [Self; 6] =
        [Self::Drystone, Self::Rapier2d, Self::Rapier3d, Self::Box2d, Self::Box3d, Self::Jolt];

    /// Its name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Drystone => "drystone",
            Self::Rapier2d => "rapier2d",
            Self::Rapier3d => "rapier3d",
            Self::Box2d => "box2d",
            Self::Box3d => "box3d",
            Self::Jolt => "jolt",
        }
    }

    /// Where its source comes from.
    pub(crate) fn version(self) -> &'static str {
        match self {
            Self::Drystone => "this checkout",
            Self::Rapier2d => env!("VERSION_RAPIER2D"),
            Self::Rapier3d => env!("VERSION_RAPIER3D"),
            Self::Box2d => env!("VERSION_BOXDD_SYS"),
            Self::Box3d => env!("VERSION_BOXDDD_SYS"),
            Self::Jolt => env!("VERSION_OXIJOLT_SYS"),
        }
    }

    /// Whether it is part of this build.
    pub(crate) fn is_built(self) -> bool {
        match self {
            Self::Drystone | Self::Rapier2d | Self::Rapier3d => true,
            Self::Box2d => cfg!(feature = "box2d"),
            Self::Box3d => cfg!(feature = "box3d"),
            Self::Jolt => cfg!(feature = "jolt"),
        }
    }

    /// Whether it has scenes of `dimension` 2 or 3.
    pub(crate) fn has_dimension(self, dimension: usize) -> bool {
        match self {
            Self::Drystone => true,
            Self::Rapier2d | Self::Box2d => dimension == 2,
            Self::Rapier3d | Self::Box3d | Self::Jolt => dimension == 3,
        }
    }

    /// The settings of `--quality`, from fast to exact.
    pub(crate) fn efforts(self) -> Vec<Effort> {
        let substeps = |counts: &[u32]| counts.iter().map(|&n| Effort::Substeps(n)).collect();
        match self {
            Self::Drystone => {
                let mut efforts: Vec<_> = substeps(&[4, 8, 16, 32]);
                efforts.push(Effort::Certified);
                efforts
            }
            Self::Jolt => substeps(&[1, 2, 4, 8]),
            _ => substeps(&[4, 8, 16, 32, 64]),
        }
    }
}

/// How hard an engine works on a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Effort {
    /// Its default settings; Drystone's for real time.
    Default,
    /// So many substeps, contacts as much stiffer; Jolt: collision steps.
    Substeps(u32),
    /// Drystone's certified settings.
    Certified,
}

impl fmt::Display for Effort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::Substeps(count) => write!(f, "{count}"),
            Self::Certified => f.write_str("certified"),
        }
    }
}

impl FromStr for Effort {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "default" => Ok(Self::Default),
            "certified" => Ok(Self::Certified),
            count => match count.parse() {
                Ok(count @ 1..=1024) => Ok(Self::Substeps(count)),
                _ => Err("accepted: default, certified, 1 to 1024".to_string()),
            },
        }
    }
}

/// Substeps and contact stiffness \[Hz\] of the engines that share Box2D's soft contacts: their
/// defaults, or both raised together, since stiffness alone sets how deep a contact sinks.
fn soft_step(effort: Effort) -> Option<(u32, f32)> {
    match effort {
        Effort::Substeps(count) => Some((count, 7.5 * count as f32)),
        _ => None,
    }
}

/// Puts a scene into an engine that works on `threads` threads.
///
/// # Errors
/// What of the scene the engine cannot have.
pub(crate) fn build(
    kind: Kind,
    scene: &Scene,
    effort: Effort,
    threads: usize,
) -> Result<Box<dyn Engine>, Refusal> {
    if effort == Effort::Certified && kind != Kind::Drystone {
        return Err(Refusal::new(kind.name(), "has no certified settings"));
    }
    if kind != Kind::Drystone {
        accept(scene)?;
    }
    match kind {
        Kind::Drystone => Ok(Box::new(Drystone::new(scene, drystone::settings(effort), threads)?)),
        Kind::Rapier2d => rapier::flat(scene, effort, threads),
        Kind::Rapier3d => rapier::space(scene, effort, threads),
        #[cfg(feature = "box2d")]
        Kind::Box2d => Ok(Box::new(box2d::Box2d::new(scene, effort, threads)?)),
        #[cfg(feature = "box3d")]
        Kind::Box3d => Ok(Box::new(box3d::Box3d::new(scene, effort, threads)?)),
        #[cfg(feature = "jolt")]
        Kind::Jolt => Ok(Box::new(jolt::Jolt::new(scene, effort, threads)?)),
        #[allow(unreachable_patterns)]
        _ => {
            Err(Refusal::new(kind.name(), "is not part of this build; build with --features peers"))
        }
    }
}

/// Whether the scene means the same in all engines.
fn accept(scene: &Scene) -> Result<(), Refusal> {
    if scene.bodies_as == BodiesAs::Particles {
        return Err(Refusal::new("bodies_as", "particles, which peers do not have"));
    }
    let materials: Vec<&Material> =
        scene.bodies.iter().flat_map(|body| &body.shapes).map(|shape| &shape.material).collect();
    let alike = materials.windows(2).all(|pair| {
        pair[0].friction == pair[1].friction && pair[0].restitution == pair[1].restitution
    });
    for (index, body) in scene.bodies.iter().enumerate() {
        let refuse = |reason: &str| Err(Refusal::body(index, body, reason));
        if !body.track.times.is_empty() {
            return refuse("follows a track, which peers do not have");
        }
        if body.mass.mass.is_some_and(f64::is_infinite)
            || body.mass.inertia.iter().flatten().any(|moment| !moment.is_finite())
        {
            return refuse("has an infinite mass or moment of inertia");
        }
        for shape in &body.shapes {
            let Material { friction_combine: friction, restitution_combine: bounce, .. } =
                shape.material;
            let usual = friction == Combine::GeometricMean && bounce == Combine::Maximum;
            let product = friction == Combine::Multiply || bounce == Combine::Multiply;
            // Of two equal numbers, means, minimum and maximum are the same.
            if !usual && (product || !alike) {
                return refuse(
                    "combines friction or restitution in a way that not all engines have",
                );
            }
            if shape.filter != Filter::default() {
                return refuse(
                    "collides with some bodies only, which this program does not carry over",
                );
            }
        }
    }
    Ok(())
}

/// Density of all shapes of a body, from its density or its mass. \[kg/m^3, 2D kg/m^2\]
fn density(body: &Body, volume: f64) -> f64 {
    match body.mass.mass {
        Some(mass) => mass / volume,
        None => body.mass.density.unwrap_or(1000.0),
    }
}

/// Whether a body states a center of mass or moments of inertia that its shapes do not have.
fn states_inertia(body: &Body) -> bool {
    body.motion == Motion::Dynamic && (body.mass.center.is_some() || body.mass.inertia.is_some())
}

/// Mass properties in double precision, the same in the plane and in space.
macro_rules! solids {
    ($name:ident: $parry:ident, $shapes:ident, $stated:expr) => {
        pub(crate) mod $name {
            use drystone::scene::{Body, Mass};
            pub(crate) use $parry::mass_properties::MassProperties;

            use super::Refusal;
            use crate::shapes::$shapes::{pose, shape, vector};

            /// Volume of all shapes of a body that have one. \[m^3, 2D m^2\]
            pub(crate) fn volume(index: usize, body: &Body) -> Result<f64, Refusal> {
                Ok(solid(index, body, 1.0)?.mass())
            }

            /// Mass, center and inertia of a body: its own where it states them, else those of its
            /// shapes.
            pub(crate) fn stated(index: usize, body: &Body) -> Result<MassProperties, Refusal> {
                let density = super::density(body, volume(index, body)?);
                let mut of = solid(index, body, density)?;
                if let Some(center) = &body.mass.center {
                    of.local_com = vector(center);
                }
                let inertia: fn(&MassProperties, &[f64], &Mass) -> MassProperties = $stated;
                Ok(body
                    .mass
                    .inertia
                    .as_ref()
                    .map_or(of, |moments| inertia(&of, moments, &body.mass)))
            }

            fn solid(index: usize, body: &Body, density: f64) -> Result<MassProperties, Refusal> {
                let mut sum = MassProperties::default();
                for part in &body.shapes {
                    let shape = shape(&part.kind).map_err(|why| Refusal::body(index, body, why))?;
                    let local = pose(&part.position, &part.rotation);
                    sum += shape.mass_properties(density).transform_by(&local);
                }
                Ok(sum)
            }
        }
    };
}

solids!(flat_solid: parry2d_f64, exact_flat, |of, moments, _| {
    MassProperties::new(of.local_com, of.mass(), moments.first().copied().unwrap_or(0.0))
});
solids!(solid: parry3d_f64, exact_space, |of, moments, mass| {
    let axes = drystone::scene::Rotation::Quaternion(mass.inertia_rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let frame = pose(&[], &axes).rotation;
    MassProperties::with_principal_inertia_frame(of.local_com, of.mass(), vector(moments), frame)
});
