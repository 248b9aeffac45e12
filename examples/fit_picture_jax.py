#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fits 50 Gaussians to a photo of 32x32 pixels by JAX: grad, jit and Adam, on a GPU if there is one.

    scripts/setup.sh
    PYTHONPATH=build/default/python python3 examples/fit_picture_jax.py --output out/fit.ppm

The picture that it writes shows the photo and the fit side by side.
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import gemsplat
from fit_picture import CAMERA, a_photo, initial_gaussians, psnr, write_ppm

RATE = 0.02


def draw(gaussians):
    return gemsplat.rasterize(**gaussians, cameras=CAMERA).image


def loss(gaussians, photo):
    return jnp.mean((draw(gaussians) - photo)**2)  # or whatever JAX can differentiate


@jax.jit
def step_of_adam(step, gaussians, moments, photo):
    """The Gaussians and the moments of their gradients after `step` steps, 1 and more."""
    gradients = jax.grad(loss)(gaussians, photo)
    moments = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, moments[0], gradients), jax.tree.map(
        lambda v, g: 0.99 * v + 0.01 * g * g, moments[1], gradients)
    return jax.tree.map(lambda value, m, v: value - RATE * m / (1 - 0.9**step) / (jnp.sqrt(v / (1 - 0.99**step)) + 1e-12),
                        gaussians, *moments), moments


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gaussians", type=int, default=50)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, default=Path("out/fit.ppm"))
    options = parser.parse_args()

    photo = jnp.asarray(a_photo(), jnp.float32)
    gaussians = {name: jnp.asarray(array, jnp.float32)
                 for name, array in initial_gaussians(options.gaussians, options.seed).items()}
    before = draw(gaussians)
    moments = (jax.tree.map(jnp.zeros_like, gaussians),) * 2
    for step in range(1, options.steps + 1):
        gaussians, moments = step_of_adam(step, gaussians, moments, photo)
    after = draw(gaussians)
    print(f"{psnr(before, photo):.1f} dB PSNR before, {psnr(after, photo):.1f} dB after {options.steps} steps")
    write_ppm(options.output, np.concatenate([photo, after], axis=1))


if __name__ == "__main__":
    main()
