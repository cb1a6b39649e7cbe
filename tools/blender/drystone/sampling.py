"""Poses of a scene frame by frame, without Blender's own simulation."""

from contextlib import ExitStack, contextmanager

import bpy
import numpy as np
from mathutils import Euler, Vector

from . import originals
from .curves import HOLDS, animates, curves_of, drivers_of
from .members import without_objects
from .space import disabled, first_frame, has_mass, is_baked, is_held, is_stopped, rigid_part, world_of

# Largest change of a pose that is none. [m, or 1]
STILL = 1e-6
# Largest relative change of a squared size that is none. [1]
SAME_SIZE = 1e-4
# Objects that should not move are looked at between so many parts of a scene.
PARTS = 8
# Most evaluations of a scene until its objects have settled.
PASSES = 5
# Distance and turn of displaced objects. [m], [rad]
AWAY, TURN = (1.0, 1.1, 1.2), (0.5, 0.6, 0.7)
# Largest change of the frame of an object that does not follow these. [m, or 1]
UNMOVED = 1e-4


def may_be_moved(thing):
    """Tells whether keys, drivers or constraints may move an object: its own, or those of objects above it."""
    while thing:
        if thing.animation_data or thing.constraints:
            return True
        thing = thing.parent
    return False


def has_reason(thing):
    """Tells whether anything but its own channels may place an object."""
    return bool(thing.parent or thing.constraints or thing.animation_data)


def may_move(thing, kept=frozenset()):
    """Tells whether a bake that keeps these objects as they are may move an object: it is active and free."""
    if thing.rigid_body.type != "ACTIVE" or thing.name_full in kept or not has_mass(thing):
        return False
    # One that was baked in another file follows the keys of that bake.
    return is_baked(thing) and not thing.library or not is_held(thing) or animates(thing, *HOLDS)


@contextmanager
def with_values(owners, key, value):
    """Sets a property of several owners for a while."""
    before = [(owner, getattr(owner, key)) for owner in owners]
    try:
        for owner, _ in before:
            setattr(owner, key, value)
        yield
    finally:
        for owner, old in before:
            setattr(owner, key, old)


def reorder(scene):
    """Makes Blender find its order anew, which another collection of the world does not."""
    scene.camera = scene.camera


@contextmanager
def in_order(scene):
    """Evaluates parents before their children, also between rigid bodies.

    Blender's order has cycles between these, and a body below another one may be a frame late. A world
    without objects has no part in the order. Objects that are evaluated for the world alone, as they are
    excluded or disabled, are enabled meanwhile.
    """
    with ExitStack() as stack:
        things = disabled(scene)
        stack.callback(reorder, scene)
        # Before objects are linked: the world may have the scene's own collection.
        stack.enter_context(without_objects(world_of(scene)))
        for thing in set(things) - set(scene.collection.objects):
            scene.collection.objects.link(thing)
            stack.callback(scene.collection.objects.unlink, thing)
        keys = [of for thing in things for of in curves_of(thing) + drivers_of(thing)
                if of.data_path == "hide_viewport"]
        stack.enter_context(with_values(keys, "mute", True))
        stack.enter_context(with_values(things, "hide_viewport", False))
        reorder(scene)
        # Blender evaluates no object again for a new order alone.
        for thing in scene.objects:
            thing.update_tag(refresh={"OBJECT"})
        yield


@contextmanager
def still(scene, kept=frozenset()):
    """Shows a scene at its first frame, without Blender's own simulation and without bakes but those of some."""
    frame, subframe = scene.frame_current, scene.frame_subframe
    world = world_of(scene)
    try:
        with with_values([world], "enabled", False), originals.shown(scene, kept):
            scene.frame_set(first_frame(scene))
            with in_order(scene):
                scene.frame_set(first_frame(scene))
                yield
    finally:
        scene.frame_set(frame, subframe=subframe)


