# SPDX-License-Identifier: Apache-2.0
"""3D Gaussian Splatting: scenes in, trained Gaussians out, with NumPy arrays at both ends.

    scene = gemsplat.Scene.load("path/to/scene", eval=True)
    result = gemsplat.train(scene, iterations=7000)
    result.model.save("model.ply")

docs/embedding.md has the whole story; __init__.pyi all signatures.
"""

from ._gemsplat import (
    Camera,
    Error,
    Evaluation,
    Model,
    OutOfMemoryError,
    Picture,
    Progress,
    Result,
    Scene,
    UsageError,
    View,
    ViewMetrics,
    __version__,
    cuda_device_count,
    evaluate,
    load,
    load_cameras,
    render,
    set_threads,
    set_verbosity,
    thread_count,
    train,
)

__all__ = [
    "Camera",
    "Error",
    "Evaluation",
    "Model",
    "OutOfMemoryError",
    "Picture",
    "Progress",
    "Result",
    "Scene",
    "UsageError",
    "View",
    "ViewMetrics",
    "__version__",
    "cuda_device_count",
    "evaluate",
    "load",
    "load_cameras",
    "render",
    "set_threads",
    "set_verbosity",
    "thread_count",
    "train",
]
