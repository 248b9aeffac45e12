# SPDX-License-Identifier: Apache-2.0
"""Real spherical harmonics of any degree by array operations, in the order and with the signs of gs_core/math/render/sh.h."""

from __future__ import annotations

import math

import torch


def basis(degree, directions):
    """Values of the (degree + 1)^2 functions for unit vectors (..., 3).   (..., K)

    Y of order +-m is (-1)^m sqrt((2l + 1)/(4 pi) (l - m)!/(l + m)!) P(z) times sqrt(2) and the real or imaginary part of
    (x + iy)^m. P are the Legendre functions over sin^m, by their recurrences in the degree l.
    """
    x, y, z = directions.unbind(-1)
    real, imaginary = [torch.ones_like(x)], [torch.zeros_like(x)]
    for _ in range(degree):
        real, imaginary = [*real, x * real[-1] - y * imaginary[-1]], [*imaginary, x * imaginary[-1] + y * real[-1]]
    functions = [None] * (degree + 1)**2
    for m in range(degree + 1):
        before, here = 0, math.prod(range(1, 2 * m, 2))
        for l in range(m, degree + 1):
            norm = math.sqrt((2 * l + 1) / (4 * math.pi) * math.factorial(l - m) / math.factorial(l + m) * (2 if m else 1))
            value = (-1)**m * norm * here
            functions[l * l + l + m] = value * real[m]
            if m:
                functions[l * l + l - m] = value * imaginary[m]
            before, here = here, ((2 * l + 1) * z * here - (l + m) * before) / (l + 1 - m)
    return torch.stack(functions, -1)


def evaluate(degree, directions, coefficients):
    """Sums (..., D) of coefficients (..., K, D) in the directions (..., 3), which are of any length."""
    values = basis(degree, torch.nn.functional.normalize(directions, dim=-1))
    return (values[..., None] * coefficients[..., :(degree + 1)**2, :]).sum(-2)
