"""Scenes of Drystone, of the rigid bodies of a scene of Blender."""

import json
import math
from dataclasses import dataclass, field
from itertools import dropwhile
from pathlib import Path

import numpy as np

from .channels import Channels
from .course import Course, gravity_of, is_keyed, tell
from .curves import HOLDS, animates
from .deforming import Deforming, deforms
from .findings import CHANGED, LEFT_OUT, Findings
from .forces import Winds, fields
from .instances import COLLIDING, MOVING, instances_of
from .joints import JointExporter
from .locks import add_locks, locks_of
from .moves import show_moves, take_moves
from .originals import take_edits
from .owners import baked_elsewhere
from .overrides import take_states
from .sampling import Sampling, followers, has_reason, may_move, moved_by, refers, settle, still, with_values
from .shapes import ShapeExporter, source_of
from .space import (body_of, compound_of, first_frame, has_mass, is_baked, is_held, is_linked, is_sound, objects_of,
                    parts_of, pose_of, refuse_stretching, simulated, time_step, turned, world_of)
from .survey import survey, survey_unseen

# Longest substep that is asked for. [s]
SUBSTEP = 1 / 480
# Largest rate of decay that Drystone takes: what is damped wholly. [1/s]
STRONGEST = 1e6
# Modifiers that leave vertices as they are, and those that move vertices and make none.
IDLE = {"COLLISION", "PARTICLE_SYSTEM", "SURFACE"}
DEFORMING = {"ARMATURE", "CAST", "CLOTH", "CORRECTIVE_SMOOTH", "CURVE", "DISPLACE", "HOOK", "LAPLACIANDEFORM",
             "LAPLACIANSMOOTH", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH",
             "SOFT_BODY", "SURFACE_DEFORM", "WARP", "WAVE", "VOLUME_DISPLACE"}
# Phrases of findings on objects that no bake can follow.
FOLLOWING, AS_AT_FIRST = "following a body that the simulation moves", "still, as at the first frame"
LINKED = " linked from another file: no keys, unless overridden or made local"
OVERRIDDEN = " overridden, but not editable, or with drivers or NLA tracks: no keys, unless made local"
ELSEWHERE = " baked in another scene: without that bake once it is baked here"
IN_WIND = " released in a wind: pushed from then on, in Blender also by the wind of the frames before"
DEACTIVATED = " with Deactivation that Dynamic stops: free at the release, in Blender asleep until something hits it"
WOKEN = " with Start Deactivated and keys of gravity: wakes as gravity changes, in Blender once something hits it"
VERTICES, BESIDES = " with vertices that follow an active body", "without that part of their motion"


@dataclass(frozen=True)
class Abilities:
    """Keys of scenes and commands that a binary knows, beyond those of the first version."""

    start_asleep: bool = False
    force: bool = False
    release: bool = False
    # Vertices of passive meshes at each frame.
    vertex_track: bool = False
    # Speed and gravity at each frame.
    world_track: bool = False
    # Commands and options beside those of the first version.
    contacts: bool = False
    progress: bool = False
    decompose: bool = False
    # Point instances of OpenUSD.
    instances: bool = False


@dataclass(frozen=True)
class Wishes:
    """Settings of the user that change a scene."""

    # 0: as many as the scene needs.
    substeps: int = 0
    # Objects of a broken constraint with Disable Collisions never collide, as in Blender.
    broken_pass: bool = False


@dataclass
class Export:
    """A scene of Drystone, and what applies its bake to the scene of Blender."""

    document: dict
    # Channels of all active bodies, by name.
    channels: dict
    # Locked axes of dynamic bodies, by name.
    locks: dict
    findings: Findings = field(default_factory=Findings)

    def write(self, path):
        Path(path).write_text(json.dumps(self.document, default=float))


def decay(damping):
    """Returns damping of Blender, the part of a velocity that is lost in a second, as a rate of decay [1/s]."""
    return min(-math.log1p(-damping), STRONGEST) if damping < 1 else STRONGEST


def generating(things):
    """Returns the modifiers that a collision shape with the source Deform leaves out.

    These are the first one that makes vertices, and all that change these later.
    """
    found = []
    for thing in things:
        shown = [of for of in thing.modifiers if of.show_viewport and of.type not in IDLE]
        if source_of(thing) == "DEFORM":
            found += dropwhile(lambda of: of.type in DEFORMING, shown)
    return found


def bodies_of(inside):
    """Returns the objects of a rigid body world that are bodies: those that are no parts of compounds."""
    return [thing for thing in inside.values() if not compound_of(thing)]


def is_below(thing, bodies):
    """Tells whether an object is below one of several."""
    above = thing.parent
    return above is not None and (above.name_full in bodies or is_below(above, bodies))


