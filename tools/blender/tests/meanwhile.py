"""Tests of scenes that change while a bake runs: names, objects, parents and scenes."""

import time
from types import SimpleNamespace

import bpy
import numpy as np
from drystone import applying, baking, cutting, operators, originals
from drystone.curves import curves_of

from .common import DOWN, LONG, block, full_bake, heap, midway, stage
from .pieces import bracket


def begun(program, folder, options=baking.Options()):
    bake = baking.Bake(bpy.context, program, options, folder)
    bake.poll()
    return bake


def swap(first, second):
    """Exchanges the names of two objects."""
    name, other = first.name, second.name
    first.name = "meanwhile"
    second.name, first.name = name, other


def end_of(thing):
    """Returns the location that the last key of an object has."""
    return np.array([curve.keyframe_points[-1].co.y for curve in curves_of(thing) if curve.data_path == "location"])


def steps_of(bake):
    """Goes on with a bake; yields after each step of work, and none while a program runs."""
    while True:
        bake.keys.refresh()
        was_running = bake.process and bake.process.is_running()
        try:
            next(bake._steps)
        except StopIteration:
            return
        if was_running:
            time.sleep(0.005)
        else:
            yield


def test_renamed(program, folder):
    """Objects that are renamed, or exchange their names, keep their own keys; nobody else gets these."""
    scene = stage(DOWN, 12)
    near, far = block("near", (0, 0, 3)), block("far", (20, 0, 9))
    other = bpy.data.objects.new("other", None)
    scene.collection.objects.link(other)
    bake = begun(program, folder)
    swap(near, far)
    bake.finish()
    assert bake.said[0] == "2 bodies baked" and not any("gone" in line for line in bake.said), bake.said
    assert abs(end_of(near)[0]) < 1e-3 and abs(end_of(far)[0] - 20) < 1e-3
    applying.delete_bake(scene)
    assert np.allclose(near.location, (0, 0, 3)) and np.allclose(far.location, (20, 0, 9))
    bake = begun(program, folder)
    near.name = "renamed"
    other.name = "far"
    assert "far" in bpy.data.objects and other.name == "far"
    bake.finish()
    assert bake.said[0] == "2 bodies baked" and not originals.is_baked(other) and other.animation_data is None
    assert abs(end_of(near)[0]) < 1e-3 and not any("gone" in line for line in bake.said)


def test_renamed_between_looks(program, folder):
    """Names change between two looks at a long bake."""
    scene = heap(60, 100)
    bake = baking.Bake(bpy.context, program, LONG, folder)
    midway(bake)
    while bake.process.is_running() and not bake.keys.frames:
        assert bake.poll()
    for i, thing in enumerate(scene.objects[1:]):
        thing.name = f"stone {i}"
    bake.finish()
    assert bake.said[0] == "60 bodies baked" and len(bake.said) == 2, bake.said
    stones = [thing for thing in scene.objects if thing.name.startswith("stone")]
    assert {len(curve.keyframe_points) for thing in stones for curve in curves_of(thing)} == {100}


def test_kept_and_renamed(program, folder):
    """An object that keeps the keys of its bake keeps them under another name."""
    scene = stage(DOWN, 12)
    near, far = block("near", (0, 0, 3)), block("far", (20, 0, 9))
    full_bake(program, folder)
    for thing in (near, far):
        thing.select_set(thing == near)
    bake = begun(program, folder, baking.Options(only_selected=True))
    far.name = "kept"
    bake.finish()
    assert originals.is_baked(far) and len(curves_of(far)) == 7
    scene.frame_set(12)
    assert far.matrix_world.translation.z < 8.9


def test_deleted(program, folder):
    """Objects deleted at any time of a bake are named as gone, and the others get their keys."""
    for at in range(1, 8):
        scene = stage(DOWN, 12)
        for i in range(-1, 3):
            block(f"crate {i}", (5 * i, 0, 3))
        full_bake(program, folder)
        scene.objects["crate -1"].rigid_body.type = "PASSIVE"
        scene.objects["crate 0"].rigid_body.type = "PASSIVE"
        bake = baking.Bake(bpy.context, program, baking.Options(), folder)
        for _ in steps_of(bake):
            at -= 1
            if at == 0:
                for name in ("crate 0", "crate 1"):
                    bpy.data.objects.remove(bpy.data.objects[name])
        assert at <= 0 and "'crate 1' is gone" in bake.said and len(bake.said) <= 4, bake.said
        assert len(curves_of(bpy.data.objects["crate 2"])) == 7


def test_deleted_as_keys_are_shown(program, folder):
    """An object that goes away between its keys and their display is left out."""
    for how in ("deleted", "cleared"):
        scene = stage(DOWN, 12)
        crate, other = block("crate", (0, 0, 3)), block("other", (5, 0, 3))
        bake = baking.Bake(bpy.context, program, baking.Options(), folder)
        channels = bake.shot.channels
        names, frames = list(channels), np.arange(3)
        poses = np.tile(np.float32([0, 1, 0, 0, 0, 0, 1]), (3, 2, 1))
        steps = bake.keys.write(names, frames, poses)
        for step in steps:
            if step is applying.WAITING and crate and originals.is_baked(crate) and crate.animation_data \
                    and crate.animation_data.action:
                if how == "deleted":
                    bpy.data.objects.remove(crate)
                else:
                    crate.animation_data_clear()
                crate = None
            bake.keys.refresh()
        assert crate is None and len(curves_of(other)) == 7 and scene, how
        bake.cancel()


