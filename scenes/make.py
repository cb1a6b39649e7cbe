#!/usr/bin/env python3
"""Writes the scenes in this folder: python3 scenes/make.py [NAME...]

The scenes are its output; it is here so that they can be changed. Same bytes on every machine:
its own random numbers, rounded coordinates.
"""

import json
import math
import sys
from pathlib import Path

import machines
import workshop
from parts import box, floor, turn

HERE = Path(__file__).parent


class Random:
    """A small generator of random numbers (a linear congruence of 64 bits), the same everywhere."""

    def __init__(self, seed):
        self.state = seed

    def between(self, low, high):
        self.state = (6364136223846793005 * self.state + 1442695040888963407) % 2**64
        return low + (high - low) * (self.state >> 11) / 2**53

    def direction(self):
        while True:
            v = [self.between(-1, 1) for _ in range(3)]
            length = math.hypot(*v)
            if 0.1 < length < 1:
                return [x / length for x in v]

    def rotation(self):
        angle = self.between(0, math.pi)
        return turn(self.direction(), angle)


# Scenes


def arch():
    """Fifteen wedges of stone between two abutments; only contact holds them."""
    count, inner, outer, depth, spring = 15, 2.0, 2.45, 0.4, 0.8
    stone = {"density": 2400.0, "friction": 0.7}
    bodies = [floor()]
    width = (outer - inner) / 2 + 0.15
    for side, x in (("left", -1), ("right", 1)):
        bodies.append({
            "name": f"{side} abutment", "motion": "static", "material": "stone",
            "position": [x * (inner + outer) / 2, spring / 2, 0.0],
            "shapes": [box(width, spring / 2, depth + 0.1)],
        })
    for i in range(count):
        a, b = (math.pi * j / count for j in (i, i + 1))
        middle = [(inner + outer) / 2 * f((a + b) / 2) for f in (math.cos, math.sin)]
        corners = [(r * math.cos(t) - middle[0], r * math.sin(t) - middle[1])
                   for t in (a, b) for r in (inner, outer)]
        points = [[x, y, z] for x, y in corners for z in (-depth, depth)]
        bodies.append({
            "name": f"voussoir {i + 1}", "material": "stone",
            "position": [middle[0], middle[1] + spring, 0.0],
            "shapes": [{"type": "convex_hull", "points": points}],
        })
    bodies.append({
        "name": "ball", "position": [0.35, spring + outer + 1.0, 0.0], "density": 800.0,
        "shapes": [{"type": "sphere", "radius": 0.18}],
    })
    return {"name": "arch", "duration": 8.0, "materials": {"stone": stone}, "bodies": bodies}


def card_house():
    """Three storeys of cards that lean on each other."""
    thick, half, depth, lean = 0.001, 0.044, 0.0315, math.radians(26)
    c, s = math.cos(lean), math.sin(lean)
    across, up = thick * c + half * s, thick * s + half * c
    roof = thick + 1e-5
    pitch = 2 * half + 0.0002
    bodies = [floor(friction=0.8)]

    def card(name, x, y, angle):
        bodies.append({"name": name, "material": "card", "position": [x, y, 0.0],
                       "rotation": turn([0, 0, 1], angle),
                       "shapes": [box(thick, half, depth)]})

    storeys = 3
    for storey in range(storeys):
        pairs = storeys - storey
        y = storey * (2 * up + 2 * roof) + 1e-5
        for pair in range(pairs):
            x = (pair - (pairs - 1) / 2) * pitch
            card(f"card {storey}.{pair} left", x - across, y + up, -lean)
            card(f"card {storey}.{pair} right", x + across, y + up, lean)
            if pair > 0:
                card(f"roof {storey}.{pair}", x - pitch / 2, y + 2 * up + roof, math.pi / 2)
    card_stock = {"density": 700.0, "friction": 0.8}
    return {"name": "card house", "duration": 6.0,
            "materials": {"card": card_stock}, "bodies": bodies}


