"""Coordinates, times and rigid bodies of a scene of Blender.

Blender is z up, Drystone y up: (x, y, z) becomes (x, z, -y), for positions, for axes of rotation and in the
frames of objects alike.
"""

import bpy
import numpy as np
from mathutils import Matrix

from .curves import animates, drivers_of, is_replaced

# Name of the custom property that holds the state of an object before its bake.
ORIGINAL = "drystone"
# Shortest and longest time of a frame that Drystone takes. [s]
SHORTEST, LONGEST = 1e-6, 1.0


def turned(v):
    """Returns a vector of Blender as one of Drystone."""
    return [v[0], v[2], -v[1]]


def unturned(v):
    """Returns a vector of Drystone as one of Blender."""
    return [v[0], -v[2], v[1]]


def pose_of(matrix):
    """Returns position and rotation of a matrix, as Drystone has them."""
    place, rotation, _ = matrix.decompose()
    return turned(place), [*turned([rotation.x, rotation.y, rotation.z]), rotation.w]


def rigid_part(matrix):
    """Returns a matrix without its scale."""
    return Matrix.LocRotScale(*matrix.decompose()[:2], None)


def rigid(thing):
    """Returns the pose of an object, without its scale."""
    return rigid_part(thing.matrix_world)


def stretch(thing, matrix=None):
    """Returns the matrix from an object's mesh to the frame of its body: scale, mirroring and shear.

    With a matrix, that of an instance of the object.
    """
    matrix = thing.matrix_world if matrix is None else matrix
    return rigid_part(matrix).inverted() @ matrix


def is_sound(thing, matrix=None):
    """Tells whether an object, or an instance of it, has a finite place and a size."""
    matrix = np.array(thing.matrix_world if matrix is None else matrix)
    return bool(np.isfinite(matrix).all()) and abs(np.linalg.det(matrix[:3, :3])) > 1e-18


def frames_per_second(scene):
    return scene.render.fps / scene.render.fps_base


def has_keyed_speed(scene):
    """Tells whether the speed of the rigid body world has keys or a driver."""
    return animates(scene, "rigidbody_world.time_scale")


def time_step(scene):
    """Returns the time of a frame: that which it simulates, unless its speed has keys. [s]"""
    speed, rate = world_of(scene).time_scale, frames_per_second(scene)
    if has_keyed_speed(scene):
        return 1 / rate
    if not SHORTEST <= speed / rate <= LONGEST:
        refuse_speed(scene, speed)
    return speed / rate


def refuse_speed(scene, speed):
    """Raises an error on the speed of a rigid body world."""
    rate = frames_per_second(scene)
    raise ValueError(f"Speed of the rigid body world is {speed:.6g}; accepted: from {SHORTEST * rate:.6g} to "
                     f"{LONGEST * rate:.6g} at {rate:.6g} frames per second")


def first_frame(scene):
    """Returns the frame at which the simulation starts: in Blender that of its cache, if it comes later."""
    return max(scene.frame_start, world_of(scene).point_cache.frame_start)


def refuse_stretching(scene):
    """Raises an error where Blender shows animations at other frames than those of the scene."""
    old, new = scene.render.frame_map_old, scene.render.frame_map_new
    if old != new:
        raise ValueError(f"Time Stretching from {old} to {new}: a bake needs the same number twice (Output, Format, "
                         "Frame Rate)")


def show_again(scene):
    """Shows the current time of a scene anew."""
    scene.frame_set(scene.frame_current, subframe=scene.frame_subframe)


def world_of(scene):
    """Returns the rigid body world of a scene."""
    if not scene.rigidbody_world:
        raise ValueError("the scene has no rigid body world: add one in the scene's properties, or a rigid body to "
                         "an object")
    return scene.rigidbody_world


def scene_with(uid):
    """Returns the scene with a session UID: undo replaces scenes, and users rename them."""
    found = next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)
    if found is None:
        raise ValueError("The scene was deleted: the work on it has ended.")
    return found


