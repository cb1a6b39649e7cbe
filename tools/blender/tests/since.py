"""Tests of what changes since a bake beside keys, and of scenes that baked objects leave."""

import bpy
import drystone
import numpy as np
from drystone import applying, baking, operators

from .common import PLACE, block, differences, empty, full_bake, lines
from .passive import exported


def test_uneven_parent_deleted(program, folder):
    """Without its uneven parent, deleted while it was baked, an object has its own scale again, also in a next bake."""
    for bakes in (1, 2):
        scene = empty(last=12)
        parent = bpy.data.objects.new("uneven", None)
        scene.collection.objects.link(parent)
        parent.scale = (3, 1, 1)
        crate = block("crate", (0, 0, 5))
        crate.parent, crate.scale = parent, (1, 2, 1)
        full_bake(program, folder)
        assert np.allclose(crate.scale, (3, 2, 1)) and not crate.parent
        bpy.data.objects.remove(parent)
        exported()
        assert np.allclose(crate.scale, (3, 2, 1)), "a check changes nothing"
        for _ in range(bakes - 1):
            _, document, poses = full_bake(program, folder)
            assert np.allclose(crate.scale, (1, 2, 1)) and differences(document, poses)[0] < PLACE
        applying.delete_bake(scene)
        assert np.allclose(crate.scale, (1, 2, 1)) and np.allclose(crate.location, (0, 0, 5)) and not crate.parent


def in_panel(program, work):
    """Does work with the operators of the add-on."""
    drystone.register()
    own, operators.preference = operators.preference, lambda _context: program
    try:
        work()
    finally:
        operators.preference = own
        drystone.unregister()


def test_own_property(program, folder):
    """Properties of users that are called as those of bakes come back, on objects and on actions."""
    values = {"number": 1, "text": "mine", "list": [1, 2, 3], "group": {"a": 1}, "none": None}
    for kind, value in values.items():
        scene = empty(last=6)
        crate = block("crate", (0, 0, 3))
        crate.keyframe_insert("scale", frame=1)
        if value is not None:
            crate["drystone"] = crate.animation_data.action["drystone"] = value
        spare = bpy.data.actions.new("spare")
        spare["drystone"] = 1
        exported()
        for _ in range(2):
            _, document, poses = full_bake(program, folder)
            assert differences(document, poses)[0] < PLACE
        applying.delete_bake(scene)
        for owner in (crate, crate.animation_data.action):
            found = owner.get("drystone")
            plain = found.to_dict() if kind == "group" else list(found) if kind == "list" else found
            assert plain == value and type(plain) is type(value), (kind, plain)
        assert set(bpy.data.actions) == {spare, crate.animation_data.action}
        assert applying.delete_bake(scene) == 0


def moved(thing, scene):
    """Moves an object to a scene alone."""
    for collection in thing.users_collection:
        collection.objects.unlink(thing)
    scene.collection.objects.link(thing)
    return thing


def second_scene(*things):
    """A scene with a world of its own that simulates some objects."""
    other = bpy.data.scenes.new("Other")
    other.frame_end = bpy.context.scene.frame_end
    bpy.context.window.scene = other
    bpy.ops.rigidbody.world_add()
    block("own", (0, 9, 3))
    for thing in things:
        other.rigidbody_world.collection.objects.link(thing)
    return other


def test_moved_to_another_scene(program, folder):
    """Delete Bake restores the objects of a bake in whatever scene they are, and those of no other bake."""
    def work():
        for has_world in (False, True):
            scene = empty(last=6)
            crate, gone = block("crate", (0, 0, 3)), block("gone", (5, 0, 3))
            scene.drystone.cache = str(folder)
            assert bpy.ops.drystone.bake() == {"FINISHED"}
            other = second_scene() if has_world else bpy.data.scenes.new("Other")
            moved(gone, other)
            bpy.context.window.scene = other
            if has_world:
                other.drystone.cache = str(folder)
                assert bpy.ops.drystone.bake() == {"FINISHED"} and "drystone" in other.objects["own"]
            bpy.context.window.scene = scene
            bpy.ops.drystone.delete_bake()
            assert not any("drystone" in thing or thing.rigid_body.kinematic for thing in (crate, gone))
            assert not has_world or "drystone" in other.objects["own"]
            assert scene.drystone.said == "" and not bpy.ops.drystone.delete_bake.poll()

    in_panel(program, work)


