"""Shapes of bodies, of the meshes of objects."""

import numpy as np
from mathutils import Matrix

from .deforming import deforms
from .findings import CHANGED, LEFT_OUT
from .masses import joined, mass_keys, solid_of
from .pieces import OPERATOR, STALE, hash_of, points_of, shown_pieces
from .space import is_sound, parts_of, pose_of, rigid, stretch, turned

# A body is flat if it is thinner than this. [m]
FLAT = 1e-4
# Least thickness of a plate in place of a flat body [m], and as a part of its size.
THINNEST, THIN = 1e-3, 0.01
# Least distance of the middle of a mesh from its origin that counts, as a part of half its size.
OFF = 0.01
ORIGIN = " with a mesh off its origin: the shape is around the mesh, in Blender around the origin"
# Least distance of the center of mass from the origin that counts, as a part of the size.
OFF_CENTER = 0.05
CENTER = " with a center of mass off the origin: that of the volume, in Blender the origin"
# Kinds of shapes that the bounding box of the final mesh sizes, whatever the source.
BOUNDED = ("BOX", "SPHERE", "CYLINDER", "CAPSULE", "CONE")
# Sides of the hull of a cone.
SIDES = 32
# Axes along which shapes keep their form only with equal scales, and the relative difference that counts.
EVEN = {"SPHERE": [0, 1, 2], "CAPSULE": [0, 1, 2], "CYLINDER": [0, 1], "CONE": [0, 1]}
UNEVEN = 0.01
SCALED = " of a compound with a scale of its own: in this size, where Blender ignores it"
SIZED = " with an uneven scale: as wide as the whole mesh, in Blender by the scale of one axis"


def source_of(thing):
    """Returns the source of the mesh that a shape is made of: BASE, DEFORM or FINAL.

    Blender moves the vertices of a deforming mesh with the source Base to those of Deform.
    """
    of = thing.rigid_body
    if of.collision_shape in BOUNDED:
        return "FINAL"
    return "DEFORM" if of.mesh_source == "BASE" and deforms(thing) else of.mesh_source


