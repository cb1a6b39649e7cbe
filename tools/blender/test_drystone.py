#!/usr/bin/env python3
"""Tests the add-on in Blender: python tools/blender/test_drystone.py --drystone DRYSTONE

Needs Blender as a module: pip install bpy==5.0.1 (Python 3.11). Prints what it measured; an error ends it.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import drystone  # noqa: E402

# How far a key may be from the bake. [m], [rad]
PLACE, TURN = 1e-5, 1e-4
DOWN = (0, 0, -9.81)


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
        shown = np.array([drystone.rigid(thing) for thing in things])
        wanted = numbers[i].astype(float)
        place = max(place, np.abs(shown[:, :3, 3] - wanted[:, :3] @ UP.T).max())
        x, y, z, w = wanted[:, 3:].T
        apart = shown[:, :3, :3] - UP @ axes(w, x, y, z) @ UP.T
        turn = max(turn, np.linalg.norm(apart, axis=(1, 2)).max() / math.sqrt(2))
    return place, turn


def shapes(command, folder):
    """Every shape, a compound, a parent, an animated body: exported, baked, back."""
    scene = empty(last=60)
    mesh = bpy.ops.mesh
    ground = add(lambda: mesh.primitive_plane_add(size=20), "PASSIVE", "MESH", "ground", friction=0.8)
    add(cube(0.5, (0, 0, 2)), "ACTIVE", "BOX", "box", mass=3, friction=0.6, restitution=0.2)
    long = add(cube(1, (2, 0, 1.5)), "ACTIVE", "BOX", "scaled box")
    long.scale, long.rotation_euler = (0.2, 0.4, 1.1), (0.3, 0.2, 0.5)
    add(lambda: mesh.primitive_uv_sphere_add(radius=0.3, location=(-2, 0, 2)), "ACTIVE", "SPHERE", "ball")
    roll = add(lambda: mesh.primitive_cylinder_add(radius=0.2, depth=0.8, location=(0, 2, 2)), "ACTIVE",
               "CYLINDER", "roll")
    roll.rotation_euler = (0, math.pi / 2, 0)
    add(lambda: mesh.primitive_cylinder_add(radius=0.2, depth=1, location=(0, -2, 2)), "ACTIVE", "CAPSULE",
        "pill")
    add(lambda: mesh.primitive_cone_add(radius1=0.4, depth=0.8, location=(3, 2, 2)), "ACTIVE", "CONE", "cone")
    add(lambda: mesh.primitive_monkey_add(size=0.6, location=(-3, 2, 2)), "ACTIVE", "CONVEX_HULL", "monkey")
    pusher = add(cube(1, (-6, -4, 0.5)), "PASSIVE", "BOX", "pusher", kinematic=True)
    for frame, x in ((1, -6), (60, -2)):
        pusher.location.x = x
        pusher.keyframe_insert("location", frame=frame)
    add(cube(0.6, (-3, -4, 0.3)), "ACTIVE", "BOX", "pushed")
    hammer = add(cube(0.3, (4, -3, 1.5)), "ACTIVE", "COMPOUND", "hammer")
    for name, place in (("head", (4, -3, 1.5)), ("shaft", (4.4, -3, 1.5))):
        part = add(cube(0.3, place), "ACTIVE", "BOX", name)
        part.parent = hammer
        part.matrix_parent_inverse = hammer.matrix_world.inverted()
    holder = bpy.data.objects.new("holder", None)
    holder.location, holder.rotation_euler = (1, 1, 0), (0, 0, 0.7)
    scene.collection.objects.link(holder)
    child = add(cube(0.4, (0, 0, 3)), "ACTIVE", "BOX", "child")
    child.parent = holder
    add(lambda: mesh.primitive_torus_add(location=(6, 6, 0)), "PASSIVE", "MESH", "ring")
    add(lambda: mesh.primitive_circle_add(radius=1, location=(6, 0, 0.5), fill_type="NGON"), "PASSIVE",
        "CONVEX_HULL", "table")
    add(cube(0.4, (6, 0, 1)), "ACTIVE", "CONVEX_HULL", "cup")
    bpy.context.view_layer.update()

    file = folder / "shapes.json"
    notes = drystone.export(bpy.context, file)
    assert notes == [], notes
    document, numbers = bake(command, file, folder / "a.npz", folder / "a.poses")
    by_name = {body["name"]: body for body in document["bodies"]}
    assert len(by_name) == 15 and len(by_name["hammer"]["shapes"]) == 2, sorted(by_name)
    assert by_name["scaled box"]["shapes"][0]["half_extents"] == [0.1, 0.55, 0.2] or np.allclose(
        by_name["scaled box"]["shapes"][0]["half_extents"], [0.1, 0.55, 0.2])
    assert len(by_name["pusher"]["track"]) == 60 and by_name["ground"]["motion"] == "static"
    # In a second a body keeps 0.96 of its velocity and 0.9 of its turning, as Blender has it by default.
    damped = [math.exp(-by_name["box"][key]) for key in ("linear_damping", "angular_damping")]
    assert np.allclose(damped, [0.96, 0.9], atol=1e-6), damped
    assert len(numbers) == 60
    count, missing = drystone.apply(bpy.context, folder / "a.npz")
    assert (count, missing) == (11, []), (count, missing)
    place, turn = differences(document, numbers)
    print(f"shapes: {len(by_name)} bodies, {len(numbers)} frames, off by {place:.1e} m, {turn:.1e} rad")
    assert place < PLACE and turn < TURN
    # What is seen lies on the ground: the shapes are where the objects are.
    low, name = min(((thing.matrix_world @ v.co).z, thing.name) for thing in scene.objects
                    if thing.type == "MESH" and thing.name != "ring" for v in thing.data.vertices)
    cup = scene.objects["cup"].matrix_world.translation.z
    assert abs(cup - 0.7) < 1e-3, cup
    print(f"shapes: the lowest vertex, of {name}, is at {low * 1e3:.2f} mm")
    assert low > -2e-3
    # A second export of what carries a bake is the first.
    drystone.export(bpy.context, folder / "again.json")
    again = json.loads((folder / "again.json").read_text())
    motions = [[(body["name"], body["motion"]) for body in of["bodies"]] for of in (document, again)]
    assert motions[0] == motions[1]
    assert ground.animation_data is None


def thousand(command, folder):
    """1000 boxes and balls by 240 frames."""
    scene = empty(last=240)
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=60), "PASSIVE", "BOX", "ground")
    bpy.ops.mesh.primitive_cube_add(size=0.4)
    block = bpy.context.object.data
    bpy.data.objects.remove(bpy.context.object)
    things = []
    for i in range(1000):
        x, y, z = i % 10, i // 10 % 10, i // 100
        thing = bpy.data.objects.new(f"thing {i}", block)
        thing.location = (0.45 * (x - 4.5) + 0.02 * z, 0.45 * (y - 4.5), 0.3 + 0.6 * z)
        scene.collection.objects.link(thing)
        things.append(thing)
    for thing in things:
        thing.select_set(True)
    bpy.context.view_layer.objects.active = things[0]
    bpy.ops.rigidbody.objects_add(type="ACTIVE")
    for i, thing in enumerate(things):
        thing.rigid_body.collision_shape = "SPHERE" if i % 3 == 0 else "BOX"
    bpy.context.view_layer.update()

    start = time.perf_counter()
    drystone.export(bpy.context, folder / "many.json")
    exported = time.perf_counter()
    document, numbers = bake(command, folder / "many.json", folder / "b.npz", folder / "b.poses",
                             "--realtime")
    baked = time.perf_counter()
    count, missing = drystone.apply(bpy.context, folder / "b.npz")
    applied = time.perf_counter()
    assert (count, missing) == (1000, []) and len(numbers) == 240
    action = bpy.data.actions[-1]
    for bag in action.layers[0].strips[0].channelbags:
        for curve in bag.fcurves:
            frames = [point.co.x for point in curve.keyframe_points]
            assert frames == list(range(1, 241)), "keys are not at whole frames"
    place, turn = differences(document, numbers)
    print(f"thousand: {count} bodies, {len(numbers)} frames, off by {place:.1e} m, {turn:.1e} rad; export "
          f"{exported - start:.1f} s, bake {baked - exported:.1f} s, keys {applied - baked:.1f} s")
    assert place < PLACE and turn < TURN


def other_rates(command, folder):
    """A bake of 60 steps a second on a scene of 24 frames: keys at whole frames, from its first to its last."""
    scene = empty(fps=24, last=10)
    add(cube(1, (0, 0, 3)), "ACTIVE", "BOX", "crate")
    document = {"steps": 60, "bodies": [
        {"name": "crate", "position": [0, 3, 0], "angular_velocity": [0, 1, 0],
         "shapes": [{"type": "box", "half_extents": [0.5, 0.5, 0.5]}]},
        {"name": "gone", "shapes": [{"type": "sphere", "radius": 0.1}], "position": [9, 0, 0]}]}
    (folder / "rate.json").write_text(json.dumps(document))
    bake(command, folder / "rate.json", folder / "c.npz", folder / "c.poses")
    assert drystone.apply(bpy.context, folder / "c.npz") == (1, ["gone"])
    assert (scene.frame_start, scene.frame_end) == (1, 25)
    scene.frame_set(25)
    fallen = 3 - bpy.data.objects["crate"].matrix_world.translation.z
    turned = bpy.data.objects["crate"].matrix_world.to_euler().z
    print(f"other rates: after 1 s fallen {fallen:.3f} m, turned {turned:.4f} rad")
    assert abs(fallen - 9.81 / 2) < 0.02 and abs(turned - 1) < 1e-3


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
        poses.append([np.array(drystone.rigid(thing)) for thing in things])
    scene.frame_set(scene.frame_start)
    return np.array(poses)


def in_drystone(command, folder, said=()):
    """The same as Drystone bakes them; the export says what it is expected to."""
    notes = drystone.export(bpy.context, folder / "joints.json")
    assert notes == list(said), notes
    document, numbers = bake(command, folder / "joints.json", folder / "j.npz", folder / "j.poses")
    moving = [i for i, body in enumerate(document["bodies"]) if body["motion"] == "dynamic"]
    numbers = numbers[:, moving].astype(float)
    poses = np.zeros((*numbers.shape[:2], 4, 4))
    poses[..., 3, 3] = 1
    poses[..., :3, 3] = numbers[..., :3] @ UP.T
    x, y, z, w = np.moveaxis(numbers[..., 3:], -1, 0)
    poses[..., :3, :3] = UP @ axes(w, x, y, z) @ UP.T
    return poses


def beside_blender(command, folder, name, near=5e-3, turn=1e-2):
    """Bakes a scene, and compares with Blender's own simulation; returns the poses of the bake."""
    shown, baked = in_blender(), in_drystone(command, folder)
    place = np.abs(shown[..., :3, 3] - baked[..., :3, 3]).max()
    apart = np.linalg.norm(shown[..., :3, :3] - baked[..., :3, :3], axis=(-2, -1)).max() / math.sqrt(2)
    moved = np.abs(baked[..., :3, 3] - baked[:1, :, :3, 3]).max()
    print(f"{name}: moved {moved:.3f} m, off Blender by {place * 1e3:.2f} mm and {apart * 1e3:.2f} mrad")
    assert place < near and apart < turn, name
    return baked


