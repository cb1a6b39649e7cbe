"""A toy workshop as glTF: meshes, materials, physics, a camera, a light and a swinging weight.

Bodies collide as boxes, cylinders, spheres and hulls; what one sees has round edges.
"""

import base64
import json
import math
import struct

FPS = 30
SECONDS = 8


# Meshes: lists of (position, normal), and triangles


def rounded_box(size, edge, steps=2):
    """A box whose edges are quarter circles."""
    half = [s / 2 for s in size]
    edge = min([edge, *(0.99 * h for h in half)])
    vertices, triangles = [], []

    def marks(h):
        near = [h - edge * (1 - math.tan(math.pi / 4 * i / steps)) for i in range(steps + 1)]
        return [-x for x in near[::-1]] + near

    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1, 1):
            first, across, up = len(vertices), marks(half[u]), marks(half[v])
            for y in up:
                for x in across:
                    p = [0.0, 0.0, 0.0]
                    p[axis], p[u], p[v] = sign * half[axis], x, y
                    inner = [max(-h + edge, min(h - edge, c)) for c, h in zip(p, half)]
                    n = unit([a - b for a, b in zip(p, inner)])
                    vertices.append(([a + edge * b for a, b in zip(inner, n)], n))
            w = len(across)
            for j in range(len(up) - 1):
                for i in range(w - 1):
                    a, b = first + j * w + i, first + j * w + i + 1
                    c, d = a + w, b + w
                    quad = [[a, b, d], [a, d, c]]
                    triangles += quad if sign > 0 else [t[::-1] for t in quad]
    return vertices, triangles


def lathe(profile, sides=22):
    """Turns pieces of outline about y; each piece [(radius, height), ...] is smooth in itself."""
    vertices, triangles = [], []
    for piece in profile:
        first, count = len(vertices), len(piece)
        for j, (r, y) in enumerate(piece):
            (r0, y0), (r1, y1) = piece[max(j - 1, 0)], piece[min(j + 1, count - 1)]
            out, up = unit([y1 - y0, r0 - r1])
            for i in range(sides + 1):
                c, s = math.cos(2 * math.pi * i / sides), math.sin(2 * math.pi * i / sides)
                vertices.append(([r * c, y, r * s], [out * c, up, out * s]))
        for j in range(count - 1):
            for i in range(sides):
                a = first + j * (sides + 1) + i
                b, c, d = a + 1, a + sides + 1, a + sides + 2
                triangles += [[a, c, b], [b, c, d]]
    return vertices, triangles


def sphere(radius, rings=12, sides=22):
    arc = [math.pi * (j / rings - 0.5) for j in range(rings + 1)]
    return lathe([[(radius * math.cos(a), radius * math.sin(a)) for a in arc]], sides)


def cylinder(radius, height, edge):
    h, r = height / 2, radius
    bend = [math.pi / 4 * i for i in range(3)]
    low = [(r - edge + edge * math.sin(a), -h + edge - edge * math.cos(a)) for a in bend]
    high = [(r - edge + edge * math.cos(a), h - edge + edge * math.sin(a)) for a in bend]
    return lathe([[(0, -h), (r - edge, -h)], low, [low[-1], high[0]], high, [(r - edge, h), (0, h)]])


def tube(points, radius, sides=8):
    """A pipe along points in the plane z = 0."""
    vertices, triangles = [], []
    for j, (x, y) in enumerate(points):
        (x0, y0), (x1, y1) = points[max(j - 1, 0)], points[min(j + 1, len(points) - 1)]
        tx, ty = unit([x1 - x0, y1 - y0])
        for i in range(sides + 1):
            c, s = math.cos(2 * math.pi * i / sides), math.sin(2 * math.pi * i / sides)
            n = [-ty * c, tx * c, s]
            vertices.append(([x + radius * n[0], y + radius * n[1], radius * n[2]], n))
    for j in range(len(points) - 1):
        for i in range(sides):
            a = j * (sides + 1) + i
            triangles += [[a, a + sides + 1, a + 1], [a + 1, a + sides + 1, a + sides + 2]]
    return vertices, triangles


def moved(mesh, shift):
    vertices, triangles = mesh
    return [([a + b for a, b in zip(p, shift)], n) for p, n in vertices], triangles


def unit(v):
    length = math.sqrt(sum(x * x for x in v)) or 1.0
    return [x / length for x in v]


def turn(axis, angle):
    s = math.sin(angle / 2)
    return [axis[0] * s, axis[1] * s, axis[2] * s, math.cos(angle / 2)]


