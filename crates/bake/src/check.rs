//! Checks of a scene before it is simulated: findings that predict trouble.

mod contacts;
mod decompositions;
mod joints;
mod meshes;
mod motion;
mod scales;
mod sizes;
mod surfaces;

use serde::Serialize;

pub use decompositions::decompositions;

use crate::any_world::build_with;
use crate::decomposition::Decompositions;
use crate::error::BuildError;
use drystone::StepSettings;
use drystone_scene::{Read, Scene};

/// Subject of a finding. Findings are listed in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingKind {
    /// Two bodies overlap at the start: the depth. \[m\]
    Overlap,
    /// Contacts that no motion can open: the missing separation speed. \[m/s\]
    Wedged,
    /// A heavy body rests on a light one: the ratio of their masses. \[1\]
    MassRatio,
    /// A body that carries others stands without friction: the friction coefficient. \[1\]
    Frictionless,
    /// A body may pass through another between two searches for contacts: the distance it may move.
    /// \[m\]
    TooFast,
    /// Two keys of a kinematic body are a jump: the speed that it implies. \[m/s\]
    Jump,
    /// A key of a kinematic body or of its mesh is between two steps, and no step reaches it: by how much
    /// it is missed. \[m\]
    MissedKey,
    /// A body is very large: its largest extent. \[m\]
    TooLarge,
    /// A body is very thin: its thickness. \[m\]
    TooSmall,
    /// A body is far from the origin: the distance. \[m\]
    TooFar,
    /// A shape is mirrored: its smallest scale factor. \[1\]
    NegativeScale,
    /// A shape is scaled unevenly: the ratio of the largest to the smallest factor. \[1\]
    UnevenScale,
    /// A mesh that should enclose a volume has holes: the number of edges that are not between two
    /// triangles.
    OpenMesh,
    /// A closed mesh faces inward, as a room does: its signed volume. \[m^3\]
    InsideOutMesh,
    /// A mesh intersects itself: the number of pairs of triangles.
    CrossingMesh,
    /// The convex pieces of a mesh deviate from it by more than the accuracy: the deviation. \[m\]
    Decomposition,
    /// Two surfaces bounce without loss: their restitution. \[1\]
    LosslessBounce,
    /// The restitution of a surface never acts: that restitution. \[1\]
    IdleBounce,
    /// The frames of a joint are apart at the start: the distance. \[m\]
    JointApart,
    /// The frames of a joint are turned against each other at the start: the angle. \[rad\]
    JointTurned,
    /// A joint starts beyond its limits: by how much. \[m, or rad\]
    JointLimit,
    /// A joint connects two bodies that no force can move.
    JointIdle,
    /// A joint connects bodies of very different mass: the ratio of their masses. \[1\]
    JointMassRatio,
    /// Cardan angles of a joint are near their singularity: the middle angle. \[rad\]
    JointSingular,
    /// Bodies of a gear or a rack are held by one that moves: gears measure angles in the world.
    JointHousing,
    /// The scene reader left something out, or replaced it.
    LeftOut,
}

impl FindingKind {
    /// All kinds, in their order.
    pub const ALL: [Self; 26] = [
        Self::Overlap,
        Self::Wedged,
        Self::MassRatio,
        Self::Frictionless,
        Self::TooFast,
        Self::Jump,
        Self::MissedKey,
        Self::TooLarge,
        Self::TooSmall,
        Self::TooFar,
        Self::NegativeScale,
        Self::UnevenScale,
        Self::OpenMesh,
        Self::InsideOutMesh,
        Self::CrossingMesh,
        Self::Decomposition,
        Self::LosslessBounce,
        Self::IdleBounce,
        Self::JointApart,
        Self::JointTurned,
        Self::JointLimit,
        Self::JointIdle,
        Self::JointMassRatio,
        Self::JointSingular,
        Self::JointHousing,
        Self::LeftOut,
    ];
}

/// A problem of a scene that will disturb its simulation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Subject of the finding.
    pub kind: FindingKind,
    /// Indices of the bodies in the scene.
    pub bodies: Vec<usize>,
    /// Index of the joint in the scene, if it is about one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<usize>,
    /// Value found, in the unit of its kind; `None` if there is nothing to measure.
    pub value: Option<f64>,
    /// Accepted limit: an upper bound, or a lower bound for [`FindingKind::TooSmall`],
    /// [`FindingKind::Frictionless`], [`FindingKind::NegativeScale`] and
    /// [`FindingKind::InsideOutMesh`].
    pub limit: Option<f64>,
    /// Sentence with names, value and limit.
    pub what: String,
    /// Recommended remedy.
    pub advice: String,
}

