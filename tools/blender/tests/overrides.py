"""Tests of bakes on objects of library overrides, through files that are saved and opened again."""

import bpy
import numpy as np
from drystone import applying

from .bodies import linked_from
from .common import PLACE, UP, block, empty, full_bake, lines
from .here import from_here
from .since import in_panel

NAMES = ("crate", "led", "bound", "below", "driven", "strips")


def library(path):
    """A file of crates with all that a bake turns off, each with some of it."""
    scene = empty(last=12)
    things = {name: block(name, (3 * i, 0, 3)) for i, name in enumerate(NAMES)}
    for key in ("location", "scale"):
        things["led"].keyframe_insert(key, frame=1)
        things["strips"].keyframe_insert(key, frame=1)
    things["bound"].constraints.new("LIMIT_LOCATION").use_min_x = True
    parent = bpy.data.objects.new("uneven", None)
    scene.collection.objects.link(parent)
    parent.scale = (2, 1, 1)
    things["below"].parent = parent
    things["driven"].driver_add("location", 0).driver.expression = "12"
    data = things["strips"].animation_data
    action, slot, data.action = data.action, data.action_slot, None
    data.nla_tracks.new().strips.new("strip", 1, action).action_slot = slot
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def overridden(folder, *names):
    """A scene with overrides of objects of the library; returns these."""
    library(folder / "library.blend")
    empty(last=12)
    block("floor", (0, 0, -50), "PASSIVE")
    return linked_from(folder / "library.blend", *names, override=True)


def again(path):
    """Saves the file and opens it; returns the scene and its crates by name."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    return scene, {name: scene.objects[name] for name in NAMES if name in scene.objects}


def state_of(thing):
    """Returns all that a bake changes."""
    data = thing.animation_data
    return [tuple(thing.location), thing.rotation_mode, tuple(thing.scale), tuple(thing.delta_location),
            thing.parent and thing.parent.name_full, thing.rigid_body.kinematic,
            [of.enabled for of in thing.constraints],
            data and data.action and data.action.name_full, "drystone" in thing]


def check(things, before):
    for name, thing in things.items():
        assert state_of(thing) == before[name], (name, state_of(thing), before[name])


def places(things):
    return np.array([thing.matrix_world.translation for thing in things.values()])


def test_overrides_keep_their_bake(program, folder):
    """Overridden objects have their keys after a file is opened, go on from a frame, and are restored to the bit."""
    def work():
        overridden(folder, *NAMES)
        scene, things = again(folder / "shot.blend")
        before = {name: state_of(thing) for name, thing in things.items()}
        run, document, poses = full_bake(program, folder)
        said = lines(run.shot)
        assert "2 objects overridden, but not editable, or with drivers or NLA tracks: no keys, unless made local: " \
            "'driven', 'strips'" in said and set(run.shot.channels) == set(NAMES[:4]), said
        index = [[body["name"] for body in document["bodies"]].index(name) for name in NAMES[:4]]
        for last in (False, True):
            scene, things = again(folder / "shot.blend")
            baked = {name: things[name] for name in NAMES[:4]}
            for frame in (1, 5, 12):
                scene.frame_set(frame)
                off = np.abs(places(baked) - poses[frame - 1, index, :3] @ UP.T).max()
                assert off < PLACE, (frame, off, places(baked))
            assert all("drystone" in thing and thing.rigid_body.kinematic for thing in baked.values())
            if not last:
                from_here(program, folder, 6)
        scene.frame_set(1)
        bpy.ops.drystone.delete_bake()
        check(things, before)
        scene, things = again(folder / "shot.blend")
        check(things, before)
        assert not any(key.startswith("drystone_") for key in scene.keys()), list(scene.keys())
        assert not any("Drystone" in action.name for action in bpy.data.actions)

    in_panel(program, work)


def test_overrides_without_the_add_on(program, folder):
    """A Blender without the add-on shows the keys, and a later one with it can restore the objects."""
    overridden(folder, "crate")
    _, _, poses = full_bake(program, folder)
    for name in ("once", "twice"):
        scene, things = again(folder / f"{name}.blend")
        for frame in range(1, 13):
            scene.frame_set(frame)
        assert np.abs(places(things) - poses[-1, 1:, :3] @ UP.T).max() < PLACE and "drystone" not in things["crate"]
    assert applying.delete_bake(scene) == 1 and not things["crate"].rigid_body.kinematic


def test_overrides_that_are_not_editable(program, folder):
    """Overrides of the system get no keys, and are named."""
    crate, = overridden(folder, "crate")
    crate.override_library.is_system_override = True
    run, _, _ = full_bake(program, folder)
    assert lines(run.shot) == ["1 object overridden, but not editable, or with drivers or NLA tracks: no keys, unless "
                               "made local: 'crate'"] and "drystone" not in crate, lines(run.shot)
