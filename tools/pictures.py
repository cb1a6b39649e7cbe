#!/usr/bin/env python3
"""Draws the pictures of the guide from bakes: python3 tools/pictures.py [NAME...]

Needs the command line, built: cargo build --release. Python 3.11, nothing else.
Each picture is an SVG in guide/src/pictures; without names, all are drawn.
"""

import argparse
import json
import math
import struct
import subprocess
import sys
import tempfile
import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCENES = ROOT / "guide/scenes"
NOTES = ROOT / "scenes/notes"
INK, GREY, LINE = "#1a1a1a", "#666666", "#dddddd"
COLORS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#1a1a1a"]


# Bakes


class Bake:
    """A scene, the poses of its bodies and the report of its steps."""

    def __init__(self, drystone, path, *arguments):
        text = Path(path).read_text()
        self.scene = tomllib.loads(text) if str(path).endswith(".toml") else json.loads(text)
        self.bodies = self.scene["bodies"]
        self.stride = 7 if self.scene.get("dimension", 3) == 3 else 3
        with tempfile.TemporaryDirectory() as folder:
            poses, report = Path(folder) / "a.poses", Path(folder) / "a.json"
            command = [drystone, "bake", path, "-q", "-o", poses, "--report", report, *arguments]
            subprocess.run(command, check=True)
            numbers = poses.read_bytes()
            self.steps = json.loads(report.read_text())["per_step"]
        self.poses = struct.unpack(f"<{len(numbers) // 4}f", numbers)
        self.dt = self.scene.get("time_step", 1 / 60)

    def frames(self):
        return len(self.steps) + 1

    def pose(self, frame, body):
        start = (frame * len(self.bodies) + body) * self.stride
        return self.poses[start:start + self.stride]

    def index(self, name):
        return [body["name"] for body in self.bodies].index(name)

    def path(self, name, axis):
        """A coordinate of a body over time: (s, m)."""
        body = self.index(name)
        return [(frame * self.dt, self.pose(frame, body)[axis]) for frame in range(self.frames())]

    def over_time(self, key, factor=1.0):
        """A number of the report over time."""
        return [((i + 1) * self.dt, step[key] * factor) for i, step in enumerate(self.steps)]


def solved(drystone, scene, step):
    """The contact problem of a step and its solution."""
    with tempfile.TemporaryDirectory() as folder:
        dump, result = Path(folder) / "step.json", Path(folder) / "result.json"
        subprocess.run([drystone, "bake", scene, "-q", "--dump-step", str(step), "--dump", dump],
                       check=True)
        subprocess.run([drystone, "solve", dump, "-q", "-o", result], check=True)
        return json.loads(dump.read_text()), json.loads(result.read_text())


# Drawing


def text(x, y, words, size=13, anchor="start", color=INK, turn=None):
    turn = f' transform="rotate({turn} {x:.1f} {y:.1f})"' if turn else ""
    return (f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" '
            f'fill="{color}"{turn}>{escape(words)}</text>')


def picture(width, height, parts):
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
            f'width="{width:.0f}" height="{height:.0f}" font-family="DejaVu Sans, sans-serif">\n'
            f'<rect width="100%" height="100%" fill="white"/>\n' + "\n".join(parts) + "\n</svg>\n")


def ticks(low, high, count=5):
    """Round numbers from low to high."""
    rough = (high - low) / count
    unit = 10 ** math.floor(math.log10(rough))
    step = next(unit * m for m in (1, 2, 5, 10) if unit * m >= rough)
    first = math.ceil(low / step - 1e-9)
    return [i * step for i in range(first, math.floor(high / step + 1e-9) + 1)]


