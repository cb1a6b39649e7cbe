"""Tests of transform locks, beside Blender's own simulation."""

import math

import bpy
import numpy as np
from drystone import baking

from .common import DOWN, UP, add, axes, block, constrain, cube, full_bake, in_blender, lines, stage
from .release import thrown
from .stages import written


def locked(thing, location="", rotation=""):
    """Locks axes of an object: "xz" are two of them."""
    thing.lock_location = [axis in location for axis in "xyz"]
    thing.lock_rotation = [axis in rotation for axis in "xyz"]
    return thing


def fallen(location, rotation):
    """A turned block above the edge of a post, on which it falls in frame 12."""
    scene = stage(DOWN, 18)
    floor = add(cube(1, (0, 0, -0.5)), "PASSIVE", "BOX", "floor", friction=0)
    floor.scale = (60, 60, 1)
    add(cube(1, (-0.6, 0.3, 0.5)), "PASSIVE", "BOX", "post", friction=0)
    thing = locked(block("block", (0, 0, 2.5)), location, rotation)
    thing.rotation_euler = (0.4, 0.5, 0.3)
    scene.frame_set(1)


def beside_blender(program, folder, said=()):
    """Returns places and rotations of the first body by frame, of Blender and of Drystone."""
    shown = in_blender()[:, 0]
    run, document, poses = full_bake(program, folder)
    assert lines(run.shot) == list(said), lines(run.shot)
    index = next(i for i, body in enumerate(document["bodies"]) if body["motion"] == "dynamic")
    x, y, z, w = poses[:, index, 3:].T.astype(float)
    return shown[:, :3, 3], shown[:, :3, :3], poses[:, index, :3] @ UP.T, UP @ axes(w, x, y, z) @ UP.T, run


def test_locks_as_in_blender(program, folder):
    """A block falls on a post, free along and about all axes but the locked ones."""
    cases = [("y", ""), ("xy", ""), ("xyz", ""), ("", "xyz"), ("y", "xz"), ("", "yz"), ("xy", "xy"), ("xyz", "xyz")]
    for location, rotation in cases:
        fallen(location, rotation)
        place, turn, baked, turned, run = beside_blender(program, folder)
        off, apart = np.abs(place - baked).max(), np.linalg.norm(turn - turned, axis=(1, 2)).max() / math.sqrt(2)
        moved = np.abs(baked - baked[0]).max(axis=0)
        print(f"locks: {location or '-'} {rotation or '-'}: moved {moved.round(3)}, turned "
              f"{np.linalg.norm(turned[-1] - turned[0]) / math.sqrt(2):.3f}; off Blender by {off:.3f} m, {apart:.3f}")
        assert all(moved["xyz".index(axis)] < 1e-4 for axis in location), (location, moved)
        steps = turned[1:] @ turned[:-1].transpose(0, 2, 1)
        spins = np.abs([steps[:, 2, 1], steps[:, 0, 2], steps[:, 1, 0]]).max(axis=1)
        assert all(spins["xyz".index(axis)] < 1e-4 for axis in rotation), (rotation, spins)
        assert off < 0.06 and apart < 0.12, (location, rotation, off, apart)
        assert not any(line.startswith("joints") for line in run.said), run.said


def test_uneven_moments(program, folder):
    """A long block that can turn about one axis alone has Bullet's moment about it, which a motor shows."""
    # Gyroscopic forces of Bullet pass the locks, and act later.
    scene = stage((0, 0, 0), 11)
    thing = block("block", (0, 0, 0))
    for vertex in thing.data.vertices:
        vertex.co = [size * x for size, x in zip((2, 0.4, 0.3), vertex.co)]
    locked(thing, rotation="xy").rotation_euler = (0.4, 0.5, 0.3)
    constrain("MOTOR", block("wall", (0, 0, 9), "PASSIVE"), thing, rotation=(0, math.pi / 2, 0), use_motor_ang=True,
              motor_ang_target_velocity=50, motor_ang_max_impulse=0.3)
    scene.frame_set(1)
    _, turn, _, turned, _ = beside_blender(program, folder)
    shown, baked = (np.unwrap(np.arctan2(of[:, 1, 0], of[:, 0, 0])) for of in (turn, turned))
    assert np.ptp(shown) > 0.3 and np.abs(shown - baked).max() < 0.02 * np.ptp(shown), (shown, baked)


