"""The command line of Drystone: where it is, what it knows and what it says."""

import functools
import json
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy

from .exporting import Abilities
from .findings import PROBLEM
from .locks import is_lock

NAME = "drystone.exe" if sys.platform == "win32" else "drystone"
BUNDLED = Path(__file__).parent / "bin" / NAME
# A window of its own would open for every command on Windows.
NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)
# Priority of programs that run beside the window, on Windows.
LOW = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)
# A scene with a body that is released.
RELEASE = {"bodies": [{"name": "thrown", "shapes": [{"type": "sphere", "radius": 0.5}],
                       "track": [{"time": 0, "position": [0, 0, 0]}, {"time": 1, "position": [1, 0, 0]}]}]}
# The refusal of a scene: where in it, and why.
REFUSAL = re.compile(r"^drystone: (?:.*?) at (/\S*): (.*)$", re.MULTILINE)
# Progress of a bake, a line at a time.
PROGRESS = re.compile(r"^frame (\d+) of (\d+) \(.*$", re.MULTILINE)
# Length of the latest messages of a running program. [byte]
LATEST = 1000
# Phrases for kinds of findings of `drystone check`, of several objects.
KINDS = {
    "overlap": " in overlap at the start: pushed apart",
    "wedged": " wedged: no motion opens the contacts",
    "mass_ratio": " of very different mass upon each other: slow to solve",
    "frictionless": " without friction below a load: likely to slide away",
    "too_fast": " fast and thin enough to tunnel",
    "jump": " with a jump between two keys",
    "missed_key": " with a key between two steps that is missed",
    "too_large": " very large",
    "too_small": " very thin",
    "too_far": " far from the origin",
    "negative_scale": " of mirrored shape",
    "uneven_scale": " of unevenly scaled shape",
    "inside_out_mesh": " with a mesh that faces inward",
    "open_mesh": " with holes in the mesh",
    "crossing_mesh": " with a mesh that intersects itself",
    "decomposition": " with a mesh that its convex pieces miss",
    "lossless_bounce": " of a bounce without loss: no rest",
    "idle_bounce": " with a bounciness that never acts",
    "joint_apart": " held by constraints that start apart",
    "joint_turned": " held by constraints that start turned",
    "joint_limit": " held by constraints that start beyond their limits",
    "joint_idle": " of infinite mass held by a constraint: it does nothing",
    "joint_mass_ratio": " of very different mass held by a constraint",
    "joint_singular": " held by constraints whose middle angle is near 90 degrees: the others turn about one axis",
    "joint_housing": " held by a body that turns: gears count its rotation, too",
}
# Phrases for remarks on values of a scene, by words in these; they are of the kind "left_out".
REMARKS = {
    "all its coordinates are free": " without limits, springs and motors: joins nothing",
    "has anchors that are": " with ends far apart at the start",
    "beyond the largest value of this angle": " with a limit beyond the largest value of its angle",
    "without area, which touch nothing": " with triangles without area: these touch nothing",
    "from the origin, where": KINDS["too_far"],
}
UNFORESEEN = " with a value that acts otherwise, or not at all"
# Where in a scene a remark is.
PLACE = re.compile(r"^/(bodies|joints|gravity|time_step|steps|solver)\b(?:/(\d+))?\S*: ")
# Lists of a scene, and what its items are in Blender.
NOUNS = {"bodies": "object", "joints": "constraint"}


def _executable(path):
    """Returns a path if it is a program. Extensions are unpacked without the right to execute."""
    if not path.is_file():
        return None
    if not os.access(path, os.X_OK):
        try:
            path.chmod(path.stat().st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
        except OSError:
            return None
    return path


def _preferred(preference):
    """Returns the program that the preference names: a file, a folder with it, or a command."""
    if not preference:
        return None
    path = Path(os.path.expanduser(bpy.path.abspath(preference)))
    if path.is_dir():
        return _executable(path / NAME)
    found = shutil.which(preference)
    return _executable(path) or (Path(found) if found else None)


def find(preference=""):
    """Returns the path of the program: in the package, by the preference, or on the search path."""
    found = shutil.which(NAME)
    path = _executable(BUNDLED) or _preferred(preference) or (Path(found) if found else None)
    if path is None:
        raise ValueError("The program drystone is missing: choose it in Edit > Preferences > Add-ons > Drystone.")
    return path


def run(path, *arguments):
    """Runs the program to its end; returns its exit code, its output and its messages."""
    done = subprocess.run([path, *arguments], capture_output=True, encoding="utf-8", creationflags=NO_WINDOW)
    return done.returncode, done.stdout, done.stderr


class Program:
    """The program while it runs. Its words go to files, as a full pipe would stop it."""

    def __init__(self, path, *arguments):
        self._output = tempfile.TemporaryFile("w+", encoding="utf-8")
        self._messages = tempfile.TemporaryFile("w+", encoding="utf-8")
        self._process = subprocess.Popen([path, *arguments], stdout=self._output, stderr=self._messages,
                                         creationflags=NO_WINDOW | LOW)
        # Blender's window comes before it.
        if hasattr(os, "setpriority"):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, 10)

    def is_running(self):
        return self._process.poll() is None

    def stop(self):
        if self.is_running():
            self._process.terminate()

    def messages(self):
        """Returns the last messages so far."""
        # The program shares the place in the file, so that it must not move.
        size = os.fstat(self._messages.fileno()).st_size
        return os.pread(self._messages.fileno(), LATEST, max(0, size - LATEST)).decode("utf-8", "replace")

    def result(self):
        """Waits for its end; returns its exit code, its output and its messages."""
        code = self._process.wait()
        words = []
        for file in (self._output, self._messages):
            file.seek(0)
            words.append(file.read())
        return code, *words


