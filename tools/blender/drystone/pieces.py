"""Convex pieces of the meshes of active objects: shown over them, and used by bakes until the mesh changes."""

import hashlib
import json

import bpy
import numpy as np

from .space import stretch, turned, unturned

COLLECTION = "Drystone Pieces"
# Custom property of the object that shows pieces: the hash of the mesh that they are of.
MESH_HASH = "drystone_mesh"
# Attribute of its vertices: the number of their piece.
PIECE = "piece"
# Operator that makes and renews pieces.
OPERATOR = "drystone.pieces"
# Finding on pieces of a mesh that has changed since.
STALE = " with pieces of an older mesh: cut anew for the bake. Renew shows these pieces"


def hash_of(points, triangles):
    """Returns the hash of a mesh, in the frame of its object."""
    return hashlib.sha1(np.float32(points).tobytes() + np.int32(triangles).tobytes()).hexdigest()


def overlay_of(thing):
    """Returns the object that shows the pieces of another one, or None."""
    return next((child for child in thing.children if MESH_HASH in child and child.type == "MESH"), None)


def points_of(mesh):
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(float)


def shown_pieces(thing):
    """Returns the hash of the mesh of the shown pieces, and their points in the frame of the object."""
    overlay = overlay_of(thing)
    attribute = overlay.data.attributes.get(PIECE) if overlay else None
    if attribute is None or attribute.domain != "POINT" or not len(overlay.data.vertices):
        return "", []
    numbers = np.empty(len(overlay.data.vertices), np.int32)
    attribute.data.foreach_get("value", numbers)
    matrix = np.array(overlay.matrix_parent_inverse @ overlay.matrix_basis)
    points = points_of(overlay.data) @ matrix[:3, :3].T + matrix[:3, 3]
    return overlay[MESH_HASH], [points[numbers == number] for number in np.unique(numbers)]


def scene_of(meshes):
    """Returns a scene of Drystone with meshes by name, each in the frame of its body."""
    return {"bodies": [
        {"name": name, "shapes": [{"type": "trimesh", "vertices": [turned(p) for p in points],
                                   "triangles": triangles.tolist()}]}
        for name, (points, triangles) in meshes.items()]}


def _collection(scene):
    collection = bpy.data.collections.get(COLLECTION) or bpy.data.collections.new(COLLECTION)
    if collection.name not in scene.collection.children:
        scene.collection.children.link(collection)
    collection.hide_render = True
    return collection


def _mesh(name, thing, pieces):
    """Returns a mesh of all pieces, in the frame of an object."""
    below = np.array(stretch(thing).to_3x3().inverted())
    points, faces, numbers = [], [], []
    for number, piece in enumerate(pieces):
        faces += [[len(points) + corner for corner in face] for face in piece["triangles"]]
        points += [below @ unturned(p) for p in piece["points"]]
        numbers += [number] * len(piece["points"])
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    mesh.attributes.new(PIECE, "INT", "POINT").data.foreach_set("value", np.int32(numbers))
    return mesh


def show(scene, thing, digest, pieces):
    """Shows pieces over an object, in place of those before."""
    overlay, name = overlay_of(thing), f"{thing.name} pieces"
    mesh = _mesh(name, thing, pieces)
    if overlay:
        old, overlay.data = overlay.data, mesh
        if not old.users:
            bpy.data.meshes.remove(old)
    else:
        overlay = bpy.data.objects.new(name, mesh)
        _collection(scene).objects.link(overlay)
        overlay.parent = thing
    overlay.matrix_parent_inverse.identity()
    overlay.matrix_basis.identity()
    overlay.display_type, overlay.show_in_front = "WIRE", True
    overlay.hide_select = overlay.hide_render = True
    overlay[MESH_HASH] = digest


def read(path):
    """Returns the meshes of a file of pieces, by the name of their body."""
    return {mesh["body"]: mesh for mesh in json.loads(path.read_text())["meshes"]}
