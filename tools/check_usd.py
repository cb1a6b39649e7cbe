#!/usr/bin/env python3
"""A stage in OpenUSD; a baked one against the same bake as arrays.

    python3 tools/check_usd.py STAGE.usda [ARRAYS.npz]
    python3 tools/check_usd.py LAYER.usda ARRAYS.npz --over STAGE.usda
    python3 tools/check_usd.py --points CONTACTS.usda

Opens the stage in OpenUSD, runs all validators and the parser of joints that come with it, and
compares the place of every body at every frame with the arrays: to 0.02 mm and 0.02 mrad, twice what samples may leave. Prints
what it finds; exit code 1 if there is anything. Needs numpy and usd-core.

With --over, the stage is a layer over another one. Bodies are then found by the names in the arrays. Their scale, and
everything else in the other stage, must be as it was. With --points, the stage holds contacts.
"""

import argparse
import math
import sys

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation

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
    names, poses = arrays["names"], arrays["poses"]
    prims = [prim for prim in stage.GetDefaultPrim().GetChildren() if prim.IsA(UsdGeom.Xformable)]
    instancers = [UsdGeom.PointInstancer(prim) for prim in prims if prim.IsA(UsdGeom.PointInstancer)]
    prims = [prim for prim in prims if not prim.IsA(UsdGeom.PointInstancer)]
    instances = [body for of in instancers for body in of.GetIdsAttr().Get()]
    if len(prims) + len(set(instances)) != len(names):
        yield f"{len(prims)} bodies and {len(instances)} instances, not {len(names)}"
        return
    alone = [body for body in range(len(names)) if body not in set(instances)]
    rate = stage.GetTimeCodesPerSecond()
    for frame, time in enumerate(arrays["times"]):
        code = Usd.TimeCode(time * rate)
        cache = UsdGeom.XformCache(code)
        transforms = dict(zip(alone, map(cache.GetLocalToWorldTransform, prims)))
        for of in instancers:
            placed = of.ComputeInstanceTransformsAtTime(code, code, UsdGeom.PointInstancer.ExcludeProtoXform)
            transforms.update(zip(of.GetIdsAttr().Get(), placed))
        for body, transform in sorted(transforms.items()):
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


def to_stage(stage):
    """Matrix, for row vectors, that takes positions in meters with +y up to the units of the stage."""
    turn = np.eye(3)
    if UsdGeom.GetStageUpAxis(stage) == "Z":
        turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    return turn / UsdGeom.GetStageMetersPerUnit(stage)


def layer_differences(stage, original, arrays):
    """Bodies that a layer has elsewhere, or with another scale than the stage below it."""
    bodies = {}
    for prim in original.Traverse(Usd.TraverseInstanceProxies()):
        if prim.HasAPI(UsdPhysics.RigidBodyAPI) or prim.HasAPI(UsdPhysics.CollisionAPI):
            bodies.setdefault(prim.GetName(), prim)
    to = to_stage(stage)
    meters = UsdGeom.GetStageMetersPerUnit(stage)
    rate, start = stage.GetTimeCodesPerSecond(), stage.GetStartTimeCode() / stage.GetTimeCodesPerSecond()
    resting = UsdGeom.XformCache(Usd.TimeCode(original.GetStartTimeCode()))
    for body, name in enumerate(arrays["names"]):
        old = bodies[str(name)]
        prim = stage.GetPrimAtPath(old.GetPath())
        before = np.array(resting.GetLocalToWorldTransform(old))[:3, :3]
        turned = [axes_of(pose.astype(float)) @ (to * meters) for pose in arrays["poses"][:, body]]
        for frame, time in enumerate(arrays["times"] - arrays["times"][0]):
            cache = UsdGeom.XformCache(Usd.TimeCode((start + time) * rate))
            transform = np.array(cache.GetLocalToWorldTransform(prim))
            place = arrays["poses"][frame, body, :3].astype(float) @ to
            apart = np.linalg.norm(transform[3, :3] - place) * meters
            # Rows are the images of the axes of the prim: what the pose has turned since frame 0.
            expected = before @ np.linalg.inv(turned[0]) @ turned[frame]
            angle = np.linalg.norm(transform[:3, :3] - expected) / np.linalg.norm(before)
            if not (apart <= METERS and angle <= RADIANS):
                yield f"frame {frame}, '{name}': {apart} m and {angle} rad away"
                break


