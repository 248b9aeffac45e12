# SPDX-License-Identifier: Apache-2.0
"""Pictures of Gaussians and their derivatives, from arrays: rasterize(), vjp() and jvp().

_arguments.py checks what they take. A module for each kind of array does the rest.
"""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any, Callable, Iterable, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arguments import SHAPES, check
from ._gemsplat import Camera, UsageError


class Rendering(NamedTuple):
    """The result of rasterize(): C pictures of H x W pixels of N Gaussians.

    Floats are of the dtype of means. What was not asked for is None. Where one camera came, and not a
    list, nothing has the axis C.

    image: (C, H, W, 3), the colors over the background. alpha: (C, H, W), how much of a pixel the
    Gaussians cover, 0 to 1. depth: (C, H, W), the sum of weights times depths along the viewing axis,
    world units; depth / alpha is the mean. inverse_depth: (C, H, W), the sum of weights over depths.
    features: (C, H, W, D), the sum of weights times features.

    The others have zeros where a Gaussian is not visible. visible: (C, N), whether its ellipse, outside
    of which it is not drawn, meets a tile of 16 pixels of the picture. radii: (C, N) int32, half the
    longer axis of the ellipse, rounded up, pixels. means2d: (C, N, 2), pixels. depths: (C, N), world
    units. conics: (C, N, 3), xx xy yy of the inverse covariance in the picture, 1 / pixels^2. With
    smooth ellipses are of four standard deviations, and visible is all that can be projected.

    overflowed: (C,) bool, only of a GPU with max_instances.
    """

    image: Any = None
    alpha: Any = None
    depth: Any = None
    inverse_depth: Any = None
    features: Any = None
    visible: Any = None
    radii: Any = None
    means2d: Any = None
    depths: Any = None
    conics: Any = None
    overflowed: Any = None


