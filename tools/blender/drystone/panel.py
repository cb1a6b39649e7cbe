"""The panel in the scene's properties."""

import textwrap

import bpy
from bpy.types import Panel

from . import binary, operators
from .cache import can_resume
from .findings import CHANGED, LEFT_OUT, PROBLEM
from .settings import VERSION, preference

ICONS = {LEFT_OUT: "CANCEL", CHANGED: "INFO", PROBLEM: "ERROR"}
# Mean width of a letter at the usual scale of the interface, and what icons and edges take. [pixel]
LETTER, EDGES = 7, 70


def wrapped(text, width, scale=1.0):
    """Returns lines of a text that fit into a region of a width."""
    return textwrap.wrap(text, max(20, int((width / scale - EDGES) / LETTER)))


def paragraph(layout, context, text, icon="NONE"):
    """Draws a text over as many lines as it needs."""
    lines = wrapped(text, context.region.width, context.preferences.system.ui_scale)
    column = layout.column(align=True)
    column.scale_y = 0.8
    for i, line in enumerate(lines):
        column.label(text=line, icon=icon if i == 0 else "BLANK1" if icon != "NONE" else "NONE")


def versions(context):
    """Returns the versions of the add-on and of the program, and whether something is to be done."""
    try:
        program = binary.version(binary.find(preference(context)))
    except ValueError as error:
        return str(error), True
    if program != VERSION:
        return f"Add-on {VERSION} is made for drystone {VERSION}, not {program}: install the same version.", True
    return f"Add-on {VERSION}, drystone {program}", False


class ScenePanel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "scene"


class Main(ScenePanel, Panel):
    bl_idname = "SCENE_PT_drystone"
    bl_label = "Drystone"

    def draw(self, context):
        layout, settings = self.layout, context.scene.drystone
        if operators.running:
            self.draw_progress(layout, operators.running)
            return
        layout.row().prop(settings, "quality", expand=True)
        layout.operator(operators.Baking.bl_idname, icon="PHYSICS")
        row = layout.row(align=True)
        if can_resume(context.scene, settings.cache):
            row.operator(operators.Baking.bl_idname, text="Resume").resume = True
        row.operator(operators.BakingFrom.bl_idname)
        row.operator(operators.Deleting.bl_idname)
        for line in settings.said.splitlines():
            paragraph(layout, context, line)

    @staticmethod
    def draw_progress(layout, bake):
        layout.progress(factor=bake.progress, text=bake.progress_text())
        layout.operator(operators.Stop.bl_idname, icon="CANCEL")


class Before(ScenePanel, Panel):
    bl_idname = "SCENE_PT_drystone_before"
    bl_label = "Before the Bake"
    bl_parent_id = Main.bl_idname

    def draw(self, context):
        layout, settings = self.layout, context.scene.drystone
        row = layout.row(align=True)
        row.operator(operators.Checking.bl_idname, icon="VIEWZOOM")
        row.operator(operators.Pieces.bl_idname, icon="MOD_EXPLODE")
        for found in settings.findings:
            row = layout.row()
            paragraph(row, context, found.line, ICONS[found.kind])
            select = row.operator(operators.Select.bl_idname, text="", icon="RESTRICT_SELECT_OFF")
            select.names, select.detail = found.names, found.detail
            if found.remedy:
                row.operator(found.remedy, text="Renew").names = found.names


class More(ScenePanel, Panel):
    bl_idname = "SCENE_PT_drystone_settings"
    bl_label = "Settings"
    bl_parent_id = Main.bl_idname
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.drystone
        layout.use_property_split = True
        layout.prop(settings, "only_selected")
        layout.prop(settings, "contacts")
        layout.prop(settings, "broken_pass")
        layout.prop(settings, "substeps")
        layout.prop(settings, "tolerance")
        layout.prop(settings, "cache")
        row = layout.row()
        row.operator(operators.Export.bl_idname, text="Export")
        row.operator(operators.Apply.bl_idname, text="Apply Bake")
        row.operator(operators.ExportBake.bl_idname, text="Export Bake")
        text, is_wrong = versions(context)
        paragraph(layout, context, text, "ERROR" if is_wrong else "NONE")


def in_export_menu(menu, _context):
    menu.layout.operator(operators.Export.bl_idname, text="Drystone Scene (.json)")
    menu.layout.operator(operators.ExportBake.bl_idname, text="Drystone Bake (.usda)")


def in_import_menu(menu, _context):
    menu.layout.operator(operators.Apply.bl_idname, text="Drystone Bake (.npz)")


CLASSES = [Main, Before, More]


def register():
    bpy.types.TOPBAR_MT_file_export.append(in_export_menu)
    bpy.types.TOPBAR_MT_file_import.append(in_import_menu)


def unregister():
    bpy.types.TOPBAR_MT_file_import.remove(in_import_menu)
    bpy.types.TOPBAR_MT_file_export.remove(in_export_menu)
