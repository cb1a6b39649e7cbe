"""States of objects before their bake: kept in a custom property, shown for a while, restored."""

import json
from contextlib import contextmanager

import bpy
import numpy as np
from mathutils import Matrix

from .curves import animates, channelbags, copy_curves, curves_of, digests_of, is_replaced
from .owners import Owners
from .space import ORIGINAL, is_baked, objects_of, simulated
from .switches import (OURS, Snapshot, clean_strips, edits_of, is_ours, note_made, restore_strips, slot_with,
                       turn_off, turn_on)

# Values of an object that a bake replaces.
VALUES = ("rotation_mode", "location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle",
          "delta_location", "delta_rotation_euler", "delta_rotation_quaternion")
# Kind of a parent, beside the parent itself and the inverse of its matrix.
PARENTING = ("parent_type", "parent_bone", "parent_vertices")
# Key of a state with a property of the user that has the same name.
OWN = "own"
# Blending of an action that replaces values during a bake.
BLENDING = {"action_blend_type": "REPLACE", "action_influence": 1.0}
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


def _animation_of(thing):
    """Returns the animation of an object, which leaves tweak mode: its action could not be set there."""
    data = thing.animation_data
    if data and data.use_tweak_mode:
        data.use_tweak_mode = False
    return data


def leave_tweak_mode(scene):
    """Makes all objects leave tweak mode; returns the names of those that were in it."""
    things = [thing for thing in objects_of(scene).values()
              if thing.animation_data and thing.animation_data.use_tweak_mode]
    for thing in things:
        _animation_of(thing)
    return {thing.name_full for thing in things}


def _parenting(thing):
    """Returns the keys of a state that tell of a parent."""
    if not thing.parent:
        return {}
    return {"parent": thing.parent, "parenting": {key: _plain(getattr(thing, key)) for key in PARENTING},
            "inverse": [value for row in thing.matrix_parent_inverse for value in row]}


def capture(thing):
    """Returns the state of an object, as a dictionary that a custom property can hold."""
    data = _animation_of(thing)
    state = {"values": _values(thing), "scale": list(thing.scale), "animated": data is not None}
    state |= _parenting(thing)
    if is_baked(thing) and "apart" in thing[ORIGINAL]:
        state["apart"] = list(thing[ORIGINAL]["apart"])
    if thing.rigid_body:
        state["kinematic"] = thing.rigid_body.kinematic
    if data:
        state["blending"] = {key: getattr(data, key) for key in BLENDING}
        if data.action:
            state |= _using(data.action, data.action_slot)
    return state


def _using(action, slot):
    """Returns the keys of a state that tell of an action."""
    return {"action": action, "slot": slot.identifier if slot else "", "handle": slot.handle if slot else 0}


def _restore_animation(thing, state):
    data = _animation_of(thing)
    if not data and not state.get("action"):
        return
    data = data or thing.animation_data_create()
    for key, value in state.get("blending", BLENDING).items():
        setattr(data, key, value)
    data.action = state.get("action")
    if data.action:
        data.action_slot = slot_of(state)


def _restore_parent(thing, state):
    parent = state.get("parent")
    # The parent of an object apart may have been deleted.
    if thing.parent == parent and "apart" not in state:
        return
    thing.parent = parent
    thing.scale = state["scale"]
    if parent:
        for key, value in state["parenting"].items():
            setattr(thing, key, value)
        # Without the class, rows would be taken for columns.
        thing.matrix_parent_inverse = Matrix(np.array(state["inverse"]).reshape(4, 4))


def restore(thing, state):
    """Puts an object into a state, but for its switches and strips."""
    _restore_parent(thing, state)
    _restore_animation(thing, state)
    for key, value in state["values"].items():
        setattr(thing, key, value)
    if thing.rigid_body and "kinematic" in state:
        thing.rigid_body.kinematic = state["kinematic"]


def _notes(thing):
    """Returns the notes of the switches that a bake has turned off. Names in custom properties are short."""
    return json.loads(thing[ORIGINAL].get("switches", "[]"))


def _show_original(thing):
    restore(thing, thing[ORIGINAL].to_dict())
    turn_on(thing, _notes(thing))
    restore_strips(thing)


def baked_things(scene):
    """Returns the baked objects of a scene: those of its own bake, and those that it simulates.

    Others are of the bake of another scene, and move by its keys.
    """
    things = [thing for thing in objects_of(scene).values() if is_baked(thing) and not thing.library]
    owners = Owners()
    others = [thing for thing in things if not owners.has_bake(scene, thing)]
    left = set(others) - set(simulated(scene).values()) if others else ()
    return [thing for thing in things if thing not in left]


