"""Tests of bakes that begin inside of an earlier one."""

import bpy
import numpy as np
from drystone import applying, baking, recordings
from drystone.channels import product
from drystone.curves import curves_of
from drystone.space import rigid

from .common import DOWN, LONG, add, block, constrain, full_bake, heap, lines, midway, stage

# Largest distance from the whole bake, with recorded velocities and with those of keys. [m]
RECORDED, KEYED = 1e-3, 5e-3
FRAME, LAST = 20, 48


def smooth():
    """A thing that flies, one that slides, one at rest, one that rolls, and one on a keyed table."""
    scene = stage(DOWN, LAST)
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=90), "PASSIVE", "BOX", "ground", friction=0.5)
    flying = thrown("flying", (0, 0, 12), (3, 0, 17), release=6)
    flying.rotation_euler = (0, 0, 0)
    for frame, angle in ((1, 0), (30, 4)):
        flying.rotation_euler = (angle, 0.3 * angle, 0)
        flying.keyframe_insert("rotation_euler", frame=frame)
    thrown("sliding", (0, 9, 0.5), (16, 9, 0.5), release=6).rigid_body.friction = 0.3
    block("resting", (0, -9, 0.5))
    ball = thrown("rolling", (0, 18, 0.5), (6, 18, 0.5), release=6)
    ball.rigid_body.collision_shape = "SPHERE"
    table = block("table", (0, -20, 0.5), "PASSIVE", size=2, kinematic=True)
    for frame, x in ((1, 0), (30, 2)):
        table.location.x = x
        table.keyframe_insert("location", frame=frame)
    block("carried", (0, -20, 2.0), friction=1.0)
    thrown("late", (0, 27, 12), (3, 27, 17), release=28)
    scene.frame_set(1)
    return scene


def thrown(name, start, end, release):
    """A crate that straight keys move, and that is free from a frame on."""
    thing = block(name, start, kinematic=True)
    for frame, place in ((1, start), (30, end)):
        thing.location = place
        thing.keyframe_insert("location", frame=frame)
    for curve in curves_of(thing):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    for frame, held in ((1, True), (release, False)):
        thing.rigid_body.kinematic = held
        thing.keyframe_insert("rigid_body.kinematic", frame=frame)
    return thing


def keys_of(thing):
    return {(curve.data_path, curve.array_index): np.array([tuple(point.co) for point in curve.keyframe_points])
            for curve in curves_of(thing)}


def shown_poses(scene, names):
    """Matrices of objects at all frames."""
    poses = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        poses.append([np.array(rigid(scene.objects[name])) for name in names])
    return np.array(poses)


def from_here(program, folder, frame, options=baking.Options()):
    bpy.context.scene.frame_set(frame)
    bake = baking.Bake(bpy.context, program, options, folder, from_here=True)
    bake.finish()
    return bake