impl Finding {
    /// Makes a finding about one body, with the value found and its limit.
    fn of_body(
        body: usize,
        kind: FindingKind,
        [value, limit]: [f64; 2],
        what: String,
        advice: &str,
    ) -> Self {
        let (value, limit) = (Some(value), Some(limit));
        let (bodies, advice) = (vec![body], advice.to_owned());
        Self { kind, bodies, joint: None, value, limit, what, advice }
    }
}

/// Returns all findings about a scene with these settings, the worst of each kind first.
///
/// Takes two steps of the scene from its start. A step of almost no time finds the contacts at the
/// start. A step of the scene's own length finds jams.
///
/// # Errors
/// The scene cannot be built.
pub fn check(read: &Read, settings: &StepSettings) -> Result<Vec<Finding>, BuildError> {
    check_with(read, settings, &mut Decompositions::default())
}

/// Checks a scene, with a cache of decompositions.
///
/// # Errors
/// Those of [`check`].
pub fn check_with(
    read: &Read,
    settings: &StepSettings,
    known: &mut Decompositions,
) -> Result<Vec<Finding>, BuildError> {
    let scene = &read.scene;
    let mut world = build_with(scene, contacts::at_the_start(settings), known)?;
    let joints: Vec<_> = world.joints().into_iter().filter_map(|id| world.joint(id)).collect();
    world.step(contacts::INSTANT)?;
    let (near, masses) = (world.nearby(), world.masses());
    // Only steps with certificates look for jams.
    let certifying = StepSettings { certify: true, ..settings.clone() };
    let wedged = build_with(scene, certifying, known)?.step_scene(scene, 0)?.jams;

    let mut findings = contacts::overlaps(scene, &near);
    findings.extend(contacts::wedged(scene, &wedged));
    findings.extend(contacts::mass_ratios(scene, &near, &masses, settings));
    findings.extend(contacts::frictionless(scene, &near, &masses));
    findings.extend(motion::too_fast(scene, settings));
    findings.extend(motion::deforms_too_fast(scene, settings));
    findings.extend(keys(scene));
    findings.extend(sizes::sizes(scene));
    findings.extend(scales::scales(read));
    findings.extend(meshes::meshes(scene));
    findings.extend(joints::joints(scene, &joints, &masses));
    let missed = |of: &Finding| of.value > of.limit;
    findings.extend(decompositions(scene, known).into_iter().filter(missed));
    findings.extend(surfaces::bounces(scene));
    findings.extend(read.warnings.iter().map(|warning| Finding {
        kind: FindingKind::LeftOut,
        bodies: Vec::new(),
        joint: None,
        value: None,
        limit: None,
        what: warning.to_string(),
        advice: "check that this is intended".to_owned(),
    }));
    let excess = |of: &Finding| match (of.value, of.limit) {
        (Some(value), Some(limit)) => (value - limit).abs(),
        _ => 0.0,
    };
    findings.sort_by(|a, b| a.kind.cmp(&b.kind).then(excess(b).total_cmp(&excess(a))));
    Ok(findings)
}

/// Returns what is wrong with the keys of kinematic bodies: of each the largest jump, and the key that it
/// misses by most.
pub fn keys(scene: &Scene) -> Vec<Finding> {
    [motion::jumps(scene), motion::missed_keys(scene)].concat()
}

/// Returns the unit vector against gravity; zero without gravity.
fn up(scene: &Scene) -> Vec<f64> {
    let strength = scene.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
    scene.gravity.iter().map(|g| if strength > 0.0 { -g / strength } else { 0.0 }).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Formats a length in mm or m.
fn length(meters: f64) -> String {
    match meters.abs() {
        0.0 => "0 m".to_owned(),
        ..1e-3 => format!("{:.3} mm", meters * 1e3),
        ..1.0 => format!("{:.2} mm", meters * 1e3),
        _ => format!("{meters:.2} m"),
    }
}