@contextmanager
def shown(scene, kept=frozenset()):
    """Shows baked objects of a scene as before their bake, but for those to be kept.

    Drivers, tracks and constraints made since the bake stay. All objects leave tweak mode.
    """
    leave_tweak_mode(scene)
    things = [thing for thing in baked_things(scene) if thing.name_full not in kept]
    baked = [(thing, capture(thing), Snapshot(thing)) for thing in things]
    try:
        for thing in things:
            _show_original(thing)
        yield
    finally:
        for thing, state, snapshot in baked:
            restore(thing, state)
            snapshot.put_back()


def _own_property(thing):
    """Returns the value of a user's property that has the name of the state, or None."""
    value = thing.get(ORIGINAL)
    for key in ("to_dict", "to_list"):
        value = getattr(value, key)() if hasattr(value, key) else value
    return value


def prepare(thing):
    """Keeps the state of an object before its first bake; returns the action and the slot of that state."""
    if is_baked(thing):
        _take_edits(thing)
    else:
        own = _own_property(thing)
        thing[ORIGINAL] = capture(thing) | ({} if own is None else {OWN: own})
    state = thing[ORIGINAL].to_dict()
    return state.get("action"), slot_of(state)


def slot_of(state):
    """Returns the slot of a state, also if it was renamed, or made anew under its name; None without one."""
    action = state.get("action")
    if not action:
        return None
    named = (slot for slot in action.slots if slot.identifier == state["slot"])
    return slot_with(action, state.get("handle")) or next(named, None)


class Actions:
    """Actions of one bake: copies of those that objects had, and common ones for all objects without.

    An action of Blender 5 has one layer and one strip. So keys of a bake cannot lie above other ones: a copy
    has them instead of those of the place.

    Whenever an F-curve is made, Blender rebuilds its graph of all objects. So common actions are copies of a
    template that has all curves. Actions are kept by name, as undo replaces them.
    """

    def __init__(self):
        # By full name of an action: the names of its copies, each with the handles of the slots in use.
        self._copies = {}
        # Names of actions, and handles of slots, for the next objects without an action of their own.
        self._room = []
        # By session UID of an object: the name of its action, and the handle of its slot.
        self._places = {}
        # The same as actions and slots, until `refresh`.
        self._found = {}

    def refresh(self):
        """Forgets references to actions and slots."""
        self._found = {}

    def place_for(self, thing):
        """Returns the action and the slot for the keys of an object. It does not use them yet."""
        uid = thing.session_uid
        if uid not in self._found:
            self._found[uid] = self._place_for(thing)
        return self._found[uid]

    def _place_for(self, thing):
        found = _place_of(*self._places.get(thing.session_uid, ("", 0)))
        if found:
            return found
        action, slot = prepare(thing)
        action, slot = self._copy(action, slot.handle) if slot else self._in_common(thing.name_full)
        self._places[thing.session_uid] = action.name, slot.handle
        return action, slot

    def is_shown(self, thing):
        """Tells whether an object shows its keys of this bake."""
        data, (name, _) = thing.animation_data, self._places[thing.session_uid]
        return data is not None and data.action is not None and data.action.name == name

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
        copies = self._copies.setdefault(action.name_full, {})
        free = [name for name, used in copies.items() if handle not in used and name in bpy.data.actions]
        copy = bpy.data.actions[free[0]] if free else self._marked(action.copy())
        if not free:
            copy.name = f"{action.name} Drystone"
        copies.setdefault(copy.name, set()).add(handle)
        slot = slot_with(copy, handle)
        bag = bag_of(copy, slot)
        for curve in [curve for curve in bag.fcurves if is_replaced(curve.data_path)]:
            bag.fcurves.remove(curve)
        note_made(copy, slot)
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


def _place_of(name, handle):
    """Returns the action of a name and its slot of a handle, or None."""
    action = bpy.data.actions.get(name)
    slot = slot_with(action, handle) if action else None
    return (action, slot) if slot else None


def bag_of(action, slot):
    """Returns the bag of F-curves of a slot, made if need be."""
    layer = action.layers[0] if action.layers else action.layers.new("Drystone")
    strip = layer.strips[0] if layer.strips else layer.strips.new(type="KEYFRAME")
    return strip.channelbag(slot, ensure=True)


def assign(thing, action, slot):
    """Makes an object show the keys of a bake; tells whether it did not before."""
    data = _animation_of(thing) or thing.animation_data_create()
    if data.action == action and data.action_slot == slot:
        return False
    data.action, data.action_slot = action, slot
    return True


def take_over(thing, channels):
    """Stops all that would move an object besides the keys of its bake."""
    state = thing[ORIGINAL]
    if channels.is_apart:
        thing.parent = None
        thing.scale = channels.scale
        # Size without the parent. An object whose size differs was scaled by hand.
        state["apart"] = list(thing.scale)
    else:
        _restore_parent(thing, state.to_dict())
        state.pop("apart", None)
    restore_strips(thing)
    clean_strips(thing)
    state["switches"] = json.dumps(turn_off(thing, _notes(thing)))
    for key, value in BLENDING.items():
        setattr(thing.animation_data, key, value)
    thing.rotation_mode = "QUATERNION"
    thing.delta_location, thing.delta_rotation_quaternion = channels.delta, channels.delta_rotation
    state["deltas"] = deltas_of(thing)
    if thing.rigid_body:
        # Or Blender's own simulation would move it as well.
        thing.rigid_body.kinematic = True


