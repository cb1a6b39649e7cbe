#!/usr/bin/env python3
"""Packs the add-on as an extension of Blender: python tools/blender/package.py --binary DRYSTONE -o OUT.zip

The program is packed too, for one platform. Without --binary the package is for all platforms, and the
program has to be installed. Needs Python 3.11.
"""

import argparse
import platform
import tomllib
import zipfile
from pathlib import Path

SOURCE = Path(__file__).resolve().parent / "drystone"
ROOT = SOURCE.parents[2]
# Blender's names of platforms.
SYSTEMS = {"Linux": "linux", "Darwin": "macos", "Windows": "windows"}
MACHINES = {"x86_64": "x64", "AMD64": "x64", "arm64": "arm64", "aarch64": "arm64"}


def this_platform():
    return f"{SYSTEMS[platform.system()]}-{MACHINES[platform.machine()]}"


def manifest_for(platform_name):
    """Returns the manifest, for one platform or for all."""
    text = (SOURCE / "blender_manifest.toml").read_text()
    if platform_name:
        first, rest = text.split("\n[", 1)
        text = f'{first}platforms = ["{platform_name}"]\n\n[{rest}'
    tomllib.loads(text)
    return text


def pack(output, binary=None, platform_name=None):
    """Writes the package; files lie at its top, as Blender wants it."""
    output.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("blender_manifest.toml", manifest_for(platform_name if binary else None))
        for path in sorted(SOURCE.glob("*.py")):
            archive.write(path, path.name)
        for license in sorted(ROOT.glob("LICENSE-*")):
            archive.write(license, license.name)
        if binary:
            name = "drystone.exe" if platform_name.startswith("windows") else "drystone"
            archive.write(binary, f"bin/{name}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", type=Path, help="program to pack, best built without debug information")
    parser.add_argument("--platform", default=this_platform(), help="platform of the program [%(default)s]")
    parser.add_argument("-o", "--output", type=Path, help="[out/drystone-blender-PLATFORM.zip]")
    arguments = parser.parse_args()
    suffix = f"-{arguments.platform}" if arguments.binary else ""
    output = arguments.output or Path(f"out/drystone-blender{suffix}.zip")
    pack(output, arguments.binary, arguments.platform)
    print(f"wrote {output} ({output.stat().st_size / 1e6:.1f} MB)")


if __name__ == "__main__":
    main()
