# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for CuPy, for JAX and for the kernels of a GPU, on memory of the host, so that the code around them is tested
where there is none of them. They have what gemsplat calls, and nothing else.
"""

import contextlib
import ctypes
import itertools
import sys
import types
from pathlib import Path

import numpy as np

from gemsplat import _gemsplat, _numpy
from gemsplat._arguments import ROWS, Arguments
from support import SOURCE

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
            row = (((self.call["sh_degree"] + 1)**2 - 1, 3) if name == "sh_rest"
                   else (stride,) if name == "features" else _ROWS.get(name))
            if name in _WHOLE:
                arrays[name] = at(address, _WHOLE[name])
            else:
                inner = {0: [], 1: [1], 2: [3, 1]}[len(row)]
                arrays[name] = at(address, (count, *row), strides=[stride, *inner])
        return arrays

    def _arguments(self, pictures, rows=()):
        names = ("count", "width", "height", "sh_degree", "near", "far", "blur", "antialiased", "blend_rule")
        camera = self.call.get("camera")
        cameras = (camera,) if camera else None
        by_matrices = "viewmats" in self.arrays  # of which a camera gives the lens alone
        return Arguments(arrays=self.arrays, cameras=None if by_matrices else cameras, lenses=cameras if by_matrices else None, views=1, has_view_axis=False, shape="",
                         opacity="", color="colors", channels=self._channels(), dtype="float32", pictures=pictures, rows=rows, smooth=False,
                         max_instances=None, **{name: self.call[name] for name in names})

    def _channels(self):
        return self.arrays["features"].shape[1] if "features" in self.arrays else 0

    def _named(self, name):
        return "inverse_depth" if name == "depth" and self.call["inverse_depth"] else name

    def draw(self, device, stream, kept, scratch, pictures):
        size = self.call["height"], self.call["width"]
        address = kept(4 * size[0] * size[1] + 1024) + 512
        kept(64)
        scratch(64)
        rendering = _numpy.rasterize(self._arguments(("image", "alpha", "depth", "inverse_depth"), ROWS))
        at(address, size)[...] = 1 - rendering.alpha
        shapes = {"image": (3, *size), "alpha": size, "depth": size, "rows": (self.call["count"], 8), "overflowed": (1,),
                  "features": (*size, self._channels())}
        for name, to in pictures.items():
            value = (np.moveaxis(rendering.image, -1, 0) if name == "image"
                     else np.column_stack([getattr(rendering, row) for row in ROWS]) if name == "rows"
                     else 0 if name == "overflowed" else getattr(rendering, self._named(name)))
            at(to, shapes[name], np.int32 if name == "overflowed" else np.float32)[...] = value
        return types.SimpleNamespace(transmittance=address)

    def pull_back(self, frame, device, stream, scratch, by_pictures, by_arrays):
        size = self.call["height"], self.call["width"]
        shapes = {"image": (3, *size), "features": (*size, self._channels()), "drawn_features": (*size, self._channels())}
        by = {self._named(name): at(address, shapes.get(name, size)) for name, address in by_pictures.items()}
        drawn = by.pop("drawn_features", None)
        if "features" in by:
            np.testing.assert_allclose(drawn, _numpy.rasterize(self._arguments(())).features, atol=1e-6)
        if "image" in by:
            by["image"] = np.moveaxis(by["image"], 0, -1)
        found = _numpy.vjp(self._arguments(tuple(name for name in by if name != "features")))[1](**by)
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


# ---- JAX ----


class _JaxArray(np.ndarray):
    pass


_JaxArray.__module__ = "jax"
_Handler = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
_targets = {}


def _base(fields):
    """A struct of XLA's foreign function interface: each begins with its size and extensions."""
    return type("Struct", (ctypes.Structure,), {"_fields_": [("struct_size", ctypes.c_size_t), ("extension", ctypes.c_void_p), *fields]})


