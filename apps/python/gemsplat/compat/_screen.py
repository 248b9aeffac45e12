# SPDX-License-Identifier: Apache-2.0
"""How tensors of scripts get the gradients by the means in a picture."""

from __future__ import annotations

import functools

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
        if ctx.units != (1, 1):
            gradient = gradient * constants(ctx.units, gradient.device, gradient.dtype)
        return torch.nn.functional.pad(gradient, (0, ctx.columns - 2)) if ctx.columns > 2 else gradient, None


def constants(numbers, device, dtype):
    """A tensor of these numbers, for which the host does not wait. Nobody changes it.

    Each stream has its own, which is written before it is read. A CUDA graph makes its own when it is recorded: nothing is
    written then, and those of others may be gone when it runs.
    """
    if device.type != "cuda":
        return _kept_constants(numbers, device, dtype, None)
    if torch.cuda.is_current_stream_capturing():
        return _new_constants(numbers, device, dtype)
    return _kept_constants(numbers, device, dtype, torch.cuda.current_stream(device).cuda_stream)


def _new_constants(numbers, device, dtype):
    tensor = torch.empty(len(numbers), device=device, dtype=dtype)
    for at, number in enumerate(numbers):
        tensor[at].fill_(number)
    return tensor


@functools.lru_cache(64)
def _kept_constants(numbers, device, dtype, _):
    return _new_constants(numbers, device, dtype)


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
