# SPDX-License-Identifier: Apache-2.0
"""A drop-in for the module fused_ssim, by array operations of PyTorch."""

from __future__ import annotations

import torch
from torch.nn import functional

from .. import UsageError
from . import _report

_REACH, _SIGMA = 5, 1.5  # of the window of 11 pixels
_C1, _C2 = 0.01**2, 0.03**2  # for values from 0 to 1


def fused_ssim(img1, img2, padding="same", train=True):
    """The mean SSIM of images (B, C, H, W) with values from 0 to 1 (Wang et al. 2004), which autograd differentiates.

    padding: same, where zeros lie around the images, or valid, where windows that reach beyond the images do not count.
    train: whether there is to be a gradient.
    """
    if padding not in ("same", "valid"):
        raise UsageError(f"padding takes same or valid, and not {padding!r}")
    _report.count("fused_ssim.fused_ssim")
    with torch.set_grad_enabled(train and torch.is_grad_enabled()):
        return _map_of(img1, img2, _REACH if padding == "same" else 0).mean()


def _map_of(x, y, zeros):
    """SSIM = (2 mx my + C1)(2 cov + C2) / ((mx^2 + my^2 + C1)(var x + var y + C2)), means over the window."""
    mx, my, xx, yy, xy = _blurred(torch.stack((x, y, x * x, y * y, x * y), 1), zeros).unbind(1)
    variances, covariance = xx - mx * mx + yy - my * my, xy - mx * my
    return (2 * mx * my + _C1) * (2 * covariance + _C2) / ((mx * mx + my * my + _C1) * (variances + _C2))


def _blurred(maps, zeros):
    """Maps (B, 5, C, H, W), each by the window, first along y and then along x. Groups of one channel keep to float32 on a GPU."""
    flat = maps.flatten(1, 2)
    places = torch.arange(-_REACH, _REACH + 1, dtype=flat.dtype, device=flat.device)
    weights = torch.exp(-places * places / (2 * _SIGMA * _SIGMA))
    line = (weights / weights.sum()).expand(flat.shape[1], 1, -1)
    flat = functional.conv2d(flat, line[..., None], padding=(zeros, 0), groups=flat.shape[1])
    flat = functional.conv2d(flat, line[:, :, None], padding=(0, zeros), groups=flat.shape[1])
    return flat.unflatten(1, maps.shape[1:3])
