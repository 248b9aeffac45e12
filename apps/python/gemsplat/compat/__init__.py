# SPDX-License-Identifier: Apache-2.0
"""Modules of others by gemsplat, for scripts that stay as they are: docs/guide/compat.md.

    import gemsplat.compat
    gemsplat.compat.install("diff_gaussian_rasterization")    # before a script imports it

`python -m gemsplat.compat SCRIPT ARGUMENTS` does so for every module below, and runs a script.
"""

from __future__ import annotations

import difflib
import importlib
import sys
from typing import Any, Dict

from .._gemsplat import UsageError
from . import _report

__all__ = ["install", "report", "uninstall"]

_MODULES = {  # the names that a script imports, and the module of this package behind them
    "diff_gaussian_rasterization": {"diff_gaussian_rasterization": "diff_gaussian_rasterization"},
    "simple_knn": {"simple_knn": "simple_knn", "simple_knn._C": "simple_knn"},
    "fused_ssim": {"fused_ssim": "fused_ssim"},
    "gsplat": {"gsplat": "gsplat", "gsplat.rendering": "gsplat"},
}
_OPTIONS = {"diff_gaussian_rasterization": {"variant": "VARIANTS"}, "gsplat": {"api": "APIS"}}
_absent = object()
_replaced: Dict[str, Any] = {}  # what sys.modules had under a name


def install(name: str, **options: Any) -> None:
    """Lets later imports of a module find gemsplat's, until uninstall().

    name: diff_gaussian_rasterization, simple_knn, fused_ssim or gsplat. Where gsplat is installed, its function rasterization
    is replaced, and gets the calls that gemsplat does not draw.
    variant: of diff_gaussian_rasterization, 2023, aa, accel or depth_alpha; by default what a call gives decides.
    api: of gsplat, 1.4, 1.5 or 1.6; by default that of the installed one, or 1.6.

    Throws UsageError, which names the argument, and ModuleNotFoundError without PyTorch.
    """
    if name not in _MODULES:
        raise UsageError(f"name is one of {', '.join(_MODULES)}, and not {name!r}{_nearest(name, _MODULES)}")
    known = _OPTIONS.get(name, {})
    for option in options:
        if option not in known:
            raise UsageError(f"{name} has no option {option}{_nearest(option, known)}")
    chosen = {}
    for option, choices in known.items():
        chosen[option] = options.get(option)
        allowed = getattr(_module(name), choices)
        if chosen[option] is not None and chosen[option] not in allowed:
            raise UsageError(f"{option} is one of {', '.join(allowed)}, and not {chosen[option]!r}")
    module = _module(name)
    for option, value in chosen.items():
        setattr(module, option, value)
    if name == "gsplat" and module.patch():
        return
    for imported, ours in _MODULES[name].items():
        _replaced.setdefault(imported, sys.modules.get(imported, _absent))
        sys.modules[imported] = _module(ours)


def uninstall() -> None:
    """Gives back everything that install() replaced. What a script has imported by then stays with it."""
    for name, module in _replaced.items():
        if module is _absent:
            sys.modules.pop(name, None)
        else:
            sys.modules[name] = module
    _replaced.clear()
    for name, options in _OPTIONS.items():
        module = sys.modules.get(f"{__name__}.{name}")
        if module is not None:
            for option in options:
                setattr(module, option, None)
            if name == "gsplat":
                module.unpatch()


def report() -> str:
    """Which functions were called how often, by gemsplat or passed to an installed package, and why: a line for each."""
    return _report.text()


def _module(name):
    return importlib.import_module(f"{__name__}.{name}")


def _nearest(name, known):
    near = difflib.get_close_matches(name, known, 1)
    return f"; did you mean {near[0]}?" if near else ""