def with_velocities(path):
    """Adds velocities to a recording that has none: of the differences of its poses, which bend little."""
    found = recordings.Recording.read(path)
    if found.has_velocities:
        return
    step = found.times[1] - found.times[0]
    poses = found.poses.astype(float)
    linear = np.gradient(poses[..., :3], step, axis=0)
    turns = np.concatenate([poses[..., 6:], poses[..., 3:6]], axis=-1)
    turned = product(turns[2:], turns[:-2] * [1, -1, -1, -1])
    turned *= np.where(turned[..., :1] < 0, -1, 1)
    length = np.linalg.norm(turned[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(length, turned[..., :1])
    angular = np.zeros_like(linear)
    angular[1:-1] = turned[..., 1:] / np.maximum(length, 1e-12) * angle / (2 * step)
    found.velocities = [linear, angular]
    found.write(path)


def test_same_as_whole(program, folder):
    """Without a change, a bake from a frame on is the whole bake; the frames before it stay to the last bit."""
    scene = smooth()
    run, _, _ = full_bake(program, folder)
    names = sorted(run.shot.channels)
    whole = shown_poses(scene, names)
    before = {name: keys_of(scene.objects[name]) for name in names}
    records = recordings.Recording.read(run.whole).has_velocities
    for kind, most in (("recorded", RECORDED), ("keyed", KEYED)):
        if kind == "recorded":
            with_velocities(run.whole)
        else:
            run.whole.unlink(missing_ok=True)
        bake = from_here(program, folder, FRAME)
        guessed = [line for line in lines(bake.shot) if "with velocities from keys" in line]
        assert (guessed == []) == (kind == "recorded"), lines(bake.shot)
        for name in names:
            after = keys_of(scene.objects[name])
            assert after.keys() == before[name].keys() and all(len(rows) == LAST for rows in after.values())
            for key, rows in after.items():
                assert np.array_equal(rows[:FRAME - 1], before[name][key][:FRAME - 1]), (name, key)
        again = shown_poses(scene, names)
        off = np.abs(again - whole)[..., :3, 3].max(axis=(0, 2))
        turn = np.abs(again - whole)[..., :3, :3].max()
        print(f"here: from frame {FRAME} on with {kind} velocities{'' if records else ' (by hand)'}, off by "
              f"{off.max() * 1e3:.3f} mm ({names[off.argmax()]}), {turn:.1e}")
        assert off.max() < most and turn < 20 * most
        assert run.whole.exists() == (kind == "recorded")
    applying.delete_bake(scene)
    scene.frame_set(1)
    assert all("drystone" not in scene.objects[name] for name in names)
    assert np.allclose(scene.objects["late"].location, (0, 27, 12)) and scene.objects["late"].rigid_body.kinematic


def test_changes_from_here(program, folder):
    """A heavier, a moved and a newly keyed thing take effect from the frame on; Delete Bake restores them all."""
    scene = stage(DOWN, LAST)
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=60), "PASSIVE", "BOX", "ground")
    crate, other = block("crate", (0, 0, 3)), block("other", (5, 0, 3), use_deactivation=True,
                                                    use_start_deactivated=True)
    pusher = block("pusher", (-5, 5, 0.5), "PASSIVE", kinematic=True)
    pushed = block("pushed", (0, 5, 0.5))
    for frame in (1, FRAME):
        pusher.keyframe_insert("location", frame=frame)
    start = {thing.name: list(thing.location) for thing in (crate, other, pushed)}
    run, _, _ = full_bake(program, folder)
    names = sorted(run.shot.channels)
    whole = shown_poses(scene, names)
    pusher.location.x = -0.5
    pusher.keyframe_insert("location", frame=LAST)
    scene.frame_set(FRAME)
    assert np.allclose(other.location, (5, 0, 3))
    crate.location = (0, -5, 6)
    bake = baking.Bake(bpy.context, program, baking.Options(), folder, from_here=True)
    assert np.allclose(crate.location, (0, -5, 6)), "the move is shown during the bake"
    bodies = {body["name"]: body for body in bake.shot.document["bodies"]}
    assert np.allclose(bodies["crate"]["position"], (0, 6, 5))
    assert bodies["other"]["start_asleep"]
    assert len(bodies["pusher"]["track"]) == LAST - FRAME + 1
    bake.finish()
    again = shown_poses(scene, names)
    off = np.abs(again - whole)[..., :3, 3].max(axis=-1)
    assert off[:FRAME - 1].max() == 0, off[:FRAME - 1]
    place = {name: again[-1, i, :3, 3] for i, name in enumerate(names)}
    assert abs(place["crate"][1] + 5) < 0.1 and place["pushed"][0] > 0.4, place
    assert np.allclose(place["other"], (5, 0, 3))
    # The whole bake begins where it did before the move.
    _, document, _ = full_bake(program, folder)
    assert np.allclose(next(body for body in document["bodies"] if body["name"] == "crate")["position"], (0, 3, 0))
    applying.delete_bake(scene)
    for name, location in start.items():
        assert np.allclose(scene.objects[name].location, location) and scene.objects[name].animation_data is None


def test_broken_stay_broken(program, folder):
    """A joint that broke before the frame is broken after it; without a recording that is said."""
    scene = stage(DOWN, 30)
    wall = block("wall", (0, 0, 3), "PASSIVE")
    constrain("FIXED", wall, block("heavy", (0, 0, 1.9), mass=100), name="glue", use_breaking=True,
              breaking_threshold=0.01)
    run, _, _ = full_bake(program, folder)
    broken = recordings.Recording.read(run.whole).joints
    assert 0 < broken["glue"] < 14
    bake = from_here(program, folder, 15)
    assert bake.shot.document["joints"][0]["enabled"] is False
    assert recordings.Recording.read(run.whole).joints == broken
    scene.frame_set(30)
    assert scene.objects["heavy"].location.z < 0
    run.whole.unlink()
    bake = from_here(program, folder, 15)
    assert ("1 constraint that may have broken before: whole again, as no recording fits the bake: 'glue'"
            in lines(bake.shot)), lines(bake.shot)


