"""Meshes of the scenes: boxes, balls, things that are turned about an axis, with their convex pieces."""

import math

import bpy
import numpy as np
from mathutils import Vector


def box_mesh(name, size, corner=False):
    """Returns a mesh of a box, about its middle or from its corner."""
    low = Vector((0, 0, 0)) if corner else -Vector(size) / 2
    points = [low + Vector((x * size[0], y * size[1], z * size[2])) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return mesh_of(name, points, faces)


def mesh_of(name, points, faces):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(p) for p in points], [], faces)
    mesh.update()
    return mesh


def ball_mesh(name, radius, smooth=True):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=radius)
    thing = bpy.context.object
    mesh = thing.data
    mesh.name = name
    bpy.data.objects.remove(thing)
    mesh.polygons.foreach_set("use_smooth", [smooth] * len(mesh.polygons))
    return mesh


def primitive(make):
    """Returns the mesh that an operator of Blender makes."""
    make()
    thing = bpy.context.object
    mesh = thing.data
    bpy.data.objects.remove(thing)
    return mesh


def lathe(profile, count):
    """Turns a closed profile of pairs of inner and outer points (radius, height) about z.

    Returns points, faces and convex pieces. The first pair may lie on the axis.
    """
    points, rings = [], []

    def ring(radius, height):
        if radius == 0:
            points.append(Vector((0, 0, height)))
            return [len(points) - 1] * count
        start = len(points)
        for i in range(count):
            angle = math.tau * i / count
            points.append(Vector((radius * math.cos(angle), radius * math.sin(angle), height)))
        return list(range(start, start + count))

    for inner, outer in profile:
        rings.append((ring(*inner), ring(*outer)))
    closed_axis = profile[0][0][0] == 0
    faces, pieces = [], []

    def quad(a, b, c, d):
        face = tuple(dict.fromkeys((a, b, c, d)))
        if len(face) > 2:
            faces.append(face)

    for i in range(count):
        j = (i + 1) % count
        for (inner, outer), (inner_next, outer_next) in zip(rings, rings[1:]):
            quad(inner[i], inner_next[i], inner_next[j], inner[j])
            quad(outer[i], outer[j], outer_next[j], outer_next[i])
            corners = {*(r[k] for r in (inner, outer, inner_next, outer_next) for k in (i, j))}
            pieces.append(np.array([points[k] for k in corners]))
        inner, outer = rings[-1]
        quad(inner[i], outer[i], outer[j], inner[j])
        if not closed_axis:
            inner, outer = rings[0]
            quad(inner[i], inner[j], outer[j], outer[i])
    return points, faces, pieces


def ring_mesh(radius=0.16, width=0.03):
    """Returns mesh and pieces of a flat ring."""
    pairs = [((radius - width, z), (radius + width, z)) for z in (-width, width)]
    points, faces, pieces = lathe(pairs, 16)
    return mesh_of("ring", points, faces), pieces


def mug_mesh(radius=0.13, height=0.28, wall=0.025):
    """Returns mesh and pieces of a mug with a handle."""
    count, steps = 16, 6
    heights = [0.0, *(wall + (height - wall) * i / 3 for i in range(1, 4))]
    profile = [((0, wall), (0, 0)), ((radius - wall, wall), (radius, 0))]
    profile += [((radius - wall, z), (radius, z)) for z in heights[1:]]
    points, faces, pieces = lathe(profile, count)
    # Outer faces of the walls between two heights: the handle goes from the upper to the lower one.
    sides = [face for face in faces if len(face) == 4
             and all(abs(math.hypot(*points[k][:2]) - radius) < 1e-6 for k in face)
             and sum(points[k].x for k in face) > 3.9 * radius * math.cos(math.pi / count)
             and sum(points[k].y for k in face) > 0]
    sides.sort(key=lambda face: sum(points[k].z for k in face))
    lower, upper = sides[0], sides[-1]
    faces = [face for face in faces if face not in (lower, upper)]
    chain = _handle(points, upper, lower, steps)
    for a, b in zip(chain, chain[1:]):
        for i in range(4):
            j = (i + 1) % 4
            faces.append((a[i], a[j], b[j], b[i]))
        pieces.append(np.array([points[k] for k in {*a, *b}]))
    middle = Vector((0, 0, height / 2))
    return mesh_of("mug", [p - middle for p in points], faces), [piece - np.array(middle) for piece in pieces]


def _handle(points, upper, lower, steps):
    """Adds the rings of a handle that leaves one face and enters another one; returns them, in order."""
    def middle(face):
        return sum((points[k] for k in face), Vector()) / len(face)

    start, end = middle(upper), middle(lower)
    outward = Vector((start.x, start.y, 0)).normalized()
    side = Vector((0, 0, 1)).cross(outward)
    centre, reach = (start + end) / 2, (start.z - end.z) / 2
    half_width = abs((points[upper[0]] - start).dot(side))
    half_height = abs(points[upper[0]].z - start.z)

    def local(k, face):
        offset = points[k] - middle(face)
        return 1 if offset.dot(side) > 0 else -1, 1 if offset.z > 0 else -1

    signs = [local(k, upper) for k in upper]
    chain = [list(upper)]
    for step in range(1, steps):
        angle = math.pi / 2 - math.pi * step / steps
        radial = outward * (math.cos(angle) * 1.0) + Vector((0, 0, math.sin(angle)))
        place = centre + outward * (reach * math.cos(angle) + 0.012) + Vector((0, 0, reach * math.sin(angle)))
        rows = []
        for across, up in signs:
            rows.append(len(points))
            points.append(place + side * (across * half_width) + radial * (up * half_height * 0.45))
        chain.append(rows)
    # The upper edge of the handle is its outer one, and enters the lower face below.
    last = []
    for across, up in signs:
        last.append(next(k for k in lower if local(k, lower) == (across, -up)))
    chain.append(last)
    return chain