def test_a_door(program, folder):
    """A door with its origin at the hinge turns about it, hit by a ball, and wakes from a start asleep."""
    scene = stage((0, 0, 0), 30)
    door = locked(block("door", (0, 0, 0), use_deactivation=True, use_start_deactivated=True), "xyz", "xy")
    for vertex in door.data.vertices:
        vertex.co.x, vertex.co.y = vertex.co.x + 0.5, vertex.co.y * 0.1
    ball = add(cube(0.4, (0.8, -1, 0)), "ACTIVE", "SPHERE", "ball", kinematic=True)
    for frame, y in ((1, -1), (4, -0.6)):
        ball.location.y = y
        ball.keyframe_insert("location", frame=frame)
        ball.rigid_body.kinematic = frame < 4
        ball.rigid_body.keyframe_insert("kinematic", frame=frame)
    scene.frame_set(1)
    run, _, poses = full_bake(program, folder)
    scene.frame_set(30)
    angle = math.degrees(door.matrix_world.to_euler().z)
    assert np.abs(door.matrix_world.translation).max() < 1e-4 and abs(angle) > 30, (door.matrix_world, angle)
    assert "PROBLEM" not in {of.kind for of in run.shot.findings}, lines(run.shot)


def test_locks_of_released_bodies(program, folder):
    """Locks act from the release on, where it is; a velocity along them is named, as one axis of rotation is."""
    stage(DOWN, 25)
    thing = locked(thrown(), "yz", "xyz")
    loose = locked(block("loose", (0, 9, 0)), rotation="z")
    shown = in_blender()
    run, document, poses = full_bake(program, folder)
    assert lines(run.shot) == [
        "1 object released with a velocity along or about a locked axis: without it, in Blender it stays: 'thrown'",
        "1 object with one locked axis of rotation: turns about it, too; locks of two or of all three axes act: "
        "'loose'"], lines(run.shot)
    flown = poses[:, 0, :3] @ UP.T
    assert np.abs(flown[7:, 1:] - flown[7, 1:]).max() < 1e-3 and np.abs(flown[:, 0] - shown[:, 0, 0, 3]).max() < 5e-3
    assert len(document["joints"]) == 1 and document["joints"][0]["collide"]
    locked(thing, "y", "xyz")
    locked(loose)
    run, _, poses = full_bake(program, folder)
    assert lines(run.shot) == [] and np.abs(poses[:, 0, :3] @ UP.T - shown[:, 0, :3, 3]).max() > 0.1


def test_locks_from_here(program, folder):
    """A later part of a bake has the same locks, at the place to which a body was moved by hand; stages, too."""
    scene = stage(DOWN, 30)
    things = [locked(block(name, (x, 0, 10)), "xy", "xy") for x, name in ((0, "kept"), (9, "moved"))]
    constrain("POINT", block("wall", (5, 5, 9), "PASSIVE"), block("hangs", (5, 5, 5)), (5, 5, 9))
    add(cube(1, (0.3, 0.2, 7)), "PASSIVE", "BOX", "post")
    for thing in things:
        thing.rotation_euler = (0.1, 0.2, 0)
    scene.frame_set(1)
    run, _, whole = full_bake(program, folder)
    assert [line for line in run.said if line.startswith("joints")][0].startswith("joints       1 joint"), run.said
    scene.frame_set(8)
    things[1].location.x = 10
    baking.Bake(bpy.context, program, baking.Options(), folder, from_here=True).finish()
    scene.frame_set(30)
    shown = [np.array(thing.matrix_world.translation) for thing in things]
    assert np.abs(shown[0] - whole[-1, 0, :3] @ UP.T).max() < 1e-3, (shown, whole[-1, 0])
    assert np.abs(shown[1][:2] - (10, 0)).max() < 1e-4, shown
    assert "moved" in written(program, folder, False)
