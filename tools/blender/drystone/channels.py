"""Channels of objects that show poses of bodies."""

import numpy as np
from mathutils import Matrix

from .curves import animates
from .space import rigid, uid_of

# Largest deviation of a matrix from a rotation of unit scale. [1]
RIGID = 1e-4


def to_blender(poses):
    """Returns positions, and quaternions w x y z, z up; no quaternion is far from the one before."""
    places = np.stack([poses[:, 0], -poses[:, 2], poses[:, 1]], axis=1)
    turns = np.stack([poses[:, 6], poses[:, 3], -poses[:, 5], poses[:, 4]], axis=1)
    return places, turns


def continuous(turns):
    """Returns the same rotations, none on the far side of the one before."""
    flips = np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0, -1, 1)
    return np.concatenate([turns[:1], turns[1:] * np.cumprod(flips)[:, None]])


def product(a, b):
    """Returns products of quaternions w x y z."""
    w, x, y, z = np.moveaxis(np.asarray(a), -1, 0)
    v, i, j, k = np.moveaxis(np.asarray(b), -1, 0)
    return np.stack([w * v - x * i - y * j - z * k, w * i + x * v + y * k - z * j,
                     w * j - x * k + y * v + z * i, w * k + x * j - y * i + z * v], axis=-1)


def matrices(turns):
    """Returns rotation matrices of quaternions w x y z."""
    w, x, y, z = (np.asarray(turns, float) / np.linalg.norm(turns, axis=-1, keepdims=True)).T
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def nearest_rotations(of):
    """Returns the rotations nearest to matrices."""
    u, _, v = np.linalg.svd(of)
    u[..., -1] *= np.sign(np.linalg.det(u @ v))[..., None]
    return u @ v


def quaternions(of):
    """Returns quaternions w x y z of rotation matrices."""
    return np.array([Matrix(matrix).to_quaternion() for matrix in of])


def unit_scale(of):
    """Returns the mean scales of matrices, and how far their columns are from orthogonal and equal."""
    gram = np.swapaxes(of, -1, -2) @ of
    square = np.trace(gram, axis1=-2, axis2=-1) / 3
    return np.sqrt(square), np.abs(gram / square[..., None, None] - np.eye(3)).max(axis=(-2, -1))


class Channels:
    """Location and quaternion of an object, of poses of its body.

    Made at the first frame, with the object as before its bake. `above` has the frames that the channels are
    in, of all frames of the scene. Without it, and where a rotation cannot show the poses in these, the object
    has no parent while it is baked.
    """

    def __init__(self, thing, above=None):
        self.name = thing.name_full
        self.parent_uid = uid_of(thing.parent)
        self.delta = list(thing.delta_location)
        self.delta_rotation = list(thing.delta_rotation_quaternion.normalized())
        self.delta_turn = np.array(thing.delta_rotation_quaternion.normalized().conjugated())
        # From the mesh to the frame of the body: diagonal, unless there is shear.
        stretch = np.array(rigid(thing).to_3x3()).T @ np.array(thing.matrix_world.to_3x3())
        own = np.array(thing.scale) * np.array(thing.delta_scale)
        # From the frame of the body to that of the channels: a rotation, unless there is shear.
        self.inner = stretch / np.where(own == 0, 1, own)
        self.above = None if above is None else np.array(above)
        self.scale = None
        self.is_exact = self._is_rigid()
        sheared = np.abs(stretch - np.diag(np.diag(stretch))).max() > RIGID * np.abs(stretch).max()
        self.is_apart = thing.parent is not None and (above is None or not self.is_exact and not sheared)
        # True if a constraint gives the object a size that its own channels do not show.
        self.is_resized = not self.is_apart and self._is_resized(thing)
        if self.is_apart:
            self._leave_parent(thing, np.diag(stretch), sheared)

    def _is_resized(self, thing):
        """Tells whether constraints change the size of an object beside its own scale and its parent."""
        shown, alone = np.array(thing.matrix_world.to_3x3()), np.array(thing.matrix_basis.to_3x3())
        if self.above is not None:
            alone = self.above[0, :3, :3] @ alone
        return np.abs(alone.T @ alone - shown.T @ shown).max() > RIGID * np.abs(shown.T @ shown).max()

    def _is_rigid(self):
        """Tells whether a location and a rotation can show every pose in the frames above."""
        size, off = unit_scale(self.inner)
        above = np.eye(3)[None] if self.above is None else self.above[:, :3, :3]
        sizes, offs = unit_scale(above)
        return max(off, offs.max()) < RIGID and np.abs(sizes / size - 1).max() < RIGID

    def _leave_parent(self, thing, size, sheared):
        """Shows poses in the world, with the size of the object at the first frame."""
        self.above, self.inner = None, np.eye(3)
        self.scale = list(size / np.where(np.array(thing.delta_scale) == 0, 1, thing.delta_scale))
        stays = np.allclose(self.scale, thing.scale, rtol=RIGID)
        self.is_exact = not sheared and (stays or not animates(thing, "scale"))

    def values(self, poses, first=0):
        """Returns locations and quaternions of poses of a bake, from a frame of the scene on; 0 is its first."""
        places, turns = to_blender(poses)
        if self.above is None:
            local = product(turns, quaternions(nearest_rotations(self.inner)[None])[0])
        else:
            frames = np.minimum(first + np.arange(len(poses)), len(self.above) - 1)
            below = np.linalg.inv(self.above[frames])
            places = (below @ np.pad(places, ((0, 0), (0, 1)), constant_values=1)[..., None])[:, :3, 0]
            local = quaternions(nearest_rotations(below[:, :3, :3] @ matrices(turns) @ self.inner))
        return places - self.delta, continuous(product(self.delta_turn, local))
