"""Tests of five scenes as artists build them, beside Blender's own simulation, in small sizes."""

import math

import bpy
import compare
import numpy as np
import scenes
from drystone.joints import BREAKS
from drystone.shapes import CENTER

# Differences that do not count. [m]
OVERLAP, APART, CREEP = 1e-4, 1e-4, 1e-4


def compare_one(program, folder, name):
    """Bakes a scene as it is, but for what breaks, and measures no worse than Blender at 60/50."""
    (baked, ours), (_, theirs) = compare.compared(program, name, True, folder, settings=[(60, 50)])
    print(f"scenes: {name}: overlap {ours.overlap * 1e3:.2f} mm beside {theirs.overlap * 1e3:.2f} mm, "
          f"creep {ours.creep * 1e3:.2f} mm beside {theirs.creep * 1e3:.2f} mm, "
          f"stood {ours.stood:.0%} beside {theirs.stood:.0%}")
    assert [line for line in baked.findings if BREAKS not in line and CENTER not in line] == [], baked.findings
    assert ours.overlap < theirs.overlap + OVERLAP, (ours, theirs)
    assert ours.apart < theirs.apart + APART, (ours, theirs)
    assert ours.creep < theirs.creep + CREEP, (ours, theirs)
    assert ours.stood >= theirs.stood, (ours, theirs)


def test_wall(program, folder):
    compare_one(program, folder, "wall")


def test_bowl(program, folder):
    compare_one(program, folder, "bowl")


def test_statue(program, folder):
    compare_one(program, folder, "statue")


def test_dominoes(program, folder):
    compare_one(program, folder, "dominoes")


def test_habits(program, folder):
    compare_one(program, folder, "habits")


def two_cubes(place, first=(0, 0, 0), second=(0, 0, 0)):
    scenes.begin("judge", 2)
    cube = scenes.box_mesh("cube", (1, 1, 1))
    scenes.put("a", cube, (0, 0, 0), rotation=first)
    scenes.put("b", cube, place, rotation=second)


def overlap_of(stage):
    """Returns the deepest overlap of a scene as it is."""
    bpy.context.view_layer.update()
    judge = compare.Judge(stage)
    return judge.overlap(np.array([judge.first]))[0]


def test_judge(_program, _folder):
    """The judge finds overlaps of boxes, a mug and a sphere that are known."""
    two_cubes((0.4, 0, 0.99))
    assert abs(overlap_of(scenes.Stage()) - 0.01) < 1e-6
    # Edge across edge.
    two_cubes((0, 0, math.sqrt(2) - 0.01), (math.pi / 4, 0, 0), (0, math.pi / 4, 0))
    assert abs(overlap_of(scenes.Stage()) - 0.01) < 1e-6
    scenes.begin("judge", 2)
    mesh, pieces = scenes.mug_mesh(radius=0.13, wall=0.025)
    scenes.put("mug", mesh, (0, 0, 0), shape="MESH")
    scenes.put("ball", scenes.ball_mesh("ball", 0.05), (0, 0, 0), shape="SPHERE")
    pieces = {"mug": pieces}
    assert overlap_of(scenes.Stage(pieces=pieces, spheres={"ball": 0.05})) == 0
    # The inner faces have their middle at the inner radius by cos(pi / 16).
    deep = 0.115 - 0.105 * math.cos(math.pi / 16)
    assert abs(overlap_of(scenes.Stage(pieces=pieces, spheres={"ball": 0.115})) - deep) < 1e-6
