"""Scenes with joints, which make.py writes."""

import math

from parts import box, floor, turn

ALONG_Z = turn([1, 0, 0], math.pi / 2)


def sphere(radius):
    return {"type": "sphere", "radius": radius}


def capsule(radius, length):
    """A capsule along y of this length, its ends included."""
    return {"type": "capsule", "radius": radius, "half_height": length / 2 - radius}


def wheel(radius, width):
    """A cylinder along z."""
    return {"type": "cylinder", "radius": radius, "half_height": width / 2, "rotation": ALONG_Z}


def placed(shape, *position, **more):
    return {**shape, "position": list(position), **more}


def bar(name, start, end, radius, **more):
    """A capsule between two points in a plane of constant z."""
    (ax, ay, z), (bx, by, _) = start, end
    length = math.hypot(bx - ax, by - ay)
    return {"name": name, "position": [(ax + bx) / 2, (ay + by) / 2, z],
            "rotation": turn([0, 0, 1], math.atan2(ax - bx, by - ay)),
            "shapes": [capsule(radius, length)], **more}


def hinge(name, bodies, anchor, axis=(0, 0, 1), **more):
    return {"type": "hinge", "name": name, "bodies": bodies, "anchor": list(anchor),
            "axis": list(axis), **more}


def ball(name, bodies, anchor, **more):
    return {"type": "ball", "name": name, "bodies": bodies, "anchor": list(anchor), **more}


def engine():
    """Four cylinders in line: a motor turns the crankshaft, which moves the pistons."""
    throw, length, bore, pitch = 0.04, 0.13, 0.04, 0.11
    shaft = [placed(wheel(0.02, 4 * pitch + 0.06), 0.0, 0.0, 0.0),
             placed(wheel(0.09, 0.025), 0.0, 0.0, 2 * pitch + 0.045)]
    bodies = [{"name": "block", "motion": "static", "shapes": [
        placed(box(0.006, 0.08, 2 * pitch), side * (bore + 0.012), 0.16, 0.0) for side in (-1, 1)]}]
    joints = [hinge("main bearing", ["crankshaft"], (0, 0, 0),
                    motor={"velocity": 20.0, "at_most": 60.0})]
    # Off the dead centers at the start.
    for i, phase in enumerate((0.6, math.pi + 0.6, math.pi + 0.6, 0.6)):
        z = (i - 1.5) * pitch
        pin = [throw * math.sin(phase), throw * math.cos(phase), z]
        top = [0.0, pin[1] + math.sqrt(length**2 - pin[0] ** 2), z]
        shaft.append(placed(wheel(0.014, 0.06), *pin))
        for side in (-1, 1):
            shaft.append(placed(box(0.022, 0.042, 0.008), 0.3 * pin[0], 0.3 * pin[1],
                                z + side * 0.024, rotation=turn([0, 0, 1], -phase)))
        bodies.append(bar(f"rod {i + 1}", pin, top, 0.01))
        bodies.append({"name": f"piston {i + 1}", "position": top, "density": 2700.0,
                       "shapes": [{"type": "cylinder", "radius": bore, "half_height": 0.028}]})
        joints += [hinge(f"crank pin {i + 1}", [f"rod {i + 1}", "crankshaft"], pin),
                   hinge(f"piston pin {i + 1}", [f"rod {i + 1}", f"piston {i + 1}"], top),
                   {"type": "slider", "name": f"cylinder {i + 1}",
                    "bodies": [f"piston {i + 1}", "block"], "axis": [0.0, 1.0, 0.0]}]
    bodies.insert(1, {"name": "crankshaft", "material": "steel", "shapes": shaft})
    for body in bodies:
        if body["name"].startswith("rod"):
            body["material"] = "steel"
    return {"name": "engine", "duration": 6.0, "materials": {"steel": {"density": 7800.0}},
            "bodies": bodies, "joints": joints}