def beside_a_wall(kind, wall_first, last=25, place=(1, 0.3, 0.2), rotation=(0.3, 0.4, 0.5), gravity=DOWN,
                  **more):
    """A block that a constraint joins to a wall, askew; either may be the first object."""
    stage(gravity, last)
    pair = block("wall", (0, 0, 3), "PASSIVE"), block("block", (0.5, 0.4, 0.3))
    return constrain(kind, *(pair if wall_first else pair[::-1]), place, rotation, **more)


def springs(**axes):
    """Settings of springs of type SPRING2: x=(stiffness, damping)."""
    settings = {"spring_type": "SPRING2"}
    for axis, (stiffness, damping) in axes.items():
        settings |= {f"use_spring_{axis}": True, f"spring_stiffness_{axis}": stiffness,
                     f"spring_damping_{axis}": damping}
    return settings


MOTOR = {"use_motor_lin": True, "motor_lin_target_velocity": 2, "motor_lin_max_impulse": 3,
         "use_motor_ang": True, "motor_ang_target_velocity": 3, "motor_ang_max_impulse": 0.3}


def joints_move(command, folder):
    """All kinds of constraints move bodies as Blender does, whichever object is the first."""
    for wall_first in (True, False):
        for kind in ("FIXED", "POINT", "HINGE", "SLIDER", "PISTON"):
            beside_a_wall(kind, wall_first)
            beside_blender(command, folder, f"joints: {kind}")
        for free in LINEAR + ANGULAR:
            # Bullet has no hinge about y beyond 90 degrees.
            beside_a_wall("GENERIC", wall_first, last=12,
                          **locked(*(axis for axis in LINEAR + ANGULAR if axis != free)))
            beside_blender(command, folder, f"joints: GENERIC, free in {free}")
        beside_a_wall("GENERIC", wall_first, last=20, **locked(*LINEAR, "ang_y"))
        beside_blender(command, folder, "joints: GENERIC, free in two angles")
        beside_a_wall("GENERIC_SPRING", wall_first, last=49, **locked(*ANGULAR),
                      **springs(x=(30, 3), y=(60, 3), z=(90, 2)))
        beside_blender(command, folder, "joints: GENERIC_SPRING, linear")
        beside_a_wall("GENERIC_SPRING", wall_first, last=49, **locked(*LINEAR),
                      **springs(ang_x=(30, 1), ang_y=(60, 1), ang_z=(90, 0.5)))
        beside_blender(command, folder, "joints: GENERIC_SPRING, angular")
        beside_a_wall("MOTOR", wall_first, last=49, gravity=(0, 0, 0), place=(0.5, 0.4, 0.3), **MOTOR)
        beside_blender(command, folder, "joints: MOTOR")
    # The axes of a constraint are those of its first object, which turns here.
    stage((0, 0, 0), 33)
    wall, first = block("wall", (0, 0, -5), "PASSIVE"), block("first", (0, 0, 0))
    second = block("second", (1.5, 0.3, 0.2), size=0.7)
    constrain("SLIDER", first, second, rotation=(0.2, 0.3, 0.4), name="rail")
    constrain("PISTON", wall, first, rotation=(0.1, -0.7, 1.1), name="axle")
    constrain("MOTOR", wall, first, rotation=(0.1, -0.7, 1.1), name="motor", **MOTOR)
    beside_blender(command, folder, "joints: a rail that a motor turns")


