//! `drystone convert`: writes a scene or a bake in another format.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use drystone::StepSettings;
use drystone_bake::Decompositions;
use drystone_scene::export::gltf::Physics;
use drystone_scene::export::usd::StageWriter;
use drystone_scene::{Scene, to_json, to_toml, write_whole};

use crate::bake::Format;
use crate::extension::{extension, wrong_extension};
use crate::failure::Failure;
use crate::files::refuse_overwrite;
use crate::frames::{FrameOptions, OutputMotion};
use crate::print;
use crate::verify::take;

/// Write a scene or a bake in another format.
///
/// Scenes of any format are written in Drystone's own (.toml, .json), as glTF with physics (.gltf,
/// .glb) or as OpenUSD with UsdPhysics (.usda). Each of these is read back as the same bodies.
/// Bakes (.npz, .poses), also unfinished ones (.journal), are written as an animation (.glb, .usda)
/// or as arrays (.npz, .poses).
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ConvertArguments {
    /// Scene (.toml, .json, .gltf, .glb, .usda) or bake (.npz, .poses, .journal)
    input: PathBuf,

    /// File to write; its extension sets the format
    output: PathBuf,

    /// Take shapes and names from this scene of the bake: for .glb, .usda and from .poses
    #[arg(long)]
    scene: Option<PathBuf>,

    #[command(flatten)]
    frame_options: FrameOptions,
}

const EXAMPLES: &str = "\
Examples:
  drystone convert scenes/arch.json arch.glb
      writes the arch with its physics as a glTF
  drystone convert scenes/workshop.gltf workshop.toml
      writes bodies, shapes and surfaces of a glTF for editing by hand; leaves out the rest
  drystone convert scenes/arch.json arch.usda
      writes the arch as OpenUSD with UsdPhysics, for Houdini or Omniverse
  drystone convert stones.glb.journal preview.glb --scene scenes/stones.json
      writes the frames so far of an unfinished bake
  drystone convert stones.npz shot.glb --scene scenes/stones.json --fps 24 --frames 24..96
      writes frames 24 to 96 of a bake, at 24 per second

Exit codes: 0 done, 2 wrong input or usage, or the format cannot hold the scene, 4 a file cannot be
read or written.";

/// Runs the command.
pub(crate) fn run(arguments: &ConvertArguments) -> Result<(), Failure> {
    let inputs = std::iter::once(&arguments.input).chain(&arguments.scene);
    refuse_overwrite(&arguments.output, inputs.map(PathBuf::as_path))?;
    match extension(&arguments.input).as_str() {
        "npz" | "poses" | "journal" => motion(arguments),
        _ => scene(arguments),
    }?;
    print(&format!("wrote        {}\n", arguments.output.display()))
}

fn motion(arguments: &ConvertArguments) -> Result<(), Failure> {
    let ConvertArguments { input, output, scene, frame_options } = arguments;
    let format = Format::of("OUT", output)?;
    let read = scene.as_deref().map(drystone_bake::read).transpose()?;
    read.as_ref().map_or(Ok(()), |read| frame_options.check(read))?;
    let stage = read.as_ref().and_then(|read| read.stage.as_ref());
    let layers = stage.into_iter().flat_map(|stage| &stage.layers);
    refuse_overwrite(output, layers.map(PathBuf::as_path))?;
    let named = take(input, read.as_ref().map(|read| &read.scene))?.ok_or_else(|| {
        let what = "does not name its bodies; give their scene with --scene";
        Failure::Input(format!("{}: {what}", input.display()))
    })?;
    if matches!(format, Format::Glb | Format::Usda)
        && let Some((frame, body)) = named.recording.first_not_finite()
    {
        let name = named.names.get(body).map_or("", String::as_str);
        return Err(Failure::Input(format!(
            "{}: frame {frame}: the pose of '{name}' has a number that is not finite; accepted \
             for {}: \
             finite poses",
            input.display(),
            output.display(),
        )));
    }
    let motion = frame_options.motion(OutputMotion {
        recording: Cow::Borrowed(&named.recording),
        names: &named.names,
        contacts: &[],
        joints: Cow::Borrowed(&named.joints),
        velocities: Cow::Borrowed(&named.velocities),
    })?;
    let warnings = format.write(output, read.as_ref(), &motion, frame_options)?;
    warnings.iter().for_each(|warning| warn(input, warning));
    Ok(())
}

fn scene(arguments: &ConvertArguments) -> Result<(), Failure> {
    let ConvertArguments { input, output, frame_options, .. } = arguments;
    if frame_options.is_asked() {
        let what = "is a scene; accepted with --fps, --frames, --key-tolerance, --new-stage and \
             --instances: a bake";
        return Err(Failure::Input(format!("{}: {what}", input.display())));
    }
    let form = extension(output);
    if !matches!(form.as_str(), "toml" | "json" | "gltf" | "glb" | "usda") {
        return Err(wrong_extension("OUT", output, ".toml, .json, .gltf, .glb, .usda"));
    }
    let read = drystone_bake::read(input)?;
    read.warnings.iter().for_each(|warning| warn(input, warning));
    let text = |text: String| write_whole(output, |out| out.write_all(text.as_bytes()));
    let written = match form.as_str() {
        "toml" => text(to_toml(&read.scene)),
        "json" => text(to_json(&read.scene)),
        "usda" => {
            let wrong = |why: String| Failure::Input(format!("{}: {why}", input.display()));
            StageWriter::new(&read.scene, &drystone_bake::Drystone).map_err(wrong)?.write(output)
        }
        _ if read.source.is_some() => {
            let what = "is a glTF already; accepted as OUT: .toml, .json, .usda";
            return Err(Failure::Input(format!("{}: {what}", input.display())));
        }
        "gltf" => physics(input, &read.scene)?.write_gltf(output),
        _ => physics(input, &read.scene)?.write_glb(output),
    };
    written.map_err(|error| Failure::cannot_write(output, &error))
}

/// Converts a scene to a glTF with physics.
fn physics(file: &Path, scene: &Scene) -> Result<Physics, Failure> {
    let wrong = |why: String| Failure::Input(format!("{}: {why}", file.display()));
    let settings = drystone_bake::settings(scene, StepSettings::certified())?;
    let simulation = drystone_bake::build_with(scene, settings, &mut Decompositions::of_user())
        .map_err(|error| wrong(error.to_string()))?;
    Physics::new(scene, &simulation.masses(), &drystone_bake::Drystone).map_err(wrong)
}

fn warn(file: &Path, warning: &drystone_scene::Warning) {
    eprintln!("drystone: warning: {}: {warning}", file.display());
}
