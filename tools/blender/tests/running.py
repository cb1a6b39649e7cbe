"""Tests of running bakes: slices, looks at the frames so far, stop, resume, settings."""

import sys
import time
from types import SimpleNamespace

import bpy
import numpy as np
from drystone import applying, baking, binary, cache, cutting, operators
from drystone.curves import curves_of

from .common import DOWN, LONG, block, full_bake, heap, midway, stage

# The window answers within this time. [s]
ANSWER = 0.2
# A machine that does other things as well may be so many times slower.
SLOW = 5


def poll_once(bake):
    """Polls once and shows the scene, as a window does; returns whether it goes on, and the time. [s]"""
    start = time.perf_counter()
    goes_on = bake.poll()
    bpy.context.view_layer.update()
    return goes_on, time.perf_counter() - start


def keys_of(name):
    curves = curves_of(bpy.data.objects[name])
    return {len(curve.keyframe_points) for curve in curves}


def test_window_answers(program, folder):
    """1000 boxes by 240 frames: no poll takes long, and frames appear while the bake runs."""
    scene = heap()
    start = time.perf_counter()
    bake = baking.Bake(bpy.context, program, baking.Options(), folder)
    begun = time.perf_counter() - start
    times, seen, progress, goes_on = [], set(), [], True
    while goes_on:
        goes_on, taken = poll_once(bake)
        times.append(taken)
        seen.add(bake.keys.frames)
        progress.append(bake.progress)
        time.sleep(0.01)
    assert not bake.error and bake.said[0] == "1000 bodies baked", bake.error
    print(f"running: begun in {begun:.2f} s, {len(times)} polls of at most {max(times):.3f} s, "
          f"{len(seen) - 1} looks at {sorted(seen)[1:]} frames, {time.perf_counter() - start:.1f} s in all")
    assert bake.keys.frames == 240 and len(seen) > 2 and len(set(progress)) > 3 and sorted(progress) == progress
    assert max(times) < 2 * SLOW * ANSWER and np.sort(times)[-3] < SLOW * ANSWER and begun < 1.5 * SLOW
    scene.frame_set(240)
    assert keys_of("thing 7") == {240}


def test_stop_and_resume(program, folder):
    """Stopped at once; what is baked stays; resumed to the same keys as without a stop."""
    scene = heap(400, 200)
    full = baking.Bake(bpy.context, program, LONG, folder)
    full.finish()
    _, _, whole = applying.read_bake(full.output)
    applying.delete_bake(scene)
    bake = baking.Bake(bpy.context, program, LONG, folder)
    midway(bake)
    start = time.perf_counter()
    bake.cancel()
    while bake.process.is_running():
        time.sleep(0.005)
    stopped = time.perf_counter() - start
    while bake.poll():
        time.sleep(0.001)
    kept, ended = bake.keys.frames, time.perf_counter() - start
    assert not bake.error and 0 < kept < 200, (bake.error, kept)
    assert bake.said == [f"stopped, baked up to frame {kept}: Resume goes on"] and keys_of("thing 7") == {kept}
    scene.frame_set(kept)
    shown = scene.objects["thing 7"].matrix_world.translation
    names = [body["name"] for body in full.shot.document["bodies"]]
    wanted = whole[kept - 1, names.index("thing 7")]
    assert np.allclose([shown.x, shown.z, -shown.y], wanted[:3], atol=1e-5)
    again = baking.Bake(bpy.context, program, LONG, folder, resume=True)
    assert again.resume
    again.finish()
    _, _, poses = applying.read_bake(again.output)
    print(f"running: stopped in {stopped:.3f} s, {kept} frames kept after {ended:.2f} s, resumed to the same "
          "bytes")
    assert np.array_equal(poses, whole) and keys_of("thing 7") == {200}
    assert stopped < 0.5 * SLOW


def test_stopped_too_late(program, folder):
    """A bake that is stopped when the program has ended is complete: there is nothing to resume."""
    stage(DOWN, 12)
    block("crate", (0, 0, 2))
    bake = baking.Bake(bpy.context, program, baking.Options(), folder)
    midway(bake)
    while bake.process.is_running():
        time.sleep(0.005)
    bake.cancel()
    bake.finish()
    assert bake.said[0] == "1 body baked" and not bake.is_cancelled and keys_of("crate") == {12}


def test_changed_scene_is_not_resumed(program, folder):
    heap(400, 200)
    bake = baking.Bake(bpy.context, program, LONG, folder)
    midway(bake)
    bake.cancel()
    bake.finish()
    bpy.data.objects["thing 3"].rigid_body.mass = 7
    again = baking.Bake(bpy.context, program, LONG, folder, resume=True)
    try:
        again.finish()
        assert False, "resumed another scene"
    except ValueError as error:
        assert str(error) == "The scene has changed since the bake was stopped: bake it anew."


