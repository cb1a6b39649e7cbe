"""Tests of what changes since a bake beside keys, and of scenes that baked objects leave."""

import bpy
import numpy as np
from drystone import applying

from .common import PLACE, block, differences, empty, full_bake
from .passive import exported


def test_uneven_parent_deleted(program, folder):
    """Without its uneven parent, deleted while it was baked, an object has its own scale again, also in a next bake."""
    for bakes in (1, 2):
        scene = empty(last=12)
        parent = bpy.data.objects.new("uneven", None)
        scene.collection.objects.link(parent)
        parent.scale = (3, 1, 1)
        crate = block("crate", (0, 0, 5))
        crate.parent, crate.scale = parent, (1, 2, 1)
        full_bake(program, folder)
        assert np.allclose(crate.scale, (3, 2, 1)) and not crate.parent
        bpy.data.objects.remove(parent)
        exported()
        assert np.allclose(crate.scale, (3, 2, 1)), "a check changes nothing"
        for _ in range(bakes - 1):
            _, document, poses = full_bake(program, folder)
            assert np.allclose(crate.scale, (1, 2, 1)) and differences(document, poses)[0] < PLACE
        applying.delete_bake(scene)
        assert np.allclose(crate.scale, (1, 2, 1)) and np.allclose(crate.location, (0, 0, 5)) and not crate.parent
