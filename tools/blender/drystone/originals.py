"""States of objects before their bake: kept in a custom property, shown for a while, restored."""

import json
from contextlib import contextmanager

import bpy
import numpy as np
from mathutils import Euler, Matrix, Quaternion, Vector

from .curves import TRANSFORMS, channelbags, curves_of, is_replaced
from .space import ORIGINAL, is_baked

# Values of an object that a bake replaces.
VALUES = ("rotation_mode", "location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle",
          "delta_location", "delta_rotation_euler", "delta_rotation_quaternion")
# Kind of a parent, beside the parent itself and the inverse of its matrix.
PARENTING = ("parent_type", "parent_bone", "parent_vertices")
# Blending of an action that replaces values during a bake.
BLENDING = {"action_blend_type": "REPLACE", "action_influence": 1.0}
# Mark of the actions of bakes.
OURS = "drystone"
# Name of the template of common actions, and the curves that it has of each object.
TEMPLATE = "Drystone template"
KEYED = {"location": 3, "rotation_quaternion": 4}
# Objects of a common action. Blender copies a whole action when one of its keys changes.
COMMON = 50
# A channel that differs by more from its curve was changed by hand. [m, or 1]
CHANGED = 1e-5


def _plain(value):
    return value if isinstance(value, (str, bool, float, int)) else list(value)


def _values(thing):
    return {key: _plain(getattr(thing, key)) for key in VALUES}


def _id_of(driver):
    return f"{driver.data_path}[{driver.array_index}]"


def capture(thing):
    """Returns the state of an object, as a dictionary that a custom property can hold."""
    data = thing.animation_data
    state = {"values": _values(thing), "scale": list(thing.scale), "animated": data is not None}
    if thing.parent:
        state["parent"] = thing.parent
        state["parenting"] = {key: _plain(getattr(thing, key)) for key in PARENTING}
        state["inverse"] = [value for row in thing.matrix_parent_inverse for value in row]
    if thing.rigid_body:
        state["kinematic"] = thing.rigid_body.kinematic
    # Names within custom properties are short, so that these are texts.
    state["constraints"] = json.dumps({of.name: of.enabled for of in thing.constraints})
    if data:
        state["drivers"] = json.dumps({_id_of(driver): driver.mute for driver in data.drivers})
        state["blending"] = {key: getattr(data, key) for key in BLENDING}
        if data.action:
            state["action"] = data.action
            state["slot"] = data.action_slot.identifier if data.action_slot else ""
    return state


def _restore_animation(thing, state):
    if not state["animated"]:
        thing.animation_data_clear()
        return
    data = thing.animation_data or thing.animation_data_create()
    for key, value in state["blending"].items():
        setattr(data, key, value)
    mutes = json.loads(state["drivers"])
    for driver in data.drivers:
        driver.mute = mutes.get(_id_of(driver), driver.mute)
    data.action = state.get("action")
    if data.action:
        slots = [slot for slot in data.action.slots if slot.identifier == state["slot"]]
        data.action_slot = slots[0] if slots else None


def _restore_parent(thing, state):
    parent = state.get("parent")
    if thing.parent == parent:
        return
    thing.parent = parent
    thing.scale = state["scale"]
    if parent:
        for key, value in state["parenting"].items():
            setattr(thing, key, value)
        # Without the class, rows would be taken for columns.
        thing.matrix_parent_inverse = Matrix(np.array(state["inverse"]).reshape(4, 4))


def restore(thing, state):
    """Puts an object into a state."""
    _restore_parent(thing, state)
    _restore_animation(thing, state)
    for key, value in state["values"].items():
        setattr(thing, key, value)
    if thing.rigid_body and "kinematic" in state:
        thing.rigid_body.kinematic = state["kinematic"]
    enabled = json.loads(state["constraints"])
    for of in thing.constraints:
        of.enabled = enabled.get(of.name, of.enabled)


def baked_things(scene):
    return [thing for thing in scene.objects if is_baked(thing)]


@contextmanager
def shown(scene, kept=frozenset()):
    """Shows baked objects of a scene as before their bake, but for those to be kept."""
    baked = [(thing, capture(thing)) for thing in baked_things(scene) if thing.name not in kept]
    try:
        for thing, _ in baked:
            restore(thing, thing[ORIGINAL].to_dict())
        yield
    finally:
        for thing, state in baked:
            restore(thing, state)