_Pointers = [("size", ctypes.c_int64), ("types", ctypes.POINTER(ctypes.c_int)), ("each", ctypes.POINTER(ctypes.c_void_p))]
_Buffer = _base([("dtype", ctypes.c_int), ("data", ctypes.c_void_p), ("rank", ctypes.c_int64), ("dims", ctypes.POINTER(ctypes.c_int64))])
_Some = _base(_Pointers)
_Attributes = _base([*_Pointers[:2], ("names", ctypes.c_void_p), ("each", ctypes.POINTER(ctypes.c_void_p))])
_Api = _base([("version", ctypes.c_size_t * 3), ("internal", ctypes.c_void_p), ("error_create", _Handler)])
_Error = _base([("message", ctypes.c_char_p), ("code", ctypes.c_int)])
_Frame = _base([("api", ctypes.POINTER(_Api)), ("context", ctypes.c_void_p), ("stage", ctypes.c_int), ("args", _Some), ("rets", _Some),
                ("attrs", _Attributes), ("future", ctypes.c_void_p)])


class _Span(ctypes.Structure):
    _fields_ = [("text", ctypes.c_char_p), ("length", ctypes.c_size_t)]


def _pointers(structs):
    return (ctypes.c_void_p * len(structs))(*map(ctypes.addressof, structs))


def _called(name, inputs, results, text):
    """Calls the handler for the CPU as XLA does."""
    inputs = [np.ascontiguousarray(array) for array in inputs]
    outputs = [np.empty(result.shape, result.dtype) for result in results]
    kinds = {"float32": 11, "float64": 12, "int32": 4, "uint8": 6}
    buffers = [[_Buffer(0, None, kinds[str(array.dtype)], array.ctypes.data, array.ndim, array.ctypes.shape_as(ctypes.c_int64))
                for array in arrays] for arrays in (inputs, outputs)]
    message = []
    report = _Handler(lambda error: message.append(ctypes.cast(error, ctypes.POINTER(_Error))[0].message.decode()) or 1)
    span = _Span(text.encode(), len(text.encode()))
    some = [_Some(0, None, len(each), None, _pointers(each)) for each in buffers]
    frame = _Frame(api=ctypes.pointer(_Api(error_create=report)), stage=3, args=some[0], rets=some[1],
                   attrs=_Attributes(0, None, 1, (ctypes.c_int * 1)(4), None, _pointers([span])))
    if _Handler(_targets[name, "cpu"])(ctypes.addressof(frame)):
        raise RuntimeError(message[0])
    return [output.view(_JaxArray) for output in outputs]


def jax(folder):
    """The module. `folder` gets what jaxlib has in its folder of headers."""
    header = Path(folder) / "xla" / "ffi" / "api" / "c_api.h"
    header.parent.mkdir(parents=True)
    header.write_text((SOURCE / "apps" / "python" / "xla" / "c_api.h").read_text())
    module, numpy = types.ModuleType("jax"), types.ModuleType("jax.numpy")
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]

    def register(name, capsule, platform):
        _targets[name, platform] = get(capsule, b"xla._CUSTOM_CALL_TARGET")

    class CustomVjp:
        def __init__(self, function, nondiff_argnums):
            self.function, self.calls = function, []

        def defvjp(self, forward, backward):
            self.forward, self.backward = forward, backward

        def __call__(self, text, arrays):
            self.calls.append((text, arrays))
            return self.function(text, arrays)

    module.Array, module.custom_vjp, module.numpy = _JaxArray, CustomVjp, numpy
    module.ShapeDtypeStruct = lambda shape, dtype: types.SimpleNamespace(shape=shape, dtype=dtype)
    module.ffi = types.SimpleNamespace(
        include_dir=lambda: folder, register_ffi_target=register,
        ffi_call=lambda name, results, vmap_method: lambda *inputs, call: _called(name, inputs, results, call))
    for name in ("asarray", "zeros_like", "moveaxis", "stack", "vstack", "concatenate"):
        setattr(numpy, name, lambda *given, like=getattr(np, name): like(*given).view(_JaxArray))
    for name in ("float32", "float64", "floating", "int32", "issubdtype"):
        setattr(numpy, name, getattr(np, name))
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
