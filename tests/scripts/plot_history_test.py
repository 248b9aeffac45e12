# SPDX-License-Identifier: Apache-2.0
"""scripts/plot_history.py: which tables it refuses, and what it draws."""
import pathlib
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts/plot_history.py"
TABLE = (ROOT / "docs/lab/benchmarks/history.csv").read_text(encoding="utf-8")
HEADER = TABLE.split("\n", 1)[0] + "\n"
ROW = "2026-11-22T09:53,gemsplat,8224c4b,NVIDIA H200,fox_640,359x640,30000,215465,train_seconds,14.48,8,a test\n"


class PlotHistory(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.table = pathlib.Path(folder.name) / "history.csv"
        self.picture = pathlib.Path(folder.name) / "history.svg"

    def run_script(self, table, *arguments):
        self.table.write_text(table, encoding="utf-8")
        return subprocess.run(
            [sys.executable, str(SCRIPT), "--table", str(self.table), "--picture", str(self.picture), *arguments],
            capture_output=True, text=True)

    def assert_refused(self, table, reason):
        ended = self.run_script(table)
        self.assertEqual(ended.returncode, 1, ended)
        self.assertIn(reason, ended.stderr)
        self.assertFalse(self.picture.exists())

    def test_rows_that_cannot_be_right_are_refused_with_their_line(self):
        self.assert_refused(HEADER.replace("value", "figure") + ROW, "line 1: the columns")
        self.assert_refused(HEADER + ROW + ROW, "line 3: the same figure as in line 2")
        self.assert_refused(HEADER + ROW.replace("14.48", "fast"), "line 2: value 'fast'")
        self.assert_refused(HEADER + ROW.replace("14.48", "0"), "line 2: value '0'")
        self.assert_refused(HEADER + ROW.replace("train_seconds", "train_minutes"), "line 2: quantity 'train_minutes'")
        self.assert_refused(HEADER + ROW.replace("2026-11-22T09:53", "22.11.2026"), "line 2: date '22.11.2026'")
        self.assert_refused(HEADER + ROW.replace("359x640", "small"), "line 2: resolution 'small'")
        self.assert_refused(HEADER + ROW.replace("30000", "-1"), "line 2: steps '-1'")
        self.assert_refused(HEADER + ROW.replace(",a test", ""), "line 2: it has another number of fields")
        self.assert_refused(HEADER + ROW.replace("a test", ""), "line 2: source is empty")
        older = ROW.replace("2026-11-22", "2026-11-21").replace("8224c4b", "ed0c027")
        self.assert_refused(HEADER + ROW + older, "line 3: older than the row above")

    def test_the_picture_holds_each_figure_of_ours(self):
        self.assertEqual(self.run_script(HEADER + ROW).returncode, 0)
        picture = ElementTree.parse(self.picture).getroot()
        titles = [dot[0].text for dot in picture.iter("{http://www.w3.org/2000/svg}circle")]
        self.assertEqual(titles, ["8224c4b, 2026-11-22: 14.48 s"])

    def test_check_fails_where_the_picture_is_missing_or_old_and_changes_nothing(self):
        self.assertEqual(self.run_script(HEADER + ROW, "--check").returncode, 1)
        self.assertFalse(self.picture.exists())
        self.assertEqual(self.run_script(HEADER + ROW).returncode, 0)
        self.assertEqual(self.run_script(HEADER + ROW, "--check").returncode, 0)
        before = self.picture.read_text(encoding="utf-8")
        ended = self.run_script(HEADER + ROW.replace("14.48", "14.40"), "--check")
        self.assertIn("run python3 scripts/plot_history.py", ended.stderr)
        self.assertEqual(ended.returncode, 1)
        self.assertEqual(self.picture.read_text(encoding="utf-8"), before)


if __name__ == "__main__":
    unittest.main()
