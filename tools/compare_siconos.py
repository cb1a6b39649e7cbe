#!/usr/bin/env python3
"""Friction problems side by side: `drystone solve` and every solver of Siconos that may succeed.

    python3 tools/compare_siconos.py FOLDER [--drystone PATH] [--tolerance 1e-8] [--rounds 3]

FOLDER holds problems as JSON: dim, nc, mu, q and W by columns (u = W r + q, normal first at each
contact). Prints a table in Markdown. Needs numpy and siconos (Debian: python3-siconos).

Each round runs Drystone and then each solver of Siconos, each in a process of its own with a time
limit, so that what else the machine does meets all alike. A process solves the problem seven times
from the start, fewer if it takes longer than a second, and states the median of the solve alone: the
first time is that of reading the program into memory. The table has medians over the rounds. Both are asked for the same tolerance. The residual is computed here, for both by the same
formula, |r - P_K(r - (u + mu |u_t| n))| / |q|: whatever a solver says of itself does not count.
"""

import argparse
import importlib.util
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

SOLVERS = {
    3: ["NSGS", "NSGSV", "NSN_AC", "NSN_FB", "NSN_NM", "ADMM", "PROX", "TFP", "ACLMFP", "SOCLCP",
        "DSFP", "EG", "FPP", "VI_EG", "VI_FPP"],
    2: ["NSGS", "CPG", "LEMKE", "ENUM"],
}
"""Of Siconos, by dimension. Left out: HP and NCPGlocker, which are no complete solvers, and PATH and
GAMS, which need programs of others."""
SWEEPS = 200_000
"""Iterations at most, of first-order methods; the time limit comes first where problems are large."""
REPEAT = 7
"""Solves in a process."""
STEPS = 5_000
"""Iterations at most, of the other methods."""
FIRST_ORDER = {"NSGS", "NSGSV", "ADMM", "DSFP", "EG", "FPP", "VI_EG", "VI_FPP", "CPG"}


def load(path):
    """The problem of a file, W as a dense array."""
    problem = json.loads(pathlib.Path(path).read_text())
    w = problem["W"]
    matrix = np.zeros((w["rows"], w["cols"]))
    for column in range(w["cols"]):
        for k in range(w["colptr"][column], w["colptr"][column + 1]):
            matrix[w["rowidx"][k], column] += w["values"][k]
    count = problem["nc"]
    mu = np.broadcast_to(np.array(problem["mu"], float), (count,))
    return problem["dim"], mu, matrix, np.array(problem["q"], float)


def project(z, mu):
    """The nearest point of the cone |z_t| <= mu z_n."""
    normal, slip = z[0], np.linalg.norm(z[1:])
    if slip <= mu * normal:
        return z
    if mu * slip <= -normal:
        return np.zeros_like(z)
    normal = (normal + mu * slip) / (1 + mu * mu)
    return np.concatenate([[normal], mu * normal / slip * z[1:]])


def residual(problem, r):
    """|r - P_K(r - (u + mu |u_t| n))| / |q|; infinite for what is no number."""
    dim, mu, matrix, q = problem
    r = np.asarray(r, float)
    if r.shape != q.shape or not np.isfinite(r).all():
        return float("inf")
    u = (matrix @ r + q).reshape(-1, dim)
    r = r.reshape(-1, dim)
    u[:, 0] += mu * np.linalg.norm(u[:, 1:], axis=1)
    error = [r_i - project(r_i - u_i, m) for r_i, u_i, m in zip(r, u, mu)]
    return float(np.linalg.norm(error) / np.linalg.norm(q))


def write_blocks(path, problem):
    """The problem in the text form of Siconos, as a sparse matrix of blocks."""
    dim, mu, matrix, q = problem
    count = len(mu)
    blocks, starts, columns = [], [0], []
    for i in range(count):
        for j in range(count):
            block = matrix[dim * i:dim * (i + 1), dim * j:dim * (j + 1)]
            if i == j or block.any():
                blocks.append(block)
                columns.append(j)
        starts.append(len(blocks))
    ends = " ".join(str(dim * (i + 1)) for i in range(count))
    lines = [dim, count, 1, f"{dim * count}\t{dim * count}", len(blocks), count, count, ends, ends,
             len(starts), len(columns), " ".join(map(str, starts)), " ".join(map(str, columns))]
    for number, block in enumerate(blocks):
        lines += [number, " ".join(f"{x:.17e}" for x in block.flatten(order="F"))]
    lines += [" ".join(f"{x:.17e}" for x in numbers) for numbers in (q, mu)]
    path.write_text("\n".join(map(str, lines)) + "\n")


