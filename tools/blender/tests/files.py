"""Tests of the files of bakes: folders, names, several files and scenes in one folder, and lost programs."""

import os
import re
import signal
import time
from pathlib import Path

import bpy
import numpy as np
from drystone import applying, baking, cache, operators, panel, stages

from .common import LONG, block, constrain, empty, export, full_bake, heap, lines, midway
from .here import from_here
from .packaging import drawn
from .ranges import heights

NO_RECORDING = "no recording"


def saved(folder, name, height, last=10):
    """Saves a file with a crate at a height and its bake, as any number of files in one folder."""
    scene = empty(last=last)
    block("floor", (0, 0, -0.5), "PASSIVE")
    crate = block("crate", (0, 0, height))
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"))
    return scene, crate


def opened(folder, name):
    bpy.ops.wm.open_mainfile(filepath=str(folder / f"{name}.blend"))
    return bpy.context.scene


def first_height(folder, program):
    """Returns the height at which the stage of a bake begins."""
    path = folder / "stage.usda"
    stages.write_stage(program, folder, bpy.context.scene, path)
    text = path.read_text()
    crate = text[text.index('"crate"'):]
    return float(re.search(r"translate.timeSamples = \{ 1: \(\S+ (\S+),", crate)[1])


def test_two_files_in_a_folder(program, folder):
    """Scenes of one name in several files have recordings of their own, in one folder."""
    for name, height in (("first", 3), ("second", 9)):
        saved(folder, name, height)
        full_bake(program, folder)
        bpy.ops.wm.save_mainfile()
    for name, height in (("first", 3), ("second", 9)):
        opened(folder, name)
        assert first_height(folder, program) == height
        bake = from_here(program, folder, 5)
        assert not any(NO_RECORDING in line for line in lines(bake.shot)), lines(bake.shot)


def test_saved_as(program, folder):
    """A file that is saved under another name keeps its recording, and its next bake harms no other file."""
    saved(folder, "v1", 3)
    full_bake(program, folder)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "v2.blend"))
    assert first_height(folder, program) == 3
    bake = from_here(program, folder, 5)
    assert not any(NO_RECORDING in line for line in lines(bake.shot)), lines(bake.shot)
    assert bake.whole.name == "v2-Scene.npz" and first_height(folder, program) == 3
    applying.delete_bake(bpy.context.scene)
    bpy.data.objects["crate"].location.z = 7
    full_bake(program, folder)
    assert first_height(folder, program) == 7
    opened(folder, "v1")
    assert first_height(folder, program) == 3


def test_saved_first_after_the_bake(program, folder):
    """A bake of a scene without a file keeps its recording when it is saved."""
    scene = empty(last=10)
    block("crate", (0, 0, 3))
    assert cache.folder_of("//drystone_cache") == cache.folder_of("")
    full_bake(program, cache.folder_of(""))
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "new.blend"))
    beside = cache.folder_of("")
    assert beside.resolve() == (folder / "drystone_cache").resolve()
    assert first_height(beside, program) == 3


def test_other_recordings(program, folder):
    """A recording that another bake has replaced is no part of a stage, nor of a bake from a frame on."""
    scene, crate = saved(folder, "file", 3)
    run, _, _ = full_bake(program, folder)
    bpy.ops.wm.save_mainfile()
    crate.location.z = 5
    full_bake(program, folder)
    opened(folder, "file")
    try:
        first_height(folder, program)
        assert False, "wrote the bake of another state"
    except ValueError as error:
        assert "no complete bake" in str(error)
    bake = from_here(program, folder, 5)
    assert any(NO_RECORDING in line for line in lines(bake.shot)), lines(bake.shot)


