"""Survey of a scene: all that a bake does not take over, beside bodies, joints and force fields."""

import bpy

from .curves import HOLDS, TRANSFORMS, animates, paths_of
from .findings import CHANGED, LEFT_OUT
from .reading import read_by_drivers
from .sampling import may_be_moved, may_move
from .shapes import source_of
from .space import compound_of, first_frame, is_linked, objects_of, unlinked, world_of

# Physics of modifiers that rigid bodies of a bake do not feel.
OTHERS = {"CLOTH": "cloth", "SOFT_BODY": "soft body", "FLUID": "fluid", "DYNAMIC_PAINT": "dynamic paint"}
# Settings of the rigid body world whose keys act; of others only the first value counts.
FOLLOWED = ("rigidbody_world.time_scale", "rigidbody_world.effector_weights.gravity")
UNSEEN = " hidden or excluded: instances collide only where they are shown"
OFF = " whose rigid body world is disabled: baked, in Blender nothing is simulated"
SKIN = " with a mesh that moves without Deforming: of the shape at the first frame, as in Blender"
READ = " whose angles drivers read: of other values while baked, as it turns by a quaternion"


def survey_unseen(scene, inside, findings):
    """Notes bodies that the scene does not show, and a disabled world, before it is shown still."""
    if not world_of(scene).enabled:
        findings.add(CHANGED, "scene", OFF, scene.name)
    alone = unlinked(scene)
    for thing in alone:
        findings.add(CHANGED, "object", " in the rigid body world alone: part of the bake, as in Blender",
                     thing.name_full)
    for name, thing in inside.items():
        if thing not in alone and not thing.visible_get():
            findings.add(CHANGED, "object", " hidden or excluded: part of the bake, as in Blender", name)
    for thing in scene.objects:
        if not thing.visible_get() and any(of.rigid_body for of in _instanced(thing)):
            findings.add(LEFT_OUT, "instancer", UNSEEN, thing.name_full)


def _instanced(thing):
    """Returns the objects that an object may show as instances, by whatever means."""
    left, found = [thing], set()
    while left:
        above = left.pop()
        below = set(above.children) if above.instance_type in ("VERTS", "FACES") else set()
        sources = [above.instance_collection] if above.instance_type == "COLLECTION" else []
        sources += [of for each in above.modifiers if each.type == "NODES" for of in _inputs(each)]
        for of in sources:
            below |= set(of.all_objects) if isinstance(of, bpy.types.Collection) else {of}
        below = {of for of in below - found if isinstance(of, bpy.types.Object)}
        found |= below
        left += below
    return found


def _inputs(modifier):
    """Returns all that Geometry Nodes read: inputs of the modifier, and of its nodes."""
    found, left = [modifier[key] for key in modifier.keys()], [modifier.node_group]
    seen = set()
    while left:
        tree = left.pop()
        if tree and tree not in seen:
            seen.add(tree)
            found += [getattr(of, "default_value", None) for node in tree.nodes for of in node.inputs]
            left += [node.node_tree for node in tree.nodes if node.type == "GROUP"]
    return [of for of in found if isinstance(of, bpy.types.ID)]


def survey(scene, inside, findings, sampling, deforming=frozenset()):
    """Notes what a bake of a scene leaves out or has otherwise; `inside` has what Blender simulates, by name.

    `deforming` has the names of objects whose vertices the bake follows.
    """
    led, read = _led(scene, inside), read_by_drivers()
    for name, thing in objects_of(scene).items():
        if thing.rigid_body and name not in inside:
            findings.add(LEFT_OUT, "object", " outside of the rigid body world's collection: left out", name)
        elif thing.rigid_body:
            _body(thing, inside, findings, sampling.is_resized(name), name in deforming)
            if name in led:
                findings.add(CHANGED, "object", " with keys before the simulation starts: still until then", name)
            if name in read and _gets_keys(thing):
                findings.add(CHANGED, "object", READ, name)
        _others(thing, findings)
    _world(scene, findings)
    paths = paths_of(scene)
    if any(path.startswith("rigidbody_world") and path not in FOLLOWED for path in paths):
        findings.add(CHANGED, "scene", " with keys of rigid body world settings: the values at the first frame hold",
                     scene.name)


def _world(scene, findings):
    """Notes a range of the cache of the rigid body world that is not that of the scene."""
    def changed(text):
        findings.add(CHANGED, "scene", text, scene.name)

    cache, first = world_of(scene).point_cache, first_frame(scene)
    start, end = cache.frame_start, cache.frame_end
    if start > scene.frame_start:
        changed(f" whose simulation starts at frame {start}: baked from there, as in Blender")
    elif start < scene.frame_start:
        changed(f" whose simulation starts at frame {start}, before the first one: baked from frame {first}")
    if end < scene.frame_end:
        changed(f" whose simulation ends at frame {end}: baked to frame {scene.frame_end}, in Blender still from there")


def _led(scene, inside):
    """Returns the names of objects whose own keys a bake replaces before the simulation starts."""
    if first_frame(scene) <= scene.frame_start:
        return set()
    return {name for name, thing in inside.items() if _gets_keys(thing) and animates(thing, *TRANSFORMS)}


def _gets_keys(thing):
    """Tells whether a bake may put keys on an object: parts of compounds and objects of other files have none."""
    return may_move(thing) and not compound_of(thing) and not is_linked(thing)


def _is_skin(thing):
    """Tells whether an armature or keys of shapes may move the vertices that an object collides with."""
    if thing.type != "MESH" or source_of(thing) == "BASE":
        return False
    keys = thing.data.shape_keys
    if keys and keys.animation_data:
        return True
    rigs = [of.object for of in thing.modifiers if of.type == "ARMATURE" and of.show_viewport and of.object]
    return any(may_be_moved(rig) or any(bone.constraints for bone in rig.pose.bones) for rig in rigs)


def _body(thing, inside, findings, is_resized, is_followed):
    of = thing.rigid_body

    def changed(text):
        findings.add(CHANGED, "object", text, thing.name_full)

    compound = compound_of(thing)
    if compound and compound.name_full not in inside:
        findings.add(LEFT_OUT, "object", " of a compound that is no body of the bake: left out", thing.name_full)
    if any(path.startswith("rigid_body.") and path not in HOLDS for path in paths_of(thing)):
        changed(" with keys of rigid body settings: the values at the first frame hold")
    if animates(thing, "scale", "delta_scale") and not is_followed:
        changed(" with keys of scale: of the size at the first frame")
    elif is_resized and not is_followed:
        changed(" sized by a parent or a constraint: of the size at the first frame")
    if of.use_deform and not is_followed:
        changed(" with a mesh that deforms: of the shape at the first frame")
    if not of.use_deform and _is_skin(thing):
        noun = "passive object" if of.type == "PASSIVE" else "active object"
        findings.add(CHANGED, noun, SKIN, thing.name_full)
    if of.use_margin and of.collision_margin > 0:
        changed(" with a collision margin: without margin")
    if _gets_keys(thing) and any(each.enabled for each in thing.constraints):
        changed(" with object constraints: off while baked")


def _others(thing, findings):
    for kind in sorted({OTHERS[of.type] for of in thing.modifiers if of.type in OTHERS}):
        findings.add(LEFT_OUT, "object", f" with {kind}: without effect on the bake", thing.name_full)
    if thing.particle_systems:
        findings.add(LEFT_OUT, "object", " with particles: without effect on the bake", thing.name_full)
