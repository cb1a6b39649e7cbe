"""Scenes that bakes belong to. An object may be in several scenes, and may move to another one after its bake."""

import uuid

import bpy

from .space import ORIGINAL, is_baked, objects_of

# Custom property of a scene: the mark of its bakes, which the states of their objects have, too.
MARK = "drystone_bake"
# Key of a state with the mark of its bake. States of older versions have none.
OWNER = "bake"


def mark_of(scene):
    """Returns the mark of the bakes of a scene, made if need be."""
    if not isinstance(scene.get(MARK), str):
        scene[MARK] = uuid.uuid4().hex
    return scene[MARK]


class Owners:
    """The scenes of all bakes at this moment. Copies of a scene have its mark, so that several may have one."""

    def __init__(self):
        self._scenes, self._things = {}, {}
        for scene in bpy.data.scenes:
            if not scene.library and scene.get(MARK):
                self._scenes.setdefault(scene[MARK], []).append(scene)

    def shows(self, scene, thing):
        """Tells whether an object is in a scene, or in its rigid body world."""
        uid = scene.session_uid
        if uid not in self._things:
            self._things[uid] = set(objects_of(scene).values())
        return thing in self._things[uid]

    def owners(self, thing, mark):
        """Returns the scenes whose bake an object with a mark is of: those that show it, or else all of its mark."""
        scenes = self._scenes.get(mark, [])
        return [scene for scene in scenes if self.shows(scene, thing)] or scenes

    def has_bake(self, scene, thing):
        """Tells whether a baked object is of the bake of a scene.

        An object whose scenes do not show it is also of the scene that does, as is one without such scenes.
        """
        owners = self.owners(thing, thing[ORIGINAL].get(OWNER))
        return scene in owners or self.shows(scene, thing) and not any(self.shows(of, thing) for of in owners)

    def has_contacts(self, scene, thing, mark):
        """Tells whether an object with the contacts of a bake of a mark is of a scene."""
        owners = self.owners(thing, mark)
        return scene in owners if owners else self.shows(scene, thing)

    def is_stray(self, thing):
        """Tells whether a baked object is of no scene's bake, and in none where a bake or its end restores it."""
        mark = thing[ORIGINAL].get(OWNER)
        return not self.owners(thing, mark) and (mark is not None or not any(
            scene.rigidbody_world for scene in thing.users_scene))


def own_bake(scene):
    """Returns the objects of the bake of a scene, wherever they are by now."""
    owners = Owners()
    return [thing for thing in bpy.data.objects if is_baked(thing) and not thing.library
            and owners.has_bake(scene, thing)]


def strays():
    """Returns the baked objects that the end of a bake in their own scene alone restores."""
    owners = Owners()
    return [thing for thing in bpy.data.objects if is_baked(thing) and not thing.library and owners.is_stray(thing)]


def baked_elsewhere(scene, names):
    """Returns those of the objects with these names that are of the bake of another scene."""
    owners, there = Owners(), objects_of(scene)
    return [name for name in names if is_baked(there[name]) and not owners.has_bake(scene, there[name])]
