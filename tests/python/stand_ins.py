# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for CuPy and for the kernels of a GPU, on memory of the host, so that the code around them is tested
where there is none of them. They have what gemsplat calls, and nothing else.
"""

import contextlib
import ctypes
import itertools
import sys
import types

import numpy as np

from gemsplat import _gemsplat, _numpy
from gemsplat._arguments import ROWS, Arguments

_ROWS = {"means": (3,), "rotations": (4,), "scales": (3,), "log_scales": (3,), "covariances": (6,), "opacities": (),
         "logit_opacities": (), "colors": (3,), "sh0": (3,), "screen": (2,), "absolute_screen": (2,)}
_WHOLE = {"viewmats": (4, 4), "Ks": (3, 3), "background": (3,)}


def at(address, shape, dtype=np.float32, strides=None):
    """The array at an address; strides in numbers."""
    strides = strides and [4 * stride for stride in strides]
    size = 4 * (1 + sum((length - 1) * stride // 4 for length, stride in zip(shape, strides))) if strides else 4 * int(np.prod(shape))
    if 0 in shape:
        return np.zeros(shape, dtype)
    flat = np.frombuffer((ctypes.c_char * size).from_address(address), dtype)
    return np.lib.stride_tricks.as_strided(flat, shape, strides) if strides else flat.reshape(shape)


class HostOperation:
    """_gemsplat.GpuOperation by the exact renderer."""

    def __init__(self, addresses, call):
        self.call = call
        self.arrays = self._arrays(addresses)

    def _arrays(self, addresses):
        count, arrays = self.call["count"], {}
        for name, (address, stride) in addresses.items():
            row = ((self.call["sh_degree"] + 1)**2 - 1, 3) if name == "sh_rest" else _ROWS.get(name)
            if name in _WHOLE:
                arrays[name] = at(address, _WHOLE[name])
            else:
                inner = {0: [], 1: [1], 2: [3, 1]}[len(row)]
                arrays[name] = at(address, (count, *row), strides=[stride, *inner])
        return arrays

    def _arguments(self, pictures, rows=()):
        names = ("count", "width", "height", "sh_degree", "near", "far", "blur", "antialiased", "blend_rule")
        camera = self.call.get("camera")
        return Arguments(arrays=self.arrays, cameras=(camera,) if camera else None, views=1, has_view_axis=False, shape="",
                         opacity="", color="colors", channels=0, dtype="float32", pictures=pictures, rows=rows, smooth=False,
                         max_instances=None, **{name: self.call[name] for name in names})

    def _named(self, name):
        return "inverse_depth" if name == "depth" and self.call["inverse_depth"] else name

    def draw(self, device, stream, kept, scratch, pictures):
        size = self.call["height"], self.call["width"]
        address = kept(4 * size[0] * size[1] + 1024) + 512
        kept(64)
        scratch(64)
        rendering = _numpy.rasterize(self._arguments(("image", "alpha", "depth", "inverse_depth"), ROWS))
        at(address, size)[...] = 1 - rendering.alpha
        shapes = {"image": (3, *size), "alpha": size, "depth": size, "rows": (self.call["count"], 8), "overflowed": (1,)}
        for name, to in pictures.items():
            value = (np.moveaxis(rendering.image, -1, 0) if name == "image"
                     else np.column_stack([getattr(rendering, row) for row in ROWS]) if name == "rows"
                     else 0 if name == "overflowed" else getattr(rendering, self._named(name)))
            at(to, shapes[name], np.int32 if name == "overflowed" else np.float32)[...] = value
        return types.SimpleNamespace(transmittance=address)

    def pull_back(self, frame, device, stream, scratch, by_pictures, by_arrays):
        size = self.call["height"], self.call["width"]
        by = {self._named(name): at(address, (3, *size) if name == "image" else size) for name, address in by_pictures.items()}
        if "image" in by:
            by["image"] = np.moveaxis(by["image"], 0, -1)
        found = _numpy.vjp(self._arguments(tuple(by)))[1](**by)
        for name, array in self._arrays(by_arrays).items():
            array[...] = found[name]


# ---- CuPy ----


class _CupyArray(np.ndarray):
    device = property(lambda self: _Device())
    data = property(lambda self: types.SimpleNamespace(ptr=self.ctypes.data))


_CupyArray.__module__ = "cupy"


class _Device(contextlib.nullcontext):
    id = 0

    def __eq__(self, other):
        return isinstance(other, _Device)


def cupy():
    """The module; gemsplat._cupy of it draws by HostOperation."""
    module = types.ModuleType("cupy")
    module.ndarray = _CupyArray
    for name in ("asarray", "empty", "zeros_like", "ascontiguousarray", "moveaxis", "stack", "vstack", "concatenate"):
        setattr(module, name, lambda *given, like=getattr(np, name): like(*given).view(_CupyArray))
    for name in ("float16", "float32", "float64", "int32", "uint8"):
        setattr(module, name, getattr(np, name))
    module.cuda = types.SimpleNamespace(runtime=types.SimpleNamespace(getDevice=lambda: 0),
                                        get_current_stream=lambda: types.SimpleNamespace(ptr=0))
    return module


@contextlib.contextmanager
def installed(ours, **modules):
    """While it lasts, `ours` is a module of gemsplat that has been loaded with these modules."""
    import importlib

    before = {name: sys.modules.get(name) for name in itertools.chain(modules, [ours])}
    sys.modules.update(modules)
    sys.modules.pop(ours, None)
    try:
        yield importlib.import_module(ours)
    finally:
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module
        package, _, name = ours.rpartition(".")
        if hasattr(sys.modules[package], name):
            delattr(sys.modules[package], name)