def others(settings):
    """Axes that a constraint locks beside those that a test limits: all linear ones, or all angles."""
    limited = [axis for axis in LINEAR + ANGULAR if f"use_limit_{axis}" in settings]
    several = len(limited) > 1
    return [axis for axis in (LINEAR if several else LINEAR + ANGULAR) if axis not in limited]


def joints_stop(command, folder):
    """Bodies come to rest at the same limits as in Blender, and start from the same side."""
    deg = math.radians
    ranges = [(-20, 50), (30, 30), (50, -50), (-360, 360), (-180, 180), (-200, 200), (-270, 0)]
    cases = [(kind, limits(**{axis: (deg(low), deg(high))})) for kind, axis in (("HINGE", "ang_z"),
             ("PISTON", "ang_x"), ("GENERIC", "ang_x"), ("GENERIC_SPRING", "ang_z")) for low, high in ranges]
    cases += [(kind, limits(lin_x=of)) for kind in ("SLIDER", "PISTON", "GENERIC")
              for of in ((-0.5, 1), (0.4, 0.4), (0.2, 0.6))]
    for several in (((-10, 25), (-20, 25), (-10, 40)), ((20, 20), (15, 15), (-30, -30))):
        several = [(deg(low), deg(high)) for low, high in several]
        cases.append(("GENERIC", limits(**dict(zip(ANGULAR, several)))))
    worst = 0
    for number, (kind, settings) in enumerate(cases * 2):
        if kind.startswith("GENERIC"):
            settings = locked(*others(settings)) | settings
        beside_a_wall(kind, number < len(cases), last=220, spring_type="SPRING2", **settings)
        bpy.context.scene.rigidbody_world.substeps_per_frame = 20
        moving = bpy.context.scene.objects["block"].rigid_body
        moving.linear_damping, moving.angular_damping = 0.9, 0.9
        shown, baked = in_blender()[-1, 0], in_drystone(command, folder)[-1, 0]
        if kind == "PISTON" and not settings.get("use_limit_lin_x"):
            # It falls along its axis; only the angle comes to rest.
            shown[:3, 3], baked[:3, 3] = 0, 0
        off = np.abs(shown - baked).max()
        worst = max(worst, off)
        assert off < 2e-3, (kind, settings, number < len(cases), off)
    print(f"joints: {2 * len(cases)} limits, at rest off Blender by {worst * 1e3:.3f} mm or mrad")


