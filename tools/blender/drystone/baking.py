"""Bakes that run beside Blender, in small steps."""

import shutil
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

import bpy

from . import binary, contacts
from .applying import WAITING, Keys, at_frames, frames_in, read_bake
from .cache import baked_scene, journal_of, recording_of, remember, whole_of
from .exporting import Wishes, export, unselected
from .findings import CHANGED, LEFT_OUT, counted
from .locks import is_lock, of_constraints
from .owners import own_bake
from .space import scene_with
from .start import Start

# Longest work between two looks at the window. [s]
SLICE = 0.05
# Time between two looks at a running bake. [s]
PREVIEWS = 1.0
# Share of the time that keys of a running bake may take. [1]
SHARE = 0.4
UNUSABLE = " with an unusable mesh: solid as the convex hull"
# Lines of the summary of a bake that are passed on.
SAID = ("certified", "velocities", "joints", "note")


@dataclass(frozen=True)
class Options:
    """Settings of a bake. 0 stands for a choice of Drystone."""

    is_preview: bool = False
    substeps: int = 0
    # [mm/s]
    tolerance: float = 0.0
    # The others are as they are: those that are baked keep their keys.
    only_selected: bool = False
    # Points of contacts come with the keys.
    contacts: bool = False
    broken_pass: bool = False

    @property
    def wishes(self):
        return Wishes(self.substeps, self.broken_pass)

    def arguments(self):
        arguments = ["--realtime"] if self.is_preview else []
        return arguments + (["--tolerance", f"{self.tolerance:g}mm/s"] if self.tolerance else [])


def duration(seconds):
    """Returns a time as one reads it: 12 s, 3 min, 2.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def sentence_of(error):
    """Returns an error as a sentence. Those of the add-on's own are one; of others the console has more."""
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, (OSError, ValueError)):
        return str(error)
    traceback.print_exception(error)
    return f"An error of the add-on ended the work ({type(error).__name__}: {error})."


def take_out(shot, kind, index, where, why):
    """Makes a scene sound that was refused for one body or joint; tells whether that is possible."""
    document = shot.document
    if kind not in ("bodies", "joints") or index >= len(document.get(kind, [])):
        return False
    of = document[kind][index]
    followed = [shape for shape in of.get("shapes", []) if shape.pop("vertex_track", None)]
    if followed:
        text = " with a deformation that Drystone refuses: of the shape at the first frame"
        shot.findings.add(CHANGED, "object", text, of["name"], detail=why)
        return True
    meshes = [shape for shape in of.get("shapes", []) if shape["type"] == "trimesh"]
    if kind == "bodies" and where.startswith("shapes") and meshes:
        for shape in meshes:
            points = shape.pop("vertices")
            del shape["triangles"]
            shape |= {"type": "convex_hull", "points": points}
        shot.findings.add(CHANGED, "object", UNUSABLE, of["name"], detail=why)
        return True
    del document[kind][index]
    if kind == "joints" and is_lock(of):
        shot.findings.add(LEFT_OUT, "object", " with locks that Drystone refuses: without", *of["bodies"], detail=why)
        return True
    noun = "object" if kind == "bodies" else "constraint"
    shot.findings.withdraw("object", UNUSABLE, of["name"])
    shot.findings.add(LEFT_OUT, noun, " that Drystone refuses: left out", of["name"], detail=why)
    if kind == "bodies":
        shot.channels.pop(of["name"], None)
        joints = [joint for joint in document.get("joints", []) if of["name"] in joint["bodies"]]
        for joint in joints:
            if not is_lock(joint):
                shot.findings.add(LEFT_OUT, "constraint", " of an object that is no body of the bake: left out",
                                  joint["name"])
            document["joints"].remove(joint)
    return bool(document["bodies"])


class Work:
    """Work beside Blender's window. `poll` goes on with it for a moment.

    The steps are generators: each `yield` gives the window a turn.
    """

    # The export at hand, if there is one.
    shot = None

    def __init__(self, context, preference, options):
        # Undo may replace a scene.
        self.scene_uid = context.scene.session_uid
        self.program = binary.find(preference)
        self.options = options
        self.process = None
        self.is_cancelled = False
        self.error = ""
        # Summary for the panel.
        self.said = []
        self._steps = self._run()

    @property
    def scene(self):
        return scene_with(self.scene_uid)

    @property
    def has_scene(self):
        return any(scene.session_uid == self.scene_uid for scene in bpy.data.scenes)

    def poll(self, seconds=SLICE):
        """Goes on for a moment; tells whether there is more to do."""
        end = time.monotonic() + seconds
        try:
            # Raises an error if the scene was deleted.
            _ = self.scene
            self._refresh()
            while time.monotonic() < end:
                if next(self._steps) is WAITING:
                    return True
        except StopIteration:
            return False
        except Exception as error:  # Whatever it is, the window must get its operator back.
            self.error = sentence_of(error)
            self._stop()
            return False
        return True

    def finish(self):
        """Goes on to the end; returns the summary."""
        while self.poll():
            time.sleep(0.005)
        if self.error:
            raise ValueError(self.error)
        return self.said

    def cancel(self):
        """Stops the program. The frames so far get keys in the next polls."""
        self.is_cancelled = True
        self._stop()

    @property
    def progress(self):
        """Returns the part that is done, from 0 to 1."""
        return 0.0

    def _stop(self):
        if self.process:
            self.process.stop()

    def _refresh(self):
        """Forgets references into Blender's data, as undo may have replaced it since the last poll."""