def times(p, q):
    """The rotation p after q."""
    (a, b, c, d), (x, y, z, w) = p, q
    return [d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x,
            d * z + a * y - b * x + c * w, d * w - a * x - b * y - c * z]


# The document


class Document:
    """A glTF as it grows."""

    def __init__(self):
        self.data = bytearray()
        self.lists = {key: [] for key in ("accessors", "bufferViews", "meshes", "materials", "nodes")}
        self.shapes, self.surfaces, self.known = [], [], {}

    def once(self, key, make):
        if key not in self.known:
            self.known[key] = make()
        return self.known[key]

    def add(self, key, item):
        self.lists[key].append(item)
        return len(self.lists[key]) - 1

    def accessor(self, rows, form, kind, component, target=None, bounds=False):
        self.data += bytes(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data)}
        for row in rows:
            self.data += struct.pack(form, *row)
        view["byteLength"] = len(self.data) - view["byteOffset"]
        if target:
            view["target"] = target
        accessor = {"bufferView": self.add("bufferViews", view), "componentType": component,
                    "count": len(rows), "type": kind}
        if bounds:
            single = [struct.unpack(form, struct.pack(form, *row)) for row in rows]
            accessor["min"] = [min(column) for column in zip(*single)]
            accessor["max"] = [max(column) for column in zip(*single)]
        return self.add("accessors", accessor)

    def primitive(self, mesh, material):
        def store():
            vertices, triangles = mesh
            positions = [[round(x, 5) for x in p] for p, _ in vertices]
            normals = [unit([round(x, 3) for x in n]) for _, n in vertices]
            return {
                "attributes": {
                    "POSITION": self.accessor(positions, "<3f", "VEC3", 5126, 34962, True),
                    "NORMAL": self.accessor(normals, "<3f", "VEC3", 5126, 34962),
                },
                "indices": self.accessor([[i] for t in triangles for i in t], "<H", "SCALAR", 5123,
                                         34963),
            }
        shared = self.once(("primitive", repr(mesh)), store)
        return {**shared, "material": self.material(*material)}

    def mesh(self, *parts):
        """Parts are (mesh, material)."""
        return self.once(("mesh", repr(parts)), lambda: self.add(
            "meshes", {"primitives": [self.primitive(*part) for part in parts]}))

    def material(self, color, roughness=0.5, metallic=0.0):
        def linear(byte):
            x = byte / 255
            return round(x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4, 4)
        factor = [linear(byte) for byte in bytes.fromhex(color)] + [1.0]
        return self.once(("material", color, roughness, metallic), lambda: self.add("materials", {
            "pbrMetallicRoughness": {"baseColorFactor": factor, "roughnessFactor": roughness,
                                     "metallicFactor": metallic}}))

    def shape(self, kind, **sizes):
        shape = {"type": kind, kind: sizes}
        def store():
            self.shapes.append(shape)
            return len(self.shapes) - 1
        return {"shape": self.once(("shape", repr(shape)), store)}

    def surface(self, friction, restitution, slides):
        def store():
            surface = {"staticFriction": friction, "dynamicFriction": friction,
                       "restitution": restitution}
            self.surfaces.append({**surface, "frictionCombine": "minimum"} if slides else surface)
            return len(self.surfaces) - 1
        return self.once(("surface", friction, restitution, slides), store)

    def node(self, name=None, at=None, rotation=None, mesh=None, children=None, **physics):
        node = {}
        for key, value in (("name", name), ("mesh", mesh), ("children", children)):
            if value is not None:
                node[key] = value
        if at is not None:
            node["translation"] = [round(x, 6) for x in at]
        if rotation is not None:
            node["rotation"] = [round(x, 7) for x in rotation]
        if physics:
            node["extensions"] = {"KHR_physics_rigid_bodies": physics}
        return self.add("nodes", node)

    def collider(self, geometry, friction=0.5, restitution=0.1, slides=False):
        """With `slides`, its friction acts whatever it touches."""
        return {"geometry": geometry,
                "physicsMaterial": self.surface(friction, restitution, slides)}


WOOD = ("a9764a", 0.6)
DARK = ("5b4030", 0.6)
WALL = ("d9cfc0", 0.9)
STEEL = ("8d949c", 0.25, 1.0)
COLORS = ["d1495b", "edae49", "3f7cac", "66a182", "e07a3f", "7d6bb0"]
TOP = 0.75  # of the table [m]