def pendulum(times, gravity, arm, inertia):
    """Angle below level of a pendulum of 1 kg that starts at rest there. [rad]"""
    count, angle, rate, angles = 100, 0.0, 0.0, [0.0]
    h, pull = (times[1] - times[0]) / count, gravity * arm / (inertia + arm * arm)
    for _ in times[1:]:
        for _ in range(count):
            # Velocity Verlet.
            rate += h / 2 * pull * math.cos(angle)
            angle += h * rate
            rate += h / 2 * pull * math.cos(angle)
        angles.append(angle)
    return np.array(angles)


def joints_by_formula(command, folder):
    """A pendulum, a slope, a damped spring and a motor against their solutions."""
    times = np.arange(49) / 24
    stage(DOWN)
    constrain("HINGE", block("wall", (0, 0, 3), "PASSIVE"), block("block", (1, 0, 0)),
              rotation=(math.pi / 2, 0, 0))
    place = in_drystone(command, folder)[:, 0, :3, 3]
    swung = np.unwrap(np.arctan2(-place[:, 2], place[:, 0]))
    off = np.abs(swung - pendulum(times, 9.81, 1, 1 / 6)).max()
    print(f"joints: a pendulum is off by {off * 1e3:.3f} mrad in 2 s")
    assert off < 2e-3

    stage(DOWN)
    constrain("SLIDER", block("block", (0, 0, 0)), None, rotation=(0, 0.5, 0), **limits(lin_x=(-2, 1)))
    said = ["1 constraint of one object, joined to the world, where Blender ignores it: 'joint'"]
    place = in_drystone(command, folder, said)[:, 0, :3, 3]
    slid = place @ [math.cos(0.5), 0, -math.sin(0.5)]
    off = np.abs(slid - np.minimum(9.81 * math.sin(0.5) / 2 * times**2, 2)).max()
    print(f"joints: a slider on a slope, up to its limit, is off by {off * 1e3:.3f} mm")
    assert off < 1e-3

    stage(DOWN)
    constrain("GENERIC_SPRING", block("wall", (0, 0, 3), "PASSIVE"), block("block", (0, 0, 0), mass=2),
              **springs(z=(80, 4)), **locked("lin_x", "lin_y", *ANGULAR))
    fallen = -in_drystone(command, folder)[:, 0, 2, 3]
    decay, rate = 4 / (2 * 2), math.sqrt(80 / 2 - 1)
    swing = np.exp(-decay * times) * (np.cos(rate * times) + decay / rate * np.sin(rate * times))
    off = np.abs(fallen - 2 * 9.81 / 80 * (1 - swing)).max()
    print(f"joints: a damped spring is off by {off * 1e3:.3f} mm")
    assert off < 2e-3

    stage((0, 0, 0))
    constrain("MOTOR", block("wall", (0, 0, 3), "PASSIVE"), block("block", (0, 0, 0)), **MOTOR)
    baked = in_drystone(command, folder)[:, 0]
    # Up to 2 m/s by 3 N, and up to 3 rad/s by 0.3 N m, against the axis of the second object.
    driven = np.where(times < 2 / 3, 1.5 * times**2, 2 * times - 2 / 3)
    turned = np.where(times < 5 / 3, 0.9 * times**2, 3 * times - 2.5)
    off = np.abs(-baked[:, 0, 3] - driven).max()
    angle = np.abs(np.unwrap(np.arctan2(-baked[:, 2, 1], baked[:, 1, 1])) - turned).max()
    print(f"joints: a motor is off by {off * 1e3:.3f} mm and {angle * 1e3:.3f} mrad")
    assert off < 3e-3 and angle < 4e-3


