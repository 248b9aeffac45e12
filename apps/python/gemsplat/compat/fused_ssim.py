# SPDX-License-Identifier: Apache-2.0
"""A drop-in for the module fused_ssim."""

from __future__ import annotations

import torch

from .._loss import compare
from . import _report


def fused_ssim(img1, img2, padding="same", train=True):
    """The mean SSIM of images (B, C, H, W) with values from 0 to 1 (Wang et al. 2004), with a gradient by the first.

    padding: same, where zeros lie around the images, or valid, where windows that reach beyond the images do not count.
    train: whether there is to be a gradient.
    """
    _report.count("fused_ssim.fused_ssim")
    with torch.set_grad_enabled(train and torch.is_grad_enabled()):
        return compare(img1.flatten(0, 1), img2.flatten(0, 1), 0, 1, padding)