def axes_of(points):
    """Returns the middle of points, their principal axes as rows, and their extents along these."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2] if len(points) > 2 else np.eye(3)
    if len(axes) < 3:
        axes = np.eye(3)
    return axes, np.ptp(points @ axes.T, axis=0)


def thickness_of(size):
    """Returns the thickness of a plate in place of a flat body."""
    return max(THINNEST, THIN * size)


def thickened(points):
    """Returns points of a hull with a volume."""
    axes, extents = axes_of(points)
    half = thickness_of(extents.max()) / 2
    for axis, extent in zip(axes, extents):
        if extent < FLAT:
            points = np.concatenate([points - half * axis, points + half * axis])
    return points


def is_flat(points):
    return axes_of(points)[1].min() < FLAT


def hull(points):
    """Returns a hull; points inside do no harm."""
    return {"type": "convex_hull", "points": [turned(p) for p in np.unique(points.round(6), axis=0)]}


def capsule(half):
    radius = max(half[:2])
    return {"type": "capsule", "radius": radius, "half_height": max(half[2] - radius, 1e-6)}


def cone(half):
    """Returns the hull of a cone with its tip up."""
    angles = np.arange(SIDES) * 2 * np.pi / SIDES
    rim = max(half[:2]) * np.stack([np.sin(angles), np.cos(angles)], axis=1)
    return hull(np.array([*([x, y, -half[2]] for x, y in rim), [0, 0, half[2]]]))


def bounded_shape(kind, half):
    """Returns a shape of the size of a bounding box."""
    return {
        "BOX": lambda: {"type": "box", "half_extents": [half[0], half[2], half[1]]},
        "SPHERE": lambda: {"type": "sphere", "radius": max(half)},
        "CYLINDER": lambda: {"type": "cylinder", "radius": max(half[:2]), "half_height": half[2]},
        "CAPSULE": lambda: capsule(half),
        "CONE": lambda: cone(half),
    }[kind]()


def slab(points, kind):
    """Returns a floor that is drawn as a plane, and its middle: solid below, so that nothing falls through."""
    low, high = points.min(axis=0), points.max(axis=0)
    depth = max(0.1, 0.05 * (high - low).max())
    if kind not in BOUNDED and len(points) > 4:
        return hull(np.concatenate([points, points - [0, 0, depth]])), np.zeros(3)
    plate = "CYLINDER" if kind in BOUNDED and kind != "BOX" else "BOX"
    return bounded_shape(plate, (high - low + [0, 0, depth]) / 2), (low + high - [0, 0, depth]) / 2


def is_closed(points, triangles):
    """Tells whether triangles enclose a volume: each edge is passed once each way; places count, not vertices."""
    size = np.ptp(points, axis=0).max()
    _, places = np.unique((points / max(size, 1e-12) * 2**20).round(), axis=0, return_inverse=True)
    corners = places.reshape(-1)[triangles]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    count = len(points)
    there, back = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    return len(edges) > 0 and np.array_equal(np.sort(there), np.sort(back))


class ShapeExporter:
    """Makes shapes of objects; takes out those that have none, and says why."""

    def __init__(self, depsgraph, findings, inside=()):
        self.depsgraph = depsgraph
        self.findings = findings
        # Names of the objects in the rigid body world, of which compounds consist.
        self.inside = inside
        # Names of objects whose vertices the bake follows.
        self.deforming = frozenset()
        # Solids of the meshes whose pieces are shapes of the body at hand, and these shapes.
        self._solids, self._pieces = [], []

    def shapes(self, thing, is_dynamic):
        """Returns the shapes of a body."""
        self._solids, self._pieces = [], []
        if thing.rigid_body.collision_shape == "COMPOUND":
            shapes = self._parts(thing, is_dynamic)
            if not shapes:
                self.left_out(thing, "without parts")
            return shapes
        return self._one(thing, is_dynamic, Matrix())

    def mass_keys(self, shapes, mass):
        """Returns the keys of the body at hand that keep the masses of its meshes: pieces may overlap."""
        return mass_keys(self._all_solids(shapes), mass) if self._solids else {}

    def tell_center(self, thing, shapes):
        """Notes a center of mass off the origin of a body: Blender has it there, whatever the shape."""
        if thing.rigid_body.collision_shape in BOUNDED:
            return
        solid = joined(self._all_solids(shapes))
        if np.linalg.norm(solid.center) > OFF_CENTER * np.cbrt(solid.volume):
            self.findings.add(CHANGED, "object", CENTER, thing.name_full)

    def _all_solids(self, shapes):
        """Returns the solids of the body at hand, of meshes with pieces once."""
        others = [shape for shape in shapes if not any(shape is piece for piece in self._pieces)]
        return [*self._solids, *map(solid_of, others)]

    def instance(self, thing, matrix):
        """Returns the shapes of an instance of a passive object."""
        self._solids, self._pieces = [], []
        return self._one(thing, False, Matrix(), matrix)

    def left_out(self, thing, why):
        self.findings.add(LEFT_OUT, "object", f" {why}: left out", thing.name_full)
        return []

    def _changed(self, thing, noun, how):
        self.findings.add(CHANGED, noun, f": {how}", thing.name_full)

    def _parts(self, body, is_dynamic):
        """Returns the shapes of the parts of a compound."""
        shapes = []
        for part in parts_of(body, self.inside):
            if not is_sound(part):
                self.left_out(part, "without a size or a place")
                continue
            if np.abs(np.abs(part.scale) - 1).max() > UNEVEN:
                self.findings.add(CHANGED, "object", SCALED, part.name_full)
            shapes += self._one(part, is_dynamic, rigid(body).inverted() @ rigid(part))
        return shapes

    def mesh(self, thing):
        """Returns vertices in the frame of the object, and triangles; of a bounded shape the corners of its box."""
        evaluated = thing.evaluated_get(self.depsgraph)
        if thing.type == "MESH" and thing.rigid_body.collision_shape in BOUNDED:
            # A last subdivision shrinks the mesh, and leaves Blender's box as it is.
            # In Edit Mode, vertices are elsewhere until a mesh is made of them.
            vertices = evaluated.to_mesh().vertices if thing.data.is_editmode else evaluated.data.vertices
            corners = np.array(evaluated.bound_box) if vertices else np.zeros((0, 3))
            return corners, np.zeros((0, 3), np.int32)
        try:
            mesh = (thing if source_of(thing) == "BASE" else evaluated).to_mesh()
        except RuntimeError:
            mesh = None
        if mesh is None or not mesh.vertices:
            return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
        mesh.calc_loop_triangles()
        corners = np.empty(len(mesh.loop_triangles) * 3, np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
        return points_of(mesh), corners.reshape(-1, 3)

    def body_mesh(self, thing, place=None):
        """Returns vertices in the frame of the body, and triangles; `place` is the matrix of an instance."""
        points, triangles = self.mesh(thing)
        matrix = np.array(stretch(thing, place).to_3x3())
        if np.linalg.det(matrix) < 0:
            triangles = triangles[:, ::-1]
        return points @ matrix.T, triangles

    def _one(self, thing, is_dynamic, place, instance=None):
        """Returns a list of the shape of an object at a place in the frame of its body, or an empty one.

        The shape of a mesh with pieces is a list of these.
        """
        points, triangles = self.body_mesh(thing, instance)
        kind = thing.rigid_body.collision_shape
        if not len(points):
            return self.left_out(thing, "without a mesh")
        if not np.isfinite(points).all() or np.ptp(points, axis=0).max() < 1e-9:
            return self.left_out(thing, "without a size or a place")
        if kind == "MESH" and not len(triangles):
            return self.left_out(thing, "without faces")
        sizes = np.linalg.norm(stretch(thing, instance).to_3x3(), axis=0)[EVEN.get(kind, [0])]
        if sizes.max() > (1 + UNEVEN) * sizes.min():
            self.findings.add(CHANGED, "object", SIZED, thing.name_full)
        shape, middle = self._shape(thing, kind, points, triangles, is_dynamic)
        position, rotation = pose_of(place @ Matrix.Translation(middle))
        pose = {"position": position, "rotation": rotation}
        pieces = self._pieces_of(thing) if is_dynamic and shape["type"] == "trimesh" else []
        if not pieces:
            return [{**shape, **pose}]
        shapes = [{"type": "convex_hull", "points": [turned(p) for p in piece], **pose} for piece in pieces]
        self._solids.append(solid_of({**shape, **pose}))
        self._pieces += shapes
        return shapes

    def _pieces_of(self, thing):
        """Returns the points of the pieces that are shown over an object, as long as they are of its mesh."""
        digest, pieces = shown_pieces(thing)
        if digest and digest != hash_of(*self.mesh(thing)):
            self.findings.add(CHANGED, "object", STALE, thing.name_full, remedy=OPERATOR)
            return []
        matrix = np.array(stretch(thing).to_3x3())
        return [piece @ matrix.T for piece in pieces]

    def _shape(self, thing, kind, points, triangles, is_dynamic):
        low, high = points.min(axis=0), points.max(axis=0)
        is_slab = not is_dynamic and high[2] - low[2] < FLAT and (kind != "MESH" or len(points) <= 4)
        if is_slab and thing.name_full not in self.deforming:
            self._changed(thing, "flat passive object", "solid below, so that nothing falls through")
            return slab(points, kind)
        if kind in BOUNDED:
            if np.abs(low + high).max() > OFF * (high - low).max():
                self.findings.add(CHANGED, "object", ORIGIN, thing.name_full)
            return bounded_shape(kind, self._half(thing, kind, (high - low) / 2)), (low + high) / 2
        if kind == "MESH" and (not is_dynamic or self._keeps_mesh(thing, points, triangles)):
            shape = {"type": "trimesh", "vertices": [turned(p) for p in points], "triangles": triangles.tolist()}
            return shape, np.zeros(3)
        if is_flat(points):
            self._changed(thing, "flat object", "given a thickness")
            points = thickened(points)
        return hull(points), np.zeros(3)

    def _keeps_mesh(self, thing, points, triangles):
        """Tells whether a mesh that moves has a volume, and says what becomes of one without."""
        if is_flat(points):
            return False
        if is_closed(points, triangles):
            return True
        self._changed(thing, "active open mesh", "solid as the convex hull")
        return False

    def _half(self, thing, kind, half):
        """Returns half extents of which none is too small for the shape."""
        if kind in ("BOX", "CYLINDER", "CONE") and half.min() < FLAT / 2:
            self._changed(thing, "flat object", "given a thickness")
            return np.where(half < FLAT / 2, thickness_of(2 * half.max()) / 2, half)
        return half
