# SPDX-License-Identifier: Apache-2.0
"""rasterize() for JAX arrays, under jit(), grad(), vmap() and checkpoint(): XLA calls the kernels of a
GPU (jax_calls.cpp), and on the CPU the exact renderer.

Which of them it will be is not known where a function is traced: shapes are the same for both.
"""

from __future__ import annotations

import ctypes
import functools
import json
import re
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from . import _gemsplat, _gpu, _numpy
from ._arguments import ROWS, Arguments, matrices_of
from ._gemsplat import UsageError


def arrays_of(given):
    """Arrays of the dtype of means; lists, numbers and arrays of NumPy become arrays of JAX."""
    dtype = jnp.float64 if given["means"].dtype == jnp.float64 else jnp.float32
    arrays = {}
    for name, value in given.items():
        if isinstance(value, jax.Array):
            if not jnp.issubdtype(value.dtype, jnp.floating):
                raise UsageError(f"{name} must hold real numbers, but is of {value.dtype}")
            arrays[name] = value.astype(jnp.float32) if value.dtype.itemsize < 4 else value
        else:
            try:
                arrays[name] = jnp.asarray(value, dtype)
            except (TypeError, ValueError):
                raise UsageError(f"{name} must be an array, as means is, and not a {type(value).__name__}") from None
    return arrays


def rasterize(arguments):
    """The Rendering, each picture of which JAX differentiates."""
    _gpu.check_depths(arguments)
    if arguments.lenses:
        raise UsageError("arrays of JAX are drawn by pinholes; lenses are for arrays of NumPy, PyTorch and CuPy")
    arrays = dict(arguments.arrays)
    if arguments.cameras:
        matrices = zip(("viewmats", "Ks"), matrices_of(arguments.cameras))
        arrays.update({name: jnp.asarray(each if arguments.has_view_axis else each[0], arguments.dtype) for name, each in matrices})
    used = (arguments.sh_degree + 1)**2
    if "sh" in arrays:
        arrays["sh"] = arrays["sh"][:, :used]
    if "sh_rest" in arrays:
        arrays["sh_rest"] = arrays["sh_rest"][:, :used - 1]
        if used == 1:
            del arrays["sh_rest"]
    background = arrays.pop("background", None)
    has_background = background is not None and "image" in arguments.pictures
    pictures = tuple(dict.fromkeys(arguments.pictures + (("alpha",) if has_background else ())))
    drawn = replace(arguments, arrays=arrays, cameras=None, pictures=pictures)

    def draw(each):
        call = {**each.settings, "shapes": each.shapes, "arrays": list(each.arrays), "dtype": arguments.dtype,
                "wanted": [name for name in each.arrays
                           if name in arguments.arrays or (name == "colors" and each.first_feature is not None)],
                "pulled": [name for name in each.shapes if name in _gpu.PULLED],
                "smooth": arguments.smooth, "deterministic": bool(arguments.deterministic), "for_backward": False}
        return _draw(json.dumps(call), each.arrays)

    rendering = _gpu.rendering(drawn, draw, jnp, lambda array: array.astype(jnp.int32), by_threes=bool(arguments.deterministic))
    if has_background:
        behind = background[:, None, None] if background.ndim == 2 else background
        rendering = rendering._replace(image=rendering.image + (1 - rendering.alpha)[..., None] * behind)
    return rendering if "alpha" in arguments.pictures else rendering._replace(alpha=None)


def vjp(arguments):
    raise UsageError("vjp() is for arrays without autograd; call rasterize() in a function for jax.vjp() or jax.grad()")


def jvp(arguments, tangents):
    raise UsageError("jvp() takes NumPy arrays; give numpy.asarray() of the arrays")


# ---- one pass: `text` has its settings, `arrays` what it is drawn from ----


@functools.partial(jax.custom_vjp, nondiff_argnums=(0,))
def _draw(text, arrays):
    return _drawn(json.loads(text), arrays)[0]


def _drawn(call, arrays, kept_bytes=0):
    """What is drawn, by name, and in a list what else is kept of it for the gradient, if anything."""
    results = [jax.ShapeDtypeStruct(tuple(shape), np.dtype("int32" if name == "overflowed" else call["dtype"]))
               for name, shape in call["shapes"].items()]
    if kept_bytes:
        results.append(jax.ShapeDtypeStruct((kept_bytes,), np.dtype("uint8")))
    drawn = jax.ffi.ffi_call("gemsplat_draw", results, vmap_method="sequential")(
        *(arrays[name] for name in call["arrays"]), call=json.dumps({**call, "for_backward": kept_bytes > 0}))
    return dict(zip(call["shapes"], drawn)), list(drawn[len(call["shapes"]):])


