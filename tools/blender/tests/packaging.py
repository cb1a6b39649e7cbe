"""Tests of the package: installed in a Blender of its own, found programs, panel."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
from drystone import baking, binary, panel, settings

from .common import add, cube, empty

TOOLS = Path(__file__).parents[1]

# A user installs the package and bakes a falling crate.
INSTALLED = """
import sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
print("installed", bpy.ops.extensions.package_install_files(
    filepath=sys.argv[1], repo="user_default", enable_on_install=True))
scene = bpy.context.scene
scene.frame_start, scene.frame_end = 1, 24
bpy.ops.rigidbody.world_add()
bpy.ops.mesh.primitive_plane_add(size=20)
bpy.ops.rigidbody.object_add(type="PASSIVE")
bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, 3))
crate = bpy.context.object
bpy.ops.rigidbody.object_add(type="ACTIVE")
assert bpy.ops.drystone.bake() == {"FINISHED"}
scene.frame_set(13)
print("fell", 3 - crate.matrix_world.translation.z)
assert 0.9 < 3 - crate.matrix_world.translation.z < 1.3
print("said", scene.drystone.said.splitlines()[0])
from importlib import import_module
package = next(name for name in bpy.context.preferences.addons.keys() if name.endswith("drystone"))
print("program", import_module(package + ".binary").find(""))
assert import_module(package + ".binary").find("").parent.name == "bin"
bpy.ops.preferences.addon_disable(module=package)
"""


def test_installed(program, folder):
    """The package installs in Blender, finds its own program and bakes."""
    package, script = folder / "drystone.zip", folder / "install.py"
    subprocess.run([sys.executable, TOOLS / "package.py", "--binary", program, "-o", package], check=True)
    script.write_text(INSTALLED)
    done = subprocess.run([sys.executable, script, package], capture_output=True, text=True, cwd=folder,
                          env={**os.environ, "BLENDER_USER_RESOURCES": str(folder / "user"), "PATH": ""})
    print(done.stdout)
    assert done.returncode == 0 and "1 body baked" in done.stdout, done.stdout + done.stderr


def test_versions_agree(_program, _folder):
    tree = ast.parse((TOOLS / "drystone" / "__init__.py").read_text())
    info = next(ast.literal_eval(node.value) for node in tree.body
                if isinstance(node, ast.Assign) and node.targets[0].id == "bl_info")
    assert ".".join(map(str, info["version"])) == settings.VERSION


def test_finds_the_program(program, folder):
    """By its path, in a folder, beside the file, or not at all."""
    own = folder / "somewhere" / binary.NAME
    own.parent.mkdir()
    own.symlink_to(program)
    assert binary.find(program) == Path(program)
    assert binary.find(str(own)) == own and binary.find(str(own.parent)) == own
    home = os.environ.get("HOME", "")
    os.environ["HOME"] = str(folder)
    assert binary.find("~/somewhere") == own
    os.environ["HOME"] = home
    empty()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "shot.blend"))
    assert binary.find("//somewhere") == own
    path = os.environ["PATH"]
    os.environ["PATH"] = str(folder)
    try:
        binary.find("")
        assert False, "found what is not there"
    except ValueError as error:
        assert "choose it in Edit > Preferences" in str(error)
    finally:
        os.environ["PATH"] = path
    other = folder / "other"
    other.write_text("#!/bin/sh\necho something else\n")
    for asked in (binary.version, binary.abilities):
        try:
            asked(binary.find(str(other)))
            assert False, "took another program for drystone"
        except ValueError as error:
            assert str(error) == f"{other} is not drystone"
    print(f"packaging: drystone {binary.version(own)}, {binary.abilities(own)}")


def test_panel(program, _folder):
    """Lines fit, and mismatched versions are told."""
    assert all(len(line) <= 30 for line in panel.wrapped("a rather long remark on many objects " * 3, 280))
    assert [baking.duration(time) for time in (12, 200, 9000)] == ["12 s", "3 min", "2.5 h"]
    own = panel.preference
    panel.preference = lambda _context: program
    try:
        text, is_wrong = panel.versions(bpy.context)
        assert is_wrong == (binary.version(Path(program)) != settings.VERSION), text
    finally:
        panel.preference = own


class Layout:
    """A layout that notes what is drawn."""

    def __init__(self, drawn=None):
        self.drawn = [] if drawn is None else drawn

    def row(self, **_):
        return Layout(self.drawn)

    column = row

    def label(self, text, icon):
        self.drawn.append(text)

    def prop(self, owner, name, **_):
        self.drawn.append(owner.bl_rna.properties[name].name)

    def operator(self, name, text=None, icon=None):
        self.drawn.append(text if text is not None else name)
        return SimpleNamespace()

    def progress(self, factor, text):
        self.drawn.append(text)


def drawn(kind, width=300):
    """Returns what a panel draws."""
    preferences = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0), addons=bpy.context.preferences.addons)
    context = SimpleNamespace(scene=bpy.context.scene, preferences=preferences,
                              region=SimpleNamespace(width=width))
    layout = Layout()
    kind.draw(SimpleNamespace(layout=layout, draw_progress=panel.Main.draw_progress), context)
    return layout.drawn


def test_units(_program, _folder):
    """Lengths are in the units of the scene, speeds and loads stay."""
    text = "deepest overlap 240.00 mm at 3 mm/s, 2 m, by 0.2 N and 3 N m, 1.5e-1 mm"
    units = SimpleNamespace(system="METRIC", scale_length=1.0)
    assert settings.in_units(text, units) == text
    units.scale_length = 0.01
    assert settings.in_units(text, units) == "deepest overlap 2.4 mm at 3 mm/s, 2 cm, by 0.2 N and 3 N m, 1.5 um"
    units.system, units.scale_length = "IMPERIAL", 1.0
    assert settings.in_units("2.54 m", units) == "8.33ft"
    units.system = "NONE"
    assert settings.in_units("2.54 m, 3.50 mm", units) == "2.54, 0.0035"


def test_operators(program, folder):
    """Each button, on a scene with a crate."""
    import drystone

    drystone.register()
    own = drystone.operators.preference
    drystone.operators.preference = lambda _context: program
    try:
        scene = empty(last=48)
        add(lambda: bpy.ops.mesh.primitive_plane_add(size=20), "PASSIVE", "BOX", "ground")
        crate = add(cube(1, (0, 0, 2)), "ACTIVE", "BOX", "crate")
        scene.drystone.cache = str(folder)
        assert bpy.ops.drystone.check() == {"FINISHED"}
        assert [found.line for found in scene.drystone.findings] == [
            "1 flat passive object: solid below, so that nothing falls through"]
        assert bpy.ops.drystone.select(names=json.dumps(["crate"])) == {"FINISHED"}
        assert bpy.context.selected_objects == [crate]
        assert bpy.ops.drystone.bake() == {"FINISHED"}
        said = scene.drystone.said.splitlines()
        assert said[0] == "1 body baked" and said[1].startswith("certified") and scene.frame_end == 48
        assert drawn(panel.Main)[:5] == ["Quality", "drystone.bake", "drystone.bake_from", "drystone.delete_bake",
                                         "1 body baked"]
        assert drawn(panel.Before) == ["drystone.check", "drystone.pieces", "1 flat passive object: solid",
                                       "below, so that nothing falls", "through", ""]
        assert "Substeps" in drawn(panel.More) and "Cache" in drawn(panel.More)
        drystone.operators.running = SimpleNamespace(progress=0.25, progress_text=lambda: "25%")
        assert drawn(panel.Main) == ["25%", "drystone.stop"]
        drystone.operators.running = None
        scene.frame_set(1)
        try:
            bpy.ops.drystone.bake_from()
            assert False, "began at the first frame"
        except RuntimeError as error:
            assert "go to a frame from 2 to 47" in str(error)
        scene.frame_set(24)
        assert bpy.ops.drystone.bake_from() == {"FINISHED"} and scene.drystone.said.startswith("1 body baked")
        scene.frame_set(48)
        assert abs(crate.matrix_world.translation.z - 0.5) < 1e-3
        assert bpy.ops.drystone.delete_bake() == {"FINISHED"}
        assert not crate.rigid_body.kinematic and crate.animation_data is None
        assert not bpy.ops.drystone.delete_bake.poll()
        assert bpy.ops.drystone.export_scene(filepath=str(folder / "d.json")) == {"FINISHED"}
        assert json.loads((folder / "d.json").read_text())["steps"] == 47
        assert bpy.ops.drystone.apply_bake(filepath=str(folder / "Scene.npz")) == {"FINISHED"}
        assert crate.rigid_body.kinematic
    finally:
        drystone.operators.preference = own
        drystone.unregister()