class Axes:
    """A frame with numbers along it, at a place in a picture. `log` scales y, `log_x` scales x."""

    def __init__(self, left, top, width, height, x, y, labels, log=False, log_x=False):
        self.box = (left, top, width, height)
        self.x, self.y, self.log, self.log_x = x, y, log, log_x
        self.parts = []
        for value in self.marks(x, log_x):
            at = self.across(value)
            self.parts.append(self.line([(at, top), (at, top + height)], LINE))
            self.parts.append(text(at, top + height + 18, f"{value:g}", 12, "middle"))
        for value in self.marks(y, log):
            at = self.up(value)
            self.parts.append(self.line([(left, at), (left + width, at)], LINE))
            self.parts.append(text(left - 7, at + 4, f"{value:g}".replace("e+0", "e"), 12, "end"))
        self.parts.append(f'<rect x="{left}" y="{top}" width="{width}" height="{height}" '
                          f'fill="none" stroke="{INK}"/>')
        self.parts.append(text(left + width / 2, top + height + 38, labels[0], 13, "middle"))
        self.parts.append(text(left - 48, top + height / 2, labels[1], 13, "middle", turn=-90))

    @staticmethod
    def marks(limits, log):
        if not log:
            return ticks(*limits)
        low, high = (math.log10(value) for value in limits)
        return [10.0 ** i for i in range(math.ceil(low - 1e-9), math.floor(high + 1e-9) + 1)]

    def across(self, value):
        left, _, width, _ = self.box
        low, high = self.x
        if self.log_x:
            low, high, value = (math.log10(max(v, self.x[0])) for v in (low, high, value))
        return left + width * (value - low) / (high - low)

    def up(self, value):
        _, top, _, height = self.box
        low, high = self.y
        if self.log:
            low, high, value = (math.log10(max(v, self.y[0])) for v in (low, high, value))
        return top + height * (high - value) / (high - low)

    @staticmethod
    def line(points, color, width=1.0, dash=""):
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        dash = f' stroke-dasharray="{dash}"' if dash else ""
        return (f'<polyline points="{path}" fill="none" stroke="{color}" '
                f'stroke-width="{width}"{dash}/>')

    def curve(self, points, color, dash=""):
        inside = [(self.across(x), self.up(min(max(y, self.y[0]), self.y[1]))) for x, y in points
                  if self.x[0] <= x <= self.x[1]]
        self.parts.append(self.line(inside, color, 1.8, dash))

    def dots(self, points, color):
        for x, y in points:
            self.parts.append(f'<circle cx="{self.across(x):.1f}" cy="{self.up(y):.1f}" r="4" '
                              f'fill="{color}" fill-opacity="0.7"/>')

    def legend(self, entries):
        left, top, width, _ = self.box
        for i, (words, color, dash) in enumerate(entries):
            y = top + 14 + 21 * i
            self.parts.append(self.line([(left + width + 14, y), (left + width + 38, y)], color, 2.2,
                                        dash))
            self.parts.append(text(left + width + 45, y + 4, words, 12))


def curves(series, x, y, labels, log=False, size=(760, 330), side=190, log_x=False):
    """Lines over one frame; each of series is (words, points[, dash])."""
    width, height = size
    axes = Axes(72, 16, width - 72 - side, height - 70, x, y, labels, log, log_x)
    entries = []
    for i, (words, points, *dash) in enumerate(series):
        color = COLORS[i % len(COLORS)] if not dash else GREY
        axes.curve(points, color, *dash)
        if words:
            entries.append((words, color, dash[0] if dash else ""))
    axes.legend(entries)
    return picture(width, height, axes.parts)


def outline(shape, pose):
    """A shape of the plane as SVG, in meters with y up."""
    x, y, angle = pose
    ox, oy = shape.get("position", (0, 0))
    c, s = math.cos(angle), math.sin(angle)
    at = (x + c * ox - s * oy, y + s * ox + c * oy)
    if shape["type"] == "sphere":
        r = shape["radius"]
        return (f'<circle cx="{at[0]:.4f}" cy="{at[1]:.4f}" r="{r}"/>'
                f'<path d="M{at[0]:.4f} {at[1]:.4f}L{at[0] + r * c:.4f} {at[1] + r * s:.4f}"/>')
    if shape["type"] == "box":
        w, h = shape["half_extents"]
        corners = [(w, h), (-w, h), (-w, -h), (w, -h)]
    elif shape["type"] == "convex_hull":
        corners = around(shape["points"])
    else:
        return ""
    path = " ".join(f"{at[0] + c * p - s * q:.4f},{at[1] + s * p + c * q:.4f}" for p, q in corners)
    return f'<polygon points="{path}"/>'


def around(points):
    """Points of a hull by their angle about its middle."""
    middle = [sum(p[i] for p in points) / len(points) for i in range(2)]
    return sorted(points, key=lambda p: math.atan2(p[1] - middle[1], p[0] - middle[0]))


def matrix_color(body):
    """The color of a body in `drystone matrix`."""
    chroma = 0.6 * 0.35
    hues = ((phase + body * 137.508 / 30) % 12 for phase in (0, 8, 4))
    channels = (0.65 - chroma * max(-1, min(k - 3, 9 - k, 1)) for k in hues)
    return "#" + "".join(f"{int(255 * channel):02x}" for channel in channels)