def solve_with_siconos(blocks, dim, name, tolerance):
    """In a process of its own: prints r and the time in ms."""
    import siconos.numerics as sn

    problem = sn.frictionContact_new_from_filename(blocks)
    options = sn.SolverOptions(getattr(sn, f"SICONOS_FRICTION_{dim}D_{name}"))
    options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = SWEEPS if name in FIRST_ORDER else STEPS
    options.dparam[sn.SICONOS_DPARAM_TOL] = tolerance
    size = problem.dimension * problem.numberOfContacts
    driver = sn.fc3d_driver if dim == 3 else sn.fc2d_driver
    times = []
    while len(times) < REPEAT and sum(times) < 1.0:
        r, u = np.zeros(size), np.zeros(size)
        start = time.perf_counter()
        driver(problem, r, u, options)
        times.append(time.perf_counter() - start)
    print("result", json.dumps({"r": r.tolist(), "time_ms": statistics.median(times) * 1e3}))


def run(command, limit):
    """What a process prints; nothing if it takes too long."""
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=limit).stdout
    except subprocess.TimeoutExpired:
        return ""


def siconos(blocks, dim, name, arguments):
    command = [sys.executable, __file__, "--solve", str(blocks), str(dim), name,
               str(arguments.tolerance)]
    lines = run(command, arguments.limit).splitlines()
    results = [line for line in lines if line.startswith("result ")]
    return json.loads(results[0].removeprefix("result ")) if results else None


def drystone(path, folder, arguments):
    result = folder / "result.json"
    result.unlink(missing_ok=True)
    run([arguments.drystone, "solve", str(path), "--quiet", "--tolerance",
         str(arguments.tolerance), "--repeat", str(REPEAT), "-o", str(result)], arguments.limit)
    if not result.exists():
        return None
    result = json.loads(result.read_text())
    return {"r": result.get("r", result.get("z")), "time_ms": result["time_ms"],
            "method": result["method"]}


def compare(path, folder, arguments):
    """Drystone's best and, of each solver of Siconos, the median time and the residual."""
    problem = load(path)
    dim = problem[0]
    blocks = folder / "problem.dat"
    write_blocks(blocks, problem)
    ours, theirs = [], {name: [] for name in SOLVERS[dim]}
    for _ in range(arguments.rounds):
        result = drystone(path, folder, arguments)
        if result:
            ours.append((result["time_ms"], residual(problem, result["r"]), result["method"]))
        for name, results in theirs.items():
            # What has failed once, or is far too slow, is not asked again.
            if results is not None:
                result = siconos(blocks, dim, name, arguments)
                good = result and residual(problem, result["r"]) <= arguments.good
                if good:
                    results.append((result["time_ms"], residual(problem, result["r"])))
                else:
                    theirs[name] = None
    return len(problem[1]), ours, {name: results for name, results in theirs.items() if results}


def median(results):
    """The median time, and the worst residual."""
    return statistics.median(r[0] for r in results), max(r[1] for r in results)


def row(path, count, ours, theirs):
    name = path.stem
    us = median(ours) if ours else None
    mine = f"{us[0]:.3g} ms, {us[1]:.1e} (`{ours[0][2]}`)" if us else "none"
    if not theirs:
        return f"| {name} | {count} | {mine} | none of them | |"
    medians = {solver: median(results) for solver, results in theirs.items()}
    best = min(medians, key=lambda solver: medians[solver][0])
    others = f"{best} {medians[best][0]:.3g} ms, {medians[best][1]:.1e}; {len(medians)} solve it"
    ratio = f"{medians[best][0] / us[0]:.2g}" if us else ""
    return f"| {name} | {count} | {mine} | {others} | {ratio} |"


def main():
    if sys.argv[1:2] == ["--solve"]:
        blocks, dim, name, tolerance = sys.argv[2:]
        solve_with_siconos(blocks, int(dim), name, float(tolerance))
        return
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--drystone", default="target/release/drystone")
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--good", type=float, default=1e-7,
                        help="residual, computed here, up to which a solver has succeeded")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--limit", type=float, default=20.0, help="seconds for each solve")
    arguments = parser.parse_args()
    if importlib.util.find_spec("siconos") is None:
        parser.error(f"{sys.executable} has no module siconos (Debian: python3-siconos, /usr/bin/python3)")
    paths = sorted(arguments.folder.glob("*.json"))
    if not paths:
        parser.error(f"{arguments.folder}: there is no problem (*.json) in this folder")
    print("| Problem | Contacts | Drystone | Fastest of Siconos | Times as long |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for path in paths:
            print(row(path, *compare(path, pathlib.Path(folder), arguments)), flush=True)


if __name__ == "__main__":
    main()
