"""Bakes that begin inside of an earlier one: poses and velocities of its bodies at a frame."""

from dataclasses import dataclass

import numpy as np
from mathutils import Matrix, Quaternion, Vector

from .channels import matrices, to_blender
from .findings import CHANGED
from .masses import joined, solid_of
from .originals import baked_things, keys_until, last_key, leave_tweak_mode, shown_apart
from .recordings import Recording
from .sampling import in_order, with_values
from .space import (ORIGINAL, first_frame, has_keyed_speed, is_linked, pose_of, rigid, simulated, time_step, turned,
                    unturned, world_of)

# Largest distance of a key from a recording of the same bake. [m, or 1]
SAME = 1e-4
# Time of rest after which a preview lets bodies sleep. [s]
REST = 0.5

NO_ARRAYS = " with velocities from keys: the recording has none, as of a stopped bake or of an older drystone"
NO_RECORDING = " with velocities from keys: no recording fits these"
LINKED = " linked from another file: goes on from the recording, as it has no keys"
UNRECORDED = " linked from another file: from its own place at this frame, as no recording fits the bake"
NEW = " new since the bake: from the place and the velocity of their keys"
ELSEWHERE = " new since the bake: from its own place, though Blender's own simulation shows it elsewhere"
WHOLE = " that may have broken before: whole again, as no recording fits the bake"


@dataclass
class State:
    """A body at the frame at which a bake begins, in Drystone's axes."""

    position: list
    rotation: list
    # Velocities of the center of mass [m/s], and about it [rad/s]; None if no recording has them.
    linear: list = None
    angular: list = None
    # True if it has not moved at all since the bake began, and since a while.
    is_untouched: bool = False
    is_at_rest: bool = False


