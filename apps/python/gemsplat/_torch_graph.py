# SPDX-License-Identifier: Apache-2.0
"""rasterize() of PyTorch tensors where torch.compile records a graph: as one operator of torch.library.

The gradient draws the picture once more, so that the graph keeps nothing whose size the GPU alone knows.
"""

from __future__ import annotations

import torch

from ._arguments import SHAPES
from ._rasterize import Rendering, drawn
from ._torch import _PULLED, arrays_of, eagerly

_is_compiling = getattr(getattr(torch, "compiler", None), "is_compiling", lambda: False)
_SETTINGS = ("width", "height", "sh_degree", "near", "far", "blur", "antialiased", "blend_rule", "smooth", "max_instances",
             "deterministic")
_SCHEMA = ("str names, str outputs, SymInt width, SymInt height, SymInt? sh_degree, float near, float far, float? blur, "
           "bool antialiased, str blend_rule, bool smooth, SymInt max_instances, bool? deterministic")


def rasterize(given):
    """The Rendering of what rasterize() takes, by name."""
    if not _is_compiling():
        return drawn(given)
    if given["max_instances"] is None or given["cameras"] is not None or given["camera_model"] != "pinhole":
        return _drawn_eagerly(given)
    names = [name for name in SHAPES if given[name] is not None]
    arrays = arrays_of({name: given[name] for name in names})
    outputs = (given["outputs"],) if isinstance(given["outputs"], str) else given["outputs"]
    found = _drawn_names(names, outputs)
    pictures = _draw([arrays[name] for name in names], " ".join(names), " ".join(outputs), *[given[name] for name in _SETTINGS])
    if len(pictures) > len(found):
        found.append("overflowed")
    return Rendering(**{name: picture if name in _PULLED else picture.detach() for name, picture in zip(found, pictures)})


_drawn_eagerly = eagerly(drawn)


def _drawn_names(names, outputs):
    return [name for name in Rendering._fields if name in outputs or (name == "features" and name in names)]


def _by_name(names, arrays):
    return dict(zip(names.split(), arrays))


def _rendering(arrays, names, outputs, settings):
    """The pictures that were asked for, by name."""
    given = {**dict.fromkeys((*SHAPES, "cameras")), **_by_name(names, arrays), "outputs": outputs.split(),
             "camera_model": "pinhole"}
    rendering = drawn({**given, **dict(zip(_SETTINGS, settings))})
    return {name: picture for name, picture in rendering._asdict().items() if picture is not None}


def _draw_now(arrays, names, outputs, *settings):
    with torch.no_grad():
        pictures = _rendering(arrays, names, outputs, settings).values()
    return [picture.clone(memory_format=torch.contiguous_format) for picture in pictures]  # of memory of their own


def _draw_shapes(arrays, names, outputs, width, height, *_):
    given = _by_name(names, arrays)
    means, views = given["means"], given["viewmats"].shape[:-2]
    dtype = torch.float64 if means.dtype == torch.float64 else torch.float32
    picture, rows = (*views, height, width), (*views, means.shape[0])
    kinds = {"image": ((*picture, 3), dtype), "alpha": (picture, dtype), "depth": (picture, dtype),
             "inverse_depth": (picture, dtype), "visible": (rows, torch.bool), "radii": (rows, torch.int32),
             "means2d": ((*rows, 2), dtype), "depths": (rows, dtype), "conics": ((*rows, 3), dtype)}
    if "features" in given:
        kinds["features"] = (*picture, given["features"].shape[-1]), dtype
    asked = [kinds[name] for name in _drawn_names(given, outputs.split())]
    if means.device.type == "cuda":
        asked.append((views, torch.bool))
    return [means.new_empty(shape, dtype=dtype) for shape, dtype in asked]


def _pull_back_now(arrays, by, pulled, wanted, names, outputs, *settings):
    with torch.inference_mode(False), torch.enable_grad():  # autograd does not look into operators
        leaves = [array.detach().requires_grad_(name in wanted.split()) for name, array in zip(names.split(), arrays)]
        pictures = _rendering(leaves, names, outputs, settings)
        asked = [leaf for leaf in leaves if leaf.requires_grad]
        by_arrays = torch.autograd.grad([pictures[name] for name in pulled.split()], asked, by, allow_unused=True)
    return [torch.zeros_like(leaf) if by_leaf is None else by_leaf.contiguous() for leaf, by_leaf in zip(asked, by_arrays)]


def _pull_back_shapes(arrays, by, pulled, wanted, names, *_):
    given = _by_name(names, arrays)
    return [torch.empty_like(given[name], memory_format=torch.contiguous_format) for name in wanted.split()]


def _keep(ctx, inputs, output):
    arrays, *ctx.settings = inputs
    ctx.save_for_backward(*arrays)


def _backward(ctx, by_pictures):
    names, outputs, *_ = ctx.settings
    found = zip(_drawn_names(names.split(), outputs.split()), by_pictures)
    by = {name: gradient for name, gradient in found if name in _PULLED and gradient is not None}
    wanted = [name for name, is_needed in zip(names.split(), ctx.needs_input_grad[0]) if is_needed]
    gradients = {}
    if by and wanted:
        gradients = dict(zip(wanted, _pull_back(list(ctx.saved_tensors), list(by.values()), " ".join(by), " ".join(wanted),
                                                *ctx.settings)))
    return [gradients.get(name) for name in names.split()], *[None] * len(ctx.settings)


if hasattr(torch.library, "custom_op"):  # from 2.4 on
    _draw = torch.library.custom_op("gemsplat::rasterize", _draw_now, mutates_args=(), schema=f"(Tensor[] arrays, {_SCHEMA}) -> Tensor[]")
    _draw.register_fake(_draw_shapes)
    _draw.register_autograd(_backward, setup_context=_keep)
    _pull_back = torch.library.custom_op(
        "gemsplat::pull_back", _pull_back_now, mutates_args=(),
        schema=f"(Tensor[] arrays, Tensor[] by, str pulled, str wanted, {_SCHEMA}) -> Tensor[]")
    _pull_back.register_fake(_pull_back_shapes)
