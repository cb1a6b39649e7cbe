//! What will hurt in a scene, found before it is simulated.

mod contacts;
mod decompositions;
mod meshes;
mod motion;
mod scales;
mod sizes;
mod surfaces;

use schemars::JsonSchema;
use serde::Serialize;

pub use decompositions::decompositions;

use crate::decomposition::Decompositions;
use crate::scene::{Read, Scene};
use crate::settings::StepSettings;
use crate::simulation::{BuildError, build_with};

/// What a finding is about. Ordered as findings are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Two bodies overlap at the start. \[m\]
    Overlap,
    /// Contacts that no motion can open. \[m/s\]
    Wedged,
    /// A heavy body rests on a light one: the ratio of their masses. \[1\]
    MassRatio,
    /// A body that carries others stands on no friction. \[1\]
    Frictionless,
    /// A body may pass through another between two searches for contacts. \[m\]
    TooFast,
    /// A key of a kinematic body is a jump: the speed that it means. \[m/s\]
    Jump,
    /// A body is very large. \[m\]
    TooLarge,
    /// A body is very thin. \[m\]
    TooSmall,
    /// A body is far from the origin. \[m\]
    TooFar,
    /// A shape is mirrored: its smallest factor of scale. \[1\]
    NegativeScale,
    /// A shape is scaled unevenly: the largest factor over the smallest. \[1\]
    UnevenScale,
    /// A mesh that should enclose a volume has holes: the number of edges that are not between two triangles.
    OpenMesh,
    /// A closed mesh looks inward, as a room does: its volume. \[m^3\]
    InsideOutMesh,
    /// A mesh passes through itself: the number of pairs of triangles.
    CrossingMesh,
    /// The convex pieces of a mesh are farther from it than they should be. \[m\]
    Decomposition,
    /// Two surfaces bounce without loss. \[1\]
    LosslessBounce,
    /// A surface has a restitution that never acts. \[1\]
    IdleBounce,
    /// The reader left something out, or took something else for it.
    LeftOut,
}

/// Something that will hurt.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What it is about.
    pub kind: Kind,
    /// The bodies, by index in the scene.
    pub bodies: Vec<usize>,
    /// The number found, in the unit of its kind; none where there is nothing to measure.
    pub value: Option<f64>,
    /// What is accepted: at most this, or for [`Kind::TooSmall`] and [`Kind::Frictionless`] at least.
    pub limit: Option<f64>,
    /// Names, number and limit in words.
    pub what: String,
    /// What to do.
    pub advice: String,
}

impl Finding {
    /// About one body: the number found, and its limit.
    fn of_body(
        body: usize,
        kind: Kind,
        [value, limit]: [f64; 2],
        what: String,
        advice: &str,
    ) -> Self {
        let (value, limit) = (Some(value), Some(limit));
        Self { kind, bodies: vec![body], value, limit, what, advice: advice.to_owned() }
    }
}

/// Everything that will hurt in a scene with these settings, the worst of each kind first.
///
/// Takes two steps of the scene: one of almost no time, for the contacts at the start, and one of its
/// own, for what is wedged.
///
/// # Errors
/// No world can be made of the scene.
pub fn check(read: &Read, settings: &StepSettings) -> Result<Vec<Finding>, BuildError> {
    check_with(read, settings, &mut Decompositions::default())
}

/// The same with decompositions that may be known already.
///
/// # Errors
/// Those of [`check`].
pub fn check_with(
    read: &Read,
    settings: &StepSettings,
    known: &mut Decompositions,
) -> Result<Vec<Finding>, BuildError> {
    let scene = &read.scene;
    let mut simulation = build_with(scene, contacts::at_the_start(settings), known)?;
    simulation.step(contacts::INSTANT);
    let (near, masses) = (simulation.nearby(), simulation.masses());
    // Jams are looked for only where certificates are.
    let certifying = StepSettings { certify: true, ..settings.clone() };
    let wedged = build_with(scene, certifying, known)?.step(scene.time_step).jams;

    let mut findings = contacts::overlaps(scene, &near);
    findings.extend(contacts::wedged(scene, &wedged));
    findings.extend(contacts::mass_ratios(scene, &near, &masses, settings));
    findings.extend(contacts::frictionless(scene, &near, &masses));
    findings.extend(motion::too_fast(scene, settings));
    findings.extend(jumps(scene));
    findings.extend(sizes::sizes(scene));
    findings.extend(scales::scales(read));
    findings.extend(meshes::meshes(scene));
    let missed = |of: &Finding| of.value > of.limit;
    findings.extend(decompositions(scene, known).into_iter().filter(missed));
    findings.extend(surfaces::bounces(scene));
    findings.extend(read.warnings.iter().map(|warning| Finding {
        kind: Kind::LeftOut,
        bodies: Vec::new(),
        value: None,
        limit: None,
        what: warning.to_string(),
        advice: "see whether that is what you mean".to_owned(),
    }));
    let excess = |of: &Finding| match (of.value, of.limit) {
        (Some(value), Some(limit)) => (value - limit).abs(),
        _ => 0.0,
    };
    findings.sort_by(|a, b| a.kind.cmp(&b.kind).then(excess(b).total_cmp(&excess(a))));
    Ok(findings)
}

/// Keys of kinematic bodies that are jumps, the fastest of each body.
pub fn jumps(scene: &Scene) -> Vec<Finding> {
    motion::jumps(scene)
}

/// Unit vector against gravity; zero without gravity.
fn up(scene: &Scene) -> Vec<f64> {
    let strength = scene.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
    scene.gravity.iter().map(|g| if strength > 0.0 { -g / strength } else { 0.0 }).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// A length in the unit that suits it.
fn length(meters: f64) -> String {
    match meters.abs() {
        0.0 => "0 m".to_owned(),
        ..1e-3 => format!("{:.3} mm", meters * 1e3),
        ..1.0 => format!("{:.2} mm", meters * 1e3),
        _ => format!("{meters:.2} m"),
    }
}