class Check(Work):
    """An export that Drystone checks. With a start, the export begins inside of a bake."""

    def __init__(self, context, preference, options, folder, start=None):
        super().__init__(context, preference, options)
        # The recording of the whole bake, beside the scene file; the bake at hand may be the later part of it.
        self.whole = whole_of(context.scene, folder)
        self.scene_file = self.whole.with_suffix(".from.json" if start else ".json")
        self.kept = unselected(context) if options.only_selected else frozenset()
        self.abilities = binary.abilities(self.program)
        self.shot = export(context, self.abilities, options.wishes, self.kept, start)

    def progress_text(self):
        return "checks the scene"

    def _run(self):
        yield from self._check()

    def _check(self):
        """Writes the scene, without the bodies that Drystone refuses, and adds its findings."""
        while True:
            self.shot.write(self.scene_file)
            more = ["--realtime"] if self.options.is_preview else []
            self.process = binary.Program(self.program, "check", "--json", *more, self.scene_file)
            while self.process.is_running():
                yield WAITING
            code, output, messages = self.process.result()
            if self.is_cancelled:
                return
            if code in (0, 1):
                binary.add_problems(self.shot.findings, output, self.shot.document)
                return
            refused = binary.refusal(messages)
            if not refused or not take_out(self.shot, *refused):
                break
        raise ValueError("; ".join(binary.said_plainly(messages)) or "the scene is refused")


