//! `drystone bake`: reads a scene, runs it and writes its motion.

mod diary;
mod dump;
mod output;
mod record;
mod report;
mod summary;

use std::collections::BTreeSet;
use std::num::NonZero;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::{fmt, process, thread};

use drystone::recording::journal::Header;
use drystone::scene::{self, Read, Scene};
use drystone::{Simulation, StepSettings};

use crate::cut::Cut;
use crate::failure::Failure;
use crate::print;
use crate::quantity::{real, speed};
use diary::Diary;
pub(crate) use output::Format;
use output::Outputs;
use record::{Bake, Length};
use summary::Summary;

/// Seconds that a scene runs which does not say how long. \[s\]
const DURATION: f64 = 10.0;
const MAX_STEPS: u32 = 10_000_000;

/// Run a scene and write its motion.
///
/// SCENE is a scene of Drystone's own format (.toml, .json; `drystone schema` describes it), a glTF with
/// physics (.gltf, .glb; extensions KHR_physics_rigid_bodies and KHR_implicit_shapes) or OpenUSD with
/// UsdPhysics (.usda).
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
#[command(group(clap::ArgGroup::new("result").required(true).multiple(true)))]
pub(crate) struct Arguments {
    /// The scene: .toml, .json, .gltf, .glb or .usda
    scene: PathBuf,

    /// Where the motion goes; may be given several times. By extension: .glb, an animated glTF
    /// (of a glTF scene: the same document with a clip added); .usda, OpenUSD with time samples;
    /// .npz, arrays for NumPy: poses, names, times, contacts; .poses, raw 32-bit floats. Frame 0 is
    /// the initial state
    #[arg(short, long, value_name = "OUT", group = "result")]
    output: Vec<PathBuf>,

    #[command(flatten)]
    cut: Cut,

    /// Seconds to simulate [default: as the scene says, or 10]
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e7), conflicts_with = "steps")]
    duration: Option<f64>,

    /// Steps to simulate, instead of seconds
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=i64::from(MAX_STEPS)))]
    steps: Option<u32>,

    /// Substeps per step: more are stiffer and more exact [default: as the scene or the preset says]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    substeps: Option<u32>,

    /// Sweeps over all contacts per substep [default: as the scene or the preset says]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    iterations: Option<u32>,

    /// How far from the exact solution of the contacts velocities may be (root mean square by mass, of
    /// each island): every substep is solved until a bound is below that; with friction it holds for
    /// the slip at hand. 0mm/s: one sweep each, in more substeps [default: as the scene says, or 1mm/s]
    #[arg(long, value_name = "SPEED", value_parser = speed)]
    tolerance: Option<f32>,

    /// Leave islands that have held still for so many seconds out of steps until something touches them;
    /// 0: never [default: as the scene says, or 0; with --realtime 0.5]
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e6))]
    sleep: Option<f64>,

    /// Threads; results do not depend on it [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,

    /// Start from the settings for games: fixed work, faster and less exact; how far from exact is
    /// certified all the same
    #[arg(long)]
    realtime: bool,

    /// Write what happened in each step as JSON
    #[arg(long, value_name = "FILE.json", group = "result")]
    report: Option<PathBuf>,

    /// Keep a ledger of where the energy of each step came from and went, for the report and the
    /// summary; a step takes up to five times as long
    #[arg(long)]
    ledger: bool,

    /// Save the contact problem of the last substep of this step, from 1: bodies, contacts, M, J, t,
    /// eps, mu, v* and the guess, for `drystone solve`
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_STEPS)))]
    dump_step: Option<u32>,

    /// Where that goes; may be given several times. By extension: .json; .hdf5, FCLIB's local form
    /// [default: beside the first output, OUT.step-N.json]
    #[arg(long, value_name = "FILE", group = "result", requires = "dump_step")]
    dump: Vec<PathBuf>,

    /// Go on with a bake that was ended, by whatever: from OUT.journal beside the first output, which a
    /// bake keeps until its files are written. The files are those of a bake that was never ended, to
    /// the last byte. Starts at the beginning where there is none; refuses one of another scene, other
    /// settings or another version
    #[arg(long)]
    resume: bool,

    /// Seconds between checkpoints of the whole state in OUT.journal; less are done again with --resume
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e6), default_value = "10")]
    checkpoint: f64,

    /// No progress bar and no summary; warnings and errors remain
    #[arg(short, long)]
    quiet: bool,
}