def test_deleted_scene(program, folder):
    """Objects whose scene was deleted are named, and restored where they are."""
    def work():
        scene = empty(last=6)
        gone = block("gone", (5, 0, 3))
        scene.drystone.cache = str(folder)
        bpy.ops.drystone.bake()
        other, third = second_scene(), bpy.data.scenes.new("Third")
        moved(gone, third)
        bpy.data.scenes.remove(scene)
        other.drystone.cache = str(folder)
        bpy.ops.drystone.bake()
        bpy.ops.drystone.delete_bake()
        assert other.drystone.said == "1 baked object in other scenes alone: delete the bake there: 'gone'"
        bpy.context.window.scene = third
        bpy.ops.drystone.delete_bake()
        assert "drystone" not in gone and not gone.rigid_body.kinematic and third.drystone.said == ""

    in_panel(program, work)


def test_shared_by_two_scenes(program, folder):
    """A scene that shows objects of another scene's bake leaves them; one that simulates them, too, says so."""
    def work():
        scene = empty(last=6)
        shown, shared = block("shown", (0, 0, 3)), block("shared", (5, 0, 3))
        scene.drystone.cache = str(folder)
        bpy.ops.drystone.bake()
        keys = [thing.animation_data.action for thing in (shown, shared)]
        other = second_scene()
        for thing in (shown, shared):
            other.collection.objects.link(thing)
        other.drystone.cache = str(folder)
        for do in (bpy.ops.drystone.bake, bpy.ops.drystone.delete_bake):
            assert do() == {"FINISHED"}
            assert [thing.animation_data.action for thing in (shown, shared)] == keys, do
        assert not bpy.ops.drystone.delete_bake.poll()
        other.rigidbody_world.collection.objects.link(shared)
        run, document, _ = full_bake(program, folder)
        told = "1 object baked in another scene: without that bake once it is baked here: 'shared'"
        assert told in lines(run.shot), lines(run.shot)
        place = next(body["position"] for body in document["bodies"] if body["name"] == "shared")
        assert document["bodies"][-1]["motion"] == "dynamic" and np.allclose(place, (5, 3, 0)), document["bodies"]
        bpy.context.window.scene = scene
        bpy.ops.drystone.delete_bake()
        assert "drystone" not in shown and "drystone" in shared

    in_panel(program, work)


def test_nothing_selected(program, folder):
    """A bake of nothing leaves nothing in the scene that Delete Bake could not remove."""
    def work():
        scene = empty(last=6)
        crate = block("crate", (0, 0, 3))
        scene.drystone.cache, scene.drystone.only_selected = str(folder), True
        crate.select_set(False)
        before = sorted(scene.keys())
        bpy.ops.drystone.bake()
        assert scene.drystone.said.startswith("0 bodies baked") and not bpy.ops.drystone.delete_bake.poll()
        assert sorted(scene.keys()) == before, sorted(scene.keys())

    in_panel(program, work)


def test_subframe(program, folder):
    """The time within a frame stays through a check, a bake, one from there, and a deleted one."""
    def work():
        scene = empty(last=12)
        block("crate", (0, 0, 3))
        scene.drystone.cache = str(folder)
        scene.frame_set(5, subframe=0.5)
        for do in (ops.check, ops.bake, ops.bake_from, ops.delete_bake):
            assert do() == {"FINISHED"}
            assert scene.frame_current_final == 5.5, do

    ops = bpy.ops.drystone
    in_panel(program, work)


def test_from_between_frames(program, folder):
    """A bake from between two frames is one from the first of them; a move by hand there counts."""
    def heights(moved):
        scene = empty(last=12)
        crate = block("crate", (0, 0, 3))
        full_bake(program, folder)
        scene.frame_set(6, subframe=0.5)
        crate.location.z += moved
        run = baking.Bake(bpy.context, program, baking.Options(), folder, from_here=True)
        run.finish()
        assert lines(run.shot) == [] and scene.frame_current_final == 6.5, lines(run.shot)
        found = []
        for frame in range(1, 13):
            scene.frame_set(frame)
            found.append(crate.location.z)
        return np.array(found)

    fall = 3 - 9.81 / 2 * (np.arange(12) / 24)**2
    assert np.abs(heights(0) - fall).max() < 1e-3
    assert np.abs(heights(7)[:5] - fall[:5]).max() < 1e-3 and heights(7)[5] > fall[5] + 6
