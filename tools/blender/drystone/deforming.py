"""Passive meshes that deform or grow: their vertices at each frame, in the frame of their body."""

import numpy as np

from .findings import CHANGED

# Smallest motion of a vertex that counts. [m]
STILL = 1e-6
# Triangles have no area if it is smaller than this part of their squared sides. [1]
FLAT = 1e-8
# Digits of coordinates after the point. [m]
DIGITS = 7
FINAL = " with modifiers and the source Final: followed, in Blender for certain only with Deform"


def deforms(thing):
    """Tells whether the shape of an object is a mesh that follows its deformation, whatever its source."""
    of = thing.rigid_body
    return of.type == "PASSIVE" and of.use_deform and of.collision_shape == "MESH"


def have_area(corners):
    """Tells which triangles have an area."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.linalg.norm(np.cross(first, second), axis=1)
    sides = (first**2).sum(axis=1) + (second**2).sum(axis=1) + ((second - first)**2).sum(axis=1)
    return across > FLAT * sides


class Deforming:
    """Vertices of passive meshes, noted at each frame of a scene."""

    def __init__(self, things, shapes, findings):
        self.things = things
        self.shapes = shapes
        self.findings = findings
        self._points = {thing.name_full: [] for thing in things}
        self._final = {thing.name_full for thing in things
                       if thing.rigid_body.mesh_source == "FINAL" and any(of.show_viewport for of in thing.modifiers)}
        # Triangles of the first frame, and whether they have had an area at all frames, by name.
        self._triangles, self._sound = {}, {}

    def look(self):
        """Notes the vertices at the present frame."""
        for thing in self.things:
            points, triangles = self.shapes.body_mesh(thing)
            frames = self._points[thing.name_full]
            frames.append(points)
            if len(points) == len(frames[0]):
                sound = have_area(points[self._triangles.setdefault(thing.name_full, triangles)])
                self._sound[thing.name_full] = self._sound.get(thing.name_full, True) & sound

    @property
    def names(self):
        return set(self._points)

    def follow(self, name, shapes, step):
        """Gives the mesh of a body its vertices at each frame, if they move in a way that Drystone follows."""
        track = self._track(name, step) if name in self._points else None
        if track:
            if name in self._final:
                self._told(name, FINAL)
            # Drystone refuses triangles that lose their area at some frame.
            triangles, sound = self._triangles[name], self._sound[name]
            shapes[0] |= {"triangles": triangles[sound].tolist(), "vertex_track": track}
            if have_area(self._points[name][0][triangles[~sound]]).any():
                self._told(name, " with triangles that lose their area at some frame: without these")

    def _track(self, name, step):
        frames = self._points[name]
        if len({len(points) for points in frames}) > 1:
            return self._told(name, " whose number of vertices changes: of the shape at the first frame")
        points = np.array(frames)
        if not np.isfinite(points).all():
            return self._told(name, " with vertices that are nowhere: of the shape at the first frame")
        if np.abs(points - points[0]).max() < STILL:
            return None
        if not self._sound[name].any():
            return self._told(name, " whose triangles lose their area: of the shape at the first frame")
        turned = np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1).round(DIGITS)
        return {"times": [frame * step for frame in range(len(points))], "points": turned.tolist()}

    def _told(self, name, text):
        self.findings.add(CHANGED, "deforming object", text, name)
