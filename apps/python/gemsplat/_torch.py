# SPDX-License-Identifier: Apache-2.0
"""rasterize() for PyTorch tensors, which autograd differentiates: on a GPU by its kernels, in float32,
and on the CPU by the exact renderer. Nothing here is linked to PyTorch: kernels get addresses.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch.autograd.function import once_differentiable

from . import _gpu, _numpy
from ._gemsplat import GpuOperation, UsageError
from ._rasterize import Rendering


# Decorates what torch.compile leaves out of its graphs; PyTorch before 2.1 has none.
eagerly = getattr(getattr(torch, "compiler", None), "disable", lambda function: function)


def arrays_of(given):
    """Tensors of the device and the dtype of means; lists and numbers become tensors."""
    means = given["means"]
    dtype = means.dtype if means.dtype == torch.float64 else torch.float32
    tensors = {}
    for name, value in given.items():
        if isinstance(value, torch.Tensor):
            if value.device != means.device:
                raise UsageError(f"{name} is on {value.device}, but means on {means.device}; move one of them by .to()")
            if not value.is_floating_point():
                raise UsageError(f"{name} must hold real numbers, but is of {value.dtype}")
            half = value.dtype in (torch.float16, torch.bfloat16)
            tensors[name] = value.to(torch.float32) if half else value
        else:
            try:
                tensors[name] = torch.as_tensor(value, dtype=dtype, device=means.device)
            except (TypeError, ValueError):
                raise UsageError(f"{name} must be a tensor, as means is, and not a {type(value).__name__}") from None
    return tensors


def rasterize(arguments):
    """The Rendering, each picture of which autograd knows."""
    device = arguments.arrays["means"].device.type
    if device == "cpu":
        return _on_cpu(arguments)
    if device == "cuda":
        return _on_gpu(arguments)
    raise UsageError(f"means is on {device}; tensors are drawn on cuda and cpu")


def footprints(arguments, names, *rule):
    """Those of the only view, by name."""
    means = arguments.arrays["means"]
    if means.device.type == "cpu":
        arrays = {name: tensor.detach().numpy() for name, tensor in arguments.arrays.items()}
        found = _numpy.footprints(replace(arguments, arrays=arrays), names, *rule)
        return {name: torch.from_numpy(array).to(torch.int32 if name == "radii" else means.dtype)
                for name, array in found.items()}
    count = arguments.count
    rows = {"means2d": (2,), "depths": (), "conics": (3,), "compensations": (), "radii": (2,)}
    found = {name: torch.empty((count, *rows[name]), dtype=torch.int32 if name == "radii" else torch.float32, device=means.device)
             for name in names}
    tensors = {name: _dense(name, tensor) for name, tensor in _gpu.arrays_of_view(arguments, 0).items()}
    call = _call(arguments, 0, _gpu.settings_of(arguments), needs_gradients=False)
    GpuOperation(_addresses(tensors), call).footprints(*_place(means.device), *rule,
                                                       [found[name].data_ptr() if name in found else 0 for name in rows])
    return found


def vjp(arguments):
    raise UsageError("vjp() is for arrays without autograd; call rasterize() on tensors, and backward() on what follows")


def jvp(arguments, tangents):
    raise UsageError("jvp() takes NumPy arrays; give .numpy() of tensors on the CPU")


# ---- the CPU ----


class _DrawExactly(torch.autograd.Function):
    @staticmethod
    def forward(ctx, arguments, names, drawn, *tensors):
        arrays = {name: tensor.detach().numpy() for name, tensor in zip(names, tensors)}
        rendering, ctx.pull = _numpy.vjp(replace(arguments, arrays=arrays))
        ctx.names, ctx.drawn = names, drawn
        drawn += [name for name, picture in rendering._asdict().items() if picture is not None]
        pictures = tuple(torch.from_numpy(getattr(rendering, name)) for name in drawn)
        ctx.mark_non_differentiable(*(picture for name, picture in zip(drawn, pictures) if name not in _PULLED))
        ctx.set_materialize_grads(False)
        return pictures

    @staticmethod
    @once_differentiable
    def backward(ctx, *gradients):
        given = {name: gradient.numpy() for name, gradient in zip(ctx.drawn, gradients) if gradient is not None}
        pulled = ctx.pull(**given)
        return None, None, None, *(torch.from_numpy(pulled[name]) for name in ctx.names)


_PULLED = ("image", "alpha", "depth", "inverse_depth", "features")


def _on_cpu(arguments):
    drawn = []  # names, which the call fills in
    pictures = _DrawExactly.apply(arguments, tuple(arguments.arrays), drawn, *arguments.arrays.values())
    return Rendering(**dict(zip(drawn, pictures)))


# ---- the GPU ----


def _pieces(device):
    return _gpu.Pieces(lambda count: torch.empty(count, dtype=torch.uint8, device=device), torch.Tensor.data_ptr)


def _addressable(tensor):
    """A tensor whose rows lie whole in memory, whatever is between them."""
    expected = 1
    for length, stride in zip(reversed(tensor.shape[1:]), reversed(tensor.stride()[1:])):
        if length != 1 and stride != expected:
            return tensor.contiguous()
        expected *= length
    return tensor


def _aligned(tensor):
    """A tensor without gaps, from a multiple of 16 bytes on."""
    tensor = tensor.contiguous()
    return tensor if tensor.data_ptr() % 16 == 0 else tensor.clone()


def _dense(name, tensor):
    """As kernels read it."""
    return (_aligned if name == "features" else torch.Tensor.contiguous if name in _gpu.MATRICES else _addressable)(tensor)


def _place(device):
    """The GPU and the stream of a call."""
    return device.index or 0, torch.cuda.current_stream(device).cuda_stream


def _addresses(tensors):
    return _gpu.addresses(tensors, lambda tensor: (tensor.data_ptr(), tensor.stride(0) if tensor.dim() else 0))


class _Draw(torch.autograd.Function):
    """One pass."""

    @staticmethod
    def forward(ctx, call, shapes, names, *tensors):
        ctx.call, ctx.shapes, ctx.names = call, shapes, names
        dense = [_dense(name, tensor) for name, tensor in zip(names, tensors)]
        device = tensors[0].device
        ctx.device, ctx.kept = device, _pieces(device)
        pictures = {name: torch.empty(shape, dtype=torch.int32 if name == "overflowed" else torch.float32, device=device)
                    for name, shape in shapes.items()}
        ctx.frame = GpuOperation(_addresses(dict(zip(names, dense))), call).draw(
            *_place(device), ctx.kept, _pieces(device), {name: picture.data_ptr() for name, picture in pictures.items()})
        ctx.save_for_backward(*dense, pictures.get("features"))
        ctx.set_materialize_grads(False)
        ctx.mark_non_differentiable(*(picture for name, picture in pictures.items() if name not in _gpu.PULLED))
        return tuple(pictures.values())

    @staticmethod
    @once_differentiable
    def backward(ctx, *by_outputs):
        by_pictures = {name: _aligned(by) for name, by in zip(ctx.shapes, by_outputs) if by is not None}
        *dense, features = ctx.saved_tensors
        dense = dict(zip(ctx.names, dense))
        wanted = [name for name, is_needed in zip(ctx.names, ctx.needs_input_grad[3:]) if is_needed]
        if not by_pictures:
            return (None,) * (3 + len(ctx.names))
        partial = ("sh", "sh_rest") if ctx.call["has_unused_sh"] else ()  # of which kernels write the degrees in use
        gradients = {name: (torch.zeros if name in partial else torch.empty)(
            dense[name].shape, dtype=torch.float32, device=dense[name].device) for name in wanted if name != "background"}
        device, addresses = ctx.device, {name: by.data_ptr() for name, by in by_pictures.items()}
        if features is not None:
            addresses["drawn_features"] = features.data_ptr()
        # Made anew, because hooks of saved tensors may have moved them.
        GpuOperation(_addresses(dense), ctx.call).pull_back(
            ctx.frame, *_place(device), _pieces(device), addresses, _addresses(gradients))
        if "background" in wanted:
            by_image = by_pictures.get("image")
            gradients["background"] = torch.zeros_like(dense["background"]) if by_image is None else (
                by_image * ctx.kept.view(ctx.frame.transmittance, by_image.shape[1:], torch.float32)).sum((1, 2))
        return None, None, None, *(gradients.get(name) for name in ctx.names)


def _is_deterministic(arguments):
    return torch.are_deterministic_algorithms_enabled() if arguments.deterministic is None else arguments.deterministic


def _call(arguments, view, settings, needs_gradients):
    call = {**settings, "has_unused_sh": _gpu.has_unused_sh(arguments), "for_backward": needs_gradients,
            "deterministic": _is_deterministic(arguments)}
    if arguments.cameras or arguments.lenses:
        call["camera"] = (arguments.cameras or arguments.lenses)[view]
    return call


def _on_gpu(arguments):
    _gpu.check(arguments)

    def draw(each):
        needs_gradients = torch.is_grad_enabled() and any(tensor.requires_grad for tensor in each.arrays.values())
        call = _call(arguments, each.view, each.settings, needs_gradients)
        return dict(zip(each.shapes, _Draw.apply(call, each.shapes, tuple(each.arrays), *each.arrays.values())))

    return _gpu.rendering(arguments, draw, torch, lambda tensor: tensor.to(torch.int32),
                          by_threes=_is_deterministic(arguments))
