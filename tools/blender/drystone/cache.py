"""Files of bakes: their folder, their names, and the recording that belongs to the keys of a scene."""

import hashlib
import os
import tempfile
from pathlib import Path

import bpy

# Folder of bakes, where the user names none.
FOLDER = "//drystone_cache"
# Custom property of a scene: path and digest of the recording of its last bake.
RECORDING = "drystone_recording"
# Longest name of a file without its endings [byte], and digits that make a changed name differ.
LONGEST, DIGITS = 120, 8


def _path_of(cache):
    """Returns the path of a folder for the files of bakes."""
    cache = cache or FOLDER
    if bpy.data.is_saved or not cache.startswith("//"):
        return Path(os.path.expanduser(bpy.path.abspath(cache)))
    return Path(bpy.app.tempdir or tempfile.gettempdir()) / "drystone"


def folder_of(cache):
    """Returns the folder for the files of bakes, made if need be."""
    path = _path_of(cache)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"The Cache folder {path} cannot be made ({error.strerror}): choose another one in the "
                         "Settings") from error
    return path


def whole_of(scene, folder):
    """Returns the path for the recording of a whole bake. Scenes of several files may share a folder."""
    file = Path(bpy.data.filepath).stem
    name = f"{file}-{scene.name}" if file else scene.name
    plain = bpy.path.clean_name(name).encode()[:LONGEST].decode(errors="ignore")
    if plain != name:
        plain += f"-{hashlib.sha1(name.encode()).hexdigest()[:DIGITS]}"
    return Path(folder) / f"{plain}.npz"


def journal_of(whole):
    """Returns the path of the frames so far of a whole bake; the program removes those of a complete one."""
    return Path(f"{whole}.journal")


def can_resume(scene, cache):
    """Tells whether a bake of a scene has ended early, also with a crash, and can go on."""
    return journal_of(whole_of(scene, _path_of(cache))).exists()


def baked_scene(whole):
    """Returns the path of the scene that belongs to the recording of a whole bake."""
    return whole.with_suffix(".scene.json")


def _digest(path):
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha1").hexdigest()


def remember(scene, path):
    """Notes the recording that belongs to the keys of a scene, or that there is none."""
    scene[RECORDING] = {"path": str(Path(path).resolve()), "digest": _digest(path)} if path else {}


def forget(scene):
    """Forgets the recording of a scene without a bake."""
    if RECORDING in scene:
        del scene[RECORDING]


def recording_of(scene, folder):
    """Returns the path of the recording that belongs to the keys of a scene, or None.

    A file saved under another name, or for the first time, still has the recording under the earlier one.
    """
    note, whole = scene.get(RECORDING), whole_of(scene, folder)
    if note is None:
        return whole if whole.exists() else None
    if "path" not in note:
        return None
    earlier = Path(note["path"])
    there = (path for path in (whole, Path(folder) / earlier.name, earlier) if path.is_file())
    return next((path for path in there if _digest(path) == note["digest"]), None)
