"""Five scenes as artists build them, through Blender's own API: wall, bowl, statue, dominoes and habits.

Each builder makes a new scene and returns a `Stage`: what a judge has to know of it. Sizes are arguments.
"""

import math
import random
from dataclasses import dataclass, field

import bpy
from mathutils import Matrix, Vector

from fracture import broken_figure, volume
from meshes import ball_mesh, box_mesh, lathe, mesh_of, mug_mesh, primitive, ring_mesh

FPS = 24


@dataclass
class Stage:
    """A scene for the judge: convex pieces of shapes, and the bodies that should stand and rest."""

    # Convex pieces by name: points in the frame of the mesh. Objects that are missing are convex themselves.
    pieces: dict = field(default_factory=dict)
    # Radii of spheres by name. [m]
    spheres: dict = field(default_factory=dict)
    # Names of the bodies that should keep their pose, and how far they may be from it. [m], [rad]
    stands: list = field(default_factory=list)
    tolerance: tuple = (0.05, 0.1)
    # Lowest and highest corner of the space that bodies should stay in, instead of a pose.
    inside: tuple | None = None
    # Names of the bodies that should rest in the last second.
    rests: list = field(default_factory=list)
    # Names of the objects that carry bodies: these should stand relative to them.
    carriers: dict = field(default_factory=dict)
    # Force that breaks a glue. [N]
    glue_force: float = 0.0
    # Frame of the picture; place of the camera, its target and its focal length [mm].
    action: int = 60
    view: tuple = ((8, -12, 6), (0, 0, 1), 40)


# Making objects