const EXAMPLES: &str = "\
Examples:
  drystone bake scenes/arch.json -o arch.glb
      eight seconds of a masonry arch; open arch.glb in Blender (File > Import > glTF 2.0),
      or drop it on any glTF viewer, and press play
  drystone bake scenes/workshop.gltf -o baked.glb --fps 24
      the scene of the file back, with a clip 'Drystone' at 24 frames per second
  drystone bake scenes/workshop.gltf -o shot.glb --fps 24 --frames 24..96 --key-tolerance 0.1mm
      frames 24 to 96 of it, with fewer keys
  drystone bake scenes/stones.json -o stones.npz -o stones.usda --report stones.report.json
      poses for NumPy: numpy.load('stones.npz')['poses'][frame, body]; a stage for Houdini or
      usdview; and numbers of each step
  drystone bake scenes/tower.json -o tower.glb --substeps 64 --duration 20
      stiffer contacts, for longer
  drystone bake scenes/arch.json -o arch.glb --tolerance 0.1mm/s
      every substep solved until its velocities are certified to be within 0.1 mm/s of the exact ones
  drystone bake scenes/stones.json -o stones.glb --resume
      go on where a bake was ended, by Ctrl-C, a power cut or a full disk; see its frames until then:
      drystone convert stones.glb.journal preview.glb --scene scenes/stones.json
  drystone bake scenes/arch.json -o arch.glb --dump-step 60
      also the contact problem of step 60, as arch.glb.step-60.json for `drystone solve`

Exit codes: 0 done, 2 wrong input or usage, 3 the simulation diverged, 4 a file cannot be read or
written, 130 interrupted. A file under its final name is always whole.";

/// Set when the user wants to end.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = Outputs::new(arguments)?;
    let read = scene::read(&arguments.scene)?;
    print_warnings(arguments, read.warnings.iter());
    outputs.check_folders()?;
    listen();
    let mut simulation = prepare(arguments, &read.scene)?;
    let threads = threads(arguments);
    simulation.set_threads(threads);
    // Of a bake that goes on later, a report may be asked for only then.
    simulation.time_stages(true);
    let steps = steps(arguments, &read.scene)?;
    arguments.cut.steps(0..=steps as usize, read.scene.time_step)?;
    let dump_step = dump::step(arguments.dump_step, steps)?;
    let bar = progress(arguments, steps);
    let header = Header::new(&read.scene, simulation.settings());
    let mut diary = Diary::open(arguments, outputs.first(arguments), header)?;
    let length = Length { steps: steps as usize, dump_step: dump_step.map(|step| step as usize) };
    let baked = Bake::run(simulation.as_mut(), &read.scene, length, &mut diary, &bar);
    if let Err(Failure::Diverged(_)) = baked {
        diary.discard(usize::MAX);
        return baked.map(|_| ());
    }
    let bake = baked?;
    let summary = Summary::new(&read.scene, &bake);
    let files = match write(arguments, &outputs, &read, &bake, &summary, threads) {
        Err(Failure::File(what)) => {
            return Err(Failure::File(format!("{what}; {}", diary.way_on())));
        }
        files => files?,
    };
    diary.discard(bake.steps.len());
    if !arguments.quiet {
        let head =
            summary::Head { file: &arguments.scene, settings: simulation.settings(), threads };
        print(&format!("{}{files}", summary.text(&read.scene, &head)));
    }
    Ok(())
}

fn print_warnings(arguments: &Arguments, warnings: impl Iterator<Item = impl fmt::Display>) {
    let mut said = BTreeSet::new();
    for warning in warnings.map(|warning| warning.to_string()) {
        if said.insert(warning.clone()) {
            eprintln!("drystone: warning: {}: {warning}", arguments.scene.display());
        }
    }
}

