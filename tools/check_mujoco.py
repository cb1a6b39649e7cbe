#!/usr/bin/env python3
"""Accelerations of mechanisms, beside those of MuJoCo.

    python3 tools/check_mujoco.py DRYSTONE [--only NAME] [--keep FOLDER]

Each mechanism is stated once, and written both as a scene and as a model of MuJoCo. Its pose and
its velocities are random, from a fixed seed. They satisfy all locks, those of closed loops too.

MuJoCo: `qacc` of its forward dynamics, as accelerations of the centers of mass and angular
accelerations. Its constraints are soft and leave out the term (dJ/dt) v. Here they are made
`STIFFER` times stiffer, and the term is added to their reference accelerations.

Drystone: a bake of `TIME` seconds. A polynomial through the poses has the acceleration at the start
as its second derivative; pose and velocity at the start are given. Drives make an error of first
order in the length of a substep, which bakes with two lengths remove (Richardson). The state of a
body has 32-bit numbers. So the result is a mean over rotated copies, which round differently.

A mechanism agrees if no body differs by more than `ACCURACY` of the largest acceleration in it,
linear or angular. Exit code 1 if one does not. Needs numpy and mujoco.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile

import mujoco
import numpy as np

ACCURACY = 1e-3
GRAVITY = np.array([0.8, -9.6, 1.5])
TIME = 0.06
"""Length of a bake [s]."""
FRAMES = 40
SUBSTEPS = (12, 24)
"""Per frame, of the coarse and the fine bake. Both take all damping as light (joint/rows.rs)."""
COPIES = 32
"""Rotated copies of a mechanism."""
DEGREE = 7
"""Degree of the polynomial in time."""
STRETCH = 1e-9
"""Distance by which locks yield under the weight of the mechanism [m]."""
STIFFER = 1e4
"""Factor of the stiffness of MuJoCo's constraints, beyond its stiffest setting."""
SOLVE = 'solref="2e-5 1" solimp="0.9999 0.9999 0.001 0.5 2"'
"""MuJoCo's stiffest setting of an equality."""


# Rotations are matrices, and quaternions x, y, z, w as in scenes.

def about(axis, angle):
    """The rotation by an angle about a unit axis."""
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def rotation(q):
    x, y, z, w = q / np.linalg.norm(q)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def quaternion(matrix):
    q = np.zeros(4)
    mujoco.mju_mat2Quat(q, np.ascontiguousarray(matrix).ravel())
    return np.roll(q, -1)


def frame_along(axis):
    """A rotation whose x axis has this direction."""
    x = np.asarray(axis, float) / np.linalg.norm(axis)
    y = np.cross(x, np.eye(3)[np.argmin(abs(x))])
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


class Mechanism:
    """Bodies in a reference pose, where all coordinates of joints are 0, and what joins them."""

    def __init__(self, name, seed, speed=1.0):
        self.name = name
        self.speed = speed
        """Root mean square of the velocities of joints [m/s, or rad/s]."""
        self.random = np.random.default_rng(seed)
        self.bodies = []
        self.closings, self.springs, self.couplings = [], [], []

    def unit(self):
        v = self.random.normal(size=3)
        return v / np.linalg.norm(v)

    def between(self, low, high):
        return float(self.random.uniform(low, high))

    def body(self, kind, parent=None, at=None, anchor=None, axis=None, range_=0.8, **axes):
        """Adds a body that a joint of this kind holds on its parent, and returns its index.

        `axes` has forces along coordinates of the joint, by name: a dictionary with stiffness,
        damping and rest of a spring; with servo, a list of drives; with friction.
        """
        base = np.zeros(3) if parent is None else self.bodies[parent]["position"]
        position = base + 0.25 * self.unit() if at is None else np.asarray(at, float)
        mass = self.between(0.5, 2.0)
        # Half-lengths of an ellipsoid of this mass.
        half = self.random.uniform(0.1, 0.2, 3)
        inertia = mass / 5 * (sum(half**2) - half**2)
        self.bodies.append({
            "kind": kind, "parent": parent, "mass": mass, "inertia": inertia,
            "position": position, "rotation": rotation(self.random.normal(size=4)),
            "anchor": (position + base) / 2 + 0.04 * self.unit() if anchor is None
            else np.asarray(anchor, float),
            "frame": frame_along(self.unit() if axis is None else axis),
            "axes": axes, "range": range_,
        })
        return len(self.bodies) - 1

    def close(self, kind, a, b=None, at=None, axis=None):
        """Closes a loop: joins a and b, or the world, in the pose of the comparison.

        `at` is a point in the frame of a."""
        at = 0.1 * self.unit() if at is None else np.asarray(at, float)
        self.closings.append((kind, a, b, at, axis))

    def spring(self, a, b, stiffness, damping, rest):
        """A spring between a point of a and one of b, or of the world."""
        points = [0.1 * self.unit(), 0.1 * self.unit()]
        self.springs.append((a, b, points, stiffness, damping, rest))

    def couple(self, kind, a, b, ratio):
        """A gear or a rack: a and `ratio` times b move against each other. Both joined to the
        world."""
        self.couplings.append((kind, a, b, ratio))


