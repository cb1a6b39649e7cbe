"""Tests of frames: where a simulation starts, and which frames a stage has."""

import re

import bpy
import numpy as np
from drystone import applying

from .common import block, differences, empty, full_bake, in_blender, lines
from .here import from_here
from .passive import exported
from .stages import written

STARTS = "1 scene whose simulation starts at frame 20: baked from there, as in Blender: 'Scene'"
LED = "1 object with keys before the simulation starts: still until then: 'led'"


def late(first=1, last=40, start=20):
    """A crate above a floor in a scene whose simulation starts late."""
    scene = empty(last=last)
    scene.frame_start = first
    scene.rigidbody_world.point_cache.frame_start = start
    block("floor", (0, 0, -0.5), "PASSIVE")
    return scene, block("crate", (0, 0, 3), linear_damping=0.0)


def heights(thing, *frames):
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        found.append(thing.matrix_world.translation.z)
    return found


def test_simulation_starts_late(program, folder):
    """A body waits until the first frame of the rigid body cache, as in Blender; a bake from a frame on too."""
    scene, crate = late()
    blender = in_blender()[:, 0, 2, 3]
    assert blender[19] == 3 and blender[21] < 3
    run, document, poses = full_bake(program, folder)
    assert lines(run.shot) == [STARTS] and len(poses) == 21 and run.keys.frames == 21
    shown = heights(crate, *range(1, 41))
    assert shown[:20] == [3] * 20 and np.abs(np.array(shown) - blender).max() < 0.06, shown
    again = from_here(program, folder, 30)
    assert np.abs(np.array(heights(crate, *range(1, 41))) - shown).max() < 1e-5 and again.keys.first == 30
    applying.delete_bake(scene)
    applying.apply(bpy.context, run.output)
    found = heights(crate, 1, 20, 40)
    assert np.abs(np.array(found) - [3, 3, shown[-1]]).max() < 1e-5 and scene.frame_end == 40, found


def test_led_before_the_start(program, folder):
    """Keys that a body has before the simulation starts are told; parents and Animated bodies move on."""
    scene, crate = late()
    led = block("led", (5, 0, 3))
    led.keyframe_insert("location", frame=1)
    belt = block("belt", (10, 0, 3), "PASSIVE", kinematic=True)
    belt.keyframe_insert("location", frame=1)
    belt.location.x = 20
    belt.keyframe_insert("location", frame=39)
    run, document, poses = full_bake(program, folder)
    assert lines(run.shot) == [LED, STARTS], lines(run.shot)
    scene.frame_start = 20
    place, turn = differences(document, poses)
    assert place < 1e-5 and turn < 1e-4
    scene.frame_set(1)
    assert belt.matrix_world.translation.x == 10


def test_refused_starts(_program, _folder):
    """A simulation that starts after the last frame is refused; one before the first frame changes nothing."""
    late(start=41)
    try:
        exported()
        assert False, "exported nothing"
    except ValueError as error:
        assert "starts at frame 41" in str(error)
    late(first=30, start=20)
    shot = exported()
    assert not lines(shot) and shot.document["steps"] == 10 and shot.document["extras"] == {"frame_start": 30}


def test_keyed_speed(program, folder):
    """Of a keyed speed the value at the first frame holds, at whatever frame a bake is begun or applied."""
    scene = empty(last=40)
    block("crate", (0, 0, 30))
    world = scene.rigidbody_world
    for frame, speed in ((1, 1), (40, 0.1)):
        world.time_scale = speed
        scene.keyframe_insert("rigidbody_world.time_scale", frame=frame)
    scene.frame_set(40)
    run, document, poses = full_bake(program, folder)
    assert abs(document["time_step"] * 24 - 1) < 1e-6
    assert any("keys of gravity or rigid body world" in line for line in lines(run.shot))
    again = from_here(program, folder, 20)
    assert not any("no recording" in line for line in lines(again.shot)), lines(again.shot)
    scene.frame_set(30)
    assert applying.apply(bpy.context, run.output) == (1, []) and scene.frame_end == 40
    place, turn = differences(document, poses)
    assert place < 1e-4 and turn < 1e-4, (place, turn)
