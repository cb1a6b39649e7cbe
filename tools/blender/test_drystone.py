#!/usr/bin/env python3
"""Tests the add-on in Blender: python tools/blender/test_drystone.py --drystone DRYSTONE

Needs Blender as a module: pip install bpy==5.0.1 (Python 3.11). Prints what it measured; an error ends it.
Names of tests after the options run these alone.
"""

import argparse
import importlib
import inspect
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

# Modules of tests, whose functions `test_...` take the program and an empty folder.
MODULES = ["bodies", "joints", "locks", "keys", "actions", "since", "drivers", "findings", "release", "running",
           "meanwhile", "here", "contacts", "pieces", "passive", "hidden", "ranges", "files", "overrides", "stages", "packaging",
           "scenes_compared"]


def tests():
    """Returns all tests, in their order in the files."""
    for name in MODULES:
        module = importlib.import_module(f"tests.{name}")
        for key, test in list(vars(module).items()):
            if key.startswith("test_") and inspect.isfunction(test):
                yield f"{name}.{key.removeprefix('test_')}", test


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drystone", type=Path, required=True)
    parser.add_argument("names", nargs="*")
    arguments = parser.parse_args()
    program = str(arguments.drystone.resolve())
    for name, test in tests():
        if arguments.names and not any(name.startswith(part) for part in arguments.names):
            continue
        start = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            test(program, Path(folder))
        print(f"{name}: passed in {time.perf_counter() - start:.1f} s", flush=True)
    print("add-on: all passed")


if __name__ == "__main__":
    main()
