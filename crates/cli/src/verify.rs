//! `drystone verify`: compares two bakes and reports where they differ.

use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use drystone_bake::recording::compare::{Difference, differences};
use drystone_bake::recording::journal;
use drystone_bake::recording::npz;
use drystone_bake::recording::poses;
use drystone_bake::recording::{JointRecording, Named, Velocities};
use drystone_scene::Scene;

use crate::extension::{extension, wrong_extension};
use crate::failure::Failure;
use crate::print;

/// Compare two bakes to the last bit.
///
/// The answer has the first frame and body that differ, the difference, and the largest difference.
/// A .npz file names its bodies. For a .poses file, --scene names them.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct VerifyArguments {
    /// First bake: .npz, .poses, or the .journal of a bake that runs or was interrupted
    a: PathBuf,

    /// Second bake, of the same scene
    b: PathBuf,

    /// Take the names of bodies from this scene
    #[arg(long)]
    scene: Option<PathBuf>,
}

const EXAMPLES: &str = "\
Examples:
  drystone verify a.npz b.npz
      compares two bakes; if they differ, names the first body and frame that do
  drystone verify a.poses b.poses --scene scenes/arch.json
      compares raw poses

Exit codes: 0 the same, 1 different, 2 wrong input or usage, 4 a file cannot be read. The report of
`drystone bake --report` has a hash of all poses and velocities after each step, `state`, to compare
bakes on machines that are far apart.";

/// Runs the command.
pub(crate) fn run(arguments: &VerifyArguments) -> Result<ExitCode, Failure> {
    let VerifyArguments { a, b, scene } = arguments;
    let shown = format!("{} and {}", a.display(), b.display());
    if bytes(a)? == bytes(b)? {
        print(&format!("same         {shown}, to the last bit\n"))?;
        return Ok(ExitCode::SUCCESS);
    }
    let scene = match scene {
        Some(path) => Some(drystone_bake::read(path)?.scene),
        None => None,
    };
    let difference = match (take(a, scene.as_ref())?, take(b, scene.as_ref())?) {
        (Some(one), Some(other)) => described(&one, &other),
        _ => "where        unknown; give their scene with --scene\n".to_owned(),
    };
    print(&format!("different    {shown}\n{difference}"))?;
    Ok(ExitCode::from(1))
}

/// Describes the first and the largest difference, and differences in the number of frames and
/// bodies.
fn described(one: &Named, other: &Named) -> String {
    let (a, b) = (&one.recording, &other.recording);
    let line = |title: &str, of: Option<Difference>| {
        let Some(Difference { frame, body, distance, angle }) = of else { return String::new() };
        let frame = a.start.saturating_add(frame);
        let (time, name) = (frame as f64 * a.frame_time, one.names.get(body));
        format!(
            "{title:<12} frame {frame} ({time:.3} s): '{}' by {:.3e} mm and {angle:.3e} rad\n",
            name.map_or("", String::as_str),
            distance * 1e3
        )
    };
    let farther = |x: Difference, y: Difference| if y.distance > x.distance { y } else { x };
    let mut text = line("first", differences(a, b).next());
    text += &line("farthest", differences(a, b).reduce(farther));
    text += &velocities(one, other);
    for (title, [x, y]) in [
        ("first frame", [a.start, b.start]),
        ("frames", [a.frames(), b.frames()]),
        ("bodies", [a.bodies, b.bodies]),
        ("dimensions", [a.dimension, b.dimension]),
    ] {
        if x != y {
            text += &format!("{title:<12} {x} and {y}\n");
        }
    }
    text
}

/// Describes the largest difference of a component of velocities, if both bakes have as many.
fn velocities(one: &Named, other: &Named) -> String {
    let (a, b) = (&one.velocities.numbers, &other.velocities.numbers);
    if a.len() != b.len() || a == b {
        return String::new();
    }
    let by = a.iter().zip(b).map(|(x, y)| f64::from((x - y).abs())).fold(0.0, f64::max);
    format!("velocities   differ by up to {by:.3e} m/s or rad/s\n")
}

fn bytes(path: &Path) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    let read = drystone_scene::open(path).and_then(|mut file| file.read_to_end(&mut bytes));
    read.map(|_| bytes).map_err(|error| Failure::cannot_read(path, &error))
}

/// Reads a bake with the names of its bodies; `None` if only a scene can tell its layout.
pub(crate) fn take(path: &Path, scene: Option<&Scene>) -> Result<Option<Named>, Failure> {
    let refused = |error: io::Error| Failure::Input(format!("{}: {error}", path.display()));
    drystone_scene::open(path).map_err(|error| Failure::cannot_read(path, &error))?;
    match extension(path).as_str() {
        "npz" => {
            let mut named = npz::read(path).map_err(refused)?;
            // A single frame does not tell the time between frames.
            if let Some(scene) = scene.filter(|_| named.recording.frames() < 2) {
                named.recording.frame_time = scene.time_step;
            }
            return Ok(Some(named));
        }
        "journal" => return journal::read(path).map(|it| Some(it.named())).map_err(refused),
        "poses" => {}
        _ => return Err(wrong_extension("a bake", path, ".npz, .poses, .journal")),
    }
    let Some(scene) = scene else { return Ok(None) };
    let bodies = scene.bodies.len();
    let recording = poses::read(path, scene.dimension, bodies, scene.time_step);
    let recording = recording.map_err(|error| {
        Failure::Input(format!(
            "{}: is not a bake of this scene, which has {bodies} bodies in {}D: {error}",
            path.display(),
            scene.dimension
        ))
    })?;
    let (joints, velocities) = (JointRecording::default(), Velocities::default());
    Ok(Some(Named { recording, names: scene.names(), joints, velocities }))
}
