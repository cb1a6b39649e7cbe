"""Tests of bodies that a view layer does not show: disabled in viewports, or in excluded collections."""

import bpy
import numpy as np
from drystone.curves import curves_of, drivers_of

from .common import add, block, constrain, cube, empty, full_bake
from .passive import exported

WAYS = ("shown", "eye", "disabled", "keyed", "driven", "collection", "excluded")


def proxies():
    """An animated proxy with a child and a fine mesh, a glued pair, and a crate, all in one collection."""
    scene = empty(last=20)
    proxy = add(cube(2, (0, 0, 1)), "PASSIVE", "BOX", "proxy", kinematic=True)
    proxy.keyframe_insert("location", frame=1)
    proxy.location.x = 5
    proxy.keyframe_insert("location", frame=20)
    child = add(cube(1, (0, 5, 1)), "PASSIVE", "BOX", "child", kinematic=True)
    child.parent = proxy
    round_one = add(cube(1, (8, 0, 5)), "ACTIVE", "CONVEX_HULL", "round", mesh_source="FINAL")
    round_one.modifiers.new("subdivision", "SUBSURF").levels = 2
    rider = block("rider", (20, 0, 9))
    above = bpy.data.objects.new("above", None)
    scene.collection.objects.link(above)
    above.location.x = 1
    above.keyframe_insert("location", frame=1)
    above.location.x = 3
    above.keyframe_insert("location", frame=20)
    rider.parent = above
    joint = constrain("FIXED", round_one, rider)
    things = [proxy, child, round_one, rider, joint]
    inside = bpy.data.collections.new("proxies")
    scene.collection.children.link(inside)
    for thing in things:
        scene.collection.objects.unlink(thing)
        inside.objects.link(thing)
    return scene, inside, things


def hide(way, inside, things):
    if way == "eye":
        for thing in things:
            thing.hide_set(True)
    for thing in things if way in ("disabled", "keyed", "driven") else ():
        thing.hide_viewport = True
        if way == "keyed":
            thing.keyframe_insert("hide_viewport", frame=1)
        elif way == "driven":
            thing.driver_add("hide_viewport").driver.expression = "1"
    inside.hide_viewport = way == "collection"
    bpy.context.view_layer.layer_collection.children[inside.name].exclude = way == "excluded"
    bpy.context.view_layer.update()


def visibility(inside, things):
    """Returns all that hides objects, and which are in the scene's own collection."""
    layer = bpy.context.view_layer
    return [layer.layer_collection.children[inside.name].exclude, inside.hide_viewport,
            [thing.hide_viewport for thing in things], [thing.name in layer.objects for thing in things],
            [thing.name in layer.objects and thing.hide_get() for thing in things],
            [thing.name for thing in bpy.context.scene.collection.objects],
            [curve.mute for thing in things for curve in curves_of(thing) + drivers_of(thing)]]


def test_exported_alike(_program, _folder):
    """Bodies, shapes, tracks and joints are the same, whoever is hidden, and so is the scene afterwards."""
    documents = {}
    for way in WAYS:
        scene, inside, things = proxies()
        hide(way, inside, things)
        before = visibility(inside, things)
        shot = exported()
        assert visibility(inside, things) == before, way
        documents[way] = shot.document
        assert {thing.name_full for thing in things[2:4]} == set(shot.channels), way
        # The frames of the rider's parent, of all frames of the scene.
        above = np.array(shot.channels["rider"].above)
        assert np.allclose(above[[0, -1], 0, 3], [1, 3]), (way, above[:, 0, 3])
        scene.frame_set(20)
        places = {name: np.array(bpy.data.objects[name].evaluated_get(
            bpy.context.evaluated_depsgraph_get()).matrix_world)[0, 3] for name in ("proxy", "child")}
        assert places == {"proxy": 5, "child": 5}, (way, places)
    tracks = {body["name"]: body.get("track", []) for body in documents["shown"]["bodies"]}
    assert len(tracks["proxy"]) == len(tracks["child"]) == 20
    for way in WAYS:
        assert documents[way] == documents["shown"], way


def test_baked(program, folder):
    """An excluded proxy that moves pushes a crate, and the crate gets its keys."""
    scene = empty(last=20)
    block("floor", (0, 0, -5), "PASSIVE", size=10)
    crate = block("crate", (0, 0, 0.5))
    wall = add(cube(1, (-1.2, 0, 0.6)), "PASSIVE", "BOX", "wall", kinematic=True)
    wall.keyframe_insert("location", frame=1)
    wall.location.x = 0.8
    wall.keyframe_insert("location", frame=20)
    inside = bpy.data.collections.new("proxies")
    scene.collection.children.link(inside)
    scene.collection.objects.unlink(wall)
    inside.objects.link(wall)
    hide("excluded", inside, [])
    full_bake(program, folder)
    scene.frame_set(20)
    assert crate.matrix_world.translation.x > 1.7, crate.matrix_world.translation


def lamp_in(collection):
    """A mesh without a rigid body in a collection inside of that of the rigid body world."""
    inside = bpy.data.collections.new("props")
    collection.children.link(inside)
    lamp = bpy.data.objects.new("lamp", bpy.data.meshes.new("lamp"))
    inside.objects.link(lamp)
    bpy.context.scene.collection.objects.link(lamp)
    return lamp


def test_meshes_without_a_body(program, folder):
    """A mesh that only shares the world's collection gets no rigid body by a check or a bake."""
    empty(last=3)
    block("crate", (0, 0, 3))
    lamp_in(bpy.context.scene.rigidbody_world.collection)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "props.blend"))
    scene = empty(last=3)
    crate = block("crate", (0, 0, 3))
    world = scene.rigidbody_world.collection
    lamp = lamp_in(world)
    with bpy.data.libraries.load(str(folder / "props.blend"), link=True) as (_, wanted):
        wanted.collections = ["props"]
    world.children.link(wanted.collections[0])
    linked = wanted.collections[0].objects[0]
    of = constrain("FIXED", crate, lamp).rigid_body_constraint
    collections = [list(thing.users_collection) for thing in (lamp, linked)]
    members = list(world.all_objects)
    _, document, _ = full_bake(program, folder)
    assert [body["name"] for body in document["bodies"]] == ["crate"]
    assert lamp.rigid_body is None and linked.rigid_body is None
    assert of.object2 == lamp and list(world.all_objects) == members
    assert [list(thing.users_collection) for thing in (lamp, linked)] == collections
    assert bpy.context.scene == scene and list(bpy.data.scenes) == [scene]
    assert not any(of.name.startswith("Drystone Scratch") for of in (
        *bpy.data.objects, *bpy.data.meshes, *bpy.data.collections))


def test_meshes_of_the_whole_scene(program, folder):
    """The same where the world has the scene's own collection, and the mesh is excluded."""
    scene = empty(last=3)
    block("crate", (0, 0, 3))
    scene.rigidbody_world.collection = scene.collection
    inside = bpy.data.collections.new("props")
    lamp = bpy.data.objects.new("lamp", bpy.data.meshes.new("lamp"))
    inside.objects.link(lamp)
    scene.collection.children.link(inside)
    bpy.context.view_layer.layer_collection.children["props"].exclude = True
    full_bake(program, folder)
    assert lamp.rigid_body is None and list(lamp.users_collection) == [inside]
    assert scene.rigidbody_world.collection == scene.collection
