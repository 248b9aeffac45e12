#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Shows that the tests of mended defects notice when a mend is gone.

Undoes one mend of mends.py after the other in the source tree, builds its test, expects it to fail,
and restores the file. The files must be as they are committed. At the end all tests are built again,
and must pass.

    tests/faults/undo_mends.py --build build/default             # all; some 40 minutes on 2 cores
    tests/faults/undo_mends.py --build build/default 3a 21       # these; 21 stands for 21a and 21b
    tests/faults/undo_mends.py --table                           # that of docs/lab/2026-11-mends.md
"""
import argparse
import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from mends import MENDS

ROOT = Path(__file__).resolve().parents[2]
TEST_SECONDS = 150  # a test that waits for ever has failed, too


def targets_of(mend):
    """The build targets: the test, and the program where the test runs it."""
    path = mend.test.split()[0]
    return [path.replace("/", "_")] + (["gemsplat"] if path.startswith("cli/") else [])


def build(folder, targets):
    ninja = subprocess.run(["ninja", "-C", folder, *targets], capture_output=True, text=True, cwd=ROOT)
    if ninja.returncode:
        print(ninja.stdout[-3000:])
    return ninja.returncode == 0


def run(folder, mend):
    """Whether the test passed, and what it said last."""
    path, name = mend.test.split()
    program = folder.resolve() / "tests" / path.replace("/", "_")
    test = subprocess.Popen([program, f"--gtest_filter={name}"], stdout=subprocess.PIPE, text=True,
                            stderr=subprocess.STDOUT, errors="replace", cwd=program.parent,
                            start_new_session=True)
    try:
        said = test.communicate(timeout=TEST_SECONDS)[0]
    except subprocess.TimeoutExpired:
        return False, f"it does not end within {TEST_SECONDS} s"
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(test.pid, signal.SIGKILL)  # and what it has started
    if "[  SKIPPED ]" in said or "0 tests from 0" in said:
        return True, "it did not run"
    if test.returncode < 0:
        return False, f"signal {-test.returncode}"
    return test.returncode == 0, next((line.strip() for line in said.splitlines() if "Failure" in line),
                                       f"exit code {test.returncode}")


def is_built_here(folder, mend):
    """Whether the build has the test: those of cuda/ need nvcc and a GPU."""
    return subprocess.run(["ninja", "-C", folder, "-t", "query", targets_of(mend)[0]],
                          capture_output=True, cwd=ROOT).returncode == 0


def is_committed(file):
    return subprocess.run(["git", "diff", "--quiet", "HEAD", "--", file], cwd=ROOT).returncode == 0


def undone(mend):
    """The text of the file without the mend."""
    text = (ROOT / mend.file).read_text()
    if text.count(mend.before) != 1:
        sys.exit(f"mend {mend.defect}: its text stands {text.count(mend.before)} times in {mend.file}")
    return text.replace(mend.before, mend.after)


def check(folder, mend):
    """Whether the test fails without the mend."""
    file = ROOT / mend.file
    mended, begin = file.read_text(), time.monotonic()
    try:
        file.write_text(undone(mend))
        is_built = build(folder, targets_of(mend))
        passed, said = run(folder, mend) if is_built else (True, "it cannot be built without the mend")
    finally:
        file.write_text(mended)
    print(f"{'FAILED' if passed else 'ok':6} {mend.defect:4} {mend.test.split()[1]}: "
          f"{'passes without the mend' if passed and said == 'exit code 0' else said} "
          f"({time.monotonic() - begin:.0f} s)", flush=True)
    return not passed


def table():
    print("| defect | without the mend | test | mend |\n|---|---|---|---|")
    for mend in MENDS:
        path, name = mend.test.split()
        print(f"| {mend.defect} | {mend.what} | `{path}` {name.split('.')[1]} | {mend.commit} |")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--build", type=Path, default=Path("build/default"))
    arguments.add_argument("--table", action="store_true", help="print the table of mends and tests")
    arguments.add_argument("defects", nargs="*")
    arguments = arguments.parse_args()
    if arguments.table:
        return table()
    chosen = [mend for mend in MENDS if not arguments.defects or
              mend.defect in arguments.defects or mend.defect.rstrip("abcde") in arguments.defects]
    for mend in [mend for mend in chosen if not is_built_here(arguments.build, mend)]:
        print(f"skip   {mend.defect:4} {mend.test}: this build does not have it")
        chosen.remove(mend)
    for mend in chosen:
        undone(mend)  # before minutes are spent
        if not is_committed(mend.file):
            sys.exit(f"{mend.file} has changes; commit or undo them first")
    failures = [mend.defect for mend in chosen if not check(arguments.build, mend)]
    if not build(arguments.build, sorted({target for mend in chosen for target in targets_of(mend)})):
        sys.exit("the tests cannot be built again")
    for mend in chosen:
        passed, said = run(arguments.build, mend)
        if not passed:
            failures.append(mend.defect)
            print(f"FAILED {mend.defect}: {mend.test} fails with the mend, too: {said}")
    print(f"{len(chosen) - len(set(failures))} of {len(chosen)} tests notice that their mend is gone")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
