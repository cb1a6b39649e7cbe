"""Scenes of Drystone, of the rigid bodies of a scene of Blender."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

from .channels import Channels
from .curves import HOLDS, animates
from .deforming import Deforming, deforms
from .findings import CHANGED, LEFT_OUT, Findings
from .forces import Wind
from .instances import instances_of
from .joints import JointExporter
from .originals import show_moves, take_moves
from .sampling import Sampling, may_be_moved, may_move, still, with_values
from .shapes import ShapeExporter
from .space import compound_of, is_baked, is_held, is_sound, pose_of, simulated, time_step, turned
from .survey import survey

# Longest substep that is asked for. [s]
SUBSTEP = 1 / 480
# Largest rate of decay that Drystone takes: what is damped wholly. [1/s]
STRONGEST = 1e6
# Modifiers that move vertices and make none.
DEFORMING = {"ARMATURE", "CAST", "CORRECTIVE_SMOOTH", "CURVE", "DISPLACE", "HOOK", "LAPLACIANDEFORM",
             "LAPLACIANSMOOTH", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH",
             "SURFACE_DEFORM", "WARP", "WAVE", "VOLUME_DISPLACE"}


@dataclass(frozen=True)
class Abilities:
    """Keys of scenes and commands that a binary knows, beyond those of the first version."""

    start_asleep: bool = False
    force: bool = False
    release: bool = False
    # Vertices of passive meshes at each frame.
    vertex_track: bool = False
    # Commands and options beside those of the first version.
    contacts: bool = False
    progress: bool = False
    decompose: bool = False


@dataclass
class Export:
    """A scene of Drystone, and what applies its bake to the scene of Blender."""

    document: dict
    # Channels of all active bodies, by name.
    channels: dict
    findings: Findings = field(default_factory=Findings)

    def write(self, path):
        Path(path).write_text(json.dumps(self.document, default=float))


def decay(damping):
    """Returns damping of Blender, the part of a velocity that is lost in a second, as a rate of decay [1/s]."""
    return min(-math.log1p(-damping), STRONGEST) if damping < 1 else STRONGEST


def generating(things):
    """Returns the modifiers that a collision shape with the source Deform leaves out."""
    deformed = [thing for thing in things if thing.rigid_body.mesh_source == "DEFORM"]
    return [of for thing in deformed for of in thing.modifiers if of.type not in DEFORMING]


def bodies_of(scene):
    """Returns the objects that are bodies: those with a rigid body that are no parts of compounds."""
    return [thing for thing in simulated(scene).values() if not compound_of(thing)]


def is_below(thing, bodies):
    """Tells whether an object is below one of several."""
    above = thing.parent
    return above is not None and (above.name in bodies or is_below(above, bodies))


def sampled(scene, things, kept=frozenset(), looks=()):
    """Samples the held objects of a scene and what is above its active ones.

    An active object below another body is left out: it has no parent while it is baked, as Blender may show
    it a frame late.
    """
    names = {thing.name for thing in things}
    watched = [thing for thing in things if is_held(thing) or animates(thing, *HOLDS)
               or thing.rigid_body.type == "PASSIVE" and may_be_moved(thing)]
    below = [thing for thing in things if thing.parent and may_move(thing, kept) and not is_below(thing, names)]
    return Sampling(scene, watched, below, looks)


def channels_of(scene):
    """Returns the channels of all objects that a bake may move, by name."""
    things = bodies_of(scene)
    with still(scene):
        things = [thing for thing in things if may_move(thing) and is_sound(thing) and not thing.library]
        sampling = sampled(scene, things)
        return {thing.name: Channels(thing, sampling.above.get(thing.name)) for thing in things}


class Exporter:
    """Makes a scene of Drystone of the rigid bodies of a scene of Blender, which is shown still."""

    def __init__(self, context, abilities, substeps, things, kept, findings):
        self.scene = context.scene
        self.kept = kept
        self.abilities = abilities
        self.substeps = substeps
        self.findings = findings
        self.shapes = ShapeExporter(context.evaluated_depsgraph_get(), self.findings)
        self.wind = Wind(self.scene, abilities.force, self.findings)
        self.things = [thing for thing in things if self.is_sound(thing)]
        followed = [thing for thing in self.things if abilities.vertex_track and deforms(thing)]
        self.deforming = Deforming(followed, self.shapes, findings)
        self.shapes.deforming = self.deforming.names
        looks = [self.deforming.look] if followed else []
        self.sampling = sampled(self.scene, self.things, kept, looks)

    def is_sound(self, thing):
        sound = is_sound(thing)
        if not sound:
            self.shapes.left_out(thing, "without a size or a place")
        return sound

    def export(self, instances):
        """Returns the whole scene; frame 0 of a bake is the first frame of Blender's range."""
        bodies = [body for body in map(self.body, self.things) if body]
        bodies += [body for body in map(self.instance, instances) if body]
        if not bodies:
            raise ValueError("no object has a rigid body that Drystone can bake")
        motions = {body["name"]: body["motion"] for body in bodies}
        joints = JointExporter(self.scene, motions, self.findings).joints
        channels = self.channels([thing for thing in self.things if motions.get(thing.name) == "dynamic"])
        document = self.world() | {"bodies": bodies} | ({"joints": joints} if joints else {})
        return Export(document, channels, self.findings)

    def channels(self, things):
        """Returns the channels of active bodies by name, of those that can have keys."""
        for thing in things:
            if thing.library:
                self.findings.add(LEFT_OUT, "object", " linked from another file: no keys, unless made local",
                                  thing.name)
        channels = {thing.name: Channels(thing, self.sampling.above.get(thing.name))
                    for thing in things if not thing.library}
        for of in channels.values():
            if of.is_apart:
                self.findings.add(CHANGED, "object", " below another body or an uneven parent: without a parent "
                                  "while baked", of.name)
            if not of.is_exact:
                self.findings.add(CHANGED, "object", " sheared by a parent: turned approximately", of.name)
        return channels

    def world(self):
        scene, step = self.scene, time_step(self.scene)
        weights = scene.rigidbody_world.effector_weights
        gravity = scene.gravity * (weights.gravity * weights.all if scene.use_gravity else 0)
        return {
            "name": scene.name,
            "gravity": turned(gravity),
            "time_step": step,
            "steps": scene.frame_end - scene.frame_start,
            "solver": {"substeps": self.substeps or max(8, math.ceil(step / SUBSTEP - 1e-9))},
            "extras": {"frame_start": scene.frame_start},
        }

    def motion(self, thing):
        """Returns the motion of a body, and notes what it cannot have."""
        of, name = thing.rigid_body, thing.name
        if of.type == "PASSIVE":
            if not of.kinematic and self.sampling.is_moved_rigidly(name):
                self.findings.add(CHANGED, "passive object", " moved but not Animated: still", name)
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
        if not is_held(thing):
            return "dynamic"
        if self.sampling.is_released(name):
            if self.abilities.release:
                return "dynamic"
            self.findings.add(LEFT_OUT, "object", " with a release by keys: not known to this version of "
                              "drystone", name)
        return "kinematic"

    def body(self, thing):
        """Returns a body, or None if it has no shape."""
        of, motion = thing.rigid_body, self.motion(thing)
        shapes = self.shapes.shapes(thing, motion == "dynamic")
        if not shapes:
            return None
        self.deforming.follow(thing.name, shapes, time_step(self.scene))
        body = self.described(thing.name, of, motion, thing.matrix_world, shapes)
        if motion == "dynamic":
            body |= self.dynamics(thing) | self.shapes.mass_keys(shapes, of.mass)
        return body | self.track(thing, motion)

    def instance(self, instance):
        """Returns an instance as a body, or None if it has no shape."""
        of, shapes = instance.thing.rigid_body, self.shapes.instance(instance.thing, instance.matrix)
        return self.described(instance.name, of, "static", instance.matrix, shapes) if shapes else None

    @staticmethod
    def described(name, of, motion, matrix, shapes):
        """Returns the keys that all bodies have, from the settings of a rigid body."""
        position, rotation = pose_of(matrix)
        layers = [f"layer {i + 1}" for i, on in enumerate(of.collision_collections) if on]
        return {
            "name": name,
            "motion": motion,
            "position": position,
            "rotation": rotation,
            "friction": of.friction,
            "restitution": of.restitution,
            # Blender multiplies both.
            "friction_combine": "multiply",
            "restitution_combine": "multiply",
            "shapes": shapes,
            "collision": {"systems": layers, "collides_with": layers},
        }

    def dynamics(self, thing):
        """Returns the keys that only a dynamic body has."""
        of = thing.rigid_body
        body = {
            "mass": of.mass,
            "linear_damping": min(decay(of.linear_damping) + self.wind.drag / of.mass, STRONGEST),
            "angular_damping": decay(of.angular_damping),
        }
        if self.wind.force.length > 0:
            body["force"] = turned(self.wind.force)
        if of.use_deactivation and of.use_start_deactivated and not is_held(thing):
            if self.abilities.start_asleep:
                body["start_asleep"] = True
            else:
                self.findings.add(LEFT_OUT, "object",
                                  " with Start Deactivated: not known to this version of drystone", thing.name)
        return body

    def track(self, thing, motion):
        """Returns the key with the poses of a body that follows its keys; none if it keeps its place."""
        if motion == "static" or motion == "kinematic" and not self.sampling.is_moved(thing.name):
            return {}
        poses = [pose_of(matrix) for matrix in self.sampling.tracks.get(thing.name, [])]
        if not poses:
            return {}
        step = time_step(self.scene)
        return {"track": [{"time": frame * step, "position": position, "rotation": rotation}
                          for frame, (position, rotation) in enumerate(poses)]}


