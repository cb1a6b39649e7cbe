"""Poses of a scene frame by frame, without Blender's own simulation."""

from contextlib import contextmanager

import numpy as np

from . import originals
from .curves import HOLDS, animates
from .space import is_baked, is_held, rigid_part

# Largest change of a pose that is none. [m, or 1]
STILL = 1e-6


def may_be_moved(thing):
    """Tells whether keys, drivers or constraints may move an object: its own, or those of objects above it."""
    while thing:
        if thing.animation_data or thing.constraints:
            return True
        thing = thing.parent
    return False


def may_move(thing, kept=frozenset()):
    """Tells whether a bake that keeps these objects as they are may move an object: it is active and free."""
    if thing.rigid_body.type != "ACTIVE" or thing.name in kept:
        return False
    return is_baked(thing) or not is_held(thing) or animates(thing, *HOLDS)


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


@contextmanager
def in_order(scene):
    """Evaluates parents before their children, also between rigid bodies.

    Blender's order has cycles between these, and a body below another one may be a frame late. A world
    without objects has no part in the order.
    """
    with with_values([scene.rigidbody_world], "collection", None):
        # Blender evaluates no object again for a new order alone.
        for thing in scene.objects:
            thing.update_tag(refresh={"OBJECT"})
        yield


@contextmanager
def still(scene, kept=frozenset()):
    """Shows a scene at its first frame, without Blender's own simulation and without bakes but those of some."""
    frame, subframe = scene.frame_current, scene.frame_subframe
    world = scene.rigidbody_world
    try:
        with with_values([world], "enabled", False), originals.shown(scene, kept):
            scene.frame_set(scene.frame_start)
            with in_order(scene):
                scene.frame_set(scene.frame_start)
                yield
    finally:
        scene.frame_set(frame, subframe=subframe)


class Sampling:
    """Poses at all frames of a scene that is shown still.

    `watched` has the objects that may follow keys at some frames; `below` has the active objects with a
    parent that is no body. `looks` are called at each frame.
    """

    def __init__(self, scene, watched, below, looks=()):
        self.scene = scene
        # Matrices of watched objects, from the first frame until they are free, by name.
        self.tracks = {thing.name: [] for thing in watched}
        # Names of watched objects that are free at some frame, and of those that are held again later.
        self.freed, self.held_again = set(), set()
        # Frames that the channels of objects are in.
        self.above = {thing.name: [] for thing in below}
        if watched or below or looks:
            constraints = [of for thing in below for of in thing.constraints]
            with with_values(constraints, "enabled", False):
                self._pass(watched, below, looks)

    def is_released(self, name):
        """Tells whether an object follows its keys at first, and is free later."""
        return name in self.freed and bool(self.tracks[name])

    def is_moved(self, name):
        """Tells whether an object moves while it follows its keys."""
        matrices = self.tracks.get(name, [])
        return any(matrix != matrices[0] for matrix in matrices)

    def is_moved_rigidly(self, name):
        """Tells whether an object moves or turns while it follows its keys, and not merely grows."""
        poses = np.array([rigid_part(matrix) for matrix in self.tracks.get(name, [])])
        return len(poses) > 0 and bool(np.abs(poses - poses[0]).max() > STILL)

    def _pass(self, watched, below, looks):
        scene = self.scene
        for frame in range(scene.frame_start, scene.frame_end + 1):
            scene.frame_set(frame)
            for thing in watched:
                self._watch(thing)
            for thing in below:
                above = thing.matrix_world @ thing.matrix_basis.inverted_safe()
                self.above[thing.name].append(np.array(above))
            for look in looks:
                look()
        scene.frame_set(scene.frame_start)

    def _watch(self, thing):
        name = thing.name
        if thing.rigid_body.type == "ACTIVE" and not is_held(thing):
            self.freed.add(name)
        elif name in self.freed:
            self.held_again.add(name)
        else:
            self.tracks[name].append(thing.matrix_world.copy())
