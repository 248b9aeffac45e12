# SPDX-License-Identifier: Apache-2.0
"""How tensors of scripts get the gradients by the means in a picture."""

from __future__ import annotations

import torch


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


class AbsoluteTap(torch.autograd.Function):
    """Zeros (..., 2) for absolute_screen, whose sums are added to the attribute `absgrad` of a tensor (..., 2)."""

    @staticmethod
    def forward(ctx, tensor):
        ctx.tensor = tensor
        tensor.absgrad = torch.zeros_like(tensor, requires_grad=False)
        return tensor.new_zeros(tensor.shape)

    @staticmethod
    def backward(ctx, sums):
        ctx.tensor.absgrad += sums
        return None
