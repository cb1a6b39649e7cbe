"""F-curves and drivers of objects."""

import hashlib

import numpy as np

# Properties that place an object. A bake replaces their keys.
TRANSFORMS = ("location", "rotation_", "delta_location", "delta_rotation_")
# Properties whose keys release an active body, or hold it.
HOLDS = ("rigid_body.kinematic", "rigid_body.enabled")


def channelbags(action, slot):
    """Returns the bags of F-curves that an action has for a slot."""
    if not action or not slot:
        return []
    bags = [strip.channelbag(slot) for layer in action.layers for strip in layer.strips]
    return [bag for bag in bags if bag]


def curves_of(owner):
    """Returns the F-curves of the action of an object or a scene."""
    data = owner.animation_data
    bags = channelbags(data.action, data.action_slot) if data else []
    return [curve for bag in bags for curve in bag.fcurves]


def drivers_of(owner):
    """Returns the drivers of an object or a scene."""
    return list(owner.animation_data.drivers) if owner.animation_data else []


def strips_of(owner, only_active=False):
    """Returns all strips of an object or a scene that have an action, those within meta strips included.

    Active ones are not muted, nor is their track.
    """
    data = owner.animation_data
    tracks = [track for track in data.nla_tracks if not (only_active and track.mute)] if data else []
    left, found = [strip for track in tracks for strip in track.strips], []
    while left:
        strip = left.pop()
        if only_active and strip.mute:
            continue
        left += strip.strips
        found += [strip] if strip.action and strip.action_slot else []
    return found


def paths_of(owner):
    """Returns the paths of all properties with keys or drivers, those of NLA strips included."""
    curves = curves_of(owner) + drivers_of(owner)
    for strip in strips_of(owner):
        for bag in channelbags(strip.action, strip.action_slot):
            curves += bag.fcurves
    return {curve.data_path for curve in curves}


def animates(owner, *prefixes):
    """Tells whether there are keys or drivers of properties whose paths begin so."""
    return any(path.startswith(prefixes) for path in paths_of(owner))


def is_replaced(path):
    """Tells whether keys and drivers of a property would act against those of a bake."""
    mutes = path.startswith("constraints[") and path.endswith((".enabled", ".mute"))
    return mutes or path.startswith((*TRANSFORMS, *HOLDS))


def all_of(curve):
    """Returns all that makes two F-curves differ: keys with handles, and modifiers."""
    points, parts = curve.keyframe_points, [curve.extrapolation, curve.mute]
    kinds = {"co": np.float32, "handle_left": np.float32, "handle_right": np.float32,
             "interpolation": np.int32, "easing": np.int32}
    for key, kind in kinds.items():
        values = np.empty((2 if kind == np.float32 else 1) * len(points), kind)
        points.foreach_get(key, values)
        parts.append(values.tobytes())
    return parts + [_settings(of) for of in curve.modifiers]


def _settings(owner):
    """Returns the settings of a modifier as plain values."""
    found = []
    for key, of in owner.bl_rna.properties.items():
        if of.type == "COLLECTION":
            found.append([_settings(each) for each in getattr(owner, key)])
        elif of.type != "POINTER":
            found.append(list(getattr(owner, key)) if getattr(of, "is_array", False) else getattr(owner, key))
    return found


def key_of(curve):
    """Returns path and index of an F-curve as one text."""
    return f"{curve.data_path} {curve.array_index}"


def digests_of(action, slot):
    """Returns digests of all F-curves of a slot, by path and index."""
    return {key_of(of): hashlib.sha1(repr(all_of(of)).encode()).hexdigest()
            for bag in channelbags(action, slot) for of in bag.fcurves}


def copy_curves(bag, bags, keys):
    """Makes F-curves of a bag, by path and index, those of other bags. It loses those that these do not have."""
    for curve in [curve for curve in bag.fcurves if key_of(curve) in keys]:
        bag.fcurves.remove(curve)
    for curve in [curve for each in bags for curve in each.fcurves if key_of(curve) in keys]:
        bag.fcurves.new_from_fcurve(curve)


def set_keys(bag, path, frames, values, past=None):
    """Makes a bag have these keys of one property: a curve per component, straight between keys.

    `past` has frames and values of keys before these, by path and index.
    """
    for index in range(values.shape[1]):
        curve = bag.fcurves.find(path, index=index) or bag.fcurves.new(path, index=index)
        before = (past or {}).get((path, index), np.zeros((0, 2), np.float32))
        rows = np.concatenate([before, np.stack([frames, values[:, index]], axis=1).astype(np.float32)])
        points = curve.keyframe_points
        points.add(len(rows) - len(points))
        points.foreach_set("co", rows.ravel())
        points.foreach_set("interpolation", np.ones(len(rows), np.int32))
        curve.update()