class Bake(Check):
    """A bake from export to keys. With `from_here`, of the frames from the current one on."""

    def __init__(self, context, preference, options, folder, resume=False, from_here=False):
        earlier = recording_of(context.scene, folder) if from_here else None
        self.start = Start(context, earlier, options.is_preview) if from_here else None
        super().__init__(context, preference, options, folder, self.start)
        # Contacts of the frames before the bake at hand.
        self.past_contacts = earlier.with_suffix(".contacts.npz") if earlier else None
        self.output = self.scene_file.with_suffix(".npz")
        self.preview = self.output.with_suffix(".preview.npz")
        self.journal = journal_of(self.output)
        self.resume = resume and self.journal.exists()
        self.is_anew = resume and not self.resume
        # True if the journal is of another scene.
        self.is_outdated = False
        self.keys = Keys(context.scene, self.shot.channels, self.start)
        self.total = self.shot.document["steps"] + 1
        self.step = self.shot.document["time_step"]
        self.started = time.monotonic()
        # Number of frames that were baked at the last look, and its time after the start. [s]
        self.done, self.done_after = 0, 0.0
        self.contacts = self.output.with_suffix(".contacts.npz")
        self.has_contacts = options.contacts and self.abilities.contacts
        if options.contacts and not self.abilities.contacts:
            self.shot.findings.add(LEFT_OUT, "", "Contacts are not known to this version of drystone: no points")

    @property
    def progress(self):
        """Returns the part of the frames that is baked."""
        return min(self.done / self.total, 1.0)

    @property
    def remaining(self):
        """Returns the time to the end as far as it can be told, or None. [s]"""
        return self.done_after * (1 / self.progress - 1) if self.done else None

    @property
    def is_stopped(self):
        """Tells whether the bake has ended early and can go on."""
        return not self.start and not self.is_outdated and self.journal.exists()

    def progress_text(self):
        left = self.remaining
        return f"{self.progress:.0%}" + (f", {duration(left)} left" if left is not None else "")

    def _refresh(self):
        self.keys.refresh()

    def _run(self):
        yield from self._check()
        yield from self.keys.begin(self.kept)
        if self.is_cancelled:
            self.said = ["stopped before the first frame"]
            return
        if not self.resume:
            self.journal.unlink(missing_ok=True)
        self.process = binary.Program(self.program, "bake", self.scene_file, "-o", self.output, *self._arguments())
        yield from self._follow()
        code, output, messages = self.process.result()
        baked = None
        if code == 0:
            baked = self.output
        elif self.journal.exists():
            yield from self._look(with_keys=True)
            baked = self.preview if self.preview.exists() else None
        if baked == self.output:
            yield from self._key(self.output)
        yield WAITING
        if baked and self.keys.are_lost():
            yield from self._key(baked)
        # A bake that had ended when it was stopped is kept whole, without a journal to go on from.
        self.is_cancelled = self.is_cancelled and code != 0
        self.keys.end(self.keys.frames - 1)
        self._keep(baked)
        self._summarize(code, output, messages)

    def _arguments(self):
        """Returns the options of the program."""
        more = ["--resume"] if self.resume else []
        more += ["--progress"] if self.abilities.progress else []
        more += ["--contacts", self.contacts] if self.has_contacts else []
        return ["--checkpoint", "1", *self.options.arguments(), *more]

    def _keep(self, baked):
        """Keeps the recording of the whole bake, shows its contacts, and removes other files."""
        # A bake that moves nothing, as without a selection, leaves no trace.
        if self.keys.frames and own_bake(self.scene):
            is_whole = self.start.merge(baked, self.whole) if self.start and baked else baked == self.output
            remember(self.scene, self.whole if is_whole else None)
            self._keep_scene(is_whole)
        if self.has_contacts and baked == self.output:
            self._show_contacts(self.whole.with_suffix(".contacts.npz"))
        else:
            self.whole.with_suffix(".contacts.npz").unlink(missing_ok=True)
            contacts.clear(self.scene)
        self.preview.unlink(missing_ok=True)
        if self.start:
            for file in (self.scene_file, self.output, self.journal, self.contacts):
                file.unlink(missing_ok=True)

    def _keep_scene(self, is_whole):
        """Keeps the scene of a whole recording, as checks and other bakes write theirs."""
        if self.start and is_whole:
            self.start.extend(self.shot.document)
            self.shot.write(baked_scene(self.whole))
        elif is_whole:
            shutil.copyfile(self.scene_file, baked_scene(self.whole))

    def _show_contacts(self, whole):
        """Shows the contacts of the bake, after those before it, and keeps them."""
        names = [body["name"] for body in self.shot.document["bodies"]]
        found, first = contacts.read(self.contacts, names), self.keys.first
        past = self.past_contacts
        before = contacts.read(past, []) if past and past.exists() else None
        if before and self.start.count < len(before["times"]):
            found, first = contacts.followed_by(before, found, self.start.count), self.start.first
        if first == self.keys.first and self.start:
            whole.unlink(missing_ok=True)
        else:
            contacts.write(whole, found)
        contacts.show(self.scene, found, first, self.step)

    def _follow(self):
        """Counts the frames so far and keys them, from time to time while the program runs."""
        look = keys = time.monotonic() + PREVIEWS
        while self.process.is_running():
            began = time.monotonic()
            if began >= look and self.journal.exists():
                self._count()
                if began >= keys or not self.abilities.progress:
                    yield from self._look(began >= keys)
                now = time.monotonic()
                look = now + PREVIEWS
                if began >= keys:
                    keys = now + (now - began) * (1 / SHARE - 1)
            yield WAITING
        self._count()

    def _count(self):
        """Counts the frames so far by what the program says."""
        done = binary.frames_done(self.process.messages()) if self.abilities.progress else None
        if done and done > self.done:
            self.done, self.done_after = done, time.monotonic() - self.started

    def _look(self, with_keys):
        """Counts the frames of the journal, and keys them if wanted."""
        reader = binary.Program(self.program, "convert", self.journal, self.preview, "--scene", self.scene_file)
        while reader.is_running():
            yield WAITING
        # Before the first frame is written, a journal is no bake yet.
        if reader.result()[0] == 0:
            self.done = max(self.done, frames_in(self.preview))
            self.done_after = time.monotonic() - self.started
            if with_keys:
                yield from self._key(self.preview)

    def _key(self, path):
        names, times, poses = read_bake(path)
        frames, poses = at_frames(times, poses, self.step)
        if len(frames) > self.keys.frames or self.keys.are_lost():
            yield from self.keys.write(names, frames, poses)

    def _summarize(self, code, output, messages):
        last = self.keys.first + self.keys.frames - 1
        kept = [f"baked up to frame {last}"] if self.keys.frames else []
        goes_on = ": Resume goes on" if self.is_stopped else ": Bake from Here goes on" if kept else ""
        if self.is_cancelled:
            self.said = [", ".join(["stopped", *(kept or ["before the first frame"])]) + goes_on]
        elif self.resume and "cannot be resumed" in messages:
            self.error, self.is_outdated = "The scene has changed since the bake was stopped: bake it anew.", True
            return
        elif code != 0:
            self.error = "; ".join((binary.said_plainly(messages) or [f"drystone ended with code {code}"]) + kept)
            self.error += goes_on if kept else ""
            return
        else:
            self.said = [f"{counted(len(self.keys.taken), 'body')} baked"]
            self.said += ["no files of the stopped bake: baked from the first frame"] if self.is_anew else []
            lines = [line for line in output.splitlines() if line.startswith(SAID)]
            self.said += of_constraints(lines, self.shot.document.get("joints", []))
            self.said += binary.said_plainly(messages)
        self.said += [f"'{name}' is gone" for name in self.keys.missing()]
        self.said += [f"'{name}' has another parent than at the start of the bake: bake again"
                      for name in self.keys.reparented()]
