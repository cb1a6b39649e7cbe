"""Cuts meshes of active objects into convex pieces, and shows these."""

import json
from pathlib import Path

from . import binary, pieces
from .applying import WAITING
from .baking import Work
from .exporting import generating
from .findings import Findings, counted
from .pieces import hash_of
from .sampling import still, with_values
from .shapes import ShapeExporter, is_closed, is_flat
from .space import simulated


def _is_cut(thing):
    """Tells whether an object is active and collides by its mesh, so that it has pieces."""
    of = thing.rigid_body
    return of.type == "ACTIVE" and of.collision_shape == "MESH"


def meshes_of(context, names=()):
    """Returns the closed meshes of objects in the frames of their bodies, and their hashes, by name.

    The objects are those of the names, else those selected, else all.
    """
    scene = context.scene
    things = [thing for thing in simulated(scene).values() if _is_cut(thing)]
    chosen = set(names) or {thing.name_full for thing in context.view_layer.objects.selected} & {
        thing.name_full for thing in things}
    things = [thing for thing in things if not chosen or thing.name_full in chosen]
    meshes, hashes = {}, {}
    with still(scene), with_values(generating(things), "show_viewport", False):
        context.view_layer.update()
        shapes = ShapeExporter(context.evaluated_depsgraph_get(), Findings())
        for thing in things:
            points, triangles = shapes.body_mesh(thing)
            if len(triangles) and not is_flat(points) and is_closed(points, triangles):
                meshes[thing.name_full] = points, triangles
                hashes[thing.name_full] = hash_of(*shapes.mesh(thing))
    return meshes, hashes


class Cutting(Work):
    """Convex pieces of the meshes of active objects, made by Drystone and shown over these."""

    def __init__(self, context, preference, options, folder, names=()):
        super().__init__(context, preference, options)
        if not binary.abilities(self.program).decompose:
            raise ValueError("This version of drystone shows no pieces: install the version of the add-on.")
        self.scene_file = Path(folder) / "pieces.scene.json"
        self.output = Path(folder) / "pieces.json"
        self.meshes, self.hashes = meshes_of(context, names)
        self.uids = {name: thing.session_uid for name, thing in simulated(context.scene).items()}
        if not self.meshes:
            raise ValueError("Pieces are of active objects of the shape Mesh with closed meshes: select some, or "
                             "none for all")

    def progress_text(self):
        return f"cuts {counted(len(self.meshes), 'object')} into pieces"

    def _run(self):
        self.scene_file.write_text(json.dumps(pieces.scene_of(self.meshes), default=float))
        self.process = binary.Program(self.program, "decompose", self.scene_file, "-o", self.output)
        while self.process.is_running():
            yield WAITING
        code, _, messages = self.process.result()
        if self.is_cancelled:
            return
        if code != 0:
            raise ValueError("; ".join(binary.said_plainly(messages)) or f"drystone ended with code {code}")
        found = pieces.read(self.output)
        for file in (self.scene_file, self.output):
            file.unlink()
        for name, mesh in found.items():
            things = {thing.session_uid: thing for thing in simulated(self.scene).values()}
            thing = things.get(self.uids[name])
            if thing:
                pieces.show(self.scene, thing, self.hashes[name], mesh["pieces"])
            yield
        count = sum(len(mesh["pieces"]) for mesh in found.values())
        worst = max(found, key=lambda name: max(found[name]["outward"], found[name]["inward"]))
        off = max(found[worst]["outward"], found[worst]["inward"])
        number = f"{counted(len(found), 'object')} as {counted(count, 'piece')}"
        self.said = [f"{number}, up to {off * 1e3:.2f} mm off: '{worst}'"]