def sampled(scene, things, kept=frozenset(), others=(), looks=()):
    """Samples the held objects of a scene, what is above its active ones, and others that should keep their places.

    An active object below another body, or below what follows one, is left out: it has no parent while it is
    baked, as Blender may show it a frame late.
    """
    names = {thing.name_full for thing in things}
    movers = [thing for thing in things if may_move(thing, kept)]
    following = followers(movers, [*things, *others])
    watched = {thing for thing in things if is_held(thing) or animates(thing, *HOLDS)}
    below = [thing for thing in movers if thing.parent and not is_below(thing, names)
             and thing.name_full not in following]
    passive = [thing for thing in things if thing.rigid_body.type == "PASSIVE" and thing not in watched]
    suspects = [thing for thing in [*passive, *others] if has_reason(thing)]
    return Sampling(scene, watched, below, suspects, looks, {thing.name_full for thing in movers}, following)


def channels_of(scene):
    """Returns the channels of all objects that a bake may move, by name."""
    things = bodies_of(simulated(scene))
    with still(scene):
        things = [thing for thing in things if may_move(thing) and is_sound(thing) and not is_linked(thing)]
        sampling = sampled(scene, things)
        return {thing.name_full: Channels(thing, sampling.above.get(thing.name_full)) for thing in things}


