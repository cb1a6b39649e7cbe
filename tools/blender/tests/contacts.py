"""Tests of contacts as points: of hand-made files, and through a bake."""

import os
import time

import bpy
import numpy as np
from drystone import applying, baking, contacts

from .common import DOWN, block, full_bake, stage


def shown(thing):
    """Positions and attributes of the points that are shown at the current frame."""
    mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    values = {"position": np.array([tuple(vertex.co) for vertex in mesh.vertices]).reshape(-1, 3)}
    for name, kind in contacts.ATTRIBUTES.items():
        key = "vector" if kind == "FLOAT_VECTOR" else "value"
        attribute = mesh.attributes.get(name)
        values[name] = np.array([getattr(each, key) for each in attribute.data] if attribute else [])
    return values


def made(frames=5):
    """Contacts of frames 0, 1, ...: as many in each frame as its number."""
    offsets = np.cumsum([0, *range(frames)])
    count = offsets[-1]
    number = np.arange(count, dtype=float)
    return {"names": np.array(["floor", "crate"]), "offsets": offsets, "times": np.arange(frames) / 24,
            "positions": np.stack([number, number + 0.5, -number], axis=1),
            "normals": np.tile([0.0, 1.0, 0.0], (count, 1)), "impulses": number + 1, "speeds": number + 2,
            "bodies": np.tile([1, 0], (count, 1))}


