//! Command-line arguments of `drystone bake`.

use std::path::PathBuf;

use crate::frames::FrameOptions;
use crate::quantity::{real, speed};

pub(super) const MAX_STEPS: u32 = 10_000_000;

/// Simulate a scene and write its motion.
///
/// SCENE is a scene of Drystone's own format (.toml, .json; `drystone schema` describes it), a
/// glTF with physics (.gltf, .glb; extensions KHR_physics_rigid_bodies and KHR_implicit_shapes)
/// or OpenUSD with UsdPhysics (.usda).
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
#[command(group(clap::ArgGroup::new("result").required(true).multiple(true)))]
pub(crate) struct BakeArguments {
    /// Scene to simulate: .toml, .json, .gltf, .glb or .usda
    pub(super) scene: PathBuf,

    /// Write the motion to OUT; may be given several times. The extension sets the format: .glb, an
    /// animated glTF (the document of a glTF scene with a clip added); .usda, OpenUSD with time
    /// samples (a layer over the stage of an OpenUSD scene); .npz, arrays for NumPy: poses,
    /// velocities, names, times, contacts, joints; .poses, raw 32-bit floats. Frame 0 is the
    /// initial state
    #[arg(short, long, value_name = "OUT", group = "result")]
    pub(super) output: Vec<PathBuf>,

    /// Write where bodies push each other to FILE, for dust and sound; may be given several times.
    /// Each frame has a point for each pair of shapes that touched in its step, with position,
    /// normal, impulse, approach speed and bodies. The extension sets the format: .npz, arrays for
    /// NumPy; .usda, OpenUSD with one prim of type Points
    #[arg(long, value_name = "FILE", group = "result")]
    pub(super) contacts: Vec<PathBuf>,

    #[command(flatten)]
    pub(super) frame_options: FrameOptions,

    /// Simulate so many seconds [default: as the scene says, or 10]
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e7), conflicts_with = "steps")]
    pub(super) duration: Option<f64>,

    /// Simulate so many steps, instead of seconds
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=i64::from(MAX_STEPS)))]
    pub(super) steps: Option<u32>,

    /// Set the substeps per step: more are stiffer and more exact [default: as the scene or the
    /// preset says, and more where bodies are small]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(super) substeps: Option<u32>,

    /// Set the sweeps over all contacts per substep [default: as the scene or the preset says]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(super) iterations: Option<u32>,

    /// Bound the error of velocities: the distance of each island from the exact solution of its
    /// contacts, root mean square by mass. Every substep is solved until a proven bound is below
    /// it. With friction the bound holds for the slip at hand. 0mm/s: one sweep each, in more
    /// substeps [default: as the scene says, or 1mm/s]
    #[arg(long, value_name = "SPEED", value_parser = speed)]
    pub(super) tolerance: Option<f32>,

    /// Let islands sleep after so many seconds at rest: steps leave them out until something
    /// touches them; 0: never [default: as the scene says, or 0; with --realtime 0.5]
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e6))]
    pub(super) sleep: Option<f64>,

    /// Use so many threads; results do not depend on it [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(super) threads: Option<u32>,

    /// Start from the real-time preset: fixed work, faster and less exact. Certificates still state
    /// the error
    #[arg(long)]
    pub(super) realtime: bool,

    /// Write numbers of each step as JSON: contacts, times of stages, certificates
    #[arg(long, value_name = "FILE.json", group = "result")]
    pub(super) report: Option<PathBuf>,

    /// Keep a ledger of the sources and sinks of energy in each step, for the report and the
    /// summary; a step takes up to five times as long
    #[arg(long)]
    pub(super) ledger: bool,

    /// Save the problem of the last substep of this step, from 1, for `drystone solve`: bodies,
    /// contacts, rows of joints, M, J, t, eps, mu, v* and the guess. If contacts bounced and were searched
    /// again after that, the substep is the last one before that search
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_STEPS)))]
    pub(super) dump_step: Option<u32>,

    /// Save the impacts of that step instead: rigid contacts without friction and joints, v* before the
    /// impacts, and t = -restitution J v* of contacts that close
    #[arg(long, requires = "dump_step")]
    pub(super) dump_impacts: bool,

    /// Write the saved problem to FILE; may be given several times. The extension sets the format:
    /// .json; .hdf5, FCLIB's local form [default: beside the first output, OUT.step-N.json]
    #[arg(long, value_name = "FILE", group = "result", requires = "dump_step")]
    pub(super) dump: Vec<PathBuf>,

    /// Resume an interrupted bake from OUT.journal beside the first output, which a bake keeps
    /// until its files are written. The files equal those of an uninterrupted bake in every byte.
    /// Without a journal the bake starts at the beginning. A journal of another scene, of other
    /// settings or of another version is refused
    #[arg(long)]
    pub(super) resume: bool,

    /// Write a checkpoint of the whole state to OUT.journal at intervals of S seconds. --resume
    /// repeats the steps after the last one
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e6), default_value = "10")]
    pub(super) checkpoint: f64,

    /// Print progress as lines on standard error, at most one per second, also where it is not a
    /// terminal: `frame 12 of 240 (5 %), 31 s left`. They replace the bar, and remain with --quiet
    #[arg(long)]
    pub(super) progress: bool,

    /// Print no progress bar and no summary; warnings and errors remain
    #[arg(short, long)]
    pub(super) quiet: bool,
}

const EXAMPLES: &str = "\
Examples:
  drystone bake scenes/arch.json -o arch.glb
      bakes eight seconds of a masonry arch; open arch.glb in Blender (File > Import >
      glTF 2.0), or drop it on any glTF viewer, and press play
  drystone bake scenes/workshop.gltf -o baked.glb --fps 24
      writes the glTF scene again, with a clip 'Drystone' at 24 frames per second
  drystone bake scenes/workshop.gltf -o shot.glb --fps 24 --frames 24..96 --key-tolerance 0.1mm
      writes its frames 24 to 96, with fewer keys
  drystone bake scenes/stones.json -o stones.npz -o stones.usda --report stones.report.json
      writes poses for NumPy: numpy.load('stones.npz')['poses'][frame, body]; a stage for
      Houdini or usdview; and numbers of each step
  drystone bake scenes/stones.json -o stones.glb --contacts dust.npz --contacts dust.usda
      also writes where stones hit each other, and how hard
  drystone bake shot/stage.usda -o shot/baked.usda
      writes a layer over the stage, which keeps its materials, textures and hierarchy
  drystone bake scenes/tower.json -o tower.glb --substeps 64 --duration 20
      simulates stiffer contacts, and more seconds
  drystone bake scenes/arch.json -o arch.glb --tolerance 0.1mm/s
      solves every substep until its velocities are certified within 0.1 mm/s
  drystone bake scenes/stones.json -o stones.glb --resume
      resumes a bake that Ctrl-C, a power cut or a full disk interrupted; the frames so far:
      drystone convert stones.glb.journal preview.glb --scene scenes/stones.json
  drystone bake scenes/arch.json -o arch.glb --dump-step 60
      also saves the contact problem of step 60, as arch.glb.step-60.json for `drystone solve`

Exit codes: 0 done, 2 wrong input or usage, 3 the simulation diverged, 4 a file cannot be read or
written, 130 interrupted. A file under its final name is always complete.";
