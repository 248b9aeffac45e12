#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the rules of the manual (CONTRIBUTING.md): a page of docs/guide begins with something to run
and has at most 120 lines; a commit hash and the name of a GPU belong in docs/lab.

    scripts/check_manual.py

Prints what is wrong as FILE:LINE and returns 1 if there is anything.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST_LINES = 120
FIRST_COMMAND = 12  # a page's first code block begins within so many lines
HASH = re.compile(r"(?<![\w./#-])(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,10}(?![\w.])")
GPU = re.compile(r"\b[AH]100\b|\bH200\b|\bRTX \d{4}\b")


def wrong_guide_pages():
    for page in sorted((ROOT / "docs/guide").glob("*.md")):
        lines = page.read_text(encoding="utf-8").splitlines()
        name = page.relative_to(ROOT)
        if len(lines) > MOST_LINES:
            yield f"{name}:{MOST_LINES + 1}: a page of the guide has at most {MOST_LINES} lines"
        if not any(line.startswith("```") for line in lines[:FIRST_COMMAND]):
            yield f"{name}:1: a page of the guide begins with something to run"


def lab_in_the_manual():
    for page in sorted((ROOT / "docs").rglob("*.md")):
        name = page.relative_to(ROOT)
        if name.parts[1] == "lab":
            continue
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
            for pattern, what in ((HASH, "a commit hash"), (GPU, "the name of a GPU")):
                found = pattern.search(re.sub(r"\]\([^)]*\)", "]", line))
                if found:
                    yield f"{name}:{number}: {what} belongs in docs/lab: {found.group(0)}"


def main():
    wrong = [*wrong_guide_pages(), *lab_in_the_manual()]
    print("\n".join(wrong) or "the manual keeps its rules")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
