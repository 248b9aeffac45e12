# SPDX-License-Identifier: Apache-2.0
"""python -m gemsplat.compat [--dgr[=VARIANT]] [--gsplat[=API]] [--report] SCRIPT ARGUMENTS: runs a script on gemsplat."""

from __future__ import annotations

import argparse
import atexit
import os
import runpy
import sys

from .. import UsageError
from . import install, report


def _arguments():
    parser = argparse.ArgumentParser(
        usage="python -m gemsplat.compat [--dgr[=VARIANT]] [--gsplat[=API]] [--report] SCRIPT ARGUMENTS", allow_abbrev=False,
        description="Runs a script, whose imports of diff_gaussian_rasterization, simple_knn, fused_ssim and gsplat find "
        "gemsplat's modules.")
    parser.add_argument("--dgr", metavar="VARIANT", help="diff_gaussian_rasterization and what goes with it, and not gsplat; "
                        "--dgr=VARIANT: 2023, aa, accel or depth_alpha, by default what a call gives decides")
    parser.add_argument("--gsplat", metavar="API", help="gsplat and fused_ssim, and nothing else; "
                        "--gsplat=API: 1.4, 1.5 or 1.6, by default that of the installed one")
    parser.add_argument("--report", action="store_true", help="write at the end which functions were called")
    parser.add_argument("script", metavar="SCRIPT")
    parser.add_argument("arguments", metavar="ARGUMENTS", nargs=argparse.REMAINDER)
    return parser, _joined(sys.argv[1:])


def _joined(words):
    """`--dgr SCRIPT` as `--dgr= SCRIPT`: a value comes behind a sign of equality alone."""
    for place, word in enumerate(words):
        if not word.startswith("--"):
            break
        if word in ("--dgr", "--gsplat"):
            words = [*words[:place], f"{word}=", *words[place + 1:]]
    return words


def main():
    parser, words = _arguments()
    given = parser.parse_args(words)
    has_all = given.dgr is None and given.gsplat is None
    try:
        if has_all or given.dgr is not None:
            install("diff_gaussian_rasterization", variant=given.dgr or None)
            install("simple_knn")
        if has_all or given.gsplat is not None:
            install("gsplat", api=given.gsplat or None)
        install("fused_ssim")
    except (UsageError, ModuleNotFoundError) as error:
        parser.error(str(error))
    if not os.path.isfile(given.script):
        parser.error(f"cannot read {given.script}: there is no such file")
    if given.report:
        atexit.register(lambda: print(report(), file=sys.stderr))
    sys.argv = [given.script, *given.arguments]
    sys.path.insert(0, os.path.dirname(os.path.abspath(given.script)))
    runpy.run_path(given.script, run_name="__main__")


if __name__ == "__main__":
    main()