def test_names(program, folder):
    """Scenes whose names differ in letters that files cannot have, and very long names, have files of their own."""
    scene = empty(last=4)
    paths = set()
    for name in ("Shot 1", "Shot_1", "Shot.1", "场景" * 40, "场景" * 41, "S" * 250, 'a/b\\"c"%'):
        scene.name = name
        paths.add(cache.whole_of(scene, folder))
    assert len(paths) == 7 and all(len(path.name.encode()) < 160 for path in paths), paths
    scene.name = "场景" * 41
    names = ["ж" * 100 + "/\\\"'.%\n\tx", "a.b/c", "a.b c", "$(HOME)"]
    for i, name in enumerate(names):
        block(name, (3 * i, 0, 3))
    constrain("FIXED", *(bpy.data.objects[name] for name in names[:2]), name="joint 'a/b\"")
    run, document, _ = full_bake(program, folder, baking.Options(contacts=True))
    assert [body["name"] for body in document["bodies"]] == names and len(run.keys.taken) == 4
    assert len(document["joints"]) == 1
    stages.write_stage(program, folder, scene, folder / "stage.usda")


def test_folders(program, folder):
    """Cache folders may begin with ~ or be empty; one that cannot be made is told by its path."""
    scene = empty(last=4)
    home = os.environ.get("HOME")
    os.environ["HOME"] = str(folder)
    try:
        assert cache.folder_of("~/bakes") == folder / "bakes"
    finally:
        os.environ["HOME"] = home
    (folder / "file").write_text("")
    try:
        cache.folder_of(str(folder / "file"))
        assert False, "made a folder of a file"
    except ValueError as error:
        assert str(folder / "file") in str(error) and "Errno" not in str(error), error


def test_lost_program(program, folder):
    """A bake whose program dies keeps its frames and can be resumed; without its files it is baked anew."""
    heap(200, 100)
    bake = baking.Bake(bpy.context, program, LONG, folder)
    midway(bake)
    time.sleep(0.2)
    os.kill(bake.process._process.pid, signal.SIGKILL)
    try:
        bake.finish()
        assert False, "ended well"
    except ValueError as error:
        assert re.search(rf"code -9; baked up to frame {bake.keys.frames}: Resume goes on$", str(error)), error
    assert bake.is_stopped and bake.keys.frames > 1
    again = baking.Bake(bpy.context, program, LONG, folder, resume=True)
    assert again.resume and again.finish()[0] == "200 bodies baked" and not again.is_stopped
    last = baking.Bake(bpy.context, program, baking.Options(is_preview=True), folder, resume=True)
    said = last.finish()
    assert said[:2] == ["200 bodies baked", "no files of the stopped bake: baked from the first frame"], said


def test_resume_after_a_crash(_program, folder):
    """The panel offers to go on with a bake whose files are there, as after a crash or a restart."""
    import drystone

    drystone.register()
    try:
        scene, _ = saved(folder, "file", 3)
        assert "Resume" not in drawn(panel.Main)
        journal = cache.journal_of(cache.whole_of(scene, cache.folder_of(scene.drystone.cache)))
        journal.write_bytes(b"frames")
        assert "Resume" in drawn(panel.Main)
        scene.name = "another"
        assert "Resume" not in drawn(panel.Main)
    finally:
        drystone.unregister()


def test_stages_have_frames_of_the_scene(program, folder):
    """Time codes of a stage are frames of the scene, at its rate, whatever the speed of the world."""
    for here in (False, True):
        scene = empty(last=110)
        scene.frame_start, scene.render.fps_base, scene.rigidbody_world.time_scale = 101, 1.001, 0.5
        floor = block("floor", (0, 0, -0.5), "PASSIVE", use_deform=True, mesh_source="DEFORM")
        floor.rigid_body.collision_shape = "MESH"
        floor.shape_key_add(name="Basis")
        key = floor.shape_key_add(name="up")
        for point in key.data:
            point.co.z += 1
        for frame, value in ((101, 0), (110, 1)):
            key.value = value
            key.keyframe_insert("value", frame=frame)
        belt = block("belt", (9, 0, 3), "PASSIVE", kinematic=True)
        for frame, x in ((101, 9), (110, 18)):
            belt.location.x = x
            belt.keyframe_insert("location", frame=frame)
        crate = block("crate", (0, 0, 3))
        full_bake(program, folder)
        if here:
            from_here(program, folder, 105)
        stages.write_stage(program, folder, scene, folder / "stage.usda")
        text = (folder / "stage.usda").read_text()
        codes = dict(re.findall(r"(\w+Code|timeCodesPerSecond) = (\S+)", text))
        assert codes.pop("timeCodesPerSecond")[:6] == "23.976", codes
        assert codes == {"startTimeCode": "101", "endTimeCode": "110"}, codes
        samples = re.findall(r"(\w+)(?::\w+)*\.timeSamples = \{ (.*?)\s*,?\s*\}\n", text, re.DOTALL)
        frames = {name: [int(frame) for frame in re.findall(r"(\d+): [(\[]", keys)] for name, keys in samples}
        assert frames and all(found[0] == 101 and found[-1] == 110 for found in frames.values()), frames
        assert "points" in frames, frames
        assert heights(crate, 101)[0] == 3


