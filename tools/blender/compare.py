#!/usr/bin/env python3
"""Compares bakes with Blender's own simulation: python tools/blender/compare.py --drystone PROGRAM

Builds the scenes of scenes.py, bakes each with the add-on, and steps Blender's simulation through the same
frames. One judge measures all of them by the poses that Blender shows. Prints a table in Markdown.

Needs Blender as a module: pip install bpy==5.0.1 (Python 3.11).
"""

import argparse
import json
import os
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

# Known once bpy is loaded.
import bmesh
import scenes
from drystone import baking
from drystone.space import stretch

# Blender's substeps per frame and iterations per substep.
BLENDER = [(10, 10), (60, 50)]


@dataclass
class Run:
    """A simulation of a scene: its time, its poses and what was said of it."""

    name: str
    # Wall time, and time of all processors. [s]
    seconds: float
    work: float
    # Maps from the shapes of bodies at the first frame to the world: frame, body, 4 x 4.
    poses: np.ndarray
    said: list = field(default_factory=list)
    findings: list = field(default_factory=list)


@dataclass
class Measures:
    """Findings of the judge: lengths [m], and the part of the bodies that stood [1]."""

    overlap: float
    overlapping: tuple
    apart: float
    creep: float
    creeping: str
    stood: float


class Piece:
    """A convex piece of a body: its points, the normals of its faces and its edges, in the frame of the body."""

    def __init__(self, body, points, radius=0.0):
        self.body, self.radius = body, radius
        self.points, self.normals, self.edges = points, np.zeros((0, 3)), np.zeros((0, 2), int)
        if len(points) > 1:
            self._hull(points)
            directions = self.points[self.edges[:, 1]] - self.points[self.edges[:, 0]]
            self.directions = distinct(directions / np.linalg.norm(directions, axis=1, keepdims=True))
        self.reach = np.linalg.norm(self.points, axis=1).max() + radius

    def _hull(self, points):
        mesh = bmesh.new()
        for p in points:
            mesh.verts.new(p)
        bmesh.ops.remove_doubles(mesh, verts=mesh.verts, dist=1e-7)
        made = bmesh.ops.convex_hull(mesh, input=mesh.verts)
        inner = {v for v in made["geom_interior"] if isinstance(v, bmesh.types.BMVert)}
        bmesh.ops.dissolve_limit(mesh, angle_limit=1e-4, verts=mesh.verts, edges=mesh.edges)
        mesh.normal_update()
        verts = [v for v in mesh.verts if v not in inner and v.link_edges]
        place = {v: i for i, v in enumerate(verts)}
        self.points = np.array([v.co for v in verts], float)
        self.normals = distinct(np.array([f.normal for f in mesh.faces], float))
        self.edges = np.array([[place[v] for v in e.verts] for e in mesh.edges])
        mesh.free()


def distinct(axes):
    """Returns axes without repetitions, whichever way they point."""
    flip = np.where((axes @ [0.601, 0.527, 0.6009]) < 0, -1, 1)
    return np.unique((axes * flip[:, None]).round(6), axis=0)


def least(axes, p, q, r):
    """Returns the least overlap of two sets of points along axes; the sum of their radii adds to it."""
    a, b = p @ axes.T, q @ axes.T
    return (np.minimum(a.max(0) - b.min(0), b.max(0) - a.min(0)) + r).min()


def unit(axes):
    length = np.linalg.norm(axes, axis=1)
    return axes[length > 1e-6] / length[length > 1e-6, None]


def depth(a, b, at_a, at_b, enough):
    """Returns the penetration of two convex pieces, or something not above `enough`, by separating axes. [m]"""
    p, q = (piece.points @ at[:3, :3].T + at[:3, 3] for piece, at in ((a, at_a), (b, at_b)))
    radius = a.radius + b.radius
    if len(p) == 1 and len(q) == 1:
        return radius - np.linalg.norm(p - q)
    axes = np.concatenate([a.normals @ at_a[:3, :3].T, b.normals @ at_b[:3, :3].T])
    found = least(axes, p, q, radius)
    if found <= enough:
        return found
    if len(p) > 1 and len(q) > 1:
        axes = np.cross((a.directions @ at_a[:3, :3].T)[:, None], (b.directions @ at_b[:3, :3].T)[None])
        axes = axes.reshape(-1, 3)
    else:
        center, corners, edges = (p[0], q, b.edges) if len(p) == 1 else (q[0], p, a.edges)
        start, end = corners[edges[:, 0]], corners[edges[:, 1]]
        part = ((center - start) * (end - start)).sum(1) / ((end - start)**2).sum(1)
        axes = np.concatenate([center - corners, center - start - part[:, None] * (end - start)])
    axes = unit(axes)
    return min(found, least(axes, p, q, radius)) if len(axes) else found


