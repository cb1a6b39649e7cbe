"""Instances of passive objects, of collections or of Geometry Nodes: each is a body that stays still."""

from dataclasses import dataclass

from mathutils import Matrix

from .findings import CHANGED, LEFT_OUT
from .sampling import may_be_moved
from .space import body_of, is_sound

ACTIVE = " of active objects: left out. Object > Apply > Make Instances Real"
MESHES = " with instances of meshes by Geometry Nodes: only its own mesh collides, unless realized"
COLLIDING = " of passive objects: these collide, in Blender they do not"
MOVING = " of passive objects that may move: still, as at the first frame"
SIZELESS = " without a size or a place: left out"


@dataclass
class Instance:
    """A passive object, shown at a place by another object."""

    name: str
    thing: object
    matrix: Matrix
    # The object that shows it.
    above: object


def unique(name, names):
    """Returns a name that no body has, and notes it."""
    number, free = 1, name
    while free in names:
        number += 1
        free = f"{name} {number}"
    names.add(free)
    return free


def instances_of(depsgraph, names, findings):
    """Returns the instances of passive objects that a scene shows; `names` has those of all bodies."""
    names, found = set(names), []
    for each in depsgraph.object_instances:
        if not each.is_instance or not each.instance_object or not each.parent:
            continue
        above, thing, matrix = each.parent.original, each.instance_object.original, each.matrix_world.copy()
        if thing == above:
            if thing.rigid_body:
                findings.add(LEFT_OUT, "object", MESHES, above.name_full)
            continue
        # The parts of a compound are instances as well, and have its type.
        if not thing.rigid_body or thing.rigid_body.collision_shape == "COMPOUND":
            continue
        if body_of(thing).rigid_body.type == "ACTIVE":
            findings.add(LEFT_OUT, "instancer", ACTIVE, above.name_full)
            continue
        name = unique(f"{above.name_full}: {thing.name_full}", names)
        if not is_sound(thing, matrix):
            findings.add(LEFT_OUT, "instance", SIZELESS, name)
            continue
        if may_be_moved(above) or may_be_moved(thing):
            findings.add(CHANGED, "instancer", MOVING, above.name_full)
        found.append(Instance(name, thing, matrix, above))
    return found
