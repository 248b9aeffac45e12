#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fits 50 Gaussians to a photo of 32x32 pixels, by the gradients of gemsplat.vjp and SciPy's L-BFGS.

    scripts/setup.sh
    sudo apt install python3-scipy
    PYTHONPATH=build/default/python examples/fit_picture.py --output out/fit.ppm

The picture that it writes shows the photo and the fit side by side. It takes some seconds on the CPU.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

import gemsplat

COURTYARD = Path(__file__).parent / "courtyard"
SIDE = 32  # pixels
CAMERA = gemsplat.Camera(SIDE, SIDE, 40.0)  # at the origin; it looks along z


def a_photo():
    """(SIDE, SIDE, 3), 0 to 1: the middle of a photo of the bundled scene."""
    photo = gemsplat.Scene.load(COURTYARD, resolution=43).train_views[0].photo  # 43 x 32 pixels
    left = (photo.shape[1] - SIDE) // 2
    return photo[:SIDE, left:left + SIDE] / 255


def initial_gaussians(count, seed):
    """Arrays that rasterize() takes: gray Gaussians before the camera, at random places of the picture."""
    random = np.random.default_rng(seed)
    depths = random.uniform(2, 3, count)
    corner = SIDE / 2 / CAMERA.fx
    return {"means": np.stack([random.uniform(-corner, corner, count) * depths, random.uniform(-corner, corner, count) * depths,
                               depths], axis=1),
            "rotations": random.normal(size=(count, 4)),
            "log_scales": np.full((count, 3), np.log(0.15)),
            "logit_opacities": np.zeros(count),
            "colors": np.full((count, 3), 0.5)}


def joined(arrays):
    return np.concatenate([array.ravel() for array in arrays.values()])


def parted(numbers, like):
    """The arrays whose joined() numbers are these."""
    ends = np.cumsum([array.size for array in like.values()])
    return {name: part.reshape(array.shape) for (name, array), part in zip(like.items(), np.split(numbers, ends[:-1]))}


def fit(photo, gaussians, steps):
    """The Gaussians with the least mean squared error that `steps` steps of L-BFGS find."""

    def loss(numbers):
        # Line searches do not get over the jumps of fragments that appear and vanish: hence smooth.
        rendering, pull = gemsplat.vjp(**parted(numbers, gaussians), cameras=CAMERA, smooth=True)
        error = rendering.image - photo
        gradients = pull(image=2 * error / error.size)
        return np.mean(error**2), joined({name: gradients[name] for name in gaussians})

    found = minimize(loss, joined(gaussians), jac=True, method="L-BFGS-B", options={"maxiter": steps})
    return parted(found.x, gaussians)


def psnr(a, b):
    """dB"""
    return -10 * np.log10(np.mean((a - b)**2))


def write_ppm(path, color):
    pixels = (np.clip(color, 0, 1) * 255 + 0.5).astype(np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"P6\n%d %d\n255\n" % (color.shape[1], color.shape[0]) + pixels.tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gaussians", type=int, default=50)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, default=Path("out/fit.ppm"))
    arguments = parser.parse_args()

    photo = a_photo()
    gaussians = initial_gaussians(arguments.gaussians, arguments.seed)
    before = gemsplat.rasterize(**gaussians, cameras=CAMERA).image
    after = gemsplat.rasterize(**fit(photo, gaussians, arguments.steps), cameras=CAMERA).image
    print(f"{psnr(before, photo):.1f} dB PSNR before, {psnr(after, photo):.1f} dB after {arguments.steps} steps")
    write_ppm(arguments.output, np.concatenate([photo, after], axis=1))


if __name__ == "__main__":
    main()
