"""Tests of bakes as OpenUSD, for programs beside Blender."""

import re
from types import SimpleNamespace

import bpy
from drystone import baking, binary, operators, panel
from drystone.stages import write_stage

from .common import LONG, block, full_bake, heap, midway
from .here import from_here
from .packaging import drawn

NO_BAKE = "The cache has no complete bake of this scene: bake it to its last frame first."


def written(program, folder, instances):
    """Returns the text of the stage of the bake of the scene."""
    path = folder / "shot.usda"
    write_stage(program, folder, bpy.context.scene, path, instances)
    return path.read_text()


def frames_of(text):
    """Returns the last time code of a stage."""
    return float(re.search(r"endTimeCode = (\S+)", text)[1])


def refused(program, folder):
    try:
        written(program, folder, True)
    except ValueError as error:
        return str(error)
    return ""


def test_instances(program, folder):
    """Equal bodies are prims, or instances of one prototype, also after checks and bakes from a frame on."""
    scene = heap(30, 24)
    assert refused(program, folder) == NO_BAKE
    full_bake(program, folder)
    single, several = written(program, folder, False), written(program, folder, True)
    assert "PointInstancer" not in single and several.count("def PointInstancer") == 1
    assert len(several) < len(single) and frames_of(single) == frames_of(several) == 24
    block("later", (0, 0, 30))
    baking.Check(bpy.context, program, baking.Options(), folder).finish()
    assert written(program, folder, True) == several
    scene.frame_set(10)
    from_here(program, folder, 10)
    text = written(program, folder, True)
    assert frames_of(text) == 24 and "later" in text


def test_incomplete(program, folder):
    """A bake that was stopped has no stage, and no older one takes its place."""
    heap(200, 100)
    full_bake(program, folder, baking.Options(is_preview=True))
    assert not refused(program, folder)
    bake = baking.Bake(bpy.context, program, LONG, folder)
    midway(bake)
    bake.cancel()
    bake.finish()
    assert bake.keys.frames and refused(program, folder) == NO_BAKE


def test_older_program(program, folder):
    """A program without instances is told, and writes single bodies."""
    heap(3, 5)
    full_bake(program, folder)
    own = binary.abilities
    binary.abilities = lambda path: SimpleNamespace(instances=False)
    try:
        assert refused(program, folder) == "This version of drystone writes no instances: install the version of " \
            "the add-on, or leave Instances out."
        assert "PointInstancer" not in written(program, folder, False)
    finally:
        binary.abilities = own


def test_operator(program, folder):
    """The operator has a checkbox; panel and menu have the operator."""
    import drystone

    drystone.register()
    own = operators.preference
    operators.preference = lambda _context: program
    try:
        scene = heap(30, 12)
        scene.drystone.cache = str(folder)
        assert not bpy.ops.drystone.export_bake.poll()
        assert bpy.ops.drystone.bake() == {"FINISHED"}
        for instances in (False, True):
            path = folder / f"{instances}.usda"
            assert bpy.ops.drystone.export_bake(filepath=str(path), instances=instances) == {"FINISHED"}
            assert ("PointInstancer" in path.read_text()) == instances
        assert "Export Bake" in drawn(panel.More)
        said = bpy.ops.drystone.export_bake.get_rna_type().properties["instances"].description
        assert 0 < len(said.split()) <= 28, said
        try:
            bpy.ops.drystone.export_bake(filepath=str(folder / "missing" / "a.usda"))
            assert False, "wrote into no folder"
        except RuntimeError as error:
            assert "missing" in str(error)
    finally:
        operators.preference = own
        drystone.unregister()