class Start:
    """The frame of a bake from which another one goes on, with what the scene shows there."""

    def __init__(self, context, path, lets_sleep=False):
        scene = context.scene
        # They still show the frame of their strip, and not that of their keys.
        self.tweaked = leave_tweak_mode(scene)
        context.view_layer.update()
        self.frame, self.scene_start = scene.frame_current, first_frame(scene)
        things = [thing for thing in baked_things(scene) if ORIGINAL in thing and "frame" in thing[ORIGINAL]]
        self.step, self.lets_sleep = time_step(scene), lets_sleep
        # Time that the frame simulates, over that of the frame.
        self.pace = world_of(scene).time_scale or 1 if has_keyed_speed(scene) else 1
        if not things:
            raise ValueError("Bake from Here goes on with a bake, and no object has one: bake first")
        self.first = max(min(thing[ORIGINAL]["frame"] for thing in things), self.scene_start)
        keyed = max(map(last_key, things))
        last = min(keyed, scene.frame_end - 1)
        if not self.first < self.frame <= last:
            frames = f"from {self.first + 1} to {last}"
            raise ValueError(f"Bake from Here begins inside of a bake: go to a frame {frames}")
        # Baked objects that are passive by now follow their keys, as those that are kept.
        self.kept = frozenset(thing.name_full for thing in things if thing.rigid_body
                              and thing.rigid_body.type == "PASSIVE")
        # Channels of objects that were moved by hand at this frame.
        self.moves = {thing.name_full: [*thing.location, *thing.rotation_quaternion]
                      for thing in things
                      if thing.name_full not in self.tweaked and shown_apart(thing, scene.frame_current_final)}
        # Keys before this frame, by name.
        past = {thing.name_full: keys_until(thing, self.frame) for thing in things}
        self.past = {name: keys for name, keys in past.items() if keys and all(map(len, keys.values()))}
        # Active bodies that have no keys of the bake: those of other files, and new ones.
        others = [thing for thing in simulated(scene).values()
                  if thing.rigid_body.type == "ACTIVE" and thing not in things]
        self.linked = {thing.name_full for thing in others if is_linked(thing)}
        self.new = {thing.name_full for thing in others} - self.linked
        self.count = self.frame - self.first
        # Shapes that deform, with their vertices at all frames of the simulation.
        self._vertices = []
        self.recording = Recording.read(path) if path else None
        if self.recording and not (self.recording.has_step(self.step) and len(self.recording.times) > self.count):
            self.recording = None
        if self.recording:
            self.recording.rename(_names_now(things))
        self._look(scene, things + others, (-1, 0, 1) if self.frame < keyed else (-1, 0))

    def _look(self, scene, things, steps):
        """Notes matrices that are shown now, and those of the keys around this frame."""
        self._now, self._around = {thing.name_full: rigid(thing) for thing in things}, {}
        subframe = scene.frame_subframe
        if subframe:
            scene.frame_set(self.frame)
            self._now |= {thing.name_full: rigid(thing) for thing in things if thing.name_full not in self.moves}
        with with_values([world_of(scene)], "enabled", False):
            with in_order(scene):
                for step in steps:
                    scene.frame_set(self.frame + step)
                    self._around[step] = {thing.name_full: rigid(thing) for thing in things}
            scene.frame_set(self.frame, subframe=subframe)
        names = self._now.keys() - self.linked - self.new
        if any(self._recorded(name) is not None for name in names):
            self._place_linked()
        self.states = {name: self._state(name) for name in self._now}

    def _place_linked(self):
        """Takes matrices of bodies from other files from the recording, as these have no keys."""
        for name in self.linked:
            place = self.recording.place(name)
            for step in self._around if place is not None else ():
                frame = min(self.count + step, len(self.recording.poses) - 1)
                places, turns = to_blender(self.recording.poses[frame, place][None])
                self._around[step][name] = Matrix.LocRotScale(places[0], Quaternion(turns[0]), None)

    def _state(self, name):
        place = self._recorded(name)
        still = all(np.ptp(rows[:, 1]) == 0 for rows in self.past.get(name, {}).values())
        if place is None or name in self.moves:
            shown = self._around[0] if name in self.linked | self.new | self.tweaked else self._now
            state = State(*pose_of(shown[name]))
        else:
            pose = self.recording.poses[self.count, place].tolist()
            state = State(pose[:3], pose[3:])
        state.is_untouched = still
        if place is not None:
            poses = self.recording.poses[:self.count + 1, place]
            rest = max(2, int(np.ceil(REST / self.step)) + 1)
            state.is_untouched = bool((poses == poses[0]).all())
            state.is_at_rest = len(poses) >= rest and bool((poses[-rest:] == poses[-1]).all())
            if self.recording.has_velocities:
                linear, angular = self.recording.velocities
                state.linear, state.angular = (of[self.count, place].tolist() for of in (linear, angular))
        return state

    def _recorded(self, name):
        """Returns the index of a body in the recording, if its keys are those of the recording; or None."""
        place = self.recording.place(name) if self.recording else None
        if place is None:
            return None
        for frame in (-1, 0):
            places, turns = to_blender(self.recording.poses[self.count + frame, place][None])
            shown = np.array(self._around[frame][name])
            size = 1 + np.abs(places).max()
            if np.abs(shown[:3, 3] - places[0]).max() > SAME * size:
                return None
            if np.abs(shown[:3, :3] - matrices(turns)[0]).max() > 10 * SAME:
                return None
        return place

    def begin(self, shot, abilities):
        """Makes a scene of the whole range begin at this frame."""
        document, offset = shot.document, self.frame - self.scene_start
        document["steps"] -= offset
        document["extras"]["frame_start"] = self.frame
        if "track" in document:
            document["track"] = [{**key, "time": i * self.step} for i, key in enumerate(document["track"][offset:])]
        self.lets_sleep = self.lets_sleep and abilities.start_asleep and self._is_as_baked(document)
        guessed = [body["name"] for body in document["bodies"] if self._body(body, offset)]
        self._tell(shot, guessed)
        for joint in document.get("joints", []):
            if "breaking" in joint and joint["name"] not in (self.recording.joints if self.recording else ()):
                shot.findings.add(CHANGED, "constraint", WHOLE, joint["name"])
            elif self.recording and 0 <= self.recording.joints.get(joint["name"], -1) <= self.count:
                joint["enabled"] = False

    def _tell(self, shot, guessed):
        """Lists bodies that begin otherwise than by keys and recording; `guessed` have velocities from keys."""
        free = {body["name"] for body in shot.document["bodies"]
                if body["motion"] == "dynamic" and "track" not in body}
        recorded = {name for name in self.linked if self._recorded(name) is not None}
        apart = {name for name in self.new
                 if np.abs(np.array(self._now[name]) - np.array(self._around[0][name])).max() > SAME}
        without = self.recording and not self.recording.has_velocities
        told = {NO_ARRAYS if without else NO_RECORDING: set(guessed) - self.new - (self.linked - recorded),
                LINKED: recorded & free, UNRECORDED: (self.linked - recorded) & free,
                NEW: self.new & set(guessed), ELSEWHERE: (self.new & apart & free) - set(guessed)}
        for text, names in told.items():
            listed = [body["name"] for body in shot.document["bodies"] if body["name"] in names]
            if listed:
                shot.findings.add(CHANGED, "object", text, *listed)

    def _is_as_baked(self, document):
        """Tells whether all that may bear a sleeper is there, and where it was: a sleeper would float without."""
        if not self.recording or self.moves:
            return False
        there = {body["name"]: body for body in document["bodies"]}
        for i, name in enumerate(self.recording.names):
            body, pose = there.get(name), self.recording.poses[0, i]
            if body is None:
                return False
            if body["motion"] != "dynamic" and np.abs(pose - [*body["position"], *body["rotation"]]).max() > SAME:
                return False
        return True

    def _body(self, body, offset):
        """Moves a body to this frame; tells whether its velocity follows from keys."""
        for shape in body["shapes"]:
            track = shape.get("vertex_track")
            if track:
                self._vertices.append((shape, track["points"]))
                shape["vertex_track"] = {"times": track["times"][:len(track["times"]) - offset],
                                         "points": track["points"][offset:]}
        keys = body.pop("track", [])[offset:]
        state = self.states.get(body["name"])
        if keys and (len(keys) > 1 or body["motion"] == "kinematic"):
            body["track"] = [{**key, "time": i * self.step} for i, key in enumerate(keys)]
            body |= {key: keys[0][key] for key in ("position", "rotation")}
            return False
        if body["motion"] != "dynamic" or state is None:
            return False
        body |= {"position": state.position, "rotation": state.rotation}
        sleeps = body.pop("start_asleep", False) and state.is_untouched
        if sleeps or self.lets_sleep and state.is_at_rest:
            body["start_asleep"] = True
            return False
        if state.linear is not None:
            body |= {"linear_velocity": state.linear, "angular_velocity": state.angular}
            return False
        if body["name"] in self.new and self._is_still(body["name"]):
            return False
        # A body that leaves its keys at this frame has their velocity.
        body |= self._difference(body, 0 if keys else max(self._around))
        return True

    def _is_still(self, name):
        """Tells whether an object keeps its place around this frame."""
        return all(around[name] == self._around[0][name] for around in self._around.values())

    def _difference(self, body, second):
        """Returns velocities from the keys of the frame before, and of this frame or the next one."""
        one, other = self._around[-1][body["name"]], self._around[second][body["name"]]
        time = (second + 1) * self.step * self.pace
        turn = other.to_quaternion() @ one.to_quaternion().inverted()
        spin = _rotation_vector(turn) / time
        center = _unturned_center(body)
        linear = (other @ center - one @ center) / time
        return {"linear_velocity": turned(linear), "angular_velocity": turned(spin)}

    def extend(self, document):
        """Makes the scene of the later part one of the whole recording, which begins earlier."""
        document["extras"]["frame_start"] = self.first
        for shape, points in ((shape, points) for shape, points in self._vertices if "vertex_track" in shape):
            points = points[self.first - self.scene_start:]
            shape["vertex_track"] = {"times": [i * self.step for i in range(len(points))], "points": points}

    def merge(self, recording, path):
        """Writes the earlier recording up to this frame, and a later one from it on; tells whether there are both."""
        later = Recording.read(recording)
        if later and self.recording:
            self.recording.followed_by(later, self.count).write(path)
        return bool(later and self.recording)


def _names_now(things):
    """Returns the names of baked objects by those at their bake."""
    names = {}
    for thing in things:
        then = thing[ORIGINAL].get("name", thing.name_full)
        # A duplicate has the name that its model had.
        if then not in names or thing.name_full == then:
            names[then] = thing.name_full
    return names


def _rotation_vector(turn):
    """Returns the axis of a rotation times its angle, which is at most half a turn."""
    turn = Quaternion(turn if turn.w >= 0 else -turn)
    axis, angle = turn.to_axis_angle()
    return axis * angle


def _unturned_center(body):
    """Returns the center of mass of a body in its frame, in Blender's axes."""
    center = body.get("center_of_mass")
    if center is None:
        center = joined([solid_of(shape) for shape in body["shapes"]]).center
    return Vector(unturned(center))
