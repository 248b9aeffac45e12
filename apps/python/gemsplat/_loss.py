# SPDX-License-Identifier: Apache-2.0
"""How pictures of PyTorch are compared: by one kernel and its gradient on a GPU, and by array operations on the CPU."""

from __future__ import annotations

import torch
from torch.nn import functional

from . import _gemsplat
from ._gemsplat import UsageError
from ._torch import _pieces, eagerly

PADDINGS = ("same", "valid")
_REACH, _SIGMA = 5, 1.5  # of the window of 11 pixels
_C1, _C2 = 0.01**2, 0.03**2  # for values from 0 to 1


def photometric_loss(image, target, ssim_weight, padding):
    planes = [picture.movedim(-1, -3).flatten(0, -3) for picture in (image, target)]
    return ssim_weight + compare(*planes, 1 - ssim_weight, -ssim_weight, padding)


@eagerly
def compare(image, target, l1, ssim, padding):
    """l1 mean|X - Y| + ssim mean SSIM(X, Y) of planes (P, H, W), with a gradient by X (Wang et al. 2004)."""
    if padding not in PADDINGS:
        raise UsageError(f"padding takes same or valid, and not {padding!r}")
    if image.shape != target.shape:
        raise UsageError(f"pictures that are compared must have one shape, but have {tuple(image.shape)} and {tuple(target.shape)}")
    margin = _REACH if padding == "valid" else 0
    if min(image.shape[1:]) <= 2 * margin:
        raise UsageError(f"pictures of {image.shape[2]}x{image.shape[1]} pixels hold no window of 11 pixels; padding=\"same\" "
                         "takes any size")
    if image.device.type == "cuda" and image.dtype == torch.float32:
        return _Compare.apply(image, target.detach().to(image), float(l1), float(ssim), margin)
    similarity = _map_of(image[None], target[None].to(image), _REACH - margin).mean() if ssim else 0
    return l1 * (image - target).abs().mean() + ssim * similarity


class _Compare(torch.autograd.Function):
    @staticmethod
    def forward(ctx, image, target, l1, ssim, margin):
        image, target = image.contiguous(), target.contiguous()
        value = image.new_empty(())
        gradient = torch.empty_like(image) if ctx.needs_input_grad[0] else None
        _gemsplat.gpu_compare(image.device.index, torch.cuda.current_stream(image.device).cuda_stream, _pieces(image.device),
                              image.data_ptr(), target.data_ptr(), tuple(image.shape), margin, (l1, ssim), value.data_ptr(),
                              0 if gradient is None else gradient.data_ptr())
        if gradient is not None:
            ctx.save_for_backward(gradient)
        return value

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_value):
        gradient, = ctx.saved_tensors
        return by_value * gradient, None, None, None, None


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
