//! `drystone decompose`: writes the convex pieces of the meshes of a scene.

use std::path::PathBuf;

use drystone_bake::decomposition::ConvexPiece;
use drystone_bake::{Decomposition, Decompositions};
use drystone_scene::{Motion, write_whole};
use serde_json::{Value, json};

use crate::extension::{extension, wrong_extension};
use crate::failure::Failure;
use crate::files::refuse_overwrite;
use crate::print;

/// Write the convex pieces of the meshes of a scene.
///
/// A mesh of a dynamic body collides as convex pieces. They are written as a bake of the scene has
/// them, in the frame of the mesh, with how far they are from it.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DecomposeArguments {
    /// Scene: .toml, .json, .gltf, .glb or .usda
    scene: PathBuf,

    /// File to write: .json
    #[arg(short, long)]
    output: PathBuf,
}

const EXAMPLES: &str = "\
Examples:
  drystone decompose scenes/workshop.gltf -o pieces.json
      writes a list 'meshes': of each the body, the index of the shape, 'pieces' of 'points' [m]
      and 'triangles', and the deviation: 'outward' and 'inward' [m], 'added' and 'lost' volume
      as fractions of that of the mesh

Exit codes: 0 done, 2 wrong input or usage, 4 a file cannot be read or written.";

/// Runs the command.
pub(crate) fn run(arguments: &DecomposeArguments) -> Result<(), Failure> {
    let DecomposeArguments { scene: input, output } = arguments;
    if extension(output) != "json" {
        return Err(wrong_extension("OUT", output, ".json"));
    }
    refuse_overwrite(output, [input.as_path()])?;
    let scene = drystone_bake::read(input)?.scene;
    let (names, mut known) = (scene.names(), Decompositions::of_user());
    let (mut meshes, mut count) = (Vec::new(), 0);
    let dynamic = |&index: &usize| scene.bodies[index].motion == Motion::Dynamic;
    for index in (0..scene.bodies.len()).filter(dynamic) {
        for (number, shape) in scene.bodies[index].shapes.iter().enumerate() {
            let Some(found) = known.of_shape(&shape.kind) else { continue };
            let found = found.map_err(|error| {
                let (file, body) = (input.display(), scene.name_of(index));
                Failure::Input(format!("{file}: shape {number} of body {body}: {error}"))
            })?;
            count += found.pieces.len();
            meshes.push(mesh(&names[index], number, &found));
        }
    }
    let text = format!("{}\n", json!({ "meshes": meshes }));
    write_whole(output, |out| out.write_all(text.as_bytes()))
        .map_err(|error| Failure::cannot_write(output, &error))?;
    print(&format!("wrote        {} ({count} pieces)\n", output.display()))
}

/// Returns the pieces of a mesh as JSON.
fn mesh(body: &str, shape: usize, found: &Decomposition) -> Value {
    let piece =
        |piece: &ConvexPiece| json!({ "points": piece.points, "triangles": piece.triangles });
    let pieces: Vec<_> = found.pieces.iter().map(piece).collect();
    let of = found.deviation;
    json!({
        "body": body,
        "shape": shape,
        "pieces": pieces,
        "outward": of.outward,
        "inward": of.inward,
        "added": of.added,
        "lost": of.lost,
    })
}
