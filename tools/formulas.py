#!/usr/bin/env python3
"""Draws the formulas of the guide as SVG, so that they read without a network.

    python3 tools/formulas.py

Reads guide/formulas.toml, writes guide/src/formulas. Needs matplotlib; the files are in the repository,
so only who changes a formula does.
"""

import tomllib
from pathlib import Path

import matplotlib
from matplotlib import pyplot

ROOT = Path(__file__).resolve().parent.parent
# The same file each time: no date, and ids that do not change.
matplotlib.rcParams["svg.hashsalt"] = "drystone"
matplotlib.rcParams["mathtext.fontset"] = "cm"


def draw(formula, path):
    figure = pyplot.figure(figsize=(0.1, 0.1), facecolor="white")
    figure.text(0, 0, formula, fontsize=17)
    figure.savefig(path, format="svg", bbox_inches="tight", pad_inches=0.12,
                   metadata={"Date": None, "Creator": None})
    pyplot.close(figure)


def main():
    folder = ROOT / "guide/src/formulas"
    folder.mkdir(exist_ok=True)
    formulas = tomllib.loads((ROOT / "guide/formulas.toml").read_text())
    for old in folder.glob("*.svg"):
        if old.stem not in formulas:
            old.unlink()
    for name, formula in formulas.items():
        draw(formula, folder / f"{name}.svg")
    print(f"{len(formulas)} formulas in {folder}")


if __name__ == "__main__":
    main()
