# SPDX-License-Identifier: Apache-2.0
"""rasterize() for the drop-ins: what a GPU does not draw beside an image, it draws as images of their own."""

from __future__ import annotations

import torch

from .. import rasterize
from .._torch import GPU_PICTURES

COLORS = ("colors", "sh", "sh0", "sh_rest", "background")


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
    """Pictures by name, of what rasterize() takes; `features` are drawn where they are given."""
    arguments = {name: value for name, value in arguments.items() if value is not None}
    extra = {name: None for name in outputs if not _is_drawn_beside(name, arguments["means"])}
    beside = [name for name in outputs if name not in extra]
    features = arguments.get("features")
    if features is not None and not _is_drawn_beside("features", arguments["means"]):
        extra["features"] = arguments.pop("features")
    pictures = {}
    if beside or "features" in arguments:
        without_colors = "image" not in beside
        shown = {name: value for name, value in arguments.items() if not (without_colors and name in COLORS)}
        pictures = {name: picture for name, picture in rasterize(outputs=beside, **shown)._asdict().items() if picture is not None}
    if extra:
        pictures.update(_in_passes(extra, arguments))
    return pictures


def _is_drawn_beside(name, means):
    return means.device.type == "cpu" or name in GPU_PICTURES


def _in_passes(extra, arguments):
    """Sums of weights times depths, their inverses and features, as the three channels of images."""
    channels = []
    for name, features in extra.items():
        if name == "depth":
            features = _depths(arguments)[..., None]
        elif name == "inverse_depth":
            features = 1 / _depths(arguments).clamp_min(arguments["near"])[..., None]
        channels.append(features)
    axes = max(one.dim() for one in channels)
    views = max(one.shape[0] if one.dim() == 3 else 1 for one in channels)
    table = torch.cat([one if one.dim() == axes else one.expand(views, *one.shape) for one in channels], -1)
    table = torch.nn.functional.pad(table, (0, -table.shape[-1] % 3))
    shared = {name: value for name, value in arguments.items() if name not in (*COLORS, "sh_degree")}
    images = [rasterize(colors=table[..., first:first + 3], **shared).image for first in range(0, table.shape[-1], 3)]
    sizes = [one.shape[-1] for one in channels]
    found = dict(zip(extra, torch.cat(images, -1)[..., :sum(sizes)].split(sizes, -1)))
    return {name: picture if name == "features" else picture[..., 0] for name, picture in found.items()}


def _depths(arguments):
    """(N,), or (C, N) for matrices with the axis C."""
    viewmats = arguments["viewmats"]
    return (arguments["means"] * viewmats[..., 2, None, :3]).sum(-1) + viewmats[..., 2, 3, None]
