"""Blender add-on: bakes the rigid bodies of a scene with Drystone.

Install it with Edit > Preferences > Add-ons > Install from Disk. The panel is in the scene's properties,
below Rigid Body World; File > Export and File > Import have the two halves on their own.

Blender is z up, Drystone y up: (x, y, z) becomes (x, z, -y), for places, for the axes of rotations and in
the frames of objects alike.
"""

import json
import math
import subprocess
import tempfile
from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty
from bpy.types import AddonPreferences, Operator, Panel
from bpy_extras.io_utils import ExportHelper, ImportHelper
from mathutils import Matrix, Quaternion

bl_info = {
    "name": "Drystone",
    "author": "The Drystone developers",
    "version": (0, 1, 0),
    "blender": (4, 4, 0),
    "location": "Properties > Scene > Drystone",
    "description": "Certified rigid body bakes",
    "category": "Physics",
}

# A body that carries a bake. Blender sees it as animated; for the next bake it is dynamic all the same.
BAKED = "drystone_baked"
# Longest substep that is asked for. [s]
SUBSTEP = 1 / 480
# What is thinner is a surface, which gets a body below it. [m]
FLAT = 1e-4
# Largest rate of decay that Drystone takes: what is damped wholly. [1/s]
STRONGEST = 1e6
# A bake whose samples are this near to whole frames is not mixed. [frame]
WHOLE = 1e-3
# Largest finite load that Drystone takes. [N, or N m]
LARGEST_LOAD = 1e20
# Largest finite position and velocity of a joint that Drystone takes. [m, or m/s]
FARTHEST = 1e6
# Half a turn and a whole one in Blender's precision. [rad]
HALF_TURN, TURN = float(np.float32(math.pi)), float(np.float32(math.tau))
# A note lists so many names, and counts the others.
LISTED = 10
# Lines of the summary of a bake that are passed on. Joints that broke are in a note.
SAID = ("certified", "joints", "note")


# From Blender


def turned(v):
    """A vector of Blender as one of Drystone."""
    return [v[0], v[2], -v[1]]


def pose_of(matrix):
    """Position and rotation of a matrix, as Drystone has them."""
    place, rotation, _ = matrix.decompose()
    return turned(place), [*turned([rotation.x, rotation.y, rotation.z]), rotation.w]


def rigid(thing):
    """Where an object is and how it is turned, without its scale."""
    return Matrix.LocRotScale(*thing.matrix_world.decompose()[:2], None)


def decay(damping):
    """Damping of Blender, the part of a velocity that is lost in a second, as a rate of decay [1/s]."""
    return min(-math.log1p(-damping), STRONGEST) if damping < 1 else STRONGEST


def frames_per_second(scene):
    return scene.render.fps / scene.render.fps_base


def compound_of(thing):
    """The object that a thing is a part of, if it is."""
    parent = thing.parent
    part = parent and parent.rigid_body and parent.rigid_body.collision_shape == "COMPOUND"
    return parent if part else None


