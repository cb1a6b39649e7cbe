"""All that moves an object besides the keys of its bake: constraints, drivers, and strips of the NLA editor."""

import json
from dataclasses import dataclass

from .curves import channelbags, copy_curves, digests_of, is_replaced, strips_of

# Mark of the actions of bakes.
OURS = "drystone"
# Property of a copied action of a strip: the action that it stands for during a bake.
STANDS_FOR = "drystone stands for"
# Property of a copied action: by handles of slots, digests of the F-curves at the start of the bake, as JSON.
MADE_WITH = "drystone copied"
# Properties that keys of a bake hide, so that strips may go on with them.
HIDDEN = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle")


def is_ours(action):
    """Tells whether an action is one of a bake. Users may have a property of that name, too."""
    return action.get(OURS) is True


@dataclass
class Switch:
    """A property that turns a constraint, a driver or a track off."""

    kind: str
    name: str
    owner: object
    key: str
    off: bool

    @property
    def is_on(self):
        return getattr(self.owner, self.key) != self.off

    def set(self, is_on):
        if self.is_on != is_on:
            setattr(self.owner, self.key, self.off != is_on)


def _switches(thing):
    """Returns all switches that a bake may turn off."""
    found = [Switch(f"constraint {of.type}", of.name, of, "enabled", False) for of in thing.constraints]
    data = thing.animation_data
    drivers = [driver for driver in data.drivers if is_replaced(driver.data_path)] if data else []
    tracks = data.nla_tracks if data else []
    found += [Switch("driver", f"{of.data_path}[{of.array_index}]", of, "mute", True) for of in drivers]
    found += [Switch("solo", of.name, of, "is_solo", False) for of in tracks]
    found += [Switch("track", of.name, of, "mute", True) for of in tracks]
    return found


def _were_on(switches, notes):
    """Returns for each switch whether it was on by the notes of an earlier bake.

    A note without a switch of its name belongs to a renamed one: the next of its kind without a note.
    """
    left, found = list(notes), [False] * len(switches)
    without = []
    for i, switch in enumerate(switches):
        same = next((note for note in left if note[:2] == [switch.kind, switch.name]), None)
        if same:
            left.remove(same)
            found[i] = same[2]
        else:
            without.append(i)
    for i in without:
        renamed = next((note for note in left if note[0] == switches[i].kind), None)
        if renamed:
            left.remove(renamed)
            found[i] = renamed[2]
    return found


def turn_off(thing, notes):
    """Turns off all that would move an object; returns notes of what was on, given those of an earlier bake.

    Without its solo track, an object would show the others, which are muted in its place.
    """
    switches = _switches(thing)
    were_on, noted = _were_on(switches, notes), []
    solo = [switch.owner for switch in switches if switch.kind == "solo" and switch.is_on]
    for switch, was_on in zip(switches, were_on):
        turns = switch.is_on and (switch.kind != "track" or solo and switch.owner not in solo)
        noted.append([switch.kind, switch.name, bool(turns or was_on and not switch.is_on)])
        if turns:
            switch.set(False)
    return noted


def turn_on(thing, notes):
    """Turns on what a bake has turned off."""
    switches = _switches(thing)
    for switch, was_on in zip(switches, _were_on(switches, notes)):
        if was_on:
            switch.set(True)


def strip_paths(thing):
    """Returns the paths of the keys in active strips of an object, those that a bake leaves out included."""
    found = set()
    for strip in strips_of(thing, only_active=True):
        action, handle = strip.action.get(STANDS_FOR) or strip.action, strip.action_slot.handle
        bags = channelbags(action, slot_with(action, handle))
        found |= {curve.data_path for bag in bags for curve in bag.fcurves}
    return found


def slot_with(action, handle):
    """Returns the slot of an action with a handle, or None."""
    return next((slot for slot in action.slots if slot.handle == handle), None)


def _use(strip, action, handle):
    strip.action = action
    strip.action_slot = slot_with(action, handle)


def _acts_beside(path):
    return is_replaced(path) and path not in HIDDEN


def clean_strips(thing):
    """Gives strips copies of their actions, without the keys that act beside a bake."""
    for strip in strips_of(thing):
        curves = [curve for bag in channelbags(strip.action, strip.action_slot) for curve in bag.fcurves]
        if not any(_acts_beside(curve.data_path) for curve in curves):
            continue
        action, handle = strip.action, strip.action_slot.handle
        copy = action.copy()
        copy[OURS], copy[STANDS_FOR] = True, action
        _use(strip, copy, handle)
        for bag in channelbags(copy, strip.action_slot):
            for curve in [curve for curve in bag.fcurves if _acts_beside(curve.data_path)]:
                bag.fcurves.remove(curve)
        note_made(copy, strip.action_slot)


def restore_strips(thing):
    """Gives strips their own actions again."""
    for strip in strips_of(thing):
        action, handle = strip.action.get(STANDS_FOR), strip.action_slot.handle
        if action:
            _use(strip, _with_edits(strip.action, action, handle), handle)


def note_made(copy, slot):
    """Notes the F-curves that a copy has for a slot. Others were edited since."""
    if MADE_WITH not in copy:
        copy[MADE_WITH] = {}
    copy[MADE_WITH][str(slot.handle)] = json.dumps(digests_of(copy, slot))


def edits_of(copy, slot, unnoted):
    """Returns path and index of the F-curves of a copy that were edited, made or removed since these were noted.

    `unnoted` has the digests that take the place of a note.
    """
    noted, now = copy.get(MADE_WITH, {}).get(str(slot.handle)), digests_of(copy, slot)
    then = unnoted if noted is None else json.loads(noted)
    return {key for key in then.keys() | now.keys() if then.get(key) != now.get(key)}


def _with_edits(copy, action, handle):
    """Returns the own action of a strip with changes that its copy has, as by tweak mode.

    An action of another file cannot change: a local one takes its place.
    """
    slot = slot_with(copy, handle)
    changed = edits_of(copy, slot, digests_of(copy, slot)) if slot else set()
    if not changed or not channelbags(action, slot_with(action, handle)):
        return action
    action = action.copy() if action.library else action
    copy_curves(channelbags(action, slot_with(action, handle))[0], channelbags(copy, slot), changed)
    note_made(copy, slot)
    copy[STANDS_FOR] = action
    return action


class Snapshot:
    """The switches and strips of an object, to be put back after a moment."""

    def __init__(self, thing):
        self._switches = [(switch, switch.is_on) for switch in _switches(thing)]
        self._strips = [(strip, strip.action) for strip in strips_of(thing)]

    def put_back(self):
        for switch, is_on in self._switches:
            switch.set(is_on)
        for strip, action in self._strips:
            if strip.action != action:
                _use(strip, action, strip.action_slot.handle)