def tower():
    """Eighteen layers of three blocks, crosswise; a rod pushes one block out."""
    length, height, width, gap = 0.075, 0.015, 0.025, 0.0002
    bodies = [floor()]
    for layer in range(18):
        for k in (-1, 0, 1):
            along_x = layer % 2 == 0
            aside = k * (width + gap)
            half = [length / 2, height / 2, width / 2]
            bodies.append({
                "name": f"block {layer + 1}.{k + 2}", "material": "wood",
                "position": [0.0 if along_x else aside, height * (layer + 0.5),
                             aside if along_x else 0.0],
                "shapes": [box(*(half if along_x else half[::-1]))],
            })
    y = height * 8.5
    far = -length / 2 - 0.08
    bodies.append({
        "name": "rod", "motion": "kinematic", "friction": 0.2, "position": [far, y, 0.0],
        "track": [{"time": t, "position": [x, y, 0.0]} for t, x in (
            (1.0, far), (1.5, far + 0.03), (4.5, far + 0.095), (5.5, far))],
        "shapes": [box(0.05, 0.004, 0.004)],
    })
    wood = {"density": 600.0, "friction": 0.4}
    return {"name": "tower", "duration": 8.0, "materials": {"wood": wood}, "bodies": bodies}


def pyramid():
    """A square pyramid of 204 blocks: 8 x 8 at the bottom, 1 on top."""
    side, bodies = 0.4, [floor()]
    for layer in range(8):
        count = 8 - layer
        for i in range(count):
            for k in range(count):
                place = [(n - (count - 1) / 2) * (side + 0.02) for n in (i, k)]
                bodies.append({"position": [place[0], side * (layer + 0.5), place[1]],
                               "shapes": [box(side / 2, side / 2, side / 2)]})
    return {"name": "pyramid", "duration": 6.0, "bodies": bodies}


def bowl(radius, depth, thickness, sides=40, rings=8):
    """A closed bowl above y = 0, as triangles: the inside up, round the rim, the outside down."""
    profile = []
    for ring in range(rings + 1):
        angle = math.pi / 2 * 0.8 * ring / rings
        profile.append((radius * math.sin(angle), thickness + depth * (1 - math.cos(angle))))
    outside = [(r + thickness * 0.9, y - thickness * 0.6) for r, y in profile[:0:-1]]
    profile = profile[1:] + outside
    vertices, triangles = [[0.0, thickness, 0.0]], []
    for r, y in profile:
        for side in range(sides):
            a = 2 * math.pi * side / sides
            vertices.append([r * math.cos(a), max(y, 0.0), r * math.sin(a)])
    at = lambda ring, side: 1 + ring * sides + side % sides
    for side in range(sides):
        triangles.append([0, at(0, side + 1), at(0, side)])
        for ring in range(len(profile) - 1):
            a, b, c, d = (at(ring, side), at(ring, side + 1), at(ring + 1, side),
                          at(ring + 1, side + 1))
            triangles += [[a, b, d], [a, d, c]]
    # The middle of the outside.
    vertices.append([0.0, thickness * 0.4, 0.0])
    last = len(profile) - 1
    for side in range(sides):
        triangles.append([len(vertices) - 1, at(last, side), at(last, side + 1)])
    return {"type": "trimesh", "vertices": vertices, "triangles": triangles}


def stones():
    """Two hundred stones fall into a bowl; some do not stay."""
    random = Random(3)
    bodies = [floor(), {"name": "bowl", "motion": "static", "shapes": [bowl(1.5, 1.1, 0.12)]}]
    for i in range(200):
        size = random.between(0.09, 0.2)
        flat = [random.between(0.55, 1.0) for _ in range(3)]
        points = [[size * f * x for f, x in zip(flat, random.direction())] for _ in range(14)]
        place, layer = i % 8, i // 8
        angle = 2 * math.pi * place / 8 + 0.4 * layer
        reach = 0.28 if place % 2 else 0.68
        bodies.append({
            "material": "stone",
            "position": [reach * math.cos(angle), 1.2 + 0.42 * layer, reach * math.sin(angle)],
            "rotation": random.rotation(),
            "shapes": [{"type": "convex_hull", "points": points}],
        })
    stone = {"density": 2600.0, "friction": 0.6, "restitution": 0.1}
    return {"name": "stones", "duration": 8.0, "materials": {"stone": stone}, "bodies": bodies}


