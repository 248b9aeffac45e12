# SPDX-License-Identifier: Apache-2.0
"""What the kernels of a GPU draw in one call, and a Rendering of several calls, for every kind of array.

`xp` is the module of a framework's functions on arrays: torch, cupy or jax.numpy. Nothing here is
linked to one: kernels get addresses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, Optional, Tuple

from ._arguments import is_per_view
from ._gemsplat import GPU_ROW_NUMBERS, UsageError
from ._rasterize import Rendering

_SETTINGS = ("count", "width", "height", "sh_degree", "near", "far", "blur", "antialiased", "blend_rule")
_DEPTHS = ("depth", "inverse_depth")
_COLORS = ("colors", "sh", "sh0", "sh_rest", "background")  # absent from passes of three features
_FEATURE_STEP = 4  # of the channels that the kernels take
MATRICES = ("viewmats", "Ks", "background")  # whose rows have no gaps
PULLED = ("image", "alpha", "depth", "features")  # what has gradients


@dataclass(frozen=True)
class Pass:
    """One call of the kernels."""

    settings: Dict[str, Any]  # by name, for GpuOperation
    shapes: Dict[str, Tuple[int, ...]]  # of what is drawn, by name
    arrays: Dict[str, Any]  # what it is drawn from
    view: int
    first_feature: Optional[int] = None  # of three that are drawn as colors


class Pieces:
    """Memory that a call takes, in pieces: arrays of bytes that `empty` makes of a count."""

    def __init__(self, empty, address_of):
        self._empty, self._address_of, self._arrays = empty, address_of, []

    def __call__(self, count):
        self._arrays.append(self._empty(count))
        return self._address_of(self._arrays[-1])

    def view(self, address, shape, float32):
        """The numbers at an address within a piece."""
        size = 4 * math.prod(shape)
        piece = next(piece for piece in self._arrays if 0 <= address - self._address_of(piece) <= len(piece) - size)
        offset = address - self._address_of(piece)
        return piece[offset:offset + size].view(float32).reshape(shape)


def check(arguments):
    """Throws UsageError where the kernels do not draw what the exact renderer does."""
    if arguments.dtype != "float32":
        raise UsageError("a GPU draws arrays of float32; arrays of float64 are drawn on the CPU")
    if arguments.smooth:
        raise UsageError("smooth is for arrays on the CPU")
    check_depths(arguments)


def check_depths(arguments):
    if "depth" in arguments.pictures and "inverse_depth" in arguments.pictures:
        raise UsageError("a GPU draws depth or inverse_depth; call rasterize() for each of them")


def rendering(arguments, draw, xp, as_int32, by_threes=False):
    """The Rendering of `draw`, which takes a Pass and returns arrays by the names of its shapes.

    by_threes: features are drawn as the colors of passes of their own, whose sums can have a fixed order.
    """
    views = [_of_view(arguments, view, draw, xp, as_int32, by_threes) for view in range(arguments.views)]
    return Rendering(**{name: xp.stack([found[name] for found in views]) if arguments.has_view_axis else views[0][name]
                        for name in views[0]})


def addresses(arrays, address_of):
    """(address, numbers from row to row) by the kernels' names. `address_of` gives both of an array."""
    found = {name: address_of(array) for name, array in arrays.items()}
    if "sh" in found:
        address, stride = found.pop("sh")
        found.update(sh0=(address, stride), sh_rest=(address + 12, stride))  # 3 numbers of 4 bytes
    return found


def padded(array, channels, xp):
    """With zeros behind the last axis, up to so many channels."""
    missing = channels - array.shape[-1]
    return xp.concatenate([array] + [xp.zeros_like(array[..., :1])] * missing, -1) if missing else array


def arrays_of_view(arguments, view):
    """Without the axis C."""
    return {name: array[view] if is_per_view(name, array) else array for name, array in arguments.arrays.items()}


def settings_of(arguments, pictures=()):
    """How GpuOperation is to draw; each framework adds for_backward, deterministic and the camera."""
    depths = [name for name in pictures if name in _DEPTHS]
    settings = {name: getattr(arguments, name) for name in _SETTINGS}
    return {**settings, "max_instances": arguments.max_instances or 0, "blends_depth": bool(depths),
            "inverse_depth": "inverse_depth" in depths}


def _of_view(arguments, view, draw, xp, as_int32, by_threes):
    """What was asked for, by the names of Rendering, without the axis C."""
    found, size = {}, (arguments.height, arguments.width)
    arrays = arrays_of_view(arguments, view)
    features = arrays.pop("features", None)
    if features is not None and not by_threes:
        arrays["features"] = padded(features, -(-arguments.channels // _FEATURE_STEP) * _FEATURE_STEP, xp)
    if arguments.pictures or arguments.rows or arguments.max_instances or "features" in arrays:
        colors = {"colors": xp.zeros_like(arrays["means"])} if arguments.color is None else {}
        settings = settings_of(arguments, arguments.pictures)
        shapes = {"image": (3, *size), "alpha": size, "depth": size, "rows": (arguments.count, GPU_ROW_NUMBERS),
                  "features": (*size, arrays["features"].shape[-1] if "features" in arrays else 0), "overflowed": (1,)}
        wanted = {"image": "image" in arguments.pictures, "alpha": "alpha" in arguments.pictures,
                  "depth": settings["blends_depth"], "rows": arguments.rows, "features": "features" in arrays,
                  "overflowed": arguments.max_instances}
        drawn = draw(Pass(settings, {name: shape for name, shape in shapes.items() if wanted[name]}, {**arrays, **colors}, view))
        if "image" in drawn:
            found["image"] = xp.moveaxis(drawn["image"], 0, -1)
        if "alpha" in drawn:
            found["alpha"] = drawn["alpha"]
        if "depth" in drawn:
            found["inverse_depth" if settings["inverse_depth"] else "depth"] = drawn["depth"]
        if "features" in drawn:
            found["features"] = drawn["features"][..., :arguments.channels]
        if arguments.rows:
            rows = drawn["rows"]
            known = {"visible": rows[:, 0] != 0, "radii": as_int32(rows[:, 1]), "means2d": rows[:, 2:4],
                     "depths": rows[:, 4], "conics": rows[:, 5:8]}
            found.update({name: known[name] for name in arguments.rows})
        if "overflowed" in drawn:
            found["overflowed"] = drawn["overflowed"][0] != 0
    if features is not None and by_threes:
        shared = {name: array for name, array in arrays.items() if name not in _COLORS}
        images = [draw(Pass(settings_of(arguments), {"image": (3, *size)},
                            {**shared, "colors": padded(features[:, first:first + 3], 3, xp)}, view, first))["image"]
                  for first in range(0, arguments.channels, 3)]
        found["features"] = xp.moveaxis(xp.vstack(images)[:arguments.channels], 0, -1)
    return found


def has_unused_sh(arguments):
    """Whether there are coefficients of higher degrees, of which kernels write no gradients."""
    arrays = arguments.arrays
    coefficients = (arrays["sh"].shape[1] if "sh" in arrays
                    else 1 + arrays["sh_rest"].shape[1] if "sh_rest" in arrays else 1)
    return coefficients > (arguments.sh_degree + 1)**2
