# SPDX-License-Identifier: Apache-2.0
"""rasterize() and vjp() for CuPy arrays, by the kernels of a GPU, in float32, on CuPy's current stream
and in memory of its pool.
"""

from __future__ import annotations

import cupy

from . import _gpu
from ._arguments import is_per_view, of_shape_of
from ._gemsplat import GpuOperation, UsageError


def arrays_of(given):
    """Arrays of the device of means; lists, numbers and arrays of NumPy become arrays of CuPy."""
    device = given["means"].device
    arrays = {}
    with device:
        for name, value in given.items():
            array = value if isinstance(value, cupy.ndarray) else cupy.asarray(value, cupy.float32)
            if array.device != device:
                raise UsageError(f"{name} is on GPU {array.device.id}, but means on {device.id}; copy one of them to the other")
            if array.dtype.kind != "f":
                raise UsageError(f"{name} must hold real numbers, but is of {array.dtype}")
            arrays[name] = array.astype(cupy.float32) if array.dtype == cupy.float16 else array
    return arrays


def rasterize(arguments):
    _gpu.check(arguments)
    with arguments.arrays["means"].device:
        return _rendering(arguments, lambda each: _Drawn(arguments, each, for_backward=False).pictures)


def vjp(arguments):
    """The Rendering, and the function that pulls gradients back through it."""
    _gpu.check(arguments)
    device, passes = arguments.arrays["means"].device, []

    def draw(each):
        passes.append(_Drawn(arguments, each, for_backward=True))
        return passes[-1].pictures

    with device:
        rendering = _rendering(arguments, draw)

    def pull(image=None, alpha=None, depth=None, inverse_depth=None, features=None):
        given = {"image": image, "alpha": alpha, "depth": depth, "inverse_depth": inverse_depth, "features": features}
        with device:
            given = {name: of_shape_of(name, cupy.asarray(value, cupy.float32), getattr(rendering, name))
                     for name, value in given.items() if value is not None}
            sums = {name: cupy.zeros_like(array) for name, array in arguments.arrays.items()}
            for drawn in passes:
                drawn.pull(given, sums)
        return sums

    return rendering, pull


def jvp(arguments, tangents):
    raise UsageError("jvp() takes NumPy arrays; give cupy.asnumpy() of the arrays")


def _rendering(arguments, draw):
    return _gpu.rendering(arguments, draw, cupy, lambda array: array.astype(cupy.int32), by_threes=bool(arguments.deterministic))


def _pieces():
    return _gpu.Pieces(lambda count: cupy.empty(count, cupy.uint8), lambda array: array.data.ptr)


def _dense(array):
    """An array without gaps, from a multiple of 16 bytes on."""
    array = cupy.ascontiguousarray(array)
    return array if array.data.ptr % 16 == 0 else array.copy()


def _addresses(arrays):
    return _gpu.addresses(arrays, lambda array: (array.data.ptr, array.size // max(1, len(array))))


class _Drawn:
    """One pass, and what is kept for its gradient."""

    def __init__(self, arguments, each, for_backward):
        self.has_view_axis, self.each, self.kept = arguments.has_view_axis, each, _pieces()
        self.arrays = {name: _dense(array) for name, array in each.arrays.items()}
        self.pictures = {name: cupy.empty(shape, cupy.int32 if name == "overflowed" else cupy.float32)
                         for name, shape in each.shapes.items()}
        settings = {**each.settings, "deterministic": bool(arguments.deterministic), "for_backward": for_backward}
        if arguments.cameras or arguments.lenses:
            settings["camera"] = (arguments.cameras or arguments.lenses)[each.view]
        self.operation = GpuOperation(_addresses(self.arrays), settings)
        self.frame = self.operation.draw(*_place(), self.kept, _pieces(),
                                         {name: picture.data.ptr for name, picture in self.pictures.items()})
        self.features = self.pictures["features"].copy() if for_backward and "features" in self.pictures else None

    def pull(self, given, sums):
        """Adds the gradients by the arrays of Arguments to `sums`, from those by the pictures of Rendering."""
        by_pictures = {"depth" if name == "inverse_depth" else name: by[self.each.view] if self.has_view_axis else by
                       for name, by in given.items()}
        first = self.each.first_feature
        if first is not None:
            by_pictures = {"image": _gpu.padded(by[..., first:first + 3], 3, cupy)
                           for name, by in by_pictures.items() if name == "features"}
        elif self.features is None:
            by_pictures.pop("features", None)
        if not by_pictures:
            return
        if "image" in by_pictures:
            by_pictures["image"] = cupy.moveaxis(by_pictures["image"], -1, 0)
        if "features" in by_pictures:
            by_pictures["features"] = _gpu.padded(by_pictures["features"], self.features.shape[-1], cupy)
            by_pictures["drawn_features"] = self.features
        by_pictures = {name: _dense(by) for name, by in by_pictures.items()}
        gradients = {name: cupy.zeros_like(array) for name, array in self.arrays.items() if name != "background"}
        self.operation.pull_back(self.frame, *_place(), _pieces(), {name: by.data.ptr for name, by in by_pictures.items()},
                                 _addresses(gradients))
        if "background" in self.arrays and "image" in by_pictures:
            by_image = by_pictures["image"]
            transmittance = self.kept.view(self.frame.transmittance, by_image.shape[1:], cupy.float32)
            gradients["background"] = (by_image * transmittance).sum((1, 2))
        if first is not None:
            gradients["features"] = gradients.pop("colors")
        for name, gradient in gradients.items():
            if name in sums:
                into = sums[name][self.each.view] if is_per_view(name, sums[name]) else sums[name]
                if name == "features":
                    into = into[:, first or 0:][:, :gradient.shape[1]]
                    gradient = gradient[:, :into.shape[1]]
                into += gradient


def _place():
    """The GPU and the stream of a call."""
    return cupy.cuda.runtime.getDevice(), cupy.cuda.get_current_stream().ptr