def test_settings(program, folder):
    """Quality, substeps and tolerance reach the program."""
    stage(DOWN, 12)
    block("crate", (0, 0, 0.5))
    block("floor", (0, 0, -0.5), "PASSIVE")
    run, document, _ = full_bake(program, folder, baking.Options(is_preview=True, substeps=7))
    assert document["solver"]["substeps"] == 7 and "the last substep of each step" in run.said[1], run.said
    run, _, _ = full_bake(program, folder, baking.Options(tolerance=0.25))
    assert "within 0.250 mm/s" in run.said[1], run.said
    scene = bpy.context.scene
    assert cache.folder_of(str(folder / "cache")) == folder / "cache" and (folder / "cache").is_dir()
    assert cache.folder_of("//cache").is_dir()


def test_progress(program, folder):
    """Lines of progress count frames, also while the program runs, and are no part of the summary."""
    said = "frame 3 of 12 (25 %), 4 s left\ndrystone: warning: a.json: frame 3 of a clip\nframe 5 of 12 (42 %)\n"
    assert binary.frames_done(said) == 5 and binary.frames_done("") is None
    assert binary.said_plainly(said) == ["frame 3 of a clip"]
    script = folder / "says.py"
    script.write_text(f"import sys, time\nsys.stderr.write({said!r})\nsys.stderr.flush()\ntime.sleep(60)\n")
    process = binary.Program(sys.executable, script)
    start = time.monotonic()
    while binary.frames_done(process.messages()) != 5:
        assert time.monotonic() - start < 30
        time.sleep(0.01)
    process.stop()
    assert process.result()[2] == said
    heap(50, 30)
    run, _, _ = full_bake(program, folder)
    assert run.done >= 29 and not any(line.startswith("frame") for line in run.said), run.said


class Window:
    """The part of a window that the modal operator needs."""

    def __init__(self):
        self.timers = 0
        self.said = []

    def event_timer_add(self, _tick, window):
        self.timers += 1
        return window

    def event_timer_remove(self, _timer):
        self.timers -= 1

    def modal_handler_add(self, _operator):
        pass


def modal(program, folder, events):
    """Drives the modal operator with events; returns its results, the window and what it reported."""
    import drystone

    drystone.register()
    own, folder_of = operators.preference, operators.folder_of
    operators.preference, operators.folder_of = lambda _context: program, lambda *_: folder
    window, said = Window(), []
    context = SimpleNamespace(scene=bpy.context.scene, window_manager=window, window="window", screen=None,
                              workspace=None, view_layer=bpy.context.view_layer,
                              evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get)
    operator = SimpleNamespace(report=lambda kind, text: said.append((kind, text)), resume=False)
    for name in ("make", "show", "_start", "_end", "modal"):
        setattr(operator, name, getattr(operators.Baking, name).__get__(operator))
    try:
        assert operator._start(context)
        operator._timer = window.event_timer_add(0, window)
        results = []
        for event in events():
            results.append(operator.modal(context, SimpleNamespace(type=event, value="PRESS")))
            if results[-1] <= {"FINISHED", "CANCELLED"}:
                break
            time.sleep(0.002)
        return results, window, said
    finally:
        operators.preference, operators.folder_of = own, folder_of
        drystone.unregister()


def test_modal(program, folder):
    """Ticks lead to the end, other events pass, Esc stops."""
    stage(DOWN, 48)
    block("crate", (0, 0, 2))

    def ticks():
        while True:
            yield "MOUSEMOVE"
            yield "TIMER"

    results, window, said = modal(program, folder, ticks)
    assert results[0] == {"PASS_THROUGH"} and results[-1] == {"FINISHED"} and window.timers == 0
    assert operators.running is None and said[0] == ({"INFO"}, "1 body baked")
    applying.delete_bake(bpy.context.scene)
    heap(400, 200)

    def escape():
        for _ in range(5):
            yield "TIMER"
        yield "ESC"
        while True:
            yield "TIMER"

    results, window, said = modal(program, folder, escape)
    assert results[5] == {"RUNNING_MODAL"} and results[-1] <= {"FINISHED", "CANCELLED"} and window.timers == 0
    assert said[-1][1].startswith("stopped"), said


def test_without_a_world(program, folder):
    """All that needs a rigid body world says so, once it has been removed."""
    scene = stage(DOWN, 12)
    block("crate", (0, 0, 3))
    run, _, _ = full_bake(program, folder)
    bpy.ops.rigidbody.world_remove()
    scene.frame_set(5)
    for work in (lambda: baking.Bake(bpy.context, program, baking.Options(), folder),
                 lambda: baking.Bake(bpy.context, program, baking.Options(), folder, from_here=True),
                 lambda: applying.apply(bpy.context, run.output),
                 lambda: cutting.Cutting(bpy.context, program, baking.Options(), folder)):
        try:
            work()
            assert False, "no error"
        except ValueError as error:
            assert str(error).startswith("the scene has no rigid body world: add one"), error
    assert applying.delete_bake(scene) == 1


def test_renamed_scene(program, folder):
    """A scene that is renamed during its bake gets all keys."""
    scene = stage(DOWN, 12)
    block("crate", (0, 0, 3))
    bake = baking.Bake(bpy.context, program, baking.Options(), folder)
    bake.poll()
    scene.name = "Shot 2"
    bake.finish()
    assert bake.said[0] == "1 body baked" and keys_of("crate") == {12}