def unselected(context):
    """Returns the names of active bodies that are not selected."""
    selected = set(context.view_layer.objects.selected)
    things = [thing for thing in bodies_of(context.scene) if may_move(thing)]
    return frozenset(thing.name for thing in things if thing not in selected)


def export(context, abilities=Abilities(), substeps=0, kept=frozenset(), start=None):
    """Returns a scene as Drystone has it. The objects to be kept follow their keys.

    With a start, the scene begins inside of a bake.
    """
    scene = context.scene
    if not scene.rigidbody_world:
        raise ValueError("the scene has no rigid body world: add a rigid body to an object first")
    if scene.frame_end < scene.frame_start:
        raise ValueError("the last frame of the scene is before its first")
    moves = start.moves if start else take_moves(scene)
    kept = kept | start.kept if start else kept
    things, inside, findings = bodies_of(scene), simulated(scene), Findings()
    with still(scene, kept):
        names = [thing.name for thing in scene.objects]
        instances = instances_of(context.evaluated_depsgraph_get(), names, findings)
        left = generating([*inside.values(), *{each.thing for each in instances}])
        with with_values(left, "show_viewport", False):
            if left:
                scene.frame_set(scene.frame_start)
            exporter = Exporter(context, abilities, substeps, things, kept, findings)
            shot = exporter.export(instances)
            survey(scene, inside, findings, exporter.deforming.names)
    if start:
        start.begin(shot, abilities)
    show_moves(scene, moves)
    return shot
