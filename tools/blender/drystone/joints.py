"""Joints of the rigid body constraints of a scene."""

import math

import numpy as np
from mathutils import Matrix

from .curves import animates
from .findings import CHANGED, LEFT_OUT
from .instances import unique
from .space import body_of, frames_per_second, objects_of, pose_of, rigid

# Largest finite load that Drystone takes. [N, or N m]
LARGEST_LOAD = 1e20
# Largest finite position and velocity of a joint that Drystone takes. [m, or m/s]
FARTHEST = 1e6
# Half a turn and a whole one in Blender's precision. [rad]
HALF_TURN, TURN = float(np.float32(math.pi)), float(np.float32(math.tau))


def joint_pose(local, axis):
    """Pose of a joint in the frame of a body, as Drystone has it: an axis of the constraint becomes x.

    The two axes that follow it cyclically become y and z.
    """
    x, y, z = (Matrix.Identity(3).col[(axis + i) % 3] for i in range(3))
    # pose_of makes (x, z, -y) of the axes.
    return pose_of(local @ Matrix((x, -z, y)).transposed().to_4x4())


def wrapped(angle):
    """The angle that Bullet takes a limit for: it differs by whole turns, and is at most half a turn."""
    angle = math.fmod(angle, TURN)
    return angle - math.copysign(TURN, angle) if abs(angle) > HALF_TURN else angle


def stated_limits(of, axis):
    """Lower and upper limit of an axis such as lin_x; None if it has none."""
    if not getattr(of, f"use_limit_{axis}"):
        return None
    return [getattr(of, f"limit_{axis}_{end}") for end in ("lower", "upper")]


def limits_of(of, axis):
    """Limits of an axis. None if it is free, as Bullet has it also if the lower one is above the upper."""
    limits = stated_limits(of, axis)
    if limits and axis.startswith("ang"):
        limits = [wrapped(limit) for limit in limits]
    return limits if limits and limits[0] <= limits[1] else None


def hinge_limits(of):
    """Limits of a hinge. Bullet shifts both by the same whole turns; a range of a whole turn is free."""
    limits = stated_limits(of, "ang_z")
    half = (limits[1] - limits[0]) / 2 if limits else -1
    if not 0 <= half < HALF_TURN:
        return None
    middle = wrapped(limits[0] + half)
    return [middle - half, middle + half]


def reversed_limits(limits):
    """Limits of the same coordinate, measured the other way."""
    return limits and [-limits[1], -limits[0]]


def load(value):
    """A load as JSON, infinite beyond the largest that Drystone takes."""
    return value if value <= LARGEST_LOAD else "inf"


def clamped(value, most):
    return max(-most, min(value, most))


def with_limits(limits):
    """The key of limits, if there are any; a lower or an upper one that is too far is none."""
    if not limits:
        return {}
    low, high = (clamped(limit, FARTHEST) for limit in limits)
    return {"limits": [low if low > -FARTHEST else "-inf", high if high < FARTHEST else "inf"]}


def spring_of(of, axis):
    """The spring of an axis such as x or ang_x. SPRING1 has no damping in N s/m."""
    if of.type != "GENERIC_SPRING" or not getattr(of, f"use_spring_{axis}"):
        return {}
    damping = getattr(of, f"spring_damping_{axis}") if of.spring_type == "SPRING2" else 0.0
    stiffness = getattr(of, f"spring_stiffness_{axis}")
    return {"spring": {"stiffness": min(stiffness, LARGEST_LOAD), "damping": min(damping, LARGEST_LOAD)}}


def motor_of(of, axis):
    """The motor of an axis, lin or ang. Blender's largest impulse is a force: Bullet divides it by the rate.

    Blender drives the first object relative to the second, and joints measure the second.
    """
    velocity = clamped(-getattr(of, f"motor_{axis}_target_velocity"), FARTHEST)
    return {"motor": {"velocity": velocity, "at_most": load(getattr(of, f"motor_{axis}_max_impulse"))}}


def hinge(of):
    """About z. Bullet measures the first object relative to the second."""
    return {"type": "hinge", **with_limits(reversed_limits(hinge_limits(of)))}


def slider(of):
    """Along x. Bullet measures the second object relative to the first."""
    return {"type": "slider", **with_limits(limits_of(of, "lin_x"))}


def piston(of):
    """Along and about x. Bullet measures the second object relative to the first in both."""
    twist = with_limits(limits_of(of, "ang_x"))
    return {"type": "piston", **with_limits(limits_of(of, "lin_x")), **({"twist": twist} if twist else {})}


def motor(of):
    """Along and about x, without locks. A Cardan angle would be singular at 90 degrees, a twist is not."""
    joint = {"type": "general"}
    if of.use_motor_lin:
        joint["x"] = motor_of(of, "lin")
    if of.use_motor_ang:
        joint["twist"] = motor_of(of, "ang")
    return joint


def free_axis(of):
    """The only axis that is not locked at 0, or x if all three are; None if there are several."""
    free = [i for i in range(3) if limits_of(of, f"ang_{'xyz'[i]}") != [0, 0]]
    return None if len(free) > 1 else free[0] if free else 0


def general(of):
    """All six axes. A single angle is one of a hinge, which counts turns; several are Cardan angles.

    Bullet measures positions of the second object along the axes of the first. Its angles are those of the
    first object relative to the second, R = Rx Ry Rz. The inverse has Drystone's order, Rz Ry Rx, and the
    opposite signs.
    """
    first = free_axis(of)
    names = ("angle_x", "angle_y", "angle_z") if first is None else ("twist", "swing_y", "swing_z")
    joint = {"type": "general"}
    for i, axis in enumerate("xyz"):
        place = (i - (first or 0)) % 3
        turning = reversed_limits(limits_of(of, f"ang_{axis}"))
        joint["xyz"[place]] = {**with_limits(limits_of(of, f"lin_{axis}")), **spring_of(of, axis)}
        joint[names[place]] = {**with_limits(turning), **spring_of(of, f"ang_{axis}")}
    return {key: value for key, value in joint.items() if value}