def bridge():
    """A suspension bridge of thirty meters; a cart drives across it."""
    half, deck, low, high, side = 15.0, 5.0, 6.2, 12.0, 1.75
    cable_at = lambda x: low + (high - low) * (x / half) ** 2
    bodies = [floor()]
    for name, sign in (("west", -1), ("east", 1)):
        legs = [placed(box(0.3, 6.2, 0.2), sign * half, 6.2, z * 2.1) for z in (-1, 1)]
        beam = placed(box(0.3, 0.25, 2.3), sign * half, 12.2, 0.0)
        bodies.append({"name": f"{name} tower", "motion": "static", "shapes": [*legs, beam]})
        bodies.append({"name": f"{name} road", "motion": "static", "material": "timber",
                       "position": [sign * (half + 4.02), deck, 0.0],
                       "shapes": [box(4.0, 0.08, 1.6)]})
    xs = [2.0 * i for i in range(-7, 8)]
    joints = []
    for i, x in enumerate(xs):
        bodies.append({"name": f"plank {i + 1}", "material": "timber", "position": [x, deck, 0.0],
                       "shapes": [box(0.985, 0.08, 1.6)]})
        before = f"plank {i}" if i else "west road"
        joints.append(hinge(f"deck {i + 1}", [f"plank {i + 1}", before], (x - 1, deck, 0)))
    # The east end slides, so that the deck can sag.
    # Cables and hangers are thinner in earnest; near their ends they would overlap.
    ropes = {"systems": ["ropes"], "not_collides_with": ["ropes"]}
    joints.append({"type": "general", "name": "expansion joint",
                   "bodies": ["plank 15", "east road"], "anchor": [half, deck, 0.0],
                   "axis": [1.0, 0.0, 0.0], "x": [-0.3, 0.3],
                   "y": "locked", "z": "locked", "twist": "locked", "swing_y": "locked"})
    for name, z in (("left", -side), ("right", side)):
        nodes = [(x, cable_at(x), z) for x in (-half, *xs, half)]
        for i, (a, b) in enumerate(zip(nodes, nodes[1:])):
            bodies.append(bar(f"{name} cable {i + 1}", a, b, 0.05, material="steel",
                              collision=ropes))
            before = f"{name} cable {i}" if i else "west tower"
            joints.append(ball(f"{name} saddle {i + 1}", [f"{name} cable {i + 1}", before], a))
        joints.append(ball(f"{name} saddle 17", [f"{name} cable 16", "east tower"], nodes[-1]))
        for i, node in enumerate(nodes[1:-1]):
            foot = (node[0], deck, z)
            hanger = f"{name} hanger {i + 1}"
            bodies.append(bar(hanger, foot, node, 0.03, material="steel", collision=ropes))
            joints += [ball(f"{hanger} top", [hanger, f"{name} cable {i + 1}"], node),
                       ball(f"{hanger} foot", [hanger, f"plank {i + 1}"], foot)]
    cart, wheels = cart_on(-18.0, deck + 0.08)
    return {"name": "bridge", "duration": 20.0,
            "materials": {"timber": {"density": 600.0, "friction": 0.8},
                          "steel": {"density": 7800.0}},
            "bodies": [*bodies, *cart], "joints": [*joints, *wheels]}


def cart_on(x, y):
    """A cart with four driven wheels, at x on a road at the height y."""
    radius, bodies, joints = 0.35, [], []
    bodies.append({"name": "cart", "mass": 800.0, "position": [x, y + 0.75, 0.0],
                   "shapes": [box(1.2, 0.25, 0.7)]})
    for along, ahead in (("front", 0.8), ("rear", -0.8)):
        for name, z in (("left", -0.95), ("right", 0.95)):
            place = [x + ahead, y + radius, z]
            bodies.append({"name": f"{along} {name} wheel", "mass": 25.0, "friction": 0.9,
                           "position": place, "shapes": [wheel(radius, 0.16)]})
            joints.append(hinge(f"{along} {name} axle", [f"{along} {name} wheel", "cart"], place,
                                motor={"velocity": -5.5, "at_most": 150.0}))
    return bodies, joints