def uid_of(thing):
    """Returns the session UID of an object, which outlives its name; 0 for none."""
    return thing.session_uid if thing else 0


def _members(scene, key="collection"):
    """Returns the objects in a collection of the rigid body world: of bodies, or of constraints."""
    collection = getattr(scene.rigidbody_world, key, None)
    return list(collection.all_objects) if collection else []


def unlinked(scene):
    """Returns the objects that are in the rigid body world alone: Blender simulates them, and shows none."""
    shown = set(scene.objects)
    members = dict.fromkeys(_members(scene) + _members(scene, "constraints"))
    return [thing for thing in members if thing not in shown]


def _inside(layer):
    """Yields the objects that a layer of collections enables: neither excluded nor disabled in viewports."""
    if layer.collection.hide_viewport:
        return
    if not layer.exclude:
        yield from layer.collection.objects
    for child in layer.children:
        yield from _inside(child)


def enabled(view_layer):
    """Returns the objects that a view layer evaluates, those hidden by the eye included."""
    return list(dict.fromkeys(thing for thing in _inside(view_layer.layer_collection) if not thing.hide_viewport))


def disabled(scene):
    """Returns the bodies and constraints that the view layer evaluates for Blender's own simulation alone."""
    there = set(enabled(bpy.context.view_layer))
    members = dict.fromkeys(_members(scene) + _members(scene, "constraints"))
    return [thing for thing in members if thing not in there]


def objects_of(scene):
    """Returns the objects of a scene by their full names, which differ for linked objects of one name."""
    return {thing.name_full: thing for thing in [*scene.objects, *unlinked(scene)]}


def simulated(scene):
    """Returns the objects that Blender's own simulation takes, by full name."""
    inside = set(_members(scene))
    return {name: thing for name, thing in objects_of(scene).items() if thing.rigid_body and thing in inside}


def is_linked(thing):
    """Tells whether an object comes from another file, so that a saved file loses keys of a bake on it.

    Editable overrides keep keys. But a file does not keep that their drivers and tracks are off.
    """
    override, data = thing.override_library, thing.animation_data
    if not override:
        return bool(thing.library)
    is_driven = any(is_replaced(driver.data_path) for driver in drivers_of(thing))
    return override.is_system_override or is_driven or bool(data and data.nla_tracks)


def compound_of(thing):
    """Returns the object that a thing is a part of, or None."""
    parent = thing.parent
    part = parent and parent.rigid_body and parent.rigid_body.collision_shape == "COMPOUND"
    return parent if part else None


def body_of(thing):
    """Returns the object whose body a thing belongs to: that of the whole compound, if it is part of one."""
    while thing.rigid_body and compound_of(thing):
        thing = compound_of(thing)
    return thing


def parts_of(thing, inside):
    """Returns the parts of a compound, and of the compounds among these, that are in the rigid body world.

    `inside` has the names of all objects that are.
    """
    parts = [part for part in thing.children if part.name_full in inside]
    return [each for part in parts
            for each in (parts_of(part, inside) if part.rigid_body.collision_shape == "COMPOUND" else [part])]


def is_baked(thing):
    """Tells whether an object has a state before its bake. Users may have a property of that name, too."""
    state = thing.get(ORIGINAL)
    return hasattr(state, "keys") and "values" in state.keys()


def has_mass(thing):
    """Tells whether a rigid body has a mass that forces can move; Blender allows any number."""
    return 0 < thing.rigid_body.mass < np.inf


def is_held(thing):
    """Tells whether an active body is not free at this frame: it follows its keys, or is stopped."""
    return thing.rigid_body.kinematic or not thing.rigid_body.enabled


def is_stopped(thing):
    """Tells whether an active body keeps its place at this frame, whatever its keys: it is not Dynamic."""
    of = thing.rigid_body
    return of.type == "ACTIVE" and not of.enabled and not of.kinematic
