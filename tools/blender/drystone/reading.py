"""Drivers that read angles of objects which a bake turns by quaternions."""

import bpy

from .curves import drivers_of

# Property with the angles of a rotation mode; all other modes are orders of Euler angles.
ANGLES = {"QUATERNION": None, "AXIS_ANGLE": "rotation_axis_angle"}
# The mode that drivers take the angles of a quaternion in.
USUAL = "XYZ"


def _owners():
    """Yields all data that may have drivers."""
    for key, of in bpy.data.bl_rna.properties.items():
        for owner in getattr(bpy.data, key) if of.type == "COLLECTION" else ():
            yield owner
            if getattr(owner, "node_tree", None):
                yield owner.node_tree


def _reads_angles(variable, target):
    """Tells whether a target of a driver is an object whose angles it reads in the rotation mode of the object."""
    mode = target.id.rotation_mode
    if variable.type == "TRANSFORMS":
        is_own = target.transform_type.startswith("ROT") and target.rotation_mode == "AUTO" and not target.bone_target
        return is_own and mode not in ANGLES and mode != USUAL
    angles = ANGLES.get(mode, "rotation_euler")
    path = target.data_path if variable.type == "SINGLE_PROP" else ""
    return path.startswith("rotation_mode") or angles is not None and path.startswith(angles)


def read_by_drivers():
    """Returns the names of objects whose angles drivers read in the object's own rotation mode."""
    targets = ((variable, target) for owner in _owners() if hasattr(owner, "animation_data")
               for driver in drivers_of(owner) for variable in driver.driver.variables for target in variable.targets)
    return {target.id.name_full for variable, target in targets
            if isinstance(target.id, bpy.types.Object) and _reads_angles(variable, target)}
