"""Tests of keys: what other keys an object keeps, where odd objects are shown, and how a bake is deleted."""

import math

import bpy
import numpy as np
from drystone import applying, baking, exporting, originals
from drystone.curves import all_of, channelbags, curves_of
from drystone.space import rigid
from mathutils import Matrix

from .common import UP, add, axes, cube, empty, export, full_bake, lines

# Largest distance of a shown body from its bake. [m], [rad]
PLACE, TURN = 1e-5, 1e-4


def off_bake(run, poses, names=None):
    """Returns how far Blender shows bodies from a bake, over all frames. [m], [rad]"""
    scene = bpy.context.scene
    bodies = [body["name"] for body in run.shot.document["bodies"]]
    place = turn = 0.0
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        for i, name in enumerate(bodies):
            if names is None and name not in run.shot.channels or names and name not in names:
                continue
            shown = np.array(rigid(scene.objects[name]))
            wanted = poses[frame - scene.frame_start, i].astype(float)
            place = max(place, np.abs(shown[:3, 3] - UP @ wanted[:3]).max())
            x, y, z, w = wanted[3:]
            apart = shown[:3, :3] - UP @ axes(w, x, y, z) @ UP.T
            turn = max(turn, np.linalg.norm(apart) / math.sqrt(2))
    return place, turn


def tilted(name, place, **more):
    """An active crate that starts askew."""
    thing = add(cube(0.6, place), "ACTIVE", "BOX", name)
    thing.rotation_euler = (0.4, 0.3, 0.2)
    for key, value in more.items():
        setattr(thing, key, value)
    return thing


def holder(name, kind=None, **more):
    """An empty to be a parent."""
    thing = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(thing)
    for key, value in more.items():
        setattr(thing, key, value)
    return thing


def ground():
    return add(lambda: bpy.ops.mesh.primitive_plane_add(size=60), "PASSIVE", "BOX", "ground")


def keyed(thing, path, *values, index=-1):
    """Keys a property at frames 1, 20, 40, ..."""
    for i, value in enumerate(values):
        setattr(thing, path, value)
        thing.keyframe_insert(path, index=index, frame=max(1, 20 * i))


def odd_things():
    """Objects whose channels differ from the pose of their body, each in another way."""
    tilted("mirrored", (0, 0, 2), scale=(-1, 1.2, 0.7))
    tilted("mirrored twice", (2, 0, 2), scale=(-1, -0.5, 0.7))
    tilted("deltas", (4, 0, 1.5), delta_location=(0.1, 0.2, 0.5), delta_rotation_euler=(0.1, 0.5, 0.2),
           delta_scale=(1, 2, 1), delta_rotation_quaternion=(0.9, 0.1, 0.3, 0.2))
    tilted("axis and angle", (6, 0, 2), rotation_mode="AXIS_ANGLE").rotation_axis_angle = (0.7, 0.3, 0.2, 0.5)
    tilted("quaternion", (8, 0, 2), rotation_mode="QUATERNION").rotation_quaternion = (0.7, 0.3, 0.2, 0.5)
    arm = holder("arm")
    keyed(arm, "location", (0, 4, 0), (1, 5, 1), (4, 4, 0))
    keyed(arm, "rotation_euler", (0, 0, 0), (1, 0, 2), (0, 1, 0.3))
    tilted("below an animated one", (0, 0, 2)).parent = arm
    big = holder("big", scale=(2, 2, 2), rotation_euler=(0.3, 0, 0))
    tilted("below a large one", (1, 4, 1)).parent = big
    carrier = tilted("carrier", (-4, 0, 2), scale=(0.5, 1, 2))
    carrier.scale = (1.5, 1.5, 1.5)
    between = holder("between", location=(0.3, 0.2, 0.1), rotation_euler=(0.5, 0.1, 0), parent=carrier)
    tilted("carried", (0, 0, 1.5)).parent = between
    platform = add(cube(2, (0, -8, 0)), "PASSIVE", "BOX", "platform", kinematic=True)
    keyed(platform, "location", (0, -8, 0), (2, -8, 0.5), (4, -9, 0))
    tilted("rider", (0.2, 0.1, 2)).parent = platform
    tilted("child", (0, 0, 1.2)).parent = carrier
    driven = tilted("driven", (-6, 0, 2))
    driver = driven.driver_add("location", 0).driver
    driver.type, driver.expression = "SCRIPTED", "-6 + frame / 100"
    target = holder("target", location=(-8, 3, 3))
    tied = tilted("constrained", (-8, 0, 2))
    of = tied.constraints.new("COPY_LOCATION")
    of.target, of.influence = target, 0.5
    keyed(of, "influence", 0.5, 1.0)
    keyed(tilted("moving deltas", (-10, 0, 2)), "delta_location", (0, 0, 0), (1, 1, 1))