def _placed_elsewhere(thing):
    """Returns values that show an object elsewhere: of its deltas, and of its own channels, which drivers may read.

    Own channels are those that a bake keys, and those that act before it.
    """
    turn, angle, mode = Euler(TURN).to_quaternion(), thing.rotation_axis_angle, thing.rotation_mode
    values = {"rotation_axis_angle": [angle[0] + TURN[0], *angle[1:]]} if mode == "AXIS_ANGLE" else {}
    for own in ("", "delta_"):
        values |= {f"{own}location": getattr(thing, f"{own}location") + Vector(AWAY),
                   f"{own}rotation_quaternion": turn @ getattr(thing, f"{own}rotation_quaternion")}
        if own or mode not in ("QUATERNION", "AXIS_ANGLE"):
            angles = getattr(thing, f"{own}rotation_euler")
            values[f"{own}rotation_euler"] = [angle + more for angle, more in zip(angles, TURN)]
    return values


def _set_values(thing, values):
    for key, value in values.items():
        setattr(thing, key, value)


@contextmanager
def displaced(things):
    """Shows objects elsewhere for a while."""
    elsewhere = [(thing, _placed_elsewhere(thing)) for thing in things]
    before = [(thing, {key: list(getattr(thing, key)) for key in values}) for thing, values in elsewhere]
    try:
        for thing, values in elsewhere:
            _set_values(thing, values)
        bpy.context.view_layer.update()
        yield
    finally:
        for thing, values in before:
            _set_values(thing, values)


def followers(movers, things):
    """Returns the names of the things that follow movers, by whatever parents, constraints or drivers.

    The movers are displaced, and Blender shows who comes along. A mover follows others if the frame does that
    its channels are in.
    """
    things, moving = [thing for thing in things if has_reason(thing)], set(movers)

    def frames():
        return {thing.name_full: np.array(thing.matrix_world @ thing.matrix_basis.inverted_safe()
                                          if thing in moving else thing.matrix_world) for thing in things}

    return moved_by(movers, frames) if things else set()


def settle():
    """Evaluates all objects until none moves any more.

    Blender's order has cycles, as between bodies and winds below them, and breaks these by chance. So an update
    alone leaves some objects where they were.
    """
    things, before = list(bpy.context.scene.objects), None
    for _ in range(PASSES):
        for thing in things:
            thing.update_tag(refresh={"OBJECT"})
        bpy.context.view_layer.update()
        now = [thing.matrix_world.copy() for thing in things]
        if now == before:
            return
        before = now


def moved_by(movers, look):
    """Returns the names of arrays that change with the places of movers; `look` returns arrays by name."""
    if not movers:
        return set()
    with with_values([of for thing in movers for of in thing.constraints], "enabled", False):
        settle()
        before = look()
        with displaced(movers):
            settle()
            after = look()
    settle()
    return {name for name in before.keys() | after.keys() if _differ(before.get(name), after.get(name))}


def _differ(one, other):
    """Tells whether two arrays differ, or are not alike."""
    if one is None or other is None or one.shape != other.shape:
        return True
    return one.size > 0 and bool(np.abs(other - one).max() > UNMOVED * (1 + np.abs(one).max()))


def refers(thing):
    """Tells whether vertices of an object may follow other objects: by modifiers, drivers or parents."""
    data, keys = thing.data, getattr(thing.data, "shape_keys", None)
    drivers = [of for owner in (thing, data, keys) if owner and owner.animation_data
               for of in owner.animation_data.drivers]
    outside = any(isinstance(getattr(of, key), bpy.types.ID) for of in thing.modifiers
                  for key in of.bl_rna.properties.keys())
    return bool(drivers) or outside or thing.type != "MESH" or thing.parent_type in ("ARMATURE", "LATTICE")


