#!/usr/bin/env python3
"""Measures how far Coulomb's own answer is from certified velocities: python3 tools/coulomb_distance.py

The bound of a certificate with friction holds for the slip at hand, not for Coulomb's answer. This draws random
systems of particles with friction, solves each to 1e-13, stops Gauss-Seidel early on the same system, and compares
the bound of each stop with its true error. Needs the command line, built, and numpy.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
BUDGETS = (1, 2, 3, 5, 10, 20)


def by_columns(matrix):
    """A matrix as `drystone solve` reads it."""
    columns, rows = np.nonzero(matrix.T)
    starts = np.searchsorted(columns, np.arange(matrix.shape[1] + 1))
    return {"rows": matrix.shape[0], "cols": matrix.shape[1], "colptr": starts.tolist(),
            "rowidx": rows.tolist(), "values": matrix[rows, columns].tolist()}


def system(random, softness):
    """2 to 5 particles with masses from 1 to 1000 kg, 2 to 8 contacts between them or with a wall."""
    bodies, contacts = random.integers(2, 6), random.integers(2, 9)
    mass = np.repeat(10 ** random.uniform(0, 3, bodies), 3)
    jacobian = np.zeros((3 * contacts, 3 * bodies))
    for i in range(contacts):
        frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
        for body, sign in zip(random.choice(bodies + 1, 2, replace=False), (1, -1)):
            if body < bodies:
                jacobian[3 * i:3 * i + 3, 3 * body:3 * body + 3] = sign * frame
    diagonal = np.einsum("ij,ij,j->i", jacobian, jacobian, 1 / mass)
    problem = {"name": "random", "dim": 3, "M": by_columns(np.diag(mass)), "J": by_columns(jacobian),
               "v_star": random.normal(size=3 * bodies).tolist(), "t": [0.0] * (3 * contacts),
               "eps": np.repeat(softness * diagonal[::3], 3).tolist(),
               "mu": random.uniform(0.2, 1, contacts).tolist()}
    return problem, mass, jacobian


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drystone", type=Path, default=ROOT / "target/release/drystone")
    parser.add_argument("--systems", type=int, default=600)
    options = parser.parse_args()
    random = np.random.default_rng(20261127)
    with tempfile.TemporaryDirectory() as folder:
        file, result = Path(folder) / "problem.json", Path(folder) / "result.json"

        def solve(*arguments):
            command = [options.drystone.resolve(), "solve", file, "-q", "-o", result, *arguments]
            subprocess.run(command, stderr=subprocess.DEVNULL)
            return json.loads(result.read_text())

        for softness in (0.01, 1 / 9):
            ratios = []
            for _ in range(options.systems):
                problem, mass, jacobian = system(random, softness)
                file.write_text(json.dumps(problem))
                exact = solve("--tolerance", "1e-13")
                if exact["residual"] > 1e-10:
                    continue
                for budget in BUDGETS:
                    stopped = solve("--method", "gauss-seidel", "--budget", str(budget))
                    error = jacobian.T @ (np.array(stopped["r"]) - exact["r"]) / mass
                    energy = error @ (mass * error)
                    if energy > 1e-18 * mass.sum():
                        ratios.append(np.sqrt(stopped["certificate"]["gap"] / energy))
            ratios = np.array(ratios)
            print(f"compliance {softness:.2f} of A_ii: {len(ratios)} stops, bound over error "
                  f"{np.median(ratios):.1f} in the median, {ratios.min():.2f} at least, "
                  f"below 1 in {np.mean(ratios < 1):.1%}")


if __name__ == "__main__":
    main()
