"""Tests of findings: nothing of a scene is dropped without a word, and odd bodies do not stop a shot."""

import json
import math
import re
from pathlib import Path

import bpy
import numpy as np
from drystone import baking, binary, exporting
from drystone.findings import Finding, Findings, counted

from .common import (DOWN, UP, add, block, constrain, cube, empty, export, full_bake, heap, in_blender,
                     limits, lines, stage)

# A binary that knows all keys.
ALL = exporting.Abilities(start_asleep=True, force=True, release=True, world_track=True)


def exported(abilities=exporting.Abilities()):
    bpy.context.view_layer.update()
    return exporting.export(bpy.context, abilities)


def body_of(shot, name):
    return next(body for body in shot.document["bodies"] if body["name"] == name)


def mesh(name, vertices, faces, kind="ACTIVE", shape="CONVEX_HULL"):
    """An object of a mesh with a rigid body."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.rigidbody.object_add(type=kind)
    thing.rigid_body.collision_shape = shape
    return thing


def test_words(_program, _folder):
    assert [counted(1, "body"), counted(2, "body"), counted(3, "open mesh"), counted(0, "object")] == [
        "1 body", "2 bodies", "3 open meshes", "0 objects"]
    many = Finding("CHANGED", "object", " without faces: left out", [f"o{i}" for i in range(12)])
    assert many.line() == "12 objects without faces: left out"
    assert many.sentence().endswith("'o9' and 2 more")


CARD = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def odd_bodies():
    """Bodies of which each would stop a bake, and two that are sound."""
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=20), "PASSIVE", "BOX", "ground")
    block("crate", (0, 0, 2))
    for i, shape in enumerate(("CONVEX_HULL", "MESH", "BOX", "SPHERE", "CYLINDER")):
        thing = mesh(f"card {shape}", CARD, [(0, 1, 2, 3)], shape=shape)
        thing.location, thing.rotation_euler = (3 * i, 4, 2), (1, 0.3, 0)
    mesh("wall", [(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (0, 0.5, 1.5)], [(0, 1, 2, 3)], "PASSIVE")
    mesh("needle", [(0, 0, 0), (0, 0, 1), (0, 0, 2)], []).location = (0, -9, 1)
    mesh("empty", [], [])
    mesh("point", [(0, 0, 0)], [])
    mesh("faceless", [(0, 0, 0), (1, 0, 0), (0, 1, 1), (1, 1, 2)], [], shape="MESH").location = (0, -6, 5)
    mesh("doubled", [*CARD], [(0, 1, 2, 3), (3, 2, 1, 0)], shape="MESH").location = (0, 9, 5)
    mesh("nowhere", CARD, [(0, 1, 2, 3)]).location.x = math.nan
    mesh("crushed", CARD, [(0, 1, 2, 3)]).scale = (0, 0, 0)
    mesh("hollow", CARD, [(0, 1, 2, 3)], shape="COMPOUND")
    corner = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    mesh("open", corner, [(0, 1, 2), (0, 1, 3)], shape="MESH").location = (-5, 0, 4)


def test_odd_bodies_do_not_stop_a_shot(program, folder):
    """All that has no shape is left out by name; flat things get a thickness; the rest is baked."""
    scene = empty(last=12)
    odd_bodies()
    constrain("FIXED", scene.objects["crate"], scene.objects["empty"], name="glue")
    run, document, _ = full_bake(program, folder)
    said = lines(run.shot)
    for line in ("1 object without a mesh: left out: 'empty'",
                 "1 object without faces: left out: 'faceless'",
                 "1 object without parts: left out: 'hollow'",
                 "1 active open mesh: solid as the convex hull: 'open'",
                 "1 constraint of an object that is no body of the bake: left out: 'glue'"):
        assert line in said, (line, said)
    sizeless = next(of for of in run.shot.findings if "without a size" in of.text)
    assert sizeless.names == ["nowhere", "crushed", "point"], sizeless
    flat = next(of for of in run.shot.findings if of.noun == "flat object")
    assert flat.names == ["card CONVEX_HULL", "card MESH", "card BOX", "card CYLINDER", "wall", "needle",
                          "doubled"], flat
    assert len(document["bodies"]) == 11 and set(run.shot.channels) == {
        body["name"] for body in document["bodies"]} - {"ground", "wall"}
    points = np.array(body_of(run.shot, "card CONVEX_HULL")["shapes"][0]["points"])
    assert 0.0099 < np.ptp(points, axis=0).min() < 0.0142, np.ptp(points, axis=0)
    print(f"findings: {len(document['bodies'])} of 18 odd bodies are baked; {len(said)} remarks")


def test_refused_bodies_are_named(program, folder):
    """A body that drystone refuses is left out by name, with the reason."""
    empty(last=12)
    block("crate", (0, 0, 2))
    block("heavy", (4, 0, 2), mass=1)
    wall = block("wall", (8, 0, 0), "PASSIVE")
    constrain("FIXED", bpy.data.objects["heavy"], wall, name="glue")
    run = baking.Bake(bpy.context, program, baking.Options(), folder)
    body_of(run.shot, "heavy")["mass"] = -1
    run.finish()
    found = {of.text: of for of in run.shot.findings}
    assert found[" that Drystone refuses: left out"].names == ["heavy"]
    assert found[" that Drystone refuses: left out"].detail.startswith("mass of body 'heavy' is -1")
    assert found[" of an object that is no body of the bake: left out"].names == ["glue"]
    assert run.said[0] == "1 body baked" and run.error == ""
    run = baking.Bake(bpy.context, program, baking.Options(), folder)
    shape = body_of(run.shot, "crate")["shapes"][0]
    corners = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    shape.update({"type": "trimesh", "vertices": corners, "triangles": []})
    del shape["half_extents"]
    run.finish()
    found = {of.text: of for of in run.shot.findings}
    assert found[" with an unusable mesh: solid as the convex hull"].names == ["crate"]
    assert body_of(run.shot, "crate")["shapes"][0]["type"] == "convex_hull" and "2 bodies" in run.said[0]


def test_problems_name_objects(program, folder):
    """Findings of `drystone check` name objects, never a file."""
    empty(last=12)
    block("lower", (0, 0, 0.5))
    block("upper", (0, 0, 1.2))
    block("third", (0, 0, 1.8))
    run, _, _ = full_bake(program, folder)
    overlap = next(of for of in run.shot.findings if of.kind == "PROBLEM")
    assert overlap.line() == "3 objects in overlap at the start: pushed apart", lines(run.shot)
    assert {"lower", "upper", "third"} == set(overlap.names), overlap
    assert str(folder) not in overlap.detail and ".json" not in overlap.detail and "mm" in overlap.detail
    assert not any(str(folder) in line or ".json" in line for line in run.said), run.said


def test_many_problems(program, folder):
    """Words of the program fit, however many: a full pipe does not stop it."""
    scene = heap(400, last=2)
    for i, thing in enumerate(thing for thing in scene.objects if thing.name != "ground"):
        thing.name, thing.location = f"a rather long name of a crate in a row of crates {i}", (i * 0.2, 0, 9)
    bpy.context.view_layer.update()
    run, _, _ = full_bake(program, folder)
    overlap = next(of for of in run.shot.findings if of.kind == "PROBLEM")
    assert len(overlap.names) == 400


def everything():
    """A scene with all that a bake does not take over, or has otherwise."""
    scene = empty(last=12)
    world = scene.rigidbody_world
    block("crate", (0, 0, 3))
    world.collection.objects.unlink(block("outside", (5, 0, 3)))
    block("hidden", (10, 0, 3)).hide_viewport = True
    excluded = bpy.data.collections.new("excluded")
    scene.collection.children.link(excluded)
    thing = block("excluded", (15, 0, 3))
    scene.collection.objects.unlink(thing)
    excluded.objects.link(thing)
    bpy.context.view_layer.layer_collection.children["excluded"].exclude = True
    block("slippery", (20, 0, 3)).rigid_body.keyframe_insert("friction", frame=1)
    thing = block("grows", (25, 0, 3))
    thing.keyframe_insert("scale", frame=1)
    block("soft", (30, 0, 3), use_margin=True, collision_margin=0.1).rigid_body.use_deform = True
    block("cloth", (35, 0, 3)).modifiers.new("Cloth", "CLOTH")
    block("jelly", (40, 0, 3)).modifiers.new("Jelly", "SOFT_BODY")
    block("dust", (45, 0, 3)).modifiers.new("Dust", "PARTICLE_SYSTEM")
    thing = block("slides", (50, 0, 3), "PASSIVE")
    for frame, place in ((12, (50, 1, 3)), (1, (50, 0, 3))):
        thing.location = place
        thing.keyframe_insert("location", frame=frame)
    follower = block("follows", (51, 0, 9), "PASSIVE").constraints.new("CHILD_OF")
    follower.target = thing
    block("does not", (52, 0, 9), "PASSIVE").keyframe_insert("location", frame=1)
    thing.rigid_body.keyframe_insert("kinematic", frame=1)
    block("asleep", (55, 0, 3), use_deactivation=True, use_start_deactivated=True)
    for kind in ("TURBULENCE", "WIND"):
        bpy.ops.object.effector_add(type=kind, location=(0, 50, 0))
        bpy.context.object.name = kind.lower()
    scene.keyframe_insert("gravity", frame=1)
    scene.keyframe_insert("rigidbody_world.solver_iterations", frame=1)
    return scene


SAID = [
    "1 force field other than steady wind: left out: 'turbulence'",
    "1 wind: not known to this version of drystone: 'wind'",
    "1 object with Start Deactivated: not known to this version of drystone: 'asleep'",
    "2 passive objects moved but not Animated: still: 'slides', 'follows'",
    "1 passive object with keys of Animated: as at the first frame: 'slides'",
    "1 object outside of the rigid body world's collection: left out: 'outside'",
    "2 objects hidden or excluded: part of the bake, as in Blender: 'hidden', 'excluded'",
    "1 object with keys of rigid body settings: the values at the first frame hold: 'slippery'",
    "1 object with keys of scale: of the size at the first frame: 'grows'",
    "1 object with a mesh that deforms: of the shape at the first frame: 'soft'",
    "1 object with a collision margin: without margin: 'soft'",
    "1 object with cloth: without effect on the bake: 'cloth'",
    "1 object with soft body: without effect on the bake: 'jelly'",
    "1 object with particles: without effect on the bake: 'dust'",
    "1 scene with keys of Speed or gravity: not known to this version of drystone: 'Scene'",
    "1 scene with keys of rigid body world settings: the values at the first frame hold: 'Scene'",
]


def test_everything_is_said(_program, _folder):
    """One line for each kind, once; lines on missing keys vanish with a program that knows them."""
    everything()
    said = lines(exported())
    assert sorted(said) == sorted(SAID), set(said) ^ set(SAID)
    shot = exported(ALL)
    assert sorted(lines(shot)) == sorted(line for line in SAID if "this version" not in line)
    assert all("force" in body_of(shot, name) for name in ("asleep", "crate"))
    bpy.data.objects["wind"].field.strength = 0
    shot = exported(ALL)
    assert body_of(shot, "asleep")["start_asleep"] and "start_asleep" not in body_of(shot, "crate")


def test_world_as_in_blender(program, folder):
    """Speed, gravity weight and damping move a body as in Blender."""
    for settings in ({"time_scale": 0.5}, {"gravity": 0.5}, {"all": 0.25}, {"time_scale": 2.0}):
        scene = stage(DOWN, 20)
        world = scene.rigidbody_world
        for key, value in settings.items():
            setattr(world if hasattr(world, key) else world.effector_weights, key, value)
        block("crate", (0, 0, 3))
        shown = in_blender()[-1, 0, 2, 3]
        _, _, poses = full_bake(program, folder)
        off = abs(poses[-1, 0, 1] - shown)
        print(f"findings: {settings}: fallen {3 - shown:.3f} m, off Blender by {off * 1e3:.2f} mm")
        assert off < 0.02 * (3 - shown) and 3 - shown > 0.1


def test_wind_as_in_blender(program, folder):
    """A wind pushes with strength / frame rate, and drags with its flow."""
    for strength, flow, mass in ((50, 0, 1), (50, 1, 1), (200, 0.5, 3)):
        scene = stage((0, 0, 0), 25)
        bpy.ops.object.effector_add(type="WIND", rotation=(0.4, math.pi / 2, 0.3))
        field = bpy.context.object.field
        field.strength, field.flow = strength, flow
        scene.rigidbody_world.effector_weights.wind = 0.5
        block("crate", (0, 0, 3), mass=mass)
        shown = in_blender()[:, 0, :3, 3]
        scene.frame_set(1)
        shot = exported(ALL)
        body = body_of(shot, "crate")
        rate, times = body["linear_damping"], np.arange(25) / 24
        force = UP @ body["force"] / mass
        fallen = times**2 / 2 if rate == 0 else (times - (1 - np.exp(-rate * times)) / rate) / rate
        off = np.abs(shown - shown[0] - fallen[:, None] * force).max()
        moved = np.abs(shown - shown[0]).max()
        print(f"findings: wind of {strength} and flow {flow} moves {mass} kg by {moved:.3f} m, off by "
              f"{off * 1e3:.2f} mm")
        assert off < 0.02 * moved and moved > 0.1
        _, _, poses = full_bake(program, folder)
        assert np.abs(poses[:, 0, :3] @ UP.T - shown).max() < 0.02 * moved


def test_sources_and_compounds(_program, _folder):
    """Deforming sources leave out modifiers that make vertices; compounds in compounds are flat."""
    empty(last=12)
    for i, source in enumerate(("BASE", "DEFORM", "FINAL")):
        thing = add(cube(1, (4 * i, 0, 2)), "ACTIVE", "CONVEX_HULL", source, mesh_source=source)
        thing.modifiers.new("Cast", "CAST").factor = 0
        thing.modifiers["Cast"].use_x = True
        displace = thing.modifiers.new("Displace", "DISPLACE")
        displace.direction, displace.strength = "X", 1.0
        thing.modifiers.new("Array", "ARRAY").count = 3
    outer = add(cube(0.3, (0, 5, 2)), "ACTIVE", "COMPOUND", "outer")
    inner = add(cube(0.3, (1, 5, 2)), "ACTIVE", "COMPOUND", "inner")
    inner.parent, inner.matrix_parent_inverse = outer, outer.matrix_world.inverted()
    leaves = [add(cube(0.3, (x, 5, 2)), "ACTIVE", "BOX", f"leaf {x}") for x in (1, 2)]
    bpy.context.view_layer.update()
    for leaf, parent in zip(leaves, (outer, inner)):
        leaf.parent, leaf.matrix_parent_inverse = parent, parent.matrix_world.inverted()
    constrain("POINT", block("wall", (0, 9, 0), "PASSIVE"), leaves[1], name="hinge")
    shot = exported()
    along = [np.array(body_of(shot, name)["shapes"][0]["points"])[:, 0] for name in ("BASE", "DEFORM", "FINAL")]
    ranges = [(points.min(), points.max()) for points in along]
    assert np.allclose(ranges, [(-0.5, 0.5), (0, 1), (0, 3)]), ranges
    assert bpy.data.objects["DEFORM"].modifiers["Array"].show_viewport
    assert len(body_of(shot, "outer")["shapes"]) == 2
    assert np.allclose([shape["position"][0] for shape in body_of(shot, "outer")["shapes"]], [2, 1])
    assert shot.document["joints"][0]["bodies"] == ["outer", "wall"]
    assert "inner" not in {body["name"] for body in shot.document["bodies"]}


def test_exports_leave_a_scene_as_it_is(_program, folder):
    """Frame, world and modifiers stay, also after an error."""
    scene = everything()
    scene.frame_set(7)
    members = len(scene.rigidbody_world.collection.objects)
    export(folder / "a.json")
    assert scene.frame_current == 7 and scene.rigidbody_world.enabled
    assert len(scene.rigidbody_world.collection.objects) == members
    own = exporting.JointExporter
    exporting.JointExporter = lambda *_: 1 / 0
    try:
        export(folder / "b.json")
        assert False, "no error"
    except ZeroDivisionError:
        pass
    finally:
        exporting.JointExporter = own
    assert scene.frame_current == 7 and scene.rigidbody_world.enabled
    assert len(scene.rigidbody_world.collection.objects) == members
    assert json.loads((folder / "a.json").read_text())["bodies"]


def test_without_a_mass(program, folder):
    """A body whose mass is no positive number keeps its place, as in Blender, and is named."""
    scene = stage(DOWN, 12)
    block("crate", (0, 0, 3))
    for i, mass in enumerate((0, -1, math.nan, math.inf)):
        block(f"odd {i}", (4 + 3 * i, 0, 3), mass=mass)
    assert np.allclose(in_blender()[-1, 1, :3, 3], (4, 0, 3))
    run, document, _ = full_bake(program, folder)
    assert [body["motion"] for body in document["bodies"]] == ["dynamic"] + 4 * ["static"]
    assert lines(run.shot) == ["4 objects without a positive mass: moved by keys alone, as in Blender: "
                               "'odd 0', 'odd 1', 'odd 2', 'odd 3'"], lines(run.shot)
    assert "drystone" not in scene.objects["odd 0"]


def test_any_number_of_odd_bodies(program, folder):
    """However many bodies and meshes drystone refuses, the others are baked; one line counts each kind."""
    scene = heap(61, last=3)
    thin = bpy.data.meshes.new("thin")
    thin.from_pydata([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 0, 1e-3)], [], [(0, 1, 2)])
    bpy.ops.object.select_all(action="DESELECT")
    walls = [bpy.data.objects.new(f"wall {i}", thin) for i in range(30)]
    for i, wall in enumerate(walls):
        wall.location = (4 * i, 20, 2)
        scene.collection.objects.link(wall)
        wall.select_set(True)
    bpy.context.view_layer.objects.active = walls[0]
    bpy.ops.rigidbody.objects_add(type="PASSIVE")
    for wall in walls:
        wall.rigid_body.collision_shape = "MESH"
    for i in range(1, 61):
        scene.objects[f"thing {i}"].location.z = 1e30
    bpy.context.view_layer.update()
    run, _, _ = full_bake(program, folder)
    assert run.said[0] == "1 body baked", run.said
    found = {of.text: len(of.names) for of in run.shot.findings}
    # The hulls of the walls are as thin as their meshes.
    assert found == {" that Drystone refuses: left out": 90, ": solid below, so that nothing falls through": 1}, found


def test_speed_is_named(_program, _folder):
    """A time of a frame that Drystone refuses is told as the setting of Blender that makes it."""
    scene = stage(DOWN, 3)
    block("crate", (0, 0, 3))
    for speed in (0, 50):
        scene.rigidbody_world.time_scale = speed
        try:
            exported()
            assert False, f"a speed of {speed}"
        except ValueError as error:
            assert str(error) == (f"Speed of the rigid body world is {speed}; accepted: from 2.4e-05 to 24 at 24 "
                                  "frames per second"), error


def test_wind_of_a_body(program, folder):
    """A body with a wind of its own pushes all others, and not itself, as in Blender."""
    scene = stage((0, 0, 0), 25)
    block("fan", (0, 0, 0))
    bpy.ops.object.forcefield_toggle()
    field = bpy.context.object.field
    field.type, field.strength, field.flow = "WIND", 200, 1
    block("crate", (0, 5, 0))
    scene.frame_set(1)
    shown = in_blender()[:, :, :3, 3]
    run, _, poses = full_bake(program, folder)
    off = np.abs(poses[:, :, :3] @ UP.T - shown).max(axis=(0, 2))
    assert np.ptp(shown[:, 0], axis=0).max() < 1e-6 and np.ptp(shown[:, 1], axis=0).max() > 2, np.ptp(shown, axis=0)
    assert (off < 0.02).all(), off
    assert lines(run.shot) == ["1 wind of a body that the simulation moves: as at the first frame: 'fan'"]


def test_wind_wakes(program, folder):
    """Bodies that start deactivated are awake in a wind, as in Blender; one that only drags leaves them asleep."""
    for strength, flow, moves in ((100, 0, True), (100, 1, True), (0, 1, False)):
        scene = stage((0, 0, 0), 25)
        bpy.ops.object.effector_add(type="WIND")
        bpy.context.object.field.strength, bpy.context.object.field.flow = strength, flow
        block("asleep", (0, 0, 0), use_deactivation=True, use_start_deactivated=True)
        scene.frame_set(1)
        shown = in_blender()[-1, 0, 2, 3]
        run, document, poses = full_bake(program, folder)
        assert (shown > 1) == moves == ("start_asleep" not in document["bodies"][0]), (strength, flow, shown)
        assert abs(poses[-1, 0, 1] - shown) < 0.02 and lines(run.shot) == [], (poses[-1, 0, 1], shown)


def placed(name, parent=None, **channels):
    """An empty with keys of channels: values at the first frame and at frame 12."""
    thing = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(thing)
    thing.parent = parent
    for path, values in channels.items():
        for frame, value in zip((1, 12), values):
            setattr(thing, path, value)
            thing.keyframe_insert(path, frame=frame)
    return thing


def test_moved_without_own_keys(_program, _folder):
    """A passive object is told to move whoever moves it, and not if nothing does."""
    scene = stage(DOWN, 12)
    block("crate", (0, 0, 3))
    bpy.ops.curve.primitive_bezier_circle_add(radius=3)
    path = bpy.context.object
    path.data.use_path, path.data.path_duration = True, 12
    for frame in (1, 12):
        path.data.eval_time = frame - 1
        path.data.keyframe_insert("eval_time", frame=frame)
    block("on a path", (0, 9, 0), "PASSIVE").parent = path
    block("at rest", (0, 18, 0), "PASSIVE").parent = placed("still")
    scene.frame_set(1)
    assert lines(exported()) == ["1 passive object moved but not Animated: still: 'on a path'"]


def test_sizes_of_others(_program, _folder):
    """A size that keys of a parent or a constraint make is told as what it is."""
    scene = stage(DOWN, 12)
    block("crate", (0, 0, 9))
    grows = placed("grows", scale=((1, 1, 1), (1, 1, 6)))
    block("child", (0, 0, 0), "PASSIVE", kinematic=True).parent = grows
    block("copy", (9, 0, 0), "PASSIVE", kinematic=True).constraints.new("COPY_SCALE").target = grows
    double = placed("double")
    double.scale = (2, 2, 2)
    block("doubled", (18, 0, 9)).constraints.new("COPY_SCALE").target = double
    scene.frame_set(1)
    assert lines(exported()) == [
        "1 object sized by a constraint, off while baked: simulated in that size, shown in its own: 'doubled'",
        "2 objects sized by a parent or a constraint: of the size at the first frame: 'child', 'copy'",
        "1 object with object constraints: off while baked: 'doubled'"], lines(exported())


def test_wind_that_blows(_program, _folder):
    """Wind acts as in Blender: also if the eye hides it, not if it is disabled or excluded; turns are told."""
    def disabled(wind):
        wind.hide_viewport = True

    def excluded(wind):
        collection = bpy.data.collections.new("winds")
        bpy.context.scene.collection.children.link(collection)
        collection.objects.link(wind)
        bpy.context.scene.collection.objects.unlink(wind)
        bpy.context.view_layer.layer_collection.children["winds"].exclude = True

    def turning(wind):
        wind.parent = placed("turns", rotation_euler=((0, 0, 0), (0, 0, 3)))

    told = ["1 wind turned by a parent or a constraint: as at the first frame: 'wind'"]
    for change, blows, said in ((lambda wind: wind.hide_set(True), True, []), (disabled, False, []),
                                (excluded, False, []), (turning, True, told)):
        scene = stage((0, 0, 0), 12)
        block("crate", (0, 0, 3))
        bpy.ops.object.effector_add(type="WIND", rotation=(0, math.pi / 2, 0))
        wind = bpy.context.object
        wind.name, wind.field.strength, wind.field.flow = "wind", 200, 0
        change(wind)
        moved = np.abs(np.ptp(in_blender()[:, 0, :3, 3], axis=0)).max() > 0.1
        scene.frame_set(1)
        shot = exported(ALL)
        assert moved == ("force" in body_of(shot, "crate")) == blows and lines(shot) == said, (moved, lines(shot))


def test_off_the_origin(_program, _folder):
    """A shape lies around its mesh, where Blender has it around the origin: this is told."""
    stage(DOWN, 3)
    for vertex in block("crate", (0, 0, 3)).data.vertices:
        vertex.co.z += 0.3
    block("even", (4, 0, 3))
    shot = exported()
    assert np.allclose(body_of(shot, "crate")["shapes"][0]["position"], (0, 0.3, 0))
    assert lines(shot) == ["1 object with a mesh off its origin: the shape is around the mesh, in Blender around the "
                           "origin: 'crate'"], lines(shot)


def test_all_kinds_have_phrases(_program, _folder):
    """Every kind of finding of `drystone check` has a phrase of its own."""
    source = (Path(__file__).parents[3] / "crates/bake/src/check.rs").read_text()
    kinds = re.findall(r"Self::(\w+),", source[source.index("const ALL"):source.index("];")])
    words = {re.sub(r"(?<!^)(?=[A-Z])", "_", kind).lower() for kind in kinds}
    assert len(words) > 20 and words == {*binary.KINDS, "left_out"}, words ^ {*binary.KINDS, "left_out"}
    assert len(set(binary.KINDS.values())) == len(binary.KINDS)


def checked(program, folder):
    """Returns the findings of a check, with their details."""
    bpy.context.view_layer.update()
    work = baking.Check(bpy.context, program, baking.Options(), folder)
    work.finish()
    return [(of.line(), of.names, of.detail) for of in work.shot.findings]


def test_remarks_of_the_reader(program, folder):
    """Remarks on values have the name of the object or constraint, a phrase of their own, and no path."""
    free, angle = {}, limits(ang_x=(-1, 1), ang_y=(-1.7, 1.7))
    phrases = (("without limits, springs and motors: joins nothing", free),
               ("with a limit beyond the largest value of its angle", angle))
    for phrase, settings in phrases:
        stage(DOWN, 3)
        wall, crate = block("wall", (0, 0, 0.5), "PASSIVE"), block("crate", (0, 0, 2))
        constrain("FIXED", crate, block("lid", (0, 0, 4)), name="glue")
        constrain("GENERIC", wall, crate, name="odd", **settings)
        found = checked(program, folder)
        assert [found[0][0], found[0][1]] == [f"1 constraint {phrase}", ["odd"]], found
        assert len(found) == 1 and "joint 'odd'" in found[0][2] and "/joints" not in found[0][2], found
        run, _, _ = full_bake(program, folder)
        assert not any("/joints" in line for line in run.said), run.said


def test_remarks_without_a_phrase(_program, _folder):
    """A remark that nobody foresaw names what it is about, too."""
    document = {"name": "Scene", "bodies": [{"name": "crate"}], "joints": [{"name": "odd"}]}
    for path, noun, name in (("/bodies/0/mass", "object", "crate"), ("/joints/0", "constraint", "odd"),
                             ("/solver/sor", "scene", "Scene"), ("/bodies/7", "scene", "Scene")):
        found = Findings()
        what = {"kind": "left_out", "names": [], "what": f"{path}: it is odd", "advice": "look"}
        binary.add_problems(found, json.dumps({"findings": [what]}), document)
        finding, = found
        assert finding.sentence() == f"1 {noun} with a value that acts otherwise, or not at all: '{name}'"
        assert finding.detail == "it is odd; look"


def push_down(thing, in_meta):
    """Makes the action of an object a strip, which may lie in a meta strip."""
    data = thing.animation_data
    action, slot = data.action, data.action_slot
    data.action = None
    track = data.nla_tracks.new()
    strip = track.strips.new("strip", 1, action)
    strip.action_slot, strip.select, track.select = slot, True, True
    if in_meta:
        window = bpy.context.window_manager.windows[0]
        area = window.screen.areas[0]
        before, area.type = area.type, "NLA_EDITOR"
        region = next(of for of in area.regions if of.type == "WINDOW")
        for other in bpy.context.view_layer.objects:
            other.select_set(other == thing)
        with bpy.context.temp_override(window=window, area=area, region=region):
            bpy.ops.nla.meta_add()
        area.type = before
        assert [of.type for of in track.strips] == ["META"]


def test_keys_in_strips(_program, _folder):
    """Keys in strips are named, also those within meta strips."""
    def keyed(thing, key, values):
        for frame, value in zip((1, 10), values):
            setattr(thing.rigid_body if key != "scale" else thing, key, value)
            (thing.rigid_body if key != "scale" else thing).keyframe_insert(key, frame=frame)

    told = {"scale": "1 object with keys of scale: of the size at the first frame: 'crate'",
            "friction": "1 object with keys of rigid body settings: the values at the first frame hold: 'crate'",
            "kinematic": "1 object held by keys after a release: free from there on: 'crate'"}
    values = {"scale": ((1, 1, 1), (2, 2, 2)), "friction": (1, 0.2), "kinematic": (False, True)}
    for key, line in told.items():
        for in_meta in (False, True):
            scene = empty(last=20)
            crate = block("crate", (0, 0, 3))
            keyed(crate, key, values[key])
            push_down(crate, in_meta)
            scene.frame_set(1)
            assert lines(exported(ALL)) == [line], (key, in_meta, lines(exported(ALL)))


def test_constraints_of_parts(_program, _folder):
    """Object constraints act on a part of a compound, which gets no keys; on the compound they are off."""
    stage(DOWN, 3)
    whole = add(cube(0.1, (0, 0, 3)), "ACTIVE", "COMPOUND", "whole")
    for name, x in (("left", -1), ("right", 1)):
        part = block(name, (x, 0, 3))
        part.parent, part.matrix_parent_inverse = whole, whole.matrix_world.inverted()
    part.constraints.new("LIMIT_LOCATION")
    assert lines(exported()) == []
    whole.constraints.new("LIMIT_LOCATION")
    assert lines(exported()) == ["1 object with object constraints: off while baked: 'whole'"]
