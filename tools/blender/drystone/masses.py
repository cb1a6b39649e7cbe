"""Volumes, centers and inertia of the shapes of a scene of Drystone, at density 1."""

from dataclasses import dataclass

import bmesh
import numpy as np
from mathutils import Matrix

from .channels import matrices


@dataclass(frozen=True)
class Solid:
    """A volume [m^3], its center [m], and the inertia about the center [m^5]."""

    volume: float
    center: np.ndarray
    inertia: np.ndarray

    def placed(self, position, rotation):
        """Returns the same solid turned and moved; the rotation is a quaternion x, y, z, w."""
        x, y, z, w = rotation
        turn = matrices(np.array([[w, x, y, z]]))[0]
        return Solid(self.volume, turn @ self.center + position, turn @ self.inertia @ turn.T)


def shifted(inertia, mass, arm):
    """Returns the inertia about a point that is an arm away from the center."""
    return inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def joined(solids):
    """Returns several solids as one."""
    volume = sum(of.volume for of in solids)
    center = sum(of.volume * of.center for of in solids) / volume
    return Solid(volume, center, sum(shifted(of.inertia, of.volume, of.center - center) for of in solids))


def of_triangles(points, triangles):
    """Returns the solid that triangles enclose, all seen from outside or all from inside."""
    middle = points.mean(axis=0)
    corners = (points - middle)[triangles]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    if volumes.sum() < 0:
        volumes = -volumes
    volume, sums = volumes.sum(), corners.sum(axis=1)
    center = (volumes[:, None] * sums).sum(axis=0) / (4 * volume)
    # Integral of x x^T over a tetrahedron with a corner at the origin.
    second = np.einsum("i,iaj,iak->jk", volumes, corners, corners) + np.einsum("i,ij,ik->jk", volumes, sums, sums)
    second = second / 20 - volume * np.outer(center, center)
    return Solid(volume, center + middle, np.trace(second) * np.eye(3) - second)


def of_hull(points):
    """Returns the solid of the hull of points."""
    points = np.asarray(points, float)
    middle, mesh = points.mean(axis=0), bmesh.new()
    size = np.ptp(points, axis=0).max()
    try:
        for point in (points - middle) / size:
            mesh.verts.new(point)
        bmesh.ops.convex_hull(mesh, input=mesh.verts)
        bmesh.ops.triangulate(mesh, faces=mesh.faces)
        mesh.verts.index_update()
        corners = np.array([vertex.co for vertex in mesh.verts])
        triangles = np.array([[vertex.index for vertex in face.verts] for face in mesh.faces])
    finally:
        mesh.free()
    return of_triangles(corners * size + middle, triangles)


def of_box(x, y, z):
    volume = 8 * x * y * z
    return Solid(volume, np.zeros(3), volume / 3 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y]))


def of_cylinder(radius, half):
    """Along y."""
    volume = 2 * np.pi * radius**2 * half
    across = radius**2 / 4 + half**2 / 3
    return Solid(volume, np.zeros(3), volume * np.diag([across, radius**2 / 2, across]))


def of_sphere(radius):
    volume = 4 / 3 * np.pi * radius**3
    return Solid(volume, np.zeros(3), 0.4 * volume * radius**2 * np.eye(3))


def of_capsule(radius, half):
    """Along y: a cylinder between two halves of a ball."""
    ball, middle = of_sphere(radius), of_cylinder(radius, half)
    # The center of a half of a ball is 3/8 of its radius off the flat side.
    arm, far = 3 / 8 * radius, half + 3 / 8 * radius
    across = ball.inertia[0, 0] + ball.volume * (far**2 - arm**2)
    caps = np.diag([across, ball.inertia[1, 1], across])
    return Solid(ball.volume + middle.volume, np.zeros(3), caps + middle.inertia)


def solid_of(shape):
    """Returns the solid of a shape in the frame of its body."""
    kind = shape["type"]
    solid = {
        "box": lambda: of_box(*shape["half_extents"]),
        "sphere": lambda: of_sphere(shape["radius"]),
        "cylinder": lambda: of_cylinder(shape["radius"], shape["half_height"]),
        "capsule": lambda: of_capsule(shape["radius"], shape["half_height"]),
        "convex_hull": lambda: of_hull(shape["points"]),
        "trimesh": lambda: of_triangles(np.array(shape["vertices"], float), np.array(shape["triangles"])),
    }[kind]()
    return solid.placed(np.array(shape["position"]), shape["rotation"])


def mass_keys(solids, mass):
    """Returns the keys of a body of several solids of one density: center and principal moments."""
    whole = joined(solids)
    moments, axes = np.linalg.eigh(whole.inertia * (mass / whole.volume))
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    turn = Matrix(axes).to_quaternion()
    return {"center_of_mass": whole.center.tolist(), "inertia": moments.tolist(),
            "inertia_rotation": [turn.x, turn.y, turn.z, turn.w]}
