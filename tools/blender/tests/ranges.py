"""Tests of frames: where a simulation starts, and which frames a stage has."""

import re

import bpy
import numpy as np
from drystone import applying
from drystone.curves import curves_of
from drystone.exporting import WOKEN

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
    """A simulation that starts after the last frame is refused; one before the first frame is told."""
    late(start=41)
    try:
        exported()
        assert False, "exported nothing"
    except ValueError as error:
        assert "starts at frame 41" in str(error)
    late(first=30, start=20)
    shot = exported()
    assert shot.document["steps"] == 10 and shot.document["extras"] == {"frame_start": 30}
    assert lines(shot) == ["1 scene whose simulation starts at frame 20, before the first one: baked from frame 30: "
                           "'Scene'"], lines(shot)


def test_simulation_ends_early(program, folder):
    """A cache that ends before the scene is told: bodies stop there in Blender, and move on in a bake."""
    scene, crate = late(start=1)
    scene.rigidbody_world.point_cache.frame_end = 12
    blender = in_blender()[:, 0, 2, 3]
    assert np.ptp(blender[11:]) == 0 and blender[10] > blender[11] > 1
    run, _, poses = full_bake(program, folder)
    assert len(poses) == 40 and heights(crate, 40)[0] < blender[-1] - 0.1
    assert lines(run.shot) == ["1 scene whose simulation ends at frame 12: baked to frame 40, in Blender still from "
                               "there: 'Scene'"], lines(run.shot)


def test_sleepers_under_keyed_gravity(program, folder):
    """A body that starts deactivated wakes as gravity changes, in Blender not; this is told."""
    keys = {"gravity": {1: (0, 0, -9.81), 20: (0, 0, -5)}, "rigidbody_world.time_scale": {1: 1, 20: 0.5}}
    for path, values in keys.items():
        scene = empty(last=24)
        block("asleep", (0, 0, 3), use_deactivation=True, use_start_deactivated=True)
        key_world(scene, [(path, values)])
        scene.frame_set(1)
        assert np.ptp(in_blender()[:, 0, 2, 3]) == 0
        run, _, poses = full_bake(program, folder)
        is_woken = path == "gravity"
        assert lines(run.shot) == ([f"1 object{WOKEN}: 'asleep'"] if is_woken else []), lines(run.shot)
        assert (poses[-1, 0, 1] < 2) == is_woken, poses[-1]


def test_disabled_world(program, folder):
    """A disabled world is told, baked all the same, and stays disabled."""
    scene, crate = late(start=1)
    scene.rigidbody_world.enabled = False
    assert np.ptp(in_blender()[:, 0, 2, 3]) == 0
    run, _, _ = full_bake(program, folder)
    assert lines(run.shot) == ["1 scene whose rigid body world is disabled: baked, in Blender nothing is simulated: "
                               "'Scene'"], lines(run.shot)
    assert heights(crate, 40)[0] < 2.5 and not scene.rigidbody_world.enabled


def key_world(scene, keys):
    """Keys properties of a scene, straight between these values: (path, {frame: value})."""
    for path, values in keys:
        owner, _, name = path.rpartition(".")
        for frame, value in values.items():
            setattr(scene.path_resolve(owner) if owner else scene, name, value)
            scene.keyframe_insert(path, frame=frame)
    straighten(scene)


def straighten(owner):
    """Makes curves straight between their keys."""
    for curve in curves_of(owner):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


SLOW = ("rigidbody_world.time_scale", {1: 1, 12: 1, 20: 0.1, 30: 0.1, 36: 1.5})


def fallen(scene, start):
    """Places of a body that falls through the frames of a scene, each with its own speed and gravity."""
    place, velocity, places = np.array(start, float), np.zeros(3), []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        world = scene.rigidbody_world
        pull = np.array(scene.gravity) * world.effector_weights.gravity * scene.use_gravity
        step = world.time_scale / 24 if places else 0
        for _ in range(1000):
            velocity = velocity + pull * step / 1000
            place = place + velocity * step / 1000
        places.append(place)
    scene.frame_set(scene.frame_start)
    return np.array(places)


def test_keyed_world(program, folder):
    """Slow motion that sets in and stops, and gravity that turns and ends, act at the frames of their keys.

    Blender takes each value at its frame or a frame late, by chance.
    """
    turn = ("gravity", {1: (0, 0, -9.81), 15: (0, 0, -9.81), 16: (2, 0, 6), 40: (2, 1, 6)})
    weight = ("rigidbody_world.effector_weights.gravity", {1: 1, 20: 1, 21: 0, 40: 0})
    off = ("use_gravity", {1: True, 20: False})
    stop = ("rigidbody_world.time_scale", {1: 1, 10: 0, 20: 1})
    for keys in ([SLOW], [turn], [weight], [off], [SLOW, turn], [stop]):
        scene = empty(last=40)
        block("crate", (0, 0, 30))
        key_world(scene, keys)
        expected = fallen(scene, (0, 0, 30))
        run, document, poses = full_bake(program, folder)
        assert not lines(run.shot), lines(run.shot)
        found = poses[:, 0, [0, 2, 1]] * (1, -1, 1)
        off_by, size = np.abs(found - expected).max(), np.ptp(expected[:, 2])
        print(f"ranges: {[path for path, _ in keys]}: off by {off_by * 1e3:.1f} mm of {size:.3f} m")
        assert off_by < 0.005 * size and size > 0.5, (off_by, keys)
        assert applying.apply(bpy.context, run.output) == (1, [])
        place, turn_by = differences(document, poses)
        assert place < 1e-4 and turn_by < 1e-4, (place, turn_by)


def test_lifts_follow_frames_in_slow_motion(program, folder):
    """An Animated lift follows its keys by frames, however slow its world is, and lifts what stands on it."""
    scene = empty(last=40)
    lift = block("lift", (0, 0, 0.5), "PASSIVE", kinematic=True)
    for frame, height in ((1, 0.5), (40, 1.5)):
        lift.location.z = height
        lift.keyframe_insert("location", frame=frame)
    straighten(lift)
    block("crate", (0, 0, 1.5))
    key_world(scene, [("rigidbody_world.time_scale", {1: 1, 40: 0.2})])
    _, document, poses = full_bake(program, folder)
    names = [body["name"] for body in document["bodies"]]
    apart = poses[:, names.index("crate"), 1] - poses[:, names.index("lift"), 1]
    assert np.abs(apart - 1).max() < 2e-3, apart
    assert abs(poses[-1, names.index("lift"), 1] - 1.5) < 1e-4


def test_keyed_speed(program, folder):
    """A bake with a keyed speed goes on from a frame, and is applied, at whatever frame the scene is."""
    scene = empty(last=40)
    block("crate", (0, 0, 30))
    key_world(scene, [("rigidbody_world.time_scale", {1: 1, 40: 0.1})])
    scene.frame_set(40)
    run, document, poses = full_bake(program, folder)
    assert abs(document["time_step"] * 24 - 1) < 1e-6 and not lines(run.shot)
    again = from_here(program, folder, 20)
    assert not any("no recording" in line for line in lines(again.shot)), lines(again.shot)
    scene.frame_set(30)
    assert applying.apply(bpy.context, run.output) == (1, []) and scene.frame_end == 40
    place, turn = differences(document, poses)
    assert place < 1e-4 and turn < 1e-4, (place, turn)
