"""Blender add-on: bakes the rigid bodies of a scene with Drystone."""

bl_info = {
    "name": "Drystone",
    "author": "The Drystone developers",
    "version": (0, 1, 0),
    "blender": (4, 4, 0),
    "location": "Properties > Scene > Drystone",
    "description": "Certified rigid body bakes",
    "category": "Physics",
}

import bpy  # noqa: E402

from . import operators, overrides, panel, settings  # noqa: E402

CLASSES = [settings.Preferences, settings.FoundLine, settings.Settings, *operators.CLASSES, *panel.CLASSES]


@bpy.app.handlers.persistent
def abandon(*_):
    operators.abandon()


@bpy.app.handlers.persistent
def take_states(*_):
    overrides.take_all()


@bpy.app.handlers.persistent
def keep_states(*_):
    overrides.keep_all()


def register():
    for of in CLASSES:
        bpy.utils.register_class(of)
    bpy.types.Scene.drystone = bpy.props.PointerProperty(type=settings.Settings)
    panel.register()
    bpy.app.handlers.load_pre.append(abandon)
    bpy.app.handlers.load_post.append(take_states)
    bpy.app.handlers.save_pre.append(keep_states)


def unregister():
    bpy.app.handlers.load_pre.remove(abandon)
    bpy.app.handlers.load_post.remove(take_states)
    bpy.app.handlers.save_pre.remove(keep_states)
    operators.abandon()
    panel.unregister()
    del bpy.types.Scene.drystone
    for of in reversed(CLASSES):
        bpy.utils.unregister_class(of)