@functools.lru_cache
def _asked(path, _changed, *arguments):
    return run(path, *arguments)[1]


def ask(path, *arguments):
    """Returns what a program answers, asked once as long as its file does not change."""
    try:
        return _asked(path, path.stat().st_mtime_ns, *arguments)
    except OSError as error:
        raise ValueError(f"{path} does not start: {error.strerror}") from error


def version(path):
    """Returns the version of a program. What calls itself otherwise is none of Drystone."""
    name, _, number = ask(path, "--version").strip().partition(" ")
    if name != "drystone":
        raise ValueError(f"{path} is not drystone")
    return number


def abilities(path):
    """Returns the keys of scenes and the commands that a program knows."""
    version(path)
    schema, bake = ask(path, "schema"), ask(path, "bake", "--help")
    body = json.loads(schema)["$defs"]["Body"]["properties"]
    return Abilities(
        start_asleep="start_asleep" in body,
        force="force" in body,
        release=_releases(path, path.stat().st_mtime_ns),
        vertex_track='"vertex_track"' in schema,
        world_track='"WorldKey"' in schema,
        contacts="--contacts" in bake,
        # Windows has no way to read a file without moving the place that the program writes at.
        progress="--progress" in bake and hasattr(os, "pread"),
        instances="--instances" in ask(path, "convert", "--help"),
        decompose=re.search(r"^  decompose ", ask(path, "--help"), re.MULTILINE) is not None)


@functools.lru_cache
def _releases(path, _changed):
    """Tells whether a program takes a scene with a dynamic body that follows a track at first."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.json"
        scene.write_text(json.dumps(RELEASE))
        return run(path, "check", scene)[0] in (0, 1)


# Messages on a scene


def refusal(messages):
    """Returns where and why the program refused a scene: ("bodies", 3, "shapes ...", text), or None."""
    found = REFUSAL.search(messages)
    if not found:
        return None
    _, kind, index, *rest = [*found[1].split("/"), "", ""]
    return (kind, int(index), "/".join(rest), found[2]) if index.isdigit() else None


def frames_done(messages):
    """Returns the number of the last frame that a bake says it has done, or None."""
    found = PROGRESS.findall(messages)
    return int(found[-1][0]) if found else None


def said_plainly(messages):
    """Returns messages without progress, the program's name and the paths of files."""
    words = [line for line in messages.strip().splitlines() if line and not PROGRESS.match(line)]
    lines = [re.sub(r"^drystone: (warning: )?", "", line) for line in words]
    lines = [re.sub(r"^\S+\.(json|npz|journal)( at /\S*)?: ", "", line) for line in lines]
    return [PLACE.sub("", line) for line in lines]


def add_problems(findings, report, document):
    """Adds the findings of `drystone check --json` on a document."""
    by_kind = {}
    joints = document.get("joints", [])
    for found in json.loads(report)["findings"]:
        if found["kind"] == "left_out":
            _add_remark(findings, found, document)
        # A lock acts from the release of its body on, wherever this is before.
        elif "joint" not in found or not is_lock(joints[found["joint"]]):
            by_kind.setdefault(found["kind"], []).append(found)
    for kind, several in by_kind.items():
        names = [name for found in several for name in found["names"]]
        joined = [joints[found["joint"]]["name"] for found in several if "joint" in found]
        detail = f"{several[0]['what']}; {several[0]['advice']}"
        text = KINDS.get(kind, f": {kind.replace('_', ' ')}")
        findings.add(PROBLEM, "object" if names else "constraint", text, *(names or joined), detail=detail)


def _add_remark(findings, found, document):
    """Adds a remark on a value, whose place in the document tells the object or the constraint."""
    place, words = PLACE.match(found["what"]), PLACE.sub("", found["what"])
    text = next((text for part, text in REMARKS.items() if part in words), UNFORESEEN)
    kind, index = (place[1], int(place[2] or 0)) if place else ("", 0)
    several = document.get(kind, []) if kind in NOUNS else []
    noun, name = (NOUNS[kind], several[index]["name"]) if index < len(several) else ("scene", document["name"])
    findings.add(PROBLEM, noun, text, name, detail=f"{words}; {found['advice']}")
