"""Operators: bake, check, delete, select, export and import."""

import json

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy.types import Operator
from bpy_extras.io_utils import ExportHelper, ImportHelper

from . import binary
from .applying import apply, delete_bake
from .baking import Bake, Check, sentence_of
from .cache import folder_of
from .cutting import Cutting
from .exporting import Abilities, export
from .findings import LEFT_OUT, Finding, counted
from .originals import baked_things
from .owners import own_bake, strays
from .pieces import OPERATOR
from .settings import preference
from .stages import write_stage

# Time between two looks at a running bake. [s]
TICK = 0.05
# Phrase for baked objects in other scenes whose own scene was deleted, or is not noted.
STRAY = " in other scenes alone: delete the bake there"
# The bake or the check that runs, if any.
running = None


class Running:
    """An operator that goes on beside the window, until Esc. `make` returns its work."""

    @classmethod
    def poll(cls, _context):
        return running is None

    def execute(self, context):
        if not self._start(context):
            return {"CANCELLED"}
        try:
            running.finish()
        except ValueError:
            pass
        return self._end(context)

    def invoke(self, context, _event):
        if bpy.app.background:
            return self.execute(context)
        if not self._start(context):
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if not running:
            context.window_manager.event_timer_remove(self._timer)
            return {"CANCELLED"}
        if event.type == "ESC" and event.value == "PRESS":
            running.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        goes_on = running.poll()
        redraw(context)
        if goes_on:
            tell(context, f"Drystone: {running.progress_text()}. Esc: stop")
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        return self._end(context)

    def cancel(self, context):
        """Stops the work when its window is closed, so that another one can begin."""
        context.window_manager.event_timer_remove(self._timer)
        abandon()

    def _start(self, context):
        global running
        settings = context.scene.drystone
        try:
            running = self.make(context, preference(context), settings.options(),
                                folder_of(settings.cache))
        except Exception as error:  # Whatever it is, the user is told in a sentence.
            self.report({"ERROR"}, sentence_of(error))
        return running is not None

    def _end(self, context):
        global running
        work, running = running, None
        if work.shot and work.has_scene:
            work.scene.drystone.show(work.shot.findings)
        tell(context, None)
        redraw(context)
        if work.error:
            self.report({"ERROR"}, work.error)
        return self.show(work) if work.has_scene else {"CANCELLED"}


class Baking(Running, Operator):
    """Bake all rigid bodies with Drystone and key them, from the first frame to the last. Esc stops"""

    bl_idname = "drystone.bake"
    bl_label = "Bake with Drystone"
    bl_options = {"REGISTER", "UNDO"}

    resume: BoolProperty(name="Resume", description="Go on with a bake that was stopped",
                         options={"HIDDEN", "SKIP_SAVE"})

    def make(self, *settings):
        return Bake(*settings, self.resume)

    def show(self, work):
        settings = work.scene.drystone
        settings.tell(work.said or [work.error])
        for line in work.said:
            self.report({"INFO"}, line)
        return {"FINISHED"} if work.keys.taken else {"CANCELLED"}


class BakingFrom(Running, Operator):
    """Bake from the current frame on. The frames before stay, and all goes on with its place and velocity"""

    bl_idname = "drystone.bake_from"
    bl_label = "Bake from Here"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return running is None and bool(baked_things(context.scene))

    def make(self, *settings):
        return Bake(*settings, from_here=True)

    show = Baking.show


class Pieces(Running, Operator):
    """Show the convex pieces of selected active objects of the shape Mesh, or of all. Bakes use these pieces"""

    bl_idname = OPERATOR
    bl_label = "Show Pieces"
    bl_options = {"REGISTER", "UNDO"}

    # A list of names, as JSON; empty for the selection.
    names: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def make(self, *settings):
        return Cutting(*settings, json.loads(self.names or "[]"))

    def show(self, work):
        for line in work.said:
            self.report({"INFO"}, line)
        return {"CANCELLED"} if work.error or work.is_cancelled else {"FINISHED"}


class Checking(Running, Operator):
    """List all that Drystone leaves out of this scene or takes over differently, and problems of the scene"""

    bl_idname = "drystone.check"
    bl_label = "Check"

    def make(self, *settings):
        return Check(*settings)

    def show(self, work):
        for finding in work.shot.findings:
            self.report({"INFO"}, finding.sentence())
        return {"CANCELLED"} if work.error else {"FINISHED"}


def abandon(*_):
    """Stops a bake whose scene goes away, as when another file is opened."""
    global running
    bake, running = running, None
    if bake:
        bake.cancel()


