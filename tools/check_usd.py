#!/usr/bin/env python3
"""A stage in OpenUSD; a baked one against the same bake as arrays.

    python3 tools/check_usd.py STAGE.usda [ARRAYS.npz]

Opens the stage in OpenUSD, runs all validators and the parser of joints that come with it, and
compares the place of every body at every frame with the arrays: to 0.02 mm and 0.02 mrad, twice what samples may leave. Prints
what it finds; exit code 1 if there is anything. Needs numpy and usd-core.
"""

import argparse
import math
import sys

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics, UsdValidation

METERS = 2e-5
RADIANS = 2e-5


def axes_of(pose):
    """World directions of the body's axes, in rows, of a pose of 7 numbers or of 3."""
    if len(pose) == 3:
        pose = [*pose[:2], 0, 0, 0, math.sin(pose[2] / 2), math.cos(pose[2] / 2)]
    x, y, z, w = pose[3:]
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (np.eye(3) + 2 * w * across + 2 * across @ across).T


def differences(stage, arrays):
    """Frames and bodies that the stage has elsewhere."""
    world = stage.GetDefaultPrim()
    prims = [prim for prim in world.GetChildren() if prim.IsA(UsdGeom.Xformable)]
    names, poses = arrays["names"], arrays["poses"]
    if len(prims) != len(names):
        yield f"{len(prims)} bodies, not {len(names)}"
        return
    rate = stage.GetTimeCodesPerSecond()
    for frame, time in enumerate(arrays["times"]):
        cache = UsdGeom.XformCache(Usd.TimeCode(time * rate))
        for body, prim in enumerate(prims):
            transform = cache.GetLocalToWorldTransform(prim)
            pose = poses[frame, body].astype(float)
            place = np.array([*pose[:3]] if len(pose) == 7 else [*pose[:2], 0])
            apart = np.linalg.norm(np.array(transform.ExtractTranslation()) - place)
            # Of a small rotation, all entries together move by its angle times the root of two.
            axes = np.array(transform.ExtractRotationMatrix())
            angle = np.linalg.norm(axes - axes_of(pose)) / math.sqrt(2)
            if not (apart <= METERS and angle <= RADIANS):
                yield f"frame {frame}, '{names[body]}': {apart} m and {angle} rad away"
                return


def joint_problems(stage):
    """Joints that OpenUSD's own parser of physics refuses, or takes for others."""
    joints = {prim.GetPath(): prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)}
    found = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ["/"])
    for kind, (paths, descriptions) in found.items():
        for path, description in zip(paths, descriptions):
            prim = joints.pop(path, None)
            if prim is None:
                continue
            name = {"PhysicsJoint": "D6Joint"}.get(prim.GetTypeName(), prim.GetTypeName()[7:])
            if not description.isValid or str(kind) != name:
                yield f"{path}: a {prim.GetTypeName()} is taken for a {kind}, or not valid"
    for path in joints:
        yield f"{path}: not taken for a joint"


def problems(stage, arrays):
    """Everything that is not as it should be."""
    if UsdGeom.GetStageMetersPerUnit(stage) != 1 or UsdGeom.GetStageUpAxis(stage) != "Y":
        yield "not in meters with +y up"
    if UsdPhysics.GetStageKilogramsPerUnit(stage) != 1:
        yield "not in kilograms"
    last = stage.GetEndTimeCode()
    if arrays is not None:
        last = arrays["times"][-1] * stage.GetTimeCodesPerSecond()
    if stage.GetStartTimeCode() != 0 or abs(stage.GetEndTimeCode() - last) > 1e-6:
        yield f"from {stage.GetStartTimeCode()} to {stage.GetEndTimeCode()}, not 0 to {last}"
    if not any(prim.HasAPI(UsdPhysics.CollisionAPI) for prim in stage.Traverse()):
        yield "nothing collides"
    registry = UsdValidation.ValidationRegistry()
    context = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators())
    for error in context.Validate(stage):
        yield error.GetMessage()
    yield from joint_problems(stage)
    if arrays is not None:
        yield from differences(stage, arrays)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stage")
    parser.add_argument("arrays", nargs="?")
    arguments = parser.parse_args()
    stage = Usd.Stage.Open(arguments.stage)
    arrays = np.load(arguments.arrays) if arguments.arrays else None
    found = list(problems(stage, arrays))
    for problem in found:
        print(f"{arguments.stage}: {problem}")
    what = "a scene"
    if arrays is not None:
        frames, bodies = arrays["poses"].shape[:2]
        what = f"{frames} frames of {bodies} bodies"
    print(f"{arguments.stage}: {len(found)} problems, {what}")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
