#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Finishes a small model by Levenberg-Marquardt, as 3DGS-LM does, and by Adam, to compare the two.

    scripts/setup.sh
    sudo apt install python3-scipy
    PYTHONPATH=build/default/python examples/levenberg_marquardt.py --output out/finish.csv

Both start from the same model of the bundled scene, minimize the same loss on the same photos with the exact renderer on the
CPU, and get the same time. Some minutes. The CSV has the loss and the PSNR of held-out photos over seconds.
Without its cache of alpha and colors and its batches: each product with J renders all photos again (Höllein et al., ICCV 2025).
"""

import argparse
import csv
import time
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

import gemsplat

COURTYARD = Path(__file__).parent / "courtyard"
HUBER = 0.1          # of a difference of colors; below it the loss is square
SIGMA, RADIUS = 1.5, 5  # pixels, of the windows of SSIM
CENTER = float(gaussian_filter(np.pad([1.0], RADIUS), SIGMA, truncate=RADIUS / SIGMA)[RADIUS])**2  # of a window's weights
# Adam's rates at the end of training, for each array that moves.
RATES = {"means": 1.6e-6, "rotations": 1e-3, "log_scales": 5e-3, "logit_opacities": 5e-2, "sh0": 2.5e-3, "sh_rest": 1.25e-4}


def smoothed(picture):
    return gaussian_filter(picture, (SIGMA, SIGMA, 0), truncate=RADIUS / SIGMA)


def residuals(image, photo):
    """(r, dr/dimage) for the two residuals of each pixel and channel, whose squares sum to twice the loss.

    The first is the root of the Huber loss. The second is the root of a quarter of 1 - SSIM, as a function of the pixel in the
    middle of its window, so that both Jacobians by the picture are diagonal.
    """
    e = image - photo
    small = np.abs(e) <= HUBER
    huber = np.where(small, e * e / 2, HUBER * (np.abs(e) - HUBER / 2))
    first = np.sqrt(huber)
    slope = np.where(small, e, HUBER * np.sign(e)) / np.maximum(2 * first, 1e-9)
    x, y = smoothed(image), smoothed(photo)
    xx, yy, xy = smoothed(image * image) - x * x, smoothed(photo * photo) - y * y, smoothed(image * photo) - x * y
    a, b, c, d = 2 * x * y + 1e-4, 2 * xy + 9e-4, x * x + y * y + 1e-4, xx + yy + 9e-4
    ssim = a * b / (c * d)
    by_pixel = CENTER * (2 * y * b + a * 2 * (photo - y)) / (c * d) - CENTER * ssim * (2 * x / c + 2 * (image - x) / d)
    second = np.sqrt(np.maximum(1 - ssim, 0) / 4)
    return (first, slope), (second, -by_pixel / np.maximum(8 * second, 1e-3))


class Problem:
    """The loss of some photos, and products with its Jacobian."""

    def __init__(self, views):
        self.cameras = [view.camera for view in views]
        self.photos = [view.photo / 255.0 for view in views]

    def loss(self, arrays):
        return sum(sum((r * r).sum() for r, _ in residuals(gemsplat.rasterize(**arrays, cameras=camera).image, photo)) / 2
                   for camera, photo in zip(self.cameras, self.photos))

    def linearize(self, arrays, probes, random):
        """Sets the point of all products. Returns (loss, its gradient, an estimate of diag(J^T J)), each as arrays by name.

        The diagonal is the mean of (J^T z)^2 over `probes` vectors z of random signs.
        """
        self.arrays, self.weights = arrays, []
        loss, gradient, diagonal = 0.0, zeros_like(arrays), zeros_like(arrays)
        for camera, photo in zip(self.cameras, self.photos):
            rendering, pull = gemsplat.vjp(**arrays, cameras=camera)
            pairs = residuals(rendering.image, photo)
            loss += sum((r * r).sum() for r, _ in pairs) / 2
            self.weights.append(sum(slope * slope for _, slope in pairs))
            add(gradient, pull(image=sum(r * slope for r, slope in pairs)))
            for _ in range(probes):
                signs = random.choice([-1.0, 1.0], photo.shape)
                pulled = pull(image=np.sqrt(self.weights[-1]) * signs)
                for name in diagonal:
                    diagonal[name] += pulled[name]**2 / probes
        return loss, gradient, diagonal

    def times_jtj(self, direction):
        """J^T J direction, without J: one pass forward and one backward for each photo."""
        product = zeros_like(direction)
        for camera, weight in zip(self.cameras, self.weights):
            _, change = gemsplat.jvp({**self.arrays, "cameras": camera}, direction)
            _, pull = gemsplat.vjp(**self.arrays, cameras=camera)
            add(product, pull(image=weight * change.image))
        return product


def zeros_like(arrays):
    return {name: np.zeros_like(array) for name, array in arrays.items()}


def add(total, more):
    for name in total:
        total[name] += more[name]


def inner(a, b):
    return sum(float((a[name] * b[name]).sum()) for name in a)


def moved(arrays, direction, by):
    return {name: array + by * direction[name] for name, array in arrays.items()}


def solve(problem, gradient, diagonal, damping, steps):
    """The direction that solves (J^T J + C) d = -gradient by preconditioned conjugate gradients."""
    inverse = {name: 1 / (diagonal[name] + damping[name]) for name in diagonal}
    direction = zeros_like(gradient)
    r = {name: -value for name, value in gradient.items()}
    z = {name: inverse[name] * r[name] for name in r}
    p, rz = z, inner(r, z)
    for _ in range(steps):
        q = problem.times_jtj(p)
        add(q, {name: damping[name] * p[name] for name in p})
        alpha = rz / inner(p, q)
        direction, r = moved(direction, p, alpha), moved(r, q, -alpha)
        z = {name: inverse[name] * r[name] for name in r}
        rz, before = inner(r, z), rz
        p = moved(z, p, rz / before)
    return direction


def levenberg_marquardt(problem, arrays, seconds, report, random):
    """Steps of Levenberg-Marquardt for `seconds`, each of eight conjugate gradients and a line search."""
    radius, end = 1.0, time.perf_counter() + seconds
    while time.perf_counter() < end:
        loss, gradient, diagonal = problem.linearize(arrays, 2, random)
        damping = {name: np.clip(value, 1e-6, 1e6) / radius for name, value in diagonal.items()}
        direction = solve(problem, gradient, diagonal, damping, 8)
        for by in 0.5**np.arange(10):
            if problem.loss(moved(arrays, direction, by)) < loss:
                arrays = moved(arrays, direction, by)
                radius *= 3 if by == 1 else 1
                break
        else:
            radius /= 3  # no length of the step was any good
        report(arrays)
    return arrays


def adam(problem, arrays, seconds, report, random):
    """Steps of Adam for `seconds`, each on one photo, with the rates of the end of training."""
    first, second, step, end = zeros_like(arrays), zeros_like(arrays), 0, time.perf_counter() + seconds
    while time.perf_counter() < end:
        for i in random.permutation(len(problem.photos)):
            rendering, pull = gemsplat.vjp(**arrays, cameras=problem.cameras[i])
            gradient = pull(image=sum(r * slope for r, slope in residuals(rendering.image, problem.photos[i])))
            step += 1
            for name, array in arrays.items():
                first[name] = 0.9 * first[name] + 0.1 * gradient[name]
                second[name] = 0.999 * second[name] + 0.001 * gradient[name]**2
                change = first[name] / (1 - 0.9**step) / (np.sqrt(second[name] / (1 - 0.999**step)) + 1e-15)
                arrays = {**arrays, name: array - RATES[name] * change}
        report(arrays)
    return arrays


def psnr(arrays, views):
    """dB, the mean of the views"""
    errors = [np.mean((gemsplat.rasterize(**arrays, cameras=view.camera).image.clip(0, 1) - view.photo / 255)**2) for view in views]
    return float(np.mean([-10 * np.log10(error) for error in errors]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", type=Path, default=COURTYARD)
    parser.add_argument("--resolution", type=int, default=64, help="the width of photos, or a factor up to 8")
    parser.add_argument("--photos", type=int, default=12, help="that train")
    parser.add_argument("--gaussians", type=int, default=800)
    parser.add_argument("--steps", type=int, default=400, help="of training before either method")
    parser.add_argument("--seconds", type=float, default=120, help="for each method")
    parser.add_argument("--output", type=Path, default=Path("out/finish.csv"))
    arguments = parser.parse_args()

    scene = gemsplat.Scene.load(arguments.scene, eval=True, resolution=arguments.resolution)
    model = gemsplat.train(scene, {"density.max_gaussians": arguments.gaussians}, iterations=arguments.steps, device="cpu").model
    start = {name: np.asarray(getattr(model, name), np.float64) for name in RATES}
    every = max(1, len(scene.train_views) // arguments.photos)
    problem = Problem(scene.train_views[::every])
    print(f"{len(start['means'])} Gaussians, {len(problem.photos)} photos of {problem.photos[0].shape[1]}x{problem.photos[0].shape[0]}")
    rows = []
    for method in (levenberg_marquardt, adam):
        begin, paused = time.perf_counter(), 0.0

        def report(arrays):
            nonlocal paused
            now = time.perf_counter()
            rows.append((method.__name__, round(now - begin - paused, 2), problem.loss(arrays), psnr(arrays, scene.test_views)))
            print("%-20s %7.1f s, loss %.4f, %.3f dB on held-out photos" % rows[-1])
            paused += time.perf_counter() - now

        report(start)
        method(problem, start, arguments.seconds, report, np.random.default_rng(0))
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    with open(arguments.output, "w", newline="") as file:
        csv.writer(file).writerows([("method", "seconds", "loss", "psnr"), *rows])


if __name__ == "__main__":
    main()
