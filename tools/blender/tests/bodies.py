"""Tests of bodies: shapes, numbers of them, rates."""

import json
import math
import time

import bpy
import numpy as np
from drystone import applying
from drystone.shapes import CENTER

from .common import (DOWN, PLACE, TURN, UP, add, bake, block, constrain, cube, differences, empty, export, full_bake,
                     in_blender, lines, stage)


def all_shapes():
    """A scene with every shape, a compound, a parent and an animated body."""
    scene = empty(last=60)
    mesh = bpy.ops.mesh
    add(lambda: mesh.primitive_plane_add(size=20), "PASSIVE", "MESH", "ground", friction=0.8)
    add(cube(0.5, (0, 0, 2)), "ACTIVE", "BOX", "box", mass=3, friction=0.6, restitution=0.2)
    long = add(cube(1, (2, 0, 1.5)), "ACTIVE", "BOX", "scaled box")
    long.scale, long.rotation_euler = (0.2, 0.4, 1.1), (0.3, 0.2, 0.5)
    add(lambda: mesh.primitive_uv_sphere_add(radius=0.3, location=(-2, 0, 2)), "ACTIVE", "SPHERE", "ball")
    roll = add(lambda: mesh.primitive_cylinder_add(radius=0.2, depth=0.8, location=(0, 2, 2)), "ACTIVE",
               "CYLINDER", "roll")
    roll.rotation_euler = (0, math.pi / 2, 0)
    add(lambda: mesh.primitive_cylinder_add(radius=0.2, depth=1, location=(0, -2, 2)), "ACTIVE", "CAPSULE",
        "pill")
    add(lambda: mesh.primitive_cone_add(radius1=0.4, depth=0.8, location=(3, 2, 2)), "ACTIVE", "CONE", "cone")
    add(lambda: mesh.primitive_monkey_add(size=0.6, location=(-3, 2, 2)), "ACTIVE", "CONVEX_HULL", "monkey")
    pusher = add(cube(1, (-6, -4, 0.5)), "PASSIVE", "BOX", "pusher", kinematic=True)
    for frame, x in ((1, -6), (60, -2)):
        pusher.location.x = x
        pusher.keyframe_insert("location", frame=frame)
    add(cube(0.6, (-3, -4, 0.3)), "ACTIVE", "BOX", "pushed")
    hammer = add(cube(0.3, (4, -3, 1.5)), "ACTIVE", "COMPOUND", "hammer")
    for name, place in (("head", (4, -3, 1.5)), ("shaft", (4.4, -3, 1.5))):
        part = add(cube(0.3, place), "ACTIVE", "BOX", name)
        part.parent = hammer
        part.matrix_parent_inverse = hammer.matrix_world.inverted()
    holder = bpy.data.objects.new("holder", None)
    holder.location, holder.rotation_euler = (1, 1, 0), (0, 0, 0.7)
    scene.collection.objects.link(holder)
    child = add(cube(0.4, (0, 0, 3)), "ACTIVE", "BOX", "child")
    child.parent = holder
    add(lambda: mesh.primitive_torus_add(location=(6, 6, 0)), "PASSIVE", "MESH", "ring")
    add(lambda: mesh.primitive_circle_add(radius=1, location=(6, 0, 0.5), fill_type="NGON"), "PASSIVE",
        "CONVEX_HULL", "table")
    add(cube(0.4, (6, 0, 1)), "ACTIVE", "CONVEX_HULL", "cup")
    bpy.context.view_layer.update()
    return scene


