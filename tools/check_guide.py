#!/usr/bin/env python3
"""Holds the guide and the other pages against the repository: python3 tools/check_guide.py

Links and pictures lead somewhere, chapters are in the summary, files and names of the code that are
mentioned exist. With --run DRYSTONE, every command of the guide that begins with `drystone` is run in
the folder of the repository, but for blocks marked norun, and a block of text after it must be in what it
says, numbers apart, unless it is marked nocheck.
Prints what is wrong; exit code 1 if anything is. Python 3.11, nothing else.
"""

import argparse
import re
import shlex
import subprocess
import sys
import unicodedata
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
GUIDE = ROOT / "guide/src"
PAGES = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md", "docs", "bench/README.md"]
FENCE = re.compile(r"^```(\S*)\n(.*?)^```$", re.M | re.S)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
PATH = re.compile(r"^(crates|scenes|guide|tools|docs|bench)/[\w./*-]+$")
NAME = re.compile(r"^[A-Za-z_]\w*(::[A-Za-z_]\w*)+$")


def anchor(heading):
    """The id that mdBook and GitHub give a heading."""
    plain = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    kept = (c for c in plain if c in " -_" or unicodedata.category(c)[0] in "LN")
    return "".join(kept).replace(" ", "-")


def prose(page):
    return FENCE.sub("", page.read_text())


def anchors(page):
    return {anchor(heading) for heading in re.findall(r"^#+ (.*)$", prose(page), re.M)}


def links(page):
    """Links of a page that lead nowhere."""
    for target in LINK.findall(prose(page)):
        if re.match(r"[a-z]+:", target):
            continue
        file, _, place = target.partition("#")
        to = (page.parent / file).resolve() if file else page
        if not to.exists():
            yield f"{target}: no such file"
        elif place and to.suffix == ".md" and place not in anchors(to):
            yield f"{target}: no such heading"


def mentions(page, words):
    """Files and names of the code in backticks that do not exist."""
    for quoted in re.findall(r"`([^`\n]+)`", prose(page)):
        if PATH.match(quoted) and not any(ROOT.glob(quoted)):
            yield f"`{quoted}`: no such file"
        if NAME.match(quoted):
            gone = [part for part in quoted.split("::") if part not in words]
            if gone:
                yield f"`{quoted}`: no {', '.join(gone)} in the code"


def summary():
    """Chapters that are not in the summary."""
    listed = {(GUIDE / target).resolve() for target in LINK.findall((GUIDE / "SUMMARY.md").read_text())}
    for page in sorted(GUIDE.rglob("*.md")):
        if page.name != "SUMMARY.md" and page.resolve() not in listed:
            yield f"{page.relative_to(ROOT)} is not in the summary"
    used = "".join(page.read_text() for page in GUIDE.rglob("*.md"))
    for drawing in sorted([*GUIDE.glob("pictures/*"), *GUIDE.glob("formulas/*")]):
        if drawing.name not in used:
            yield f"{drawing.relative_to(ROOT)} is in no chapter"


def without_numbers(text):
    return [re.sub(r"[\d.,]+(e-?\d+)?", "0", line).strip() for line in text.splitlines()]


def commands(page, drystone):
    """Commands that do not do what the page says."""
    said = []
    for info, block in FENCE.findall(page.read_text()):
        language, *options = info.split(",")
        if language == "sh" and "norun" not in options:
            code = next((int(of[5:]) for of in options if of.startswith("exit=")), 0)
            said = []
            for line in block.splitlines():
                words = shlex.split(line, comments=True)
                if words[:1] != ["drystone"]:
                    continue
                done = subprocess.run([drystone, *words[1:]], cwd=ROOT, capture_output=True, text=True)
                said += without_numbers(done.stdout + done.stderr)
                if done.returncode != code:
                    yield f"{line}: exit code {done.returncode}, not {code}: {done.stderr.strip()}"
        elif language == "text" and "nocheck" not in options:
            for line in without_numbers(block):
                if line and line not in said:
                    yield f"nothing says: {line}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--run", type=Path, metavar="DRYSTONE", help="the command line, built")
    options = parser.parse_args()
    sources = "".join(file.read_text() for file in sorted(ROOT.glob("crates/**/*.rs")))
    words = set(re.findall(r"\w+", sources))
    guide = sorted(GUIDE.rglob("*.md"))
    others = [ROOT / page for page in PAGES]
    pages = guide + [page for of in others for page in ([of] if of.is_file() else sorted(of.glob("*.md")))]
    found = list(summary())
    for page in pages:
        wrong = [*links(page), *mentions(page, words)]
        found += [f"{page.relative_to(ROOT)}: {what}" for what in wrong]
    count = 0
    if options.run:
        (ROOT / "out").mkdir(exist_ok=True)
        for page in guide:
            count += len(re.findall(r"^drystone ", page.read_text(), re.M))
            wrong = commands(page, options.run.resolve())
            found += [f"{page.relative_to(ROOT)}: {what}" for what in wrong]
    for what in found:
        print(what)
    print(f"{len(pages)} pages, {count} commands, {len(found)} problems")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