# Kinds of joints: the joints of MuJoCo that make them, as type and axis of the frame, and the
# coordinate of Drystone that each is.
KINDS = {
    "free": [("free", None, None)],
    "ball": [("ball", None, "rotation")],
    "hinge": [("hinge", 0, "twist")],
    "slider": [("slide", 0, "x")],
    "piston": [("slide", 0, "x"), ("hinge", 0, "twist")],
    "universal": [("hinge", 2, "swing_z"), ("hinge", 0, "twist")],
    "planar": [("slide", 1, "y"), ("slide", 2, "z"), ("hinge", 0, "twist")],
    "screw": [("slide", 0, "x"), ("hinge", 0, "twist")],
    "fixed": [],
}
PITCH = 0.3
"""Of screws [m]."""
OWN = {"hinge": "twist", "slider": "x", "piston": "x"}
"""Coordinates whose forces are keys of the joint itself."""


def numbers(values):
    return " ".join(repr(float(x)) for x in np.ravel(values))


def scalar_first(matrix):
    return numbers(np.roll(quaternion(matrix), 1))


def model_of(mechanism, sites=()):
    """The text of the model. `sites` are ends of closings: body, position, rotation."""
    bodies = mechanism.bodies

    def element(index):
        body = bodies[index]
        parent = body["parent"]
        base, turned = (np.zeros(3), np.eye(3)) if parent is None else (
            bodies[parent]["position"], bodies[parent]["rotation"])
        own = body["rotation"]
        yield (f'<body name="b{index}" pos="{numbers(turned.T @ (body["position"] - base))}" '
               f'quat="{scalar_first(turned.T @ own)}">')
        yield (f'<inertial pos="0 0 0" mass="{body["mass"]!r}" '
               f'diaginertia="{numbers(body["inertia"])}"/>')
        for number, (kind, column, coordinate) in enumerate(KINDS[body["kind"]]):
            text = f'<joint name="j{index}_{number}" type="{kind}"'
            if kind != "free":
                text += f' pos="{numbers(own.T @ (body["anchor"] - body["position"]))}"'
            if column is not None:
                text += f' axis="{numbers(own.T @ body["frame"][:, column])}"'
            force = body["axes"].get(coordinate, {})
            text += f' stiffness="{force.get("stiffness", 0.0)!r}"'
            text += f' damping="{force.get("damping", 0.0)!r}"'
            text += f' frictionloss="{force.get("friction", 0.0)!r}"'
            if kind in ("hinge", "slide"):
                text += f' springref="{force.get("rest", 0.0)!r}"'
            yield text + "/>"
        yield from site(index)
        for child, other in enumerate(bodies):
            if other["parent"] == index:
                yield from element(child)
        yield "</body>"

    def site(index):
        for number, (body, position, turned) in enumerate(sites):
            if body == index:
                yield (f'<site name="s{number}" pos="{numbers(position)}" '
                       f'quat="{scalar_first(turned)}"/>')
        for number, (a, b, points, *_) in enumerate(mechanism.springs):
            for end, point in zip((a, b), points):
                if end == index:
                    yield f'<site name="t{number}_{"ab"[end is b]}" pos="{numbers(point)}"/>'

    def actuators():
        for index, body in enumerate(bodies):
            for number, (*_, coordinate) in enumerate(KINDS[body["kind"]]):
                for drive in body["axes"].get(coordinate, {}).get("servo", ()):
                    limit = drive.get("at_most")
                    reach = f' forcerange="{-limit} {limit}"' if limit else ""
                    gain = drive.get("stiffness", 0.0), drive.get("damping", 0.0)
                    bias = np.dot(gain, [drive.get("position", 0.0), drive.get("velocity", 0.0)])
                    yield (f'<general joint="j{index}_{number}" gainprm="0" biastype="affine" '
                           f'biasprm="{float(bias)!r} {-gain[0]!r} {-gain[1]!r}"{reach}/>')

    def equalities():
        for number, (kind, *_) in enumerate(mechanism.closings):
            # A hinge is two points of its axis.
            ends = {"ball": [("connect", 0)], "fixed": [("weld", 0)],
                    "hinge": [("connect", 0), ("connect", 2)]}[kind]
            for name, offset in ends:
                yield (f'<{name} site1="s{4 * number + offset}" site2="s{4 * number + offset + 1}" '
                       f'{SOLVE}/>')
        for index, body in enumerate(bodies):
            if body["kind"] == "screw":
                yield (f'<joint joint1="j{index}_0" joint2="j{index}_1" '
                       f'polycoef="0 {PITCH / (2 * math.pi)!r} 0 0 0" {SOLVE}/>')
        for _, a, b, ratio in mechanism.couplings:
            yield (f'<joint joint1="j{a}_0" joint2="j{b}_0" polycoef="0 {-ratio!r} 0 0 0" '
                   f'{SOLVE}/>')

    roots = [line for index, body in enumerate(bodies) if body["parent"] is None
             for line in element(index)]
    tendons = [f'<spatial stiffness="{k!r}" damping="{c!r}" springlength="{rest!r}">'
               f'<site site="t{number}_a"/><site site="t{number}_b"/></spatial>'
               for number, (_, _, _, k, c, rest) in enumerate(mechanism.springs)]
    return "\n".join([
        "<mujoco>", '<compiler angle="radian" inertiafromgeom="false"/>',
        f'<option gravity="{numbers(GRAVITY)}" timestep="1e-5" solver="Newton" jacobian="dense" '
        'tolerance="0" iterations="100" ls_iterations="100"><flag island="disable"/></option>',
        "<worldbody>", *site(None), *roots, "</worldbody>",
        "<tendon>", *tendons, "</tendon>",
        "<equality>", *(equalities() if sites or not mechanism.closings else ()), "</equality>",
        "<actuator>", *actuators(), "</actuator>", "</mujoco>"])


