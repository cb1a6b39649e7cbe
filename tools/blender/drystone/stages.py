"""OpenUSD stages of bakes, written by Drystone from the files of the cache."""

import bpy

from . import binary


def baked_scene(whole):
    """Returns the path of the scene that belongs to the recording of a whole bake."""
    return whole.with_suffix(".scene.json")


def write_stage(program, folder, scene, path, instances=False):
    """Writes the bake of a scene as OpenUSD; with `instances`, equal bodies are instances of one prototype."""
    whole = folder / f"{bpy.path.clean_name(scene.name)}.npz"
    shapes = baked_scene(whole)
    if not (whole.exists() and shapes.exists()):
        raise ValueError("The cache has no complete bake of this scene: bake it to its last frame first.")
    program = binary.find(program)
    if instances and not binary.abilities(program).instances:
        raise ValueError("This version of drystone writes no instances: install the version of the add-on, or "
                         "leave Instances out.")
    more = ["--instances"] if instances else []
    code, _, messages = binary.run(program, "convert", whole, path, "--scene", shapes, *more)
    if code != 0:
        raise ValueError("; ".join(binary.said_plainly(messages)) or f"drystone ended with code {code}")