def layer_problems(stage, original, arrays):
    """Everything in a layer that is not as it should be."""
    for what in ("upAxis", "metersPerUnit", "timeCodesPerSecond", "defaultPrim", "startTimeCode"):
        if stage.GetMetadata(what) != original.GetMetadata(what):
            yield f"{what} is {stage.GetMetadata(what)}, not {original.GetMetadata(what)}"
    last = stage.GetStartTimeCode() + (arrays["times"][-1] - arrays["times"][0]) * stage.GetTimeCodesPerSecond()
    if abs(stage.GetEndTimeCode() - last) > 1e-6:
        yield f"to {stage.GetEndTimeCode()}, not {last}"
    changed = ("xformOp", "physics:kinematicEnabled", "physics:jointEnabled", "drystone:released")
    materials = 0
    for old in original.Traverse(Usd.TraverseInstanceProxies()):
        prim = stage.GetPrimAtPath(old.GetPath())
        if not prim or prim.GetTypeName() != old.GetTypeName() or prim.GetAppliedSchemas() != old.GetAppliedSchemas():
            yield f"{old.GetPath()} is not as it was"
            continue
        for attribute in old.GetAuthoredAttributes():
            name = attribute.GetName()
            same = prim.GetAttribute(name)
            if not name.startswith(changed) and (same.Get(), same.GetTimeSamples()) != (
                attribute.Get(),
                attribute.GetTimeSamples(),
            ):
                yield f"{attribute.GetPath()} is not as it was"
        for relationship in old.GetRelationships():
            if prim.GetRelationship(relationship.GetName()).GetTargets() != relationship.GetTargets():
                yield f"{relationship.GetPath()} is not as it was"
        bound = [UsdShade.MaterialBindingAPI(of).ComputeBoundMaterial()[0].GetPath() for of in (old, prim)]
        materials += not bound[0].isEmpty
        if bound[0] != bound[1]:
            yield f"{old.GetPath()} has the material {bound[1]}, not {bound[0]}"
    if materials == 0:
        yield "no material is bound"
    registry = UsdValidation.ValidationRegistry()
    context = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators())
    known = {error.GetMessage() for error in context.Validate(original)}
    for error in context.Validate(stage):
        if error.GetMessage() not in known:
            yield error.GetMessage()
    yield from layer_differences(stage, original, arrays)


def point_problems(stage):
    """Everything in a stage of contacts that is not as it should be."""
    registry = UsdValidation.ValidationRegistry()
    for error in UsdValidation.ValidationContext(registry.GetOrLoadAllValidators()).Validate(stage):
        yield error.GetMessage()
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/Contacts"))
    if not points:
        yield "no contacts"
        return
    primvars = UsdGeom.PrimvarsAPI(points)
    extras = [primvars.GetPrimvar(name) for name in ("impulse", "speed", "bodyA", "bodyB")]
    most = 0
    for code in points.GetPointsAttr().GetTimeSamples():
        count = len(points.GetPointsAttr().Get(code))
        most = max(most, count)
        all_of = [points.GetNormalsAttr(), points.GetWidthsAttr(), *extras]
        if any(len(attribute.Get(code)) != count for attribute in all_of):
            yield f"time code {code}: not {count} numbers of each kind"
        impulses = np.array(extras[0].Get(code))
        lengths = np.linalg.norm(np.array(points.GetNormalsAttr().Get(code)).reshape(-1, 3), axis=1)
        if not ((impulses > 0).all() and np.allclose(lengths, 1, atol=1e-5)):
            yield f"time code {code}: an impulse or a normal is wrong"
        computed = UsdGeom.Boundable.ComputeExtentFromPlugins(points, code)
        if count and not np.allclose(points.GetExtentAttr().Get(code), computed, rtol=1e-5):
            yield f"time code {code}: the extent is wrong"
    if most == 0 or primvars.GetPrimvar("impulse").GetInterpolation() != "vertex":
        yield "no points, or impulses that are not one per point"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stage")
    parser.add_argument("arrays", nargs="?")
    parser.add_argument("--points", action="store_true", help="the stage holds contacts")
    parser.add_argument("--over", help="the stage that the layer STAGE lies over")
    arguments = parser.parse_args()
    stage = Usd.Stage.Open(arguments.stage)
    arrays = np.load(arguments.arrays) if arguments.arrays else None
    if arguments.points:
        found = list(point_problems(stage))
    elif arguments.over:
        found = list(layer_problems(stage, Usd.Stage.Open(arguments.over), arrays))
    else:
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