class Reference:
    """A mechanism in MuJoCo: pose, velocity and acceleration of its bodies."""

    def __init__(self, mechanism):
        self.mechanism = mechanism
        model = mujoco.MjModel.from_xml_string(model_of(mechanism))
        data = mujoco.MjData(model)
        self.pose(model, data)
        positions = data.qpos.copy()
        self.places = [(data.xpos[i + 1].copy(), data.xmat[i + 1].reshape(3, 3).copy())
                       for i in range(len(mechanism.bodies))]
        self.ends = [self.end(*closing) for closing in mechanism.closings]
        sites = []
        for (_, a, b, *_), ends in zip(mechanism.closings, self.ends):
            for along in (0.0, 0.1):
                for body, (point, frame) in zip((a, b), ends):
                    sites.append((body, point + along * frame[:, 0], frame))
        if sites:
            model = mujoco.MjModel.from_xml_string(model_of(mechanism, sites))
            data = mujoco.MjData(model)
            data.qpos[:] = positions
        self.model, self.data = model, data
        self.accelerate()

    def pose(self, model, data):
        """Random coordinates of joints."""
        mechanism = self.mechanism
        for joint in range(model.njnt):
            index = int(model.joint(joint).name[1:].split("_")[0])
            body = mechanism.bodies[index]
            at = model.jnt_qposadr[joint]
            match model.jnt_type[joint]:
                case mujoco.mjtJoint.mjJNT_BALL:
                    angle = mechanism.between(-body["range"], body["range"])
                    q = quaternion(about(mechanism.unit(), angle))
                    data.qpos[at:at + 4] = np.roll(q, 1)
                case mujoco.mjtJoint.mjJNT_HINGE:
                    data.qpos[at] = mechanism.between(-body["range"], body["range"])
                case mujoco.mjtJoint.mjJNT_SLIDE:
                    data.qpos[at] = 0.1 * mechanism.between(-body["range"], body["range"])
        for index, body in enumerate(mechanism.bodies):
            if body["kind"] == "screw":
                turn = data.joint(f"j{index}_1").qpos[0]
                data.joint(f"j{index}_0").qpos[0] = PITCH / (2 * math.pi) * turn
        for _, a, b, ratio in mechanism.couplings:
            data.joint(f"j{a}_0").qpos[0] = -ratio * data.joint(f"j{b}_0").qpos[0]
        mujoco.mj_kinematics(model, data)

    def end(self, kind, a, b, at, axis):
        """Frames of a closing in a and in b, which coincide."""
        place, turned = self.places[a]
        point = place + turned @ at
        frame = frame_along([1, 0, 0] if axis is None else axis)
        ends = []
        for body in (a, b):
            place, turned = (np.zeros(3), np.eye(3)) if body is None else self.places[body]
            ends.append((turned.T @ (point - place), turned.T @ frame))
        return ends

    def accelerate(self):
        model, data, random = self.model, self.data, self.mechanism.random
        velocity = random.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        jacobian = self.equality_jacobian()
        self.freedom = model.nv - np.linalg.matrix_rank(jacobian, tol=1e-9)
        # Velocities that all equalities allow.
        for _ in range(2):
            velocity -= np.linalg.pinv(jacobian, rcond=1e-9) @ (jacobian @ velocity)
        velocity *= self.mechanism.speed * math.sqrt(model.nv) / np.linalg.norm(velocity)
        data.qvel[:] = velocity
        mujoco.mj_forward(model, data)
        drift = self.drift(velocity)
        equal = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        data.efc_aref[equal] = -drift
        data.efc_D[:] *= STIFFER
        data.efc_R[:] /= STIFFER
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 1)
        self.missed = float(abs(self.equality_jacobian() @ data.qacc + drift).max(initial=0.0))
        mujoco.mj_rnePostConstraint(model, data)
        self.velocities, self.accelerations = [], []
        for index in range(len(self.mechanism.bodies)):
            kind, result = mujoco.mjtObj.mjOBJ_BODY, np.zeros(6)
            mujoco.mj_objectVelocity(model, data, kind, index + 1, result, 0)
            self.velocities.append((result[3:].copy(), result[:3].copy()))
            mujoco.mj_objectAcceleration(model, data, kind, index + 1, result, 0)
            # MuJoCo's is that of an accelerometer, which gravity does not move.
            self.accelerations.append((result[3:] + GRAVITY, result[:3].copy()))
        self.accelerations = np.array(self.accelerations)

    def equality_jacobian(self):
        data = self.data
        jacobian = data.efc_J.reshape(-1, self.model.nv)
        return jacobian[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY].copy()

    def drift(self, velocity):
        """(dJ/dt) v of the equalities, by central differences along the motion."""
        step, rates = 1e-5, []
        for sign in (1, -1):
            other = mujoco.MjData(self.model)
            other.qpos[:] = self.data.qpos
            mujoco.mj_integratePos(self.model, other.qpos, velocity, sign * step)
            mujoco.mj_forward(self.model, other)
            equal = other.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
            rates.append(other.efc_J.reshape(-1, self.model.nv)[equal] @ velocity)
        return (rates[0] - rates[1]) / (2 * step)