def rasterize(means: ArrayLike, rotations: Optional[ArrayLike] = None, *, scales: Optional[ArrayLike] = None,
              log_scales: Optional[ArrayLike] = None, covariances: Optional[ArrayLike] = None,
              opacities: Optional[ArrayLike] = None, logit_opacities: Optional[ArrayLike] = None,
              colors: Optional[ArrayLike] = None, sh0: Optional[ArrayLike] = None, sh_rest: Optional[ArrayLike] = None,
              sh: Optional[ArrayLike] = None, features: Optional[ArrayLike] = None,
              cameras: Union[None, Camera, Iterable[Camera]] = None, viewmats: Optional[ArrayLike] = None,
              Ks: Optional[ArrayLike] = None, width: Optional[int] = None, height: Optional[int] = None,
              camera_model: str = "pinhole", background: Optional[ArrayLike] = None, screen: Optional[ArrayLike] = None,
              absolute_screen: Optional[ArrayLike] = None, sh_degree: Optional[int] = None, outputs: Union[str, Sequence[str]] = ("image",), near: float = 0.2,
              far: float = 10000.0, blur: Optional[float] = None, antialiased: bool = False,
              blend_rule: str = "faster_gs", smooth: bool = False, max_instances: Optional[int] = None,
              deterministic: Optional[bool] = None) -> Rendering:
    """Draws N Gaussians in C views. vjp() and jvp() differentiate it by every array.

    NumPy arrays are drawn on the CPU by the exact renderer, each Gaussian at each pixel, in float64.
    Arrays of float32 are computed in float64, too, and give float32. docs/guide/differentiable.md has
    programs.

    The Gaussians; of each pair or three that is named with "or", one is given:

    means: (N, 3), world units.
    rotations: (N, 4), w x y z, of any length; absent with covariances.
    scales, log_scales or covariances: (N, 3), standard deviations in world units, or their logarithms;
    or (N, 6), the upper triangle of the world covariance, row by row, world units^2.
    opacities or logit_opacities: (N,) or (N, 1), 0 to 1, or their logits.
    colors, sh0 or sh: (N, 3) or (C, N, 3), used as they are; or coefficients of spherical harmonics of
    degree 0 to 3, in sh (N, K, 3), or in sh0 (N, 3) and sh_rest (N, K - 1, 3), which may be absent.
    Absent where outputs does not name image.
    sh_degree: the degree in use, by default that of the coefficients.
    features: (N, D) or (C, N, D), any numbers, which are blended, too.

    The views, by cameras or by matrices. Of one Camera, or of matrices without the axis C, nothing has
    that axis:

    cameras: a Camera, or a list of C with pictures of one size, each through its lens.
    viewmats: (C, 4, 4), from world to camera coordinates. The last row is not read.
    Ks: (C, 3, 3), with fx, fy, cx and cy in pixels. Other entries are not read.
    width, height: of the pictures, pixels.
    camera_model: how matrices project: pinhole; fisheye, equidistant, of what lies in front of the camera; or
    ortho, parallel rays, with fx and fy in pixels per world unit. A Camera with a fisheye sees all around.
    background: (3,) or (C, 3), by default black. Features have none behind them.
    screen: (C, N, 2), added to the projected means, pixels: zeros, to get the gradient by these means.
    absolute_screen: (C, N, 2), not read. In place of a gradient it gets the sum of the absolute values of
    what each pixel adds to that by the projected means (Ye et al. 2024).

    How it is drawn:

    outputs: names of image, alpha, depth, inverse_depth, visible, radii, means2d, depths and conics.
    near, far: what is drawn, along the viewing axis, world units.
    antialiased: lowers the opacity of what the blur makes larger, as in Yu et al. 2024.
    blur: added to the covariance in the picture, pixels^2; by default 0.3, or 0.1 with antialiased.
    blend_rule: faster_gs; or classic, as in Kerbl et al. 2023, where alpha is at most 0.99.
    smooth: drops no fragment for being faint or hidden, and clamps no alpha, so that finite differences
    find no jumps.
    max_instances: the most pairs of a Gaussian and a tile of 16 pixels that it meets, for which a GPU has
    room. Nothing then waits for the GPU, and CUDA graphs can record the call. Where there are more,
    overflowed is True, pictures lack Gaussians, and gradients are zero. By default they are counted.
    deterministic: gradients of a GPU have the same bits each time, and features take a pass for three of
    them. None: where torch.use_deterministic_algorithms() says so. The CPU's always have.

    Rows that cannot be drawn, such as those with NaN, are not visible. Throws UsageError, which names
    the argument.
    """
    given = {"means": means, "rotations": rotations, "scales": scales, "log_scales": log_scales, "covariances": covariances,
             "opacities": opacities, "logit_opacities": logit_opacities, "colors": colors, "sh0": sh0, "sh_rest": sh_rest, "sh": sh,
             "features": features, "cameras": cameras, "camera_model": camera_model, "viewmats": viewmats, "Ks": Ks, "width": width, "height": height,
             "background": background, "screen": screen, "absolute_screen": absolute_screen, "sh_degree": sh_degree,
             "outputs": outputs, "near": near, "far": far, "blur": blur, "antialiased": antialiased, "blend_rule": blend_rule,
             "smooth": smooth, "max_instances": max_instances, "deterministic": deterministic}
    if _module_of(means) == "torch":
        from . import _torch_graph

        return _torch_graph.rasterize(given)
    return drawn(given)


def drawn(given):
    """The Rendering of what rasterize() takes, by name."""
    backend, arguments = _prepared(given)
    return backend.rasterize(arguments)


def _prepared(given):
    """The module for the arrays, and Arguments."""
    backend = _backend_of(given["means"])
    arrays = backend.arrays_of({name: given[name] for name in SHAPES if given[name] is not None})
    return backend, check({**given, **arrays})


def _backend_of(means):
    if isinstance(means, (np.ndarray, list, tuple)):
        from . import _numpy

        return _numpy
    kind, module = type(means), _module_of(means)
    if module == "torch":
        from . import _torch

        return _torch
    if module in ("jax", "jaxlib"):
        from . import _jax

        return _jax
    if module == "cupy":
        from . import _cupy

        return _cupy
    raise UsageError(f"means is a {kind.__module__}.{kind.__qualname__}, which cannot be drawn; give a NumPy array, such as "
                     "numpy.asarray(means)")


