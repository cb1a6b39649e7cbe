//! `drystone check`: reports problems of a scene before it is simulated.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use drystone::StepSettings;
use drystone_bake::Decompositions;
use drystone_bake::check::{Finding, FindingKind, check_with};
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::print;

/// Number of findings of each kind that are listed before the rest is counted.
const LISTED: usize = 10;

/// Find problems of a scene before it is baked.
///
/// Findings are overlaps, wedged bodies, heavy bodies on light ones, stacks without friction,
/// bodies that may tunnel, extreme sizes, mirrored and uneven scales, meshes with holes, inside
/// out or far from their convex pieces, surfaces that bounce without loss, joints that their bodies
/// do not fit at the start, and data that the reader left out.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CheckArguments {
    /// Scene to check: .toml, .json, .gltf, .glb or .usda
    scene: PathBuf,

    /// Check against the real-time preset, with its fixed work
    #[arg(long)]
    realtime: bool,

    /// Print all findings as JSON
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  drystone check scenes/arch.json
      prints nothing found: the scene is ready to bake
  drystone check scenes/workshop.gltf --json
      prints findings for other programs: kind, bodies, value, limit, and both in words

Exit codes: 0 nothing found, 1 something found, 2 wrong input or usage, 4 a file cannot be read.";

/// Runs the command.
pub(crate) fn run(arguments: &CheckArguments) -> Result<ExitCode, Failure> {
    let read = drystone_bake::read(&arguments.scene)?;
    let preset =
        if arguments.realtime { StepSettings::realtime() } else { StepSettings::certified() };
    let settings = drystone_bake::settings(&read.scene, preset)?;
    let file = arguments.scene.display();
    let findings = check_with(&read, &settings, &mut Decompositions::of_user())
        .map_err(|error| Failure::Input(format!("{file}: {error}")))?;
    if arguments.json {
        let names = read.scene.names();
        let list: Vec<_> = findings.iter().map(|finding| value(&names, finding)).collect();
        let version = env!("CARGO_PKG_VERSION");
        let whole = json!({ "scene": file.to_string(), "version": version, "findings": list });
        print(&format!("{whole:#}\n"))?;
    } else {
        print(&text(&findings))?;
        let count = match findings.len() {
            0 => "nothing found".to_owned(),
            1 => "1 finding".to_owned(),
            count => format!("{count} findings"),
        };
        print(&format!("{file}: {count} among {} bodies\n", read.scene.bodies.len()))?;
    }
    Ok(if findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Returns a finding as JSON with the names of its bodies.
fn value(names: &[String], finding: &Finding) -> Value {
    let mut value = json!(finding);
    value["names"] = finding.bodies.iter().filter_map(|&body| names.get(body)).cloned().collect();
    value
}

/// Lists the first findings of each kind, and counts the rest.
fn text(findings: &[Finding]) -> String {
    let mut kinds: BTreeMap<FindingKind, Vec<&Finding>> = BTreeMap::new();
    for finding in findings {
        kinds.entry(finding.kind).or_default().push(finding);
    }
    let mut text = String::new();
    for (kind, found) in kinds {
        let title = json!(kind).as_str().unwrap_or_default().replace('_', " ");
        for Finding { what, advice, .. } in found.iter().take(LISTED) {
            text += &format!("{title:<17} {what}; {advice}\n");
        }
        if found.len() > LISTED {
            text += &format!("{title:<17} and {} more; --json has all\n", found.len() - LISTED);
        }
    }
    text
}