def deltas_of(thing):
    """Returns the deltas that act on the channels of a bake, as a list."""
    return [*thing.delta_location, *thing.delta_rotation_quaternion]


def forget(thing):
    """Puts an object back into its state before the bake, if it has one, with what was changed since."""
    if not is_baked(thing):
        return
    _take_edits(thing)
    _show_original(thing)
    data = thing.animation_data
    if data and not (thing[ORIGINAL]["animated"] or data.action or data.drivers or data.nla_tracks):
        thing.animation_data_clear()
    own = thing[ORIGINAL].to_dict().get(OWN)
    del thing[ORIGINAL]
    if own is not None:
        thing[ORIGINAL] = own


def remove_unused_actions():
    for action in [action for action in bpy.data.actions if is_ours(action) and not action.users]:
        bpy.data.actions.remove(action)


# Objects that were changed since their bake


def take_edits(scene):
    """Makes keys and sizes that baked objects got since their bake part of their state before it."""
    for thing in baked_things(scene):
        _take_edits(thing)


def take_parents(scene):
    """Makes parents that baked objects got or lost since their bake part of their state before it.

    Returns the names of these objects.
    """
    return {thing.name for thing in baked_things(scene) if _take_parent(thing)}


def _take_edits(thing):
    state = thing[ORIGINAL].to_dict()
    changes = _new_action(thing, state)
    if "apart" in state and not thing.parent and not animates(thing, "scale"):
        now, then = np.array(thing.scale), np.array(state["apart"])
        if (now != then).any():
            scale = state["scale"] * now / np.where(then == 0, 1, then)
            changes |= {"scale": scale.tolist(), "apart": now.tolist()}
    for key, value in changes.items():
        thing[ORIGINAL][key] = value


def _take_parent(thing):
    """Tells whether an object got or lost a parent since its bake."""
    state = thing[ORIGINAL].to_dict()
    if "apart" in state and not thing.parent and not _is_below_itself(thing):
        return False
    now = {"scale": list(thing.scale)} | _parenting(thing)
    for key in ("parent", "parenting", "inverse"):
        if key not in now and key in state:
            del thing[ORIGINAL][key]
    for key, value in now.items():
        if state.get(key) != value:
            thing[ORIGINAL][key] = value
    is_new = state.get("parent") != thing.parent or "apart" in state
    thing[ORIGINAL].pop("apart", None)
    return is_new


def _is_below_itself(thing):
    """Tells whether an object would be below itself without its bake: its parent was put below it since."""
    above = []
    while thing and thing not in above:
        above.append(thing)
        is_apart = is_baked(thing) and "apart" in thing[ORIGINAL] and not thing.parent
        thing = thing[ORIGINAL].get("parent") if is_apart else thing.parent
    return thing == above[0]


def _new_action(thing, state):
    """Returns the keys of a state that tell of its action, if keys were set since the bake.

    Keys that the bake does not replace are in its copy of the action, and go into the action itself.
    """
    data = _animation_of(thing)
    if not data or not data.action or data.action == state.get("action"):
        return {}
    if not is_ours(data.action):
        return {"animated": True, **_using(data.action, data.action_slot)}
    action, slot = state.get("action"), slot_of(state)
    copy, own = data.action, data.action_slot
    edited = edits_of(copy, own, digests_of(action, slot)) if own else ()
    changed = {key for key in edited if not is_replaced(key.rpartition(" ")[0])}
    if not changed:
        return {}
    if not slot:
        action = bpy.data.actions.new(f"{thing.name_full}Action")
        slot = action.slots.new(id_type="OBJECT", name=thing.name_full)
    elif action.library or _is_shared(thing, action, slot):
        action, handle = action.copy(), slot.handle
        slot = slot_with(action, handle)
    copy_curves(bag_of(action, slot), channelbags(copy, own), changed)
    note_made(copy, own)
    return {"animated": True, **_using(action, slot)}


def _is_shared(thing, action, slot):
    """Tells whether other objects have the same slot of an action, also while these are baked."""
    for other in bpy.data.objects:
        data = other.animation_data
        if other != thing and (data and data.action == action and data.action_slot == slot or is_baked(other)
                               and other[ORIGINAL].get("action") == action
                               and slot_of(other[ORIGINAL].to_dict()) == slot):
            return True
    return False


def keyed_at(thing, frame):
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
    keyed = keyed_at(thing, frame) if thing.rotation_mode == "QUATERNION" else None
    now = np.array([*thing.location, *thing.rotation_quaternion])
    return keyed is not None and np.abs(now - keyed).max() > CHANGED