class Exporter:
    """Makes a scene of Drystone of the rigid bodies of a scene of Blender, which is shown still."""

    def __init__(self, context, abilities, wishes, inside, instances, kept, findings):
        self.scene = context.scene
        self.kept = kept
        self.abilities = abilities
        self.wishes = wishes
        self.findings = findings
        self.shapes = ShapeExporter(context.evaluated_depsgraph_get(), findings, inside)
        self.things = [thing for thing in bodies_of(inside) if self.is_sound(thing)]
        followed = [thing for thing in self.things if abilities.vertex_track and deforms(thing)]
        self.deforming = Deforming(followed, self.shapes, findings)
        self.shapes.deforming = self.deforming.names
        looks = [self.deforming.look] if followed else []
        tell(self.scene, findings, abilities.world_track)
        self.course = Course(self.scene) if abilities.world_track and is_keyed(self.scene) else None
        looks += [self.course.look] if self.course else []
        winds = fields(context.view_layer, self.scene.rigidbody_world.effector_weights)
        self.instances = instances
        others = {*winds, *(each.above for each in instances)} - set(self.things)
        self.sampling = sampled(self.scene, self.things, kept, others, looks)
        self.follow()
        settle()
        self.winds = Winds(self.scene, winds, abilities.force, self.sampling, findings)

    def follow(self):
        """Notes what follows active bodies by its vertices, or as an instance."""
        movers = [thing for thing in self.things if may_move(thing, self.kept)]
        parts = [part for thing in self.things if thing.rigid_body.collision_shape == "COMPOUND"
                 for part in parts_of(thing, self.shapes.inside)]
        things = [thing for thing in self.things + parts
                  if thing.rigid_body.collision_shape != "COMPOUND" and source_of(thing) != "BASE" and refers(thing)]

        def vertices():
            return {thing.name_full: self.shapes.body_mesh(thing)[0] for thing in things}

        def instances():
            found = instances_of(self.shapes.depsgraph, objects_of(self.scene), Findings())
            return {each.name: np.array(each.matrix) for each in found}

        moved = moved_by(movers, instances) if self.instances else set()
        self.following_instances = {each.above.name_full for each in self.instances if each.name in moved}
        following = moved_by(movers, vertices) if things else set()
        for thing in things:
            if thing.name_full in following - self.sampling.following:
                noun = "passive object" if thing.rigid_body.type == "PASSIVE" else "object"
                as_told = BESIDES if thing.name_full in self.deforming.names else "as at the first frame"
                self.findings.add(CHANGED, noun, f"{VERTICES}: {as_told}", thing.name_full)

    def is_sound(self, thing):
        sound = is_sound(thing)
        if not sound:
            self.shapes.left_out(thing, "without a size or a place")
        return sound

    def export(self):
        """Returns the whole scene; frame 0 of a bake is that at which Blender's simulation starts."""
        bodies = [body for body in map(self.body, self.things) if body]
        bodies += [body for body in map(self.instance, self.instances) if body]
        if not bodies:
            survey(self.scene, simulated(self.scene), self.findings, self.sampling)
            why = [found.sentence() for found in self.findings if found.kind == LEFT_OUT]
            raise ValueError("; ".join(["no object has a rigid body that Drystone can bake", *why]))
        motions = {body["name"]: body["motion"] for body in bodies}
        joints = JointExporter(self.scene, motions, self.wishes.broken_pass, self.findings).joints
        moving = [thing for thing in self.things if motions.get(thing.name_full) == "dynamic"]
        locks = {thing.name_full: locks_of(thing) for thing in moving if locks_of(thing)}
        document = self.world() | {"bodies": bodies} | ({"joints": joints} if joints else {})
        return Export(document, self.channels(moving), locks, self.findings)

    def channels(self, things):
        """Returns the channels of active bodies by name, of those that can have keys."""
        for thing in things:
            if is_linked(thing):
                self.findings.add(LEFT_OUT, "object", LINKED if thing.library else OVERRIDDEN, thing.name_full)
        channels = {thing.name_full: Channels(thing, self.sampling.above.get(thing.name_full))
                    for thing in things if not is_linked(thing)}
        for of in channels.values():
            if of.is_apart:
                self.findings.add(CHANGED, "object", " below another body or an uneven parent: without a parent "
                                  "while baked", of.name)
            if of.is_resized:
                self.findings.add(CHANGED, "object", " sized by a constraint, off while baked: simulated in that "
                                  "size, shown in its own", of.name)
            elif not of.is_exact:
                self.findings.add(CHANGED, "object", " sheared by a parent: turned approximately", of.name)
        return channels

    def world(self):
        scene, step = self.scene, time_step(self.scene)
        return {
            "name": scene.name,
            "gravity": gravity_of(scene),
            "time_step": step,
            "steps": scene.frame_end - first_frame(scene),
            "solver": {"substeps": self.wishes.substeps or max(8, math.ceil(step / SUBSTEP - 1e-9))},
            "extras": {"frame_start": first_frame(scene)},
        } | (self.course.track(step) if self.course else {})

    def motion(self, thing):
        """Returns the motion of a body, and notes what it cannot have."""
        of, name = thing.rigid_body, thing.name_full
        if of.type == "PASSIVE":
            if not of.kinematic and self.sampling.is_moved_rigidly(name):
                self.findings.add(CHANGED, "passive object", " moved but not Animated: still", name)
            if not of.kinematic and name in self.sampling.following:
                self.findings.add(CHANGED, "passive object", f" {FOLLOWING}: {AS_AT_FIRST}", name)
            if animates(thing, "rigid_body.kinematic"):
                self.findings.add(CHANGED, "passive object", " with keys of Animated: as at the first frame",
                                  name)
            return "kinematic" if of.kinematic else "static"
        if name in self.kept:
            if not is_baked(thing):
                self.findings.add(CHANGED, "object", " neither selected nor baked: still", name)
            return "kinematic"
        if name in self.sampling.held_again:
            self.findings.add(CHANGED, "object", " held by keys after a release: free from there on", name)
        if not has_mass(thing):
            self.findings.add(CHANGED, "object", " without a positive mass: moved by keys alone, as in Blender", name)
            return "kinematic" if is_held(thing) else "static"
        if not is_held(thing):
            return "dynamic"
        if self.sampling.is_stopped_in_flight(name):
            self.findings.add(CHANGED, "object", " stopped by Dynamic after Animated: released at rest, in Blender "
                              "with the velocity of its keys", name)
        if self.sampling.is_dynamic_early(name):
            self.findings.add(CHANGED, "object", " with Dynamic turned on while Animated: released where keys lead it, "
                              "in Blender where it was then", name)
        if self.sampling.is_released(name):
            if self.abilities.release:
                return "dynamic"
            self.findings.add(LEFT_OUT, "object", " with a release by keys: not known to this version of "
                              "drystone", name)
        return "kinematic"

    def body(self, thing):
        """Returns a body, or None if it has no shape."""
        of, motion = thing.rigid_body, self.motion(thing)
        if motion == "kinematic" and thing.name_full in self.sampling.following:
            return self.shapes.left_out(thing, FOLLOWING)
        shapes = self.shapes.shapes(thing, motion == "dynamic")
        if not shapes:
            return None
        self.deforming.follow(thing.name_full, shapes, time_step(self.scene))
        body = self.described(thing.name_full, of, motion, thing.matrix_world, shapes)
        if motion == "dynamic":
            body |= self.dynamics(thing) | self.shapes.mass_keys(shapes, of.mass)
            self.shapes.tell_center(thing, shapes)
        return body | self.track(thing, motion)

    def instance(self, instance):
        """Returns an instance as a body, or None if it has no shape."""
        above, name = instance.above, instance.above.name_full
        follows = name in self.sampling.following | self.following_instances
        if follows or above.rigid_body and may_move(above, self.kept):
            self.findings.add(CHANGED, "instancer", f" {FOLLOWING}: {AS_AT_FIRST}", name)
        elif self.sampling.is_moved_rigidly(name):
            self.findings.add(CHANGED, "instancer", MOVING, name)
        self.findings.add(CHANGED, "instancer", COLLIDING, name)
        of, shapes = body_of(instance.thing).rigid_body, self.shapes.instance(instance.thing, instance.matrix)
        return self.described(instance.name, of, "static", instance.matrix, shapes) if shapes else None

    def described(self, name, of, motion, matrix, shapes):
        """Returns the keys that all bodies have, from the settings of a rigid body."""
        if of.restitution > 1:
            self.findings.add(CHANGED, "object", " with a bounciness above 1: of 1", name)
        position, rotation = pose_of(matrix)
        layers = [f"layer {i + 1}" for i, on in enumerate(of.collision_collections) if on]
        return {
            "name": name,
            "motion": motion,
            "position": position,
            "rotation": rotation,
            "friction": of.friction,
            "restitution": min(of.restitution, 1.0),
            # Blender multiplies both.
            "friction_combine": "multiply",
            "restitution_combine": "multiply",
            "shapes": shapes,
            "collision": {"systems": layers, "collides_with": layers},
        }

    def dynamics(self, thing):
        """Returns the keys that only a dynamic body has."""
        of = thing.rigid_body
        force, drag = self.winds.on(thing.name_full)
        body = {
            "mass": of.mass,
            "linear_damping": min(decay(of.linear_damping) + drag / of.mass, STRONGEST),
            "angular_damping": decay(of.angular_damping),
        }
        if is_held(thing) and (force.length > 0 or drag > 0):
            self.findings.add(CHANGED, "object", IN_WIND, thing.name_full)
        if force.length > 0:
            # Blender wakes the bodies that a wind pushes.
            body["force"] = turned(force)
        elif of.use_deactivation and self.sampling.is_stopped_at_release(thing.name_full):
            self.findings.add(CHANGED, "object", DEACTIVATED, thing.name_full)
        elif of.use_deactivation and of.use_start_deactivated and not is_held(thing):
            if self.abilities.start_asleep:
                body["start_asleep"] = True
                if self.course and self.course.changes_gravity():
                    self.findings.add(CHANGED, "object", WOKEN, thing.name_full)
            else:
                self.findings.add(LEFT_OUT, "object",
                                  " with Start Deactivated: not known to this version of drystone", thing.name_full)
        return body

    def track(self, thing, motion):
        """Returns the key with the poses of a body that follows its keys; none if it keeps its place."""
        if motion == "static" or motion == "kinematic" and not self.sampling.is_moved(thing.name_full):
            return {}
        poses = [pose_of(matrix) for matrix in self.sampling.tracks.get(thing.name_full, [])]
        if not poses:
            return {}
        step = time_step(self.scene)
        return {"track": [{"time": frame * step, "position": position, "rotation": rotation}
                          for frame, (position, rotation) in enumerate(poses)]}