def scene_of(mechanism, reference, substeps, turn):
    """The scene of Drystone, the world rotated by `turn`."""
    bodies = []
    for index, body in enumerate(mechanism.bodies):
        place, turned = reference.places[index]
        linear, angular = reference.velocities[index]
        bodies.append({
            "name": f"b{index}", "position": (turn @ place).tolist(),
            "rotation": quaternion(turn @ turned).tolist(),
            "mass": body["mass"], "inertia": body["inertia"].tolist(),
            "linear_velocity": (turn @ linear).tolist(),
            "angular_velocity": (turn @ angular).tolist(),
            "shapes": [{"type": "sphere", "radius": 0.05}],
            "collision": {"systems": ["all"], "not_collides_with": ["all"]},
        })

    def frame(index, point, turned):
        world = turn if index is None else np.eye(3)
        return {"position": (world @ point).tolist(),
                "rotation": quaternion(world @ turned).tolist()}

    def at(index, body):
        place, turned = (np.zeros(3), np.eye(3)) if index is None else (
            mechanism.bodies[index]["position"], mechanism.bodies[index]["rotation"])
        return frame(index, turned.T @ (body["anchor"] - place), turned.T @ body["frame"])

    def pair(a, b):
        return [a, -1 if b is None else b]

    joints = []
    for index, body in enumerate(mechanism.bodies):
        kind, parent = body["kind"], body["parent"]
        if kind == "free":
            continue
        joint = {"type": kind, "bodies": pair(index, parent),
                 "frames": [at(index, body), at(parent, body)]}
        if kind == "screw":
            joint["pitch"] = PITCH
        for coordinate, force in body["axes"].items():
            if OWN.get(kind) == coordinate:
                joint.update(forces(force))
            else:
                joint[coordinate] = forces(force)
        joints.append(joint)
    for (kind, a, b, *_), ends in zip(mechanism.closings, reference.ends):
        joints.append({"type": kind, "bodies": pair(a, b),
                       "frames": [frame(a, *ends[0]), frame(b, *ends[1])]})
    for a, b, points, stiffness, damping, rest in mechanism.springs:
        anchors = [frame(i, point, np.eye(3))["position"] for i, point in zip((a, b), points)]
        joints.append({"type": "spring", "bodies": pair(a, b), "anchors": anchors,
                       "stiffness": stiffness, "damping": damping, "rest": rest})
    for kind, a, b, ratio in mechanism.couplings:
        axes = [(turn @ mechanism.bodies[i]["frame"][:, 0]).tolist() for i in (a, b)]
        key, value = ("ratio", ratio) if kind == "gear" else ("radius", 1 / ratio)
        joints.append({"type": kind, "bodies": [a, b], "axes": axes, key: value})
    return {"name": mechanism.name, "dimension": 3, "gravity": (turn @ GRAVITY).tolist(),
            "time_step": TIME / FRAMES, "steps": FRAMES, "bodies": bodies, "joints": joints,
            "solver": {"substeps": substeps, "stretch": STRETCH}}


