# SPDX-License-Identifier: Apache-2.0
"""rasterize() for PyTorch tensors, which autograd differentiates: on a GPU by its kernels, in float32,
and on the CPU by the exact renderer. Nothing here is linked to PyTorch: kernels get addresses.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch.autograd.function import once_differentiable

from . import _gemsplat, _numpy
from ._arguments import is_per_view
from ._gemsplat import UsageError
from ._rasterize import Rendering

_SETTINGS = ("width", "height", "sh_degree", "near", "far", "blur", "antialiased", "blend_rule")
_SPLAT_NUMBERS = 12  # mean2d 2, conic 3, opacity, cutoff, color 3, variance_y, depth


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


def footprints(arguments, *rule):
    """Those of the first view, by name."""
    means = arguments.arrays["means"]
    if means.device.type == "cpu":
        arrays = {name: tensor.detach().numpy() for name, tensor in arguments.arrays.items()}
        found = _numpy.footprints(replace(arguments, arrays=arrays), *rule)
        return {name: torch.from_numpy(array).to(torch.int32 if name == "radii" else means.dtype)
                for name, array in found.items()}
    count = arguments.count
    found = {name: torch.empty((count, *row), dtype=torch.int32 if name == "radii" else torch.float32, device=means.device)
             for name, row in {"means2d": (2,), "depths": (), "conics": (3,), "compensations": (), "radii": (2,)}.items()}
    tensors = {name: tensor.contiguous() if name in _MATRICES else _addressable(tensor)
               for name, tensor in _of_view(arguments, 0).items()}
    operation = _gemsplat.GpuOperation(_addresses(tensors), count, _call(arguments, 0, tensors))
    operation.footprints(torch.cuda.current_stream(means.device).cuda_stream, *rule,
                         [tensor.data_ptr() for tensor in found.values()])
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


class _Pieces:
    """Memory that a call takes, in pieces, each of which is a tensor of bytes."""

    def __init__(self, device):
        self.device, self.tensors = device, []

    def __call__(self, count):
        self.tensors.append(torch.empty(count, dtype=torch.uint8, device=self.device))
        return self.tensors[-1].data_ptr()

    def view(self, address, dtype, *shape):
        """The tensor at an address within a piece."""
        size = torch.Size(shape).numel() * dtype.itemsize
        for piece in self.tensors:
            offset = address - piece.data_ptr()
            if 0 <= offset and offset + size <= piece.numel():
                return piece[offset:offset + size].view(dtype).view(shape)
        return torch.empty(shape, dtype=dtype, device=self.device)  # of nothing


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


def _addresses(tensors):
    """(address, numbers from row to row) by the kernels' names."""
    addresses = {}
    for name, tensor in tensors.items():
        address, stride = tensor.data_ptr(), tensor.stride(0) if tensor.dim() else 0
        if name == "sh":
            addresses["sh0"] = (address, stride)
            addresses["sh_rest"] = (address + 3 * tensor.element_size(), stride)
        else:
            addresses[name] = (address, stride)
    return addresses