def unselected(context):
    """Returns the names of active bodies that are not selected."""
    selected = set(context.view_layer.objects.selected)
    things = [thing for thing in bodies_of(simulated(context.scene)) if may_move(thing)]
    return frozenset(thing.name_full for thing in things if thing not in selected)


def export(context, abilities=Abilities(), wishes=Wishes(), kept=frozenset(), start=None):
    """Returns a scene as Drystone has it. The objects to be kept follow their keys.

    With a start, the scene begins inside of a bake.
    """
    scene = context.scene
    world_of(scene)
    take_states(scene)
    if scene.frame_end < scene.frame_start:
        raise ValueError("the last frame of the scene is before its first")
    if scene.frame_end < first_frame(scene):
        raise ValueError(f"the simulation starts at frame {first_frame(scene)}, after the last frame of the scene: set "
                         "Simulation Start in the cache of the rigid body world")
    refuse_stretching(scene)
    kept = kept | start.kept if start else kept
    take_edits(scene)
    moves = start.moves if start else take_moves(scene, kept)
    inside, findings = simulated(scene), Findings()
    survey_unseen(scene, inside, findings)
    with still(scene, kept):
        instances = instances_of(context.evaluated_depsgraph_get(), objects_of(scene), findings)
        left = generating([*inside.values(), *{each.thing for each in instances}])
        with with_values(left, "show_viewport", False):
            if left:
                scene.frame_set(first_frame(scene))
            exporter = Exporter(context, abilities, wishes, inside, instances, kept, findings)
            shot = exporter.export()
            survey(scene, inside, findings, exporter.sampling, exporter.deforming.names)
    for name in baked_elsewhere(scene, shot.channels):
        findings.add(CHANGED, "object", ELSEWHERE, name)
    if start:
        start.begin(shot, abilities)
    add_locks(shot.document, shot.locks, findings)
    show_moves(scene, moves)
    return shot