def test_sleepers_of_a_preview(program, folder):
    """Bodies at rest in a preview sleep on; a thing that comes later wakes them."""
    scene = stage(DOWN, 60)
    add(lambda: bpy.ops.mesh.primitive_plane_add(size=60), "PASSIVE", "BOX", "ground")
    block("resting", (0, 0, 0.5))
    block("falling", (5, 0, 60))
    preview = baking.Options(is_preview=True)
    full_bake(program, folder, preview)
    scene.frame_set(40)
    bake = baking.Bake(bpy.context, program, preview, folder, from_here=True)
    bodies = {body["name"]: body for body in bake.shot.document["bodies"]}
    assert bodies["resting"].get("start_asleep") and not bodies["falling"].get("start_asleep"), bodies
    bake.finish()
    # Without its floor, it falls.
    scene.frame_set(40)
    scene.objects["ground"].location.z = -5
    bake = baking.Bake(bpy.context, program, preview, folder, from_here=True)
    bodies = {body["name"]: body for body in bake.shot.document["bodies"]}
    assert not bodies["resting"].get("start_asleep")


def test_refused(program, folder):
    """Before a bake, at its first frame and after its last there is nothing to go on with."""
    scene = stage(DOWN, 12)
    block("crate", (0, 0, 3))
    for frame, said in ((5, "no object has one: bake first"), (1, "go to a frame from 2 to 11"),
                        (12, "go to a frame from 2 to 11")):
        scene.frame_set(frame)
        try:
            baking.Bake(bpy.context, program, baking.Options(), folder, from_here=True)
            assert False, f"began at frame {frame}"
        except ValueError as error:
            assert str(error).endswith(said), error
        full_bake(program, folder)


def test_stopped_and_gone_on(program, folder):
    """A bake from a frame on that is stopped keeps its frames, and goes on from its last one."""
    scene = heap(400, 100)
    full_bake(program, folder, baking.Options(is_preview=True))
    scene.frame_set(10)
    bake = baking.Bake(bpy.context, program, LONG, folder, from_here=True)
    midway(bake)
    bake.cancel()
    bake.finish()
    last = 9 + bake.keys.frames
    assert bake.said[0] == f"stopped, baked up to frame {last}: Bake from Here goes on", bake.said
    thing = scene.objects["thing 7"]
    assert {len(rows) for rows in keys_of(thing).values()} == {last}
    bake = from_here(program, folder, min(last, 99), baking.Options(is_preview=True))
    assert not bake.error and {len(rows) for rows in keys_of(thing).values()} == {100}
    assert len(recordings.Recording.read(bake.whole).times) == 100


def with_linked(folder, place):
    """A scene with an active body from another file, beside one of its own; returns both."""
    scene = stage(DOWN, LAST)
    block("linked", place)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "other.blend"))
    scene = stage(DOWN, LAST)
    own = block("own", (0, 0, 40))
    with bpy.data.libraries.load(str(folder / "other.blend"), link=True) as (_, target):
        target.objects = ["linked"]
    linked = target.objects[0]
    scene.collection.objects.link(linked)
    scene.rigidbody_world.collection.objects.link(linked)
    bpy.context.view_layer.update()
    return linked, own


def body_of(bake, name):
    return next(body for body in bake.shot.document["bodies"] if body["name"] == name)


def test_linked_from_here(program, folder):
    """A body from another file goes on from the recording; without one its place is told."""
    for is_overridden in (False, True):
        linked, _ = with_linked(folder, (9, 0, 40))
        if is_overridden:
            linked = linked.override_create(remap_local_usages=True)
            linked.override_library.is_system_override = True
        name = linked.name_full
        run, document, poses = full_bake(program, folder)
        index = [body["name"] for body in document["bodies"]].index(name)
        bake = from_here(program, folder, FRAME)
        body = body_of(bake, name)
        assert np.allclose(body["position"], poses[FRAME - 1, index, :3], atol=1e-5), body["position"]
        assert body["linear_velocity"][1] < -5 and np.allclose(bake.keys.scene.frame_current, FRAME)
        said = [line for line in lines(bake.shot) if "recording" in line]
        assert said == ["1 object linked from another file: goes on from the recording, as it has no keys: "
                        f"'{name}'"], lines(bake.shot)
        again = recordings.Recording.read(bake.whole)
        assert np.abs(again.poses[:, index] - poses[:, index]).max() < RECORDED
        run.whole.unlink()
        bake = from_here(program, folder, FRAME)
        assert np.allclose(body_of(bake, name)["position"], (9, 40, 0), atol=1e-5)
        assert "1 object linked from another file: from its own place at this frame, as no recording fits the " \
            f"bake: '{name}'" in lines(bake.shot), lines(bake.shot)


