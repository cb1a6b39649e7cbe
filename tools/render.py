#!/usr/bin/env python3
"""Renders a frame of an animated glTF: python tools/render.py IN.glb OUT.png [--frame N]

Or many as one moving picture: python tools/render.py IN.glb OUT.webp --frames 0 120 3

The moving picture of the README is the workshop with --fps 30 --frames 6 126 3 --samples 12 --size 560 315.

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


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--frame", type=int, help="frame to show [default: the last]")
    parser.add_argument("--frames", type=int, nargs=3, metavar=("FIRST", "LAST", "STEP"),
                        help="frames of a moving picture, which plays at the speed of the scene")
    parser.add_argument("--fps", type=float, default=60.0, help="frames per second [default: 60]")
    parser.add_argument("--samples", type=int, default=48, help="samples per pixel [default: 48]")
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720))
    parser.add_argument("--view", type=float, nargs=3, metavar=("AZIMUTH", "HEIGHT", "DISTANCE"),
                        default=(35.0, 18.0, 1.0),
                        help="camera, if the file has none: degrees, degrees, factor")
    return parser.parse_args()


def load(options):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    # The importer turns seconds into frames of this length.
    scene.render.fps = round(options.fps)
    bpy.ops.import_scene.gltf(filepath=str(options.scene))
    clips = [play_last(thing) for thing in bpy.data.objects]
    end = max([clip.frame_range[1] for clip in clips if clip], default=0)
    scene.frame_set(round(end) if options.frame is None else options.frame)
    bpy.context.view_layer.update()


def play_last(thing):
    """Plays the last clip of an object: a bake comes after what the file had before."""
    data = thing.animation_data
    if not data or not data.nla_tracks:
        return data.action if data else None
    strip = data.nla_tracks[-1].strips[0]
    action, slot = strip.action, strip.action_slot
    for track in list(data.nla_tracks):
        data.nla_tracks.remove(track)
    data.action = action
    data.action_slot = slot
    return action


def corners(moving):
    """World corners of the bounds of what is seen; of what moves, if anything does."""
    meshes = [thing for thing in bpy.data.objects if thing.type == "MESH"]

    def moves(thing):
        while thing:
            if thing.animation_data:
                return True
            thing = thing.parent
        return False

    chosen = [thing for thing in meshes if moves(thing)] if moving else []
    for thing in chosen or meshes:
        for corner in thing.bound_box:
            yield thing.matrix_world @ Vector(corner)


def add_camera(view):
    """A camera that has what moves in its frame."""
    points = list(corners(True))
    low = Vector([percentile([p[i] for p in points], 0.03) for i in range(3)])
    high = Vector([percentile([p[i] for p in points], 0.97) for i in range(3)])
    middle, radius = (low + high) / 2, (high - low).length / 2
    azimuth, height = math.radians(view[0]), math.radians(view[1])
    toward = Vector((math.sin(azimuth) * math.cos(height), -math.cos(azimuth) * math.cos(height),
                     math.sin(height)))
    lens = bpy.data.cameras.new("camera")
    lens.angle = math.radians(35)
    camera = bpy.data.objects.new("camera", lens)
    # The picture is wide: its height is what must hold the scene.
    across = lens.angle * 9 / 16
    camera.location = middle + toward * (view[2] * radius / math.sin(across / 2) * 0.8)
    camera.rotation_euler = (-toward).to_track_quat("-Z", "Y").to_euler()
    lens.clip_start = radius / 100
    lens.clip_end = radius * 1000
    bpy.context.collection.objects.link(camera)
    return camera


def percentile(values, part):
    values.sort()
    return values[round(part * (len(values) - 1))]


def light(camera):
    """A low sun from the side, and a sky."""
    for lamp in [thing for thing in bpy.data.objects if thing.type == "LIGHT"]:
        bpy.data.objects.remove(lamp)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.color = 4.5, math.radians(2.5), (1.0, 0.92, 0.8)
    lamp = bpy.data.objects.new("sun", sun)
    side = camera.matrix_world.to_3x3() @ Vector((-0.9, 0.0, 0.35))
    aim = Vector((side.x, side.y, 0.0)).normalized() * 0.75 + Vector((0, 0, 1.0))
    lamp.rotation_euler = aim.to_track_quat("Z", "Y").to_euler()
    bpy.context.collection.objects.link(lamp)
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.62, 0.72, 0.86, 1.0)
    background.inputs["Strength"].default_value = 0.45


def prepare(options):
    scene = bpy.context.scene
    camera = next((thing for thing in bpy.data.objects if thing.type == "CAMERA"), None)
    scene.camera = camera or add_camera(options.view)
    bpy.context.view_layer.update()
    light(scene.camera)
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = options.samples
    scene.cycles.use_denoising = True
    scene.cycles.max_bounces = 4
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.render.resolution_x, scene.render.resolution_y = options.size
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.compression = 100


def shoot(path):
    bpy.context.scene.render.filepath = str(Path(path).resolve())
    bpy.ops.render.render(write_still=True)


def still(options):
    shoot(options.picture)
    # A palette takes a third of the space, and nobody sees the difference.
    with Image.open(options.picture) as picture:
        small = picture.quantize(256, Image.Quantize.MAXCOVERAGE, 2, dither=Image.Dither.NONE)
    small.save(options.picture, optimize=True)


def moving(options):
    first, last, step = options.frames
    pictures = []
    with tempfile.TemporaryDirectory() as folder:
        for frame in range(first, last + 1, step):
            bpy.context.scene.frame_set(frame)
            shoot(Path(folder) / "frame.png")
            with Image.open(Path(folder) / "frame.png") as picture:
                pictures.append(picture.convert("RGB"))
    pictures[0].save(options.picture, save_all=True, append_images=pictures[1:], loop=0, quality=72,
                     method=6, duration=round(1000 * step / options.fps))


def main():
    options = arguments()
    load(options)
    prepare(options)
    (moving if options.frames else still)(options)
    if not options.picture.exists():
        sys.exit(f"{options.picture}: not written")


if __name__ == "__main__":
    main()
