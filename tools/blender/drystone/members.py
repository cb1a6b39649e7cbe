"""A rigid body world whose objects are taken out for a while."""

from contextlib import contextmanager

import bpy

# Name of a scene, a collection and an object that exist for a moment.
SCRATCH = "Drystone Scratch"


@contextmanager
def without_objects(world):
    """Takes all objects out of a rigid body world for a while.

    A world that gets its collection back gives a rigid body to every mesh in it. Meshes that had none lose it again.
    """
    collection = world.collection
    things = collection.all_objects if collection else []
    bare = [thing for thing in things if thing.type == "MESH" and not thing.rigid_body]
    world.collection = None
    try:
        yield
    finally:
        if bare:
            _give_back(world, collection, bare)
        else:
            world.collection = collection


def _give_back(world, collection, bare):
    """Gives a world its collection, of which some objects have no rigid body.

    The operator needs a body as the active object. A scene without a world keeps collections and constraints of
    the others.
    """
    scene, scratch = bpy.data.scenes.new(SCRATCH), bpy.data.collections.new(SCRATCH)
    mesh = bpy.data.meshes.new(SCRATCH)
    body = bpy.data.objects.new(SCRATCH, mesh)
    scratch.objects.link(body)
    world.collection = scratch
    world.collection = collection
    with bpy.context.temp_override(scene=scene, object=body, active_object=body, selected_objects=bare,
                                   selected_editable_objects=bare):
        bpy.ops.rigidbody.objects_remove()
    bpy.data.objects.remove(body)
    bpy.data.meshes.remove(mesh)
    bpy.data.collections.remove(scratch)
    bpy.data.scenes.remove(scene)