def test_shapes(command, folder):
    """Every shape is exported, baked, and shown where the bake says."""
    scene = all_shapes()
    file = folder / "shapes.json"
    said = lines(export(file))
    assert said == ["2 flat passive objects: solid below, so that nothing falls through: 'ground', 'table'",
                    f"2 objects{CENTER}: 'monkey', 'hammer'"], said
    document, numbers = bake(command, file, folder / "a.npz", folder / "a.poses")
    by_name = {body["name"]: body for body in document["bodies"]}
    assert len(by_name) == 15 and len(by_name["hammer"]["shapes"]) == 2, sorted(by_name)
    assert by_name["scaled box"]["shapes"][0]["half_extents"] == [0.1, 0.55, 0.2] or np.allclose(
        by_name["scaled box"]["shapes"][0]["half_extents"], [0.1, 0.55, 0.2])
    assert len(by_name["pusher"]["track"]) == 60 and by_name["ground"]["motion"] == "static"
    # In a second a body keeps 0.96 of its velocity and 0.9 of its turning, as Blender has it by default.
    damped = [math.exp(-by_name["box"][key]) for key in ("linear_damping", "angular_damping")]
    assert np.allclose(damped, [0.96, 0.9], atol=1e-6), damped
    assert len(numbers) == 60
    count, missing = applying.apply(bpy.context, folder / "a.npz")
    assert (count, missing) == (11, []), (count, missing)
    place, turn = differences(document, numbers)
    print(f"shapes: {len(by_name)} bodies, {len(numbers)} frames, off by {place:.1e} m, {turn:.1e} rad")
    assert place < PLACE and turn < TURN
    # The objects lie on the ground where their shapes are.
    low, name = min(((thing.matrix_world @ v.co).z, thing.name) for thing in scene.objects
                    if thing.type == "MESH" and thing.name != "ring" for v in thing.data.vertices)
    cup = scene.objects["cup"].matrix_world.translation.z
    assert abs(cup - 0.7) < 1e-3, cup
    print(f"shapes: the lowest vertex, of {name}, is at {low * 1e3:.2f} mm")
    assert low > -2e-3
    # A second export of what carries a bake is the first.
    export(folder / "again.json")
    again = json.loads((folder / "again.json").read_text())
    motions = [[(body["name"], body["motion"]) for body in of["bodies"]] for of in (document, again)]
    assert motions[0] == motions[1]
    assert scene.objects["ground"].animation_data is None


def test_thousand(command, folder):
    """1000 boxes and balls by 240 frames."""
    scene = empty(last=240)
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=60), "PASSIVE", "BOX", "ground")
    bpy.ops.mesh.primitive_cube_add(size=0.4)
    block = bpy.context.object.data
    bpy.data.objects.remove(bpy.context.object)
    things = []
    for i in range(1000):
        x, y, z = i % 10, i // 10 % 10, i // 100
        thing = bpy.data.objects.new(f"thing {i}", block)
        thing.location = (0.45 * (x - 4.5) + 0.02 * z, 0.45 * (y - 4.5), 0.3 + 0.6 * z)
        scene.collection.objects.link(thing)
        things.append(thing)
    for thing in things:
        thing.select_set(True)
    bpy.context.view_layer.objects.active = things[0]
    bpy.ops.rigidbody.objects_add(type="ACTIVE")
    for i, thing in enumerate(things):
        thing.rigid_body.collision_shape = "SPHERE" if i % 3 == 0 else "BOX"
    bpy.context.view_layer.update()

    start = time.perf_counter()
    export(folder / "many.json")
    exported = time.perf_counter()
    document, numbers = bake(command, folder / "many.json", folder / "b.npz", folder / "b.poses",
                             "--realtime")
    baked = time.perf_counter()
    count, missing = applying.apply(bpy.context, folder / "b.npz")
    applied = time.perf_counter()
    assert (count, missing) == (1000, []) and len(numbers) == 240
    bags = [bag for action in bpy.data.actions for bag in action.layers[0].strips[0].channelbags]
    assert len(bags) == 1000
    for bag in bags:
        for curve in bag.fcurves:
            frames = [point.co.x for point in curve.keyframe_points]
            assert frames == list(range(1, 241)), "keys are not at whole frames"
    place, turn = differences(document, numbers)
    print(f"thousand: {count} bodies, {len(numbers)} frames, off by {place:.1e} m, {turn:.1e} rad; export "
          f"{exported - start:.1f} s, bake {baked - exported:.1f} s, keys {applied - baked:.1f} s")
    assert place < PLACE and turn < TURN