def billiards():
    """The break: a ball at 8 m/s into a triangle of fifteen."""
    r, length, width = 0.028575, 1.27, 0.635
    # A cushion touches balls above their middle, so that they do not climb it.
    cushion, nose, y = 0.025, 0.01, 0.635 * 2 * r + 0.01
    rails = []
    for name, x, z, half in (
        ("head", -length - cushion, 0.0, (cushion, nose, width + 2 * cushion)),
        ("foot", length + cushion, 0.0, (cushion, nose, width + 2 * cushion)),
        ("left", 0.0, -width - cushion, (length, nose, cushion)),
        ("right", 0.0, width + cushion, (length, nose, cushion)),
    ):
        rails.append({"name": f"{name} rail", "motion": "static", "material": "rail",
                      "position": [x, y, z], "shapes": [box(*half)]})
    ball = {"type": "sphere", "radius": r}
    balls = [{"name": "cue", "material": "ball", "position": [-0.6, r, 0.01],
              "linear_velocity": [8.0, 0.0, 0.0], "shapes": [ball]}]
    for row in range(5):
        for k in range(row + 1):
            balls.append({"name": f"ball {len(balls)}", "material": "ball", "shapes": [ball],
                          "position": [0.6 + row * 2 * r * math.cos(math.pi / 6), r,
                                       (k - row / 2) * 2 * r]})
    materials = {"ball": {"density": 1700.0, "friction": 0.1, "restitution": 0.95},
                 "rail": {"friction": 0.1, "restitution": 0.75},
                 "cloth": {"friction": 0.2}}
    bed = floor(material="cloth")
    return {"name": "billiards", "duration": 6.0, "time_step": 0.008, "materials": materials,
            "bodies": [bed, *rails, *balls]}


def dominoes():
    """A spiral of dominoes; a ball starts it."""
    thick, tall, wide, gap = 0.004, 0.024, 0.012, 0.021
    bodies, angle = [floor()], 0.0
    radius = lambda a: 0.12 + 0.03 * a / (2 * math.pi) * 1.6
    while radius(angle) < 0.27:
        r = radius(angle)
        bodies.append({"material": "domino", "position": [r * math.cos(angle), tall,
                                                          r * math.sin(angle)],
                       "rotation": turn([0, 1, 0], -angle), "shapes": [box(wide, tall, thick)]})
        angle += gap / r
    last = bodies[-1]["position"]
    away = [-math.sin(angle), math.cos(angle)]
    size = 0.014
    bodies.append({"name": "ball", "density": 2500.0,
                   "position": [last[0] + 0.06 * away[0], size, last[2] + 0.06 * away[1]],
                   "linear_velocity": [-0.9 * away[0], 0.0, -0.9 * away[1]],
                   "angular_velocity": [-0.9 * away[1] / size, 0.0, 0.9 * away[0] / size],
                   "shapes": [{"type": "sphere", "radius": size}]})
    material = {"density": 1200.0, "friction": 0.4}
    return {"name": "dominoes", "duration": 7.0, "materials": {"domino": material},
            "bodies": bodies}