def crane():
    """A crane slews a wrecking ball on a chain of twenty-four links into a wall."""
    tip, height, link, count, radius = 12.0, 20.0, 0.6, 24, 0.8
    bodies = [floor(),
              {"name": "mast", "motion": "static", "position": [0.0, height / 2 - 0.4, 0.0],
               "shapes": [box(0.7, height / 2 - 0.4, 0.7)]},
              {"name": "jib", "density": 300.0, "position": [0.0, height, 0.0], "shapes": [
                  placed(box(8.5, 0.35, 0.35), 4.5, 0.0, 0.0),
                  placed(box(1.2, 0.8, 0.9), -5.2, -0.2, 0.0)]}]
    joints = [hinge("slewing ring", ["jib", "mast"], (0, height - 0.6, 0), (0, 1, 0),
                    limits=[0.0, 2.4], motor={"velocity": 0.4, "at_most": 150000.0})]
    y, before = height - 0.5, "jib"
    for i in range(count):
        bodies.append({"name": f"link {i + 1}", "density": 7800.0,
                       "position": [tip, y - link / 2, 0.0], "shapes": [capsule(0.07, link)]})
        joints.append(ball(f"chain {i + 1}", [f"link {i + 1}", before], (tip, y, 0)))
        y, before = y - link, f"link {i + 1}"
    bodies.append({"name": "wrecking ball", "density": 2500.0, "position": [tip, y - radius, 0.0],
                   "shapes": [sphere(radius)]})
    joints.append(ball("hook", ["wrecking ball", before], (tip, y, 0)))
    half = [0.5, 0.3, 0.25]
    for row in range(10):
        for k in range(5):
            # In the way of the ball, which swings outward.
            x = 4.0 + 2 * half[0] * (k + 0.5 * (row % 2))
            bodies.append({"material": "brick", "shapes": [box(*half)],
                           "position": [x, half[1] * (2 * row + 1), -15.0]})
    return {"name": "crane", "duration": 12.0,
            "materials": {"brick": {"density": 1900.0, "friction": 0.6}},
            "bodies": bodies, "joints": joints}


def ragdoll():
    """A ragdoll of thirteen parts falls down fourteen stairs."""
    rise, run, steps = 0.17, 0.28, 14
    top = rise * steps
    bodies = [floor(), {"name": "landing", "motion": "static", "position": [-0.6, top / 2, 0.0],
                        "shapes": [box(0.6, top / 2, 0.9)]}]
    for i in range(steps - 1):
        tall = top - rise * (i + 1)
        bodies.append({"name": f"stair {i + 1}", "motion": "static",
                       "position": [run * (i + 0.5), tall / 2, 0.0],
                       "shapes": [box(run / 2, tall / 2, 0.9)]})
    x, joints = -0.2, []

    def part(name, y, z, *shapes):
        bodies.append({"name": name, "material": "flesh", "position": [x, top + y, z],
                       "linear_velocity": [2.0, 0.0, 0.0], "shapes": list(shapes)})

    def socket(name, pair, y, z, **more):
        joints.append(ball(name, pair, (x, top + y, z), axis=[0.0, -1.0, 0.0],
                           axis_y=[0.0, 0.0, 1.0], **more))

    part("pelvis", 0.95, 0.0, box(0.1, 0.09, 0.16))
    part("chest", 1.27, 0.0, box(0.1, 0.19, 0.17))
    part("head", 1.63, 0.0, sphere(0.11))
    socket("waist", ["chest", "pelvis"], 1.06, 0.0, cone=[0.0, 0.6], twist=[-0.5, 0.5])
    socket("neck", ["head", "chest"], 1.49, 0.0, cone=[0.0, 0.7], twist=[-1.0, 1.0])
    for side, sign in (("left", -1), ("right", 1)):
        arm, leg = 0.24 * sign, 0.09 * sign
        part(f"{side} upper arm", 1.265, arm, capsule(0.045, 0.31))
        part(f"{side} forearm", 0.97, arm, capsule(0.04, 0.28), placed(sphere(0.05), 0, -0.17, 0))
        part(f"{side} thigh", 0.68, leg, capsule(0.065, 0.4))
        part(f"{side} shin", 0.28, leg, capsule(0.05, 0.4))
        part(f"{side} foot", 0.035, leg, placed(box(0.12, 0.034, 0.045), 0.05, 0.0, 0.0))
        socket(f"{side} shoulder", [f"{side} upper arm", "chest"], 1.42, arm,
               cone=[0.0, 1.5], twist=[-0.8, 0.8])
        socket(f"{side} hip", [f"{side} thigh", "pelvis"], 0.88, leg,
               swing_y=[-0.4, 1.3], swing_z=[-0.5, 0.5], twist=[-0.4, 0.4])
        for name, low, high, y, z, limits in (
            ("elbow", "forearm", "upper arm", 1.11, arm, [0.0, 2.4]),
            ("knee", "shin", "thigh", 0.48, leg, [-2.3, 0.0]),
            ("ankle", "foot", "shin", 0.08, leg, [-0.7, 0.5]),
        ):
            joints.append(hinge(f"{side} {name}", [f"{side} {low}", f"{side} {high}"],
                                (x, top + y, z), limits=limits, friction=1.0))
    return {"name": "ragdoll", "duration": 6.0,
            "materials": {"flesh": {"density": 1000.0, "friction": 0.35}},
            "bodies": bodies, "joints": joints}