class Exporter:
    """Makes a scene of Drystone of the rigid bodies of a scene of Blender."""

    def __init__(self, context):
        self.context = context
        self.scene = context.scene
        self.notes = []

    def document(self):
        """The whole scene; frame 0 of a bake is the first frame of Blender's range."""
        scene = self.scene
        rate = frames_per_second(scene)
        scene.frame_set(scene.frame_start)
        bodies = [self.body(thing) for thing in self.things()]
        joints = JointExporter(scene, {body["name"]: body["motion"] for body in bodies})
        tracks = self.tracks()
        for body in bodies:
            if body["name"] in tracks:
                body["track"] = tracks[body["name"]]
        gravity = turned(scene.gravity) if scene.use_gravity else [0.0, 0.0, 0.0]
        document = {
            "name": scene.name,
            "gravity": gravity,
            "time_step": 1 / rate,
            "steps": scene.frame_end - scene.frame_start,
            "solver": {"substeps": max(8, math.ceil(1 / rate / SUBSTEP - 1e-9))},
            "bodies": bodies,
            "extras": {"frame_start": scene.frame_start},
        }
        if joints.joints:
            document["joints"] = joints.joints
        self.notes += joints.notes()
        return document

    def things(self):
        """Objects with a rigid body, but for the parts of compounds."""
        bodies = [thing for thing in self.scene.objects if thing.rigid_body]
        return [thing for thing in bodies if not compound_of(thing)]

    @staticmethod
    def motion(thing):
        of = thing.rigid_body
        if of.type == "ACTIVE" and of.enabled and (not of.kinematic or thing.get(BAKED)):
            return "dynamic"
        return "kinematic" if of.kinematic and not thing.get(BAKED) else "static"

    def body(self, thing):
        of, motion = thing.rigid_body, self.motion(thing)
        position, rotation = pose_of(thing.matrix_world)
        body = {
            "name": thing.name,
            "motion": motion,
            "position": position,
            "rotation": rotation,
            "friction": of.friction,
            "restitution": of.restitution,
            # As Blender has it.
            "friction_combine": "multiply",
            "restitution_combine": "multiply",
            "shapes": self.shapes(thing, motion),
        }
        layers = [f"layer {i + 1}" for i, on in enumerate(of.collision_collections) if on]
        body["collision"] = {"systems": layers, "collides_with": layers}
        if motion == "dynamic":
            body["mass"] = of.mass
            body["linear_damping"] = decay(of.linear_damping)
            body["angular_damping"] = decay(of.angular_damping)
        return body

    def shapes(self, thing, motion):
        if thing.rigid_body.collision_shape != "COMPOUND":
            return [self.shape(thing, motion, Matrix())]
        parts = [part for part in thing.children if part.rigid_body]
        return [self.shape(part, motion, rigid(thing).inverted() @ rigid(part)) for part in parts]

    def shape(self, thing, motion, place):
        """A shape at a place in the frame of its body."""
        points = self.points(thing)
        low, high = points.min(axis=0), points.max(axis=0)
        half = np.maximum((high - low) / 2, 1e-6)
        middle = Matrix.Translation((low + high) / 2)
        kind = thing.rigid_body.collision_shape
        if motion != "dynamic" and half[2] < FLAT and (kind != "MESH" or len(points) <= 4):
            return self.slab(points, kind, place)
        if kind == "MESH" and motion == "dynamic" and not self.closed(thing):
            self.notes.append(f"'{thing.name}': its mesh is open and moves: it collides as its convex hull")
            kind = "CONVEX_HULL"
        shape = {
            "BOX": lambda: {"type": "box", "half_extents": [half[0], half[2], half[1]]},
            "SPHERE": lambda: {"type": "sphere", "radius": max(half)},
            "CYLINDER": lambda: {"type": "cylinder", "radius": max(half[:2]), "half_height": half[2]},
            "CAPSULE": lambda: self.capsule(half),
            "MESH": lambda: self.mesh(thing),
        }.get(kind, lambda: {"type": "convex_hull", "points": [turned(p) for p in self.hull(points)]})()
        if kind in ("BOX", "SPHERE", "CYLINDER", "CAPSULE"):
            place = place @ middle
        position, rotation = pose_of(place)
        return {**shape, "position": position, "rotation": rotation}

    @staticmethod
    def slab(points, kind, place):
        """A floor that is drawn as a plane: what is below it counts, so that nothing falls through."""
        low, high = points.min(axis=0), points.max(axis=0)
        depth = max(0.1, 0.05 * (high - low).max())
        if kind == "BOX" or len(points) <= 4:
            half = (high - low + [0, 0, depth]) / 2
            place = place @ Matrix.Translation((low + high - [0, 0, depth]) / 2)
            shape = {"type": "box", "half_extents": [half[0], half[2], half[1]]}
        else:
            both = np.concatenate([points, points - [0, 0, depth]])
            shape = {"type": "convex_hull", "points": [turned(p) for p in both]}
        position, rotation = pose_of(place)
        return {**shape, "position": position, "rotation": rotation}

    @staticmethod
    def capsule(half):
        radius = max(half[:2])
        return {"type": "capsule", "radius": radius, "half_height": max(half[2] - radius, 1e-6)}

    def evaluated(self, thing):
        """The mesh of an object with its modifiers, unless the object asks for the one before."""
        if thing.rigid_body.mesh_source == "BASE":
            return thing
        return thing.evaluated_get(self.context.evaluated_depsgraph_get())

    def points(self, thing):
        """Vertices in meters, in the object's frame without its scale."""
        mesh = self.evaluated(thing).to_mesh()
        if mesh is None or not mesh.vertices:
            raise ValueError(f"'{thing.name}' has a rigid body and no mesh")
        points = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", points)
        return points.reshape(-1, 3).astype(float) * np.array(thing.matrix_world.to_scale())

    @staticmethod
    def hull(points):
        """Points that are all different; those inside do no harm."""
        return np.unique(points.round(6), axis=0)

    def mesh(self, thing):
        points = self.points(thing)
        mesh = self.evaluated(thing).to_mesh()
        mesh.calc_loop_triangles()
        corners = np.empty(len(mesh.loop_triangles) * 3, np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
        triangles = corners.reshape(-1, 3)
        if np.prod(thing.matrix_world.to_scale()) < 0:
            triangles = triangles[:, ::-1]
        return {"type": "trimesh", "vertices": [turned(p) for p in points],
                "triangles": triangles.tolist()}

    def closed(self, thing):
        """Whether a mesh encloses a volume: each edge is passed once each way; places count, not vertices."""
        mesh = self.mesh(thing)
        points = np.array(mesh["vertices"])
        size = np.ptp(points, axis=0).max()
        _, places = np.unique((points / max(size, 1e-12) * 2**20).round(), axis=0, return_inverse=True)
        places = places.reshape(-1)
        corners = places[np.array(mesh["triangles"], np.int64).reshape(-1, 3)]
        edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        edges = edges[edges[:, 0] != edges[:, 1]]
        count = len(points)
        there, back = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
        return len(edges) > 0 and np.array_equal(np.sort(there), np.sort(back))

    def tracks(self):
        """Poses of animated bodies, one per frame."""
        animated = [thing for thing in self.things() if self.motion(thing) == "kinematic"]
        tracks = {thing.name: [] for thing in animated}
        if not animated:
            return tracks
        scene, rate = self.scene, frames_per_second(self.scene)
        for frame in range(scene.frame_start, scene.frame_end + 1):
            scene.frame_set(frame)
            for thing in animated:
                position, rotation = pose_of(thing.matrix_world)
                time = (frame - scene.frame_start) / rate
                tracks[thing.name].append({"time": time, "position": position, "rotation": rotation})
        scene.frame_set(scene.frame_start)
        return tracks


# Joints


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


def is_animated(thing):
    """Whether a constraint has keys or drivers."""
    data = thing.animation_data
    if not data:
        return False
    curves = list(data.drivers)
    for layer in data.action.layers if data.action and data.action_slot else []:
        bags = [strip.channelbag(data.action_slot) for strip in layer.strips]
        curves += [curve for bag in bags if bag for curve in bag.fcurves]
    return any(curve.data_path.startswith("rigid_body_constraint") for curve in curves)


class JointExporter:
    """Makes joints of the constraints of a scene whose bodies have these motions, at its first frame."""

    def __init__(self, scene, motions):
        self.scene = scene
        self.motions = motions
        world = scene.rigidbody_world
        self.simulated = set(world.constraints.all_objects) if world and world.constraints else set()
        # Names of constraints, by what is to be said of them.
        self.said = {}
        things = [thing for thing in scene.objects if thing.rigid_body_constraint]
        self.joints = [self.joint(thing) for thing in things if not self.is_left_out(thing)]

    def note(self, text, *names):
        self.said.setdefault(text, []).extend(names)

    def notes(self):
        """One line for each kind of remark, with the number of constraints and their names."""
        lines = []
        for text, names in self.said.items():
            more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
            count = "1 constraint" if len(names) == 1 else f"{len(names)} constraints"
            lines.append(f"{count} {text}: {', '.join(names[:LISTED])}{more}")
        return lines

    @staticmethod
    def body_of(thing):
        """The object whose body a thing belongs to: that of the whole compound, if it is part of one."""
        while thing.rigid_body and compound_of(thing):
            thing = compound_of(thing)
        return thing

    def ends(self, thing):
        """The objects of the bodies that a constraint joins; None is the world."""
        of = thing.rigid_body_constraint
        return [end and self.body_of(end) for end in (of.object1, of.object2)]

    def is_left_out(self, thing):
        """Whether a constraint joins nothing, and notes why."""
        ends = self.ends(thing)
        bodies = [end for end in ends if end]
        lacking = [end.name for end in bodies if end.name not in self.motions]
        if thing not in self.simulated:
            self.note("left out, not in the collection of the rigid body world", f"'{thing.name}'")
        elif not bodies:
            self.note("left out, without an object", f"'{thing.name}'")
        elif lacking:
            self.note("left out, of an object that is no rigid body",
                      f"'{thing.name}' ({', '.join(lacking)})")
        elif ends[0] == ends[1]:
            self.note("left out, of one body with itself", f"'{thing.name}'")
        elif all(self.motions[end.name] != "dynamic" for end in bodies):
            self.note("left out, of bodies of which none is active", f"'{thing.name}'")
        else:
            return False
        return True

    def joint(self, thing):
        of = thing.rigid_body_constraint
        self.remark(thing, of)
        ends = self.ends(thing)[::-1]
        joint = {
            "name": thing.name,
            "bodies": [end.name if end else -1 for end in ends],
            "frames": [self.frame(thing, end) for end in ends],
            "collide": not of.disable_collisions,
            "enabled": of.enabled,
            **JOINTS[of.type](of),
        }
        if of.use_breaking:
            most = load(of.breaking_threshold * self.steps_per_second())
            joint["breaking"] = {"force": most, "torque": most}
        return joint

    def steps_per_second(self):
        """Steps of Bullet in a second; its loads are impulses in a step."""
        world = self.scene.rigidbody_world
        return frames_per_second(self.scene) * world.substeps_per_frame / (world.time_scale or 1)

    @staticmethod
    def frame(thing, end):
        """Pose of a constraint in the frame of a body, or in the world."""
        local = rigid(end).inverted() @ rigid(thing) if end else rigid(thing)
        position, rotation = joint_pose(local, main_axis(thing.rigid_body_constraint))
        return {"position": position, "rotation": rotation}

    def remark(self, thing, of):
        """Notes what a joint has otherwise than its constraint."""
        name = f"'{thing.name}'"
        if not (of.object1 and of.object2):
            self.note("of one object, joined to the world, where Blender ignores it", name)
        if of.use_override_solver_iterations:
            self.note("whose number of iterations has no meaning", name)
        if is_animated(thing):
            self.note("with keys or drivers, of which the values at the first frame hold", name)
        axes = [f"{turning}{axis}" for turning in ("", "ang_") for axis in "xyz"]
        sprung = [axis for axis in axes if spring_of(of, axis)]
        if of.spring_type == "SPRING1" and any(getattr(of, f"spring_damping_{axis}") for axis in sprung):
            self.note("with springs of type Blender 2.7, without their damping", name)


def export(context, path):
    """Writes the scene; returns what it had to leave out."""
    exporter = Exporter(context)
    document = exporter.document()
    if not document["bodies"]:
        raise ValueError("no object has a rigid body")
    Path(path).write_text(json.dumps(document, default=float))
    return exporter.notes


# Back to Blender


def at_frames(times, poses, rate):
    """Poses at whole frames, from the first sample to the last: mixed where samples lie between."""
    moments = np.asarray(times, float) * rate
    if np.abs(moments - moments.round()).max() <= WHOLE and (np.diff(moments.round()) > 0).all():
        return moments.round().astype(int), poses
    frames = np.arange(int(math.floor(moments[-1] + WHOLE)) + 1)
    after = np.clip(np.searchsorted(moments, frames), 1, len(moments) - 1)
    part = (frames - moments[after - 1]) / (moments[after] - moments[after - 1])
    part = np.clip(part, 0, 1)[:, None, None]
    first, second = poses[after - 1].astype(float), poses[after].astype(float)
    sign = np.where((first[..., 3:] * second[..., 3:]).sum(-1, keepdims=True) < 0, -1, 1)
    second[..., 3:] *= sign
    mixed = first + (second - first) * part
    mixed[..., 3:] /= np.linalg.norm(mixed[..., 3:], axis=-1, keepdims=True)
    return frames, mixed


def to_blender(poses):
    """Positions and quaternions w x y z of one body, z up; no quaternion far from the one before."""
    places = np.stack([poses[:, 0], -poses[:, 2], poses[:, 1]], axis=1)
    turns = np.stack([poses[:, 6], poses[:, 3], -poses[:, 5], poses[:, 4]], axis=1)
    flips = np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0, -1, 1)
    turns[1:] *= np.cumprod(flips)[:, None]
    return places, turns


