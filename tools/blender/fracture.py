"""Fracture: a figure of convex blocks, cut into Voronoi cells, and the neighbors among these."""

import math

from mathutils import Vector


def prism(bottom, top, low, high):
    """Returns the faces of an eight-sided block between two half sizes in x and y, at two heights."""
    def ring(half, z):
        x, y = half
        return [Vector((u * x, v * y, z)) for u, v in ((1, -0.5), (1, 0.5), (0.5, 1), (-0.5, 1), (-1, 0.5), (-1, -0.5),
                                                       (-0.5, -1), (0.5, -1))]
    a, b = ring(bottom, low), ring(top, high)
    sides = [[a[i], a[(i + 1) % 8], b[(i + 1) % 8], b[i]] for i in range(8)]
    return [a[::-1], b, *sides]


def cuboid(low, high):
    """Returns the faces of a box."""
    p = [Vector((x, y, z)) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    return [[p[k] for k in face] for face in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2),
                                              (1, 3, 7, 5))]


def cut(faces, point, normal, label):
    """Cuts a convex block, faces with labels, by a plane; keeps the side that the normal points away from."""
    kept, rim = [], []
    for mark, face in faces:
        heights = [(p - point).dot(normal) for p in face]
        if max(heights) <= 1e-6:
            kept.append((mark, face))
            continue
        if min(heights) >= -1e-6:
            continue
        new = []
        for i, (p, h) in enumerate(zip(face, heights)):
            q, k = face[(i + 1) % len(face)], heights[(i + 1) % len(face)]
            if h <= 0:
                new.append(p)
            if (h < 0 < k) or (k < 0 < h):
                crossing = p.lerp(q, h / (h - k))
                new.append(crossing)
                rim.append(crossing)
            elif h == 0:
                rim.append(p)
        kept.append((mark, new))
    if len(rim) > 2:
        middle = sum(rim, Vector()) / len(rim)
        u = normal.orthogonal().normalized()
        v = normal.cross(u)
        rim.sort(key=lambda p: math.atan2((p - middle).dot(v), (p - middle).dot(u)))
        cap = [p for i, p in enumerate(rim) if (p - rim[i - 1]).length > 1e-6]
        if len(cap) > 2:
            kept.append((label, cap))
    return kept


def area(face):
    return sum(((face[i] - face[0]).cross(face[i + 1] - face[0]) for i in range(1, len(face) - 1)), Vector()).length / 2


def volume(faces):
    return sum(face[0].dot((face[i] - face[0]).cross(face[i + 1] - face[0])) for face in faces
               for i in range(1, len(face) - 1)) / 6


def within(point, faces):
    return all((point - face[0]).dot((face[1] - face[0]).cross(face[2] - face[0])) <= 1e-6 for face in faces)


def voronoi(block, count, chance):
    """Returns seeds and cells of a convex block: faces with the index of the neighbor, or None on the outside."""
    corners = [p for face in block for p in face]
    low = [min(p[i] for p in corners) for i in range(3)]
    high = [max(p[i] for p in corners) for i in range(3)]
    seeds = []
    while len(seeds) < count:
        seed = Vector([chance.uniform(a, b) for a, b in zip(low, high)])
        if within(seed, block):
            seeds.append(seed)
    for last in (False, True):
        cells = [_cell(block, seeds, i) for i in range(count)]
        if not last:
            # One step of relaxation: no cell is a splinter.
            seeds = [(seed + _middle(cell)) / 2 for seed, cell in zip(seeds, cells)]
    return seeds, cells


def _cell(block, seeds, i):
    seed = seeds[i]
    cell = [(None, face) for face in block]
    for j in sorted(range(len(seeds)), key=lambda j: (seeds[j] - seed).length):
        if j == i:
            continue
        away = seeds[j] - seed
        reach = max((p - seed).length for _, face in cell for p in face)
        if away.length > 2 * reach:
            break
        cell = cut(cell, (seed + seeds[j]) / 2, away.normalized(), j)
    return cell


def _middle(cell):
    points = [p for _, face in cell for p in face]
    return sum(points, Vector()) / len(points)


# Parts of the statue, and the share of its cells beside their volume.
FIGURE = [
    (cuboid((-0.6, -0.6, 0), (0.6, 0.6, 0.4)), 0.35),
    (prism((0.42, 0.36), (0.27, 0.22), 0.4, 1.3), 1),
    (prism((0.27, 0.22), (0.36, 0.24), 1.3, 1.75), 1),
    (prism((0.36, 0.24), (0.36, 0.24), 1.75, 2.05), 1),
    (prism((0.11, 0.11), (0.19, 0.19), 2.05, 2.25), 2),
    (prism((0.19, 0.19), (0.12, 0.12), 2.25, 2.5), 2),
    (cuboid((0.36, -0.12, 1.15), (0.54, 0.12, 2.05)), 1.2),
    (cuboid((-0.54, -0.12, 1.75), (-0.36, 0.12, 2.75)), 1.2),
]


def broken_figure(count, chance):
    """Returns cells of the statue, faces each, and its neighbors: (a, b, place, area)."""
    sizes = [volume(block) * weight for block, weight in FIGURE]
    shares = [max(2, round(count * size / sum(sizes))) for size in sizes]
    shares[1] += count - sum(shares)
    cells, contacts, parts = [], {}, []
    for (block, _), share in zip(FIGURE, shares):
        seeds, several = voronoi(block, share, chance)
        start = len(cells)
        parts.append((block, seeds, start))
        for i, cell in enumerate(several):
            cells.append([face for _, face in cell])
            for j, face in cell:
                if j is not None and i < j:
                    contacts[start + i, start + j] = sum(face, Vector()) / len(face), area(face)
    _across(cells, parts, contacts, chance)
    return cells, [(a, b, place, size) for (a, b), (place, size) in contacts.items()]


def _across(cells, parts, contacts, chance):
    """Adds neighbors of different parts: points of a face that lie in another part."""
    for number, (_, seeds, start) in enumerate(parts):
        for i in range(len(seeds)):
            for face in cells[start + i]:
                points = [face[0].lerp(face[k], chance.random() ** 0.5).lerp(face[k + 1], chance.random())
                          for k in range(1, len(face) - 1) for _ in range(30)]
                for block, others, first in parts[number + 1:]:
                    touched = {}
                    for p in points:
                        if within(p, block):
                            j = min(range(len(others)), key=lambda j: (others[j] - p).length)
                            touched.setdefault(j, []).append(p)
                    for j, several in touched.items():
                        contacts[start + i, first + j] = (sum(several, Vector()) / len(several),
                                                          area(face) * len(several) / len(points))
