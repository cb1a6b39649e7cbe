"""Helpers of the tests: scenes, bakes, and how far Blender shows them apart."""

import json
import math
import subprocess
import time
from pathlib import Path

import bpy
import numpy as np
from drystone import applying, baking, binary, exporting
from drystone.space import rigid

# Largest distance of a key from the bake. [m], [rad]
PLACE, TURN = 1e-5, 1e-4
DOWN = (0, 0, -9.81)
# A bake that takes seconds, so that it can be stopped midway.
LONG = baking.Options(substeps=40)


def empty(fps=24, last=240):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = fps, 1, last
    bpy.ops.rigidbody.world_add()
    return scene


def add(make, kind, shape, name, **more):
    """An object made by an operator of Blender, with a rigid body."""
    make()
    thing = bpy.context.object
    thing.name = name
    bpy.ops.rigidbody.object_add(type=kind)
    thing.rigid_body.collision_shape = shape
    for key, value in more.items():
        setattr(thing.rigid_body, key, value)
    return thing


def cube(size, place):
    return lambda: bpy.ops.mesh.primitive_cube_add(size=size, location=place)


def bake(command, scene, arrays, poses, *more):
    subprocess.run([command, "bake", scene, "-q", "-o", arrays, "-o", poses, *more], check=True)
    document = json.loads(Path(scene).read_text())
    count = len(document["bodies"])
    numbers = np.fromfile(poses, "<f4").reshape(-1, count, 7)
    return document, numbers


def axes(w, x, y, z):
    """Rotation matrices of quaternions."""
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


# z up from y up, and back: places and axes alike.
UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)


def differences(document, numbers):
    """Farthest that Blender shows a body from the bake, over all frames. [m], [rad]"""
    scene = bpy.context.scene
    assert scene.frame_end - scene.frame_start + 1 == len(numbers), "frame range"
    things = [scene.objects[body["name"]] for body in document["bodies"]]
    place, turn = 0.0, 0.0
    for i, frame in enumerate(range(scene.frame_start, scene.frame_end + 1)):
        scene.frame_set(frame)
        shown = np.array([rigid(thing) for thing in things])
        wanted = numbers[i].astype(float)
        place = max(place, np.abs(shown[:, :3, 3] - wanted[:, :3] @ UP.T).max())
        x, y, z, w = wanted[:, 3:].T
        apart = shown[:, :3, :3] - UP @ axes(w, x, y, z) @ UP.T
        turn = max(turn, np.linalg.norm(apart, axis=(1, 2)).max() / math.sqrt(2))
    return place, turn


def stage(gravity, last=49):
    """A scene for joints, with steps of Blender so short that they hardly matter."""
    scene = empty(last=last)
    scene.gravity = gravity
    scene.rigidbody_world.substeps_per_frame = 100
    scene.rigidbody_world.solver_iterations = 100
    return scene


def block(name, place, kind="ACTIVE", size=1.0, **more):
    """A box without damping."""
    more = {"linear_damping": 0, "angular_damping": 0, "use_deactivation": False, **more}
    return add(cube(size, place), kind, "BOX", name, **more)


def constrain(kind, first, second, place=(0, 0, 0), rotation=(0, 0, 0), name="joint", **more):
    """An empty with a rigid body constraint."""
    bpy.ops.object.empty_add(location=place, rotation=rotation)
    thing = bpy.context.object
    thing.name = name
    bpy.ops.rigidbody.constraint_add(type=kind)
    of = thing.rigid_body_constraint
    of.object1, of.object2, of.disable_collisions = first, second, True
    for key, value in more.items():
        setattr(of, key, value)
    return thing


def limits(**ranges):
    """Settings of limits: lin_x=(0, 1)."""
    settings = {}
    for axis, (lower, upper) in ranges.items():
        settings |= {f"use_limit_{axis}": True, f"limit_{axis}_lower": lower, f"limit_{axis}_upper": upper}
    return settings


def locked(*axes):
    return limits(**{axis: (0, 0) for axis in axes})


LINEAR, ANGULAR = ("lin_x", "lin_y", "lin_z"), ("ang_x", "ang_y", "ang_z")


def in_blender():
    """Poses of all active bodies as Blender simulates them: frame, body, 4 x 4."""
    scene = bpy.context.scene
    things = [thing for thing in scene.objects if thing.rigid_body and thing.rigid_body.type == "ACTIVE"]
    poses = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        poses.append([np.array(rigid(thing)) for thing in things])
    scene.frame_set(scene.frame_start)
    return np.array(poses)


def in_drystone(command, folder, said=()):
    """The same as Drystone bakes them; the export says what it is expected to."""
    shot = export(folder / "joints.json")
    assert lines(shot) == list(said), lines(shot)
    document, numbers = bake(command, folder / "joints.json", folder / "j.npz", folder / "j.poses")
    moving = [i for i, body in enumerate(document["bodies"]) if body["motion"] == "dynamic"]
    numbers = numbers[:, moving].astype(float)
    poses = np.zeros((*numbers.shape[:2], 4, 4))
    poses[..., 3, 3] = 1
    poses[..., :3, 3] = numbers[..., :3] @ UP.T
    x, y, z, w = np.moveaxis(numbers[..., 3:], -1, 0)
    poses[..., :3, :3] = UP @ axes(w, x, y, z) @ UP.T
    return poses


def export(path, program=None, **more):
    """Writes the scene; returns the export. Without a program, keys of the first version alone."""
    abilities = binary.abilities(Path(program)) if program else exporting.Abilities()
    shot = exporting.export(bpy.context, abilities, **more)
    shot.write(path)
    return shot


def lines(shot):
    return [finding.sentence() for finding in shot.findings]


def full_bake(program, folder, options=baking.Options()):
    """Bakes the scene as the panel does; returns the bake, its document and its poses."""
    run = baking.Bake(bpy.context, program, options, folder)
    run.finish()
    _, _, poses = applying.read_bake(run.output)
    return run, run.shot.document, poses


def heap(count=1000, last=240):
    """Boxes above a floor."""
    scene = empty(last=last)
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=60), "PASSIVE", "BOX", "ground")
    first = block("thing 0", (0, 0, 0.3), size=0.4)
    things = [first]
    for i in range(1, count):
        thing = bpy.data.objects.new(f"thing {i}", first.data)
        scene.collection.objects.link(thing)
        thing.select_set(True)
        things.append(thing)
    for i, thing in enumerate(things):
        x, y, z = i % 10, i // 10 % 10, i // 100
        thing.location = (0.45 * (x - 4.5) + 0.02 * z, 0.45 * (y - 4.5), 0.3 + 0.6 * z)
    bpy.context.view_layer.objects.active = first
    bpy.ops.rigidbody.objects_add(type="ACTIVE")
    bpy.context.view_layer.update()
    return scene


def midway(bake):
    """Goes on with a bake until the program tells of its first frame."""
    while not (bake.process and binary.frames_done(bake.process.messages()) is not None):
        assert bake.poll(), "ended before the first frame"
        time.sleep(0.005)
