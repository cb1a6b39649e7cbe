"""Speed and gravity of a scene, frame by frame if they have keys."""

from .curves import animates
from .findings import CHANGED, LEFT_OUT
from .space import LONGEST, frames_per_second, has_keyed_speed, refuse_speed, turned, world_of

WEIGHTS = "rigidbody_world.effector_weights."
# Properties whose keys change gravity.
GRAVITY = ("gravity", "use_gravity", WEIGHTS + "gravity", WEIGHTS + "all")


def gravity_of(scene):
    """Returns the acceleration of gravity at the present frame, in Drystone's axes. [m/s^2]"""
    weights = world_of(scene).effector_weights
    return turned(scene.gravity * (weights.gravity * weights.all if scene.use_gravity else 0))


def is_keyed(scene):
    """Tells whether speed or gravity have keys or drivers."""
    return has_keyed_speed(scene) or animates(scene, *GRAVITY)


class Course:
    """Speed and gravity of a scene, noted at each of its frames."""

    def __init__(self, scene):
        self.scene = scene
        self._noted = []

    def look(self):
        """Notes speed and gravity at the present frame."""
        speed = world_of(self.scene).time_scale if has_keyed_speed(self.scene) else 1.0
        most = LONGEST * frames_per_second(self.scene)
        if speed > most:
            refuse_speed(self.scene, speed)
        self._noted.append((speed, gravity_of(self.scene)))

    def changes_gravity(self):
        return any(gravity != self._noted[0][1] for _, gravity in self._noted)

    def track(self, step):
        """Returns the key with speed and gravity at each frame; none if they stay as the scene has them."""
        if all(speed == 1 and gravity == self._noted[0][1] for speed, gravity in self._noted):
            return {}
        return {"track": [{"time": frame * step, "speed": speed, "gravity": gravity}
                          for frame, (speed, gravity) in enumerate(self._noted)]}


def tell(scene, findings, is_known):
    """Notes which keys of speed and gravity a bake has otherwise; `is_known` if the program knows them."""
    if is_keyed(scene) and not is_known:
        findings.add(LEFT_OUT, "scene", " with keys of Speed or gravity: not known to this version of drystone",
                     scene.name)
    if has_keyed_speed(scene) and any(of.rigid_body_constraint and of.rigid_body_constraint.use_breaking
                                      for of in scene.objects):
        findings.add(CHANGED, "scene", " with keys of Speed, and constraints that break: these as at the first frame",
                     scene.name)