def test_points_of_a_frame(_program, _folder):
    """Each frame shows its own points with all attributes; renewed points keep the object and its nodes."""
    scene = stage(DOWN, 10)
    given = made()
    thing = contacts.show(scene, given, 3, 1 / 24)
    for frame in range(5):
        scene.frame_set(3 + frame)
        values = shown(thing)
        rows = slice(given["offsets"][frame], given["offsets"][frame + 1])
        assert len(values["position"]) == frame and (values["frame"] == 3 + frame).all()
        assert np.allclose(values["position"], given["positions"][rows] @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        assert np.allclose(values["impulse"], given["impulses"][rows])
        assert np.allclose(values["speed"], given["speeds"][rows])
        assert (values["body_a"] == 1).all() and (values["body_b"] == 0).all()
        assert np.allclose(values["normal"].reshape(-1, 3), [0, 0, 1])
    assert [str(name) for name in thing["bodies"]] == ["floor", "crate"]
    scene.frame_set(6, subframe=0.5)
    assert len(shown(thing)["position"]) == 3
    # Without the add-on: the nodes alone show them.
    bpy.context.view_layer.update()
    again = contacts.show(scene, made(3), 1, 1 / 24)
    assert again == thing and len(thing.modifiers) == 1 and len(thing.data.vertices) == 3
    thing.modifiers.new("Dust", "NODES")
    contacts.clear(scene)
    assert contacts.found(scene) == thing and not len(thing.data.vertices)
    thing.modifiers.remove(thing.modifiers["Dust"])
    contacts.clear(scene)
    assert contacts.found(scene) is None and not bpy.data.node_groups


def test_many_points(_program, _folder):
    """Contacts of a thousand bodies by 240 frames."""
    scene = stage(DOWN, 240)
    count = 240 * 4000
    given = {"names": np.array(["a"]), "offsets": np.arange(241) * 4000, "times": np.arange(240) / 24,
             "positions": np.zeros((count, 3)), "normals": np.zeros((count, 3)), "impulses": np.zeros(count),
             "speeds": np.zeros(count), "bodies": np.zeros((count, 2), int)}
    start = time.perf_counter()
    thing = contacts.show(scene, given, 1, 1 / 24)
    made = time.perf_counter()
    scene.frame_set(100)
    assert len(shown(thing)["frame"]) == 4000
    print(f"contacts: {count} points are made in {made - start:.2f} s, a frame shown in "
          f"{time.perf_counter() - made:.2f} s")


def test_baked_contacts(program, folder):
    """A bake makes points; one from a frame on keeps those before it; they are deleted with the bake."""
    scene = stage(DOWN, 12)
    block("crate", (0, 0, 0.5))
    block("floor", (0, 0, -0.5), "PASSIVE")
    options = baking.Options(contacts=True)
    full_bake(program, folder, options)
    thing = contacts.found(scene)
    scene.frame_set(12)
    last = shown(thing)
    assert len(last["frame"]) and set(thing["bodies"]) == {"crate", "floor"}
    assert np.abs(last["position"][:, 2]).max() < 0.01, last
    weight = 9.81 / 24
    assert abs(last["impulse"].sum() - weight) < 1e-2 * weight, last["impulse"]
    scene.frame_set(6)
    before = shown(thing)
    scene.frame_set(9)
    bake = baking.Bake(bpy.context, program, options, folder, from_here=True)
    bake.finish()
    assert contacts.found(scene) == thing
    for frame in range(1, 13):
        scene.frame_set(frame)
        values = shown(thing)
        assert bool(len(values["frame"])) == (frame > 1) and (values["frame"] == frame).all(), frame
        if frame == 6:
            assert all(np.array_equal(values[key], before[key]) for key in values)
    files = sorted(os.listdir(folder))
    assert files == ["Scene.contacts.npz", "Scene.json", "Scene.npz", "Scene.scene.json"], files
    applying.delete_bake(scene)
    assert contacts.found(scene) is None


def test_work_of_users(program, folder):
    """Materials, modifiers and nodes of users outlive the next bake and Delete Bake; all else goes."""
    def subdivided(thing):
        thing.modifiers.clear()
        thing.modifiers.new("Sub", "SUBSURF")

    def own_nodes(thing):
        thing.modifiers.clear()
        thing.modifiers.new("Dust", "NODES").node_group = bpy.data.node_groups.new("Dust", "GeometryNodeTree")

    def other_nodes(thing):
        thing.modifiers[0].node_group = bpy.data.node_groups.new("Dust", "GeometryNodeTree")

    def more_nodes(thing):
        thing.modifiers[0].node_group.nodes.new("GeometryNodeMeshCube")

    def painted(thing):
        thing.data.materials.append(bpy.data.materials.new("dust"))

    def held(thing):
        bpy.ops.object.empty_add()
        bpy.context.object.parent = thing

    for change in (subdivided, own_nodes, other_nodes, more_nodes, painted, held, None):
        scene = stage(DOWN, 3)
        block("crate", (0, 0, 0.5))
        block("floor", (0, 0, -0.5), "PASSIVE")
        full_bake(program, folder, baking.Options(contacts=True))
        thing = contacts.found(scene)
        if change:
            change(thing)
        made = [(of.name, of.type, getattr(of, "node_group", None)) for of in thing.modifiers]
        full_bake(program, folder, baking.Options(contacts=True))
        assert contacts.found(scene) == thing and len(thing.data.vertices)
        applying.delete_bake(scene)
        if not change:
            assert contacts.found(scene) is None
            assert not any(len(of) for of in (bpy.data.node_groups, bpy.data.materials))
            continue
        assert contacts.found(scene) == thing and not len(thing.data.vertices), change
        assert [(of.name, of.type, getattr(of, "node_group", None)) for of in thing.modifiers] == made
        assert [of.name for of in thing.data.materials] == ["dust"] * (change == painted)


def test_modifiers_removed(_program, _folder):
    """Nodes that no object uses any longer go with the object."""
    scene = stage(DOWN, 10)
    contacts.show(scene, made(), 1, 1 / 24).modifiers.clear()
    contacts.clear(scene)
    assert contacts.found(scene) is None and not bpy.data.node_groups and not bpy.data.meshes


def test_contacts_in_other_scenes(program, folder):
    """Contacts that moved to another scene stay those of their bake; a shared object of these is no other scene's."""
    scene = stage(DOWN, 12)
    block("crate", (0, 0, 0.6))
    block("floor", (0, 0, -0.5), "PASSIVE")
    options = baking.Options(contacts=True)
    full_bake(program, folder, options)
    thing, other = contacts.found(scene), bpy.data.scenes.new("Other")
    other.collection.objects.link(thing)
    assert contacts.found(other) is None and contacts.found(scene) == thing
    contacts.clear(other)
    scene.collection.objects.unlink(thing)
    full_bake(program, folder, options)
    assert contacts.found(scene) == thing and len(thing.data.vertices) and contacts.found(other) is None
    applying.delete_bake(scene)
    assert contacts.NAME not in bpy.data.objects