def arrow(x, y, length, scale):
    """A vertical arrow from a point, in meters."""
    tip, head = y + length, math.copysign(10 / scale, length)
    return (f'<path d="M{x:.4f} {y:.4f}V{tip - head:.4f}" stroke-width="{3 / scale:.5f}"/>'
            f'<path d="M{x:.4f} {tip:.4f}l{-5 / scale:.4f} {-head:.4f}h{10 / scale:.4f}z" '
            f'fill="{INK}"/>')


def strip(bake, frames, low, high, titles=None, scale=150, gap=14, named=False, over=None):
    """The bodies of a plane scene at some frames, side by side, within a window of meters.

    `named` writes names on bodies, in the colors of `drystone matrix`; `over` draws on a frame."""
    width, height = ((high[i] - low[i]) * scale for i in range(2))
    parts = []
    for panel, frame in enumerate(frames):
        left = gap + panel * (width + gap)
        parts.append(f'<svg x="{left:.1f}" y="30" width="{width:.1f}" height="{height:.1f}" '
                     f'viewBox="0 0 {width:.1f} {height:.1f}">')
        parts.append('<rect width="100%" height="100%" fill="#f4f4f2"/>')
        parts.append(f'<g transform="matrix({scale} 0 0 {-scale} {-low[0] * scale:.1f} '
                     f'{high[1] * scale:.1f})" stroke="{INK}" stroke-width="{1.2 / scale:.5f}" '
                     f'stroke-linejoin="round">')
        color = 0
        for body, of in enumerate(bake.bodies):
            moves = of.get("motion", "dynamic") == "dynamic"
            fill = matrix_color(body) if named else COLORS[color % 6]
            fill = fill if moves else "#b9b5ac"
            color += moves
            parts.append(f'<g fill="{fill}">')
            for shape in of["shapes"]:
                if shape["type"] == "halfspace":
                    y = bake.pose(frame, body)[1]
                    parts.append(f'<rect x="{low[0] - 1}" y="{y - 9}" width="{high[0] - low[0] + 2}" '
                                 f'height="9"/>')
                else:
                    parts.append(outline(shape, bake.pose(frame, body)))
            parts.append("</g>")
        parts.append(over(frame) if over else "")
        parts.append("</g>")
        for body, of in enumerate(bake.bodies):
            if named and of.get("motion", "dynamic") == "dynamic":
                x, y, _ = bake.pose(frame, body)
                parts.append(text((x - low[0]) * scale - 9, (high[1] - y) * scale + 5, of["name"], 13,
                                  "middle"))
        parts.append("</svg>")
        words = titles[panel] if titles else f"{frame * bake.dt:.2f} s"
        parts.append(text(left + width / 2, 20, words, 13, "middle"))
    return picture(gap + len(frames) * (width + gap), height + 30 + gap, parts)


# Pictures


def bounce(drystone):
    bake = Bake(drystone, SCENES / "bounce.toml")
    series = [(f"restitution {name}", bake.path(f"ball {name}", 1)) for name in (0.9, 0.7, 0.4)]
    series = [(words, [(t, y - 0.1) for t, y in points]) for words, points in series]
    heights = [(f"1 m times {e}² = {e * e:.2f} m", [(0, e * e), (3, e * e)], "2 3")
               for e in (0.9, 0.7, 0.4)]
    return curves(series + heights, (0, 3), (0, 1.05), ("time, s", "height of the lower side, m"),
                  side=220)


def cradle(drystone):
    """One panel for each law of impact: position over time."""
    parts = []
    for panel, law in enumerate(("reflections", "newton", "poisson")):
        scene = tomllib.loads((SCENES / "cradle.toml").read_text())
        scene["solver"] = {"impact_law": law}
        with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
            json.dump(scene, file)
            file.flush()
            bake = Bake(drystone, file.name)
        axes = Axes(72 + panel * 300, 34, 220, 230, (0, 1.2), (-0.8, 1.4),
                    ("time, s", "position, m" if panel == 0 else ""))
        for i in range(5):
            axes.curve(bake.path(f"ball {i + 1}", 0), COLORS[i])
        parts += axes.parts + [text(182 + panel * 300, 20, law, 13, "middle")]
    return picture(920, 320, parts)


def overlap(drystone):
    bake = Bake(drystone, SCENES / "overlap.toml")
    axes = Axes(72, 16, 468, 260, (0, 0.125), (0, 20), ("time, s", "overlap, mm"))
    axes.curve([(n * bake.dt, 20 * 0.8 ** n) for n in range(31)], GREY, "2 3")
    axes.dots([(t, (0.5 - y) * 1e3) for t, y in bake.path("ball", 1)], COLORS[0])
    axes.legend([("20 mm times (1 − 0.2)ⁿ", GREY, "2 3")])
    axes.parts.append(f'<circle cx="566" cy="51" r="4" fill="{COLORS[0]}" fill-opacity="0.7"/>')
    axes.parts.append(text(585, 55, "ball, after each substep", 12))
    return picture(760, 330, axes.parts)