class Judge:
    """Measures poses of a scene that is shown at its first frame. It knows meshes and no solver."""

    def __init__(self, stage):
        scene = bpy.context.scene
        self.stage = stage
        self.things = bodies()
        self.names = [thing.name for thing in self.things]
        self.place = {name: i for i, name in enumerate(self.names)}
        self.moves = np.array([thing.rigid_body.type == "ACTIVE" for thing in self.things])
        self.fps = scene.render.fps
        self.pieces = [piece for i, thing in enumerate(self.things) for piece in self._pieces(i, thing)]
        self.first = np.array([np.array(thing.matrix_world @ stretch(thing).inverted()) for thing in self.things])
        self.joints, self.joined = [], set()
        for thing in scene.rigidbody_world.constraints.objects:
            self._joint(thing)

    def _pieces(self, i, thing):
        radius = self.stage.spheres.get(thing.name)
        if radius:
            return [Piece(i, np.zeros((1, 3)), radius)]
        matrix = np.array(stretch(thing).to_3x3())
        several = self.stage.pieces.get(thing.name) or [np.array([v.co for v in thing.data.vertices])]
        return [Piece(i, points @ matrix.T) for points in several]

    def _joint(self, thing):
        of = thing.rigid_body_constraint
        if of.use_breaking:
            return
        a, b = self.place[of.object1.name], self.place[of.object2.name]
        self.joined.add((min(a, b), max(a, b)))
        anchor = np.array([*thing.matrix_world.translation, 1])
        self.joints.append((a, b, np.linalg.inv(self.first[a]) @ anchor, np.linalg.inv(self.first[b]) @ anchor))

    def measure(self, run):
        overlap, pair = self.overlap(run.poses)
        creep, name = self.creep(run.poses)
        return Measures(overlap, pair, self.apart(run.poses), creep, name, self.stood(run.poses))

    def overlap(self, poses):
        """Returns the deepest overlap of two bodies in all frames, and their names."""
        worst, pair = 0.0, ()
        body = np.array([piece.body for piece in self.pieces])
        for at in poses:
            boxes = []
            for piece in self.pieces:
                matrix = at[piece.body]
                points = piece.points @ matrix[:3, :3].T + matrix[:3, 3]
                boxes.append([points.min(0) - piece.radius, points.max(0) + piece.radius])
            low, high = np.moveaxis(np.array(boxes), 1, 0)
            near = (low[:, None] < high[None] - worst).all(-1) & (low[None] < high[:, None] - worst).all(-1)
            near &= (body[:, None] < body[None]) & (self.moves[body][:, None] | self.moves[body][None])
            for i, j in np.argwhere(near):
                a, b = self.pieces[i], self.pieces[j]
                if (a.body, b.body) in self.joined:
                    continue
                found = depth(a, b, at[a.body], at[b.body], worst)
                if found > worst:
                    worst, pair = found, (self.names[a.body], self.names[b.body])
        return worst, pair

    def apart(self, poses):
        """Returns how far the ends of a constraint that does not break come apart."""
        gaps = [np.linalg.norm(poses[:, a] @ p - poses[:, b] @ q, axis=-1).max() for a, b, p, q in self.joints]
        return max(gaps, default=0.0)

    def relative(self, poses, name):
        """Returns poses of a body in the world, or in the frame of what carries it."""
        own = poses[:, self.place[name]]
        carrier = self.stage.carriers.get(name)
        return own if carrier is None else np.linalg.inv(poses[:, self.place[carrier]]) @ own

    def creep(self, poses):
        """Returns the largest motion of a point, in the last second, of bodies that should rest."""
        worst, culprit = 0.0, ""
        by_body = {}
        for piece in self.pieces:
            by_body.setdefault(piece.body, []).append(piece)
        for name in self.stage.rests:
            at = self.relative(poses, name)[-self.fps - 1:]
            points = np.concatenate([piece.points for piece in by_body[self.place[name]]])
            shown = points @ np.swapaxes(at[:, :3, :3], 1, 2) + at[:, None, :3, 3]
            moved = np.linalg.norm(shown - shown[0], axis=-1).max()
            if moved > worst:
                worst, culprit = moved, name
        return worst, culprit

    def stood(self, poses):
        """Returns the part of the bodies that should stand, or stay inside, that do at the last frame."""
        if self.stage.inside:
            low, high = np.array(self.stage.inside)
            places = np.array([poses[-1, self.place[name], :3, 3] for name in self.stage.stands])
            return ((places > low) & (places < high)).all(1).mean()
        near, turn = self.stage.tolerance
        stood = []
        for name in self.stage.stands:
            at = self.relative(poses, name)
            off = np.linalg.norm(at[-1, :3, 3] - at[0, :3, 3])
            turned = np.linalg.norm(at[-1, :3, :3] - at[0, :3, :3]) / np.sqrt(2)
            stood.append(off < near and turned < turn)
        return np.mean(stood)