def test_other_rates(command, folder):
    """A bake of 60 steps a second on a scene of 24 frames: keys at whole frames, from its first to its last."""
    scene = empty(fps=24, last=10)
    add(cube(1, (0, 0, 3)), "ACTIVE", "BOX", "crate")
    document = {"steps": 60, "bodies": [
        {"name": "crate", "position": [0, 3, 0], "angular_velocity": [0, 1, 0],
         "shapes": [{"type": "box", "half_extents": [0.5, 0.5, 0.5]}]},
        {"name": "gone", "shapes": [{"type": "sphere", "radius": 0.1}], "position": [9, 0, 0]}]}
    (folder / "rate.json").write_text(json.dumps(document))
    bake(command, folder / "rate.json", folder / "c.npz", folder / "c.poses")
    assert applying.apply(bpy.context, folder / "c.npz") == (1, ["gone"])
    assert (scene.frame_start, scene.frame_end) == (1, 25)
    scene.frame_set(25)
    fallen = 3 - bpy.data.objects["crate"].matrix_world.translation.z
    turned = bpy.data.objects["crate"].matrix_world.to_euler().z
    print(f"other rates: after 1 s fallen {fallen:.3f} m, turned {turned:.4f} rad")
    assert abs(fallen - 9.81 / 2) < 0.02 and abs(turned - 1) < 1e-3


def linked_from(path, *names, override=False):
    """Links objects from a file into the scene and its rigid body world."""
    scene = bpy.context.scene
    with bpy.data.libraries.load(str(path), link=True) as (_, linked):
        linked.objects = list(names)
    things = [thing.override_create() if override else thing for thing in linked.objects]
    for thing in things:
        scene.collection.objects.link(thing)
        scene.rigidbody_world.collection.objects.link(thing)
    bpy.context.view_layer.update()
    return things


def test_linked_of_the_same_name(program, folder):
    """Objects of one name from several files are bodies of their own; those linked get no keys."""
    empty(last=12)
    add(cube(1, (9, 0, 2)), "ACTIVE", "BOX", "crate")
    add(cube(1, (0, 0, 2)), "PASSIVE", "BOX", "post")
    add(cube(1, (18, 0, 2)), "ACTIVE", "BOX", "over")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "set.blend"), check_existing=False)
    scene = empty(last=12)
    crate, post = (add(cube(1, (0, y, 2)), "ACTIVE", "BOX", name) for y, name in ((4, "crate"), (8, "post")))
    linked_from(folder / "set.blend", "crate", "post")
    linked_from(folder / "set.blend", "over", override=True)
    run, document, poses = full_bake(program, folder)
    places = {body["name"]: body["position"] for body in document["bodies"]}
    assert {name: np.round(place).tolist() for name, place in places.items()} == {
        "crate": [0, 2, -4], "post": [0, 2, -8], "crate [set.blend]": [9, 2, 0], "post [set.blend]": [0, 2, 0],
        "over": [18, 2, 0]}, places
    assert lines(run.shot) == ["1 object linked from another file: no keys, unless overridden or made local: "
                               "'crate [set.blend]'"], lines(run.shot)
    scene.frame_set(12)
    for thing in (crate, post):
        wanted = poses[-1, list(places).index(thing.name), :3] @ UP.T
        assert np.allclose(thing.matrix_world.translation, wanted, atol=PLACE), (thing, wanted)
    assert sorted(thing.name_full for thing in scene.objects if "drystone" in thing) == ["crate", "over", "post"]