class _Draw(torch.autograd.Function):
    """One view."""

    @staticmethod
    def forward(ctx, call, names, *tensors):
        ctx.call, ctx.names = call, names
        dense = [_aligned(tensor) if name == "features" else tensor.contiguous() if name in _MATRICES else _addressable(tensor)
                 for name, tensor in zip(names, tensors)]
        device = tensors[0].device
        ctx.kept = _Pieces(device)
        operation = _gemsplat.GpuOperation(_addresses(dict(zip(names, dense))), call["count"], call)
        pixels = call["height"], call["width"]
        shapes = {"image": (3, *pixels), "features": (*pixels, tensors[names.index("features")].shape[1] if call["features"] else 0)}
        pictures = [torch.empty(shapes.get(name, pixels), dtype=torch.float32, device=device)
                    if name in call["pictures"] or call["blends_depth"] and name == "depth" or call["features"] and name == "features"
                    else None for name in _DRAWN]
        ctx.frame = operation.draw(torch.cuda.current_stream(device).cuda_stream, ctx.kept, _Pieces(device),
                                   *(0 if picture is None else picture.data_ptr() for picture in pictures))
        ctx.save_for_backward(*dense, *pictures[3:])
        ctx.set_materialize_grads(False)
        known = _row_outputs(ctx.frame, ctx.kept, call)
        if call["max_instances"]:
            known.append(ctx.kept.view(ctx.frame.overflowed, torch.int32, 1)[0] != 0)
        ctx.mark_non_differentiable(*known)
        return *pictures, *known

    @staticmethod
    @once_differentiable
    def backward(ctx, *by_outputs):
        by_pictures = [None if by is None else _aligned(by) for by in by_outputs[:len(_DRAWN)]]
        *dense, features = ctx.saved_tensors
        dense = dict(zip(ctx.names, dense))
        wanted = [name for name, is_needed in zip(ctx.names, ctx.needs_input_grad[2:]) if is_needed]
        if all(by is None for by in by_pictures):
            return (None,) * (2 + len(ctx.names))
        partial = ("sh", "sh_rest") if ctx.call["has_unused_sh"] else ()  # of which kernels write the degrees in use
        gradients = {name: (torch.zeros if name in partial else torch.empty)(
            dense[name].shape, dtype=torch.float32, device=dense[name].device) for name in wanted if name != "background"}
        device = ctx.kept.device
        # Made anew, because hooks of saved tensors may have moved them.
        operation = _gemsplat.GpuOperation(_addresses(dense), ctx.call["count"], ctx.call)
        operation.pull_back(ctx.frame, torch.cuda.current_stream(device).cuda_stream, _Pieces(device),
                            *(0 if by is None else by.data_ptr() for by in (*by_pictures, features)), _addresses(gradients))
        if "background" in wanted:
            by_image = by_pictures[0]
            gradients["background"] = torch.zeros_like(dense["background"]) if by_image is None else (
                by_image * ctx.kept.view(ctx.frame.transmittance, torch.float32, *by_image.shape[1:])).sum((1, 2))
        return None, None, *(gradients.get(name) for name in ctx.names)


_MATRICES = ("viewmats", "Ks", "background")
_DEPTHS = ("depth", "inverse_depth")
_COLORS = ("colors", "sh", "sh0", "sh_rest", "background", "features")  # absent from passes of features
_DRAWN = ("image", "alpha", "depth", "features")  # what the kernels write; depth is either of _DEPTHS
_FEATURE_STEP = 4  # of the channels that the kernels take


def _row_outputs(frame, kept, call):
    """What was asked for of each Gaussian, with zeros where it is not visible."""
    if not call["rows"]:
        return []
    count = call["count"]
    visible = kept.view(frame.tile_counts, torch.int32, count) != 0
    splats = kept.view(frame.splats, torch.float32, count, _SPLAT_NUMBERS)

    def shown(rows):
        return torch.where(visible.view(-1, *(1,) * (rows.dim() - 1)), rows, rows.new_zeros(()))

    def radii():
        xx, xy, yy, cutoff = splats[:, 2], splats[:, 3], splats[:, 4], splats[:, 6]
        smallest = (xx + yy) / 2 - torch.hypot((xx - yy) / 2, xy)  # eigenvalue of the conic
        return shown(torch.sqrt(2 * cutoff / smallest).clamp(1, 1e9).ceil()).to(torch.int32)

    make = {"visible": lambda: visible, "radii": radii, "means2d": lambda: shown(splats[:, :2]),
            "depths": lambda: shown(1 / splats[:, 11] if call["inverse_depth"] else splats[:, 11]),
            "conics": lambda: shown(splats[:, 2:5])}
    return [make[name]() for name in call["rows"]]


