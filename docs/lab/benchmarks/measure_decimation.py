# SPDX-License-Identifier: Apache-2.0
"""Measures what a trained model loses when it is made smaller, on the photos that its run held out.

    python3 measure_decimation.py RUN -o OUT [--shares 0.5 0.25 0.1] [--recover 1000] [--device cpu]
        [--program gemsplat] [--splat-transform PROGRAM]

For each share the model is decimated in these ways:

    merge             gemsplat edit --decimate SHARE
    drop              the same with --decimate-by drop: by what the training views show
    opacity           the Gaussians of the highest opacity stay
    splat-transform   PROGRAM -F SHARE, of @playcanvas/splat-transform; left out without PROGRAM.
                      It needs WebGPU; without a GPU, Chromium's software Vulkan will do:
                      VK_ICD_FILENAMES=/usr/lib/chromium/vk_swiftshader_icd.json

and then trained on for --recover steps with `-c finetune` (0: not at all). OUT gets the models,
decimation.json, and decimation.md with the table. Models that are there already are not made again.
Needs nothing but Python.
"""

import argparse
import json
import math
import pathlib
import re
import struct
import subprocess
import sys
import time


def run(words, **options):
    """Runs a program, and returns its output. Ends with its messages where it fails."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, **options)
    if done.returncode:
        sys.exit(f"error: {' '.join(map(str, words))} has failed:\n{done.stdout}{done.stderr}")
    return done.stdout


def count_of(ply):
    with open(ply, "rb") as file:
        head = file.read(4096).decode("latin-1")
    return int(re.search(r"element vertex (\d+)", head).group(1))


def opacity_range(ply, share):
    """The opacity above which a share of the Gaussians lies, as `gemsplat edit` takes it."""
    with open(ply, "rb") as file:
        data = file.read()
    head, body = data.split(b"end_header\n", 1)
    names = re.findall(rb"property float (\S+)", head)
    row, place = 4 * len(names), 4 * names.index(b"opacity")
    logits = sorted(struct.unpack_from("<f", body, at + place)[0]
                    for at in range(0, len(body) - row + 1, row))
    limit = logits[len(logits) - round(share * len(logits))]
    return f"opacity={1 / (1 + math.exp(-limit)):.9g}.."


class Measurement:
    def __init__(self, options):
        self.options = options
        self.out = pathlib.Path(options.output)
        self.out.mkdir(parents=True, exist_ok=True)
        self.program = options.program
        plys = sorted(pathlib.Path(options.run).glob("point_cloud/iteration_*/point_cloud.ply"),
                      key=lambda ply: int(ply.parent.name.split("_")[1]))
        if not plys:
            sys.exit(f"error: {options.run} has no model; give the folder of a finished run")
        self.model = plys[-1].resolve()

    def figures(self, model):
        text = run([self.program, "eval", model, "-c", self.options.run, "--json", "-q",
                    *self.device()])
        figures = json.loads(text)
        return {key: figures[key] for key in ("psnr", "ssim", "flip") if key in figures}

    def device(self):
        return ["--device", self.options.device] if self.options.device else []

    def make(self, way, share, model):
        edit = [self.program, "edit"]
        if way == "splat-transform":
            run([self.options.splat_transform, "-w", self.model, "-F", f"{100 * share:g}%", model])
        elif way == "opacity":
            run(edit + [self.model, "--keep", opacity_range(self.model, share), "-o", model])
        else:
            run(edit + [self.options.run, "--decimate", share, "--decimate-by", way, "-o", model])

    def recovered(self, way, share, model):
        out = self.out / f"{way}_{share:g}_recovered"
        if not (out / "results.json").exists():
            run([self.program, "train", "-c", self.options.run, "-c", "finetune", "--from", model,
                 "-i", self.options.recover, "-o", out, "-q", "--force", "--set",
                 f"density.max_gaussians={count_of(model)}", *self.device()])
        test = json.loads((out / "results.json").read_text())["test"]
        return {key: test[key] for key in ("psnr", "ssim", "flip") if key in test}

    def rows(self):
        yield {"way": "as trained", "share": 1, "gaussians": count_of(self.model),
               **self.figures(self.model)}
        ways = ["merge", "drop", "opacity"]
        if self.options.splat_transform:
            ways.append("splat-transform")
        for share in self.options.shares:
            for way in ways:
                model = self.out / f"{way}_{share:g}.ply"
                begin = time.monotonic()
                if not model.exists():
                    self.make(way, share, model)
                row = {"way": way, "share": share, "gaussians": count_of(model),
                       "seconds": round(time.monotonic() - begin, 2), **self.figures(model)}
                if self.options.recover:
                    row["recovered"] = self.recovered(way, share, model)
                yield row


def shown(row):
    after = row.get("recovered")
    cells = [row["way"], f"{row['share']:.0%}", f"{row['gaussians']:,}"]
    for figures in (row, after):
        if figures is not None:
            cells += [f"{figures['psnr']:.2f}", f"{figures['ssim']:.4f}".lstrip("0"),
                      f"{figures['flip']:.4f}".lstrip("0") if "flip" in figures else ""]
        else:
            cells += ["", "", ""]
    return "| " + " | ".join(cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run")
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--shares", type=float, nargs="+", default=[0.5, 0.25, 0.1])
    parser.add_argument("--recover", type=int, default=1000)
    parser.add_argument("--device", default="")
    parser.add_argument("--program", default="gemsplat")
    parser.add_argument("--splat-transform", default="")
    measurement = Measurement(parser.parse_args())
    lines = ["| model | share | Gaussians | PSNR / dB | SSIM | FLIP | recovered: PSNR / dB | SSIM "
             "| FLIP |", "|---|---|---|---|---|---|---|---|---|"]
    print("\n".join(lines))
    rows = []
    for row in measurement.rows():
        rows.append(row)
        lines.append(shown(row))
        print(lines[-1], flush=True)
    (measurement.out / "decimation.json").write_text(json.dumps(rows, indent=1) + "\n")
    (measurement.out / "decimation.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