def basis(thing, places, turns):
    """The same in the frame that an object's own channels are in, below its parent at this moment."""
    if thing.parent is None:
        return places, turns
    above = (thing.parent.matrix_world @ thing.matrix_parent_inverse).inverted()
    turn = above.to_quaternion()
    places = np.array([above @ Matrix.Translation(p).translation for p in places])
    return places, np.array([turn @ Quaternion(q) for q in turns])


def key(bag, path, frames, values):
    """Keys of one property: a curve per component, straight between keys."""
    for index in range(values.shape[1]):
        curve = bag.fcurves.new(path, index=index)
        points = curve.keyframe_points
        points.add(len(frames))
        co = np.empty(len(frames) * 2, np.float32)
        co[0::2], co[1::2] = frames, values[:, index]
        points.foreach_set("co", co)
        points.foreach_set("interpolation", np.ones(len(frames), np.int32))
        curve.update()


def apply(context, path):
    """Puts a bake on the objects that have the names of its bodies; returns how many, and who is missing."""
    with np.load(path, allow_pickle=False) as arrays:
        poses, names, times = arrays["poses"], arrays["names"], arrays["times"]
    if poses.shape[2] != 7:
        raise ValueError(f"{path} is of a scene in the plane; accepted: bakes in 3D")
    scene = context.scene
    frames, poses = at_frames(times, poses, frames_per_second(scene))
    frames = frames + scene.frame_start
    action = bpy.data.actions.new("Drystone")
    strip = action.layers.new("Drystone").strips.new(type="KEYFRAME")
    missing, count = [], 0
    for body, name in enumerate(names):
        thing = scene.objects.get(str(name))
        if thing is None:
            missing.append(str(name))
            continue
        of = thing.rigid_body
        if of and Exporter.motion(thing) != "dynamic":
            continue
        places, turns = basis(thing, *to_blender(poses[:, body]))
        thing.rotation_mode = "QUATERNION"
        slot = action.slots.new(id_type="OBJECT", name=thing.name)
        bag = strip.channelbag(slot, ensure=True)
        key(bag, "location", frames, places)
        key(bag, "rotation_quaternion", frames, turns)
        data = thing.animation_data or thing.animation_data_create()
        data.action, data.action_slot = action, slot
        if of:
            # Or Blender's own simulation would move it as well.
            of.kinematic = True
            thing[BAKED] = True
        count += 1
    if count == 0:
        bpy.data.actions.remove(action)
    else:
        scene.frame_end = max(int(frames[-1]), scene.frame_start)
        scene.frame_set(scene.frame_start)
    return count, missing