class Sampling:
    """Poses at the frames of a scene that is shown still.

    `watched` has the objects that may follow keys at some frames; `below` has the active objects with a
    parent that follows no body. `suspects` should keep their places; a few frames show whether they do. `looks`
    are called at each frame. `movers` has the names of the bodies that the bake moves, `following` those of
    objects that follow these.
    """

    def __init__(self, scene, watched, below, suspects=(), looks=(), movers=frozenset(), following=frozenset()):
        self.scene = scene
        self.movers, self.following = movers, following
        # Matrices of objects, from the first frame until they are free, by name.
        self.tracks = {thing.name_full: [] for thing in [*watched, *suspects]}
        # Names of watched objects that are free at some frame, and of those that are held again later.
        self.freed, self.held_again = set(), set()
        # True for objects that are stopped, and for those that are Dynamic, at the frames of their tracks.
        self._stops, self._dynamic = ({name: [] for name in self.tracks} for _ in range(2))
        # Frames that the channels of objects are in.
        self.above = {thing.name_full: [] for thing in below}
        if self.tracks or below or looks:
            constraints = [of for thing in below for of in thing.constraints]
            first = first_frame(scene)
            frames = range(first, max(first, scene.frame_end) + 1)
            if not (watched or below or looks or any(map(may_be_moved, suspects))):
                frames = sorted({frames[round(part * (len(frames) - 1) / PARTS)] for part in range(PARTS + 1)})
            with with_values(constraints, "enabled", False):
                self._pass(frames, [*watched, *suspects], below, looks)

    def is_released(self, name):
        """Tells whether an object follows its keys at first, and is free later."""
        return name in self.freed and bool(self.tracks[name])

    def is_stopped_at_release(self, name):
        """Tells whether an object is stopped at the frame before its release."""
        return self.is_released(name) and self._stops[name][-1]

    def is_stopped_in_flight(self, name):
        """Tells whether an object is stopped before its release, after it moved by keys."""
        stops, track = self._stops.get(name), self.tracks.get(name)
        if not self.is_released(name) or not stops[-1] or all(stops):
            return False
        last = max(i for i, is_stop in enumerate(stops) if not is_stop)
        return last > 0 and track[last] != track[last - 1]

    def is_dynamic_early(self, name):
        """Tells whether an object that is released later becomes Dynamic while it still follows its keys."""
        stops, dynamic = self._stops.get(name), self._dynamic.get(name)
        if not self.is_released(name):
            return False
        follows = [not (one or other) for one, other in zip(stops, stops[1:])]
        return any(now and not before and of for before, now, of in zip(dynamic, dynamic[1:], follows))

    def is_moved(self, name):
        """Tells whether an object moves while it follows its keys."""
        matrices = self.tracks.get(name, [])
        return any(matrix != matrices[0] for matrix in matrices)

    def is_moved_rigidly(self, name):
        """Tells whether an object moves or turns while it follows its keys, and not merely grows."""
        poses = self._poses(name)
        return bool((np.abs(poses - poses[:1]) > STILL).any())

    def is_turned(self, name):
        """Tells whether an object turns while it follows its keys."""
        turns = self._poses(name)[:, :3, :3]
        return bool((np.abs(turns - turns[:1]) > STILL).any())

    def is_resized(self, name):
        """Tells whether an object changes its size or its shear while it follows its keys."""
        axes = np.array(self.tracks.get(name, [])).reshape(-1, 4, 4)[:, :3, :3]
        squares = axes.transpose(0, 2, 1) @ axes
        return bool((np.abs(squares - squares[:1]) > SAME_SIZE * np.abs(squares[:1]).max(initial=0)).any())

    def _poses(self, name):
        """Returns the matrices of an object without their scale."""
        return np.array([rigid_part(matrix) for matrix in self.tracks.get(name, [])]).reshape(-1, 4, 4)

    def _pass(self, frames, watched, below, looks):
        scene = self.scene
        for frame in frames:
            scene.frame_set(frame)
            for thing in watched:
                self._watch(thing)
            for thing in below:
                above = thing.matrix_world @ thing.matrix_basis.inverted_safe()
                self.above[thing.name_full].append(np.array(above))
            for look in looks:
                look()
        scene.frame_set(first_frame(scene))

    def _watch(self, thing):
        name, of = thing.name_full, thing.rigid_body
        is_active = of and of.type == "ACTIVE"
        if is_active and not is_held(thing):
            self.freed.add(name)
        elif name in self.freed:
            self.held_again.add(name)
        else:
            track, stops = self.tracks[name], bool(is_active and is_stopped(thing))
            track.append(track[-1] if stops and track else thing.matrix_world.copy())
            self._stops[name].append(stops)
            self._dynamic[name].append(bool(of and of.enabled))
