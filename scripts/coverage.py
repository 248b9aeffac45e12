#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads what a build with GS_COVERAGE has counted, and prints the lines that ran for each library.

    scripts/coverage.py build/coverage

A line counts once, in whatever files and templates it was compiled; headers count for the library of
their folder. Lines of tests and of other people's headers are left out. The lines that did not run are
in BUILD/lines.txt.
"""

import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = ("gs_core", "gs_render", "gs_train", "gs_eval", "gs_model", "data_loaders", "gs_app", "apps")
AT_ONCE = 40  # files of one call of gcov


def counted_files(build):
    """What gcov says of each file that was compiled, whether it ran or not."""
    notes = sorted(str(path) for path in build.rglob("*.gcno")
                   if not path.relative_to(build).parts[0] == "tests")
    for i in range(0, len(notes), AT_ONCE):
        done = subprocess.run(["gcov", "--json-format", "--stdout", *notes[i:i + AT_ONCE]],
                              capture_output=True, text=True, check=True, cwd=build)
        for line in done.stdout.splitlines():
            yield from json.loads(line)["files"]


def lines_of(build):
    """How often each line ran: {file below ROOT: {line: count}}."""
    counts = defaultdict(dict)
    for file in counted_files(build):
        path = (build / file["file"]).resolve()
        if not path.is_relative_to(ROOT):
            continue
        name = path.relative_to(ROOT).as_posix()
        if name.split("/")[0] not in LIBRARIES:
            continue
        lines = counts[name]
        for line in file["lines"]:
            number = line["line_number"]
            lines[number] = lines.get(number, 0) + line["count"]
    return counts


def table(counts):
    rows = [(library, [lines for name, lines in counts.items() if name.startswith(library + "/")])
            for library in LIBRARIES]
    rows.append(("all", list(counts.values())))
    yield f"{'library':14} {'lines':>8} {'run':>8} {'share':>7}"
    for library, files in rows:
        total = sum(map(len, files))
        run = sum(count > 0 for lines in files for count in lines.values())
        yield f"{library:14} {total:8,} {run:8,} {100 * run / max(total, 1):6.1f} %"


def main():
    build = Path(sys.argv[1]).resolve()
    counts = lines_of(build)
    if not counts:
        raise SystemExit(f"nothing was counted in {build}; build and run tests there first")
    with open(build / "lines.txt", "w") as report:
        for name, lines in sorted(counts.items()):
            silent = [number for number, count in sorted(lines.items()) if count == 0]
            report.write(f"{name}: {len(lines) - len(silent)} of {len(lines)}; not run: "
                         f"{' '.join(map(str, silent)) or 'none'}\n")
    print("\n".join(table(counts)))


if __name__ == "__main__":
    main()