def forces(force):
    """Keys of the coordinate of a scene that has these forces."""
    own = {}
    if "stiffness" in force or "damping" in force:
        own["spring"] = {key: force[key] for key in ("stiffness", "damping", "rest")
                         if key in force}
    if "servo" in force:
        own["drives"] = force["servo"]
    if "friction" in force:
        own["friction"] = force["friction"]
    return own


def bake(mechanism, reference, substeps, turn, drystone, folder):
    """Accelerations at the start of a bake: bodies x (linear, angular) x 3."""
    scene = folder / f"{mechanism.name}.json"
    scene.write_text(json.dumps(scene_of(mechanism, reference, substeps, turn), indent=1))
    arrays = scene.with_suffix(".npz")
    subprocess.run([drystone, "bake", str(scene), "-o", str(arrays), "-q", "--threads", "1"],
                   check=True)
    baked = np.load(arrays)
    times, poses = baked["times"][1:] / TIME, baked["poses"][1:].astype(float)
    powers = np.column_stack([times**k / math.factorial(k) for k in range(2, DEGREE + 1)])
    result = []
    for index, (place, turned) in enumerate(reference.places):
        linear, angular = reference.velocities[index]
        moves = poses[:, index, :3] @ turn - place - np.outer(times, TIME * linear)
        # A rotation by a vector r(t) from r(0) = 0 has r'(0) = omega and r''(0) = d omega/dt.
        turns = [rotation_vector(turn.T @ rotation(q) @ turned.T)
                 for q in poses[:, index, 3:]]
        turns -= np.outer(times, TIME * angular)
        fit = np.linalg.lstsq(powers, np.column_stack([moves, turns]), rcond=None)[0]
        result.append(fit[0].reshape(2, 3) / TIME**2)
    return np.array(result)


