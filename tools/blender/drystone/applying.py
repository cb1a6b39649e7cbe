"""Keys of a bake on the objects of a scene."""

import math

import numpy as np

from . import cache, contacts
from .curves import set_keys
from .exporting import channels_of
from .moves import take_reparented
from .originals import Actions, assign, bag_of, forget, remove_unused_actions, take_edits, take_over
from .owners import MARK, OWNER, mark_of, own_bake
from .overrides import hold, keep_states, take_states
from .recordings import BAKE, read_arrays, require
from .space import (ORIGINAL, first_frame, is_baked, objects_of, refuse_stretching, scene_with, show_again, time_step,
                    uid_of)

# A step after which the window gets its turn.
WAITING = "waiting"
# A bake whose samples are this near to whole frames is not mixed. [frame]
WHOLE = 1e-3


def at_frames(times, poses, step):
    """Returns poses at whole frames, from the first sample to the last: mixed where samples lie between."""
    moments = np.asarray(times, float) / step
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


def read_bake(path):
    """Returns names, times and poses of a bake."""
    arrays = read_arrays(path, *BAKE)
    require(arrays, path, *BAKE)
    names, times, poses = (arrays[name] for name in BAKE)
    if not len(times):
        raise ValueError(f"{path} has no frames")
    if poses.shape[2] != 7:
        raise ValueError(f"{path} is of a scene in the plane; accepted: bakes in 3D")
    return [str(name) for name in names], times, poses


def frames_in(path):
    """Returns the number of samples of a bake."""
    return len(read_arrays(path, "times")["times"])


def _sign_after(past, turn):
    """Returns the sign with which a quaternion is near the one of the last key before it."""
    if any(("rotation_quaternion", i) not in past for i in range(4)):
        return 1.0
    last = np.array([past["rotation_quaternion", i][-1, 1] for i in range(4)])
    return -1.0 if last @ turn < 0 else 1.0


class Keys:
    """Keys of one bake, which may grow.

    `channels` has the channels of the objects that get keys, by name. With a start, the bake begins inside of
    another one, whose keys before it stay.
    """

    def __init__(self, scene, channels, start=None):
        # Undo may replace a scene while a bake runs.
        self.scene_uid = scene.session_uid
        # Users rename objects while a bake runs. So a name is that at the export, and leads to a session UID.
        self._uids = {name: thing.session_uid for name, thing in objects_of(scene).items()}
        self.first = start.frame if start else first_frame(scene)
        # Number of frames of the simulation before the first one of the bake, and keys of these, by name.
        self.offset = self.first - first_frame(scene)
        self.past = start.past if start else {}
        self.channels = channels
        self.actions = Actions()
        # Names of the objects that have keys.
        self.taken = set()
        # Number of frames that all objects have keys of.
        self.frames = 0
        self._things = None

    def refresh(self):
        """Forgets references, which undo replaces."""
        self._things = None
        self.actions.refresh()

    def thing(self, name):
        """Returns the object that had a name at the export, or None if it gets no keys or is gone."""
        return self._thing_with(self._uids.get(name)) if name in self.channels else None

    def _thing_with(self, uid):
        """Returns an object of the scene. A look into Blender's list of objects would take longer."""
        if self._things is None:
            self._things = {thing.session_uid: thing for thing in objects_of(self.scene).values()}
        return self._things.get(uid)

    @property
    def scene(self):
        return scene_with(self.scene_uid)

    def begin(self, kept):
        """Restores objects of earlier bakes that are not part of this one, but for those to be kept."""
        stay = {self._uids.get(name) for name in [*self.channels, *kept]}
        left = [] if self.past else [thing.session_uid for thing in own_bake(self.scene)]
        for uid in left:
            thing = self._thing_with(uid)
            if thing and uid not in stay:
                forget(thing)
                yield

    def write(self, names, frames, poses):
        """Sets keys of the poses of a bake, and yields after each object."""
        for i, name in enumerate(names):
            thing = self.thing(name)
            if thing:
                self._key(name, thing, frames + self.first, *self.channels[name].values(poses[:, i], self.offset))
                yield
        yield from self._show()
        self.frames = len(frames)

    def _key(self, name, thing, frames, places, turns):
        bag, past = bag_of(*self.actions.place_for(thing)), self.past.get(name)
        if past:
            turns = turns * _sign_after(past, turns[0])
        set_keys(bag, "location", frames, places, past)
        set_keys(bag, "rotation_quaternion", frames, turns, past)
        if thing.override_library:
            hold(bag, self.first)
        if name not in self.taken:
            if not past:
                self._note_first(thing, int(frames[0]), [*places[0], *turns[0]])
            thing[ORIGINAL]["name"], thing[ORIGINAL][OWNER] = name, mark_of(self.scene)
            self.taken.add(name)

    def _note_first(self, thing, frame, channels):
        # Rounded to 32 bits like keys, so that a difference is a move by hand.
        thing[ORIGINAL]["first"] = np.float32(channels).tolist()
        thing[ORIGINAL]["frame"] = frame

    def _show(self):
        """Makes all objects show their keys, all at once: Blender rebuilds its graph after each change."""
        if not self.frames:
            yield WAITING
        things = {name: self.thing(name) for name in self.taken}
        new = [name for name, thing in things.items() if thing and assign(thing, *self.actions.place_for(thing))]
        if new:
            yield WAITING
        for name in new:
            thing = self.thing(name)
            # Else it was deleted, or undo has taken its keys.
            if thing and is_baked(thing) and self.actions.is_shown(thing):
                take_over(thing, self.channels[name])

    def are_lost(self):
        """Tells whether undo has taken keys of the bake from objects."""
        things = filter(None, map(self.thing, self.taken))
        return any(not self.actions.is_shown(thing) for thing in things)

    def missing(self):
        """Returns the names of objects that are gone since the export."""
        return [name for name in self.channels if not self.thing(name)]

    def reparented(self):
        """Returns the names of objects whose keys are below a parent that they have no longer."""
        things = {name: self.thing(name) for name in self.taken}
        return [name for name, thing in things.items() if thing and not self.channels[name].is_apart
                and uid_of(thing.parent) != self.channels[name].parent_uid]

    def end(self, last):
        """Shows the bake from the first frame, in a scene that ends no earlier than it."""
        self.actions.end()
        scene = self.scene
        scene.frame_end = max(scene.frame_end, self.first + int(last))
        keep_states(scene)
        show_again(scene)


def apply(context, path):
    """Puts a bake on the objects that have the names of its bodies; returns how many, and who is missing."""
    names, times, poses = read_bake(path)
    scene = context.scene
    refuse_stretching(scene)
    frames, poses = at_frames(times, poses, time_step(scene))
    take_edits(scene)
    take_reparented(scene)
    channels = channels_of(scene)
    keys = Keys(scene, {name: channels[name] for name in names if name in channels})
    for _ in keys.write(names, frames, poses):
        pass
    if keys.taken:
        cache.remember(scene, path)
        scene.frame_end = keys.first + int(frames[-1])
        keys.end(0)
        scene.frame_set(scene.frame_start)
    there = objects_of(scene)
    return len(keys.taken), [name for name in names if name not in there]


def delete_bake(scene):
    """Restores all objects of the bake of a scene to their state before it; returns how many."""
    contacts.clear(scene)
    cache.forget(scene)
    take_states(scene)
    take_edits(scene)
    take_reparented(scene)
    things = own_bake(scene)
    for thing in things:
        forget(thing)
    scene.pop(MARK, None)
    keep_states(scene)
    remove_unused_actions()
    show_again(scene)
    return len(things)