def main_axis(of):
    """The axis of a constraint that becomes x of its joint."""
    if of.type in ("GENERIC", "GENERIC_SPRING"):
        return free_axis(of) or 0
    return 2 if of.type == "HINGE" else 0


# Keys of the joint that a constraint becomes. Its first body is the second object.
JOINTS = {
    "FIXED": lambda _of: {"type": "fixed"},
    "POINT": lambda _of: {"type": "ball"},
    "HINGE": hinge,
    "SLIDER": slider,
    "PISTON": piston,
    "GENERIC": general,
    "GENERIC_SPRING": general,
    "MOTOR": motor,
}


BREAKS = ("that may break, with Disable Collisions: once broken, the objects collide, in Blender they never do "
          "(Settings: Broken Pairs Pass)")
# A joint that acts, as one that keeps collisions off must, and that bounds nothing.
FREE = {"type": "general", "x": {"limits": ["-inf", "inf"]}}


class JointExporter:
    """Makes joints of the constraints of a scene whose bodies have these motions, at its first frame.

    If broken pairs pass, constraints that break have a second joint, which keeps collisions off for good.
    """

    def __init__(self, scene, motions, broken_pass, findings):
        self.scene = scene
        self.motions = motions
        self.broken_pass = broken_pass
        self.findings = findings
        world = scene.rigidbody_world
        self.simulated = set(world.constraints.all_objects) if world and world.constraints else set()
        things = [thing for thing in objects_of(scene).values() if thing.rigid_body_constraint]
        self.joints = [self.joint(thing) for thing in things if not self.is_left_out(thing)]
        if broken_pass:
            names = {joint["name"] for joint in self.joints}
            self.joints += [self.filter_of(joint, names) for joint in self.joints
                            if "breaking" in joint and not joint["collide"]]

    def ends(self, thing):
        """Returns the objects of the bodies that a constraint joins, or None."""
        of = thing.rigid_body_constraint
        return [end and body_of(end) for end in (of.object1, of.object2)]

    def is_left_out(self, thing):
        """Tells whether a constraint joins nothing, and notes why."""
        ends = self.ends(thing)
        bodies = [end for end in ends if end]
        if thing not in self.simulated:
            why = "outside of the rigid body world's collection"
        elif not bodies:
            why = "without an object"
        elif any(end.name_full not in self.motions for end in bodies):
            why = "of an object that is no body of the bake"
        elif ends[0] == ends[1]:
            why = "of one body with itself"
        elif all(self.motions[end.name_full] != "dynamic" for end in bodies):
            why = "without an active body"
        elif len(bodies) == 1:
            why = "of one object, which Blender ignores, too"
        else:
            return False
        self.findings.add(LEFT_OUT, "constraint", f" {why}: left out", thing.name_full)
        return True

    def joint(self, thing):
        """Returns the joint of a constraint; that of a disabled one without collisions leaves all motions free."""
        of = thing.rigid_body_constraint
        is_filter = of.disable_collisions and not of.enabled
        self.remark(thing, of)
        ends = self.ends(thing)[::-1]
        joint = {
            "name": thing.name_full,
            "bodies": [end.name_full for end in ends],
            "frames": [self.frame(thing, end) for end in ends],
            "collide": not of.disable_collisions,
            "enabled": of.enabled or is_filter,
            **(FREE if is_filter else JOINTS[of.type](of)),
        }
        if of.use_breaking and of.enabled:
            most = load(of.breaking_threshold * self.steps_per_second())
            joint["breaking"] = {"force": most, "torque": most}
        return joint

    @staticmethod
    def filter_of(joint, names):
        """Returns a joint that never breaks, and does nothing but to keep collisions off; `names` has all others."""
        kept = {key: joint[key] for key in ("bodies", "frames", "collide", "enabled")}
        return {"name": unique(f"{joint['name']}: no collisions", names), **kept, **FREE}

    def steps_per_second(self):
        """Returns the number of Bullet's steps in a second; its loads are impulses in a step."""
        world = self.scene.rigidbody_world
        return frames_per_second(self.scene) * world.substeps_per_frame / (world.time_scale or 1)

    @staticmethod
    def frame(thing, end):
        """Returns the pose of a constraint in the frame of a body."""
        local = rigid(end).inverted() @ rigid(thing)
        position, rotation = joint_pose(local, main_axis(thing.rigid_body_constraint))
        return {"position": position, "rotation": rotation}

    def remark(self, thing, of):
        """Notes what a joint has otherwise than its constraint."""
        def changed(text):
            self.findings.add(CHANGED, "constraint", f" {text}", thing.name_full)

        if of.use_breaking and of.enabled and of.disable_collisions and not self.broken_pass:
            changed(BREAKS)
        if of.use_override_solver_iterations:
            changed("with a number of iterations: it has no meaning")
        if animates(thing, "rigid_body_constraint"):
            changed("with keys or drivers: the values at the first frame hold")
        axes = [f"{turning}{axis}" for turning in ("", "ang_") for axis in "xyz"]
        sprung = [axis for axis in axes if spring_of(of, axis)]
        if of.spring_type == "SPRING1" and any(getattr(of, f"spring_damping_{axis}") for axis in sprung):
            changed("with springs of type Blender 2.7: without their damping")