def tell(context, text):
    """Shows a text at the lower edge of the window, or the usual one."""
    if context.workspace:
        context.workspace.status_text_set(text)


def redraw(context):
    for area in context.screen.areas if context.screen else []:
        if area.type == "PROPERTIES":
            area.tag_redraw()


class Stop(Operator):
    """Stop the bake and keep the frames so far"""

    bl_idname = "drystone.stop"
    bl_label = "Stop"

    def execute(self, _context):
        if running:
            running.cancel()
        return {"FINISHED"}


class Select(Operator):
    """Select these objects"""

    bl_idname = "drystone.select"
    bl_label = "Select"
    bl_options = {"REGISTER", "UNDO"}

    # A list of names, as JSON.
    names: StringProperty(options={"HIDDEN"})
    detail: StringProperty(options={"HIDDEN"})

    @classmethod
    def description(cls, _context, properties):
        return properties.detail or cls.__doc__

    def execute(self, context):
        names = set(json.loads(self.names))
        things = [thing for thing in context.view_layer.objects if thing.name_full in names and thing.visible_get()]
        for thing in context.view_layer.objects:
            thing.select_set(thing in things)
        if things:
            context.view_layer.objects.active = things[0]
        if len(things) < len(names):
            self.report({"INFO"}, f"{len(names) - len(things)} of {len(names)} are hidden, renamed or deleted")
        return {"FINISHED"}


class Deleting(Operator):
    """Restore all baked objects: their place, their own keys and their rigid bodies"""

    bl_idname = "drystone.delete_bake"
    bl_label = "Delete Bake"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return running is None and bool(own_bake(context.scene))

    def execute(self, context):
        delete_bake(context.scene)
        left = [thing.name for thing in strays()]
        said = [Finding(LEFT_OUT, "baked object", STRAY, left).sentence()] if left else []
        context.scene.drystone.tell(said)
        for line in said:
            self.report({"WARNING"}, line)
        return {"FINISHED"}


class Export(Operator, ExportHelper):
    """Write the rigid bodies of this scene for Drystone"""

    bl_idname = "drystone.export_scene"
    bl_label = "Export for Drystone"
    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def execute(self, context):
        settings = context.scene.drystone
        try:
            shot = export(context, self._abilities(context), settings.options().wishes)
            shot.write(bpy.path.abspath(self.filepath))
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, sentence_of(error))
            return {"CANCELLED"}
        settings.show(shot.findings)
        for finding in shot.findings:
            self.report({"WARNING"}, finding.sentence())
        return {"FINISHED"}

    @staticmethod
    def _abilities(context):
        """Returns what the program on this machine knows. A scene can be written without one."""
        try:
            return binary.abilities(binary.find(preference(context)))
        except ValueError:
            return Abilities()


class ExportBake(Operator, ExportHelper):
    """Write the bake of this scene as OpenUSD, with the shapes that collide"""

    bl_idname = "drystone.export_bake"
    bl_label = "Export Drystone Bake"
    filename_ext = ".usda"
    filter_glob: StringProperty(default="*.usda", options={"HIDDEN"})
    instances: BoolProperty(name="Instances", description="Write equal bodies as point instances of one shape, "
                            "so that thousands of pieces open fast in Houdini and usdview")

    @classmethod
    def poll(cls, context):
        return running is None and bool(baked_things(context.scene))

    def execute(self, context):
        folder = folder_of(context.scene.drystone.cache)
        try:
            write_stage(preference(context), folder, context.scene, bpy.path.abspath(self.filepath), self.instances)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, sentence_of(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class Apply(Operator, ImportHelper):
    """Key the bodies of a bake on the objects of the same names"""

    bl_idname = "drystone.apply_bake"
    bl_label = "Apply Drystone Bake"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".npz"
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})

    @classmethod
    def poll(cls, _context):
        return running is None

    def execute(self, context):
        try:
            count, missing = apply(context, bpy.path.abspath(self.filepath))
        except (OSError, ValueError, KeyError) as error:
            self.report({"ERROR"}, sentence_of(error))
            return {"CANCELLED"}
        for name in missing:
            self.report({"WARNING"}, f"no object is called '{name}'")
        self.report({"INFO"}, f"keys on {counted(count, 'object')}")
        return {"FINISHED"} if count else {"CANCELLED"}


CLASSES = [Baking, BakingFrom, Pieces, Stop, Checking, Select, Deleting, Export, ExportBake, Apply]
