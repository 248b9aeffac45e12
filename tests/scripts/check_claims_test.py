#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""scripts/check_claims.py notices a claim without a test, and a test that is not there."""

import sys
import unittest
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import check_claims  # noqa: E402

TABLE = "| what | test |\n|---|---|\n| a kill | %s |\n"


class CheckClaims(unittest.TestCase):
    def test_a_row_needs_a_test_by_name(self):
        for cell in ("", "the lines above", "`cli/files_test`"):
            wrong = list(check_claims.rows_without_a_test("page", TABLE % cell))
            self.assertEqual(len(wrong), 1, cell)
        for cell in ("`cli/files_test` TwoWritersOfOneFileAreRefused", "`faults/kills`"):
            self.assertEqual(list(check_claims.rows_without_a_test("page", TABLE % cell)), [])

    def test_names_go_with_the_file_before_them(self):
        text = "(`a/b_test` First, Second and\nThird, `c/d_test` Fourth)"
        self.assertEqual(check_claims.mentions(text),
                         [("a/b_test", ["First", "Second", "Third"]), ("c/d_test", ["Fourth"])])

    def test_a_test_that_is_not_in_the_sources_is_named(self):
        sources = {"cli/files_test": {"Files", "ATest"}}
        text = "`cli/files_test` ATest, AnotherTest, `cli/gone_test` Other"
        wrong = list(check_claims.missing_tests("page", text, sources))
        self.assertEqual(len(wrong), 2)
        self.assertIn("AnotherTest", wrong[0])
        self.assertIn("cli/gone_test", wrong[1])

    def test_each_promise_needs_a_row(self):
        security = "## What is promised for them\n\n- **No shell.** a\n- **No paths out\n  of it.** b\n"
        rows = "| promise | test |\n|---|---|\n| No shell | `a/b_test` First |\n"
        wrong = list(check_claims.promises_without_a_test(security, rows))
        self.assertEqual(len(wrong), 1)
        self.assertIn("No paths out of it", wrong[0])


if __name__ == "__main__":
    unittest.main()