def _draw_forward(text, arrays):
    call = json.loads(text)
    has_room = call["max_instances"] and call["pulled"] and _gemsplat.cuda_device_count()
    drawn, kept = _drawn(call, arrays, _gemsplat.jax_kept_bytes(call) if has_room else 0)
    features = [drawn["features"]] if "features" in drawn else []
    return drawn, (arrays, features + kept)


def _draw_backward(text, residuals, by):
    (arrays, kept), call = residuals, json.loads(text)
    gradients = {name: jnp.zeros_like(array) for name, array in arrays.items()}
    if call["pulled"] and call["wanted"]:
        results = [jax.ShapeDtypeStruct(arrays[name].shape, arrays[name].dtype) for name in call["wanted"]]
        gradients.update(zip(call["wanted"], jax.ffi.ffi_call("gemsplat_pull_back", results, vmap_method="sequential")(
            *(arrays[name] for name in call["arrays"]), *(by[name] for name in call["pulled"]), *kept, call=text)))
    return (gradients,)


_draw.defvjp(_draw_forward, _draw_backward)


# ---- what XLA calls on the CPU, with (address, shape) of arrays ----


def draw_on_host(text, inputs, outputs):
    call = json.loads(text)
    rendering = _numpy.rasterize(_arguments(call, inputs))
    known = {name: picture for name, picture in rendering._asdict().items() if picture is not None}
    known["overflowed"] = 0
    known["depth"] = known.get("inverse_depth", known.get("depth"))
    if "image" in known:
        known["image"] = np.moveaxis(known["image"], -1, 0)
    if "rows" in call["shapes"]:
        known["rows"] = np.column_stack([known[name] for name in ROWS])
    for name, at in zip(call["shapes"], outputs):
        _array(at, "int32" if name == "overflowed" else call["dtype"])[...] = known[name]


def pull_back_on_host(text, inputs, outputs):
    call = json.loads(text)
    _, pull = _numpy.vjp(_arguments(call, inputs))
    by = {name: _array(at, call["dtype"]) for name, at in zip(call["pulled"], inputs[len(call["arrays"]):])}
    if "image" in by:
        by["image"] = np.moveaxis(by["image"], 0, -1)
    if call["inverse_depth"]:
        by["inverse_depth"] = by.pop("depth")
    gradients = pull(**by)
    for name, at in zip(call["wanted"], outputs):
        _array(at, call["dtype"])[...] = gradients[name]


def _array(at, dtype):
    """The NumPy array at an address."""
    address, shape = at
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return np.frombuffer((ctypes.c_char * size).from_address(address), dtype).reshape(shape) if size else np.empty(shape, dtype)


def _arguments(call, inputs):
    """What _numpy.py takes, of one view without the axis C."""
    depth = "inverse_depth" if call["inverse_depth"] else "depth"
    pictures = tuple(depth if name == "depth" else name for name in call["pulled"] if name != "features")
    arrays = {name: _array(at, call["dtype"]) for name, at in zip(call["arrays"], inputs)}
    settings = {name: call[name] for name in ("count", "width", "height", "sh_degree", "near", "far", "blur", "antialiased",
                                              "blend_rule", "smooth", "dtype")}
    return Arguments(arrays=arrays, cameras=None, views=1, has_view_axis=False, shape="", opacity="", color="colors",
                     channels=arrays["features"].shape[1] if "features" in arrays else 0, pictures=pictures,
                     rows=ROWS if "rows" in call["shapes"] else (), max_instances=None, **settings)


def _register():
    header = Path(jax.ffi.include_dir(), "xla", "ffi", "api", "c_api.h").read_text()
    major, minor = (int(re.search(rf"#define XLA_FFI_API_{part} (\d+)", header)[1]) for part in ("MAJOR", "MINOR"))
    known = _gemsplat.XLA_VERSION
    if major != known[0] or minor < known[1]:  # later minor versions append to what earlier ones have
        raise UsageError(f"gemsplat knows version {known[0]}.{known[1]} of XLA's foreign function interface, and this jaxlib "
                         f"has {major}.{minor}; install jaxlib 0.11.2 or a newer gemsplat")
    for name, platform, handler in _gemsplat.jax_targets(minor):
        jax.ffi.register_ffi_target(name, handler, platform=platform)


_register()
