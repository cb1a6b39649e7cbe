"""Coordinates, times and rigid bodies of a scene of Blender.

Blender is z up, Drystone y up: (x, y, z) becomes (x, z, -y), for positions, for axes of rotation and in the
frames of objects alike.
"""

import numpy as np
from mathutils import Matrix

# Name of the custom property that holds the state of an object before its bake.
ORIGINAL = "drystone"


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


def time_step(scene):
    """Returns the simulated time of a frame. [s]"""
    world = scene.rigidbody_world
    return (world.time_scale if world else 1) / frames_per_second(scene)


def simulated(scene):
    """Returns the objects that Blender's own simulation takes, by name."""
    world = scene.rigidbody_world
    inside = set(world.collection.all_objects) if world and world.collection else set()
    return {thing.name: thing for thing in scene.objects if thing.rigid_body and thing in inside}


def compound_of(thing):
    """Returns the object that a thing is a part of, or None."""
    parent = thing.parent
    part = parent and parent.rigid_body and parent.rigid_body.collision_shape == "COMPOUND"
    return parent if part else None


def is_baked(thing):
    return ORIGINAL in thing


def is_held(thing):
    """Tells whether an active body follows its keys at this frame."""
    return thing.rigid_body.kinematic or not thing.rigid_body.enabled
