"""Contacts of a bake: a mesh of points, of which Geometry Nodes show those of the current frame."""

import bpy
import numpy as np

from .owners import Owners, mark_of
from .recordings import read_arrays, require, write_arrays

NAME = "Drystone Contacts"
# Property of the object with the mark of its bake, and of its nodes with their number, which users change.
MARK = "drystone_contacts"
# Custom property with the names of the bodies, of which `body_a` and `body_b` are the indices.
BODIES = "bodies"
# Attributes of the points, with their types.
ATTRIBUTES = {"frame": "INT", "impulse": "FLOAT", "speed": "FLOAT", "body_a": "INT", "body_b": "INT",
              "normal": "FLOAT_VECTOR"}
ARRAYS = ("offsets", "positions", "normals", "impulses", "speeds", "bodies", "times")


def read(path, names):
    """Returns the arrays of a file of contacts of a bake whose bodies have these names."""
    found = read_arrays(path, *ARRAYS, "names")
    require(found, path, *(name for name in ARRAYS if name != "speeds"))
    found.setdefault("names", np.array(names, str))
    found.setdefault("speeds", np.zeros(len(found["positions"])))
    return found


def followed_by(first, later, count):
    """Returns the contacts of the first frames of a bake, and those of another one that goes on from them.

    The initial state of the later one has none.
    """
    end = int(first["offsets"][min(count + 1, len(first["offsets"]) - 1)])
    begin = int(later["offsets"][1])
    # Bodies by the indices of the later bake; those that it does not have come after these.
    names = [str(name) for name in later["names"]]
    names += [str(name) for name in first["names"] if str(name) not in names]
    places = np.array([names.index(str(name)) for name in first["names"]], int)
    bodies = first["bodies"][:end]
    moved = np.where(bodies < 0, bodies, places[np.maximum(bodies, 0)]) if len(places) else bodies
    offsets = np.concatenate([first["offsets"][:count + 2], later["offsets"][2:] - begin + end])
    step = later["times"][1] - later["times"][0]
    return {"names": np.array(names), "offsets": offsets, "times": np.arange(len(offsets) - 1) * step,
            "bodies": np.concatenate([moved, later["bodies"][begin:]]),
            **{key: np.concatenate([first[key][:end], later[key][begin:]])
               for key in ("positions", "normals", "impulses", "speeds")}}


def write(path, contacts):
    write_arrays(path, contacts)


def found(scene):
    """Returns the object with contacts of the bake of a scene, wherever it is by now, or None."""
    owners = Owners()
    things = [thing for thing in bpy.data.objects if MARK in thing and not thing.library]
    things.sort(key=lambda thing: not owners.shows(scene, thing))
    return next((thing for thing in things if owners.has_contacts(scene, thing, thing[MARK])), None)


def show(scene, contacts, first, step):
    """Makes the object with contacts, or renews its points; `first` is the frame of the time 0."""
    thing = _object(scene)
    thing[MARK] = mark_of(scene)
    mesh, count = thing.data, len(contacts["positions"])
    # The mesh stays, with its materials.
    mesh.clear_geometry()
    mesh.vertices.add(count)
    mesh.vertices.foreach_set("co", _turned(contacts["positions"]))
    frames = first + np.round(np.asarray(contacts["times"], float) / step).astype(int)
    values = {
        "frame": np.repeat(frames, np.diff(contacts["offsets"])).astype(np.int32),
        "impulse": np.float32(contacts["impulses"]),
        "speed": np.float32(contacts["speeds"]),
        "body_a": np.int32(contacts["bodies"][:, 0]),
        "body_b": np.int32(contacts["bodies"][:, 1]),
        "normal": _turned(contacts["normals"]),
    }
    for name, kind in ATTRIBUTES.items():
        attribute = mesh.attributes.new(name, kind, "POINT")
        attribute.data.foreach_set("vector" if kind == "FLOAT_VECTOR" else "value", values[name])
    mesh.update()
    thing[BODIES] = [str(name) for name in contacts["names"]]
    return thing


def clear(scene):
    """Removes the object with contacts, or its points if the user has added anything to it."""
    thing = found(scene)
    if thing and _has_work(thing):
        thing.data.clear_geometry()
    elif thing:
        mesh = thing.data
        bpy.data.objects.remove(thing)
        if not mesh.users:
            bpy.data.meshes.remove(mesh)
    for nodes in [of for of in bpy.data.node_groups if _are_made(of) and not of.users and not of.library]:
        bpy.data.node_groups.remove(nodes)


def _has_work(thing):
    """Tells whether the user has added anything to the object, or has changed its nodes."""
    nodes = [of.node_group if of.type == "NODES" else None for of in thing.modifiers]
    return bool(thing.material_slots or thing.children or thing.constraints or thing.animation_data
                or not all(map(_are_made, nodes)))


def _are_made(nodes):
    """Tells whether nodes are those that were made with the object, and none was added or removed."""
    return nodes is not None and nodes.get(MARK) == len(nodes.nodes)


def _turned(vectors):
    """Returns vectors of Drystone as numbers of Blender, in one row."""
    vectors = np.asarray(vectors, np.float32).reshape(-1, 3)
    return np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], axis=1).ravel()


def _object(scene):
    thing = found(scene)
    if not thing:
        thing = bpy.data.objects.new(NAME, bpy.data.meshes.new(NAME))
        scene.collection.objects.link(thing)
        thing.modifiers.new("Current Frame", "NODES").node_group = _nodes()
    return thing


def _nodes():
    """Returns nodes that leave the points whose attribute `frame` is the current frame."""
    tree = bpy.data.node_groups.new("Drystone Current Frame", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeInputSceneTime", "GeometryNodeInputNamedAttribute",
             "ShaderNodeMath", "FunctionNodeCompare", "GeometryNodeDeleteGeometry")
    begin, end, now, own, floor, differs, delete = (tree.nodes.new(kind) for kind in kinds)
    for i, node in enumerate((begin, now, own, floor, differs, delete, end)):
        node.location = (180 * i, 0)
    own.data_type, floor.operation = "INT", "FLOOR"
    own.inputs["Name"].default_value = "frame"
    differs.data_type, differs.operation = "INT", "NOT_EQUAL"
    delete.domain = "POINT"
    sockets = {socket.identifier: socket for socket in differs.inputs}
    links = [(now.outputs["Frame"], floor.inputs[0]), (floor.outputs[0], sockets["A_INT"]),
             (own.outputs["Attribute"], sockets["B_INT"]), (differs.outputs["Result"], delete.inputs["Selection"]),
             (begin.outputs[0], delete.inputs["Geometry"]), (delete.outputs[0], end.inputs[0])]
    for link in links:
        tree.links.new(*link)
    tree[MARK] = len(tree.nodes)
    return tree