def prepare(thing):
    """Keeps the state of an object that has no bake yet; returns the action and the slot of that state."""
    if not is_baked(thing):
        thing[ORIGINAL] = capture(thing)
    state = thing[ORIGINAL].to_dict()
    return state.get("action"), _slot_of(state)


def _slot_of(state):
    action = state.get("action")
    slots = [slot for slot in action.slots if slot.identifier == state["slot"]] if action else []
    return slots[0] if slots else None


class Actions:
    """Actions of one bake: copies of those that objects had, and common ones for all objects without.

    An action of Blender 5 has one layer and one strip. So keys of a bake cannot lie above other ones: a copy
    has them instead of those of the place.

    Whenever an F-curve is made, Blender rebuilds its graph of all objects. So common actions are copies of a
    template that has all curves. Actions are kept by name, as undo replaces them.
    """

    def __init__(self):
        # By name of an action: the names of its copies, each with the handles of the slots in use.
        self._copies = {}
        # Names of actions, and handles of slots, for the next objects without an action of their own.
        self._room = []
        # By name of an object: the name of its action, and the handle of its slot.
        self._places = {}
        # The same as actions and slots, until `refresh`.
        self._found = {}

    def refresh(self):
        """Forgets references to actions and slots."""
        self._found = {}

    def place_for(self, thing):
        """Returns the action and the slot for the keys of an object. It does not use them yet."""
        if thing.name not in self._found:
            self._found[thing.name] = self._place_for(thing)
        return self._found[thing.name]

    def _place_for(self, thing):
        found = _place_of(*self._places.get(thing.name, ("", 0)))
        if found:
            return found
        action, slot = prepare(thing)
        action, slot = self._copy(action, slot.handle) if slot else self._in_common(thing.name)
        self._places[thing.name] = action.name, slot.handle
        return action, slot

    def _in_common(self, name):
        found = _place_of(*self._room.pop(0)) if self._room else None
        if not found:
            template = bpy.data.actions.get(TEMPLATE) or self._template()
            action = self._marked(template.copy())
            action.name = "Drystone"
            self._room = [(action.name, slot.handle) for slot in action.slots]
            found = _place_of(*self._room.pop(0))
        found[1].name_display = name
        return found

    def _template(self):
        template = self._marked(bpy.data.actions.new(TEMPLATE))
        for _ in range(COMMON):
            bag = bag_of(template, template.slots.new(id_type="OBJECT", name="Object"))
            for path, count in KEYED.items():
                for index in range(count):
                    bag.fcurves.new(path, index=index)
        return template

    def _copy(self, action, handle):
        copies = self._copies.setdefault(action.name, {})
        free = [name for name, used in copies.items() if handle not in used and name in bpy.data.actions]
        copy = bpy.data.actions[free[0]] if free else self._marked(action.copy())
        if not free:
            copy.name = f"{action.name} Drystone"
        copies.setdefault(copy.name, set()).add(handle)
        slot = _slot_with(copy, handle)
        bag = bag_of(copy, slot)
        for curve in [curve for curve in bag.fcurves if is_replaced(curve.data_path)]:
            bag.fcurves.remove(curve)
        return copy, slot

    def end(self):
        """Removes room that no object needs."""
        for action, slot in filter(None, (_place_of(*place) for place in self._room)):
            action.slots.remove(slot)
        self._room = []
        remove_unused_actions()

    @staticmethod
    def _marked(action):
        action[OURS] = True
        return action


def _slot_with(action, handle):
    return next((slot for slot in action.slots if slot.handle == handle), None)


def _place_of(name, handle):
    """Returns the action of a name and its slot of a handle, or None."""
    action = bpy.data.actions.get(name)
    slot = _slot_with(action, handle) if action else None
    return (action, slot) if slot else None


def bag_of(action, slot):
    """Returns the bag of F-curves of a slot, made if need be."""
    layer = action.layers[0] if action.layers else action.layers.new("Drystone")
    strip = layer.strips[0] if layer.strips else layer.strips.new(type="KEYFRAME")
    return strip.channelbag(slot, ensure=True)


def assign(thing, action, slot):
    """Makes an object show the keys of a bake; tells whether it did not before."""
    data = thing.animation_data or thing.animation_data_create()
    if data.action == action and data.action_slot == slot:
        return False
    data.action, data.action_slot = action, slot
    return True