def matrix(drystone):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "a.svg"
        command = [drystone, "matrix", NOTES / "seven.toml", "--step", "150", "-o", out]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return out.read_text()


def seven(drystone):
    bake = Bake(drystone, NOTES / "seven.toml")
    return strip(bake, [0, 18, 36, 150], (-0.85, -0.1), (0.85, 1.3), scale=130, named=True)


def pull(drystone):
    """Forces on the upper box: its weight, and one and a half times as much upward."""
    bake = Bake(drystone, NOTES / "pull.toml")
    scale, weight = 120, 0.3

    def forces(frame):
        x, y, _ = bake.pose(frame, bake.index("upper"))
        return (f'<g fill="none">{arrow(x - 0.1, y, -weight, scale)}'
                f'{arrow(x + 0.1, y, 1.5 * weight, scale)}</g>')

    return strip(bake, [0, 12, 24, 36], (-0.7, -0.15), (0.7, 2.4), scale=scale, over=forces)


def complementarity(drystone):
    dump, result = solved(drystone, ROOT / "scenes/wall_2d.json", 55)
    dim = dump["dim"]
    pushes = result["r"][::dim]
    excess = [u * 1e3 for u in result["u"][::dim]]
    axes = Axes(80, 20, 520, 280, (0, max(pushes) * 1.05), (0, max(excess) * 1.05),
                ("impulse γ, N s", "excess w, mm/s"))
    left, top, width, height = axes.box
    axes.parts.append(axes.line([(left, top), (left, top + height), (left + width, top + height)],
                                COLORS[4], 7))
    axes.parts.append(text(left + 14, top + 60, "separates: γ = 0, w ≥ 0"))
    axes.parts.append(text(left + width - 14, top + height - 14, "pushes: γ ≥ 0, w = 0", 13, "end"))
    axes.dots([(max(g, 0), max(w, 0)) for g, w in zip(pushes, excess)], COLORS[0])
    off = max(min(g / max(pushes), w / max(excess)) for g, w in zip(pushes, excess))
    sys.stderr.write(f"complementarity: {len(pushes)} contacts, farthest from the L: {off:.1e}\n")
    return picture(640, 360, axes.parts)


def methods(drystone, scene, step):
    """`drystone solve --compare --history` draws time too, which is never the same twice."""
    with tempfile.TemporaryDirectory() as folder:
        dump, out = Path(folder) / "step.json", Path(folder) / "a.svg"
        subprocess.run([drystone, "bake", scene, "-q", "--steps", str(step), "--dump-step", str(step),
                        "--dump", dump], check=True)
        subprocess.run([drystone, "solve", dump, "-q", "--compare", "--history", out], check=True)
        return out.read_text()


def convergence(drystone):
    return methods(drystone, SCENES / "heavy.toml", 1)


def arch_methods(drystone):
    return methods(drystone, ROOT / "scenes/arch.json", 60)


def jaws(drystone):
    bake = Bake(drystone, SCENES / "jaws.toml")
    return strip(bake, [0, 36, 60], (-1.0, -0.7), (1.0, 0.7), scale=120)


def stick(drystone):
    bake = Bake(drystone, SCENES / "stick.toml")
    return strip(bake, [0, 18, 24, 30, 36], (-0.75, -0.1), (0.75, 1.2), scale=110)


def heavy(drystone):
    path = SCENES / "heavy.toml"
    kinds = [("solved to 1 mm/s", []), ("32 substeps, 1 sweep", ["--tolerance", "0"]),
             ("4 substeps, 1 sweep", ["--realtime"])]
    bakes = [(words, Bake(drystone, path, *more)) for words, more in kinds]
    series = [(words, bake.over_time("deepest_penetration", 1e3)) for words, bake in bakes]
    return curves(series, (0, 3), (1e-2, 1e3), ("time, s", "deepest overlap, mm"), log=True)


