# SPDX-License-Identifier: Apache-2.0
"""rasterize() and its derivatives for NumPy arrays, by the exact renderer, in float64.

Two steps lead from the arguments to what the renderer takes for one view: activations, which are
taken element by element, and a choice of parts, which is linear. Derivatives repeat or transpose them.
"""

from __future__ import annotations

import numpy as np

from ._arguments import is_per_view, matrices_of, of_shape_of
from ._classes import real_array
from ._gemsplat import UsageError, exact_footprints, exact_gradients, exact_picture, exact_slopes
from ._rasterize import Rendering

_SETTINGS = ("width", "height", "sh_degree", "channels", "near", "far", "blur", "antialiased", "blend_rule", "smooth")
_RENDERER_NAMES = {"scales": "log_scales", "logit_opacities": "opacities"}


def arrays_of(given):
    """Arrays, lists and numbers by name as arrays of the dtype of means; integers become float64."""
    arrays = {name: real_array(name, value) for name, value in given.items()}
    dtype = np.float32 if arrays["means"].dtype == np.float32 else np.float64
    return {name: array.astype(dtype, copy=False) for name, array in arrays.items()}


def rasterize(arguments):
    values, _ = _activated(arguments)
    return _rendering([exact_picture(_of_view(values, arguments, view), _settings(arguments, view))
                       for view in range(arguments.views)], arguments)


def footprints(arguments, _, *rule):
    """Those of the only view, by name."""
    values, _ = _activated(arguments)
    return exact_footprints(_of_view(values, arguments, 0), _settings(arguments, 0), *rule)


def vjp(arguments):
    """The Rendering, and the function that pulls gradients back through it."""
    values, derivatives = _activated(arguments)
    inputs = [_of_view(values, arguments, view) for view in range(arguments.views)]
    settings = [_settings(arguments, view) for view in range(arguments.views)]
    rendering = _rendering([exact_picture(*pair) for pair in zip(inputs, settings)], arguments)

    def pull(image=None, alpha=None, depth=None, inverse_depth=None, features=None):
        given = {"image": image, "alpha": alpha, "depth": depth, "inverse_depth": inverse_depth, "features": features}
        given = {name: _like(name, value, getattr(rendering, name)) for name, value in given.items() if value is not None}
        sums = {name: np.zeros(array.shape) for name, array in arguments.arrays.items()}
        for view in range(arguments.views):
            of_view = {name: value[view] if arguments.has_view_axis else value for name, value in given.items()}
            _add(sums, exact_gradients(inputs[view], of_view, settings[view]), view)
        return {name: (sum * derivatives.get(name, 1)).astype(arguments.dtype) for name, sum in sums.items()}

    return rendering, pull


def jvp(arguments, tangents):
    """The Rendering, and a Rendering of how its pictures change as the arrays change by `tangents`."""
    for name in tangents:
        if name not in arguments.arrays:
            raise UsageError(f"tangents has {name}, which is not among the arrays of arguments")
    values, derivatives = _activated(arguments)
    slopes = {name: _like(name, tangents.get(name, np.zeros(array.shape)), array) * derivatives.get(name, 1)
              for name, array in arguments.arrays.items()}
    pairs = [(_of_view(values, arguments, view), _of_view(slopes, arguments, view)) for view in range(arguments.views)]
    settings = [_settings(arguments, view) for view in range(arguments.views)]
    rendering = _rendering([exact_picture(inputs, each) for (inputs, _), each in zip(pairs, settings)], arguments)
    changes = [exact_slopes(*pair, each) for pair, each in zip(pairs, settings)]
    return rendering, Rendering(**_pictures(changes, arguments))


def _settings(arguments, view):
    lens = {"camera": arguments.lenses[view]} if arguments.lenses else {}
    return {**{name: getattr(arguments, name) for name in _SETTINGS}, **lens}


def _activated(arguments):
    """The arrays after activations, by their own names, and the derivatives of these activations."""
    values = {name: np.asarray(array, np.float64) for name, array in arguments.arrays.items()}
    derivatives = {}
    if "scales" in values:  # only their squares count, so that a sign does not
        scales = values["scales"]
        derivatives["scales"] = np.divide(1, scales, out=np.zeros_like(scales), where=scales != 0)
        with np.errstate(divide="ignore"):
            values["scales"] = np.log(np.abs(scales))
    if "logit_opacities" in values:
        opacities = np.exp(-np.logaddexp(0, -values["logit_opacities"]))
        values["logit_opacities"], derivatives["logit_opacities"] = opacities, opacities * (1 - opacities)
    if arguments.cameras:
        matrices = zip(("viewmats", "Ks"), matrices_of(arguments.cameras))
        values.update((name, array if arguments.has_view_axis else array[0]) for name, array in matrices)
    values.setdefault("background", np.zeros(3))
    if arguments.color is None:
        values["colors"] = np.zeros((arguments.count, 3))
    return values, derivatives


def _of_view(arrays, arguments, view):
    """What the renderer takes for a view, by its names: parts of activated arrays, or of their changes."""
    inputs = {_RENDERER_NAMES.get(name, name): array[view] if is_per_view(name, array) else array
              for name, array in arrays.items()}
    if "sh0" in inputs:
        inputs["sh"] = np.concatenate([inputs.pop("sh0")[:, None], inputs.pop("sh_rest", np.zeros((arguments.count, 0, 3)))], 1)
    if "sh" in inputs:
        inputs["sh"] = inputs["sh"][:, :(arguments.sh_degree + 1)**2]
    return inputs


def _add(sums, gradients, view):
    """Adds the gradients by what _of_view() gave to those by the arrays that it was made of."""
    for name, sum in sums.items():
        if name in ("sh", "sh0", "sh_rest"):
            gradient = gradients["sh"]
            part = {"sh": gradient, "sh0": gradient[:, 0], "sh_rest": gradient[:, 1:]}[name]
            sum[:, :part.shape[1]] += part
        else:
            (sum[view] if is_per_view(name, sum) else sum)[...] += gradients[_RENDERER_NAMES.get(name, name)]


def _like(name, value, wanted):
    """An array of float64 of the shape of `wanted`."""
    return of_shape_of(name, np.asarray(value, np.float64), wanted)


def _stacked(pictures, name, arguments):
    return np.stack([picture[name] for picture in pictures]) if arguments.has_view_axis else pictures[0][name]


def _pictures(pictures, arguments):
    drawn = arguments.pictures + (("features",) if arguments.channels else ())
    return {name: _stacked(pictures, name, arguments).astype(arguments.dtype) for name in drawn}


def _rendering(pictures, arguments):
    radii = _stacked(pictures, "radii", arguments)
    rows = {"visible": radii > 0, "radii": radii}
    for name in arguments.rows:
        if name not in rows:
            rows[name] = _stacked(pictures, name, arguments).astype(arguments.dtype)
    return Rendering(**_pictures(pictures, arguments), **{name: rows[name] for name in arguments.rows})