def wall_2d():
    """A wall of bricks in the plane, and a disk that hits it."""
    half = [0.3, 0.15]
    bodies = [floor(2)]
    for row in range(10):
        y = half[1] * (2 * row + 1)
        halves = row % 2 == 1
        for k in range(5 + halves):
            small = halves and k in (0, 5)
            x = (k - 2) * 2 * half[0] - (half[0] if halves else 0.0)
            x += (half[0] / 2 if k == 0 else -half[0] / 2) if small else 0.0
            shape = box(half[0] / 2 if small else half[0], half[1])
            bodies.append({"material": "brick", "position": [x, y], "shapes": [shape]})
    bodies.append({"name": "ball", "density": 4000.0, "position": [-6.0, 1.2],
                   "linear_velocity": [9.0, 3.0],
                   "shapes": [{"type": "sphere", "radius": 0.35}]})
    brick = {"density": 1900.0, "friction": 0.6}
    return {"name": "wall in 2D", "dimension": 2, "duration": 6.0, "materials": {"brick": brick},
            "bodies": bodies}


def particles():
    """Grains without friction or spin fall between four walls."""
    random = Random(7)
    planes = [("floor", [0, 0, 0], [0, 1, 0]), ("left", [-0.5, 0, 0], [1, 0, 0]),
              ("right", [0.5, 0, 0], [-1, 0, 0]), ("back", [0, 0, -0.5], [0, 0, 1]),
              ("front", [0, 0, 0.5], [0, 0, -1])]
    bodies = [{"name": name, "motion": "static", "position": place,
               "shapes": [{"type": "halfspace", "normal": normal}]}
              for name, place, normal in planes]
    for i in range(600):
        x, y, z = i % 6, i // 36, i // 6 % 6
        jitter = [random.between(-0.02, 0.02) for _ in range(3)]
        place = [(n - 2.5) * 0.15 + j for n, j in zip((x, y, z), jitter)]
        place[1] += 0.7
        bodies.append({"position": place, "restitution": 0.3,
                       "shapes": [{"type": "sphere", "radius": random.between(0.03, 0.05)}]})
    return {"name": "particles", "bodies_as": "particles", "duration": 5.0, "bodies": bodies}


# Files

SCENES = {
    "arch.json": arch, "billiards.toml": billiards, "card_house.toml": card_house,
    "dominoes.json": dominoes, "particles.json": particles, "pyramid.json": pyramid,
    "stones.json": stones, "tower.json": tower, "wall_2d.json": wall_2d, **machines.SCENES,
}


def rounded(value):
    """Six decimals are a micrometer, and the same whatever the machine's sine."""
    if isinstance(value, float):
        return round(value, 6) + 0.0
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [rounded(inner) for inner in value]
    return value


def inline(value):
    """A value as TOML on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {inline(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(inline, value)) + "]"
    return json.dumps(value)


def toml(scene, comment):
    lines = [f"# {comment}", ""]
    lines += [f"{key} = {inline(value)}" for key, value in scene.items()
              if key not in ("materials", "bodies", "joints")]
    if "materials" in scene:
        lines += ["", "[materials]"]
        lines += [f"{key} = {inline(value)}" for key, value in scene["materials"].items()]
    for kind in ("bodies", "joints"):
        for item in scene.get(kind, []):
            lines += ["", f"[[{kind}]]"]
            lines += [f"{key} = {inline(value)}" for key, value in item.items()]
    return "\n".join(lines) + "\n"


def lines_of(scene):
    """JSON with one body or joint per line."""
    lists = ("bodies", "joints")
    head = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in scene.items()
            if key not in lists]
    for kind in lists:
        if kind in scene:
            items = ",\n".join("    " + json.dumps(item) for item in scene[kind])
            head.append(f'  "{kind}": [\n{items}\n  ]')
    return "{\n" + ",\n".join(head) + "\n}\n"


def main(names):
    for name, make in SCENES.items():
        if names and not any(wanted in name for wanted in names):
            continue
        scene = rounded(make())
        text = toml(scene, make.__doc__) if name.endswith(".toml") else lines_of(scene)
        (HERE / name).write_text(text)
    if not names or "workshop" in names:
        (HERE / "workshop.gltf").write_text(workshop.gltf())


if __name__ == "__main__":
    main(sys.argv[1:])
