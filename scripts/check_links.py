#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the links of all Markdown files of the tree: files and headings that they name must exist.

    scripts/check_links.py            # the tree that holds this script
    scripts/check_links.py FOLDER     # another tree

Links to other sites are not followed. Prints each broken link as FILE:LINE and returns 1 if there is
any.
"""

import os
import pathlib
import re
import sys

SKIPPED_FOLDERS = {"build", "out", "node_modules", "shared"}  # and those whose name begins with a dot
LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\[\]]*\])*\]\(([^()\s]+)\)")
FENCE = re.compile(r"^\s*(```|~~~)")


def markdown_files(root):
    for folder, folders, files in os.walk(root):
        folders[:] = sorted(f for f in folders if f not in SKIPPED_FOLDERS and not f.startswith("."))
        yield from (pathlib.Path(folder) / name for name in sorted(files) if name.endswith(".md"))


def prose_lines(path):
    """Number and text of each line outside of code blocks."""
    in_code = False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if FENCE.match(line):
            in_code = not in_code
        elif not in_code:
            yield number, line


def anchor_of(heading):
    """The anchor that GitHub gives to a heading: lower case, without punctuation, spaces as hyphens."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)  # a link counts as its text
    text = re.sub(r"[^\w\- ]", "", text.strip().lower())
    return text.replace(" ", "-")


def anchors_of(path):
    anchors = set()
    for _, line in prose_lines(path):
        if match := re.match(r"#{1,6}\s+(.*?)\s*#*$", line):
            anchor, repeated = anchor_of(match[1]), 0
            while (name := anchor if repeated == 0 else f"{anchor}-{repeated}") in anchors:
                repeated += 1
            anchors.add(name)
    return anchors


def problem_of(file, target):
    """What is wrong with a link in `file`, or None."""
    if re.match(r"[a-z]+:", target):
        return None
    name, _, anchor = target.partition("#")
    path = file.parent / name if name else file
    if not path.exists():
        return f"there is no {name}"
    if anchor and path.suffix == ".md" and anchor not in anchors_of(path):
        return f"{name or file.name} has no heading #{anchor}"
    return None


def broken_links(root):
    for file in markdown_files(root):
        for number, line in prose_lines(file):
            for target in LINK.findall(re.sub(r"`[^`]*\]\([^`]*`", "", line)):  # code shows no links
                if problem := problem_of(file, target):
                    yield f"{file.relative_to(root)}:{number}: {problem}"


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parent.parent)
    problems = list(broken_links(root.resolve()))
    print("\n".join(problems) if problems else "all links lead somewhere")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