def rigged():
    """An object below a bone, one below a vertex, and one whose keys are in an NLA strip."""
    armature = bpy.data.objects.new("rig", bpy.data.armatures.new("rig"))
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bone = armature.data.edit_bones.new("bone")
    bone.head, bone.tail = (0, 12, 0), (0.3, 12, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    bone = armature.pose.bones["bone"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((1, 0), (30, 1)):
        bone.rotation_euler = (angle, 0.2, 0)
        bone.keyframe_insert("rotation_euler", frame=frame)
    below = tilted("below a bone", (0.5, 0.5, 1))
    below.parent, below.parent_type, below.parent_bone = armature, "BONE", "bone"
    mesh = bpy.data.objects.new("mesh", bpy.data.meshes["Cube"])
    bpy.context.scene.collection.objects.link(mesh)
    keyed(mesh, "location", (5, 12, 0), (5, 14, 1))
    below = tilted("below a vertex", (0.5, 0.5, 1))
    below.parent, below.parent_type, below.parent_vertices = mesh, "VERTEX", (3, 3, 3)
    thing = tilted("in a strip", (10, 12, 2))
    keyed(thing, "location", (10, 12, 2), (12, 12, 4))
    keyed(thing, "rotation_euler", (0, 0, 1), (1, 1, 1))
    pushed_down(thing)


def pushed_down(thing):
    """Makes the action of an object a strip; returns its track."""
    data = thing.animation_data
    action, slot, track = data.action, data.action_slot, data.nla_tracks.new()
    track.strips.new("strip", 1, action).action_slot = slot
    data.action = None
    return track


def test_rigs(program, folder):
    """Objects below bones and vertices, and of NLA strips, are shown where the bake says, and restored."""
    scene = empty(last=30)
    ground()
    rigged()
    scene.frame_set(1)
    active = [thing for thing in scene.objects if thing.rigid_body and thing.rigid_body.type == "ACTIVE"]
    before = {thing.name: state(thing) for thing in active}
    run, _, poses = full_bake(program, folder)
    place, turn = off_bake(run, poses)
    print(f"keys: {len(active)} objects of rigs are off by {place:.1e} m and {turn:.1e} rad")
    assert place < PLACE and turn < TURN and len(active) == 3
    applying.delete_bake(scene)
    scene.frame_set(1)
    assert {thing.name: state(thing) for thing in active} == before


def test_odd_objects(program, folder):
    """Mirrored, below parents, driven, constrained: shown where the bake says, at each frame."""
    empty(last=40)
    ground()
    odd_things()
    bpy.context.view_layer.update()
    run, document, poses = full_bake(program, folder)
    assert len(run.shot.channels) == 14, sorted(run.shot.channels)
    place, turn = off_bake(run, poses)
    print(f"keys: 14 odd objects are off by {place:.1e} m and {turn:.1e} rad")
    assert place < PLACE and turn < TURN
    for line in ("1 object with object constraints: off while baked: 'constrained'",
                 "3 objects below another body or an uneven parent: without a parent while baked: 'carried', "
                 "'rider', 'child'"):
        assert line in lines(run.shot), lines(run.shot)
    # The second bake starts from the same places.
    shot = export(folder / "again.json")
    again = shot.document
    said = [of.sentence() for of in run.shot.findings if of.kind != "PROBLEM"]
    assert lines(shot) == said, (lines(shot), said)
    for one, other in zip(document["bodies"], again["bodies"]):
        assert np.allclose(one["position"], other["position"], atol=1e-6), one["name"]
        assert np.allclose(one["rotation"], other["rotation"], atol=1e-6), one["name"]


def test_shear_is_told(program, folder):
    """A sheared body is where it should be, but cannot be turned exactly; below other uneven parents it is."""
    empty(last=20)
    ground()
    squashed = holder("squashed", scale=(1, 2, 0.5), rotation_euler=(0, 0, 0.3))
    tilted("sheared", (1, 0, 1)).parent = squashed
    tilted("upright", (4, 0, 5), rotation_euler=(0, 0, 0), scale=(-1, 1, 2)).parent = squashed
    grown = tilted("below a growing one", (8, 0, 2))
    grown.parent = holder("growing")
    keyed(grown.parent, "scale", (1, 1, 1), (2, 2, 2))
    bpy.context.view_layer.update()
    start = np.array(bpy.data.objects["upright"].matrix_world)
    run, _, poses = full_bake(program, folder)
    for line in ("1 object sheared by a parent: turned approximately: 'sheared'",
                 "2 objects below another body or an uneven parent: without a parent while baked: 'upright', "
                 "'below a growing one'"):
        assert line in lines(run.shot), lines(run.shot)
    place, turn = off_bake(run, poses, ["sheared"])
    print(f"keys: a sheared object is off by {place:.1e} m and {turn:.1e} rad")
    assert place < PLACE
    place, turn = off_bake(run, poses, ["upright", "below a growing one"])
    assert place < PLACE and turn < TURN, (place, turn)
    applying.delete_bake(bpy.context.scene)
    bpy.context.scene.frame_set(1)
    assert np.allclose(bpy.data.objects["upright"].matrix_world, start, atol=1e-6)


def tracks(thing):
    """Tracks of an object, with the actions and the frames of their strips."""
    data = thing.animation_data
    return [(track.name, track.mute, track.is_solo,
             [(strip.name, strip.action.name, strip.action_slot_handle, strip.frame_start, strip.frame_end)
              for strip in track.strips]) for track in (data.nla_tracks if data else [])]


def state(thing):
    """All that a bake may change of an object."""
    data = thing.animation_data
    return {"values": [list(getattr(thing, key)) if key != "rotation_mode" else getattr(thing, key)
                       for key in originals.VALUES],
            "kinematic": thing.rigid_body.kinematic,
            "constraints": [of.enabled for of in thing.constraints],
            "tracks": tracks(thing),
            "drivers": [of.mute for of in data.drivers] if data else None,
            "action": data and data.action and data.action.name,
            "slot": data and data.action_slot and data.action_slot.identifier,
            "blending": data and (data.action_blend_type, data.action_influence),
            "curves": [(curve.data_path, curve.array_index, [tuple(point.co) for point in curve.keyframe_points])
                       for curve in curves_of(thing)],
            "parent": (thing.parent and thing.parent.name, thing.parent_type),
            "inverse": [list(row) for row in thing.matrix_parent_inverse],
            "scale": list(thing.scale), "properties": sorted(thing.keys())}


def test_other_keys_stay(program, folder):
    """Scale, visibility and custom properties keep their keys; deleting the bake restores everything."""
    scene = empty(last=40)
    ground()
    odd_things()
    places = {"plain": -4, "shared": -6, "own": -8, "blended": -10}
    things = [tilted(name, (0, y, 2)) for name, y in places.items()]
    for thing in things[1:]:
        keyed(thing, "scale", (1, 1, 1), (1, 1, 2))
        keyed(thing, "hide_render", False, True)
        thing["glow"] = 1.0
        for frame, value in ((1, 1.0), (20, 5.0)):
            thing["glow"] = value
            thing.keyframe_insert('["glow"]', frame=frame)
    keyed(things[2], "location", (0, -8, 2), (0, -8, 9))
    things[2]["x" * 60] = 1.0
    things[2].driver_add(f'["{"x" * 60}"]').driver.expression = "frame"
    # Two objects of one action and one slot.
    data = things[1].animation_data
    own = things[0].animation_data_create()
    own.action, own.action_slot = data.action, data.action_slot
    things[3].animation_data.action_blend_type, things[3].animation_data.action_influence = "ADD", 0.5
    scene.frame_set(1)
    active = [thing for thing in scene.objects if thing.rigid_body and thing.rigid_body.type == "ACTIVE"]
    before, actions = {thing.name: state(thing) for thing in active}, len(bpy.data.actions)
    run, _, poses = full_bake(program, folder)
    place, turn = off_bake(run, poses, run.shot.channels.keys() - {thing.name for thing in things[1:]})
    assert place < PLACE and turn < TURN, (place, turn)
    for frame, glow in ((1, 1.0), (20, 5.0)):
        scene.frame_set(frame)
        assert all(thing["glow"] == glow for thing in things[1:]), [thing["glow"] for thing in things[1:]]
    assert [thing.hide_render for thing in things[1:]] == [True] * 3
    assert [round(thing.scale.z, 3) for thing in things[1:]] == [2] * 3
    assert sum("with keys of scale: of the size at the first frame" in line for line in lines(run.shot)) == 1
    scene.frame_set(33)
    applying.delete_bake(scene)
    scene.frame_set(1)
    for thing in active:
        assert state(thing) == before[thing.name], (thing.name, state(thing), before[thing.name])
    assert len(bpy.data.actions) == actions
    print(f"keys: {len(active)} objects restored, {actions} actions as before")


def test_moved_since(program, folder):
    """A thing that is moved starts from its new place; frames and bakes do not lose the old one."""
    scene = empty(last=20)
    ground()
    crate, other = tilted("crate", (0, 0, 2)), tilted("other", (3, 0, 2))
    far = tilted("far", (4321.1234, 0.1, 2), rotation_mode="ZYX")
    far.rotation_euler = (7, 0.1, 0.2)
    child = tilted("child", (0, 6, 2))
    child.parent = crate
    child.matrix_parent_inverse = Matrix(((1, 0, 0, 1), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
    bpy.context.view_layer.update()
    started = [*other.location, *other.rotation_euler]
    full_bake(program, folder)
    scene.frame_start, scene.frame_end = 8, 30
    scene.frame_set(25)
    full_bake(program, folder)
    document = export(folder / "third.json").document
    assert np.allclose(document["bodies"][1]["position"], [0, 2, 0], atol=1e-6)
    # By hand, at a frame in between, and by a key at the first frame.
    scene.frame_set(12)
    crate.location = (0, 5, 4)
    child.location = (9, 1, 6)
    child.rotation_quaternion = (0.6, 0, 0.8, 0)
    for curve in curves_of(other):
        if (curve.data_path, curve.array_index) == ("location", 0):
            curve.keyframe_points[0].co.y = 7
    export(folder / "fourth.json")
    assert np.allclose(crate.location, (0, 5, 4)) and scene.frame_current == 12
    _, document, _ = full_bake(program, folder)
    assert np.allclose(document["bodies"][1]["position"], [0, 4, -5], atol=1e-6), document["bodies"][1]
    assert np.allclose(document["bodies"][2]["position"], [7, 2, 0], atol=1e-6), document["bodies"][2]
    # It was moved in the world, so that it starts where it is shown, though its parent was moved as well.
    body = document["bodies"][4]
    assert np.allclose(body["position"], [9, 6, -1], atol=1e-5), body
    assert np.allclose(body["rotation"], [0, 0, -0.8, 0.6], atol=1e-5), body
    applying.delete_bake(scene)
    assert np.allclose(far.rotation_euler, (7, 0.1, 0.2)) and far.rotation_mode == "ZYX"
    assert child.parent == crate and np.array(child.matrix_parent_inverse)[:3].tolist() == [
        [1, 0, 0, 1], [0, 0, 1, 0], [0, -1, 0, 0]]
    assert child.rotation_mode == "XYZ"
    assert np.allclose(crate.location, (0, 5, 4)) and crate.rotation_mode == "XYZ"
    assert np.allclose(list(other.location)[1:] + list(other.rotation_euler), started[1:], atol=1e-6)
    print("keys: moved objects start from their new places")


def test_no_longer_active(program, folder):
    """A baked object that becomes passive loses the keys of its bake with the next one."""
    scene = empty(last=20)
    ground()
    crate = tilted("crate", (0, 0, 2))
    tilted("other", (3, 0, 2))
    full_bake(program, folder)
    crate.rigid_body.type = "PASSIVE"
    run, document, _ = full_bake(program, folder)
    assert list(run.shot.channels) == ["other"] and document["bodies"][1]["motion"] == "static"
    scene.frame_set(20)
    assert np.allclose(crate.matrix_world.translation, (0, 0, 2)) and crate.animation_data is None
    assert not exporting.is_held(crate)


def test_saved_and_loaded(program, folder):
    """The state before a bake is in the file; a linked object is told."""
    scene = empty(last=20)
    ground()
    crate = tilted("crate", (0, 0, 2))
    keyed(crate, "scale", (1, 1, 1), (1, 1, 2))
    keyed(crate, "location", (0, 0, 2), (0, 0, 5))
    scene.frame_set(1)
    before = state(crate)
    full_bake(program, folder)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(folder / "shot.blend"))
    scene, crate = bpy.context.scene, bpy.data.objects["crate"]
    assert state(crate) != before
    applying.delete_bake(scene)
    scene.frame_set(1)
    assert state(crate) == before
    for name in ("plain.blend", "other.blend"):
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / name))
    with bpy.data.libraries.load(str(folder / "plain.blend"), link=True) as (source, target):
        target.objects = ["crate"]
    linked = target.objects[0]
    bpy.data.objects.remove(crate)
    scene.collection.objects.link(linked)
    scene.rigidbody_world.collection.objects.link(linked)
    bpy.context.view_layer.update()
    said = lines(export(folder / "linked.json"))
    assert any(line.startswith("1 object linked from another file: no keys") for line in said), said


def test_only_selected(program, folder):
    """A selection is baked again; the others keep their keys and push it."""
    scene = empty(last=30)
    ground()
    lower, upper = tilted("lower", (0, 0, 1)), tilted("upper", (0.1, 0, 2.5))
    still, child = tilted("still", (5, 0, 1)), tilted("child", (0, 0, 1.5))
    child.parent = lower
    bpy.context.view_layer.update()
    run, _, poses = full_bake(program, folder)
    applying.delete_bake(scene)
    child.select_set(True)
    still.select_set(False)
    _, _, poses = full_bake(program, folder)
    keys = [tuple(point.co) for curve in curves_of(lower) for point in curve.keyframe_points]
    originals.forget(still)
    for thing in scene.objects:
        thing.select_set(thing in (upper, child))
    run, document, again = full_bake(program, folder, baking.Options(only_selected=True))
    bodies = {body["name"]: body for body in document["bodies"]}
    assert sorted(run.shot.channels) == ["child", "upper"]
    assert bodies["lower"]["motion"] == "kinematic" and len(bodies["lower"]["track"]) == 30
    assert "1 object neither selected nor baked: still: 'still'" in lines(run.shot), lines(run.shot)
    assert keys == [tuple(point.co) for curve in curves_of(lower) for point in curve.keyframe_points]
    place, turn = off_bake(run, again, ["upper", "child", "lower"])
    print(f"keys: a selection is off by {place:.1e} m and {turn:.1e} rad")
    assert place < PLACE and turn < TURN and "first" in lower["drystone"]


def paths(thing):
    return sorted({curve.data_path for curve in curves_of(thing)})


def check(program, folder):
    baking.Check(bpy.context, program, baking.Options(), folder).finish()


def is_shown(run, poses, names=None):
    """Tells whether Blender shows bodies where a bake has them, at all frames."""
    place, turn = off_bake(run, poses, names)
    return place < PLACE and turn < TURN


def test_check_changes_nothing(program, folder):
    """Drivers and tracks made since a bake stay through a check, the next bake and the end of all."""
    scene = empty(last=10)
    ground()
    crate, other = tilted("crate", (0, 0, 2)), tilted("other", (3, 0, 2))
    full_bake(program, folder)
    crate["glow"] = 1.0
    crate.driver_add('["glow"]').driver.expression = "frame"
    crate.driver_add("delta_location", 0).driver.expression = "2"
    mine = crate.animation_data.nla_tracks.new()
    mine.strips.new("mine", 1, bpy.data.actions.new("mine"))
    # The bake itself, as a strip.
    other.animation_data.action.name = "clip"
    pushed_down(other)
    scene.frame_set(1)
    before = [state(crate), state(other)]
    check(program, folder)
    assert [state(crate), state(other)] == before
    run, _, poses = full_bake(program, folder)
    assert is_shown(run, poses) and [driver.mute for driver in crate.animation_data.drivers] == [False, True]
    applying.delete_bake(scene)
    assert [driver.mute for driver in crate.animation_data.drivers] == [False, False]
    assert [track.name for track in crate.animation_data.nla_tracks] == [mine.name]
    assert [track[3][0][1] for track in tracks(other)] == ["clip"]


def test_later_keys_stay(program, folder):
    """Keys of other properties, set or removed since a bake, outlive the next one and its deletion."""
    scene = empty(last=10)
    ground()
    plain, first, second = (tilted(name, (3 * i, 0, 2)) for i, name in enumerate(("plain", "first", "second")))
    keyed(first, "scale", (1, 1, 1), (1, 1, 2))
    keyed(first, "hide_render", False, True)
    data = second.animation_data_create()
    data.action, data.action_slot = first.animation_data.action, first.animation_data.action_slot
    full_bake(program, folder)
    keyed(plain, "hide_render", False, True)
    keyed(first, "scale", (1, 1, 1), (1, 1, 3))
    first.keyframe_delete("hide_render", frame=1)
    first.keyframe_delete("hide_render", frame=20)
    full_bake(program, folder)
    assert paths(plain) == ["hide_render", "location", "rotation_quaternion"]
    keyed(plain, "scale", (1, 1, 1), (1, 1, 2))
    applying.delete_bake(scene)
    assert paths(plain) == ["hide_render", "scale"] and paths(first) == ["scale"]
    scene.frame_set(20)
    # The other object of the same action keeps its own keys.
    assert [first.scale.z, second.scale.z] == [3, 2] and paths(second) == ["hide_render", "scale"]
    first.animation_data.action = None
    full_bake(program, folder)
    mine = bpy.data.actions.new("mine")
    first.animation_data.action = mine
    full_bake(program, folder)
    applying.delete_bake(scene)
    assert first.animation_data.action == mine


def test_scaled_since(program, folder):
    """A body without its parent keeps a scale that was applied since its bake, also from a frame on."""
    for options in ({}, {"from_here": True}):
        scene = empty(last=10)
        carrier, child = tilted("carrier", (0, 0, 5)), tilted("child", (0, 0, 3), scale=(2, 2, 2))
        child.parent = carrier
        bpy.context.view_layer.update()
        full_bake(program, folder)
        scene.frame_set(5 if options else 1)
        for thing in scene.objects:
            thing.select_set(thing == child)
        bpy.context.view_layer.objects.active = child
        bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
        run = baking.Bake(bpy.context, program, baking.Options(), folder, **options)
        run.finish()
        shapes = next(body["shapes"] for body in run.shot.document["bodies"] if body["name"] == "child")
        assert np.allclose(shapes[0]["half_extents"], 0.6, atol=1e-5), shapes
        assert np.allclose(child.scale, 1, atol=1e-5)
        applying.delete_bake(scene)
        assert child.parent == carrier and np.allclose(child.scale, 1, atol=1e-5)


def test_switches_since(program, folder):
    """Constraints added or renamed since a bake are on again after it, but for those that were off."""
    scene = empty(last=10)
    ground()
    crate = tilted("crate", (0, 0, 2))
    one, off, third = (crate.constraints.new("COPY_SCALE") for _ in range(3))
    off.enabled = False
    full_bake(program, folder)
    off.name, third.name = "off", "third"
    added = crate.constraints.new("LIMIT_SCALE")
    full_bake(program, folder)
    assert not any(of.enabled for of in crate.constraints)
    applying.delete_bake(scene)
    assert [of.enabled for of in (one, off, third, added)] == [True, False, True, True]


def reparented(how):
    """A baked crate whose parents change; returns it, and the change."""
    scene = empty(last=10)
    ground()
    stand = holder("stand", location=(3, 3, 1))
    other = holder("other", location=(1, 2, 3), rotation_euler=(1, 0, 0))
    crate, carrier = tilted("crate", (0, 0, 2)), tilted("carrier", (0, 0, 5))
    parents = {"unparented": other, "moved to another": other, "evened": stand}
    crate.parent = None if how == "parented" else parents.get(how, carrier)
    stand.scale = (1, 2, 0.5) if how == "evened" else (1, 1, 1)
    crate.rotation_euler = (0, 0, 0) if how == "evened" else crate.rotation_euler

    def change():
        scene.frame_set(1)
        place = crate.matrix_world.copy()
        if how == "evened":
            stand.scale = (1, 1, 1)
        elif how == "unloaded":
            bpy.context.view_layer.objects.active = carrier
            bpy.ops.rigidbody.object_remove()
        elif how == "turned over":
            carrier.parent = crate
            bpy.context.view_layer.update()
        else:
            crate.parent = None if how == "unparented" else stand
            # Keep Transform.
            crate.matrix_world = place if how != "parented" else crate.matrix_world
        bpy.context.view_layer.update()
        return crate.parent or {"evened": stand, "unloaded": carrier}.get(how)

    bpy.context.view_layer.update()
    return crate, change


def test_reparented_since(program, folder):
    """A body whose parents changed since its bake is shown where the next one has it, and keeps its parent."""
    for how in ("parented", "unparented", "moved to another", "taken down", "turned over", "unloaded", "evened"):
        crate, change = reparented(how)
        full_bake(program, folder)
        parent = change()
        place = np.array(crate.matrix_world)
        run, _, poses = full_bake(program, folder)
        assert is_shown(run, poses) and crate.parent == parent, how
        bpy.context.scene.frame_set(1)
        assert how in ("evened", "unloaded") or np.allclose(crate.matrix_world, place, atol=1e-5), how
        applying.delete_bake(bpy.context.scene)
        assert crate.parent == parent, how


def test_deleted_below_another_parent(program, folder):
    """Without its bake, an object stays below its new parent, where it was put."""
    for how in ("unparented", "taken down"):
        crate, change = reparented(how)
        full_bake(program, folder)
        parent = change()
        place = np.array(crate.matrix_world)
        applying.delete_bake(bpy.context.scene)
        bpy.context.scene.frame_set(1)
        assert crate.parent == parent and np.allclose(crate.matrix_world, place, atol=1e-5), how


def test_moved_apart(program, folder):
    """Bodies without their parents start where they are shown, whatever else was moved."""
    scene = empty(last=10)
    carrier, child = tilted("carrier", (0, 0, 2)), tilted("child", (0, 0, 3.5), delta_location=(2, 0, 0))
    child.parent = carrier
    uneven = tilted("uneven", (4, 0, 5), rotation_euler=(0, 0, 0))
    uneven.parent = holder("squashed", scale=(1, 2, 0.5), rotation_euler=(0, 0, 0.3))
    bpy.context.view_layer.update()
    full_bake(program, folder)
    scene.frame_set(1)
    for thing in (carrier, child, uneven):
        thing.location.x += 1
    bpy.context.view_layer.update()
    places = {thing.name: np.array(thing.matrix_world) for thing in (carrier, child, uneven)}
    run, _, poses = full_bake(program, folder)
    assert is_shown(run, poses)
    scene.frame_set(1)
    for name, place in places.items():
        assert np.allclose(scene.objects[name].matrix_world, place, atol=1e-5), name


def test_deltas_since(program, folder):
    """Deltas changed since a bake move the object, whatever mode its rotation has."""
    for mode in ("XYZ", "QUATERNION", "AXIS_ANGLE"):
        scene = empty(last=10)
        crate = tilted("crate", (0, 0, 2), rotation_mode=mode, delta_location=(0.1, 0.2, 0.3),
                       delta_rotation_euler=(0.3, 0, 0))
        full_bake(program, folder)
        scene.frame_set(1)
        crate.delta_rotation_quaternion, crate.delta_location = (0.7, 0.7, 0, 0), (1, 0, 0)
        bpy.context.view_layer.update()
        place = np.array(crate.matrix_world)
        for _ in range(2):
            run, _, poses = full_bake(program, folder)
            assert is_shown(run, poses), mode
            scene.frame_set(1)
            assert np.allclose(crate.matrix_world, place, atol=1e-5), mode
        applying.delete_bake(scene)
        assert crate.rotation_mode == mode and np.allclose(crate.delta_location, (1, 0, 0))


def test_strips_besides(program, folder):
    """Strips do not act beside a bake; their other keys do, and all strips come back."""
    for how in ("delta_location", "delta_rotation_quaternion", "rotation_mode", "release", "constraint", "solo"):
        scene = empty(last=20)
        ground()
        crate = tilted("crate", (0, 0, 2))
        keyed(crate, "scale", (1, 1, 1), (1, 1, 2))
        if how == "release":
            keyed(crate.rigid_body, "kinematic", True, False)
        elif how == "constraint":
            crate.constraints.new("COPY_LOCATION").target = holder("target", location=(3, 3, 3))
            keyed(crate.constraints[0], "enabled", False, True)
        elif how == "rotation_mode":
            keyed(crate, how, "ZYX")
        elif how == "delta_rotation_quaternion":
            crate.rotation_mode = "QUATERNION"
            keyed(crate, how, (1, 0, 0, 0), (0.7, 0.7, 0, 0))
        else:
            keyed(crate, "delta_location", (0, 0, 0), (1, 1, 1))
        track = pushed_down(crate)
        track.is_solo = how == "solo"
        scene.frame_set(1)
        before, actions = state(crate), len(bpy.data.actions)
        for _ in range(2):
            run, _, poses = full_bake(program, folder)
            assert is_shown(run, poses), how
            scene.frame_set(20)
            assert math.isclose(crate.scale.z, 2), how
        applying.delete_bake(scene)
        scene.frame_set(1)
        assert state(crate) == before and len(bpy.data.actions) == actions, how


def test_tweak_mode(program, folder):
    """An object leaves the tweak mode of its strips for a bake and for the deletion of one."""
    scene = empty(last=10)
    crate = tilted("crate", (0, 0, 2))
    keyed(crate, "location", (0, 0, 2), (3, 0, 2))
    track, data = pushed_down(crate), crate.animation_data

    def tweak():
        track.select = track.strips[0].select = True
        data.nla_tracks.active = track
        data.use_tweak_mode = True
        assert data.use_tweak_mode

    tweak()
    for _ in range(2):
        run, _, poses = full_bake(program, folder)
        assert is_shown(run, poses) and len(run.shot.channels) == 1
        tweak()
    applying.delete_bake(scene)
    assert not data.use_tweak_mode and data.action is None and len(data.nla_tracks) == 1


def test_time_stretching(program, folder):
    """Stretched time is refused: Blender would show keys at other frames."""
    scene = empty(last=10)
    tilted("crate", (0, 0, 2))
    run, _, _ = full_bake(program, folder)
    scene.render.frame_map_new = 200
    for work in (lambda: full_bake(program, folder), lambda: applying.apply(bpy.context, run.output)):
        try:
            work()
            assert False, "not refused"
        except ValueError as error:
            assert str(error).startswith("Time Stretching from 100 to 200"), error


def test_undone_at_the_end(program, folder):
    """Undo between the last keys and the end of a bake does not take them."""
    scene = empty(last=10)
    crate = tilted("crate", (0, 0, 5))
    bpy.ops.ed.undo_push(message="before")
    crate.location.z = 6
    bpy.ops.ed.undo_push(message="after")
    run = baking.Bake(bpy.context, program, baking.Options(), folder)
    undone = False
    while run.poll():
        if run.keys.frames and not undone:
            bpy.ops.ed.undo()
            undone = True
    assert undone and not run.error and originals.is_baked(bpy.data.objects["crate"])
    assert run.said[0] == "1 body baked" and len(curves_of(bpy.data.objects["crate"])) == 7


def lifted(name, place):
    """A crate that is keyed in a strip alone; returns it and its track."""
    thing = tilted(name, place)
    keyed(thing, "location", place, (place[0] + 4, place[1], place[2] + 2))
    return thing, pushed_down(thing)


def test_moved_with_strips(program, folder):
    """A body of strips starts from these, though it was moved since; strips and place come back exactly."""
    for how in ("plain", "muted", "solo"):
        scene = empty(last=20)
        ground()
        crate, track = lifted("crate", (0, 0, 3))
        if how == "muted":
            track.mute = True
            crate.location = (0, 0, 3)
        track.is_solo = how == "solo"
        scene.frame_set(1)
        before, actions = state(crate), len(bpy.data.actions)
        keys = everything(crate)
        full_bake(program, folder)
        crate.location = (7, 7, 7)
        run, document, poses = full_bake(program, folder)
        index = [body["name"] for body in document["bodies"]].index("crate")
        wanted = (7, 7, -7) if how == "muted" else (0, 3, 0)
        assert np.allclose(poses[0, index, :3], wanted, atol=1e-5), (how, poses[0, index])
        scene.frame_set(9)
        applying.delete_bake(scene)
        scene.frame_set(1)
        if how == "muted":
            # Its rotation is that of the keys, which have 32 bits.
            assert np.allclose(crate.rotation_euler, before["values"][2])
            before["values"] = state(crate)["values"]
            assert before["values"][1] == [7, 7, 7]
        assert state(crate) == before, (how, state(crate), before)
        assert everything(crate) == keys and len(bpy.data.actions) == actions, how


def everything(thing):
    """Returns all settings of the strips of an object, and their keys with handles."""
    found = []
    for track in thing.animation_data.nla_tracks:
        for strip in track.strips:
            settings = [(key, str(getattr(strip, key))) for key in strip.bl_rna.properties.keys()
                        if isinstance(getattr(strip, key), (bool, int, float, str))]
            bags = channelbags(strip.action, strip.action_slot)
            curves = [(of.data_path, of.array_index, all_of(of)) for bag in bags for of in bag.fcurves]
            found.append((track.name, strip.action.name, settings, curves))
    return found


def tweaked(thing, track):
    """Enters tweak mode of the strip of a track; returns the curves in it."""
    track.select = track.strips[0].select = True
    data = thing.animation_data
    data.nla_tracks.active = track
    data.use_tweak_mode = True
    assert data.use_tweak_mode
    return {(of.data_path, of.array_index): of for of in curves_of(thing)}


def test_strips_edited_in_tweak_mode(program, folder):
    """Keys that are set, changed or removed in a strip while it is baked outlive the bake and its deletion."""
    for ends in ("delete", "bake", "save", "here"):
        scene = empty(last=20)
        ground()
        crate = tilted("crate", (0, 0, 3))
        keyed(crate, "location", (0, 0, 3), (4, 0, 5))
        keyed(crate, "delta_location", (0, 0, 0), (0, 1, 0))
        keyed(crate, "scale", (1, 1, 1), (1, 1, 2))
        track = pushed_down(crate)
        own = track.strips[0].action.name
        scene.frame_set(1)
        actions = len(bpy.data.actions)
        full_bake(program, folder)
        curves = tweaked(crate, track)
        curves["location", 0].keyframe_points[0].co.y = 1.5
        curves["scale", 2].keyframe_points[1].co.y = 3
        action = crate.animation_data.action
        bag = channelbags(action, crate.animation_data.action_slot)[0]
        bag.fcurves.remove(curves["scale", 1])
        bag.fcurves.new("hide_render").keyframe_points.insert(5, 1)
        if ends == "bake":
            full_bake(program, folder)
        elif ends == "here":
            scene.frame_set(10)
            baking.Bake(bpy.context, program, baking.Options(), folder, from_here=True).finish()
            x, y, z = crate.matrix_world.translation
            assert abs(x) < 0.5 and abs(y) < 0.5 and z < 3, (x, y, z)
            assert not crate.animation_data.use_tweak_mode and len(curves_of(crate)[0].keyframe_points) == 20
        elif ends == "save":
            crate.animation_data.use_tweak_mode = False
            bpy.ops.wm.save_as_mainfile(filepath=str(folder / "tweak.blend"))
            bpy.ops.wm.open_mainfile(filepath=str(folder / "tweak.blend"))
            scene, crate = bpy.context.scene, bpy.data.objects["crate"]
        applying.delete_bake(scene)
        strip = crate.animation_data.nla_tracks[0].strips[0]
        assert strip.action.name == own and len(bpy.data.actions) == actions, (ends, strip.action.name)
        curves = {(of.data_path, of.array_index): [point.co.y for point in of.keyframe_points]
                  for bag in channelbags(strip.action, strip.action_slot) for of in bag.fcurves}
        assert curves["location", 0] == [1.5, 4] and curves["scale", 2] == [1, 3], (ends, curves)
        assert ("scale", 1) not in curves and curves["hide_render", 0] == [1], (ends, curves)
        assert curves["delta_location", 1] == [0, 1] and curves["location", 2] == [3, 5], (ends, curves)


def test_shared_strips_edited(program, folder):
    """Two objects share the action of their strips: an edit by one is not undone by the copy of the other."""
    scene = empty(last=20)
    ground()
    one, other = tilted("one", (0, 0, 3)), tilted("other", (5, 0, 3))
    keyed(one, "delta_location", (0, 0, 0), (0, 1, 0))
    keyed(one, "scale", (1, 1, 1), (1, 1, 2))
    track = pushed_down(one)
    action, slot = track.strips[0].action, track.strips[0].action_slot
    strip = other.animation_data_create().nla_tracks.new().strips.new("shared", 1, action)
    strip.action_slot = slot
    scene.frame_set(1)
    full_bake(program, folder)
    tweaked(one, track)["scale", 2].keyframe_points[1].co.y = 3
    applying.delete_bake(scene)
    curves = [of for bag in channelbags(action, slot) for of in bag.fcurves if (of.data_path, of.array_index) ==
              ("scale", 2)]
    assert [point.co.y for point in curves[0].keyframe_points] == [1, 3]
    assert one.animation_data.nla_tracks[0].strips[0].action == strip.action == action


def linked_action(folder, name):
    """Returns the action of a name, linked from a file that has the scene at hand."""
    path = str(folder / f"{name}.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    with bpy.data.libraries.load(path, link=True) as (_, target):
        target.actions = [name]
    return target.actions[0]


def test_linked_actions_edited(program, folder):
    """Edits of actions that are linked from another file are kept in local ones."""
    scene = empty(last=20)
    ground()
    in_strip, direct = tilted("in strip", (0, 0, 3)), tilted("direct", (5, 0, 3))
    for thing in (in_strip, direct):
        keyed(thing, "delta_location", (0, 0, 0), (0, 1, 0))
        keyed(thing, "scale", (1, 1, 1), (1, 1, 2))
    track = pushed_down(in_strip)
    strip, data = track.strips[0], direct.animation_data
    handle = strip.action_slot.handle
    strip.action = linked_action(folder, strip.action.name)
    strip.action_slot = next(slot for slot in strip.action.slots if slot.handle == handle)
    data.action = linked_action(folder, data.action.name)
    data.action_slot = data.action.slots[0]
    scene.frame_set(1)
    full_bake(program, folder)
    for curves in (tweaked(in_strip, track),
                   {(of.data_path, of.array_index): of for of in curves_of(direct)}):
        curves["scale", 2].keyframe_points[1].co.y = 3
    applying.delete_bake(scene)
    for action, slot in ((strip.action, strip.action_slot), (data.action, data.action_slot)):
        heights = [[point.co.y for point in of.keyframe_points] for bag in channelbags(action, slot)
                   for of in bag.fcurves if (of.data_path, of.array_index) == ("scale", 2)]
        assert heights == [[1, 3]] and not action.library, (action, heights)
