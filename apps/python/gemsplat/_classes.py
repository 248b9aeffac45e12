# SPDX-License-Identifier: Apache-2.0
"""What Model, Camera and Scene have in Python: arrays that come in are checked and copied here."""

from __future__ import annotations

from typing import Iterable, Optional, Sequence, Tuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gemsplat
from ._gemsplat import MOST_PIXELS, Camera, Model, Scene, UsageError

LENSES = {"pinhole": 0, "opencv": 4, "fisheye": 4, "orthographic": 0}  # numbers of their distortion
_POSE_TOLERANCE = 1e-3  # single precision and rounded text
_new_model, _new_camera, _new_scene = Model.__init__, Camera.__init__, Scene.__init__


def real_array(name, value):
    """A NumPy array of floats or integers. Throws UsageError, which names the argument."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of several lengths
        raise UsageError(f"{name} is not an array") from None
    if array.dtype.kind not in "fiu":
        raise UsageError(f"{name} must hold real numbers, but is of dtype {array.dtype}")
    return array


def _array_of(name, value, shape):
    array = real_array(name, value)
    if array.ndim != len(shape) or any(want not in (None, has) for want, has in zip(shape, array.shape)):
        wanted = str(shape).replace("None", "N")
        raise UsageError(f"{name} must have the shape {wanted}, but has {array.shape}")
    return array


def floats_of(name, value, shape):
    """float32 in C order, finite."""
    with np.errstate(over="ignore"):
        floats = _array_of(name, value, shape).astype(np.float32, order="C")
    for row, *rest in np.argwhere(~np.isfinite(floats))[:1]:
        raise UsageError(f"{name} holds {floats[(row, *rest)]} in row {row}; every value must be a finite float32")
    return floats


def _bytes_of(name, value, shape):
    if np.asarray(value).dtype != np.uint8:  # 0..1 cannot be told from 0..255
        raise UsageError(f"{name} must hold uint8, 0 to 255, but is of dtype {np.asarray(value).dtype}")
    return _array_of(name, value, shape)


def three_numbers(name, value):
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (3,):
        raise UsageError(f"{name} must be three numbers")
    if not np.isfinite(numbers).all():
        raise UsageError(f"{name} must be finite")
    return tuple(numbers)


def _stored(name, stored, other, activated, shape, stored_of):
    if (stored is None) == (activated is None):
        raise UsageError(f"give either {other} or {name}")
    return floats_of(name, stored, shape) if activated is None else stored_of(floats_of(other, activated, shape))


def _log_of(scales):
    if not (scales > 0).all():
        raise UsageError(f"scales must be above 0, and one is {scales.min():g}")
    return _gemsplat.log(scales)


def _logit_of(opacities):
    for wrong in opacities[(opacities <= 0) | (opacities >= 1)][:1]:
        raise UsageError(f"opacities must lie between 0 and 1, both excluded, and one is {wrong:g}")
    return _gemsplat.logit(opacities)


def _init_model(self, *, means: ArrayLike, rotations: ArrayLike, scales: Optional[ArrayLike] = None,
                log_scales: Optional[ArrayLike] = None, opacities: Optional[ArrayLike] = None,
                logit_opacities: Optional[ArrayLike] = None, colors: Optional[ArrayLike] = None,
                sh0: Optional[ArrayLike] = None, sh_rest: Optional[ArrayLike] = None, antialiased: bool = False,
                world_offset: Optional[ArrayLike] = None) -> None:
    """Copies arrays of real numbers to float32. The shapes are those of the properties.

    Give scales or log_scales, opacities or logit_opacities, colors or sh0. Without sh_rest the SH
    degree is 0. NaN and infinity are refused (UsageError).
    """
    means = floats_of("means", means, (None, 3))
    rows = len(means)
    rest = floats_of("sh_rest", np.zeros((rows, 0, 3)) if sh_rest is None else sh_rest, (rows, None, 3))
    if rest.shape[1] not in (0, 3, 8, 15):
        raise UsageError(f"sh_rest must have 0, 3, 8 or 15 coefficients (SH degree 0 to 3), and has {rest.shape[1]}")
    _new_model(
        self, means, floats_of("rotations", rotations, (rows, 4)),
        _stored("log_scales", log_scales, "scales", scales, (rows, 3), _log_of),
        _stored("logit_opacities", logit_opacities, "opacities", opacities, (rows,), _logit_of),
        _stored("sh0", sh0, "colors", colors, (rows, 3), lambda color: (color - np.float32(0.5)) / _gemsplat.SH0),
        rest, antialiased, (0, 0, 0) if world_offset is None else three_numbers("world_offset", world_offset))


def _scales(self) -> NDArray[np.float32]:
    """(N, 3) float32: standard deviations along the axes, world units. A copy."""
    return _gemsplat.exp(self.log_scales)


def _unit_rotations(self) -> NDArray[np.float32]:
    """(N, 4) float32: rotations with length 1, w x y z. A copy."""
    return self.rotations / np.sqrt(np.sum(self.rotations**2, axis=1, keepdims=True))


def _opacities(self) -> NDArray[np.float32]:
    """(N,) float32: 0 to 1. A copy."""
    return _gemsplat.sigmoid(self.logit_opacities)


def _colors(self) -> NDArray[np.float32]:
    """(N, 3) float32: colors of degree 0, red green blue, 0 to 1 as displayed (sRGB), not clamped. A copy."""
    return np.float32(0.5) + _gemsplat.SH0 * self.sh0


def _pose(cam_from_world):
    try:
        pose = np.asarray(cam_from_world, np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape not in ((3, 4), (4, 4)):
        raise UsageError("cam_from_world must be a matrix of 3 or 4 rows and 4 columns")
    if not (np.abs(pose[3:] - [0, 0, 0, 1]) < _POSE_TOLERANCE).all():
        raise UsageError("the last row of cam_from_world must be 0 0 0 1; is it transposed?")
    turn = pose[:3, :3]
    if not ((np.abs(turn @ turn.T - np.eye(3)) < _POSE_TOLERANCE).all() and np.linalg.det(turn) > 0):
        raise UsageError("cam_from_world must hold a rotation (orthonormal, determinant 1) in its first three columns")
    if not np.isfinite(pose).all():
        raise UsageError("the translation of cam_from_world must be finite")
    return pose[:3]


def _init_camera(self, width: int, height: int, fx: float, fy: Optional[float] = None, cx: Optional[float] = None,
                 cy: Optional[float] = None, cam_from_world: Optional[ArrayLike] = None, name: str = "",
                 time: float = 0.0, lens: str = "pinhole", distortion: Sequence[float] = ()) -> None:
    """width, height, fx, fy, cx, cy in pixels; without fy it is fx, without cx and cy the picture's center.

    cam_from_world: (3, 4) or (4, 4), a rotation and a translation in world units; without it the camera
    is at the origin and looks along z. time: the moment of a scene that moves, from 0 to 1.
    lens: pinhole; opencv with the distortion k1 k2 p1 p2; fisheye, k1 k2 k3 k4, which also sees beside and
    behind the camera; orthographic, where fx and fy are pixels per world unit.
    """
    fy, cx, cy = fx if fy is None else fy, width / 2 if cx is None else cx, height / 2 if cy is None else cy
    if not (1 <= min(width, height) and max(width, height) <= MOST_PIXELS):
        raise UsageError(f"width and height must lie between 1 and {MOST_PIXELS} pixels, but are {width} and {height}")
    if not (0 < fx < np.inf and 0 < fy < np.inf):
        raise UsageError("fx and fy must be above 0 and finite")
    if not np.isfinite([cx, cy]).all():
        raise UsageError("cx and cy must be finite")
    pose = np.eye(3, 4) if cam_from_world is None else _pose(cam_from_world)
    with np.errstate(all="ignore"):
        kept = np.float32([fx, fy, cx, cy, *pose[:, 3]])
    if not (np.isfinite(kept).all() and kept[:2].min() > 0):
        raise UsageError("the camera's numbers do not fit 32 bits; scale or move the scene")
    if lens not in LENSES:
        raise UsageError(f"lens must be one of {', '.join(LENSES)}, and not {lens!r}")
    distortion = np.asarray(distortion, np.float64)
    if distortion.shape not in ((0,), (LENSES[lens],)) or not np.isfinite(distortion).all():
        raise UsageError(f"distortion must be {LENSES[lens]} finite numbers for the lens {lens}, or none")
    distortion = np.resize(distortion, 4) if distortion.size else np.zeros(4)
    _new_camera(self, width, height, fx, fy, cx, cy, pose, name, time, lens, distortion)


def _init_scene(self, train: Iterable[Tuple[Camera, ArrayLike]], test: Iterable[Tuple[Camera, ArrayLike]] = (), *,
                points: Optional[ArrayLike] = None, point_colors: Optional[ArrayLike] = None) -> None:
    """From arrays, which are copied.

    train, test: pairs of a Camera and its photo, (height, width, 3) uint8, sRGB, of the camera's size;
    views are sorted by their cameras' names. points: (M, 3), world units; without points training
    starts at random. point_colors: (M, 3) uint8, else gray.
    """
    def view(pair):
        if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[0], Camera)):
            raise UsageError("a view is a pair: a Camera and its photo")
        return pair[0], _bytes_of("a photo", pair[1], (pair[0].height, pair[0].width, 3))

    at = floats_of("points", np.zeros((0, 3)) if points is None else points, (None, 3))
    gray = np.full(at.shape, 128, np.uint8)
    colors = gray if points is None or point_colors is None else _bytes_of("point_colors", point_colors, at.shape)
    _new_scene(self, [view(pair) for pair in train], [view(pair) for pair in test], at, colors)


Model.__init__, Camera.__init__, Scene.__init__ = _init_model, _init_camera, _init_scene
Model.scales, Model.unit_rotations = property(_scales), property(_unit_rotations)
Model.opacities, Model.colors = property(_opacities), property(_colors)