def take_over(thing, channels):
    """Stops all that would move an object besides the keys of its bake."""
    if channels.is_apart:
        thing.parent = None
        thing.scale = channels.scale
    for of in thing.constraints:
        of.enabled = False
    data = thing.animation_data
    for driver in data.drivers:
        driver.mute = driver.mute or is_replaced(driver.data_path)
    for key, value in BLENDING.items():
        setattr(data, key, value)
    thing.rotation_mode = "QUATERNION"
    thing.delta_location = channels.delta
    if thing.rigid_body:
        # Or Blender's own simulation would move it as well.
        thing.rigid_body.kinematic = True


def forget(thing):
    """Puts an object back into its state before the bake, if it has one."""
    if is_baked(thing):
        restore(thing, thing[ORIGINAL].to_dict())
        del thing[ORIGINAL]


def remove_unused_actions():
    for action in [action for action in bpy.data.actions if OURS in action and not action.users]:
        bpy.data.actions.remove(action)


# Objects that were moved since their bake


def _keyed(thing, frame):
    """Returns the location and the quaternion that the keys of a bake have at a frame, or None."""
    curves = {(curve.data_path, curve.array_index): curve for curve in curves_of(thing)}
    wanted = [(path, index) for path, count in KEYED.items() for index in range(count)]
    if any(key not in curves for key in wanted):
        return None
    return np.array([curves[key].evaluate(frame) for key in wanted])


def last_key(thing):
    """Returns the last frame that a baked object has a key of its place at, or one before all."""
    curves = [curve for curve in curves_of(thing) if curve.data_path == "location" and len(curve.keyframe_points)]
    return int(curves[0].keyframe_points[-1].co.x) if curves else -2**31


def keys_until(thing, frame):
    """Returns frames and values of the keys of a bake before a frame, as rows, by path and index."""
    keys = {}
    for curve in curves_of(thing):
        if curve.data_path in KEYED:
            co = np.empty(2 * len(curve.keyframe_points), np.float32)
            curve.keyframe_points.foreach_get("co", co)
            rows = co.reshape(-1, 2)
            keys[curve.data_path, curve.array_index] = rows[rows[:, 0] < frame]
    return keys


def shown_apart(thing, frame):
    """Tells whether an object is shown elsewhere than by the keys of its bake: it was moved by hand."""
    keyed = _keyed(thing, frame) if thing.rotation_mode == "QUATERNION" else None
    now = np.array([*thing.location, *thing.rotation_quaternion])
    return keyed is not None and np.abs(now - keyed).max() > CHANGED


def _moved_to(thing, scene):
    """Returns the channels to which an object was moved since its bake, or None."""
    first = thing[ORIGINAL].get("first")
    if first is None or thing.rotation_mode != "QUATERNION":
        return None
    now = np.array([*thing.location, *thing.rotation_quaternion])
    keyed = _keyed(thing, scene.frame_current_final)
    if keyed is None or np.abs(now - keyed).max() > CHANGED:
        return now
    start = _keyed(thing, thing[ORIGINAL]["frame"])
    return start if np.abs(start - np.array(first)).max() > CHANGED else None


def _with_pose(thing, state, channels):
    """Returns the values of a state, with the place and the turn of the channels of its bake."""
    place = Vector(channels[:3])
    turn = (Quaternion(thing.delta_rotation_quaternion) @ Quaternion(channels[3:])).normalized()
    if "above" in state:
        # Without its parent, the object is keyed in the world.
        below = Matrix(np.array(state["above"]).reshape(4, 4)).inverted()
        place, turn = below @ place, below.to_quaternion() @ turn
    values = state["values"]
    mode = values["rotation_mode"]
    moved = {**values, "location": list(place)}
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


def take_moves(scene):
    """Makes places to which baked objects were moved their places before the bake.

    Objects with keys of their own start from these. Returns the channels that show the moves, by name.
    """
    moves = {}
    for thing in baked_things(scene):
        channels, state = _moved_to(thing, scene), thing[ORIGINAL].to_dict()
        bags = channelbags(state.get("action"), _slot_of(state))
        keyed = any(curve.data_path.startswith(TRANSFORMS) for bag in bags for curve in bag.fcurves)
        if channels is None or keyed:
            continue
        state["values"] = _with_pose(thing, state, channels)
        thing[ORIGINAL] = state
        moves[thing.name] = [*thing.location, *thing.rotation_quaternion]
    return moves


def show_moves(scene, moves):
    """Shows moved objects where they were moved to, until the frame changes."""
    for name, channels in moves.items():
        thing = scene.objects[name]
        thing.location, thing.rotation_quaternion = channels[:3], channels[3:]
