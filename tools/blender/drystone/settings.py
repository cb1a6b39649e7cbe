"""Settings of the add-on, and what the panel shows of the last bake."""

import json
import re
import tomllib
from pathlib import Path

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy.types import AddonPreferences, PropertyGroup

from .baking import Options

# Units of lengths in the words of the program. [m]
LENGTHS = {"mm": 1e-3, "m": 1.0}
MANIFEST = Path(__file__).parent / "blender_manifest.toml"
VERSION = tomllib.loads(MANIFEST.read_text())["version"]


class Preferences(AddonPreferences):
    bl_idname = __package__

    drystone: StringProperty(
        name="Program", subtype="FILE_PATH",
        description="The program drystone, or the folder that contains it. Empty: the one on the search path. A "
                    "program in the add-on's package comes first")

    def draw(self, _context):
        self.layout.prop(self, "drystone")


class FoundLine(PropertyGroup):
    """A finding, as the panel shows it."""

    line: StringProperty()
    kind: StringProperty()
    detail: StringProperty()
    # A list of names, as JSON.
    names: StringProperty()
    # Name of an operator that mends it.
    remedy: StringProperty()


class Settings(PropertyGroup):
    quality: EnumProperty(
        name="Quality", default="FINAL",
        items=[("PREVIEW", "Preview", "Fast and less exact: fixed work per step"),
               ("FINAL", "Final", "Every step is solved until its error is certified")])
    only_selected: BoolProperty(
        name="Only Selected",
        description="Bake the selected objects alone. The others keep the keys of their bake")
    contacts: BoolProperty(
        name="Contacts",
        description="Make the object Drystone Contacts: points of the contacts of each frame, for dust and sound")
    broken_pass: BoolProperty(
        name="Broken Pairs Pass",
        description="As in Blender, objects of a broken constraint with Disable Collisions never collide. Each such "
                    "constraint takes up to twice the time")
    substeps: IntProperty(name="Substeps", min=0, max=1000,
                          description="Substeps per frame; 0: as many as the scene needs")
    tolerance: FloatProperty(name="Tolerance", min=0, soft_max=100, unit="NONE", precision=3,
                             description="Largest error of velocities [mm/s]; 0: that of the quality")
    cache: StringProperty(
        name="Cache", subtype="DIR_PATH", default="//drystone_cache",
        description="Folder of the files of bakes; while the scene has no file, a temporary one")
    findings: CollectionProperty(type=FoundLine)
    # Lines of the summary of the last bake.
    said: StringProperty()

    def options(self):
        return Options(self.quality == "PREVIEW", self.substeps, self.tolerance, self.only_selected,
                       self.contacts, self.broken_pass)

    def show(self, findings):
        """Keeps findings for the panel."""
        self.findings.clear()
        for finding in findings:
            line = self.findings.add()
            line.line, line.kind, line.names = finding.line(), finding.kind, json.dumps(finding.names)
            line.remedy = finding.remedy
            line.detail = in_units(finding.detail, self.id_data.unit_settings)

    def tell(self, lines):
        """Keeps the summary of a bake for the panel."""
        self.said = "\n".join(in_units(line, self.id_data.unit_settings) for line in lines)


def in_units(text, units):
    """Returns a text with its lengths in the units of a scene; a unit of Blender is a meter of the simulation."""
    if units.system == "METRIC" and units.scale_length == 1:
        return text

    def length(found):
        size = float(found[1]) * LENGTHS[found[2]]
        if units.system == "NONE":
            return f"{size:.3g}"
        size *= units.scale_length
        return bpy.utils.units.to_string(units.system, "LENGTH", size, precision=3, compatible_unit=True)

    return re.sub(r"(?<![\w.])(\d[\d.]*(?:e-?\d+)?) (mm|m)\b(?![/^])", length, text)


def preference(context):
    """Returns the path of the program that the user has chosen."""
    addon = context.preferences.addons.get(__package__)
    return addon.preferences.drystone if addon else ""
