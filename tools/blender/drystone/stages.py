"""OpenUSD stages of bakes, written by Drystone from the files of the cache."""

import json
import tempfile
from pathlib import Path

import numpy as np

from . import binary
from .cache import baked_scene, recording_of
from .recordings import BAKE, read_arrays, require
from .space import frames_per_second


def _as_frames(document, first, rate):
    """Makes a scene that begins at a frame of Blender, and whose steps are the frames."""
    by = 1 / (document["time_step"] * rate)
    for body in document["bodies"]:
        for keys in body.get("track", []):
            keys["time"] = keys["time"] * by + first / rate
        for track in (shape["vertex_track"] for shape in body["shapes"] if "vertex_track" in shape):
            track["times"] = [time * by + first / rate for time in track["times"]]
    for key in document.get("track", []):
        key["time"] = key["time"] * by + first / rate
    document["time_step"] = 1 / rate


def _with_joints(arrays):
    """Returns the arrays of a bake that a later part continues with no values of joints, but for their breaks."""
    if "joint_names" not in arrays or "joint_axes" in arrays:
        return arrays
    frames, joints = len(arrays["times"]), len(arrays["joint_names"])
    return {**arrays, "joint_axes": np.zeros(0, "<U1"), "joint_of_axis": np.zeros(0, np.uint32),
            "joint_values": np.zeros((frames, 0), np.float32), "joint_loads": np.zeros((frames, joints, 2), np.float32)}


def write_stage(program, folder, scene, path, instances=False):
    """Writes the bake of a scene as OpenUSD, whose time codes are the frames of the scene.

    With `instances`, equal bodies are instances of one prototype.
    """
    whole = recording_of(scene, folder)
    if not whole or not baked_scene(whole).exists():
        raise ValueError("The cache has no complete bake of this scene: bake it to its last frame first.")
    program = binary.find(program)
    if instances and not binary.abilities(program).instances:
        raise ValueError("This version of drystone writes no instances: install the version of the add-on, or "
                         "leave Instances out.")
    more = ["--instances"] if instances else []
    # OpenUSD has time codes to nine digits, and more of the rate would show in them.
    document, rate = json.loads(baked_scene(whole).read_text()), round(frames_per_second(scene), 6)
    first = document["extras"]["frame_start"]
    arrays = _with_joints(read_arrays(whole))
    require(arrays, whole, *BAKE)
    with tempfile.TemporaryDirectory() as place:
        bake, shapes = Path(place) / "bake.npz", Path(place) / "scene.json"
        np.savez(bake, **{**arrays, "times": (first + np.arange(len(arrays["times"]))) / rate})
        _as_frames(document, first, rate)
        shapes.write_text(json.dumps(document))
        code, _, messages = binary.run(program, "convert", bake, path, "--scene", shapes, *more)
    if code != 0:
        raise ValueError("; ".join(binary.said_plainly(messages)) or f"drystone ended with code {code}")
