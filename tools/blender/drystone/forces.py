"""Force fields of a scene: wind becomes a constant force and a drag."""

from mathutils import Vector

from .curves import animates
from .findings import CHANGED, LEFT_OUT
from .space import enabled, frames_per_second

# Settings of a wind that blows the same everywhere, and always.
STEADY = {"shape": ("PLANE", "POINT", "LINE"), "falloff_type": ("SPHERE",), "falloff_power": (0,),
          "z_direction": ("BOTH",), "noise": (0,), "use_min_distance": (False,), "use_max_distance": (False,),
          "use_absorption": (False,)}


def fields(view_layer, weights):
    """Returns the objects with force fields that reach rigid bodies in Blender, those hidden by the eye included."""
    inside = set(weights.collection.all_objects) if weights.collection else None
    things = [thing for thing in enabled(view_layer) if thing.field and thing.field.type != "NONE"]
    return [thing for thing in things if inside is None or thing in inside]


def is_steady(field):
    return field.type == "WIND" and all(getattr(field, key) in values for key, values in STEADY.items())


def turns_of(thing, sampling):
    """Returns words on what changes a wind after the first frame, or nothing."""
    if animates(thing, "field", "rotation_"):
        return "with keys"
    if thing.name_full in sampling.movers:
        return "of a body that the simulation moves"
    if thing.name_full in sampling.following:
        return "following a body that the simulation moves"
    return "turned by a parent or a constraint" if sampling.is_turned(thing.name_full) else ""


class Winds:
    """The winds of a scene at its first frame, where a binary takes forces.

    Blender pushes a body with F = s / r n - f v: strength s, rate of frames r, axis n, flow f.
    """

    def __init__(self, scene, things, can_push, sampling, findings):
        # Force [N] and drag [N s/m] of each wind, by the name of its object.
        self._winds = {}
        weights = scene.rigidbody_world.effector_weights
        weight = weights.all * weights.wind
        for thing in things:
            field = thing.field
            if not is_steady(field):
                findings.add(LEFT_OUT, "force field", " other than steady wind: left out", thing.name_full)
            elif not can_push:
                findings.add(LEFT_OUT, "wind", ": not known to this version of drystone", thing.name_full)
            elif field.apply_to_location:
                axis = thing.matrix_world.to_3x3().col[2].normalized()
                force = axis * (weight * field.strength / frames_per_second(scene))
                self._winds[thing.name_full] = force, weight * field.flow
                turns = turns_of(thing, sampling)
                if turns:
                    findings.add(CHANGED, "wind", f" {turns}: as at the first frame", thing.name_full)

    def on(self, name):
        """Returns force [N] and drag [N s/m] on a body, which its own wind leaves alone."""
        others = [of for emitter, of in self._winds.items() if emitter != name]
        return sum((force for force, _ in others), Vector()), sum(drag for _, drag in others)
