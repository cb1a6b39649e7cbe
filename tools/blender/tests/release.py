"""Tests of bodies that follow their keys and are released."""

import time

import bpy
import numpy as np
from drystone import exporting

from .common import DOWN, UP, block, full_bake, in_blender, lines, stage

ALL = exporting.Abilities(start_asleep=True, force=True, release=True)
# The frame at which Animated is keyed off, where bodies leave their keys.
FREE = 9


def switched(thing, path, frames):
    """Keys a setting of a rigid body: its values by frame."""
    for frame, value in frames:
        setattr(thing.rigid_body, path, value)
        thing.keyframe_insert(f"rigid_body.{path}", frame=frame)


def thrown(name="thrown", y=0.0, frames=((1, True), (FREE, False)), since=1):
    """A crate that keys move along x and up, and that is then free."""
    thing = block(name, (0, y, 2), kinematic=True)
    for frame, place in ((since, (0, y, 2)), (40, (10, y, 6))):
        thing.location = place
        thing.keyframe_insert("location", frame=frame)
    for curve in thing.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    switched(thing, "kinematic", frames)
    return thing


def test_released_as_in_blender(program, folder):
    """A thrown crate leaves its keys where it does in Blender, with their velocity."""
    scene = stage(DOWN, 25)
    thing = thrown()
    shown = in_blender()[:, 0, :3, 3]
    scene.frame_set(20)
    # Whatever was played before.
    shot = exporting.export(bpy.context, ALL)
    body = shot.document["bodies"][0]
    assert body["motion"] == "dynamic" and lines(shot) == [], lines(shot)
    track = np.array([key["position"] for key in body["track"]]) @ UP.T
    assert np.abs(track - shown[:len(track)]).max() < 1e-5 and len(track) == FREE - 1
    velocity = (track[-1] - track[-2]) * 24
    times = np.arange(25 - len(track) + 1) / 24
    flown = track[-1] + times[:, None] * velocity + times[:, None]**2 / 2 * np.array(DOWN)
    off = np.abs(flown - shown[len(track) - 1:]).max()
    print(f"release: a thrown crate flies {np.ptp(shown[:, 0]):.2f} m, off Blender by {off * 1e3:.2f} mm")
    assert off < 5e-3
    _, _, poses = full_bake(program, folder)
    assert np.abs(poses[:, 0, :3] @ UP.T - shown).max() < 5e-3
    scene.frame_set(25)
    assert thing.rigid_body.kinematic and not np.allclose(thing.location, (10, 0, 6))


def test_kinds_of_release(_program, _folder):
    """Held once more, held late, held at first and dropped at rest, enabled by a key, or driven."""
    stage(DOWN, 30)
    thrown("twice", 0, ((1, True), (5, False), (12, True), (20, False)))
    switched(block("late", (0, 4, 2)), "kinematic", ((1, False), (12, True)))
    switched(block("drop", (0, 8, 2)), "kinematic", ((1, True), (12, False)))
    switched(block("enabled", (0, 12, 2)), "enabled", ((1, False), (10, True)))
    driver = block("driven", (0, 16, 2)).driver_add("rigid_body.kinematic").driver
    driver.type, driver.expression = "SCRIPTED", "frame < 7"
    block("always", (0, 20, 2), kinematic=True)
    shot = exporting.export(bpy.context, ALL)
    bodies = {body["name"]: (body["motion"], len(body.get("track", []))) for body in shot.document["bodies"]}
    assert bodies == {"twice": ("dynamic", 4), "late": ("dynamic", 0), "drop": ("dynamic", 11),
                      "enabled": ("dynamic", 9), "driven": ("dynamic", 6), "always": ("kinematic", 0)}, bodies
    assert lines(shot) == [
        "2 objects held by keys after a release: free from there on: 'twice', 'late'"], lines(shot)


ON, OFF = True, False
# Frames and values of Animated and of Dynamic.
STOPPED = [(((1, OFF),), ((1, OFF), (FREE, ON))), (((1, OFF),), ((1, OFF),)), (((1, ON),), ((1, OFF), (FREE, ON))),
           (((1, ON), (FREE, OFF)), ((1, OFF),)), (((1, OFF), (FREE, ON)), ((1, OFF),))]


