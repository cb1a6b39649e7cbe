"""Shapes and rotations that the scenes of make.py and machines.py share."""

import math


def turn(axis, angle):
    """Quaternion x y z w about a unit axis."""
    s = math.sin(angle / 2)
    return [axis[0] * s, axis[1] * s, axis[2] * s, math.cos(angle / 2)]


def box(*half_extents):
    return {"type": "box", "half_extents": list(half_extents)}


def floor(dimension=3, **more):
    normal = [0.0, 1.0, 0.0][:dimension]
    shape = {"type": "halfspace", "normal": normal}
    return {"name": "floor", "motion": "static", **more, "shapes": [shape]}