def test_refused_without_bodies(_program, folder):
    """A scene whose bodies are all left out says why."""
    empty(last=4)
    thing = block("crate", (0, 0, 3))
    bpy.context.scene.rigidbody_world.collection.objects.unlink(thing)
    try:
        export(Path(folder) / "scene.json")
        assert False, "exported nothing"
    except ValueError as error:
        assert "outside of the rigid body world's collection" in str(error) and "'crate'" in str(error), error


def test_bounciness_above_one(program, folder):
    """A bounciness above 1, which Drystone refuses, is 1 and told; the body is baked."""
    empty(last=10)
    block("trampoline", (0, 0, -0.5), "PASSIVE", restitution=1.5)
    crate = block("crate", (0, 0, 1), restitution=0.5)
    run, document, _ = full_bake(program, folder)
    assert [body["restitution"] for body in document["bodies"]] == [1.0, 0.5] and len(run.keys.taken) == 1
    assert "1 object with a bounciness above 1: of 1: 'trampoline'" in lines(run.shot), lines(run.shot)
    assert np.isfinite(crate.location).all()


def test_unreadable_files(program, folder):
    """A file that is cut, empty or of another kind is told in a sentence; a bake goes on without it."""
    import drystone

    drystone.register()
    own, operators.preference = operators.preference, lambda _context: program
    try:
        scene = empty(last=10)
        block("crate", (0, 0, 3))
        run, _, _ = full_bake(program, folder)
        data = run.whole.read_bytes()
        broken = {"cut.npz": data[:len(data) // 2], "nothing.npz": b"", "text.npz": b"text"}
        for name, content in broken.items():
            (folder / name).write_bytes(content)
        np.save(folder / "single.npy", np.zeros(3))
        np.savez(folder / "other.npz", a=np.zeros(3))
        np.savez(folder / "none.npz", poses=np.zeros((0, 1, 7)), names=np.array(["crate"]), times=np.zeros(0))
        for name in (*broken, "single.npy", "other.npz", "none.npz", "missing.npz"):
            try:
                bpy.ops.drystone.apply_bake(filepath=str(folder / name))
                assert False, name
            except RuntimeError as error:
                assert "Traceback" not in str(error) and name in str(error), error
        scene.frame_set(5)
        for content in broken.values():
            run.whole.write_bytes(content)
            cache.forget(scene)
            bake = from_here(program, folder, 5)
            assert any(NO_RECORDING in line for line in lines(bake.shot)), lines(bake.shot)
            run.whole.write_bytes(content)
            try:
                stages.write_stage(program, folder, scene, folder / "stage.usda")
                assert False, "wrote a stage"
            except ValueError:
                pass
    finally:
        operators.preference = own
        drystone.unregister()


def test_paths_beside_the_file(program, folder):
    """Paths that begin with // are beside the file, as everywhere in Blender."""
    import drystone

    drystone.register()
    own, operators.preference = operators.preference, lambda _context: program
    try:
        saved(folder, "file", 3)
        assert bpy.ops.drystone.bake() == {"FINISHED"}
        assert bpy.ops.drystone.export_scene(filepath="//scene.json") == {"FINISHED"}
        assert bpy.ops.drystone.export_bake(filepath="//bake.usda") == {"FINISHED"}
        assert {"scene.json", "bake.usda", "drystone_cache"} <= {path.name for path in folder.iterdir()}
        assert bpy.ops.drystone.apply_bake(filepath="//drystone_cache/file-Scene.npz") == {"FINISHED"}
    finally:
        operators.preference = own
        drystone.unregister()