def bake(context, drystone, folder):
    """Exports, bakes and applies; returns what Drystone said of it."""
    scene, arrays = Path(folder) / "scene.json", Path(folder) / "bake.npz"
    notes = export(context, scene)
    done = subprocess.run([drystone, "bake", scene, "-o", arrays], capture_output=True, text=True)
    if done.returncode != 0:
        raise ValueError(done.stderr.strip())
    count, missing = apply(context, arrays)
    said = [line for line in done.stdout.splitlines() if line.startswith(SAID)]
    said += [line.removeprefix("drystone: ") for line in done.stderr.splitlines() if "warning:" in line]
    notes += [f"'{name}' is gone" for name in missing]
    return [f"{count} bodies baked", *said, *notes]


# What one sees


class Preferences(AddonPreferences):
    bl_idname = __name__

    drystone: StringProperty(name="Command", subtype="FILE_PATH", default="drystone",
                             description="The command line of Drystone")

    def draw(self, _context):
        self.layout.prop(self, "drystone")


def command(context):
    addon = context.preferences.addons.get(__name__)
    return addon.preferences.drystone if addon else "drystone"


class Baking(Operator):
    """Bake all rigid bodies with Drystone and key them, from the first frame to the last"""

    bl_idname = "drystone.bake"
    bl_label = "Bake with Drystone"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        try:
            with tempfile.TemporaryDirectory() as folder:
                said = bake(context, command(context), folder)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for line in said:
            self.report({"INFO"}, line)
        context.scene["drystone_said"] = said
        return {"FINISHED"}


