# SPDX-License-Identifier: Apache-2.0
"""A drop-in for rasterization() of gsplat 1.4 to 1.6, by gemsplat.rasterize(); install() puts it into an installed gsplat.

docs/guide/compat.md says what differs. Shapes: any batch axes "...", C views, N Gaussians, pictures of H x W pixels.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import itertools
import math
import sys
from typing import Optional

import torch

from .. import UsageError
from .._arguments import CAMERA_MODELS
from .._rasterize import CheckedView, Footprints
from .._torch import eagerly
from . import _harmonics, _report
from ._meta import Meta
from ._screen import AbsoluteTap, ScreenTap

APIS = ("1.4", "1.5", "1.6")
_MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
_ARRAYS = ("means", "quats", "scales", "covars", "opacities", "colors", "viewmats", "Ks", "backgrounds")
_TILE = 16  # pixels
_WITHOUT_EFFECT = ("global_z_order",)
_OF_GSPLAT = ("DefaultStrategy", "MCMCStrategy", "Strategy", "SelectiveAdam", "PngCompression", "rasterization_2dgs",
              "fully_fused_projection", "rasterize_to_pixels", "isect_tiles", "isect_offset_encode", "spherical_harmonics",
              "quat_scale_to_covar_preci", "compute_relocation", "proj", "world_to_cam", "accumulate", "export_splats")

api: Optional[str] = None  # of APIS, as install() was asked for; None: that of the installed gsplat
rendering = sys.modules[__name__]
_originals = []  # (module, its rasterization), which patch() has replaced


class _SparseGradient(torch.autograd.Function):
    """A tensor (N, ...) whose gradient is a sparse tensor of some rows."""

    @staticmethod
    def forward(ctx, tensor, rows):
        ctx.save_for_backward(rows)
        return tensor.view_as(tensor)

    @staticmethod
    def backward(ctx, gradient):
        rows, = ctx.saved_tensors
        return torch.sparse_coo_tensor(rows[None], gradient[rows], gradient.shape), None


@eagerly
def rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height, near_plane=0.01, far_plane=1e10,
                  radius_clip=0.0, eps2d=0.3, sh_degree=None, packed=True, tile_size=_TILE, backgrounds=None, render_mode="RGB",
                  sparse_grad=False, absgrad=False, rasterize_mode="classic", channel_chunk=32, distributed=False,
                  camera_model="pinhole", segmented=False, covars=None, renderer_config=None, **others):
    """Pictures (..., C, H, W, X), alphas (..., C, H, W, 1), and a dict of what is known of each Gaussian.

    means (..., N, 3), quats (..., N, 4), scales (..., N, 3), or covars (..., N, 3, 3); opacities (..., N).
    colors: (..., N, D) or (..., C, N, D); with sh_degree (..., N, K, 3) or (..., C, N, K, 3).
    viewmats (..., C, 4, 4) from world to camera, Ks (..., C, 3, 3), backgrounds (..., C, D).
    render_mode: RGB, D (sums of weights times depths), ED (their mean), RGB+D or RGB+ED, whose depth is the last channel.
    absgrad: backward() sets the attribute absgrad of the dict's means2d, sums of absolute values of pixels.
    packed: the dict has the Gaussians of all pictures one behind the other, for which the host waits for the GPU.
    sparse_grad: with packed and without batch axes, means, quats and scales get sparse gradients of the Gaussians that are seen.

    channel_chunk, segmented, global_z_order and a renderer_config of mixed batches have no effect. What gemsplat does not draw
    is passed to an installed gsplat; without one it throws NotImplementedError, which names the argument.
    """
    given = dict(locals())
    del given["others"]
    reason = _reason_to_pass(given, others)
    if reason:
        return _pass_on(reason, given, others)
    _report.count("gsplat.rasterization")
    batch, views = means.shape[:-2], viewmats.shape[-3]
    if sh_degree is not None and colors is not None and batch and colors.dim() == 3:
        given["colors"] = colors.expand(*batch, *colors.shape)  # gsplat 1.6 has them in common
    _check_shapes(given, batch, means.shape[-2], views)
    flat = {name: None if given[name] is None else given[name].reshape(math.prod(batch), *given[name].shape[len(batch):])
            for name in _ARRAYS}
    settings = {"width": width, "height": height, "near": near_plane, "far": far_plane, "blur": eps2d,
                "antialiased": rasterize_mode == "antialiased", "camera_model": camera_model}
    places = list(itertools.product(range(len(flat["means"])), range(views)))
    scenes = [_scene_of(flat, b, c, sh_degree, render_mode, settings) for b, c in places]
    rows = _rows(flat, scenes, radius_clip, rasterize_mode)
    is_seen = rows["radii"] > 0 if rows["radii"].dim() == 3 else (rows["radii"] > 0).all(-1)
    is_differentiated = torch.is_grad_enabled() and any(tensor is not None and tensor.requires_grad for tensor in flat.values())
    meta, taps = _meta_of(rows, is_seen, batch, packed, is_differentiated, absgrad)
    meta.update(width=width, height=height, tile_size=_TILE, tile_width=math.ceil(width / _TILE),
                tile_height=math.ceil(height / _TILE), n_batches=len(flat["means"]), n_cameras=views)
    sparse = {}  # in place of what was given
    if sparse_grad and packed and not batch:
        seen = is_seen[0].any(0).nonzero()[:, 0]
        sparse = {name: _SparseGradient.apply(given[of_gsplat], seen)
                  for name, of_gsplat in (("means", "means"), ("rotations", "quats"), ("scales", "scales"))
                  if given[of_gsplat] is not None}
    pairs = []
    for (b, c), scene in zip(places, scenes):
        arrays = {**sparse, **{name: _part(_part(tap, b), c) for name, tap in taps.items()}}
        if radius_clip > 0:
            opacities = _part(flat["opacities"], b)
            arrays["opacities"] = torch.where(is_seen[b, c], opacities, opacities.new_zeros(()))
        background = None if flat["backgrounds"] is None else flat["backgrounds"][b, c]
        pairs.append(_picture(scene.draw(**arrays), background, render_mode))
    pictures, alphas = (_stacked(each).view(*batch, views, *each[0].shape) for each in zip(*pairs))
    return pictures, alphas, meta


def patch():
    """Replaces rasterization() of the installed gsplat; False where there is none."""
    package = _installed()
    if package is None:
        return False
    if not _originals:
        for module in (package, importlib.import_module("gsplat.rendering")):
            _originals.append((module, module.rasterization))
            module.rasterization = rasterization
    return True


def unpatch():
    """Gives back what patch() has replaced."""
    for module, original in _originals:
        module.rasterization = original
    _originals.clear()


def __getattr__(name):
    package = None if name.startswith("__") else _installed()
    if package is not None:
        return getattr(package, name)
    if name in _OF_GSPLAT:
        raise ImportError(f"{name} is gsplat's own, and gsplat is not installed; "
                          "gemsplat.compat has rasterization alone")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _installed():
    """The package gsplat, or None."""
    try:
        package = importlib.import_module("gsplat")
    except ModuleNotFoundError as error:
        if error.name != "gsplat":
            raise
        return None
    return None if package is sys.modules[__name__] else package


def _api():
    if api:
        return api
    version = str(getattr(_originals[0][0], "__version__", APIS[-1])) if _originals else APIS[-1]
    return next((known for known in APIS if version.startswith(known)), APIS[-1])


def _reason_to_pass(given, others):
    """What of a call gemsplat does not draw, as it was given; None: it draws all."""
    drawn = {"camera_model": CAMERA_MODELS, "render_mode": _MODES, "rasterize_mode": ("classic", "antialiased"),
             "tile_size": (_TILE, None), "distributed": (False,)}
    for name, values in drawn.items():
        if given[name] not in values:
            return f"{name}={given[name]!r}"
    if type(given["renderer_config"]).__name__ not in ("NoneType", "RendererConfig_MixedBatch"):
        return "renderer_config"
    known = _parameters_of(_originals[0][1]) if _originals else {}
    for name, value in others.items():
        is_default = value is None or value is False or (name in known and value is known[name].default)
        if not is_default and name not in _WITHOUT_EFFECT:
            return name
    return None


@functools.lru_cache
def _parameters_of(function):
    return inspect.signature(function).parameters


def _pass_on(reason, given, others):
    package = _installed()
    if package is None:
        raise NotImplementedError(f"gemsplat does not draw {reason}; where gsplat is installed, such calls are passed to it")
    _report.count("gsplat.rasterization", reason)
    original = _originals[0][1] if _originals else package.rasterization
    defaults = inspect.signature(rasterization).parameters
    return original(**{name: value for name, value in given.items() if value is not defaults[name].default}, **others)


def _check_shapes(given, batch, count, views):
    wanted = {"means": (count, 3), "opacities": (count,), "viewmats": (views, 4, 4), "Ks": (views, 3, 3)}
    wanted.update({"quats": (count, 4), "scales": (count, 3)} if given["covars"] is None else {"covars": (count, 3, 3)})
    for name, shape in wanted.items():
        if tuple(given[name].shape) != (*batch, *shape):
            raise UsageError(f"{name} must have the shape {(*batch, *shape)}, but has {tuple(given[name].shape)}")
    if "RGB" not in given["render_mode"]:
        return
    shape, degree = tuple(given["colors"].shape[len(batch):]), given["sh_degree"]
    of_one = shape[1:] if len(shape) == (3 if degree is None else 4) and shape[0] == views else shape
    if of_one[:1] != (count,) or len(of_one) != (2 if degree is None else 3):
        last = "D" if degree is None else "K, 3"
        raise UsageError(f"colors must have the shape (..., {count}, {last}) or (..., {views}, {count}, {last}), but has "
                         f"{tuple(given['colors'].shape)}; with sh_degree they are coefficients")
    if degree is not None and of_one[1] < (degree + 1)**2:
        raise UsageError(f"colors must have {(degree + 1)**2} coefficients or more for sh_degree={degree}, but have {of_one[1]}")


def _rows(flat, scenes, clip, rasterize_mode):
    """What the dict tells of each Gaussian in each picture, (B, C, N, ...) by name: radii of gsplat 1.4 have no last axis."""
    shape = "square" if _api() == "1.4" else "box"
    with torch.no_grad():
        parts = [scene.footprints(shape, clip=clip) for scene in scenes]
        pictures = flat["viewmats"].shape[:2]
        rows = {name: _stacked(part).view(*pictures, *part[0].shape)
                for name, part in zip(Footprints._fields, zip(*parts))}
        opacities = flat["opacities"][:, None].expand(rows["depths"].shape)
        compensations = rows.pop("compensations")
        rows["opacities"] = opacities * compensations if rasterize_mode == "antialiased" else opacities
        if shape == "square":
            rows["radii"] = rows["radii"][..., 0]
        return rows


def _part(tensor, index):
    """tensor[index], whose gradient is no copy where there is one part alone."""
    return tensor.squeeze(0) if len(tensor) == 1 else tensor[index]


def _stacked(tensors):
    return torch.stack(tensors) if len(tensors) > 1 else tensors[0][None]


def _shape_of(flat, b):
    """Of rasterize(): scales and rotations, or covariances."""
    if flat["covars"] is None:
        return {"scales": _part(flat["scales"], b), "rotations": _part(flat["quats"], b)}
    covars = _part(flat["covars"], b)
    return {"covariances": torch.stack([covars[:, row, column] for row in range(3) for column in range(row, 3)], -1)}


def _meta_of(rows, is_seen, batch, packed, is_differentiated, absgrad):
    """The dict, and the screens of rasterize() by name (B, C, N, 2), by which its means2d gets gradients."""
    with torch.no_grad():
        ids = is_seen.nonzero(as_tuple=True) if packed else (None,) * 3
        shown = {name: value[ids] if packed else value.reshape(*batch, *value.shape[1:]) for name, value in rows.items()}
    meta = Meta((*batch, is_seen.shape[1]), batch_ids=ids[0], camera_ids=ids[1], gaussian_ids=ids[2], **shown)
    if not is_differentiated:
        return meta, {}
    means2d = meta["means2d"].requires_grad_()
    taps = {"screen": ScreenTap.apply(means2d, (1, 1)), **({"absolute_screen": AbsoluteTap.apply(means2d)} if absgrad else {})}
    if packed:
        taps = {name: tap.new_zeros((*is_seen.shape, 2)).index_put(ids, tap) for name, tap in taps.items()}
    return meta, {name: tap.reshape(*is_seen.shape, 2) for name, tap in taps.items()}


def _scene_of(flat, b, c, degree, render_mode, settings):
    """One picture. Colors of other than three channels are features, which have no background of their own."""
    viewmat = flat["viewmats"][b, c]
    arrays = {"means": _part(flat["means"], b), **_shape_of(flat, b), "opacities": _part(flat["opacities"], b),
              "viewmats": viewmat, "Ks": flat["Ks"][b, c]}
    outputs = ["alpha"]
    if "RGB" in render_mode:
        colors = _part(flat["colors"], b)
        if colors.dim() == (3 if degree is None else 4):
            colors = _part(colors, c)
        if degree is not None and degree <= 3 and colors.shape[-1] == 3:
            arrays.update(sh=colors if colors.shape[1] in (1, 4, 9, 16) else colors[:, :(degree + 1)**2], sh_degree=degree)
        elif degree is not None:
            center = -(viewmat[:3, :3] * viewmat[:3, 3, None]).sum(0)
            colors = (_harmonics.evaluate(degree, arrays["means"] - center, colors) + 0.5).clamp_min(0)
        if colors.shape[-1] == 3:
            outputs.append("image")
            if "sh" not in arrays:
                arrays["colors"] = colors
            if flat["backgrounds"] is not None:
                arrays["background"] = flat["backgrounds"][b, c]
        else:
            arrays["features"] = colors
    if "D" in render_mode:
        outputs.append("depth")
    return CheckedView(outputs=outputs, blend_rule="classic", **arrays, **settings)


def _picture(found, background, render_mode):
    """(H, W, X) and alpha (H, W, 1)."""
    alpha, channels = found.alpha[..., None], []
    if found.features is not None:
        channels.append(found.features if background is None else found.features + (1 - alpha) * background)
    elif found.image is not None:
        channels.append(found.image)
    if "D" in render_mode:
        depth = found.depth[..., None]
        channels.append(depth / alpha.clamp_min(1e-10) if "ED" in render_mode else depth)
    return channels[0] if len(channels) == 1 else torch.cat(channels, -1), alpha