def room(doc):
    size = [9.0, 0.2, 9.0]
    doc_floor = doc.node("floor", [0, -0.1, 0], mesh=doc.mesh((rounded_box(size, 0.01, 1), WALL)),
                         collider=doc.collider(doc.shape("box", size=size), 0.6))
    top, leg = [1.9, 0.05, 1.0], [0.07, TOP - 0.05, 0.07]
    legs = [doc.node(None, [x, leg[1] / 2 - TOP + 0.025, z],
                     mesh=doc.mesh((rounded_box(leg, 0.01, 1), DARK)),
                     collider=doc.collider(doc.shape("box", size=leg)))
            for x in (-0.85, 0.85) for z in (-0.4, 0.4)]
    table = doc.node("table", [0, TOP - 0.025, 0], mesh=doc.mesh((rounded_box(top, 0.012), WOOD)),
                     children=legs, collider=doc.collider(doc.shape("box", size=top)))
    return [doc_floor, table]


def body(doc, name, at, mesh, geometry, mass, rotation=None, friction=0.5, restitution=0.1):
    return doc.node(name, at, rotation, mesh, motion={"mass": mass},
                    collider=doc.collider(geometry, friction, restitution))


def bricks(doc):
    """A pyramid of toy bricks, with a roof."""
    nodes, side, gap = [], 0.07, 0.012
    mesh = rounded_box([side] * 3, 0.006)
    shape = doc.shape("box", size=[side] * 3)
    for layer, count in enumerate((4, 3, 2, 1)):
        for k in range(count):
            color = COLORS[(2 * layer + k) % len(COLORS)]
            z = (k - (count - 1) / 2) * (side + gap)
            nodes.append(body(doc, f"brick {layer}.{k}", [0.1, TOP + side * (layer + 0.5), z],
                              doc.mesh((mesh, (color, 0.35))), shape, 0.2))
    return nodes


def plank_tower(doc):
    """Cylinders and planks by turns."""
    nodes, h, t = [], 0.1, 0.02
    column, plank = cylinder(0.025, h, 0.004), rounded_box([0.3, t, 0.09], 0.004)
    rod = doc.shape("cylinder", height=h, radiusTop=0.025, radiusBottom=0.025)
    slab = doc.shape("box", size=[0.3, t, 0.09])
    for storey in range(3):
        y = TOP + storey * (h + t)
        for k, x in enumerate((-0.1, 0.1)):
            color = COLORS[(storey + 3 * k) % len(COLORS)]
            nodes.append(body(doc, f"column {storey}.{k}", [0.62 + x, y + h / 2, 0.1],
                              doc.mesh((column, (color, 0.35))), rod, 0.12))
        nodes.append(body(doc, f"plank {storey}", [0.62, y + h + t / 2, 0.1],
                          doc.mesh((plank, ("d8b07a", 0.5))), slab, 0.35))
    return nodes


def books(doc):
    nodes, y = [], TOP
    for k, (w, t, d, color, angle) in enumerate((
        (0.3, 0.045, 0.22, "2f5d62", 0.1), (0.27, 0.035, 0.2, "a23e48", -0.15),
        (0.24, 0.05, 0.18, "e2b33d", 0.25), (0.2, 0.025, 0.15, "3b3b58", -0.05),
    )):
        board = 0.004
        cover = rounded_box([w, board, d], 0.0015, 1)
        back = moved(rounded_box([board, t, d], 0.0015, 1), [-w / 2 + board / 2, 0, 0])
        pages = moved(rounded_box([w - 0.012, t - 2 * board, d - 0.012], 0.001, 1), [-0.003, 0, 0])
        lift = t / 2 - board / 2
        mesh = doc.mesh((moved(cover, [0, lift, 0]), (color, 0.6)),
                        (moved(cover, [0, -lift, 0]), (color, 0.6)), (back, (color, 0.6)),
                        (pages, ("f3ead7", 0.9)))
        nodes.append(body(doc, f"book {k}", [-0.62, y + t / 2, -0.18], mesh,
                          doc.shape("box", size=[w, t, d]), 600 * w * t * d, turn([0, 1, 0], angle),
                          0.6))
        y += t
    return nodes, y


