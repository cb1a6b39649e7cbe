//! Command-line arguments of `drystone bake`.

use std::path::PathBuf;

use crate::cut::Cut;
use crate::quantity::{real, speed};

pub(super) const MAX_STEPS: u32 = 10_000_000;

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
    pub(super) scene: PathBuf,

    /// Where the motion goes; may be given several times. By extension: .glb, an animated glTF
    /// (of a glTF scene: the same document with a clip added); .usda, OpenUSD with time samples;
    /// .npz, arrays for NumPy: poses, names, times, contacts; .poses, raw 32-bit floats. Frame 0 is
    /// the initial state
    #[arg(short, long, value_name = "OUT", group = "result")]
    pub(super) output: Vec<PathBuf>,

    #[command(flatten)]
    pub(super) cut: Cut,

    /// Seconds to simulate [default: as the scene says, or 10]
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e7), conflicts_with = "steps")]
    pub(super) duration: Option<f64>,

    /// Steps to simulate, instead of seconds
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=i64::from(MAX_STEPS)))]
    pub(super) steps: Option<u32>,

    /// Substeps per step: more are stiffer and more exact [default: as the scene or the preset says, and more where
    /// bodies are small]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(super) substeps: Option<u32>,

    /// Sweeps over all contacts per substep [default: as the scene or the preset says]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(super) iterations: Option<u32>,

    /// How far from the exact solution of the contacts velocities may be (root mean square by mass, of
    /// each island): every substep is solved until a bound is below that; with friction it holds for
    /// the slip at hand. 0mm/s: one sweep each, in more substeps [default: as the scene says, or 1mm/s]
    #[arg(long, value_name = "SPEED", value_parser = speed)]
    pub(super) tolerance: Option<f32>,

    /// Leave islands that have held still for so many seconds out of steps until something touches them;
    /// 0: never [default: as the scene says, or 0; with --realtime 0.5]
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e6))]
    pub(super) sleep: Option<f64>,

    /// Threads; results do not depend on it [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(super) threads: Option<u32>,

    /// Start from the settings for games: fixed work, faster and less exact; how far from exact is
    /// certified all the same
    #[arg(long)]
    pub(super) realtime: bool,

    /// Write what happened in each step as JSON
    #[arg(long, value_name = "FILE.json", group = "result")]
    pub(super) report: Option<PathBuf>,

    /// Keep a ledger of where the energy of each step came from and went, for the report and the
    /// summary; a step takes up to five times as long
    #[arg(long)]
    pub(super) ledger: bool,

    /// Save the contact problem of the last substep of this step, from 1: bodies, contacts, M, J, t,
    /// eps, mu, v* and the guess, for `drystone solve`
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_STEPS)))]
    pub(super) dump_step: Option<u32>,

    /// Where that goes; may be given several times. By extension: .json; .hdf5, FCLIB's local form
    /// [default: beside the first output, OUT.step-N.json]
    #[arg(long, value_name = "FILE", group = "result", requires = "dump_step")]
    pub(super) dump: Vec<PathBuf>,

    /// Go on with a bake that was ended, by whatever: from OUT.journal beside the first output, which a
    /// bake keeps until its files are written. The files are those of a bake that was never ended, to
    /// the last byte. Starts at the beginning where there is none; refuses one of another scene, other
    /// settings or another version
    #[arg(long)]
    pub(super) resume: bool,

    /// Seconds between checkpoints of the whole state in OUT.journal; less are done again with --resume
    #[arg(long, value_name = "S", value_parser = real(0.0..=1e6), default_value = "10")]
    pub(super) checkpoint: f64,

    /// No progress bar and no summary; warnings and errors remain
    #[arg(short, long)]
    pub(super) quiet: bool,
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
