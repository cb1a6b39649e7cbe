"""Objects that were moved by hand since their bake, which start from their new places."""

import bpy
import numpy as np
from mathutils import Euler, Matrix, Quaternion, Vector

from .channels import nearest_rotations
from .curves import TRANSFORMS, channelbags
from .originals import CHANGED, baked_things, deltas_of, keyed_at, slot_of, take_parents
from .sampling import still
from .space import ORIGINAL, objects_of, rigid
from .switches import strip_paths


def _differ(one, other):
    return np.abs(np.array(one) - np.array(other)).max() > CHANGED


def _moved_to(thing, scene, is_below_another):
    """Returns the channels to which an object was moved since its bake, or None.

    An object with another parent than at its bake keeps the channels that it has below this one.
    """
    state = thing[ORIGINAL]
    if not {"first", "deltas"} <= set(state.keys()) or thing.rotation_mode != "QUATERNION":
        return None
    now = np.array([*thing.location, *thing.rotation_quaternion])
    keyed = keyed_at(thing, scene.frame_current_final)
    if keyed is None or _differ(now, keyed):
        return now
    start = keyed_at(thing, state["frame"])
    is_moved = is_below_another or _differ(start, state["first"]) or _differ(deltas_of(thing), state["deltas"])
    return start if is_moved else None


def _has_keys(thing):
    """Tells whether an object had keys of its own place before its bake."""
    state = thing[ORIGINAL].to_dict()
    bags = channelbags(state.get("action"), slot_of(state))
    paths = {curve.data_path for bag in bags for curve in bag.fcurves} | strip_paths(thing)
    return any(path.startswith(TRANSFORMS) for path in paths)


def _with_deltas(thing, values):
    """Returns values with the deltas of an object, where these were changed since its bake."""
    if not _differ(deltas_of(thing), thing[ORIGINAL]["deltas"]):
        return values
    return values | {"delta_location": list(thing.delta_location),
                     "delta_rotation_quaternion": list(thing.delta_rotation_quaternion)}


def _placed(values, place, turn):
    """Returns values that show a place and a turn, both with deltas, in the frame of an object."""
    mode = values["rotation_mode"]
    moved = {**values, "location": list(place - Vector(values["delta_location"]))}
    if mode == "QUATERNION":
        delta = Quaternion(values["delta_rotation_quaternion"]).normalized()
        moved["rotation_quaternion"] = list(delta.inverted() @ turn)
    elif mode == "AXIS_ANGLE":
        axis, angle = turn.to_axis_angle()
        moved["rotation_axis_angle"] = [angle, *axis]
    else:
        delta = Euler(values["delta_rotation_euler"], mode).to_matrix()
        moved["rotation_euler"] = list((delta.inverted() @ turn.to_matrix()).to_euler(mode))
    return moved


def take_moves(scene, kept=frozenset()):
    """Makes places to which baked objects were moved their places before the bake.

    Objects with keys of their own start from these. Returns the channels that show the moves, by name.
    """
    return _take_moves(scene, baked_things(scene), take_parents(scene), kept)


def take_reparented(scene):
    """Makes new parents of baked objects their parents before the bake, with the places below these."""
    reparented = take_parents(scene)
    _take_moves(scene, [thing for thing in baked_things(scene) if thing.name in reparented], reparented)


def _take_moves(scene, things, reparented, kept=frozenset()):
    moves, apart = {}, {}
    for thing in things:
        channels = _moved_to(thing, scene, thing.name in reparented)
        if channels is None:
            continue
        if _has_keys(thing):
            # Deltas move an object with keys.
            thing[ORIGINAL]["values"] = _with_deltas(thing, thing[ORIGINAL].to_dict()["values"])
            continue
        place = Vector(channels[:3]) + thing.delta_location
        turn = (thing.delta_rotation_quaternion @ Quaternion(channels[3:])).normalized()
        values = _with_deltas(thing, thing[ORIGINAL].to_dict()["values"])
        if "apart" in thing[ORIGINAL]:
            apart[thing.name_full] = values, place, turn
        else:
            thing[ORIGINAL]["values"] = _placed(values, place, turn)
        moves[thing.name_full] = [*thing.location, *thing.rotation_quaternion]
    if apart:
        _take_apart(scene, apart, kept - apart.keys())
    return moves


def _ancestors(thing):
    return 1 + _ancestors(thing.parent) if thing.parent else 0


def _take_apart(scene, apart, kept):
    """Makes places in the world places below the parents that objects have outside of their bake.

    Parents come first, since they may be moved as well.
    """
    with still(scene, kept):
        there = objects_of(scene)
        things = sorted((there[name] for name in apart), key=_ancestors)
        for thing in things:
            bpy.context.view_layer.update()
            values, place, turn = apart[thing.name_full]
            values = _placed(values, *_below_parent(thing, place, turn))
            thing[ORIGINAL]["values"] = values
            for key, value in values.items():
                setattr(thing, key, value)


def _below_parent(thing, place, turn):
    """Returns a place and a turn in the world as those below the parent: approximate below an uneven one."""
    above = thing.matrix_world @ thing.matrix_basis.inverted_safe()
    below = above.inverted_safe()
    by = turn.to_matrix() @ rigid(thing).to_3x3().transposed()
    wanted = below.to_3x3() @ by @ above.to_3x3() @ thing.matrix_basis.to_quaternion().to_matrix()
    return below @ place, Matrix(nearest_rotations(np.array(wanted)[None])[0]).to_quaternion()


def show_moves(scene, moves):
    """Shows moved objects where they were moved to, until the frame changes."""
    there = objects_of(scene)
    for name, channels in moves.items():
        thing = there[name]
        thing.location, thing.rotation_quaternion = channels[:3], channels[3:]
