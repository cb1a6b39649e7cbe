"""Tests of constraints, beside Blender's own simulation and formulas."""

import json
import math

import bpy
import numpy as np
from drystone import baking
from drystone.shapes import CENTER

from .common import (ANGULAR, DOWN, LINEAR, add, axes, bake, block, constrain, cube, export, full_bake,
                     in_blender, in_drystone, limits, lines, locked, stage)


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


def test_move(command, folder):
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


def test_stop(command, folder):
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


def test_by_formula(command, folder):
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
    constrain("SLIDER", block("block", (0, 0, 0)), block("wall", (0, 0, 3), "PASSIVE"), rotation=(0, 0.5, 0),
              **limits(lin_x=(-2, 1)))
    place = in_drystone(command, folder)[:, 0, :3, 3]
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


def test_break(command, folder):
    """Constraints break at the impulses of Blender's steps; a bake says so."""
    for kind in ("FIXED", "POINT", "HINGE", "SLIDER"):
        for substeps in (1, 10):
            for part, holds in ((0.95, False), (1.05, True)):
                scene = stage(DOWN, 25)
                scene.rigidbody_world.substeps_per_frame = substeps
                constrain(kind, block("wall", (0, 0, 3), "PASSIVE"), block("block", (0, 0, 0)), use_breaking=True,
                          disable_collisions=False, breaking_threshold=part * 9.81 / 24 / substeps)
                shown, baked = in_blender()[-1, 0, 2, 3], in_drystone(command, folder)[-1, 0, 2, 3]
                assert (shown > -0.01) == (baked > -0.01) == holds, (kind, substeps, part, shown, baked)
    said = full_bake(command, folder)[0].said
    assert any(line.startswith("joints") for line in said) and not any("broke" in line for line in said), said
    scene = stage(DOWN, 25)
    constrain("FIXED", block("wall", (0, 0, 3), "PASSIVE"), block("block", (0, 0, 0)), name="glue",
              use_breaking=True, breaking_threshold=1e-4)
    said = [line for line in full_bake(command, folder)[0].said if "broke: 'glue'" in line]
    assert len(said) == 1
    print(f"joints: {said[0]}")


def test_collisions_without_a_constraint(command, folder):
    """Disable Collisions holds for a disabled constraint, as in Blender; once it breaks, its objects collide."""
    said = ["1 constraint that may break, with Disable Collisions: once broken, the objects collide, in Blender they "
            "never do (Settings: Broken Pairs Pass): 'joint'"]
    for enabled, separated, breaks in ((False, True, False), (False, False, False), (True, True, True)):
        stage(DOWN, 25)
        add(cube(1, (0, 0, -0.5)), "PASSIVE", "BOX", "floor").scale = (60, 60, 1)
        lower, upper = block("lower", (0, 0, 0.5)), block("upper", (0, 0, 2))
        constrain("FIXED", lower, upper, enabled=enabled, disable_collisions=separated, use_breaking=breaks,
                  breaking_threshold=1e-4)
        shown, baked = in_blender()[-1, 1, 2, 3], in_drystone(command, folder, said if breaks else ())[-1, 1, 2, 3]
        assert (shown < 1.4) == separated and (baked < 1.4) == (separated and not breaks), (enabled, shown, baked)


def test_broken_pairs_pass(program, folder):
    """With the setting, objects of a broken constraint never collide, as in Blender, also from a frame on."""
    scene = stage(DOWN, 25)
    add(cube(1, (0, 0, -0.5)), "PASSIVE", "BOX", "floor").scale = (60, 60, 1)
    lower, upper = block("lower", (0, 0, 0.5)), block("upper", (0, 0, 2))
    constrain("FIXED", lower, upper, use_breaking=True, breaking_threshold=1e-4)
    shown = in_blender()[:, 1, 2, 3]
    options = baking.Options(broken_pass=True)
    run, document, poses = full_bake(program, folder, options)
    upper = [body["name"] for body in document["bodies"]].index("upper")
    assert shown[-1] < 0.6 and np.abs(poses[:, upper, 1] - shown).max() < 0.1, (poses[:, upper, 1], shown)
    assert lines(run.shot) == [] and any("broke: 'joint'" in line for line in run.said), run.said
    assert not any("2 joints" in line or "no collisions" in line for line in run.said), run.said
    scene.frame_set(12)
    again = baking.Bake(bpy.context, program, options, folder, from_here=True)
    again.finish()
    scene.frame_set(25)
    assert abs(bpy.data.objects["upper"].matrix_world.translation.z - poses[-1, upper, 1]) < 1e-2
    assert [joint["enabled"] for joint in again.shot.document["joints"]] == [False, True]


def odd_constraints():
    """A scene with constraints that joints have otherwise, or not at all."""
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
    return child, crate


def test_as_documents(command, folder):
    """Collisions, enabled, compounds, parents, scales; and all that is left out is named."""
    child, crate = odd_constraints()
    notes = lines(export(folder / "joints.json"))
    assert notes == [
        f"1 object{CENTER}: 'hammer'",
        "1 constraint of an object that is no body of the bake: left out: 'bodiless'",
        "1 constraint without an object: left out: 'empty'",
        "1 constraint of one body with itself: left out: 'within'",
        "1 constraint without an active body: left out: 'still'",
        "1 constraint outside of the rigid body world's collection: left out: 'outside'",
        "1 constraint with a number of iterations: it has no meaning: 'old'",
        "1 constraint with keys or drivers: the values at the first frame hold: 'old'",
        "1 constraint with springs of type Blender 2.7: without their damping: 'old'",
        "1 constraint of one object, which Blender ignores, too: left out: 'pinned'",
    ], notes
    joints = {joint["name"]: joint for joint in json.loads((folder / "joints.json").read_text())["joints"]}
    assert joints["child"]["breaking"] == {"force": "inf", "torque": "inf"}
    assert joints["far"]["x"] == {"limits": ["-inf", 1]} and joints["far"]["y"] == {"limits": ["-inf", "inf"]}
    assert sorted(joints) == ["child", "far", "handle", "off", "old"]
    assert joints["handle"]["bodies"] == ["hammer", "wall"]
    # A disabled one keeps collisions off.
    assert joints["off"]["enabled"] and joints["off"]["type"] == "general" and joints["child"]["type"] == "fixed"
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
