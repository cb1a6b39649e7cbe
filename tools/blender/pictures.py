#!/usr/bin/env python3
"""Renders the five scenes in the middle of their action: python tools/blender/pictures.py --drystone PROGRAM

Bakes each scene of scenes.py with the add-on, or takes finished bakes from a folder (--bakes), such as that of
compare.py. Writes NAME.webp into the folder of the guide's pictures, or another one.

Needs Blender as a module: pip install bpy==5.0.1 pillow (Python 3.11).
"""

import argparse
import math
import sys
import tempfile
from pathlib import Path

import bpy
from mathutils import Vector
from PIL import Image

ROOT = Path(__file__).parent.parent.parent
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "tools")]

import render
import scenes
from drystone import applying, baking

# Beginnings of the names of objects of metal, and of those with sharp edges.
METAL = ("ball", "bob", "link", "ring", "wire", "bar", "crane", "pin")
SHARP = ("ground", "bowl", "ball", "bob", "wire", "mug", "cell")
# Width of the rounded edges. [m]
EDGE = 0.008


def material(metal):
    """Returns a material of the colors of objects."""
    made = bpy.data.materials.new("metal" if metal else "plain")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    surface, info = nodes["Principled BSDF"], nodes.new("ShaderNodeObjectInfo")
    links.new(info.outputs["Color"], surface.inputs["Base Color"])
    surface.inputs["Metallic"].default_value = 0.9 if metal else 0.0
    surface.inputs["Roughness"].default_value = 0.3 if metal else 0.62
    return made


def dress(scene):
    """Gives objects their colors, and the edges of boxes a light of their own."""
    metal, plain = material(True), material(False)
    for thing in scene.objects:
        if thing.type not in ("MESH", "FONT"):
            continue
        if not thing.data.materials:
            thing.data.materials.append(plain)
        thing.material_slots[0].link = "OBJECT"
        thing.material_slots[0].material = metal if thing.name.startswith(METAL) else plain
        if thing.type == "MESH" and not thing.name.startswith(SHARP):
            edge = thing.modifiers.new("edge", "BEVEL")
            edge.width, edge.segments, edge.harden_normals = EDGE, 2, False
        if thing.name.startswith(("bowl", "mug", "ring")):
            thing.data.set_sharp_from_angle(angle=math.radians(40))
            thing.data.polygons.foreach_set("use_smooth", [True] * len(thing.data.polygons))


def camera(view):
    place, target, lens = view
    data = bpy.data.cameras.new("camera")
    data.lens = lens
    made = bpy.data.objects.new("camera", data)
    made.location = place
    made.rotation_euler = (Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(made)
    bpy.context.scene.camera = made


def light():
    """A warm sun from the left and behind the scene, and a cool dim sky: edges and shadows show."""
    made = bpy.context.scene.camera
    for lamp in [thing for thing in bpy.data.objects if thing.type == "LIGHT"]:
        bpy.data.objects.remove(lamp)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.color = 4.2, math.radians(4), (1.0, 0.90, 0.76)
    lamp = bpy.data.objects.new("sun", sun)
    side = made.matrix_world.to_3x3() @ Vector((-1.0, 0, -0.35))
    aim = Vector((side.x, side.y, 0)).normalized() + Vector((0, 0, 0.85))
    lamp.rotation_euler = aim.to_track_quat("Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(lamp)
    background = bpy.context.scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.50, 0.62, 0.80, 1)
    background.inputs["Strength"].default_value = 0.32


def picture(name, arguments, folder):
    stage = scenes.build(name)
    scene = bpy.context.scene
    if arguments.bakes:
        applying.apply(bpy.context, str(arguments.bakes / f"{name}.npz"))
    else:
        baking.Bake(bpy.context, str(arguments.drystone), baking.Options(), folder).finish()
    scene.frame_set(arguments.frame or stage.action)
    dress(scene)
    camera(stage.view)
    render.prepare(arguments)
    light()
    shot = folder / f"{name}.png"
    render.shoot(shot)
    with Image.open(shot) as image:
        image.convert("RGB").save(arguments.output / f"{name}.webp", quality=82, method=6)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drystone", type=Path)
    parser.add_argument("--bakes", type=Path, metavar="FOLDER", help="finished bakes, NAME.npz")
    parser.add_argument("--scene", choices=scenes.SCENES, action="append", help="[default: all]")
    parser.add_argument("--frame", type=int, help="frame to show [default: that of the scene]")
    parser.add_argument("--samples", type=int, default=64, help="samples per pixel [default: 64]")
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720))
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "guide/src/pictures")
    arguments = parser.parse_args()
    if not arguments.drystone and not arguments.bakes:
        parser.error("give --drystone or --bakes")
    arguments.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.scene or scenes.SCENES:
            picture(name, arguments, Path(folder))


if __name__ == "__main__":
    main()