def _module_of(array):
    return type(array).__module__.partition(".")[0]


_SIGNATURE = inspect.signature(rasterize)
_DEFAULTS = {name: parameter.default for name, parameter in _SIGNATURE.parameters.items()}


def _bound(*places, **keywords):
    bound = _SIGNATURE.bind(*places, **keywords)
    bound.apply_defaults()
    return _prepared(bound.arguments)


def vjp(*places, **keywords):
    """The Rendering, and a function that pulls gradients back through it (reverse mode).

    Takes what rasterize() takes. Returns (rendering, pull). With L a function of the pictures,

        pull(image=None, alpha=None, depth=None, inverse_depth=None, features=None)

    takes dL by each of them, in their shapes, and returns a dict of dL by every array that was given,
    by its name and in its shape. What the pictures do not depend on has zeros: Gaussians that are not
    visible, and entries that are not read. pull may be called several times.
    """
    backend, arguments = _bound(*places, **keywords)
    return backend.vjp(arguments)


vjp.__signature__ = _SIGNATURE.replace(return_annotation="Tuple[Rendering, Callable[..., dict[str, NDArray[Any]]]]")


def jvp(arguments: Mapping[str, Any], tangents: Mapping[str, ArrayLike]) -> Tuple[Rendering, Rendering]:
    """The Rendering, and how its pictures change with the arrays (forward mode, by dual numbers).

    arguments: what rasterize() takes, by name. tangents: changes of arrays, by their names and in their
    shapes; absent ones are zeros. The second Rendering has the derivative of each picture along these
    changes, and None for what is known of each Gaussian.
    """
    backend, checked = _bound(**arguments)
    return backend.jvp(checked, tangents)


def photometric_loss(image: Any, target: Any, *, ssim_weight: float = 0.2, padding: str = "same") -> Any:
    """(1 - ssim_weight) mean|image - target| + ssim_weight (1 - mean SSIM), a scalar (Kerbl et al. 2023, Eq. 7).

    image, target: tensors of PyTorch (..., H, W, C) with values from 0 to 1, such as Rendering.image. On a GPU two kernels
    compute it and its gradient, which is by image alone.
    padding: same, where zeros lie around the pictures; or valid, where windows that reach beyond them do not count.
    """
    if _module_of(image) != "torch":
        raise UsageError(f"image must be a tensor of PyTorch, and not a {type(image).__name__}")
    from . import _loss

    return _loss.photometric_loss(image, target, ssim_weight, padding)


class Footprints(NamedTuple):
    """N Gaussians in one picture by the rules of another rasterizer; zeros where one is not visible.

    means2d: (N, 2), pixels. depths: (N,), world units. conics: (N, 3), xx xy yy of the inverse covariance, 1 / pixels^2.
    compensations: (N,), what antialiasing multiplies opacities with (Yu et al. 2024). radii: (N, 2) int32, pixels.
    """

    means2d: Any
    depths: Any
    conics: Any
    compensations: Any
    radii: Any


class CheckedView:
    """What rasterize() takes for one view, checked once: for drop-ins, which ask for pictures and footprints of it."""

    def __init__(self, **given):
        self._backend, self._arguments = _prepared({**_DEFAULTS, **given})

    def draw(self, **arrays):
        """The Rendering, with these arrays, unless they are None, beside those given or in their place. Shapes are not checked."""
        arrays = {**self._arguments.arrays, **{name: array for name, array in arrays.items() if array is not None}}
        return self._backend.rasterize(replace(self._arguments, arrays=arrays))

    def footprints(self, shape, *, clip=0.0, tile=1, names=Footprints._fields):
        """Footprints, of which only `names` may be read, without gradients and without waiting for a GPU.

        shape: square, of three standard deviations of the longer axis whatever the opacity (Kerbl et al. 2023); or box, around
        the ellipse outside of which no fragment is drawn. A Gaussian is visible where either of its radii is above `clip`, and
        the shape meets the picture, completed to whole tiles of so many pixels.
        """
        found = self._backend.footprints(self._arguments, names, shape, float(clip), tile)
        return Footprints(**{name: found.get(name) for name in Footprints._fields})