def accelerations(mechanism, reference, drystone, folder):
    """Accelerations by Drystone, in the limit of short substeps."""
    random = np.random.default_rng(0)
    found = []
    for _ in range(COPIES):
        turn = rotation(random.normal(size=4))
        coarse, fine = (bake(mechanism, reference, n, turn, drystone, folder) for n in SUBSTEPS)
        found.append(2 * fine - coarse)
    return np.mean(found, axis=0)


def rotation_vector(matrix):
    q = quaternion(matrix)
    q *= math.copysign(1, q[3])
    sine = np.linalg.norm(q[:3])
    return 2 * q[:3] if sine < 1e-12 else 2 * math.atan2(sine, q[3]) * q[:3] / sine


def mechanisms():
    # Four free bodies, which springs connect.
    m = Mechanism("springs", 1)
    for _ in range(4):
        m.body("free", at=0.3 * m.unit())
    for a, b in [(0, 1), (1, 2), (2, 3), (3, 0), (0, None)]:
        m.spring(a, b, m.between(20, 60), m.between(0.5, 2), 0.2)
    yield m

    # A chain of six hinges, in all directions.
    m = Mechanism("hinges", 2)
    last = None
    for k in range(6):
        last = m.body("hinge", last)
    yield m

    # A torso with four limbs of two parts in free fall: balls with springs, hinges with damping.
    m = Mechanism("figure", 3)
    torso = m.body("free", at=[0, 0, 0])
    for _ in range(4):
        upper = m.body("ball", torso, rotation={"stiffness": m.between(0.5, 2)})
        m.body("hinge", upper, twist={"stiffness": 1.0, "damping": 0.02, "rest": 0.4})
    yield m

    # A cart on a rail with a spring and dry friction carries two poles.
    m = Mechanism("cart", 4, speed=3.0)
    cart = m.body("slider", x={"stiffness": 120.0, "damping": 3.0, "rest": 0.05, "friction": 1.5})
    pole = m.body("hinge", cart, twist={"damping": 0.02})
    m.body("hinge", pole, twist={"friction": 0.05})
    m.body("ball", cart)
    yield m

    # An arm of six hinges with servos, one of which is at its largest torque, and a slider.
    m = Mechanism("arm", 5)
    last = None
    for k in range(6):
        servo = {"position": m.between(-0.5, 0.5), "stiffness": m.between(10, 30),
                 "damping": m.between(0.1, 0.3)}
        if k == 2:
            servo["at_most"] = 0.5
            servo["position"] = 3.0
        last = m.body("hinge", last, twist={"servo": [servo]})
    m.body("slider", last, x={"servo": [{"velocity": 0.3, "damping": 4.0}], "stiffness": 80.0})
    yield m

    # Four bars, closed by a hinge; a motor drives the first with its largest torque.
    m = Mechanism("four bars", 6, speed=3.0)
    axis = m.unit()
    side, up = frame_along(axis)[:, 1:].T
    crank = m.body("hinge", None, anchor=[0, 0, 0], at=0.1 * up + 0.02 * axis, axis=axis,
                   twist={"servo": [{"velocity": -20.0, "damping": 0.5, "at_most": 3.0}]})
    rod = m.body("hinge", crank, anchor=0.2 * up, at=0.2 * up + 0.2 * side, axis=axis)
    rocker = m.body("hinge", rod, anchor=0.25 * up + 0.4 * side, at=0.1 * up + 0.42 * side,
                    axis=axis)
    m.close("hinge", rocker, axis=axis)
    yield m

    # A slider and a crank with a servo and a spring.
    m = Mechanism("slider and crank", 7)
    axis = m.unit()
    side, up = frame_along(axis)[:, 1:].T
    crank = m.body("hinge", None, anchor=[0, 0, 0], at=0.07 * up, axis=axis,
                   twist={"servo": [{"position": 0.6, "stiffness": 12.0, "damping": 0.2}]})
    rod = m.body("hinge", crank, anchor=0.15 * up, at=0.15 * up + 0.15 * side, axis=axis)
    m.body("slider", None, at=0.35 * side, anchor=0.35 * side, axis=side,
           x={"stiffness": 100.0, "damping": 2.0})
    m.close("hinge", 2, rod, axis=axis)
    yield m

    # A loop in space: two hinges on the world, and a rod between two balls.
    m = Mechanism("spatial loop", 8, speed=2.0)
    crank = m.body("hinge", twist={"damping": 0.1})
    rod = m.body("ball", crank)
    rocker = m.body("hinge", at=[0.3, 0.1, -0.2], twist={"stiffness": 3.0})
    m.close("ball", rod, rocker)
    yield m

    # Shafts with universal joints, the last of which slides and turns; a planar body beside it.
    m = Mechanism("shafts", 9)
    first = m.body("hinge", twist={"servo": [{"velocity": 5.0, "damping": 0.3}]})
    second = m.body("universal", first)
    third = m.body("universal", second)
    m.body("piston", third, x={"stiffness": 150.0, "damping": 1.0}, twist={"damping": 0.05})
    m.body("planar", first, y={"stiffness": 90.0}, z={"stiffness": 60.0, "damping": 1.0})
    yield m

    # A ring of eight hinges, welded to the world.
    m = Mechanism("ring", 10)
    last = None
    for k in range(8):
        last = m.body("hinge", last, range_=0.5, **({"twist": {"damping": 0.1}} if k % 2 else {}))
    m.close("fixed", last)
    yield m

    # A gear train, a rack and a screw.
    m = Mechanism("gears", 11)
    wheel = m.body("hinge", twist={"servo": [{"velocity": 3.0, "damping": 0.5}]})
    pinion = m.body("hinge", at=[0.3, 0, 0.1])
    rail = m.body("slider", at=[-0.2, 0.1, 0.3], x={"stiffness": 100.0, "damping": 2.0})
    m.couple("gear", wheel, pinion, 2.5)
    m.couple("rack", pinion, rail, 8.0)
    nut = m.body("screw", rail)
    m.body("hinge", nut)
    yield m