class Export(Operator, ExportHelper):
    """Write the rigid bodies of this scene for Drystone"""

    bl_idname = "drystone.export_scene"
    bl_label = "Export for Drystone"
    filename_ext = ".json"

    def execute(self, context):
        try:
            notes = export(context, self.filepath)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for note in notes:
            self.report({"WARNING"}, note)
        return {"FINISHED"}


class Apply(Operator, ImportHelper):
    """Key the bodies of a bake on the objects of the same names"""

    bl_idname = "drystone.apply_bake"
    bl_label = "Apply Drystone Bake"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".npz"
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})

    def execute(self, context):
        try:
            count, missing = apply(context, self.filepath)
        except (OSError, ValueError, KeyError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for name in missing:
            self.report({"WARNING"}, f"no object is called '{name}'")
        self.report({"INFO"}, f"{count} bodies have keys")
        return {"FINISHED"} if count else {"CANCELLED"}


class ScenePanel(Panel):
    bl_idname = "SCENE_PT_drystone"
    bl_label = "Drystone"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "scene"

    def draw(self, context):
        self.layout.operator(Baking.bl_idname, icon="PHYSICS")
        row = self.layout.row()
        row.operator(Export.bl_idname, text="Export")
        row.operator(Apply.bl_idname, text="Apply Bake")
        for line in context.scene.get("drystone_said", []):
            self.layout.label(text=line)


CLASSES = [Preferences, Baking, Export, Apply, ScenePanel]


def in_export_menu(menu, _context):
    menu.layout.operator(Export.bl_idname, text="Drystone Scene (.json)")


def in_import_menu(menu, _context):
    menu.layout.operator(Apply.bl_idname, text="Drystone Bake (.npz)")


def register():
    for of in CLASSES:
        bpy.utils.register_class(of)
    bpy.types.TOPBAR_MT_file_export.append(in_export_menu)
    bpy.types.TOPBAR_MT_file_import.append(in_import_menu)


def unregister():
    bpy.types.TOPBAR_MT_file_import.remove(in_import_menu)
    bpy.types.TOPBAR_MT_file_export.remove(in_export_menu)
    for of in reversed(CLASSES):
        bpy.utils.unregister_class(of)


if __name__ == "__main__":
    register()
