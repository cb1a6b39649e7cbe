"""Recordings of bakes: arrays beside the keys, which later bakes begin from."""

import os
import zlib
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

VELOCITIES = ("linear_velocities", "angular_velocities")
# Arrays of every bake.
BAKE = ("names", "times", "poses")


class Recording:
    """Names, times, poses, and velocities and broken joints as far as the file has them."""

    def __init__(self, arrays):
        self.names = [str(name) for name in arrays["names"]]
        self.times = np.asarray(arrays["times"], float)
        self.poses = np.asarray(arrays["poses"])
        self.velocities = [np.asarray(arrays[key]) for key in VELOCITIES if key in arrays]
        self.joints = {}
        if "joint_broken" in arrays:
            names = [str(name) for name in arrays["joint_names"]]
            self.joints = dict(zip(names, np.asarray(arrays["joint_broken"]).tolist()))
        self._places = {name: i for i, name in enumerate(self.names)}

    @classmethod
    def read(cls, path):
        """Returns the recording in a file, or None if there is none of bodies in 3D."""
        try:
            found = cls(read_arrays(path, *BAKE, *VELOCITIES, "joint_names", "joint_broken"))
        except (OSError, ValueError, KeyError):
            return None
        return found if found.poses.ndim == 3 and found.poses.shape[2] == 7 else None

    @property
    def has_velocities(self):
        return len(self.velocities) == len(VELOCITIES)

    def rename(self, names):
        """Gives bodies other names; `names` has new ones by old ones."""
        self.names = [names.get(name, name) for name in self.names]
        self._places = {name: i for i, name in enumerate(self.names)}

    def place(self, name):
        """Returns the index of a body, or None."""
        return self._places.get(name)

    def has_step(self, step):
        """Tells whether the samples are a step apart. [s]"""
        return len(self.times) > 1 and np.allclose(np.diff(self.times), step, rtol=1e-5)

    def followed_by(self, later, count):
        """Returns the first samples of this recording and all of a later one, of whose bodies it is.

        Bodies that only the later one has are still until it begins.
        """
        places = [self.place(name) for name in later.names]

        def both(first, second):
            past = np.repeat(second[:1], count, axis=0)
            for i, place in enumerate(places):
                if place is not None:
                    past[:, i] = first[:count, place]
            return np.concatenate([past, second])

        step = later.times[1] - later.times[0] if len(later.times) > 1 else self.times[1] - self.times[0]
        arrays = {"names": np.array(later.names), "poses": both(self.poses, later.poses),
                  "times": np.arange(count + len(later.times)) * step}
        if self.has_velocities and later.has_velocities:
            arrays |= {key: both(*pair) for key, *pair in zip(VELOCITIES, self.velocities, later.velocities)}
        if later.joints:
            arrays["joint_names"] = np.array(list(later.joints))
            arrays["joint_broken"] = np.array([self._broken(name, first, count)
                                               for name, first in later.joints.items()], np.int64)
        return Recording(arrays)

    def _broken(self, name, later, count):
        """Returns the first sample in which a joint is broken, -1 for never."""
        before = self.joints.get(name, -1)
        return before if 0 <= before <= count else later + count if later >= 0 else -1

    def write(self, path):
        """Writes the arrays of the recording; the file under its name is always complete."""
        arrays = {"names": np.array(self.names), "times": self.times, "poses": self.poses}
        arrays |= dict(zip(VELOCITIES, self.velocities)) if self.has_velocities else {}
        if self.joints:
            arrays |= {"joint_names": np.array(list(self.joints)),
                       "joint_broken": np.array(list(self.joints.values()), np.int64)}
        write_arrays(path, arrays)


def read_arrays(path, *names):
    """Returns the arrays of a file that have these names, as far as it has them; without names, all."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files if name in names or not names}
    # NumPy has no error of its own for a file that it cannot read.
    except (BadZipFile, EOFError, TypeError, ValueError, zlib.error) as error:
        raise ValueError(f"{path} is no file of Drystone, or not complete") from error


def require(arrays, path, *names):
    """Raises an error if arrays of a file are missing."""
    missing = [name for name in names if name not in arrays]
    if missing:
        raise ValueError(f"{path} has no array {missing[0]!r}; accepted: files of drystone bake")


def write_arrays(path, arrays):
    """Writes arrays to a temporary name, which is then the final one."""
    partial = Path(path).with_suffix(".partial.npz")
    np.savez(partial, **arrays)
    os.replace(partial, path)
