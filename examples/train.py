#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains the bundled scene, and renders a picture from a view that training did not see.

    scripts/setup.sh
    PYTHONPATH=build/default/python examples/train.py --steps 300 --output out/example

The folder then holds the model (point_cloud/), checkpoints, a report and view.ppm. Started again with --resume, a run that
was stopped goes on. On a CPU with two cores 300 steps take about a minute.
"""

import argparse
from pathlib import Path

import numpy as np

import gemsplat

COURTYARD = Path(__file__).parent / "courtyard"


def show_progress(now):
    """Called every few steps; returning False would end the run."""
    print(f"step {now.step} of {now.steps}: loss {now.loss:.4f}, {now.gaussian_count:,} Gaussians")


def write_ppm(path, color):
    """Saves a float picture, 0 to 1, as PPM: a header, then red, green and blue of each pixel."""
    height, width, _ = color.shape
    pixels = (np.clip(color, 0, 1) * 255 + 0.5).astype(np.uint8)
    path.write_bytes(b"P6\n%d %d\n255\n" % (width, height) + pixels.tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--output", type=Path, default=Path("out/example"), help="the folder of the run")
    parser.add_argument("--resume", action="store_true", help="go on with the run in the folder")
    parser.add_argument("--device", default="auto", help="cpu, cuda, cuda:N or auto")
    arguments = parser.parse_args()

    # Photos of 120x90 pixels; every eighth view is held out to measure on.
    scene = gemsplat.Scene.load(COURTYARD, eval=True, resolution=4)
    result = gemsplat.train(scene, iterations=arguments.steps, device=arguments.device, output=arguments.output,
                            resume=arguments.resume, callback=show_progress, callback_every=20)
    if result.evaluation:  # None for a run that was finished before
        print(f"{result.evaluation.psnr:.2f} dB PSNR on {len(result.evaluation.views)} held-out views")

    picture = gemsplat.render(result.model, scene.test_views[0].camera, device=arguments.device)
    write_ppm(arguments.output / "view.ppm", picture.color)
    print(f"the run is in {arguments.output}")


if __name__ == "__main__":
    main()