def begin(name, last, first=1):
    """Makes an empty scene with a rigid body world, from a first to a last frame."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = name
    scene.render.fps, scene.frame_start, scene.frame_end = FPS, first, last
    bpy.ops.rigidbody.world_add()
    world = scene.rigidbody_world
    world.collection = bpy.data.collections.new("RigidBodyWorld")
    world.constraints = bpy.data.collections.new("RigidBodyConstraints")
    world.point_cache.frame_start, world.point_cache.frame_end = first, last
    scene.frame_set(first)
    return scene


def put(name, mesh, place, kind="ACTIVE", shape="BOX", rotation=(0, 0, 0), color=(0.8, 0.8, 0.8), scale=(1, 1, 1),
        collection=None, **more):
    """Adds an object with a rigid body."""
    scene = bpy.context.scene
    thing = bpy.data.objects.new(name, mesh)
    thing.location, thing.rotation_euler, thing.scale = place, rotation, scale
    thing.color = (*color, 1)
    (collection or scene.collection).objects.link(thing)
    # Blender makes the rigid body of an object that it finds in this collection.
    scene.rigidbody_world.collection.objects.link(thing)
    of = thing.rigid_body
    of.type, of.collision_shape = kind, shape
    for key, value in more.items():
        setattr(of, key, value)
    return thing


def constrain(name, kind, first, second, place, rotation=(0, 0, 0), **more):
    """Adds an empty with a rigid body constraint."""
    scene = bpy.context.scene
    thing = bpy.data.objects.new(name, None)
    thing.location, thing.rotation_euler, thing.empty_display_size = place, rotation, 0.05
    scene.collection.objects.link(thing)
    scene.rigidbody_world.constraints.objects.link(thing)
    of = thing.rigid_body_constraint
    of.type, of.object1, of.object2, of.disable_collisions = kind, first, second, True
    for key, value in more.items():
        setattr(of, key, value)
    return thing


def ground(size=40, color=(0.5, 0.5, 0.5)):
    return put("ground", box_mesh("ground", (size, size, 1)), (0, 0, -0.5), "PASSIVE", color=color, friction=0.8)


def shade(chance, color, spread=0.12):
    """Returns a color near another one."""
    part = 1 + chance.uniform(-spread, spread)
    return tuple(min(max(value * part, 0), 1) for value in color)


def released(thing, keys, free):
    """Moves an object by keys of its place, straight, and frees it at a frame."""
    thing.rigid_body.kinematic = True
    for frame, place in keys:
        thing.location = place
        thing.keyframe_insert("location", frame=frame)
    for curve in curves_of(thing):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    for frame, held in ((keys[0][0], True), (free, False)):
        thing.rigid_body.kinematic = held
        thing.keyframe_insert("rigid_body.kinematic", frame=frame)


def curves_of(thing):
    return thing.animation_data.action.layers[0].strips[0].channelbags[0].fcurves


def names_of(things):
    return [thing.name for thing in things]


# Wall


def wall(columns=30, rows=10, links=6, last=144):
    """A wall of bricks, and a heavy ball on light links that swings into its middle.

    The outer fifth of the bricks on both sides should stand.
    """
    begin("wall", last)
    chance = random.Random(1)
    ground(color=(0.42, 0.42, 0.44))
    length, depth, height = 0.4, 0.2, 0.2
    whole, half = box_mesh("brick", (length, depth, height)), box_mesh("half", (length / 2, depth, height))
    outer = []
    for row in range(rows):
        # Rows with an odd number begin and end with half a brick.
        count = columns + row % 2
        for column in range(count):
            x = (column - (count - 1) / 2) * length
            at_end = row % 2 and column in (0, count - 1)
            x -= math.copysign(length / 4, x) if at_end else 0
            brick = put(f"brick {row:02} {column:02}", half if at_end else whole, (x, 0, (row + 0.5) * height),
                        mass=2 if at_end else 4, friction=0.8, color=shade(chance, (0.55, 0.16, 0.08), 0.35))
            if min(column, count - 1 - column) < columns // 5:
                outer.append(brick)
    _wrecking_ball(links, 0.6 * rows * height, depth / 2)
    names = names_of(outer)
    return Stage(spheres={"ball": 0.45}, tolerance=(0.1, 0.15), stands=names, rests=names, action=37,
                 view=((5.6, 6.6, 2.6), (0.2, 0.3, 1.2), 36))


def _wrecking_ball(links, height, face):
    """Hangs a ball of 500 kg on links of 2 kg; it swings along y, and touches a face at the bottom."""
    radius, link, angle = 0.45, 0.5, math.radians(65)
    reach = links * link + radius
    hook = Vector((0, -face - radius, height + reach))
    along = Vector((0, -math.sin(angle), -math.cos(angle)))
    turn = (-angle, 0, 0)
    crane = put("crane", box_mesh("crane", (0.3, 0.3, 0.3)), hook + Vector((0, 0, 0.15)), "PASSIVE",
                color=(0.9, 0.6, 0.05))
    mesh = box_mesh("link", (0.08, 0.08, link - 0.06))
    above = crane
    for i in range(links + 1):
        place = hook + along * (i * link)
        if i < links:
            below = put(f"link {i}", mesh, place + along * (link / 2), rotation=turn, mass=2,
                        color=(0.25, 0.25, 0.28), use_deactivation=False)
        else:
            below = put("ball", ball_mesh("ball", radius), hook + along * reach, shape="SPHERE", rotation=turn,
                        mass=500, color=(0.07, 0.07, 0.08), use_deactivation=False)
        kind = "POINT" if i % 2 else "HINGE"
        # The axis of a hinge is z: here along x of the world.
        constrain(f"pin {i}", kind, above, below, place, (0, math.pi / 2, 0))
        above = below


# Bowl


def bowl(things=200, hollow=20, last=240):
    """A bowl, a mesh that keeps its place, with convex things, mugs and rings that fall into it."""
    begin("bowl", last)
    chance = random.Random(2)
    ground(color=(0.35, 0.30, 0.26))
    radius, depth, thick, base = 1.55, 1.05, 0.12, 0.15
    profile = []
    for i in range(9):
        angle = math.pi / 2 * i / 8
        inner = (radius * math.sin(angle), base + depth * (1 - math.cos(angle)))
        outer = ((radius + thick) * math.sin(angle), base + depth - (depth + thick) * math.cos(angle))
        profile.append((inner, outer))
    points, faces, pieces = lathe(profile, 32)
    mesh = mesh_of("bowl", points, faces)
    # A margin of 0, as artists set it: things would hover by the default one of 40 mm.
    bare = {"use_margin": True, "collision_margin": 0}
    dish = put("bowl", mesh, (0, 0, 0), "PASSIVE", "MESH", color=(0.75, 0.73, 0.68), friction=0.6, **bare)
    stage = Stage(pieces={dish.name: pieces}, inside=((-radius, -radius, 0.1), (radius, radius, 3)), action=20,
                  view=((2.9, -4.1, 3.5), (0, 0, 1.2), 37))
    ops = bpy.ops.mesh
    kinds = [box_mesh("cube", (0.2, 0.2, 0.2)), box_mesh("bar", (0.36, 0.12, 0.12)),
             primitive(lambda: ops.primitive_cone_add(vertices=12, radius1=0.14, depth=0.26)),
             primitive(lambda: ops.primitive_cylinder_add(vertices=16, radius=0.11, depth=0.22)),
             primitive(lambda: ops.primitive_ico_sphere_add(subdivisions=1, radius=0.15)),
             primitive(lambda: ops.primitive_cone_add(vertices=3, radius1=0.19, depth=0.24))]
    colors = [(0.80, 0.16, 0.10), (0.92, 0.58, 0.08), (0.10, 0.42, 0.62), (0.16, 0.50, 0.26), (0.88, 0.82, 0.66),
              (0.42, 0.16, 0.42)]
    concave = [(*mug_mesh(), "mug", (0.86, 0.88, 0.90)), (*ring_mesh(), "ring", (0.75, 0.52, 0.12))]
    places, layer = [], 0
    while len(places) < things + hollow:
        spots = [(x * 0.46, y * 0.46) for x in range(-3, 4) for y in range(-3, 4)
                 if math.hypot(x * 0.46, y * 0.46) < 1.1]
        chance.shuffle(spots)
        places += [Vector((x, y, 0.95 + 0.48 * layer)) for x, y in spots]
        layer += 1
    every = (things + hollow) // max(hollow, 1)
    made = 0
    for i in range(things + hollow):
        place = places[i] + Vector((chance.uniform(-0.02, 0.02), chance.uniform(-0.02, 0.02), 0))
        turn = [chance.uniform(-math.pi, math.pi) for _ in range(3)]
        if i % every == every // 2 and made < hollow:
            mesh, pieces, noun, color = concave[made % 2]
            thing = put(f"{noun} {made}", mesh, place, shape="MESH", rotation=turn, color=color, mass=0.6, **bare)
            stage.pieces[thing.name] = pieces
            made += 1
        else:
            kind = i % len(kinds)
            thing = put(f"thing {i}", kinds[kind], place, shape="BOX" if kind < 2 else "CONVEX_HULL", rotation=turn,
                        color=shade(chance, colors[kind]), mass=1)
        stage.stands.append(thing.name)
    stage.rests = list(stage.stands)
    return stage


# Statue


def statue(count=202, glues=962, last=96):
    """A statue of convex cells that glue holds, asleep until a ball strikes it, which keys throw."""
    begin("statue", last)
    chance = random.Random(3)
    ground(color=(0.30, 0.31, 0.33))
    cells, contacts = broken_figure(count, chance)
    things = []
    for i, faces in enumerate(cells):
        middle = sum((p for face in faces for p in face), Vector()) / sum(map(len, faces))
        points = []
        for face in faces:
            for p in face:
                if all((p - q).length > 1e-6 for q in points):
                    points.append(p)
        index = [tuple(dict.fromkeys(min(range(len(points)), key=lambda k: (points[k] - p).length) for p in face))
                 for face in faces]
        mesh = mesh_of(f"cell {i}", [p - middle for p in points], [face for face in index if len(face) > 2])
        things.append(put(f"cell {i}", mesh, middle, shape="CONVEX_HULL", mass=max(500 * volume(faces), 0.05),
                          friction=0.8, color=shade(chance, (0.74, 0.70, 0.62), 0.06), use_deactivation=True,
                          use_start_deactivated=True))
    contacts.sort(key=lambda contact: -contact[3])
    force = 1200.0
    threshold = force / (FPS * bpy.context.scene.rigidbody_world.substeps_per_frame)
    for a, b, place, _ in contacts[:glues]:
        constrain(f"glue {a} {b}", "FIXED", things[a], things[b], place, use_breaking=True,
                  breaking_threshold=threshold)
    ball = put("ball", ball_mesh("ball", 0.25), (0.1, -9.5, 1.4), shape="SPHERE", mass=400, color=(0.06, 0.06, 0.07))
    # Free one frame before it touches the statue.
    released(ball, [(1, (0.1, -9.5, 1.4)), (25, (0.1, -0.75, 1.65))], 25)
    pedestal = [thing.name for thing, faces in zip(things, cells) if max(p.z for f in faces for p in f) < 0.41]
    return Stage(spheres={"ball": 0.25}, stands=pedestal, rests=pedestal, tolerance=(0.05, 0.1), glue_force=force,
                 action=30, view=((4.9, -4.8, 1.7), (0.15, 0.3, 1.4), 38))


# Dominoes


def dominoes(outer=40, inner=22, row=18, last=264):
    """Dominoes on a turntable and on a belt, both keyed. A pin topples the outer ring; the others should stand."""
    begin("dominoes", last)
    chance = random.Random(4)
    ground(color=(0.55, 0.52, 0.48))
    size, speed = (0.08, 0.2, 0.4), {"friction": 0.8}
    table = put("turntable", primitive(lambda: bpy.ops.mesh.primitive_cylinder_add(vertices=64, radius=2, depth=0.2)),
                (0, 0, 0.15), "PASSIVE", "CYLINDER", color=(0.20, 0.26, 0.32), kinematic=True, **speed)
    for frame, angle in ((1, 0), (13, 0), (last - 48, math.pi)):
        table.rotation_euler.z = angle
        table.keyframe_insert("rotation_euler", index=2, frame=frame)
    belt = put("belt", box_mesh("belt", (9, 0.6, 0.2)), (-1.5, -2.6, 0.15), "PASSIVE", color=(0.10, 0.10, 0.11),
               kinematic=True, **speed)
    for frame, x in ((1, -1.5), (13, -1.5), (last - 48, 1.5)):
        belt.location.x = x
        belt.keyframe_insert("location", index=0, frame=frame)
    mesh = box_mesh("domino", size)
    stage = Stage(tolerance=(0.03, 0.1), action=124, view=((-3.4, -5.9, 3.3), (0.1, -0.75, 0.3), 38))

    def domino(name, place, turn, carrier, color, stands):
        thing = put(name, mesh, place, rotation=(0, 0, turn), mass=0.5, color=shade(chance, color, 0.08),
                    use_deactivation=False, **speed)
        stage.carriers[thing.name] = carrier.name
        stage.rests.append(thing.name)
        if stands:
            stage.stands.append(thing.name)

    top = 0.25 + size[2] / 2
    rings = [(outer, 1.7, (0.85, 0.25, 0.10), False), (inner, 1.0, (0.93, 0.88, 0.78), True)]
    for count, radius, color, stands in rings:
        for i in range(count):
            # Room for the pin before the first one.
            angle = math.tau * (i + 0.5) / (count + (0 if stands else 3)) + math.radians(0 if stands else 14)
            domino(f"{'inner' if stands else 'outer'} {i}", (radius * math.cos(-angle), radius * math.sin(-angle), top),
                   -angle + math.pi / 2, table, color, stands)
    for i in range(row):
        domino(f"row {i}", (-1.5 + (i - (row - 1) / 2) * 0.3, -2.6, top), 0, belt, (0.10, 0.38, 0.60), True)
    put("pin", box_mesh("pin", (0.3, 0.06, 0.9)), (1.7, 0, 0.25 + 0.32 + 0.45), "PASSIVE", color=(0.9, 0.65, 0.1))
    return stage


# Habits


def habits(balls=5, wide=4, deep=2, high=5, last=340):
    """A cradle of hinges, and crates below one of 500 kg, with scales, origins and collections as they come."""
    scene = begin("habits", last, 101)
    chance = random.Random(5)
    ground(color=(0.40, 0.42, 0.40))
    outer, inner = bpy.data.collections.new("props"), bpy.data.collections.new("crates")
    scene.collection.children.link(outer)
    outer.children.link(inner)
    plain, unit = box_mesh("crate", (0.5, 0.5, 0.5)), box_mesh("unit", (1, 1, 1))
    corner, flat = box_mesh("corner", (0.5, 0.5, 0.5), corner=True), box_mesh("flat", (2, 1, 0.25))
    stage = Stage(tolerance=(0.02, 0.05), action=124, view=((-2.8, -8.6, 2.3), (-0.4, 0, 1.4), 40))
    across = (wide * 0.5, deep * 0.5)
    for i in range(wide * deep * high):
        x, y, z = i % wide, i // wide % deep, i // (wide * deep)
        place = Vector((1.4 + (x - (wide - 1) / 2) * 0.5, (y - (deep - 1) / 2) * 0.5, 0.25 + z * 0.5))
        # Linked duplicates; scales that nobody applied, some negative; origins in a corner.
        mesh, scale, shape = [(plain, (1, 1, 1), "BOX"), (unit, (0.5, 0.5, 0.5), "BOX"),
                              (unit, (-0.5, 0.5, 0.5), "BOX"), (corner, (1, 1, 1), "CONVEX_HULL"),
                              (flat, (0.25, -0.5, -2), "CONVEX_HULL")][i % 5]
        if mesh is corner:
            place -= Vector((0.25, 0.25, 0.25))
        crate = put(f"crate.{i:03}", mesh, place, shape=shape, scale=scale, collection=(inner, outer)[i % 2], mass=5,
                    friction=0.8, color=shade(chance, (0.50, 0.32, 0.15), 0.3))
        stage.stands.append(crate.name)
    heavy = put("heavy", unit, (1.4, 0, high * 0.5 + 0.4), scale=(across[0], across[1], 0.8), collection=outer,
                mass=500, friction=0.8, color=(0.18, 0.20, 0.22))
    stage.stands.append(heavy.name)
    stage.rests = list(stage.stands)
    _label("500 kg", heavy, Vector((1.4, -across[1] / 2 - 0.002, high * 0.5 + 0.4)), outer)
    _cradle(stage, balls, outer)
    return stage


def _label(text, thing, place, collection):
    """Writes on the front of an object."""
    curve = bpy.data.curves.new("label", "FONT")
    curve.body, curve.size, curve.align_x, curve.align_y = text, 0.4, "CENTER", "CENTER"
    label = bpy.data.objects.new("label", curve)
    label.parent, label.matrix_parent_inverse = thing, Matrix.LocRotScale(thing.location, None, thing.scale).inverted()
    label.location, label.rotation_euler, label.color = place, (math.pi / 2, 0, 0), (0.95, 0.75, 0.15, 1)
    collection.objects.link(label)


def _cradle(stage, balls, collection):
    """Hangs balls in a row on hinges; the first one starts raised."""
    radius, arm, height = 0.25, 1.5, 2.4
    middle = -2.1
    bar = put("bar", box_mesh("unit bar", (1, 1, 1)), (middle, 0, height + 0.05), "PASSIVE", collection=collection,
              scale=(balls * 2 * radius + 0.2, 0.1, -0.1), color=(0.25, 0.25, 0.27))
    mesh, rod = ball_mesh("bob", 1), box_mesh("rod", (0.03, 0.03, arm))
    for i in range(balls):
        x = middle + (i - (balls - 1) / 2) * 2 * radius
        angle = math.radians(45) if i == 0 else 0
        place = Vector((x - arm * math.sin(angle), 0, height - arm * math.cos(angle)))
        bob = put(f"bob {i}", mesh, place, shape="SPHERE", rotation=(0, angle, 0), scale=(radius,) * 3, mass=10,
                  restitution=0.97, friction=0, linear_damping=0, angular_damping=0, use_deactivation=False,
                  collection=collection, color=(0.75, 0.76, 0.78))
        stage.spheres[bob.name] = radius
        # The axis of a hinge is z: here along y of the world.
        constrain(f"hinge {i}", "HINGE", bar, bob, (x, 0, height), (math.pi / 2, 0, 0))
        wire = bpy.data.objects.new(f"wire {i}", rod)
        wire.parent, wire.color = bob, (0.3, 0.3, 0.3, 1)
        wire.matrix_parent_inverse = Matrix.Diagonal((1 / radius,) * 3).to_4x4()
        wire.location = (0, 0, arm / 2)
        collection.objects.link(wire)


SCENES = {"wall": wall, "bowl": bowl, "statue": statue, "dominoes": dominoes, "habits": habits}
# Sizes for a test.
SMALL = {"wall": {"columns": 26, "rows": 6, "last": 72}, "bowl": {"things": 10, "hollow": 2, "last": 72},
         "statue": {"count": 40, "glues": 150, "last": 60},
         "dominoes": {"outer": 12, "inner": 8, "row": 6, "last": 144},
         "habits": {"balls": 3, "wide": 2, "deep": 2, "high": 3, "last": 172}}


def build(name, small=False):
    """Builds a scene; returns its stage."""
    stage = SCENES[name](**(SMALL[name] if small else {}))
    bpy.context.view_layer.update()
    return stage