def test_in_the_world_alone(program, folder):
    """Bodies and constraints that no collection of the scene has are part of the bake, as in Blender."""
    scene = stage(DOWN, 24)
    crate = block("crate", (0, 0, 3))
    lift = block("lift", (0, 0, 0), "PASSIVE", size=2, kinematic=True)
    for frame, height in ((1, 0), (24, 1)):
        lift.location.z = height
        lift.keyframe_insert("location", frame=frame)
    hangs = block("hangs", (9, 0, 0))
    joint = constrain("POINT", block("post", (9, 0, 4), "PASSIVE"), hangs, (9, 0, 2))
    for thing in (lift, hangs, joint):
        scene.collection.objects.unlink(thing)
    scene.frame_set(1)
    run, document, poses = full_bake(program, folder)
    heights = {body["name"]: poses[-1, i, 1] for i, body in enumerate(document["bodies"])}
    assert abs(heights["lift"] - 1) < 1e-5 and heights["crate"] > 2.4 and abs(heights["hangs"]) < 1e-3, heights
    assert lines(run.shot) == ["3 objects in the rigid body world alone: part of the bake, as in Blender: "
                               "'lift', 'hangs', 'joint'"], lines(run.shot)
    assert "drystone" in hangs and hangs.name not in scene.objects and crate.name in scene.objects
    assert applying.delete_bake(scene) == 2 and "drystone" not in hangs


def test_sources_as_in_blender(program, folder):
    """A crate rests as high as in Blender. The source Deform ends at the first modifier that makes vertices."""
    for source in ("BASE", "DEFORM", "FINAL"):
        for kinds in (("BEVEL", "DISPLACE"), ("DISPLACE", "BEVEL"), ("DISPLACE", "COLLISION"), ("ARRAY",)):
            scene = empty(last=60)
            floor = add(cube(1, (0, 0, -0.5)), "PASSIVE", "BOX", "floor")
            floor.scale = (20, 20, 1)
            crate = add(cube(1, (0, 0, 2)), "ACTIVE", "CONVEX_HULL", "crate", mesh_source=source)
            for kind in kinds:
                modifier = crate.modifiers.new(kind, kind)
                if kind == "DISPLACE":
                    modifier.mid_level, modifier.strength = 0, 1
                elif kind == "BEVEL":
                    modifier.width = 0.01
                elif kind == "ARRAY":
                    modifier.relative_offset_displace = (0, 0, -1)
            bpy.context.view_layer.update()
            blender = in_blender()[-1, 0, 2, 3]
            full_bake(program, folder)
            scene.frame_set(60)
            height = crate.matrix_world.translation.z
            assert abs(height - blender) < 0.01, (source, kinds, height, blender)
            assert all(modifier.show_viewport for modifier in crate.modifiers)


def test_edit_mode(program, folder):
    """Objects in Edit Mode are baked as they are shown there, and stay in it."""
    for shape in ("BOX", "CONVEX_HULL", "MESH"):
        scene = empty(last=48)
        add(cube(20, (0, 0, -10)), "PASSIVE", "BOX", "floor")
        crate, other = (add(cube(1, (x, 0, 2)), "ACTIVE", shape, name) for x, name in ((0, "crate"), (5, "other")))
        other.data = crate.data
        bpy.context.view_layer.objects.active = crate
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.transform.resize(value=(1, 1, 2))
        run, _, _ = full_bake(program, folder)
        assert lines(run.shot) == [] and crate.mode == "EDIT", lines(run.shot)
        scene.frame_set(48)
        heights = [thing.matrix_world.translation.z for thing in (crate, other)]
        assert np.allclose(heights, 1, atol=1e-2), (shape, heights)
        bpy.ops.object.mode_set(mode="OBJECT")


