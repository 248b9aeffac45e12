# SPDX-License-Identifier: Apache-2.0
"""Runs the Python of docs/reference/python.md, and compares the type stubs with the module."""

import ast
import contextlib
import inspect
import io
import os
import re
import unittest

import gemsplat
from support import SOURCE, TestCase


def python_blocks():
    page = SOURCE / "docs" / "reference" / "python.md"
    return re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)


class Docs(TestCase):
    def test_the_programs_of_the_docs_run_in_their_order(self):
        os.symlink(SOURCE / "examples", self.folder / "examples")
        before = os.getcwd()
        self.addCleanup(os.chdir, before)
        os.chdir(self.folder)
        blocks = python_blocks()
        self.assertEqual(len(blocks), 4)
        names = {}
        printed = []
        for block in blocks:
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(block, "docs/reference/python.md", "exec"), names)
            printed.append(out.getvalue())
        self.assertRegex(printed[0], r"^20 0\.\d+ \d+\n(.*\n)+100 .*\n<gemsplat.Evaluation: .* over 5 views>\n\(90, 120, 3\) ")
        self.assertRegex(printed[1], r"^\d+ \d+\n$")
        self.assertRegex(printed[2], r"^61 True \{'step': 61, ")
        self.assertRegex(printed[3], r"^31 60 <gemsplat.Evaluation: .* over 5 views>\n\{.*'format': 'splat'.*'psnr': \d+\.")
        for file in ["courtyard.ply", "after_40.ply"]:
            self.assertGreater(len(gemsplat.load(file)), 100)

    def test_the_first_program_has_ten_lines_at_most(self):
        self.assertLessEqual(len([line for line in python_blocks()[0].splitlines() if line]), 10)


class Stubs(TestCase):
    @classmethod
    def setUpClass(cls):
        cls.tree = ast.parse((SOURCE / "apps" / "python" / "gemsplat" / "__init__.pyi").read_text())

    def test_every_name_of_the_module_is_in_the_stubs_and_no_other(self):
        stated = {node.name for node in self.tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))
                  if not node.name.startswith("_")} | {"__version__"}
        self.assertEqual(stated, set(gemsplat.__all__))

    def test_classes_have_the_members_that_the_stubs_state(self):
        for node in self.tree.body:
            if not isinstance(node, ast.ClassDef) or node.name.startswith("_"):
                continue
            stated = {item.name for item in node.body if isinstance(item, ast.FunctionDef)} - {"__init__"}
            found = {name for name in vars(getattr(gemsplat, node.name)) if not name.startswith("_")}
            self.assertEqual({name for name in stated if not name.startswith("_")}, found, node.name)

    def test_functions_take_the_arguments_that_the_stubs_state(self):
        for node in self.tree.body:
            if not isinstance(node, ast.FunctionDef):
                continue
            first_line = getattr(gemsplat, node.name).__doc__.splitlines()[0]
            found = re.findall(r"(\w+): ", first_line.split("->")[0])
            stated = [a.arg for a in node.args.args + node.args.kwonlyargs]
            self.assertEqual(found, stated, node.name)

    def test_everything_has_a_docstring(self):
        for name in gemsplat.__all__:
            if name != "__version__":
                self.assertTrue(inspect.getdoc(getattr(gemsplat, name)), name)
        self.assertRegex(gemsplat.__version__, r"^\d+\.\d+\.\d+$")


if __name__ == "__main__":
    unittest.main()