def mug(doc, name, at, color, rotation=None):
    """A wall of twelve boxes, a bottom and a handle: it can be filled."""
    r, h, t, sides = 0.042, 0.095, 0.006, 12
    edge = [(r - t / 2 + t / 2 * math.cos(a), h + t / 2 * math.sin(a))
            for a in (math.pi * i / 4 for i in range(5))]
    inside, rim = r - t, edge
    outline = [[(0, 0), (r - 0.004, 0)], [(r - 0.004, 0), (r - 0.001, 0.001), (r, 0.004)],
               [(r, 0.004), (r, h)], rim, [(inside, h), (inside, 0.012)],
               [(inside, 0.012), (inside - 0.002, 0.008), (inside - 0.006, t)],
               [(inside - 0.006, t), (0, t)]]
    arc = [math.pi * (i / 12 - 0.5) for i in range(13)]
    handle = tube([(r - 0.002 + 0.03 * math.cos(a), h * 0.5 + 0.032 * math.sin(a)) for a in arc],
                  0.005)
    mesh = doc.mesh((lathe(outline, 24), (color, 0.25)), (handle, (color, 0.25)))
    width = 2 * r * math.tan(math.pi / sides)
    wall = doc.shape("box", size=[t, h, round(width, 5)])
    parts = [doc.node(None, [(r - t / 2) * math.cos(a), h / 2, -(r - t / 2) * math.sin(a)],
                      turn([0, 1, 0], a), collider=doc.collider(wall, 0.5, 0.15))
             for a in (2 * math.pi * i / sides for i in range(sides))]
    base = doc.shape("cylinder", height=t, radiusTop=r - t / 2, radiusBottom=r - t / 2)
    parts.append(doc.node(None, [0, t / 2, 0], collider=doc.collider(base, 0.5, 0.15)))
    grip = doc.shape("box", size=[0.01, 0.064, 0.01])
    parts.append(doc.node(None, [r + 0.026, h / 2, 0], collider=doc.collider(grip, 0.5, 0.15)))
    return doc.node(name, at, rotation, mesh, parts, motion={"mass": 0.3})


def train(doc, at, rotation):
    """An engine of boxes and cylinders; its wheels do not turn, but slide well."""
    red, green, black, brass = ("b3303a", 0.3), ("2f6b4f", 0.3), ("26262b", 0.4), ("c9a227", 0.3, 1.0)
    parts = []

    def part(mesh, material, place, geometry, axis=None, wheel=False):
        turned = turn(axis, math.pi / 2) if axis else None
        collider = doc.collider(geometry, 0.04 if wheel else 0.3, 0.1, wheel)
        parts.append(doc.node(None, place, turned, doc.mesh((mesh, material)), collider=collider))

    def block(size, material, place):
        part(rounded_box(size, 0.005, 1), material, place, doc.shape("box", size=size))

    def drum(radius, height, material, place, axis=None, wheel=False):
        geometry = doc.shape("cylinder", height=height, radiusTop=radius, radiusBottom=radius)
        part(cylinder(radius, height, min(0.004, height / 3)), material, place, geometry, axis,
             wheel)

    block([0.24, 0.025, 0.08], black, [0, 0.045, 0])
    block([0.08, 0.1, 0.085], red, [-0.075, 0.105, 0])
    block([0.1, 0.012, 0.1], black, [-0.075, 0.16, 0])
    drum(0.034, 0.13, green, [0.05, 0.092, 0], [0, 0, 1])
    drum(0.036, 0.012, brass, [0.118, 0.092, 0], [0, 0, 1])
    drum(0.013, 0.05, black, [0.085, 0.142, 0])
    drum(0.01, 0.026, brass, [0.03, 0.13, 0])
    for x in (-0.08, 0, 0.08):
        for z in (-0.044, 0.044):
            drum(0.03, 0.014, red, [x, 0.03, z], [1, 0, 0], True)
    return doc.node("engine", at, rotation, None, parts,
                    motion={"mass": 1.2, "linearVelocity": [1.1, 0, 0]})


def pendulum(doc):
    """A gallows behind the table, and a weight that an animation swings."""
    height, back, beam = 1.5, -0.62, 0.05
    frame = []
    for name, size, at in (
        ("post", [beam, height, beam], [0.1, height / 2, back]),
        ("arm", [beam, beam, 0.06 - back], [0.1, height, back / 2]),
    ):
        frame.append(doc.node(name, at, mesh=doc.mesh((rounded_box(size, 0.008, 1), DARK)),
                              collider=doc.collider(doc.shape("box", size=size))))
    rope, radius = height - TOP - 0.17, 0.075
    ball = doc.node(None, [0, -rope, 0], mesh=doc.mesh((sphere(radius), STEEL)),
                    collider=doc.collider(doc.shape("sphere", radius=radius), 0.4, 0.2))
    cord = doc.node(None, [0, -rope / 2, 0], mesh=doc.mesh((cylinder(0.006, rope, 0.001), WALL)))
    weight = doc.node("weight", [0.1, height, 0], swing(0), None, [ball, cord],
                      motion={"isKinematic": True})
    return [*frame, weight], weight


