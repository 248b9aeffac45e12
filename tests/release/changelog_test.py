#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The changelog of Debian packages, which is made of CHANGELOG.md."""
import gzip
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TEXT = """# Changelog
What users notice.

## [Unreleased]

### Added
- A verb ([docs/verb.md](docs/verb.md)) with **much** to say, so much that the line does not end here
  but in the next one.

## [0.2.0] - 2026-02-03

The second version,
in two lines.
- One item.

## [0.1.0] - 2026-01-02

- The first.
"""


def write(text, version, folder):
    source, out = Path(folder) / "CHANGELOG.md", Path(folder) / "changelog.Debian.gz"
    source.write_text(text, encoding="utf-8")
    answer = subprocess.run([sys.executable, ROOT / "scripts/release/changelog.py", "--package", "gemsplat", "--version", version,
                             "--release", "1~bookworm", "--maintainer", "A B <a@b.org>", source, out],
                            capture_output=True, text=True, env=os.environ | {"SOURCE_DATE_EPOCH": "86400"})
    return answer, out


def changelog(text, version):
    with tempfile.TemporaryDirectory() as folder:
        answer, out = write(text, version, folder)
        if answer.returncode:
            raise AssertionError(answer.stderr)
        return gzip.decompress(out.read_bytes()).decode()


class Changelog(unittest.TestCase):
    def test_unreleased_changes_belong_to_the_version_of_the_package(self):
        entry = changelog(TEXT, "0.2.0").split("\n\ngemsplat")[0]
        self.assertEqual(entry.splitlines()[0], "gemsplat (0.2.0-1~bookworm) UNRELEASED; urgency=medium")
        self.assertIn("  [ Added ]\n  * A verb (docs/verb.md) with much to say, so much that the line does not end\n"
                      "    here but in the next one.\n", entry)
        self.assertIn("  * The second version, in two lines.\n  * One item.\n", entry)
        self.assertIn(" -- A B <a@b.org>  Fri, 02 Jan 1970 00:00:00 +0000", entry)

    def test_a_released_version_has_the_day_of_its_heading(self):
        text = TEXT.replace(TEXT[TEXT.index("### Added"):TEXT.index("## [0.2.0]")], "")
        first, second = changelog(text, "0.2.0").split("\n\ngemsplat")
        self.assertEqual(first.splitlines()[0], "gemsplat (0.2.0-1~bookworm) bookworm; urgency=medium")
        self.assertTrue(first.endswith(" -- A B <a@b.org>  Tue, 03 Feb 2026 00:00:00 +0000"), first)
        self.assertIn("(0.1.0-1~bookworm)", second)

    def test_a_version_or_a_heading_that_is_missing_is_an_error(self):
        released = TEXT.replace("### Added\n- A verb", "## [0.3.0] - 2026-03-04\n\n- A verb")
        for text, version, words in ((released, "0.4.0", "says nothing of version 0.4.0"), (TEXT + "\n## Soon\n", "0.2.0", "'## Soon'")):
            with tempfile.TemporaryDirectory() as folder:
                answer, out = write(text, version, folder)
                self.assertEqual(answer.returncode, 1)
                self.assertIn(words, answer.stderr)
                self.assertFalse(out.exists())

    def test_debian_reads_our_own(self):
        if not shutil.which("dpkg-parsechangelog"):
            self.skipTest("dpkg-parsechangelog is not installed")
        version = subprocess.run(["sed", "-n", r"s/^project(gemsplat VERSION \([0-9.]*\).*/\1/p", ROOT / "CMakeLists.txt"],
                                 capture_output=True, text=True, check=True).stdout.strip()
        text = changelog((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), version)
        self.assertLessEqual(max(map(len, text.splitlines())), 80)
        answer = subprocess.run(["dpkg-parsechangelog", "-l", "-", "--all"], input=text, capture_output=True, text=True)
        self.assertEqual((answer.returncode, answer.stderr), (0, ""))
        self.assertIn(f"Version: {version}-1~bookworm", answer.stdout)


if __name__ == "__main__":
    unittest.main()
