#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that reliability.md, the table of mends and SECURITY.md claim only what a test shows.

    scripts/check_claims.py

Each row of a table with a column "test" names a test, each promise of SECURITY.md has such a row, and
each kind of input a fuzz target. The tests exist in the sources, and the lists of fuzz targets agree.
Prints what is wrong and returns 1 if there is anything.
"""

import argparse
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("docs/develop/reliability.md", "SECURITY.md", "docs/lab/2026-11-mends.md")
TESTING = "docs/develop/testing.md"
# `folder/file_test` Name, Name and Name; also a script of tests/faults, which needs no names.
MENTION = re.compile(r"`((?:[a-z_0-9]+/)+[a-z_0-9]+_test|faults/(?:inject|kills))`"
                     r"((?:(?:,| and|\s)+(?!`)[A-Z]\w*[a-z]\w*)*)")
FAULTS = ("faults/inject", "faults/kills")  # each is one test of CTest
DEFINED = re.compile(r"^TEST(?:_[FP])?\(\s*(\w+),\s*(\w+)\)", re.M)


def mentions(text):
    """(path, names) of each test that a text names."""
    return [(path, re.findall(r"[A-Z]\w+", names)) for path, names in MENTION.findall(text)]


def tables(text):
    """The cells of each row with the names of their columns, and the row's number of line."""
    columns = None
    for number, line in enumerate(text.splitlines(), 1):
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip())[1:-1]]
        if not cells:
            columns = None
        elif columns is None:
            columns = cells
        elif not set(line) <= set("|- "):
            yield number, dict(zip(columns, cells))


def rows_without_a_test(page, text):
    for number, row in tables(text):
        if "test" not in row:
            continue
        named = mentions(row["test"])
        if not any(names or path in FAULTS for path, names in named):
            yield f"{page}:{number}: no test shows this: {' | '.join(row.values())[:90]}"


def tests_in_sources():
    """Names of tests and of their suites, by the path of their file below tests/."""
    return {file.relative_to(ROOT / "tests").with_suffix("").as_posix():
            {name for suite_and_name in DEFINED.findall(file.read_text())
             for name in suite_and_name} for file in (ROOT / "tests").rglob("*_test.cpp")}


def missing_tests(page, text, in_sources):
    for path, names in mentions(text):
        if path in FAULTS:
            continue
        if path not in in_sources:
            yield f"{page}: there is no tests/{path}.cpp"
        for name in names:
            if name not in in_sources.get(path, {name}):
                yield f"{page}: there is no test {name} in tests/{path}.cpp"


def promises_without_a_test(security, reliability):
    """Each bullet of SECURITY.md begins with its promise in bold, and has a row of that name."""
    section = security.split("## What is promised for them")[1].split("\n## ")[0]
    rows = {row["promise"] for _, row in tables(reliability) if "promise" in row}
    for promise in re.findall(r"^- \*\*(.+?)\.\*\*", re.sub(r"\n  ", " ", section), re.M):
        if promise not in rows:
            yield f"SECURITY.md promises \"{promise}\", for which {PAGES[0]} has no row"


def fuzz_targets():
    words = re.search(r"set\(fuzz_targets\s([^)]*)\)", (ROOT / "tests/CMakeLists.txt").read_text())
    return set(words.group(1).split())


def wrong_fuzz_targets(security, reliability, developing):
    targets = fuzz_targets()
    for number, row in tables(security):
        for target in re.findall(r"`(\w+)`", row.get("fuzz targets", "")):
            if target not in targets:
                yield f"SECURITY.md:{number}: there is no fuzz target {target}"
        if not re.search(r"`\w+`", row.get("fuzz targets", "`any`")):
            yield f"SECURITY.md:{number}: no fuzz target reads this"
    described = {name for _, row in tables(developing) if "reads" in row
                 for name in re.findall(r"`(\w+)`", row.get("target", ""))}
    if described != targets:
        yield f"{TESTING} describes other fuzz targets: {sorted(described ^ targets)}"
    for page, text, count in ((PAGES[0], reliability, r"the (\d+) \[fuzz targets\]"),
                              (TESTING, developing, r"has (\d+) targets for libFuzzer")):
        stated = re.search(count, re.sub(r"\s+", " ", text))
        if not stated or int(stated.group(1)) != len(targets):
            yield f"{page} does not say that there are {len(targets)} fuzz targets"
    for target in targets:
        for place in (f"tests/fuzz/{target}.cpp", f"tests/fuzz/corpus/{target}"):
            if not (ROOT / place).exists():
                yield f"there is no {place}"


def main():
    argparse.ArgumentParser(description=__doc__,
                            formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    text = {page: (ROOT / page).read_text() for page in (*PAGES, TESTING)}
    reliability, security = text[PAGES[0]], text[PAGES[1]]
    in_sources = tests_in_sources()
    wrong = []
    for page in PAGES:
        wrong += rows_without_a_test(page, text[page])
        wrong += missing_tests(page, text[page], in_sources)
    wrong += promises_without_a_test(security, reliability)
    wrong += wrong_fuzz_targets(security, reliability, text[TESTING])
    print("\n".join(wrong) or "every line of the pages names a test that exists")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