def _on_gpu(arguments):
    if arguments.dtype != "float32":
        raise UsageError("a GPU draws tensors of float32; tensors of float64 are drawn on the CPU")
    if arguments.smooth:
        raise UsageError("smooth is for tensors on the CPU")
    if "depth" in arguments.pictures and "inverse_depth" in arguments.pictures:
        raise UsageError("a GPU draws depth or inverse_depth; call rasterize() for each of them")
    is_drawn = arguments.pictures or arguments.rows or arguments.max_instances or arguments.channels
    views = [_view(arguments, view) for view in range(arguments.views)] if is_drawn else []
    depth = "inverse_depth" if "inverse_depth" in arguments.pictures else "depth"
    names = arguments.rows + (("overflowed",) if arguments.max_instances else ())
    found = dict(zip(("image", "alpha", depth, "features") + names, zip(*views)))
    if "image" in arguments.pictures:
        found["image"] = [image.permute(1, 2, 0) for image in found["image"]]
    if arguments.channels:
        names += ("features",)
        if torch.are_deterministic_algorithms_enabled():
            found["features"] = [_features(arguments, view) for view in range(arguments.views)]
        else:
            found["features"] = [features[..., :arguments.channels] for features in found["features"]]
    return Rendering(**{name: torch.stack(found[name]) if arguments.has_view_axis else found[name][0]
                        for name in arguments.pictures + names})


def _of_view(arguments, view):
    """The tensors of a view by their names."""
    if not arguments.has_view_axis:
        return dict(arguments.arrays)
    return {name: tensor[view] if is_per_view(name, tensor) else tensor for name, tensor in arguments.arrays.items()}


def _view(arguments, view):
    """The pictures of _DRAWN, those not asked for as None, and what is known besides."""
    tensors = _of_view(arguments, view)
    features = tensors.pop("features", None)
    has_features = features is not None and not torch.are_deterministic_algorithms_enabled()
    if has_features:
        tensors["features"] = torch.nn.functional.pad(features, (0, -arguments.channels % _FEATURE_STEP))
    if arguments.color is None:
        tensors["colors"] = tensors["means"].new_zeros((1, 3)).expand(arguments.count, 3)
    depths = [name for name in _DEPTHS if name in arguments.pictures]
    return _drawn(arguments, view, tensors, pictures=arguments.pictures, rows=arguments.rows, blends_depth=bool(depths),
                  inverse_depth="inverse_depth" in depths, features=has_features)


def _features(arguments, view):
    """(H, W, D): the features of a view, three of them at a time as the colors of a pass whose sums have a fixed order."""
    tensors = _of_view(arguments, view)
    shared = {name: tensor for name, tensor in tensors.items() if name not in _COLORS}
    passes = []
    for first in range(0, arguments.channels, 3):
        colors = tensors["features"][:, first:first + 3]
        colors = torch.nn.functional.pad(colors, (0, 3 - colors.shape[1]))
        image, *_ = _drawn(arguments, view, {**shared, "colors": colors}, pictures=("image",))
        passes.append(image)
    return torch.cat(passes)[:arguments.channels].permute(1, 2, 0)


def _drawn(arguments, view, tensors, **what):
    """One call of the kernels for a view."""
    return _Draw.apply(_call(arguments, view, tensors, **what), tuple(tensors), *tensors.values())


def _call(arguments, view, tensors, **what):
    """How GpuOperation is to draw a view. `what`: its pictures, rows, blends_depth, inverse_depth and features."""
    call = {name: getattr(arguments, name) for name in _SETTINGS}
    coefficients = (tensors["sh"].shape[1] if "sh" in tensors
                    else 1 + tensors["sh_rest"].shape[1] if "sh_rest" in tensors else 1)
    call.update(pictures=(), rows=(), blends_depth=False, inverse_depth=False, features=False)
    call.update(what, count=arguments.count, device=tensors["means"].device.index or 0,
                max_instances=arguments.max_instances or 0, has_unused_sh=coefficients > (arguments.sh_degree + 1)**2,
                deterministic=torch.are_deterministic_algorithms_enabled(),
                for_backward=torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors.values()))
    if arguments.cameras:
        call["camera"] = arguments.cameras[view]
    return call