def test_stopped_as_in_blender(program, folder):
    """An active body whose Dynamic is off stays where it is, unless it is Animated, and starts at rest."""
    for animated, dynamic in STOPPED:
        scene = stage(DOWN, 25)
        # Blender may take the place at the second frame for that at the first one.
        thing = thrown(frames=animated, since=2)
        switched(thing, "enabled", dynamic)
        shown = in_blender()[:, 0, :3, 3]
        run, _, poses = full_bake(program, folder)
        assert lines(run.shot) == [], (animated, dynamic, lines(run.shot))
        assert np.abs(poses[:, 0, :3] @ UP.T - shown).max() < 5e-3, (animated, dynamic, poses[:, 0, :3] @ UP.T, shown)


def test_stops_otherwise_than_in_blender(_program, _folder):
    """Blender keeps the velocity of keys during a stop, and forgets the way of keys since Dynamic is on."""
    stage(DOWN, 30)
    switched(thrown("stopped"), "enabled", ((1, False), (16, True)))
    switched(thrown("early", 4, ((1, True), (16, False))), "enabled", ((1, False), (FREE, True)))
    shot = exporting.export(bpy.context, ALL)
    assert lines(shot) == [
        "1 object stopped by Dynamic after Animated: released at rest, in Blender with the velocity of its keys: "
        "'stopped'",
        "1 object with Dynamic turned on while Animated: released where keys lead it, in Blender where it was then: "
        "'early'"], lines(shot)


def test_releases_otherwise_than_in_blender(program, folder):
    """Blender lets bodies sleep that Dynamic stops, and gives them the wind of the frames before their release."""
    def wind():
        bpy.ops.object.effector_add(type="WIND", rotation=(0, np.pi / 2, 0))
        bpy.context.object.field.strength, bpy.context.object.field.flow = 50, 0

    told = {"stopped": exporting.DEACTIVATED, "blown": exporting.IN_WIND}
    for name, text in told.items():
        scene = stage(DOWN, 25)
        if name == "blown":
            wind()
            switched(block(name, (0, 0, 2), kinematic=True), "kinematic", ((1, True), (FREE, False)))
        else:
            switched(block(name, (0, 0, 2), use_deactivation=True), "enabled", ((1, False), (FREE, True)))
        shown = in_blender()[-1, 0, :3, 3]
        run, _, poses = full_bake(program, folder)
        assert lines(run.shot) == [f"1 object{text}: '{name}'"], lines(run.shot)
        place = poses[-1, 0, :3] @ UP.T
        assert place[2] < 1 and (shown[2] == 2 if name == "stopped" else shown[0] > place[0] + 0.2), (shown, place)
        for thing in scene.objects:
            if thing.name == "Wind":
                thing.field.strength = 0
            else:
                thing.rigid_body.use_deactivation = False
        assert lines(exporting.export(bpy.context, ALL)) == []


def test_one_animated_among_a_thousand(_program, folder):
    """An export evaluates no simulation, so that it takes seconds with a thousand bodies."""
    scene = stage(DOWN, 240)
    thrown()
    data = bpy.data.objects["thrown"].data
    things = []
    for i in range(1000):
        thing = bpy.data.objects.new(f"thing {i}", data)
        thing.location = (i % 10 * 1.5, 3 + i // 10 % 10 * 1.5, i // 100 * 1.5)
        scene.collection.objects.link(thing)
        thing.select_set(True)
        things.append(thing)
    bpy.context.view_layer.objects.active = things[0]
    bpy.ops.rigidbody.objects_add(type="ACTIVE")
    start = time.perf_counter()
    shot = exporting.export(bpy.context, exporting.Abilities())
    shot.write(folder / "a.json")
    taken = time.perf_counter() - start
    print(f"release: 1 animated body among 1000 by 240 frames is exported in {taken:.1f} s")
    assert taken < 15 and len(shot.document["bodies"][0]["track"]) == FREE - 1