def test_reparented(program, folder):
    """A body that gets another parent during its bake is named, since its keys are below the old one."""
    scene = stage(DOWN, 12)
    holder = bpy.data.objects.new("holder", None)
    scene.collection.objects.link(holder)
    holder.location = (3, 0, 0)
    block("crate", (0, 0, 3)).parent = holder
    block("other", (9, 0, 3))
    bpy.context.view_layer.update()
    bake = begun(program, folder)
    bpy.data.objects.remove(holder)
    bake.finish()
    assert bake.said[-1] == "'crate' has another parent than at the start of the bake: bake again", bake.said
    assert not any("other" in line.split(" ")[0] for line in bake.said)


def test_deleted_scene(program, folder):
    """A bake whose scene is deleted ends with one sentence, and its program stops."""
    for options in (baking.Options(), LONG):
        heap(200, 100)
        bake = baking.Bake(bpy.context, program, options, folder)
        if options is LONG:
            midway(bake)
        else:
            bake.poll(0)
        scene = bpy.context.scene
        bpy.data.scenes.new("other")
        bpy.data.scenes.remove(scene)
        assert not bake.poll() and bake.error == "The scene was deleted: the work on it has ended.", bake.error
        assert not bake.process or bake.process.result()[0] != 0


def test_deleted_scene_in_a_window(program, folder):
    """The operator ends with the sentence and without an exception."""
    import drystone

    drystone.register()
    try:
        heap(60, 100)
        said = []
        operator = SimpleNamespace(report=lambda kind, text: said.append((kind, text)))
        for name in ("show", "_end"):
            setattr(operator, name, getattr(operators.Baking, name).__get__(operator))
        work = operators.running = baking.Bake(bpy.context, program, LONG, folder)
        bpy.data.scenes.new("other")
        bpy.data.scenes.remove(bpy.context.scene)
        while work.poll():
            pass
        context = SimpleNamespace(scene=bpy.context.scene, screen=None, workspace=None)
        assert operator._end(context) == {"CANCELLED"} and operators.running is None
        assert said == [({"ERROR"}, "The scene was deleted: the work on it has ended.")], said
    finally:
        operators.running = None
        drystone.unregister()


def test_pieces_of_renamed(program, folder):
    """Pieces are shown over the objects that they are of."""
    stage(DOWN, 12)
    first, second = bracket("first"), bracket("second", (5, 0, 0))
    work = cutting.Cutting(bpy.context, program, baking.Options(), folder)
    swap(first, second)
    bpy.data.objects.remove(second)
    work.finish()
    assert [child.name for child in first.children] == ["second pieces"], list(bpy.data.objects)


def test_window_closed(program, folder):
    """A bake whose window is closed stops, and another one can begin."""
    import drystone

    drystone.register()
    try:
        scene = heap(60, 100)
        work = operators.running = baking.Bake(bpy.context, program, LONG, folder)
        midway(work)
        assert not bpy.ops.drystone.apply_bake.poll() and not bpy.ops.drystone.bake.poll()
        window = SimpleNamespace(event_timer_remove=lambda timer: None)
        operators.Baking.cancel(SimpleNamespace(_timer=1), SimpleNamespace(window_manager=window))
        assert operators.running is None and work.process.result()[0] != 0 and scene
        assert bpy.ops.drystone.bake.poll()
    finally:
        operators.running = None
        drystone.unregister()


def test_unexpected_error(program, folder):
    """An error that nobody has foreseen ends a bake with a sentence."""
    stage(DOWN, 12)
    block("crate", (0, 0, 3))
    bake = baking.Bake(bpy.context, program, baking.Options(), folder)
    bake.keys.channels = None
    while bake.poll():
        time.sleep(0.005)
    assert bake.error.startswith("An error of the add-on ended the work (TypeError: "), bake.error


def test_rotation_keys_removed(program, folder):
    """Bodies that lost keys of their rotation since a bake can be baked from a frame on."""
    scene = stage(DOWN, 24)
    crate = block("crate", (0, 0, 30))
    full_bake(program, folder)
    for curve in curves_of(crate):
        if curve.data_path == "rotation_quaternion" and curve.array_index:
            bag_of(crate).remove(curve)
    scene.frame_set(12)
    bake = baking.Bake(bpy.context, program, baking.Options(), folder, from_here=True)
    bake.finish()
    assert bake.said[0] == "1 body baked" and len(curves_of(crate)) == 7, bake.said


def bag_of(thing):
    """Returns the F-curves of an object, to be changed."""
    data = thing.animation_data
    return data.action.layers[0].strips[0].channelbag(data.action_slot).fcurves


def test_unexpected_error_at_the_start(program, folder):
    """An error that nobody has foreseen, before a bake begins, is told in a sentence; the next bake can begin."""
    import drystone

    drystone.register()
    own, preference, operators.preference = operators.Bake, operators.preference, lambda _context: program
    try:
        stage(DOWN, 6)
        block("crate", (0, 0, 3))
        bpy.context.scene.drystone.cache = str(folder)
        operators.Bake = lambda *_: 1 / 0
        try:
            bpy.ops.drystone.bake()
            assert False, "no error"
        except RuntimeError as error:
            assert "An error of the add-on ended the work (ZeroDivisionError: " in str(error), error
        operators.Bake = own
        assert bpy.ops.drystone.bake() == {"FINISHED"}
    finally:
        operators.Bake, operators.preference = own, preference
        drystone.unregister()
