"""Tests of actions of objects that are renamed, shared or deleted between bakes."""

import bpy
from drystone import applying
from drystone.curves import curves_of

from .common import block, differences, empty, full_bake


def keyed(name, place, others=0):
    """A crate with keys of its place and its scale, whose action has other slots; returns it and its action."""
    thing = block(name, place)
    data = thing.animation_data_create()
    data.action = bpy.data.actions.new(f"{name}Action")
    for i in range(others):
        data.action.slots.new(id_type="OBJECT", name=f"other {i}")
    data.action_slot = data.action.slots.new(id_type="OBJECT", name=name)
    for frame, size in ((1, 1), (10, 2)):
        thing.scale.x = size
        thing.keyframe_insert("scale", frame=frame)
        thing.keyframe_insert("location", frame=frame)
    return thing, thing.animation_data.action


def paths(thing):
    return sorted({curve.data_path for curve in curves_of(thing)})


def test_renamed_action(program, folder):
    """An action and its slot that are renamed while their object is baked come back with all their keys."""
    scene = empty(last=10)
    thing, action = keyed("crate", (0, 0, 3))
    for _ in range(2):
        full_bake(program, folder)
        action.name, action.slots[0].name_display = "renamed", "another"
        thing.name = "crate renamed"
    applying.delete_bake(scene)
    assert thing.animation_data.action == action and thing.animation_data.action_slot == action.slots[0]
    assert paths(thing) == ["location", "scale"]


def test_linked_duplicates(program, folder):
    """Duplicates that share an action, made before and after a bake, have keys of their own and share it again."""
    scene = empty(last=10)
    thing, action = keyed("crate", (0, 0, 3))
    things = [thing]
    for x in (4, 8):
        bpy.ops.object.select_all(action="DESELECT")
        thing.select_set(True)
        bpy.context.view_layer.objects.active = thing
        bpy.ops.object.duplicate(linked=True)
        things.append(bpy.context.object)
        things[-1].delta_location.x = x
        assert things[-1].animation_data.action == thing.animation_data.action
        _, document, poses = full_bake(program, folder)
        assert differences(document, poses)[0] < 1e-5
        places = [poses[0, i, 0] for i in range(len(things))]
        assert places == [0, 4, 8][:len(things)], places
    applying.delete_bake(scene)
    assert all(of.animation_data.action == action and not of.rigid_body.kinematic for of in things)
    assert paths(thing) == ["location", "scale"] and len(bpy.data.actions) == 1


def test_actions_of_one_name(program, folder):
    """Actions of one name, a local one and some of other files, have copies of their own."""
    for others, file in enumerate(("one", "two"), 1):
        empty(last=10)
        thing, action = keyed("crate", (0, 0, 3), others)
        action.name = "walk"
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{file}.blend"))
    scene = empty(last=10)
    thing, action = keyed("crate", (0, 0, 3))
    action.name = "walk"
    things, actions = [thing], [action]
    for i, file in enumerate(("one", "two")):
        with bpy.data.libraries.load(str(folder / f"{file}.blend"), link=True) as (_, wanted):
            wanted.actions = ["walk"]
        actions += wanted.actions
        things.append(block(file, (4 * i + 4, 0, 3)))
        data = things[-1].animation_data_create()
        data.action, data.action_slot = actions[-1], actions[-1].slots[-1]
        things[-1].delta_location.x = 4 * i + 4
    assert len({of.name for of in actions}) == 1
    for _ in range(2):
        _, document, poses = full_bake(program, folder)
        assert differences(document, poses)[0] < 1e-5
        assert all(paths(of) == ["location", "rotation_quaternion", "scale"] for of in things)
    applying.delete_bake(scene)
    assert [of.animation_data.action for of in things] == actions


def grow_to(thing, size):
    """Edits the last key of the scale of an object."""
    for curve in curves_of(thing):
        if curve.data_path == "scale":
            curve.keyframe_points[-1].co.y = size
            curve.update()


def sizes_at(scene, frame, *things):
    scene.frame_set(frame)
    return [thing.scale.x for thing in things]


def sharing():
    """A crate and a decoration without rigid body that share an action with keys of their scale."""
    scene = empty(last=10)
    thing, action = keyed("crate", (0, 0, 3))
    bpy.ops.mesh.primitive_cube_add(location=(5, 0, 0))
    other = bpy.context.object
    data = other.animation_data_create()
    data.action, data.action_slot = action, thing.animation_data.action_slot
    return scene, thing, other, action


def test_edits_of_a_shared_action(program, folder):
    """Keys that another object of the action gets meanwhile are no edits of the baked copy."""
    for bakes in (1, 2):
        scene, thing, other, action = sharing()
        full_bake(program, folder)
        grow_to(other, 3)
        for _ in range(bakes - 1):
            full_bake(program, folder)
        applying.delete_bake(scene)
        assert thing.animation_data.action == other.animation_data.action == action and len(bpy.data.actions) == 1
        assert sizes_at(scene, 10, thing, other) == [3, 3]


def test_edits_on_both_sides(program, folder):
    """Keys edited on the baked object are its own, and those edited on the other one stay there."""
    scene, thing, other, action = sharing()
    full_bake(program, folder)
    grow_to(thing, 5)
    grow_to(other, 3)
    for _ in range(2):
        full_bake(program, folder)
        assert sizes_at(scene, 10, thing, other) == [5, 3]
    applying.delete_bake(scene)
    assert other.animation_data.action == action != thing.animation_data.action
    assert sizes_at(scene, 10, thing, other) == [5, 3] and len(bpy.data.actions) == 2


def test_updated_library(program, folder):
    """A linked action that its library changes meanwhile comes back as the library has it now."""
    library, file = folder / "library.blend", folder / "scene.blend"
    for size in (2, 3):
        empty(last=10)
        thing, action = keyed("crate", (0, 0, 3))
        action.name = "grow"
        grow_to(thing, size)
        bpy.ops.wm.save_as_mainfile(filepath=str(library))
        if size == 2:
            scene = empty(last=10)
            thing = block("crate", (0, 0, 3))
            with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
                wanted.actions = ["grow"]
            data = thing.animation_data_create()
            data.action, data.action_slot = wanted.actions[0], wanted.actions[0].slots[-1]
            full_bake(program, folder)
            bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.wm.open_mainfile(filepath=str(file))
    scene = bpy.context.scene
    thing = scene.objects["crate"]
    applying.delete_bake(scene)
    assert thing.animation_data.action.library and sizes_at(scene, 10, thing) == [3]
