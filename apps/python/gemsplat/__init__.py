# SPDX-License-Identifier: Apache-2.0
"""3D Gaussian Splatting: scenes in, trained Gaussians out, with NumPy arrays at both ends.

    scene = gemsplat.Scene.load("path/to/scene", eval=True)
    result = gemsplat.train(scene, iterations=7000)
    result.model.save("model.ply")

gemsplat.jobs has every command of the program as a function. docs/reference/python.md explains all
of it; __init__.pyi and jobs.pyi, which the build makes, have the signatures.
"""

try:
    import numpy as _np  # what the arrays of a model and the pictures are
except ModuleNotFoundError as error:
    import sys

    error.msg = f"gemsplat needs NumPy, and {sys.executable} lacks it: install NumPy there, or use the Python that the module was built for, often /usr/bin/python3"
    raise

try:
    from ._gemsplat import (Camera, Error, Model, OutOfMemoryError, Progress, Scene, UsageError, View, __version__,
                            cuda_device_count, set_threads, set_verbosity, thread_count)
except ModuleNotFoundError as error:
    if error.name == "gemsplat._gemsplat":
        error.msg = "the compiled part of gemsplat is not built, or is for another Python: run scripts/setup.sh"
    raise
from . import jobs
from ._arrays import (Evaluation, Picture, Result, ViewMetrics, evaluate, export, load, load_cameras, merge,
                     nearest_distances, render, report, train)
from ._rasterize import Rendering, jvp, photometric_loss, rasterize, vjp
from ._trainer import Rows, StepView, Trainer

__all__ = [name for name in dir() if not name.startswith("_")] + ["__version__"]
