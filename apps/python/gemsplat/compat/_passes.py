# SPDX-License-Identifier: Apache-2.0
"""rasterize() for the drop-ins: a GPU draws features as images of their own."""

from __future__ import annotations

import torch

from .. import rasterize

_COLORS = ("colors", "sh", "sh0", "sh_rest", "sh_degree", "background")


class ScreenTap(torch.autograd.Function):
    """Zeros (..., 2) to add to the means in a picture, from a tensor (..., 2 or more) that is to get their gradient.

    Values of the tensor do not count. Its gradient is that in pixels times `units` in x and y; other columns get zeros.
    """

    @staticmethod
    def forward(ctx, tensor, units):
        ctx.units, ctx.columns = units, tensor.shape[-1]
        return tensor.new_zeros((*tensor.shape[:-1], 2))

    @staticmethod
    def backward(ctx, gradient):
        wanted = gradient.new_zeros((*gradient.shape[:-1], ctx.columns))
        for axis, unit in enumerate(ctx.units):
            wanted[..., axis] = gradient[..., axis] * unit
        return wanted, None


def draw(outputs, **arguments):
    """Pictures by name, of what rasterize() takes for one view; features (N, D) are drawn where they are given."""
    arguments = {name: value for name, value in arguments.items() if value is not None}
    features = arguments.get("features")
    if features is None or not _needs_passes(features):
        return rasterize(outputs=outputs, **arguments)._asdict()
    del arguments["features"]
    pictures = rasterize(outputs=outputs, **arguments)._asdict() if outputs else {}
    shared = {name: value for name, value in arguments.items() if name not in _COLORS}
    table = torch.nn.functional.pad(features, (0, -features.shape[-1] % 3))
    images = [rasterize(colors=table[:, first:first + 3], **shared).image for first in range(0, table.shape[-1], 3)]
    return {**pictures, "features": torch.cat(images, -1)[..., :features.shape[-1]]}


def _needs_passes(features):
    return features.device.type != "cpu"
