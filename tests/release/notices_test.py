#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The table of third parties against a build, and what is made of it.

    notices_test.py BUILD [unittest arguments]     BUILD has CMakeCache.txt, bin/ and lib/
"""
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts" / "release"))
sys.dont_write_bytecode = True
import notices  # noqa: E402

BUILD = Path(sys.argv.pop(1)).resolve()
CACHE = (BUILD / "CMakeCache.txt").read_text(encoding="utf-8")


def cached(name):
    return re.search(rf"^{name}:[A-Z]+=(.*)$", CACHE, re.M).group(1)


HAVE = set(cached("GS_BUILD_HAS").split(","))


class Table(unittest.TestCase):
    def test_every_row_is_complete_and_its_license_has_a_text(self):
        for row in notices.read_table():
            for key in ("name", "license", "copyright", "how", "version", "source"):
                self.assertTrue(row.get(key), f"{row['name']}: {key}")
            if row["how"] != "shared":
                self.assertTrue(notices.license_texts([row]), row["name"])

    def test_every_web_package_in_a_page_has_a_row(self):
        self.assertEqual(notices.bundled_packages(), ["@sparkjsdev/spark", "fflate", "three", "uplot"])
        notices.pages(None)

    def test_every_needed_library_has_a_row(self):
        if not shutil.which("readelf"):
            self.skipTest("readelf is not installed")
        files = [BUILD / "bin" / "gemsplat", *BUILD.glob("lib/gemsplat/*.so"), *BUILD.glob("python/gemsplat/*.so")]
        static = cached("GS_STATIC_LIBRARIES") == "ON"
        rows = notices.rows_of(HAVE, static)
        self.assertEqual(notices.unexpected(files, rows, static), [])
        without = [row for row in rows if row["name"] != "GNU C Library"]
        self.assertIn(f"{files[0]} needs libc.so.6", notices.unexpected(files, without, static))

    def test_nothing_under_the_gpl_is_inside_a_build(self):
        everything = {row["when"] for row in notices.read_table() if "when" in row}
        inside = [row for static in (False, True) for row in notices.rows_of(everything, static) if row["how"] in notices.INSIDE]
        copyleft = [row["name"] for row in inside if "GPL" in row["license"] and "GCC-exception" not in row["license"]]
        self.assertEqual(copyleft, [])


class Documents(unittest.TestCase):
    def write(self, *flags):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, ROOT / "scripts/release/notices.py", "write", "--have", "ZLIB,WEB,CUDA", "--version", "1.2.3",
                            "--cuda", "12.9.1", *flags, folder], check=True, env=os.environ | {"SOURCE_DATE_EPOCH": "86400"})
            return (Path(folder) / "NOTICE").read_text(encoding="utf-8"), (Path(folder) / "sbom.spdx.json").read_text(encoding="utf-8")

    def test_the_same_build_gives_the_same_bytes(self):
        self.assertEqual(self.write(), self.write())

    def test_notice_has_name_copyright_and_license_of_what_is_inside(self):
        shared, static = self.write()[0], self.write("--static")[0]
        for text in ("three.js 0.180.0", "Copyright (c) 2022 Leon Sorokin", "Permission is hereby granted", "CUDA runtime 12.9.1"):
            self.assertIn(text, shared)
        self.assertNotIn("Jean-loup Gailly", shared)  # zlib is a library of the system there
        self.assertIn("Jean-loup Gailly", static)
        self.assertNotIn("libwebp", static)  # this build has none

    def test_sbom_is_spdx(self):
        document = json.loads(self.write("--static")[1])
        self.assertEqual(document["spdxVersion"], "SPDX-2.3")
        self.assertEqual(document["creationInfo"]["created"], "1970-01-02T00:00:00Z")
        ids = [package["SPDXID"] for package in document["packages"]]
        self.assertEqual(len(ids), len(set(ids)))
        related = {(r["relationshipType"], r["relatedSpdxElement"]) for r in document["relationships"]}
        self.assertIn(("CONTAINS", "SPDXRef-zlib"), related)
        self.assertIn(("DEPENDS_ON", "SPDXRef-GNU-C-Library"), related)
        for _, name in related:
            self.assertIn(name, ids)
        for package in document["packages"]:
            self.assertRegex(package["SPDXID"], r"^SPDXRef-[A-Za-z0-9.-]+$")
        self.assertEqual([t["licenseId"] for t in document["hasExtractedLicensingInfos"]], ["LicenseRef-NVIDIA-CUDA"])


if __name__ == "__main__":
    unittest.main()
