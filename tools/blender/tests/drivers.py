"""Tests of drivers that read active bodies: their transform channels, or their properties."""

import bpy
import numpy as np

from .common import add, block, cube, differences, empty, full_bake, lines
from .passive import body_of, exported

FOLLOWING = "following a body that the simulation moves"


def driven(thing, path, index, source, read, **more):
    """Makes a channel of a thing what a variable reads from a source: a property, or a transform channel."""
    driver = thing.driver_add(path, index).driver
    variable = driver.variables.new()
    variable.type, driver.expression = "TRANSFORMS" if more else "SINGLE_PROP", variable.name
    target = variable.targets[0]
    target.id, target.data_path = source, read
    for key, value in more.items():
        setattr(target, key, value)


# Channels of a crate that drivers read, by its rotation mode; the first one is of its height.
READ = {"XYZ": ("location.z", "rotation_euler.z"), "QUATERNION": ("location[2]", "rotation_quaternion[3]"),
        "AXIS_ANGLE": ("location.z", "rotation_axis_angle[0]", "delta_location.x")}
CHANNELS = ("location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle")


def test_properties(_program, _folder):
    """Passive objects that follow a property of an active body are named, or left out if they are Animated."""
    for mode, paths in READ.items():
        empty(last=12)
        crate = block("crate", (1, 2, 8))
        crate.rotation_mode = mode
        for i, path in enumerate(paths):
            driven(block(f"still {i}", (4, 3 * i, 1), "PASSIVE"), "location", 2, crate, path)
            driven(block(f"gone {i}", (8, 3 * i, 1), "PASSIVE", kinematic=True), "location", 2, crate, path)
        alone = block("alone", (12, 0, 1), "PASSIVE", kinematic=True)
        idle = "rotation_axis_angle[0]" if mode == "XYZ" else "rotation_euler.x"
        driven(alone, "location", 2, crate, idle)
        bpy.context.view_layer.update()
        before = [list(getattr(crate, key)) for key in CHANNELS]
        shot = exported()
        said = lines(shot)
        for kind, name, end in (("passive objects", "still", "still, as at the first frame"),
                                ("objects", "gone", "left out")):
            names = ", ".join(f"'{name} {i}'" for i in range(len(paths)))
            assert f"{len(paths)} {kind} {FOLLOWING}: {end}: {names}" in said, said
        assert {body["name"] for body in shot.document["bodies"]} == {
            "crate", "alone", *(f"still {i}" for i in range(len(paths)))}
        assert np.isclose(body_of(shot, "still 0")["position"][1], 8)
        assert [list(getattr(crate, key)) for key in CHANNELS] == before


def test_keyed_properties(program, folder):
    """The same of a thrown body, whose keys come back at each frame."""
    scene = empty(last=24)
    thrown = block("thrown", (0, 0, 5))
    for frame, at in ((1, 0), (12, 2)):
        thrown.rotation_euler.z = thrown.location.x = at
        thrown.keyframe_insert("rotation_euler", frame=frame)
        thrown.keyframe_insert("location", frame=frame)
    for frame, held in ((1, True), (20, False)):
        thrown.rigid_body.kinematic = held
        thrown.rigid_body.keyframe_insert("kinematic", frame=frame)
    driven(block("wheel", (5, 0, 5), "PASSIVE", kinematic=True), "rotation_euler", 0, thrown, "rotation_euler.z")
    scene.frame_set(1)
    run, document, poses = full_bake(program, folder)
    said = lines(run.shot)
    assert f"1 object {FOLLOWING}: left out: 'wheel'" in said, said
    assert differences(document, poses)[0] < 1e-5


def test_angles(program, folder):
    """Drivers that read angles of a body in its own rotation mode are told, as a bake turns it by a quaternion."""
    def said_of(mode, *reads, path="location"):
        empty(last=6)
        crate = block("crate", (0, 0, 5))
        crate.rotation_mode = mode
        bpy.ops.object.light_add()
        for i, (read, more) in enumerate(reads):
            driven(bpy.context.object, path, i, crate, read, **more)
        bpy.context.view_layer.update()
        return lines(exported())

    told = ["1 object whose angles drivers read: of other values while baked, as it turns by a quaternion: 'crate'"]
    auto, own = ({"transform_type": "ROT_X", "rotation_mode": mode} for mode in ("AUTO", "ZYX"))
    place = {"transform_type": "LOC_X"}
    assert said_of("ZYX", ("", auto)) == told
    assert said_of("ZYX", ("", own), ("", place), ("location.x", {})) == []
    assert said_of("XYZ", ("", auto), ("rotation_quaternion[0]", {})) == []
    assert said_of("XYZ", ("rotation_euler.x", {})) == told
    assert said_of("XYZ", ("rotation_mode", {})) == told
    assert said_of("QUATERNION", ("rotation_euler.x", {}), ("rotation_quaternion.x", {})) == []
    assert said_of("AXIS_ANGLE", ("rotation_axis_angle[0]", {})) == told
    empty(last=6)
    crate = add(cube(1, (0, 0, 5)), "ACTIVE", "BOX", "crate")
    material = bpy.data.materials.new("paint")
    material.use_nodes = True
    value = material.node_tree.nodes.new("ShaderNodeValue").outputs[0]
    driven(value, "default_value", -1, crate, "rotation_euler.x")
    assert lines(exported()) == told
    full_bake(program, folder)
    assert lines(exported()) == told