def car():
    """A car with four sprung wheels drives over a bumpy road."""
    mass, radius, sag = 1200.0, 0.32, 0.08
    bodies = [floor(friction=0.9)]
    for i in range(16):
        side = (-0.75, 0.75, 0.0, 0.0)[i % 4]
        bodies.append({"name": f"bump {i + 1}", "motion": "static", "friction": 0.9,
                       "position": [4.0 + 2.3 * i, -0.5 + (0.1, 0.1, 0.13, 0.08)[i % 4], side],
                       "shapes": [wheel(0.5, 1.2 if side else 3.0)]})
    bodies.append({"name": "chassis", "mass": mass, "position": [0.0, 0.65, 0.0],
                   "center_of_mass": [0.0, -0.1, 0.0],
                   "shapes": [placed(box(2.1, 0.22, 0.62), 0.0, 0.0, 0.0),
                              placed(box(1.0, 0.25, 0.6), -0.3, 0.45, 0.0)]})
    # A quarter of the weight presses each spring by its sag.
    stiffness = mass / 4 * 9.81 / sag
    damping = 2 * 0.4 * math.sqrt(stiffness * mass / 4)
    spring = {"stiffness": stiffness, "damping": damping, "rest": -sag}
    joints = []
    for along, x in (("front", 1.35), ("rear", -1.35)):
        for side, z in (("left", -0.77), ("right", 0.77)):
            place = [x, radius, z]
            bodies.append({"name": f"{along} {side} wheel", "mass": 20.0, "friction": 1.0,
                           "position": place, "shapes": [wheel(radius, 0.2)]})
            motor = {"motor": {"velocity": -20.0, "at_most": 400.0}} if along == "rear" else {}
            joints.append({"type": "wheel", "name": f"{along} {side} suspension",
                           "bodies": [f"{along} {side} wheel", "chassis"], "anchor": place,
                           "axis": [0.0, 0.0, 1.0], "suspension": [0.0, 1.0, 0.0],
                           "limits": [-0.15, 0.12], "spring": spring, **motor})
    return {"name": "car", "duration": 8.0, "bodies": bodies, "joints": joints}


def glued_wall():
    """Three hundred bricks that glue holds together, until a ball hits them."""
    half, rows, columns = [0.12, 0.06, 0.06], 15, 20
    bodies, joints = [floor()], []
    left = lambda row: (row % 2 - columns) * half[0]
    glue = {"force": 3000.0, "torque": 60.0}

    def fix(pair, anchor):
        name = "glue " + " to ".join(brick.removeprefix("brick ") for brick in pair)
        joints.append({"type": "fixed", "name": name, "bodies": pair, "anchor": anchor,
                       "breaking": glue})

    for row in range(rows):
        for k in range(columns):
            x, y = left(row) + half[0] * (2 * k + 1), half[1] * (2 * row + 1)
            name = f"brick {row + 1}.{k + 1}"
            bodies.append({"name": name, "material": "brick", "position": [x, y, 0.0],
                           "shapes": [box(*half)]})
            if k:
                fix([name, f"brick {row + 1}.{k}"], [x - half[0], y, 0.0])
            if row == 0:
                fix([name, "floor"], [x, 0.0, 0.0])
                continue
            # The two bricks below meet in the middle of this one.
            shift = 0 if row % 2 else -1
            for below, end in ((k + shift, -0.5), (k + shift + 1, 0.5)):
                if 0 <= below < columns:
                    fix([name, f"brick {row}.{below + 1}"], [x + end * half[0], y - half[1], 0.0])
    bodies.append({"name": "ball", "mass": 150.0, "position": [0.3, 1.1, 4.0],
                   "linear_velocity": [0.0, 2.0, -10.0], "shapes": [sphere(0.25)]})
    return {"name": "glued wall", "duration": 5.0,
            "materials": {"brick": {"density": 1900.0, "friction": 0.6}},
            "bodies": bodies, "joints": joints}