def compare(mechanism, drystone, folder):
    """The reference; the largest accelerations; the largest differences, relative to these."""
    reference = Reference(mechanism)
    expected = reference.accelerations
    found = accelerations(mechanism, reference, drystone, folder)
    largest = np.linalg.norm(expected, axis=2).max(axis=0)
    return reference, largest, np.linalg.norm(found - expected, axis=2).max(axis=0) / largest


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("drystone", help="the program")
    parser.add_argument("--only", help="compare the mechanism of this name")
    parser.add_argument("--keep", help="keep scenes and bakes in this folder")
    options = parser.parse_args()
    print("mechanism: bodies, degrees of freedom, largest accelerations [m/s^2, rad/s^2]; "
          "relative differences")
    failed = False
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(options.keep or temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for mechanism in mechanisms():
            if options.only not in (None, mechanism.name):
                continue
            reference, largest, worst = compare(mechanism, options.drystone, folder)
            agrees = worst.max() <= ACCURACY
            failed |= not agrees
            print(f"{mechanism.name}: {len(mechanism.bodies)}, {reference.freedom}, "
                  f"{largest[0]:.3g}, {largest[1]:.3g}; {worst[0]:.1e}, {worst[1]:.1e}"
                  f"{'' if agrees else ' FAILED'}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