def test_center_of_mass(program, folder):
    """A body has the center of its volume, in Blender its origin, which holds it on an edge; this is told."""
    for shape in ("CONVEX_HULL", "MESH", "COMPOUND"):
        scene = empty(last=48)
        add(cube(2, (0, 0, -1)), "PASSIVE", "BOX", "post")
        plank = add(cube(1, (0, 0, 0.5)), "ACTIVE", shape, "plank")
        part = add(cube(1, (0, 0, 0.5)), "ACTIVE", "CONVEX_HULL", "part") if shape == "COMPOUND" else plank
        for vertex in part.data.vertices:
            vertex.co.x = 3 * vertex.co.x + 1.4
        if part != plank:
            part.parent, part.matrix_parent_inverse = plank, plank.matrix_world.inverted()
        scene.frame_set(1)
        assert in_blender()[-1, 0, 2, 3] > 0.4, shape
        run, _, poses = full_bake(program, folder)
        assert lines(run.shot) == [f"1 object{CENTER}: 'plank'"], lines(run.shot)
        assert poses[-1, -1, 1] < 0 or poses[-1, -1, 3:].min() < -0.1, (shape, poses[-1])


SHAPED = ("BOX", "SPHERE", "CYLINDER", "CAPSULE", "CONE")


def test_bounding_boxes_as_in_blender(program, folder):
    """Shapes of a bounding box have that of the final mesh, whatever the source; parts of compounds, too."""
    for source in ("BASE", "DEFORM", "FINAL"):
        scene = empty(last=40)
        add(cube(1, (0, 0, -0.5)), "PASSIVE", "BOX", "floor").scale = (60, 60, 1)
        things = [add(cube(1, (4 * i, 0, 2)), "ACTIVE", shape, shape, mesh_source=source)
                  for i, shape in enumerate(SHAPED)]
        things += [add(cube(0.1, (24, 0, 2)), "ACTIVE", "COMPOUND", "whole"),
                   add(cube(1, (28, 0, 2)), "ACTIVE", "BOX", "keyed", mesh_source=source),
                   add(cube(1, (32, 0, 2)), "ACTIVE", "BOX", "smooth", mesh_source=source)]
        part = add(cube(1, (24, 0, 2)), "ACTIVE", "BOX", "part", mesh_source=source)
        part.parent, part.matrix_parent_inverse = things[5], things[5].matrix_world.inverted()
        for thing in [*things[:len(SHAPED)], part]:
            modifier = thing.modifiers.new("Solidify", "SOLIDIFY")
            modifier.thickness, modifier.offset, modifier.use_even_offset = 0.4, 1, True
        things[7].modifiers.new("Subdivision", "SUBSURF")
        things[6].shape_key_add(name="Basis")
        large = things[6].shape_key_add(name="Large")
        large.value = 1
        for point in large.data:
            point.co *= 2
        bpy.context.view_layer.update()
        shown = in_blender()[-1, :len(things), 2, 3]
        full_bake(program, folder)
        scene.frame_set(40)
        heights = [thing.matrix_world.translation.z for thing in things]
        # Bullet has a cone, and no other of these, a margin of 40 mm off the floor.
        assert np.abs(np.array(heights) - shown).max() < 0.05, (source, heights, shown)


def compound(name, place, kind="ACTIVE", parts=()):
    """A compound of boxes of 1 m at heights above its origin, by name."""
    whole = add(cube(0.1, place), kind, "COMPOUND", name)
    for part, height in dict(parts).items():
        part = add(cube(1, (place[0], place[1], place[2] + height)), kind, "BOX", part)
        part.parent, part.matrix_parent_inverse = whole, whole.matrix_world.inverted()
    bpy.context.view_layer.update()
    return whole