def clock():
    """A motor turns the second hand; gears drive the minute and the hour hand at a 60th of it."""
    brass, apart, layer = {"density": 8500.0}, 0.085, 0.006
    deep = lambda number: number * layer
    disk = lambda radius, number: placed(wheel(radius, 0.004), 0.0, 0.0, deep(number))

    def hand(length, number):
        return placed(box(0.0015, length / 2, 0.001), 0.0, length / 2 - 0.01, deep(number))

    # Radii of wheels that meet add up to the distance of their arbors.
    minute_pinion, hour_pinion = apart / 9, 0.04 / 5
    arbors = [
        ("second hand", 0.0, [disk(0.01, 0), hand(0.1, 6)]),
        ("third wheel", apart, [disk(0.075, 0), placed(wheel(0.003, 0.01), 0.0, 0.0, deep(0.5)),
                                disk(minute_pinion, 1)]),
        ("minute hand", 0.0, [disk(8 * minute_pinion, 1), disk(0.01, 2), hand(0.085, 5)]),
        ("minute wheel", -0.04, [disk(0.03, 2), placed(wheel(0.003, 0.01), 0.0, 0.0, deep(2.5)),
                                 disk(hour_pinion, 3)]),
        ("hour hand", 0.0, [disk(4 * hour_pinion, 3), hand(0.055, 4)]),
    ]
    bodies = [{"name": name, "material": "brass", "position": [x, 0.0, 0.0], "shapes": shapes,
               "collision": {"systems": ["train"], "not_collides_with": ["train"]}}
              for name, x, shapes in arbors]
    joints = [hinge(f"{name} arbor", [name], (x, 0, 0), **(
        {"motor": {"velocity": -math.pi, "at_most": 0.5}} if name == "second hand" else {}))
              for name, x, _ in arbors]
    pairs = [("third wheel", "second hand", 1 / 7.5), ("minute hand", "third wheel", 1 / 8),
             ("minute wheel", "minute hand", 1 / 3), ("hour hand", "minute wheel", 1 / 4)]
    joints += [{"type": "gear", "name": f"{a} on {b}", "bodies": [a, b], "axis": [0.0, 0.0, 1.0],
                "ratio": ratio} for a, b, ratio in pairs]
    return {"name": "clock", "duration": 30.0, "materials": {"brass": brass}, "bodies": bodies,
            "joints": joints}


def watt_linkage():
    """Two rockers and a coupler, whose middle moves along a straight line: Watt, 1784."""
    links = {"systems": ["links"], "not_collides_with": ["links"]}
    reach, arm, throw = 1.0, 0.3, 0.2

    def link(name, start, end):
        (ax, ay), (bx, by) = start, end
        return {"name": name, "position": [(ax + bx) / 2, (ay + by) / 2], "collision": links,
                "rotation": math.atan2(by - ay, bx - ax), "density": 50.0,
                "shapes": [box(math.hypot(bx - ax, by - ay) / 2, 0.02)]}

    def pin(name, bodies, anchor, **more):
        return {"type": "hinge", "name": name, "bodies": bodies, "anchor": list(anchor), **more}

    left, right, up, down = (-reach, arm), (reach, -arm), (0.0, arm), (0.0, -arm)
    middle, axle = (-reach / 2, arm), (-reach / 2, -0.9)
    crank = (axle[0] + throw, axle[1])
    coupler = link("coupler", down, up)
    coupler["shapes"].append(sphere(0.035))
    bodies = [link("left rocker", left, up), link("right rocker", right, down), coupler,
              link("crank", axle, crank), link("rod", crank, middle)]
    joints = [pin("left pivot", ["left rocker"], left), pin("right pivot", ["right rocker"], right),
              pin("upper pin", ["coupler", "left rocker"], up),
              pin("lower pin", ["coupler", "right rocker"], down),
              pin("axle", ["crank"], axle, motor={"velocity": 3.0, "at_most": 50.0}),
              pin("crank pin", ["rod", "crank"], crank),
              pin("rocker pin", ["rod", "left rocker"], middle)]
    return {"name": "Watt linkage", "dimension": 2, "duration": 8.0, "bodies": bodies,
            "joints": joints}


SCENES = {
    "bridge.json": bridge, "car.toml": car, "clock.toml": clock, "crane.json": crane,
    "engine.toml": engine, "glued_wall.json": glued_wall, "ragdoll.toml": ragdoll,
    "watt_linkage.toml": watt_linkage,
}
