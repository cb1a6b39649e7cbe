"""Transform locks of active objects: joints to the world for places, infinite moments of inertia for turns.

Blender multiplies forces and torques by 0 along the locked axes of the world.
"""

import re

import numpy as np
from mathutils import Matrix, Quaternion, Vector

from .findings import CHANGED, counted
from .instances import unique
from .joints import FREE
from .masses import mass_keys, solid_of
from .space import turned

# Coordinates of a joint along Blender's axes x, y and z.
COORDINATES = ("x", "z", "y")
# Velocities below this are none. [m/s, or rad/s]
SLOW = 1e-4

ONE = " with one locked axis of rotation: turns about it, too; locks of two or of all three axes act"
FAST = " released with a velocity along or about a locked axis: without it, in Blender it stays"


def locks_of(thing):
    """Returns the locked axes of an object's place, and those of its rotation, by index; None without any."""
    place, turn = ([i for i in range(3) if of[i]] for of in (thing.lock_location, thing.lock_rotation))
    return (place, turn) if place or turn else None


def is_lock(joint):
    """Tells whether a joint is a lock of one body: constraints join two."""
    return len(joint["bodies"]) == 1


def is_filter(joint):
    """Tells whether a joint does nothing but to keep collisions off for another one, which may break."""
    return "breaking" not in joint and FREE.items() <= joint.items()


def add_locks(document, locks, findings):
    """Adds locks to the dynamic bodies of a scene; `locks` has the locked axes by name."""
    joints = document.get("joints", [])
    names = {joint["name"] for joint in joints}
    for body in document["bodies"]:
        place, turn = locks.get(body["name"], ([], []))
        if body["motion"] != "dynamic":
            continue
        if place:
            joints.append(_joint(body, place, unique(f"{body['name']}: locks", names)))
        if len(turn) == 1:
            findings.add(CHANGED, "object", ONE, body["name"])
        elif turn:
            body |= _inertia(body, turn)
        if _loses_speed(body, place, turn):
            findings.add(CHANGED, "object", FAST, body["name"])
    if joints:
        document["joints"] = joints


def of_constraints(lines, joints):
    """Returns the lines of a summary of a bake without its locks, so that constraints that join alone are joints."""
    names = [joint["name"] for joint in joints if is_lock(joint) or is_filter(joint)]
    others = counted(len(joints) - len(names), "joint")
    found = []
    for line in lines:
        if not names or not line.startswith("joints"):
            found.append(line)
        elif len(names) < len(joints):
            misses, *broke = line.split(";")
            misses = re.sub(r"\d+ joints?", others, misses, count=1)
            # The joint that is off most speaks for all.
            misses = misses.split(",")[0] if any(f"'{name}'" in misses for name in names) else misses
            found.append(";".join([misses, *broke]))
    return found


def _released(body):
    """Returns the pose at which a body begins to move freely."""
    return body["track"][-1] if body.get("track") else body


def _joint(body, place, name):
    """Returns the joint that holds the origin of a body along axes of the world."""
    frames = [{"position": [0, 0, 0]}, {"position": _released(body)["position"]}]
    return {"name": name, "type": "general", "bodies": [body["name"]], "frames": frames, "collide": True,
            **{COORDINATES[axis]: "locked" for axis in place}}


def _inertia(body, turn):
    """Returns the keys of inertia of a body that turns about one axis of the world, or about none."""
    if len(turn) == 3:
        return {"inertia": ["inf"] * 3, "inertia_rotation": [0, 0, 0, 1]}
    free = next(axis for axis in range(3) if axis not in turn)
    axis = _quaternion(_released(body)["rotation"]).inverted() @ Vector(turned(Matrix.Identity(3)[free]))
    keys = body if "inertia" in body else mass_keys([solid_of(shape) for shape in body["shapes"]], body["mass"])
    along = _quaternion(keys["inertia_rotation"]).inverted() @ axis
    # Bullet takes the response to a torque about the axis, 1 / (n I^-1 n), and drops the rest of it.
    moment = 1 / (np.square(along) / keys["inertia"]).sum()
    to_axis = Vector((1, 0, 0)).rotation_difference(axis)
    return {"inertia": [moment, "inf", "inf"], "inertia_rotation": [to_axis.x, to_axis.y, to_axis.z, to_axis.w]}


def _quaternion(rotation):
    x, y, z, w = rotation
    return Quaternion((w, x, y, z))


def _loses_speed(body, place, turn):
    """Tells whether a body is released with a velocity that its locks take from it."""
    linear, angular = Vector(body.get("linear_velocity", (0, 0, 0))), Vector(body.get("angular_velocity", (0, 0, 0)))
    if len(body.get("track", ())) > 1:
        before, after = body["track"][-2:]
        time = after["time"] - before["time"]
        linear = (Vector(after["position"]) - Vector(before["position"])) / time
        spin = _quaternion(after["rotation"]) @ _quaternion(before["rotation"]).inverted()
        angular = Vector(spin.to_exponential_map()) / time
    # A body that cannot be turned at all keeps its spin, as in Blender.
    turn = turn if len(turn) == 2 else []
    axes = np.array([turned(axis) for axis in Matrix.Identity(3)])
    lost = [*np.abs(axes @ linear)[place], *np.abs(axes @ angular)[turn]]
    return max(lost, default=0) > SLOW
