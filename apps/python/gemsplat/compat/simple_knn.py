# SPDX-License-Identifier: Apache-2.0
"""A drop-in for the module simple_knn and its part _C."""

from __future__ import annotations

import sys

import torch

from .. import nearest_distances
from . import _report

_C = sys.modules[__name__]


def distCUDA2(points):
    """Mean squared distance from each point (N, 3) to its three nearest others, on the points' device.   (N,) float32

    The host computes it: it is for the start of a run.
    """
    _report.count("simple_knn.distCUDA2")
    return torch.from_numpy(nearest_distances(points.detach().cpu().numpy(), 3)).to(points.device)