def joints_break(command, folder):
    """Constraints break at the impulses of Blender's steps; a bake says so."""
    for kind in ("FIXED", "POINT", "HINGE", "SLIDER"):
        for substeps in (1, 10):
            for part, holds in ((0.95, False), (1.05, True)):
                scene = stage(DOWN, 25)
                scene.rigidbody_world.substeps_per_frame = substeps
                constrain(kind, block("wall", (0, 0, 3), "PASSIVE"), block("block", (0, 0, 0)),
                          use_breaking=True, breaking_threshold=part * 9.81 / 24 / substeps)
                shown, baked = in_blender()[-1, 0, 2, 3], in_drystone(command, folder)[-1, 0, 2, 3]
                assert (shown > -0.01) == (baked > -0.01) == holds, (kind, substeps, part, shown, baked)
    said = drystone.bake(bpy.context, command, folder)
    assert any(line.startswith("joints") for line in said) and not any("broke" in line for line in said), said
    scene = stage(DOWN, 25)
    constrain("FIXED", block("wall", (0, 0, 3), "PASSIVE"), block("block", (0, 0, 0)), name="glue",
              use_breaking=True, breaking_threshold=1e-4)
    said = [line for line in drystone.bake(bpy.context, command, folder) if "broke: 'glue'" in line]
    assert len(said) == 1
    print(f"joints: {said[0]}")


