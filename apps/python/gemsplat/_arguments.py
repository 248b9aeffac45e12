# SPDX-License-Identifier: Apache-2.0
"""The arguments of rasterize() and of its derivatives, checked for every framework alike.

Arrays pass through unchanged: only their `shape` and `dtype` are read, and never their values.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import index
from typing import Any, Mapping, Optional, Tuple

import numpy as np

from ._gemsplat import MOST_PIXELS, Camera, UsageError, camera_of_model

PICTURES = ("image", "alpha", "depth", "inverse_depth")
ROWS = ("visible", "radii", "means2d", "depths", "conics")  # known of each Gaussian, without derivatives
BLEND_RULES = ("faster_gs", "classic")
CAMERA_MODELS = ("pinhole", "fisheye", "ortho")  # of matrices, as gsplat names them
BLUR, BLUR_ANTIALIASED = 0.3, 0.1  # pixels^2: kBlur and kBlurAntialias of gs_core/math/constants.h

# The shapes that an array may have. Axes: N Gaussians, C views, D features, K coefficients of SH, R
# of them beyond the first. Arrays with which an axis gets its length come before the others.
SHAPES = {
    "means": ("N 3",),
    "viewmats": ("4 4", "C 4 4"),
    "Ks": ("3 3", "C 3 3"),
    "rotations": ("N 4",),
    "scales": ("N 3",),
    "log_scales": ("N 3",),
    "covariances": ("N 6",),
    "opacities": ("N", "N 1"),
    "logit_opacities": ("N", "N 1"),
    "colors": ("N 3", "C N 3"),
    "sh0": ("N 3",),
    "sh_rest": ("N R 3",),
    "sh": ("N K 3",),
    "features": ("N D", "C N D"),
    "background": ("3", "C 3"),
    "screen": ("N 2", "C N 2"),
    "absolute_screen": ("N 2", "C N 2"),
}
_ONE_EACH_VIEW = ("viewmats", "Ks", "screen", "absolute_screen")  # with the axis C wherever there is one
_LENGTHS = {"C": range(1, 2**31), "D": range(1, 2**31), "K": (1, 4, 9, 16), "R": (0, 3, 8, 15)}


@dataclass(frozen=True)
class Arguments:
    """What is drawn, checked."""

    arrays: Mapping[str, Any]  # those that were given, by name, all of one dtype
    cameras: Optional[Tuple[Camera, ...]]  # C; None: viewmats and Ks are among the arrays
    count: int  # N
    views: int  # C
    has_view_axis: bool  # False: of one view, and neither arrays nor pictures have the axis C
    width: int  # pixels
    height: int
    shape: str  # scales, log_scales or covariances
    opacity: str  # opacities or logit_opacities
    color: Optional[str]  # colors, sh0 or sh; None: no image is asked for
    sh_degree: int  # in use, 0 to 3
    channels: int  # D; 0 without features
    dtype: str  # float32 or float64
    pictures: Tuple[str, ...]  # of PICTURES, to be drawn
    rows: Tuple[str, ...]  # of ROWS, to be told
    near: float  # world units
    far: float
    blur: float  # pixels^2
    antialiased: bool
    blend_rule: str  # of BLEND_RULES
    smooth: bool
    max_instances: Optional[int]  # None: as many as there are
    deterministic: Optional[bool] = None  # None: as the framework has it
    lenses: Optional[Tuple[Camera, ...]] = None  # C, whose lenses count; None: pinholes


def check(given: Mapping[str, Any]) -> Arguments:
    """Of all that rasterize() takes, by name; arrays that are absent are None. Throws UsageError."""
    arrays = {name: given[name] for name in SHAPES if given[name] is not None}
    pictures, rows = _outputs(given["outputs"])
    kinds = {"shape": _one_of("scales log_scales covariances", arrays),
             "opacity": _one_of("opacities logit_opacities", arrays),
             "color": _one_of("colors sh0 sh", arrays, is_needed="image" in pictures)}
    _check_company(arrays)
    if not pictures and not rows and "features" not in arrays:
        raise UsageError("there is nothing to draw: name outputs or give features")
    dtype = _dtype_of(arrays)
    cameras, width, height = _views(given)
    has_view_axis = arrays["viewmats"].shape[2:] != () if cameras is None else not isinstance(given["cameras"], Camera)
    sizes = _sizes(arrays, {"C": len(cameras)} if cameras and has_view_axis else {}, has_view_axis)
    return Arguments(arrays=arrays, cameras=cameras, count=sizes["N"], views=sizes.get("C", 1),
                     has_view_axis=has_view_axis, width=width, height=height, **kinds,
                     sh_degree=_sh_degree(given["sh_degree"], kinds["color"], sizes), channels=sizes.get("D", 0),
                     dtype=dtype, pictures=pictures, rows=rows,
                     lenses=_lenses(given["camera_model"], cameras, sizes.get("C", 1), width, height), **_settings(given))


def is_per_view(name, array):
    """Whether an array of Arguments has the axis C."""
    longest = SHAPES[name][-1].split()
    return longest[0] == "C" and len(array.shape) == len(longest)


def of_shape_of(name, array, wanted):
    """The array, a gradient or change of a picture, or an array of Arguments. Throws UsageError where the shape is another."""
    if wanted is None:
        raise UsageError(f"there is no gradient by {name}, which was not drawn")
    if array.shape != wanted.shape:
        raise UsageError(f"the gradient or change of {name} must have the shape {wanted.shape}, but has {array.shape}")
    return array


def matrices_of(cameras):
    """viewmats (C, 4, 4) and Ks (C, 3, 3) of cameras, as NumPy arrays of float64."""
    Ks = [[[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]] for camera in cameras]
    return np.stack([camera.cam_from_world for camera in cameras]), np.array(Ks, np.float64)


def words(names, last="and"):
    """"a, b and c"."""
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def _outputs(outputs):
    outputs = tuple(outputs) if hasattr(outputs, "__iter__") and not isinstance(outputs, str) else (outputs,)
    for name in outputs:
        if name == "features":
            raise UsageError("features are drawn wherever they are given; outputs does not name them")
        if name not in PICTURES + ROWS:
            raise UsageError(f"outputs takes {words(PICTURES + ROWS)}, and not {name!r}")
    return tuple(name for name in PICTURES if name in outputs), tuple(name for name in ROWS if name in outputs)


def _one_of(names, arrays, is_needed=True):
    names = names.split()
    found = [name for name in names if name in arrays]
    if len(found) > 1 or (is_needed and not found):
        raise UsageError(f"give one of {words(names)}, and not {words(found) if found else 'none'}")
    return found[0] if found else None


def _check_company(arrays):
    if "covariances" in arrays and "rotations" in arrays:
        raise UsageError("rotations go with scales or log_scales; covariances hold their rotation already")
    if "covariances" not in arrays and "rotations" not in arrays:
        raise UsageError("rotations are missing; scales and log_scales are along axes that they turn")
    if "sh_rest" in arrays and "sh0" not in arrays:
        raise UsageError("sh_rest goes with sh0; sh holds all coefficients in one array")


def _dtype_of(arrays):
    dtypes = {}
    for name, array in arrays.items():
        if not hasattr(array, "dtype"):
            raise UsageError(f"{name} must be an array, and not a {type(array).__name__}")
        dtypes[name] = str(array.dtype).rpartition(".")[2]  # torch.float32, too
    wanted = dtypes["means"]
    if wanted not in ("float32", "float64"):
        raise UsageError(f"means must be of dtype float32 or float64, but is of {wanted}")
    for name, dtype in dtypes.items():
        if dtype != wanted:
            raise UsageError(f"{name} must be of dtype {wanted}, as means is, but is of {dtype}")
    return wanted


def _views(given):
    """The cameras, or None; the width and the height of pictures in pixels."""
    names = ("viewmats", "Ks", "width", "height")
    cameras, found = given["cameras"], [name for name in names if given[name] is not None]
    if (cameras is None) != (len(found) == len(names)) or (cameras is not None and found):
        found = [*(["cameras"] if cameras is not None else []), *found]
        raise UsageError(f"give cameras, or {words(names)}, and not {words(found) if found else 'none'}")
    if cameras is None:
        return None, _side("width", given["width"]), _side("height", given["height"])
    listed = (cameras,) if isinstance(cameras, Camera) else tuple(cameras) if hasattr(cameras, "__iter__") else ()
    if not listed or not all(isinstance(camera, Camera) for camera in listed):
        raise UsageError("cameras must be a gemsplat.Camera or a list of them; arrays are viewmats and Ks")
    first = listed[0]
    for camera in listed:
        if (camera.width, camera.height) != (first.width, first.height):
            raise UsageError(f"cameras must have pictures of one size, but have {first.width}x{first.height} and "
                             f"{camera.width}x{camera.height} pixels; draw each size in a call of its own")
    return listed, first.width, first.height


def _lenses(model, cameras, views, width, height):
    if model not in CAMERA_MODELS:
        raise UsageError(f"camera_model takes {words(CAMERA_MODELS, 'or')}, and not {model!r}")
    if cameras is None:
        return None if model == "pinhole" else (camera_of_model(width, height, model),) * views
    if model != "pinhole":
        raise UsageError("camera_model goes with viewmats and Ks; cameras have lenses of their own")
    return cameras if any(camera.lens != "pinhole" for camera in cameras) else None


def _side(name, value):
    try:
        pixels = index(value)
    except TypeError:
        raise UsageError(f"{name} must be a number of pixels, and not {value!r}") from None
    if not 1 <= pixels <= MOST_PIXELS:
        raise UsageError(f"{name} must lie between 1 and {MOST_PIXELS} pixels, but is {pixels}")
    return pixels


def _sizes(arrays, sizes, has_view_axis):
    """The lengths of the axes by their letters, those in `sizes` and all others of the arrays."""
    for name, array in arrays.items():
        choices = [choice.split() for choice in SHAPES[name]]
        if len(choices) == 2 and choices[1][0] == "C":
            choices = choices[1:] if has_view_axis and name in _ONE_EACH_VIEW else choices[:1 + has_view_axis]
        shape = tuple(array.shape)
        fitting = [choice for choice in choices if _fits(choice, shape, sizes)]
        if not fitting:
            wanted = words([_as_text(choice, sizes) for choice in choices], "or")
            raise UsageError(f"{name} must have the shape {wanted}, but has {shape}")
        sizes.update({axis: length for axis, length in zip(fitting[0], shape) if axis.isalpha()})
    return sizes


def _fits(choice, shape, sizes):
    return len(choice) == len(shape) and all(
        length == int(axis) if axis.isdigit() else length == sizes[axis] if axis in sizes
        else length in _LENGTHS.get(axis, (length,)) for axis, length in zip(choice, shape))


def _as_text(choice, sizes):
    """(8, 3), or (N, 3) while N is unknown; lengths that are one of a few are named."""
    axes = [str(sizes.get(axis, axis)) for axis in choice]
    known = {axis: "at least 1" if axis in "CD" else words(map(str, _LENGTHS[axis]), "or") for axis in _LENGTHS}
    limits = [f" with {axis} of {known[axis]}" for axis in axes if axis in known]
    return f"({', '.join(axes)}{',' if len(axes) == 1 else ''}){''.join(limits)}"


def _sh_degree(degree, color, sizes):
    stored = {1: 0, 4: 1, 9: 2, 16: 3}[sizes.get("K", 1 + sizes.get("R", 0))]
    if degree is None:
        return stored
    if color not in ("sh0", "sh"):
        raise UsageError("sh_degree goes with sh0 or sh")
    if degree not in range(stored + 1):
        raise UsageError(f"sh_degree must lie between 0 and {stored}, the degree of {color}, but is {degree}")
    return int(degree)


def _settings(given):
    near, far = _number("near", given["near"]), _number("far", given["far"])
    if not near < far:
        raise UsageError(f"near must be less than far, but they are {near:g} and {far:g}")
    for name in ("antialiased", "smooth"):
        if given[name] not in (True, False):
            raise UsageError(f"{name} must be True or False, and not {given[name]!r}")
    if given["deterministic"] not in (True, False, None):
        raise UsageError(f"deterministic must be True, False or None, and not {given['deterministic']!r}")
    antialiased, rule = bool(given["antialiased"]), given["blend_rule"]
    if rule not in BLEND_RULES:
        raise UsageError(f"blend_rule takes {words(BLEND_RULES, 'or')}, and not {rule!r}")
    usual = BLUR_ANTIALIASED if antialiased else BLUR
    blur = _number("blur", usual if given["blur"] is None else given["blur"])
    return {"near": near, "far": far, "blur": blur, "antialiased": antialiased, "blend_rule": rule,
            "smooth": bool(given["smooth"]), "max_instances": _max_instances(given["max_instances"]),
            "deterministic": given["deterministic"]}


def _max_instances(value):
    if value is None:
        return None
    try:
        count = index(value)
    except TypeError:
        raise UsageError(f"max_instances must be a whole number, and not {value!r}") from None
    if not 1 <= count < 2**31:
        raise UsageError(f"max_instances must lie between 1 and 2^31 - 1, but is {count}")
    return count


def _number(name, value):
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise UsageError(f"{name} must be a number, and not {value!r}") from None
    if not 0 < number < 3e38:
        raise UsageError(f"{name} must be above 0 and fit 32 bits, but is {number:g}")
    return number
