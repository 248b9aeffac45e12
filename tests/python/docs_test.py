# SPDX-License-Identifier: Apache-2.0
"""Runs the Python of docs/reference/python.md and of docs/guide: differentiable.md, trainer.md, compat.md."""

import contextlib
import importlib.util
import io
import os
import re
import unittest

import gemsplat
from support import SOURCE, TestCase


def python_blocks(page):
    return re.findall(r"^```python\n(.*?)^```", (SOURCE / "docs" / page).read_text(), re.M | re.S)


def outputs_of(page):
    """What each program of a page prints; they run in their order."""
    names, printed = {}, []
    for block in python_blocks(page):
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(block, page, "exec"), names)
        printed.append(out.getvalue())
    return printed


class Docs(TestCase):
    def run_in_folder(self):
        os.symlink(SOURCE / "examples", self.folder / "examples")
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)

    def test_the_programs_of_the_docs_run_in_their_order(self):
        self.run_in_folder()
        printed = outputs_of("reference/python.md")
        self.assertEqual(len(printed), 5)
        self.assertRegex(printed[0], r"^20 0\.\d+ \d+\n(.*\n)+100 .*\n<gemsplat.Evaluation: .* over 5 views>\n\(90, 120, 3\) ")
        self.assertRegex(printed[1], r"^\d+ \d+\n$")
        self.assertRegex(printed[2], r"^61 True \{'step': 61, ")
        self.assertRegex(printed[3], r"^31 60 <gemsplat.Evaluation: .* over 5 views>\n\{.*'format': 'splat'.*'psnr': \d+\.")
        self.assertRegex(printed[4], r"\{'event': 'progress', .*\n5 growth\n$")
        for file in ["courtyard.ply", "after_40.ply"]:
            self.assertGreater(len(gemsplat.load(file)), 100)

    def test_the_first_program_has_ten_lines_at_most(self):
        self.assertLessEqual(len([line for line in python_blocks("reference/python.md")[0].splitlines() if line]), 10)

    def test_the_programs_of_the_guide_to_derivatives_run(self):
        arrays = ["colors", "log_scales", "logit_opacities", "means", "rotations"]
        self.assertEqual(outputs_of("guide/differentiable.md"),
                         [f"(48, 64, 3) {arrays}\n", "float32 True\n", "(48, 64, 3) True\n"])

    def test_the_programs_of_the_guide_to_trainers_run(self):
        self.run_in_folder()
        self.assertEqual(outputs_of("guide/trainer.md"), ["True True\n", "True\n"])

    @unittest.skipUnless(importlib.util.find_spec("torch"), "PyTorch is not installed")
    def test_the_program_of_the_guide_to_drop_ins_runs(self):
        import gemsplat.compat

        self.addCleanup(gemsplat.compat.uninstall)
        self.assertEqual(outputs_of("guide/compat.md"),
                         ["(1, 48, 64, 4) (1, 100, 2)\ngsplat.rasterization: 1 call by gemsplat\n"])


if __name__ == "__main__":
    unittest.main()