def bodies():
    """Returns the objects with a rigid body, in the order of the judge."""
    return [thing for thing in bpy.context.scene.objects if thing.rigid_body]


def clocks():
    """Returns wall time and the time of processors, of this process and of those that it has ended. [s]"""
    return np.array([time.perf_counter(), sum(os.times()[:4])])


def stepped():
    """Shows all frames; returns poses of bodies, and the times that Blender took. [s]"""
    scene, things = bpy.context.scene, bodies()
    inverse = [np.linalg.inv(np.array(stretch(thing))) for thing in things]
    poses, taken = [], np.zeros(2)
    for frame in range(scene.frame_start, scene.frame_end + 1):
        start = clocks()
        scene.frame_set(frame)
        taken += clocks() - start
        poses.append([np.array(thing.matrix_world) @ of for thing, of in zip(things, inverse)])
    return np.array(poses), taken


def in_blender(stage, substeps, iterations):
    """Simulates the scene with Blender; glue breaks at the same force, whatever the number of substeps."""
    scene = bpy.context.scene
    world = scene.rigidbody_world
    world.substeps_per_frame, world.solver_iterations = substeps, iterations
    for thing in world.constraints.objects:
        thing.rigid_body_constraint.breaking_threshold = stage.glue_force / (scene.render.fps * substeps)
    bpy.context.view_layer.update()
    poses, taken = stepped()
    return Run(f"Blender {substeps}/{iterations}", *taken, poses)


def in_drystone(program, folder, options=baking.Options()):
    """Bakes the scene as the panel does, from export to keys."""
    start = clocks()
    bake = baking.Bake(bpy.context, str(program), options, folder)
    bake.finish()
    taken = clocks() - start
    findings = [finding.sentence() for finding in bake.shot.findings]
    return Run("Drystone", *taken, stepped()[0], bake.said, findings)


def compared(program, name, small, folder, settings=BLENDER, more=()):
    """Yields the runs of a scene, each with its measures; `more` has other options of bakes by name."""
    judge = Judge(scenes.build(name, small))
    for label, options in (("Drystone", baking.Options()), *more):
        scenes.build(name, small)
        run = in_drystone(program, folder, options)
        run.name = label
        yield run, judge.measure(run)
    for substeps, iterations in settings:
        run = in_blender(scenes.build(name, small), substeps, iterations)
        yield run, judge.measure(run)


HEAD = """| Scene | Solver | Time \\[s\\] | CPU \\[s\\] | Overlap \\[mm\\] | Apart \\[mm\\] | Creep \\[mm\\] | Stood |
|---|---|---|---|---|---|---|---|"""


def row(scene, run, of):
    return (f"| {scene} | {run.name} | {run.seconds:.1f} | {run.work:.1f} | {of.overlap * 1e3:.2f} | "
            f"{of.apart * 1e3:.2f} | {of.creep * 1e3:.2f} | {of.stood:.0%} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drystone", type=Path, required=True)
    parser.add_argument("--scene", choices=scenes.SCENES, action="append", help="[default: all]")
    parser.add_argument("--small", action="store_true", help="sizes of the tests")
    parser.add_argument("--preview", action="store_true", help="the real-time preset too")
    parser.add_argument("-o", "--output", type=Path, help="folder for the exported scenes, bakes and numbers")
    arguments = parser.parse_args()
    more = [("Drystone, Preview", baking.Options(is_preview=True))] if arguments.preview else []
    print(HEAD, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        folder = arguments.output or Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for name in arguments.scene or scenes.SCENES:
            numbers = []
            for run, of in compared(arguments.drystone, name, arguments.small, folder, more=more):
                print(row(name, run, of), flush=True)
                for line in run.findings + run.said:
                    print(f"{name}: {line}", file=sys.stderr)
                numbers.append({"solver": run.name, "seconds": run.seconds, "work": run.work, "said": run.said,
                                "findings": run.findings, **vars(of)})
            (folder / f"{name}.results.json").write_text(json.dumps(numbers, indent=1))


if __name__ == "__main__":
    main()
