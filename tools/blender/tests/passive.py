"""Tests of passive colliders that are instances, deform or grow."""

import bpy
import numpy as np
from drystone import applying, exporting
from drystone.channels import matrices

from .common import DOWN, PLACE, UP, add, block, cube, empty, full_bake, in_blender, lines, stage

# A program that follows vertices.
FOLLOWS = exporting.Abilities(vertex_track=True)
COLLIDE = "{} instancer{} of passive objects: these collide, in Blender they do not: "


def exported(abilities=FOLLOWS):
    bpy.context.view_layer.update()
    return exporting.export(bpy.context, abilities)


def body_of(shot, name):
    return next(body for body in shot.document["bodies"] if body["name"] == name)


def in_collection(name, *things):
    """Moves objects to a collection that the scene does not show."""
    collection = bpy.data.collections.new(name)
    for thing in things:
        for own in list(thing.users_collection):
            own.objects.unlink(thing)
        collection.objects.link(thing)
    return collection


def instancer(name, collection, **more):
    thing = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(thing)
    thing.instance_type, thing.instance_collection = "COLLECTION", collection
    for key, value in more.items():
        setattr(thing, key, value)
    return thing


def nodes(host, make):
    """Geometry Nodes that put instances on the points of a host; `make` adds the node of the instance."""
    tree = bpy.data.node_groups.new("scatter", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    begin, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    scatter = tree.nodes.new("GeometryNodeInstanceOnPoints")
    tree.links.new(begin.outputs[0], scatter.inputs["Points"])
    tree.links.new(make(tree), scatter.inputs["Instance"])
    tree.links.new(scatter.outputs[0], end.inputs[0])
    host.modifiers.new("scatter", "NODES").node_group = tree


def object_node(thing):
    def make(tree):
        node = tree.nodes.new("GeometryNodeObjectInfo")
        node.inputs["Object"].default_value, node.inputs["As Instance"].default_value = thing, True
        return node.outputs["Geometry"]

    return make


def world_corners(body):
    """Corners of a box of a scene, in the world of Blender."""
    shape = body["shapes"][0]
    half = np.array(shape["half_extents"])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    x, y, z, w = body["rotation"]
    corners = (signs * half + shape["position"]) @ matrices(np.array([[w, x, y, z]]))[0].T + body["position"]
    return np.stack([corners[:, 0], -corners[:, 2], corners[:, 1]], axis=1)


def test_instances_of_collections(program, folder):
    """Several instances of one collection collide where Blender shows them; nested, scaled, turned, offset."""
    scene = empty(last=30)
    post = add(cube(1, (1, 0, 0)), "PASSIVE", "BOX", "post", friction=0.7)
    post.scale, post.rotation_euler = (1, 2, 0.5), (0, 0, 0.4)
    loose = add(cube(0.4, (0, 0, 1)), "ACTIVE", "BOX", "loose")
    collection = in_collection("tile", post, loose)
    collection.instance_offset = (1, 0, 0)
    things = [instancer(f"tile {i}", collection, location=(5 * i, 1, 0), rotation_euler=(0, 0, 0.5 * i),
                        scale=(1 + i,) * 3) for i in range(3)]
    street = in_collection("street", things.pop())
    instancer("street", street, location=(0, 20, 0))
    block("crate", (0.1, 1, 3))
    shot = exported()
    shown = {}
    for each in bpy.context.evaluated_depsgraph_get().object_instances:
        if each.is_instance and each.object.original == post:
            shown[tuple(np.round(each.matrix_world.translation, 4))] = np.array(each.matrix_world)
    bodies = [body for body in shot.document["bodies"] if body["name"] != "crate"]
    assert [body["name"] for body in bodies] == ["tile 0: post", "tile 1: post", "street: post"], bodies
    assert len(shown) == 3
    corners = np.array([[x, y, z, 1] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    for body in bodies:
        off = min(np.abs(np.sort(world_corners(body), axis=0)
                         - np.sort((corners @ matrix.T)[:, :3], axis=0)).max() for matrix in shown.values())
        assert off < 1e-5 and body["motion"] == "static" and np.isclose(body["friction"], 0.7), (body["name"], off)
    assert lines(shot) == ["3 instancers of active objects: left out. Object > Apply > Make Instances Real: "
                           "'tile 0', 'tile 1', 'street'", COLLIDE.format(3, "s") + "'tile 0', 'tile 1', 'street'"]
    assert in_blender()[-1, 0, 2, 3] < 0
    _, _, poses = full_bake(program, folder)
    assert abs(poses[-1, 0, 1] - 0.75) < 2e-3, poses[-1, 0]
    scene.objects["tile 1"].keyframe_insert("location", frame=1)
    said = lines(exported())
    assert any(line.startswith("1 instancer of passive objects that may move: still") for line in said), said


def test_instances_of_compounds(_program, _folder):
    """Parts of an instanced compound are of its type, and have its surface, whatever is set for the parts."""
    for kind in ("PASSIVE", "ACTIVE"):
        for other in ("PASSIVE", "ACTIVE"):
            empty(last=3)
            block("crate", (0, 0, 9))
            whole = add(cube(0.2, (0, 0, 0)), kind, "COMPOUND", "whole", friction=0.7)
            parts = [add(cube(1, (x, 0, 0)), other, "BOX", f"part {x}", friction=0.1) for x in (0, 2)]
            for part in parts:
                part.parent = whole
            instancer("tile", in_collection("tile", whole, *parts), location=(5, 0, 0))
            shot = exported()
            bodies = {body["name"]: (body["motion"], round(body["friction"], 3)) for body in shot.document["bodies"]}
            tiles = {name: of for name, of in bodies.items() if name.startswith("tile: ")}
            if kind == "PASSIVE":
                assert tiles == {f"tile: part {x}": ("static", 0.7) for x in (0, 2)}, (other, tiles)
                assert lines(shot) == [COLLIDE.format(1, "") + "'tile'"], lines(shot)
            else:
                assert not tiles and lines(shot) == ["1 instancer of active objects: left out. Object > Apply > Make "
                                                     "Instances Real: 'tile'"], (other, lines(shot))


def test_instances_of_nodes(_program, _folder):
    """Instances of objects collide; instances of meshes are told, if their host collides."""
    empty(last=12)
    post = in_collection("hidden", add(cube(1, (1, 0, 0)), "PASSIVE", "BOX", "post")).objects[0]
    block("crate", (0, 0, 9))
    grid = bpy.ops.mesh.primitive_grid_add
    grid(x_subdivisions=1, y_subdivisions=1, size=8)
    nodes(bpy.context.object, object_node(post))
    bpy.context.object.name = "host"
    host = add(lambda: grid(x_subdivisions=1, y_subdivisions=1, size=8, location=(0, 0, -5)), "PASSIVE", "MESH",
               "meshes")
    nodes(host, lambda tree: tree.nodes.new("GeometryNodeMeshCube").outputs["Mesh"])
    grid(x_subdivisions=1, y_subdivisions=1, size=8, location=(0, 0, -9))
    nodes(bpy.context.object, lambda tree: tree.nodes.new("GeometryNodeMeshCube").outputs["Mesh"])
    shot = exported()
    places = sorted(tuple(body["position"]) for body in shot.document["bodies"] if body["name"].startswith("host"))
    assert np.allclose(places, [(-4, 0, -4), (-4, 0, 4), (4, 0, -4), (4, 0, 4)], atol=1e-5), places
    assert "1 object with instances of meshes by Geometry Nodes: only its own mesh collides, unless realized: " \
        "'meshes'" in lines(shot), lines(shot)
    assert host.modifiers["scatter"].show_viewport


def floor(name, place=(0, 0, 0), **more):
    """A passive grid that deforms."""
    thing = add(lambda: bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=4, location=place),
                "PASSIVE", "MESH", name, **{"use_deform": True, "mesh_source": "DEFORM", **more})
    return thing


def rises(thing, height, last=24):
    """Shape keys that lift all vertices, straight in time."""
    thing.shape_key_add(name="Basis")
    key = thing.shape_key_add(name="up")
    for i, vertex in enumerate(thing.data.vertices):
        key.data[i].co = vertex.co + type(vertex.co)((0, 0, height))
    for frame, value in ((1, 0), (last, 1)):
        key.value = value
        key.keyframe_insert("value", frame=frame)
    action = thing.data.shape_keys.animation_data.action
    for curve in action.layers[0].strips[0].channelbags[0].fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def rig(thing):
    """An armature of one bone that turns a mesh."""
    armature = bpy.data.objects.new("rig", bpy.data.armatures.new("rig"))
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bone = armature.data.edit_bones.new("bone")
    bone.head, bone.tail = (0, 0, 0), (0, 1, 0)
    bpy.ops.object.mode_set(mode="OBJECT")
    thing.vertex_groups.new(name="bone").add(range(len(thing.data.vertices)), 1.0, "REPLACE")
    thing.modifiers.new("rig", "ARMATURE").object = armature
    bone = armature.pose.bones["bone"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((1, 0), (24, 0.8)):
        bone.rotation_euler = (angle, 0, 0)
        bone.keyframe_insert("rotation_euler", frame=frame)


def test_deforming_is_exported(_program, _folder):
    """Shape keys, armatures and keys of scale become vertices at each frame; all else is told."""
    scene = stage(DOWN, 24)
    rises(floor("rising"), 1.0)
    rig(floor("turning", (10, 0, 0)))
    grows = floor("growing", (20, 0, 0), mesh_source="FINAL")
    for frame, size in ((1, 1), (24, 2)):
        grows.scale = (size, size, 1)
        grows.keyframe_insert("scale", frame=frame)
    folding = floor("folding", (60, 0, 0))
    rises(folding, 1.0)
    corner = folding.data.shape_keys.key_blocks["up"].data
    for i in (1, 5, 6):
        corner[i].co = corner[0].co
    floor("still", (30, 0, 0))
    rises(floor("base", (40, 0, 0), mesh_source="BASE"), 1.0)
    counted = floor("counted", (50, 0, 0), mesh_source="FINAL").modifiers.new("Array", "ARRAY")
    for frame, count in ((1, 1), (12, 2)):
        counted.count = count
        counted.keyframe_insert("count", frame=frame)
    block("crate", (0, 0, 0.6))
    scene.frame_set(1)
    shot = exported()
    tracks = {body["name"]: body["shapes"][0].get("vertex_track") for body in shot.document["bodies"]}
    assert {name for name, track in tracks.items() if track} == {"rising", "turning", "growing", "folding", "base"}
    shapes = body_of(shot, "folding")["shapes"][0]
    assert len(shapes["triangles"]) < len(body_of(shot, "rising")["shapes"][0]["triangles"]) == 32
    for name in ("rising", "turning", "growing", "base"):
        track, body = tracks[name], body_of(shot, name)
        assert np.allclose(track["times"], np.arange(24) / 24)
        assert np.allclose(track["points"][0], body["shapes"][0]["vertices"], atol=1e-6)
        for frame in (7, 24):
            scene.frame_set(frame)
            thing = scene.objects[name]
            mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
            shown = np.array([thing.matrix_world @ vertex.co for vertex in mesh.vertices])
            points = np.array(track["points"][frame - 1]) + body["position"]
            off = np.abs(np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1) - shown).max()
            assert off < 1e-5, (name, frame, off)
    scene.frame_set(1)
    assert lines(shot) == [
        "1 deforming object with triangles that lose their area at some frame: without these: 'folding'",
        "1 deforming object whose number of vertices changes: of the shape at the first frame: 'counted'"], lines(shot)
    old = lines(exported(exporting.Abilities()))
    assert old == ["7 objects with a mesh that deforms: of the shape at the first frame: "
                   "'rising', 'turning', 'growing', 'folding', 'still', 'base', 'counted'",
                   "1 object with keys of scale: of the size at the first frame: 'growing'"], old


def test_rising_floor(program, folder):
    """A floor that rises by its vertices carries a crate."""
    scene = stage(DOWN, 24)
    rises(floor("floor"), 1.0)
    block("crate", (0, 0, 0.5))
    scene.frame_set(1)
    _, document, poses = full_bake(program, folder)
    crate = [body["name"] for body in document["bodies"]].index("crate")
    rose = poses[-1, crate, 1] - 0.5
    print(f"passive: a floor that rises by 1 m carries a crate by {rose:.4f} m")
    assert abs(rose - 1) < 2e-3


def swinging(source="DEFORM", use_deform=True):
    """An arm that its bone turns towards a ball."""
    scene = stage(DOWN, 36)
    block("floor", (0, 0, -5), "PASSIVE", size=10)
    make = bpy.ops.mesh.primitive_grid_add
    arm = add(lambda: make(x_subdivisions=4, y_subdivisions=2, size=1), "PASSIVE", "MESH", "arm", mesh_source=source,
              use_deform=use_deform)
    for vertex in arm.data.vertices:
        x, y, _ = vertex.co
        vertex.co = (0, 2 * x + 1.2, y + 0.5)
    rig(arm)
    bpy.data.objects["rig"].pose.bones["bone"].rotation_mode = "XYZ"
    for frame, angle in ((1, 0), (24, 1)):
        bone = bpy.data.objects["rig"].pose.bones["bone"]
        bone.rotation_euler = (0, 0, angle)
        bone.keyframe_insert("rotation_euler", frame=frame)
    add(lambda: bpy.ops.mesh.primitive_uv_sphere_add(radius=0.3, location=(-0.6, 1.6, 0.3)), "ACTIVE", "SPHERE", "ball")
    scene.frame_set(1)
    return scene


def test_skins(program, folder):
    """An armature moves a passive mesh as in Blender with the sources Base and Deform; the source Final is told."""
    final = "1 deforming object with modifiers and the source Final: followed, in Blender for certain only with " \
            "Deform: 'arm'"
    for source in ("BASE", "DEFORM", "FINAL"):
        scene = swinging(source)
        blender = in_blender()[-1, 0, 0, 3]
        scene.frame_set(1)
        run, _, poses = full_bake(program, folder)
        ball = [body["name"] for body in run.shot.document["bodies"]].index("ball")
        # With Final, Blender follows in some runs of a process.
        assert poses[-1, ball, 0] < -1.5 and (blender < -1.5 or source == "FINAL"), (source, poses[-1, ball], blender)
        assert lines(run.shot) == ([final] if source == "FINAL" else []), lines(run.shot)


def test_skins_that_do_not_deform(program, folder):
    """An armature without Deforming moves no shape, as in Blender, and is told, as that of an active body is."""
    told = "with a mesh that moves without Deforming: of the shape at the first frame, as in Blender: 'arm'"
    scene = swinging(use_deform=False)
    assert abs(in_blender()[-1, 0, 0, 3] + 0.6) < 1e-3
    scene.frame_set(1)
    run, _, poses = full_bake(program, folder)
    ball = [body["name"] for body in run.shot.document["bodies"]].index("ball")
    assert abs(poses[-1, ball, 0] + 0.6) < 1e-3 and lines(run.shot) == [f"1 passive object {told}"], lines(run.shot)
    arm = scene.objects["arm"]
    arm.rigid_body.type, arm.rigid_body.collision_shape = "ACTIVE", "CONVEX_HULL"
    assert f"1 active object {told}" in lines(exported()), lines(exported())
    arm.rigid_body.mesh_source = "BASE"
    assert not any("Deforming" in line for line in lines(exported()))
    scene.objects["rig"].pose.bones["bone"].rotation_euler = (0, 0, 0)
    scene.objects["rig"].animation_data_clear()
    arm.rigid_body.mesh_source = "DEFORM"
    assert not any("Deforming" in line for line in lines(exported()))


def test_following_a_body(program, folder):
    """What follows an active body is told, and left out if it moves; parents that do so are left while baked."""
    scene = stage(DOWN, 12)
    crate = block("crate", (0, 0, 5))
    for name, place, kinematic in (("child", (9, 0, 0), False), ("Animated child", (18, 0, 0), True)):
        block(name, place, "PASSIVE", kinematic=kinematic).parent = crate
    copy = block("copy", (27, 0, 0), "PASSIVE", kinematic=True).constraints.new("COPY_LOCATION")
    copy.target, copy.use_offset = crate, True
    driver = block("driven", (36, 0, 0), "PASSIVE", kinematic=True).driver_add("location", 2).driver
    variable = driver.variables.new()
    variable.type, driver.expression = "TRANSFORMS", variable.name
    variable.targets[0].id, variable.targets[0].transform_type = crate, "LOC_Z"
    holder = bpy.data.objects.new("holder", None)
    scene.collection.objects.link(holder)
    holder.constraints.new("COPY_LOCATION").target = crate
    below = block("below", (45, 0, 0))
    below.parent = holder
    collection = in_collection("posts", block("post", (0, 0, 0), "PASSIVE"))
    instancer("shows posts", collection, location=(54, 0, 0), parent=crate)
    block("apart", (63, 0, 0), "PASSIVE").parent = instancer("still", None)
    bpy.context.view_layer.update()
    deltas = [tuple(thing.delta_location) for thing in scene.objects]
    run, document, poses = full_bake(program, folder)
    following = "following a body that the simulation moves"
    assert sorted(lines(run.shot)) == [
        "1 instancer following a body that the simulation moves: still, as at the first frame: 'shows posts'",
        COLLIDE.format(1, "") + "'shows posts'",
        "1 object below another body or an uneven parent: without a parent while baked: 'below'",
        f"1 passive object {following}: still, as at the first frame: 'child'",
        f"3 objects {following}: left out: 'Animated child', 'copy', 'driven'"], lines(run.shot)
    names = [body["name"] for body in document["bodies"]]
    assert names == ["crate", "child", "below", "apart", "shows posts: post"], names
    scene.frame_set(12)
    assert np.allclose(below.matrix_world.translation, poses[-1, 2, :3] @ UP.T, atol=PLACE)
    applying.delete_bake(scene)
    assert deltas == [tuple(thing.delta_location) for thing in scene.objects] and below.parent == holder


def hooked(thing, target):
    """Lets all vertices of an object follow another one."""
    hook = thing.modifiers.new("hook", "HOOK")
    hook.object = target
    hook.vertex_indices_set(range(len(thing.data.vertices)))
    return hook


def vertex_followers(crate):
    """Passive objects whose vertices follow a crate, each in another way, and some that follow nobody."""
    scene = bpy.context.scene
    hooked(floor("hooked", (10, 0, 0)), crate)
    hooked(floor("box", (20, 0, 0), collision_shape="BOX", use_deform=False), crate)
    rig(floor("rigged", (30, 0, 0)))
    follow = scene.objects["rig"].pose.bones["bone"].constraints.new("COPY_LOCATION")
    follow.target = crate
    lattice = bpy.data.objects.new("lattice", bpy.data.lattices.new("lattice"))
    scene.collection.objects.link(lattice)
    lattice.parent = crate
    lattice.data.points[0].co_deform.x += 1
    floor("in lattice", (0, 0, 5)).modifiers.new("lattice", "LATTICE").object = lattice
    driven = floor("driven", (50, 0, 0))
    rises(driven, 1.0)
    driver = driven.data.shape_keys.key_blocks["up"].driver_add("value").driver
    variable = driver.variables.new()
    variable.type, driver.expression = "TRANSFORMS", variable.name
    variable.targets[0].id, variable.targets[0].transform_type = crate, "LOC_X"
    onto = floor("onto", (60, 0, 0), mesh_source="FINAL").modifiers.new("shrink", "SHRINKWRAP")
    onto.target = crate
    hooked(floor("base", (70, 0, 0), mesh_source="BASE"), crate)
    still = bpy.data.objects.new("still", None)
    scene.collection.objects.link(still)
    hooked(floor("follows nobody", (80, 0, 0)), still)
    rises(floor("rising", (90, 0, 0)), 1.0)


def test_vertices_following_a_body(program, folder):
    """Vertices that follow an active body are told by name: of passive objects, active ones and parts."""
    for abilities in (FOLLOWS, exporting.Abilities()):
        scene = stage(DOWN, 12)
        crate = block("crate", (0, 0, 5))
        vertex_followers(crate)
        hooked(block("active", (0, 20, 0)), crate)
        below = block("below a vertex", (0, 30, 0), "PASSIVE")
        below.parent, below.parent_type = crate, "VERTEX"
        plain = [tuple(thing.location) + tuple(thing.delta_location) for thing in scene.objects]
        said = lines(exported(abilities))
        assert "1 passive object following a body that the simulation moves: still, as at the first frame: " \
            "'below a vertex'" in said, said
        said = [line for line in said if "vertices that follow" in line]
        tracked = "without that part of their motion"
        names = "'hooked', 'rigged', 'in lattice', 'driven', 'onto', 'base'"
        if abilities.vertex_track:
            wanted = [f"6 passive objects with vertices that follow an active body: {tracked}: {names}",
                      "1 passive object with vertices that follow an active body: as at the first frame: 'box'"]
        else:
            names = names.replace("'hooked', ", "'hooked', 'box', ")
            wanted = [f"7 passive objects with vertices that follow an active body: as at the first frame: {names}"]
        wanted.append("1 object with vertices that follow an active body: as at the first frame: 'active'")
        assert sorted(said) == sorted(wanted), said
        assert plain == [tuple(thing.location) + tuple(thing.delta_location) for thing in scene.objects]


def test_instances_and_winds_following_a_body(program, folder):
    """Instances on vertices that follow an active body are told, and winds that it turns."""
    stage(DOWN, 12)
    crate = block("crate", (0, 0, 5))
    post = block("post", (0, 0, 0), "PASSIVE")
    in_collection("posts", post)
    bpy.ops.mesh.primitive_plane_add(size=4, location=(10, 0, 0))
    host = bpy.context.object
    host.name = "host"
    hooked(host, crate)
    nodes(host, object_node(post))
    bpy.ops.object.effector_add(type="WIND", location=(20, 0, 0))
    bpy.context.object.name = "wind"
    bpy.context.object.parent = crate
    said = lines(exported(exporting.Abilities(force=True)))
    assert "1 instancer following a body that the simulation moves: still, as at the first frame: 'host'" in said
    assert "1 wind following a body that the simulation moves: as at the first frame: 'wind'" in said, said


def test_winds_below_bodies(_program, _folder):
    """A wind below a body, also a hidden one, blows in its direction of the first frame in every export."""
    for is_hidden in (False, True):
        scene = stage(DOWN, 12)
        things = [block(f"crate {i}", (3 * i, 0, 5)) for i in range(4)]
        in_collection("posts", block("post", (0, 9, 0), "PASSIVE"))
        instancer("posts", bpy.data.collections["posts"])
        bpy.ops.object.effector_add(type="WIND", location=(20, 0, 0))
        bpy.context.object.parent, things[1].hide_viewport = things[1], is_hidden
        for frame in range(1, 9):
            scene.frame_set(frame)
            force = body_of(exported(exporting.Abilities(force=True)), "crate 0")["force"]
            assert np.allclose(force, (0, 1 / 24, 0), atol=1e-6), (is_hidden, frame, force)


def test_hidden_instancers(_program, _folder):
    """Instancers whose instances a view layer does not show are named, unless they show no bodies."""
    def parented(above, below):
        below.parent, above.instance_type = above, "VERTS"

    def scattered(above, below):
        nodes(above, object_node(below))

    def nested(above, below):
        inner = instancer("inner", in_collection("post", below))
        above.instance_type, above.instance_collection = "COLLECTION", in_collection("street", inner)

    def hidden(above):
        above.hide_set(True)

    def disabled(above):
        above.hide_viewport = True

    told = ["1 instancer hidden or excluded: instances collide only where they are shown: 'above'"]
    for show in (parented, scattered, nested):
        for hide, kind in ((hidden, "PASSIVE"), (disabled, "PASSIVE"), (None, "PASSIVE"), (hidden, None)):
            empty(last=3)
            block("crate", (0, 0, 9))
            below = block("below", (0, 0, 0), "PASSIVE")
            if not kind:
                bpy.ops.rigidbody.object_remove()
            bpy.ops.mesh.primitive_plane_add(size=4)
            above = bpy.context.object
            if show == nested:
                above = bpy.data.objects.new("above", None)
                bpy.context.scene.collection.objects.link(above)
            above.name = "above"
            show(above, below)
            if hide:
                hide(above)
            said = [line for line in lines(exported()) if "instancer" in line]
            wanted = (told if hide else [COLLIDE.format(1, "") + "'above'"]) if kind else []
            assert said == wanted, (show, hide, kind, said)