def test_parts_outside_of_the_world(program, folder):
    """A compound has the parts in the rigid body world's collection alone, as in Blender; others are named."""
    scene = empty(last=30)
    add(cube(1, (0, 0, -0.5)), "PASSIVE", "BOX", "floor").scale = (60, 60, 1)
    things = [compound("whole", (0, 0, 3), parts={"inner": 0, "outer": -1}),
              compound("nested", (5, 0, 3), parts={"flat": 0, "deep": -1})]
    below = compound("below", (5, 0, 2), parts={"lowest": -1})
    below.parent, below.matrix_parent_inverse = things[1], things[1].matrix_world.inverted()
    for name in ("outer", "below"):
        scene.rigidbody_world.collection.objects.unlink(scene.objects[name])
    bpy.context.view_layer.update()
    shown = in_blender()[-1, [1, 4], 2, 3]
    run, _, _ = full_bake(program, folder)
    scene.frame_set(30)
    heights = [thing.matrix_world.translation.z for thing in things]
    assert np.abs(np.array(heights) - shown).max() < 0.02, (heights, shown)
    assert lines(run.shot) == [
        f"1 object{CENTER}: 'nested'",
        "2 objects outside of the rigid body world's collection: left out: 'outer', 'below'",
        "1 object of a compound that is no body of the bake: left out: 'lowest'"], lines(run.shot)


def test_uneven_sizes_are_told(_program, folder):
    """Round shapes of uneven scale and scaled parts of compounds are as one sees them; Blender has them otherwise."""
    empty(last=3)
    things = {}
    for i, (shape, scale) in enumerate((("CYLINDER", (1, 1, 2)), ("CYLINDER", (1, 2, 1)), ("SPHERE", (1, 1, 2)),
                                        ("SPHERE", (-2, 2, 2)), ("CAPSULE", (1, 1, 2)), ("BOX", (1, 2, 3)))):
        thing = add(cube(1, (5 * i, 0, 3)), "ACTIVE", shape, f"{shape} {scale}")
        thing.scale = scale
        things[thing.name] = thing
    whole = add(cube(1, (0, 9, 3)), "ACTIVE", "COMPOUND", "whole")
    whole.scale = (2, 2, 2)
    for name, size in (("even", 1), ("small", 0.5)):
        part = add(cube(1, (0, 0, 0)), "ACTIVE", "BOX", name)
        part.parent, part.scale = whole, (size, size, size)
    bpy.context.view_layer.update()
    shot = export(folder / "scene.json")
    assert lines(shot) == [
        "3 objects with an uneven scale: as wide as the whole mesh, in Blender by the scale of one axis: "
        "'CYLINDER (1, 2, 1)', 'SPHERE (1, 1, 2)', 'CAPSULE (1, 1, 2)'",
        "1 object of a compound with a scale of its own: in this size, where Blender ignores it: 'small'"], lines(shot)
    shapes = {body["name"]: body["shapes"] for body in shot.document["bodies"]}
    assert shapes["SPHERE (1, 1, 2)"][0]["radius"] == 1
    assert [shape["half_extents"] for shape in shapes["whole"]] == [[1, 1, 1], [0.5, 0.5, 0.5]]


def test_linked_baked(program, folder):
    """A baked object of another file is Animated, as Blender shows it, and so are Animated objects below it."""
    empty(last=12)
    crate = add(cube(1, (0, 0, 4)), "ACTIVE", "BOX", "crate")
    below = add(cube(1, (0, 4, 0)), "PASSIVE", "BOX", "below", kinematic=True)
    below.parent = crate
    full_bake(program, folder)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "baked.blend"), check_existing=False)
    scene = empty(last=12)
    add(cube(1, (9, 0, 4)), "ACTIVE", "BOX", "own")
    things = linked_from(folder / "baked.blend", "crate", "below")
    run, document, poses = full_bake(program, folder)
    motions = {body["name"]: (body["motion"], "track" in body) for body in document["bodies"]}
    assert motions == {"own": ("dynamic", False), "crate [baked.blend]": ("kinematic", True),
                       "below [baked.blend]": ("kinematic", True)}, motions
    assert lines(run.shot) == [], lines(run.shot)
    places = poses[:, :, :3] @ UP.T
    for frame in (1, 6, 12):
        scene.frame_set(frame)
        assert np.abs(places[frame - 1, 1] - things[0].matrix_world.translation).max() < 1e-5
    # Blender shows it a frame late.
    assert np.abs(places[:, 2] - places[:, 1] - (0, 4, 0)).max() < 1e-5
