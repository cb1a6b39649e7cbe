"""Objects of library overrides: a file keeps their keys, but no custom properties and nothing of their rigid body.

So their scene keeps their states, and a key of their bake holds them Animated.
"""

import bpy
import numpy as np

from .curves import set_keys
from .owners import own_bake
from .space import ORIGINAL, is_baked

# Custom property of a scene: the overridden objects of its bake with their states.
STATES = "drystone_overrides"
HELD = "rigid_body.kinematic"


def hold(bag, frame):
    """Adds a key that holds an object Animated to those of its bake."""
    set_keys(bag, HELD, np.array([frame]), np.ones((1, 1)))


def keep_states(scene):
    """Notes the states of the overridden objects of the bake of a scene in the scene."""
    states = [{"thing": thing, "state": thing[ORIGINAL].to_dict()} for thing in own_bake(scene)
              if thing.override_library]
    if states:
        scene[STATES] = states
    else:
        scene.pop(STATES, None)


def take_states(scene):
    """Gives overridden objects of the bake of a scene the states that a file does not keep."""
    for note in scene.get(STATES, ()):
        thing = note.get("thing")
        if thing and not is_baked(thing):
            thing[ORIGINAL] = note["state"].to_dict()
            if thing.rigid_body:
                thing.rigid_body.kinematic = True


def keep_all():
    """Notes the states of all scenes, before a file is saved."""
    for scene in bpy.data.scenes:
        if not scene.library:
            keep_states(scene)


def take_all():
    """Takes the states of all scenes, once a file is open."""
    for scene in bpy.data.scenes:
        if not scene.library:
            take_states(scene)