def swing(time):
    """Held aside for a second, then a swing that dies down."""
    start, rate = math.radians(-68), math.sqrt(9.81 / 0.63)
    t = max(time - 1.0, 0.0)
    return turn([0, 0, 1], start * math.cos(rate * t) * math.exp(-0.35 * t))


def animation(doc, node):
    keys = [i / FPS for i in range(FPS * SECONDS + 1)]
    turns = [[round(x, 6) for x in swing(t)] for t in keys]
    return {"name": "swing", "channels": [
        {"sampler": 0, "target": {"node": node, "path": "rotation"}}], "samplers": [{
            "input": doc.accessor([[t] for t in keys], "<f", "SCALAR", 5126, None, True),
            "output": doc.accessor([unit(q) for q in turns], "<4f", "VEC4", 5126),
            "interpolation": "LINEAR"}]}


def look(eye, target):
    """Rotation of a camera at `eye`."""
    x, y, z = (b - a for a, b in zip(eye, target))
    yaw, pitch = math.atan2(-x, -z), math.atan2(y, math.hypot(x, z))
    return times(turn([0, 1, 0], yaw), turn([1, 0, 0], pitch))


def gltf():
    """The document, its data embedded."""
    doc = Document()
    roots = room(doc) + bricks(doc) + plank_tower(doc)
    stack, y = books(doc)
    roots += stack
    roots.append(mug(doc, "red mug", [-0.62, y, -0.18], "c8553d", turn([0, 1, 0], -0.6)))
    roots.append(mug(doc, "blue mug", [0.35, TOP, 0.34], "3d6b8c", turn([0, 1, 0], 0.9)))
    roots.append(mug(doc, "white mug", [0.62, TOP + 0.36, 0.1], "f2efe6", turn([0, 1, 0], 2.2)))
    roots.append(train(doc, [-0.75, TOP, 0.3], None))
    marble = doc.shape("sphere", radius=0.016)
    for k in range(5):
        color = COLORS[k % len(COLORS)]
        place = [0.35 + 0.008 * (k % 2), TOP + 0.14 + 0.06 * k, 0.34 - 0.006 * (k % 3)]
        roots.append(body(doc, f"marble {k}", place, doc.mesh((sphere(0.016, 6, 12), (color, 0.1))),
                          marble, 0.04, None, 0.3, 0.5))
    swinging, weight = pendulum(doc)
    roots += swinging
    eye, target = [1.3, 1.5, 2.0], [0.03, 0.86, 0.02]
    roots.append(doc.add("nodes", {"name": "camera", "camera": 0, "translation": eye,
                                   "rotation": [round(x, 7) for x in look(eye, target)]}))
    sun = look([2.5, 4.0, 1.8], [0, 0, 0])
    roots.append(doc.add("nodes", {"name": "sun", "translation": [2.5, 4.0, 1.8],
                                   "rotation": [round(x, 7) for x in sun],
                                   "extensions": {"KHR_lights_punctual": {"light": 0}}}))
    clip = animation(doc, weight)
    uri = "data:application/octet-stream;base64," + base64.b64encode(doc.data).decode()
    light = {"name": "sun", "type": "directional", "intensity": 3.0, "color": [1.0, 0.95, 0.87]}
    document = {
        "asset": {"version": "2.0", "generator": "scenes/make.py"},
        "extensionsUsed": ["KHR_implicit_shapes", "KHR_physics_rigid_bodies",
                           "KHR_lights_punctual"],
        "extensions": {
            "KHR_implicit_shapes": {"shapes": doc.shapes},
            "KHR_physics_rigid_bodies": {"physicsMaterials": doc.surfaces},
            "KHR_lights_punctual": {"lights": [light]},
        },
        "scene": 0,
        "scenes": [{"name": "workshop", "nodes": roots}],
        "cameras": [{"type": "perspective", "perspective": {
            "yfov": 0.6, "aspectRatio": round(16 / 9, 6), "znear": 0.05, "zfar": 60.0}}],
        "animations": [clip],
        **doc.lists,
        "buffers": [{"byteLength": len(doc.data), "uri": uri}],
    }
    return json.dumps(document, separators=(",", ":")) + "\n"