/// The first signal ends the simulation between two steps; a file that is being written is
/// finished first, so that none is left in part. A second one ends the process at once. Whatever
/// happens, the bake can go on from its journal.
fn listen() {
    let heard = || {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            process::exit(130);
        }
    };
    // Without a handler, a signal ends the process, which is all that is lost.
    let _ = ctrlc::set_handler(heard);
}

fn prepare(arguments: &Arguments, scene: &Scene) -> Result<Box<dyn Simulation>, Failure> {
    let in_file = |error: &dyn fmt::Display| {
        Failure::Input(format!("{}: {error}", arguments.scene.display()))
    };
    drystone::build(scene, settings(arguments, scene)?).map_err(|error| in_file(&error))
}

fn settings(arguments: &Arguments, scene: &Scene) -> Result<StepSettings, Failure> {
    let preset = match (arguments.realtime, arguments.tolerance) {
        (true, _) => StepSettings { certify: true, ..StepSettings::realtime() },
        (false, Some(0.0)) => StepSettings { certify: true, ..StepSettings::quality() },
        (false, _) => StepSettings::certified(),
    };
    let mut settings = scene.settings(preset)?;
    settings.substeps = arguments.substeps.unwrap_or(settings.substeps);
    settings.iterations = arguments.iterations.unwrap_or(settings.iterations);
    settings.sleep = arguments.sleep.map_or(settings.sleep, |seconds| seconds as f32);
    settings.tolerance = arguments.tolerance.unwrap_or(settings.tolerance);
    settings.ledger |= arguments.ledger;
    Ok(settings)
}

fn threads(arguments: &Arguments) -> usize {
    let all = || thread::available_parallelism().map_or(1, NonZero::get);
    arguments.threads.map_or_else(all, |threads| threads as usize)
}

fn steps(arguments: &Arguments, scene: &Scene) -> Result<u32, Failure> {
    // Without the margin, rounding of the quotient would add a step to whole durations.
    let of = |seconds: f64| (seconds / scene.time_step * (1.0 - 1e-9)).ceil();
    let Some(seconds) = arguments.duration else {
        return Ok(arguments.steps.or(scene.steps).unwrap_or(of(DURATION) as u32));
    };
    if of(seconds) > f64::from(MAX_STEPS) {
        let longest = f64::from(MAX_STEPS) * scene.time_step;
        return Err(Failure::Input(format!(
            "--duration is {seconds} s; accepted: up to {longest} s, {MAX_STEPS} steps"
        )));
    }
    Ok(of(seconds) as u32)
}

fn progress(arguments: &Arguments, steps: u32) -> indicatif::ProgressBar {
    if arguments.quiet {
        return indicatif::ProgressBar::hidden();
    }
    let style = "{bar:40} step {human_pos} of {human_len}, {eta} to go {msg}";
    let style = indicatif::ProgressStyle::with_template(style);
    let bar = indicatif::ProgressBar::new(u64::from(steps));
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

fn write(
    arguments: &Arguments,
    outputs: &Outputs,
    read: &Read,
    bake: &Bake,
    summary: &Summary,
    threads: usize,
) -> Result<String, Failure> {
    let (mut files, warnings) = outputs.write(read, bake, &arguments.cut)?;
    print_warnings(arguments, warnings.iter());
    if let Some(saved) = &bake.saved {
        let step = arguments.dump_step.unwrap_or_default();
        let (dumps, warning) = dump::write(outputs.dumps(), &read.scene, step, saved)?;
        print_warnings(arguments, warning.iter());
        files.extend(dumps);
    }
    if let Some(path) = &arguments.report {
        let settings = &bake.settings;
        let scene = &arguments.scene;
        report::write(path, &report::Run { scene, settings, threads, bake, summary })?;
        files.push(path.clone());
    }
    Ok(files.iter().map(|path| format!("wrote        {}\n", output::describe(path))).collect())
}
