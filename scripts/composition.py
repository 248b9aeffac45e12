#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Times how the matrix product of GEMM-GS composes with what other systems bring: the table of docs/lab/2026-11-systems.md.

    python3 scripts/composition.py RUN -o out/composition             # on a GPU, of a run's folder

RUN is drawn with the bounds and the order of each system, and as a file of c3dgs and of LightGaussian, with `render.blend` simt and
gemm. OUT has composition.json, composition.md and the report of each `gemsplat bench`.
"""
import argparse
import json
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# (system, settings of its own, a suffix of the file that its model comes from)
ROWS = [
    ("3DGS: squares of 3 standard deviations", ["render.bounds=square", "render.blend_rule=classic"], None),
    ("Speedy-Splat: boxes by opacity", ["render.bounds=box"], None),
    ("FlashGS, Speedy-Splat: the tiles that an ellipse touches", [], None),
    ("StopThePop: each pixel's own order", ["render.order=pixel"], None),
    ("c3dgs: its file", [], ".npz"),
    ("LightGaussian: its file", [], ".extreme_saving.zip"),
]
BLENDS = ("simt", "gemm")


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stderr.strip()}")


def times_of(report):
    """{scale: (milliseconds of a frame, of its blending)}"""
    return {row["scale"]: (row["ms_per_frame"], next(stage["ms"] for stage in row["stages"] if stage["stage"] == "blend"))
            for row in json.loads(report.read_text())["render"]}


def table(rows, scales):
    lines = ["| | " + " | ".join(f"frame at {scale:g}x: simt, gemm / ms | gain | blending alone" for scale in scales) + " |",
             "|---" * (1 + 3 * len(scales)) + "|"]
    for name, times in rows.items():
        cells = []
        for scale in scales:
            (simt, blend_simt), (gemm, blend_gemm) = (times[blend][scale] for blend in BLENDS)
            cells.append(f"{simt:.3f}, {gemm:.3f} | {simt / gemm:.2f} | {blend_simt / blend_gemm:.2f}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--program", type=Path, default=ROOT / "build/default/bin/gemsplat")
    parser.add_argument("--scales", default="1,2,3")
    parser.add_argument("--frames", type=int, default=9)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--scene", help="the photos of RUN, where they have moved")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    scene = options.scene or tomllib.loads((options.run / "config.toml").read_text())["dataset"]["source"]
    rows = {}
    for name, settings, suffix in ROWS:
        model = options.run
        if suffix:
            model = options.output / f"model{suffix}"
            if not model.exists():
                run(options.program, "export", options.run, model, "-q")
        rows[name] = {}
        for blend in BLENDS:
            report = options.output / f"{len(rows)}_{blend}.json"
            flags = [flag for setting in [*settings, f"render.blend={blend}"] for flag in ("--set", setting)]
            run(options.program, "bench", model, "-c", options.run, "-d", scene, "--device", options.device, "--steps", 1, "--warmup", 1, "--frames",
                options.frames, "--scales", options.scales, "-q", "-o", report.with_suffix(".new.json"), *flags)
            report.with_suffix(".new.json").replace(report)
            rows[name][blend] = times_of(report)
    scales = [float(scale) for scale in options.scales.split(",")]
    (options.output / "composition.json").write_text(json.dumps(rows, indent=1) + "\n")
    text = table(rows, scales)
    (options.output / "composition.md").write_text(text)
    print(text, end="")


if __name__ == "__main__":
    main()