def joints_as_documents(command, folder):
    """Collisions, enabled, compounds, parents, scales; and all that is left out is named."""
    scene = stage(DOWN, 25)
    wall, crate = block("wall", (0, 0, 3), "PASSIVE"), block("crate", (0, 0, 1))
    plain = bpy.data.objects.new("plain", None)
    scene.collection.objects.link(plain)
    hammer = add(cube(0.3, (4, -3, 1.5)), "ACTIVE", "COMPOUND", "hammer", linear_damping=0, angular_damping=0)
    for name, place in (("head", (4, -3, 1.5)), ("shaft", (4.4, -3, 1.5))):
        part = add(cube(0.3, place), "ACTIVE", "BOX", name)
        part.parent = hammer
        part.matrix_parent_inverse = hammer.matrix_world.inverted()
    head, shaft = scene.objects["head"], scene.objects["shaft"]
    constrain("POINT", wall, shaft, (4.5, -3, 1.5), name="handle")
    holder = bpy.data.objects.new("holder", None)
    holder.location, holder.rotation_euler, holder.scale = (1, 1, 0), (0, 0, 0.7), (2, 3, 0.5)
    scene.collection.objects.link(holder)
    child = constrain("FIXED", wall, crate, (0.5, 0.6, 0.7), name="child", disable_collisions=False,
                      use_breaking=True, breaking_threshold=3e38)
    child.parent, child.scale = holder, (4, 1, 1)
    constrain("FIXED", wall, crate, name="off", enabled=False)
    constrain("FIXED", wall, plain, name="bodiless")
    constrain("FIXED", None, None, name="empty")
    constrain("FIXED", head, shaft, name="within")
    constrain("FIXED", wall, None, name="still")
    constrain("FIXED", wall, crate, name="outside")
    scene.rigidbody_world.constraints.objects.unlink(scene.objects["outside"])
    far = limits(lin_x=(-3e38, 1), lin_y=(-3e38, 3e38), ang_x=(0, 0))
    constrain("GENERIC", wall, crate, name="far", **far)
    own = constrain("GENERIC_SPRING", wall, crate, name="old", use_override_solver_iterations=True,
                    **{**springs(x=(10, 0.5)), "spring_type": "SPRING1"})
    own.rigid_body_constraint.keyframe_insert("enabled", frame=1)
    constrain("POINT", None, crate, name="pinned")
    bpy.context.view_layer.update()
    notes = drystone.export(bpy.context, folder / "joints.json")
    assert notes == [
        "1 constraint left out, of an object that is no rigid body: 'bodiless' (plain)",
        "1 constraint left out, without an object: 'empty'",
        "1 constraint left out, of one body with itself: 'within'",
        "1 constraint left out, of bodies of which none is active: 'still'",
        "1 constraint left out, not in the collection of the rigid body world: 'outside'",
        "1 constraint whose number of iterations has no meaning: 'old'",
        "1 constraint with keys or drivers, of which the values at the first frame hold: 'old'",
        "1 constraint with springs of type Blender 2.7, without their damping: 'old'",
        "1 constraint of one object, joined to the world, where Blender ignores it: 'pinned'",
    ], notes
    joints = {joint["name"]: joint for joint in json.loads((folder / "joints.json").read_text())["joints"]}
    assert joints["child"]["breaking"] == {"force": "inf", "torque": "inf"}
    assert joints["far"]["x"] == {"limits": ["-inf", 1]} and joints["far"]["y"] == {"limits": ["-inf", "inf"]}
    assert sorted(joints) == ["child", "far", "handle", "off", "old", "pinned"]
    assert joints["handle"]["bodies"] == ["hammer", "wall"] and joints["pinned"]["bodies"] == ["crate", -1]
    assert [joints[name]["enabled"] for name in ("child", "off")] == [True, False]
    assert [joints[name]["collide"] for name in ("child", "off")] == [True, False]
    anchor = child.matrix_world.translation - crate.matrix_world.translation
    assert np.allclose(joints["child"]["frames"][0]["position"], [anchor.x, anchor.z, -anchor.y], atol=1e-6)
    _, poses = bake(command, folder / "joints.json", folder / "j.npz", folder / "j.poses")
    names = [body["name"] for body in json.loads((folder / "joints.json").read_text())["bodies"]]
    poses = poses[:, names.index("hammer")].astype(float)
    place, (x, y, z, w) = poses[:, :3], poses[:, 3:].T
    held = place + axes(w, x, y, z) @ joints["handle"]["frames"][0]["position"]
    off, moved = np.abs(held - [4.5, 1.5, 3]).max(), np.abs(place - place[0]).max()
    print(f"joints: a hammer swings {moved:.2f} m about its handle, which is off by {off * 1e3:.4f} mm")
    assert off < 1e-4 and moved > 0.3


def as_addon(command, folder):
    """Installed, one click on a scene."""
    drystone.register()
    scene = empty(last=48)
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=20), "PASSIVE", "BOX", "ground")
    add(cube(1, (0, 0, 2)), "ACTIVE", "BOX", "crate")
    drystone.command = lambda _context: command
    assert bpy.ops.drystone.bake() == {"FINISHED"}
    said = list(scene["drystone_said"])
    print(f"as add-on: {said}")
    assert said[0] == "1 bodies baked" and said[1].startswith("certified") and scene.frame_end == 48
    assert bpy.ops.drystone.export_scene(filepath=str(folder / "d.json")) == {"FINISHED"}
    assert json.loads((folder / "d.json").read_text())["steps"] == 47
    drystone.unregister()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drystone", type=Path, required=True)
    command = str(parser.parse_args().drystone.resolve())
    with tempfile.TemporaryDirectory() as folder:
        for test in (shapes, thousand, other_rates, joints_move, joints_stop, joints_by_formula, joints_break,
                     joints_as_documents, as_addon):
            test(command, Path(folder))
    print("add-on: all passed")


if __name__ == "__main__":
    main()
