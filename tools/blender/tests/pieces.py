"""Tests of convex pieces: shown over objects, used by bakes, and stale once a mesh changes."""

import json

import bpy
import numpy as np
from drystone import baking, cutting, masses, operators, panel, pieces
from drystone.shapes import CENTER as ORIGIN
from drystone.space import rigid, unturned
from mathutils import Vector

from .common import DOWN, add, block, export, full_bake, lines, stage
from .packaging import drawn

OUTLINE = [(0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 2), (0, 2)]
# Center of its area: of the lower arm of 1 m^2, and the rest of the upper one.
CENTER = np.array([1 * 1 + 0.75 * 0.25, 1 * 0.25 + 0.75 * 1.25]) / 1.75


def bracket(name, place=(0, 0, 0), **more):
    """An angle bracket that is active and collides by its mesh."""
    points = [(x, y, z) for z in (0, 1) for x, y in OUTLINE]
    faces = [(5, 4, 3, 2, 1, 0), (6, 7, 8, 9, 10, 11)]
    faces += [(i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6) for i in range(6)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.rigidbody.object_add(type="ACTIVE")
    thing.rigid_body.collision_shape, thing.location = "MESH", place
    for key, value in more.items():
        setattr(thing, key, value)
    bpy.context.view_layer.update()
    return thing


def cut(program, folder, names=()):
    work = cutting.Cutting(bpy.context, program, baking.Options(), folder, names)
    work.finish()
    return work


def body_of(shot, name):
    return next(body for body in shot.document["bodies"] if body["name"] == name)


def test_solids(_program, _folder):
    """Volumes, centers and moments of all shapes, beside the formulas of the books."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-2, 2) for z in (-0.5, 0.5)], float)
    hull, box = masses.of_hull(corners + [3, 4, 5]), masses.of_box(1, 2, 0.5)
    assert np.isclose(hull.volume, 8) and np.allclose(hull.center, [3, 4, 5])
    assert np.allclose(hull.inertia, box.inertia) and np.allclose(np.diag(box.inertia), 8 / 12 * np.array(
        [16 + 1, 4 + 1, 4 + 16]))
    halves = [masses.of_box(0.5, 2, 0.5).placed(np.array([x, 0, 0]), (0, 0, 0, 1)) for x in (-0.5, 0.5)]
    assert np.allclose(masses.joined(halves).inertia, box.inertia)
    long, ball = masses.of_capsule(0.5, 1e-9), masses.of_sphere(0.5)
    assert np.allclose(long.inertia, ball.inertia) and np.isclose(long.volume, ball.volume)
    keys = masses.mass_keys([box], 2)
    assert np.allclose(sorted(keys["inertia"]), np.sort(np.diag(box.inertia)) / 4)


def test_pieces_are_used(program, folder):
    """A bake has the pieces that are shown, with the masses of the mesh; scaled and turned objects too."""
    scene = stage(DOWN, 24)
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=30), "PASSIVE", "BOX", "ground")
    first = bracket("bracket", (0, 0, 3))
    bracket("other", (5, 0, 3), scale=(-1, 2, 0.5), rotation_euler=(0.4, 0.3, 0.2))
    block("crate", (9, 0, 3))
    before = export(folder / "before.json")
    assert [shape["type"] for shape in body_of(before, "bracket")["shapes"]] == ["trimesh"]
    work = cut(program, folder)
    assert work.said[0].startswith("2 objects as 4 pieces, up to 0.0"), work.said
    bpy.context.view_layer.update()
    overlay = pieces.overlay_of(first)
    assert overlay.parent == first and overlay.display_type == "WIRE" and overlay.hide_render
    assert bpy.data.collections[pieces.COLLECTION] in overlay.users_collection
    assert np.allclose(np.array(overlay.matrix_world), np.array(first.matrix_world))
    shot = export(folder / "after.json")
    assert lines(shot) == lines(before), lines(shot)
    for name in ("bracket", "other"):
        thing, body = scene.objects[name], body_of(shot, name)
        assert [shape["type"] for shape in body["shapes"]] == ["convex_hull"] * 2
        center = thing.matrix_world @ Vector((*CENTER, 0.5))
        shown = body_center(thing, body)
        assert np.allclose(shown, center, atol=1e-5), (name, shown, center)
        solid = masses.solid_of(body_of(before, name)["shapes"][0])
        assert np.allclose(np.sort(body["inertia"]), np.sort(np.linalg.eigvalsh(solid.inertia)) / solid.volume)
    _, _, poses = full_bake(program, folder)
    # The same masses and nearly the same surfaces as without pieces shown.
    bpy.data.objects.remove(overlay)
    bpy.data.objects.remove(pieces.overlay_of(scene.objects["other"]))
    _, _, again = full_bake(program, folder)
    off = np.abs(again[:18, :, :3] - poses[:18, :, :3]).max()
    print(f"pieces: with shown pieces, up to the impact {off * 1e3:.4f} mm off those that Drystone cuts itself")
    assert off < 1e-3


def body_center(thing, body):
    """Center of mass of a body in the world of Blender."""
    return rigid(thing) @ Vector(unturned(body["center_of_mass"]))


def test_stale_pieces(program, folder):
    """A mesh that changes makes its pieces stale: said, cut anew for the bake, and renewed by a button."""
    import drystone

    scene = stage(DOWN, 12)
    thing, _ = bracket("bracket", (0, 0, 3)), bracket("same", (5, 0, 3))
    cut(program, folder)
    thing.scale = (1, 1, 3)
    bpy.context.view_layer.update()
    assert lines(export(folder / "a.json")) == [f"2 objects{ORIGIN}: 'bracket', 'same'"]
    thing.data.vertices[0].co.z -= 0.5
    thing.data.update()
    shot = export(folder / "a.json")
    assert f"1 object{pieces.STALE}: 'bracket'" in lines(shot), lines(shot)
    assert body_of(shot, "bracket")["shapes"][0]["type"] == "trimesh"
    assert len(body_of(shot, "same")["shapes"]) == 2
    drystone.register()
    preference, operators.preference = operators.preference, lambda _context: program
    try:
        scene.drystone.cache = str(folder)
        assert bpy.ops.drystone.check() == {"FINISHED"}
        assert "Renew" in drawn(panel.Before, width=2000)
        assert bpy.ops.drystone.pieces(names=json.dumps(["bracket"])) == {"FINISHED"}
        overlay = pieces.overlay_of(thing)
        assert len(thing.children) == 1 and overlay[pieces.MESH_HASH] == pieces.shown_pieces(thing)[0]
        assert not any(pieces.STALE in line for line in lines(export(folder / "a.json")))
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "shot.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(folder / "shot.blend"))
        shapes = body_of(export(folder / "a.json"), "bracket")["shapes"]
        assert len(shapes) > 1 and all(shape["type"] == "convex_hull" for shape in shapes)
    finally:
        operators.preference = preference
        drystone.unregister()


def test_nothing_to_cut(program, folder):
    stage(DOWN, 12)
    block("crate", (0, 0, 3))
    try:
        cut(program, folder)
        assert False, "cut a box"
    except ValueError as error:
        assert str(error).startswith("Pieces are of active objects of the shape Mesh"), error