def heavy_strip(drystone):
    bake = Bake(drystone, SCENES / "heavy.toml", "--realtime")
    sure = Bake(drystone, SCENES / "heavy.toml")
    titles = ["0 s", "4 substeps, 0.4 s", "4 substeps, 4 s"]
    left = strip(bake, [0, 24, 240], (-0.9, -0.1), (0.9, 2.4), titles, scale=90)
    right = strip(sure, [240], (-0.9, -0.1), (0.9, 2.4), ["solved to 1 mm/s, 4 s"], scale=90)
    inner = [left.replace("<svg ", '<svg x="0" ', 1), right.replace("<svg ", '<svg x="528" ', 1)]
    return picture(528 + 190, 269, inner)


def cost(drystone):
    """Visits grow with the contacts, entries of A faster: counted in steps of growing pyramids."""
    rows = []
    for base in (2, 4, 6, 8, 12, 16, 20):
        bodies = [{"name": "floor", "motion": "static",
                   "shapes": [{"type": "halfspace", "normal": [0, 1]}]}]
        for row in range(base):
            for i in range(base - row):
                bodies.append({"position": [1.02 * (i + row / 2), row + 0.5],
                               "shapes": [{"type": "box", "half_extents": [0.5, 0.5]}]})
        scene = {"dimension": 2, "steps": 30, "bodies": bodies}
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "pyramid.json"
            file.write_text(json.dumps(scene))
            problem, _ = solved(drystone, file, 30)
        pairs = [contact["bodies"] for contact in problem["contacts"]]
        moves = set(range(1, len(bodies)))
        meets = sum(1 for p in pairs for q in pairs if set(p) & set(q) & moves)
        rows.append((len(pairs), meets))
    most = max(rows)
    series = [("nonzero entries of A", [(k, n) for k, n in rows]),
              ("all entries, k²", [(k, k * k) for k, _ in rows], "2 3"),
              ("visits in a sweep, k", [(k, k) for k, _ in rows], "6 3")]
    return curves(series, (10, 2000), (10, 4e6), ("contacts k", ""), log=True, side=240, log_x=True)


def incline(drystone):
    bake = Bake(drystone, SCENES / "incline.toml")
    series, theory = [], []
    for mu in (0.0, 0.1, 0.2, 0.3, 0.4):
        path = bake.path(f"box {mu}", 0)
        series.append((f"friction {mu}", [(t, x - path[0][1]) for t, x in path]))
        slope = math.radians(20)
        pull = max(0.0, 9.81 * (math.sin(slope) - mu * math.cos(slope)))
        theory.append(("on paper" if mu == 0 else None,
                       [(i / 50, pull * (i / 50) ** 2 / 2) for i in range(76)], "2 3"))
    return curves(series + theory, (0, 1.5), (0, 4), ("time, s", "distance, m"))


def crank(drystone):
    bake = Bake(drystone, SCENES / "crank.toml")
    return strip(bake, [0, 10, 20, 30, 40], (-0.36, -0.36), (0.92, 0.36), scale=105)


def chain(drystone):
    bake = Bake(drystone, SCENES / "chain.toml")
    return strip(bake, [0, 30, 60, 90, 120], (-1.4, -2.6), (1.4, 0.1), scale=50)


def certified(drystone):
    """Certified errors of the arch by step."""
    path = ROOT / "scenes/arch.json"
    kinds = [("4 substeps, 1 sweep", ["--realtime"]), ("solved to 1 mm/s", []),
             ("solved to 0.1 mm/s", ["--tolerance", "0.1mm/s"])]
    series = []
    for words, more in kinds:
        bake = Bake(drystone, path, *more)
        errors = [((i + 1) * bake.dt, step["certificate"] * 1e3)
                  for i, step in enumerate(bake.steps)]
        series.append((words, errors))
    return curves(series, (0, 8), (1e-3, 1e3), ("time, s", "certified error, mm/s"), log=True)


PICTURES = [bounce, cradle, overlap, matrix, seven, pull, complementarity, convergence, arch_methods,
            jaws, stick, heavy, heavy_strip, cost, incline, crank, chain, certified]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME",
                        help=", ".join(of.__name__ for of in PICTURES))
    parser.add_argument("--drystone", type=Path, default=ROOT / "target/release/drystone")
    parser.add_argument("--out", type=Path, default=ROOT / "guide/src/pictures")
    options = parser.parse_args()
    unknown = set(options.names) - {of.__name__ for of in PICTURES}
    if unknown:
        parser.error(f"no picture {', '.join(sorted(unknown))}")
    options.out.mkdir(parents=True, exist_ok=True)
    for draw in PICTURES:
        if not options.names or draw.__name__ in options.names:
            (options.out / f"{draw.__name__}.svg").write_text(draw(options.drystone.resolve()))
            print(options.out / f"{draw.__name__}.svg")


if __name__ == "__main__":
    main()