def test_new_from_here(program, folder):
    """Bodies that are new since the bake start where their own keys and parents have them at the frame."""
    scene = stage(DOWN, LAST)
    block("own", (0, 0, 40))
    full_bake(program, folder)
    scene.frame_set(1)
    thrown("released", (9, 0, 30), (18, 0, 30), release=10)
    holder = bpy.data.objects.new("holder", None)
    scene.collection.objects.link(holder)
    for frame, x in ((1, 0), (30, 29)):
        holder.location.x = x
        holder.keyframe_insert("location", frame=frame)
    for curve in curves_of(holder):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    block("carried", (0, 20, 0)).parent = holder
    block("dropped", (0, 40, 5))
    waiting = block("waiting", (0, 60, 5), use_deactivation=True)
    waiting.rigid_body.use_start_deactivated = True
    scene.frame_set(1)
    bake = from_here(program, folder, FRAME)
    bodies = {body["name"]: body for body in bake.shot.document["bodies"]}
    assert np.allclose(bodies["released"]["position"], (9 + 9 * 19 / 29, 30, 0), atol=1e-4), bodies["released"]
    assert np.allclose(bodies["carried"]["position"], (19, 0, -20), atol=1e-4), bodies["carried"]
    assert np.allclose(bodies["dropped"]["position"], (0, 5, -40)) and bodies["waiting"]["start_asleep"]
    assert np.allclose(bodies["carried"]["linear_velocity"], (24, 0, 0), atol=1e-2)
    said = lines(bake.shot)
    assert "2 objects new since the bake: from the place and the velocity of their keys: 'released', 'carried'" \
        in said and not any("dropped" in line for line in said), said
    scene.frame_set(FRAME)
    assert np.allclose(scene.objects["carried"].matrix_world.translation, (19, 20, 0), atol=1e-4)


def test_renamed_since(program, folder):
    """Bodies that exchange their names after a bake, or during it, go on from their own recording."""
    for is_meanwhile in (False, True):
        scene = stage(DOWN, LAST)
        near, far = thrown("near", (0, 0, 30), (9, 0, 30), 6), thrown("far", (0, 20, 40), (3, 20, 40), 6)
        scene.frame_set(1)
        bake = baking.Bake(bpy.context, program, baking.Options(), folder)
        bake.poll() if is_meanwhile else bake.finish()
        near.name, far.name = "meanwhile", "near"
        near.name = "far"
        bake.finish()
        for thing in (near, far):
            assert len(keys_of(thing)) == 7, thing
        with_velocities(bake.whole)
        for frame in (FRAME, FRAME + 8):
            whole = shown_poses(scene, ["near", "far"])
            later = from_here(program, folder, frame)
            assert not any("velocities from keys" in line for line in lines(later.shot)), lines(later.shot)
            assert np.abs(shown_poses(scene, ["near", "far"]) - whole).max() < RECORDED
        names = recordings.Recording.read(bake.whole).names
        assert sorted(names) == ["far", "near"]
        applying.delete_bake(scene)
        scene.frame_set(1)
        assert np.allclose(near.location, (0, 0, 30)) and np.allclose(far.location, (0, 20, 40))


def test_renamed_joints(program, folder):
    """A constraint that the recording does not know, as it was renamed, is told to be whole."""
    scene = stage(DOWN, LAST)
    post, crate = block("post", (0, 0, 5), "PASSIVE"), block("crate", (2, 0, 5))
    glue = constrain("FIXED", post, crate, (1, 0, 5), name="glue", use_breaking=True, breaking_threshold=0.01)
    full_bake(program, folder)
    bake = from_here(program, folder, FRAME)
    assert not any("whole again" in line for line in lines(bake.shot)), lines(bake.shot)
    glue.name = "other"
    bake = from_here(program, folder, FRAME)
    assert "1 constraint that may have broken before: whole again, as no recording fits the bake: 'other'" \
        in lines(bake.shot), lines(bake.shot)
    assert scene
