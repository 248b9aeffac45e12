# SPDX-License-Identifier: Apache-2.0
# Signatures of the module. Docstrings (help(gemsplat.train)) say what the arguments mean.
from os import PathLike
from pathlib import Path
from typing import Any, Callable, Iterable, Literal, Mapping, Optional, Sequence, Tuple, TypedDict, Union, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path = Union[str, PathLike[str]]
_Config = Union[None, _Path, Mapping[str, Any], Sequence["_Config"]]
_Background = Union[None, Literal["black", "white"], ArrayLike]
_Floats = NDArray[np.float32]
_Bytes = NDArray[np.uint8]
_Offset = Tuple[float, float, float]

__version__: str

class Error(RuntimeError): ...
class UsageError(Error, ValueError): ...
class OutOfMemoryError(Error, MemoryError): ...

class Model:
    def __init__(
        self,
        *,
        means: ArrayLike,
        rotations: ArrayLike,
        scales: Optional[ArrayLike] = None,
        log_scales: Optional[ArrayLike] = None,
        opacities: Optional[ArrayLike] = None,
        logit_opacities: Optional[ArrayLike] = None,
        colors: Optional[ArrayLike] = None,
        sh0: Optional[ArrayLike] = None,
        sh_rest: Optional[ArrayLike] = None,
        antialiased: bool = False,
        world_offset: Optional[ArrayLike] = None,
    ) -> None: ...
    # stored values: views
    @property
    def means(self) -> _Floats: ...  # (N, 3)
    @property
    def log_scales(self) -> _Floats: ...  # (N, 3)
    @property
    def rotations(self) -> _Floats: ...  # (N, 4)
    @property
    def logit_opacities(self) -> _Floats: ...  # (N,)
    @property
    def sh0(self) -> _Floats: ...  # (N, 3)
    @property
    def sh_rest(self) -> _Floats: ...  # (N, K, 3)
    # activated values: copies
    @property
    def scales(self) -> _Floats: ...  # (N, 3)
    @property
    def unit_rotations(self) -> _Floats: ...  # (N, 4)
    @property
    def opacities(self) -> _Floats: ...  # (N,)
    @property
    def colors(self) -> _Floats: ...  # (N, 3)
    @property
    def sh_degree(self) -> int: ...
    @property
    def antialiased(self) -> bool: ...
    @property
    def world_offset(self) -> _Offset: ...
    def __len__(self) -> int: ...
    def copy(self) -> Model: ...
    def edit(
        self,
        *operations: str,
        cameras: Optional[Iterable[Camera]] = None,
        about: Optional[ArrayLike] = None,
        plane: str = "xz",
        whole: bool = False,
        decimate_by: str = "merge",
        device: str = "auto",
    ) -> Model: ...
    def keep(self, rows: ArrayLike) -> Model: ...
    def drop(self, rows: ArrayLike) -> Model: ...
    def save(
        self, path: _Path, *, replace: bool = False, spz_version: int = 3, spz_sh_bits: int = 0
    ) -> int: ...

class Camera:
    def __init__(
        self,
        width: int,
        height: int,
        fx: float,
        fy: Optional[float] = None,
        cx: Optional[float] = None,
        cy: Optional[float] = None,
        cam_from_world: Optional[ArrayLike] = None,
        name: str = "",
        time: float = 0.0,
    ) -> None: ...
    @property
    def name(self) -> str: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def cam_from_world(self) -> NDArray[np.float64]: ...  # (4, 4)
    @property
    def position(self) -> NDArray[np.float64]: ...  # (3,)
    @property
    def time(self) -> float: ...
    def at_time(self, time: float) -> Camera: ...
    def at_resolution(self, resolution: int) -> Camera: ...

class View:
    @property
    def name(self) -> str: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def photo(self) -> _Bytes: ...  # (height, width, 3)
    @property
    def mask(self) -> Optional[_Bytes]: ...  # (height, width)
    @property
    def exposure(self) -> Tuple[float, float, float]: ...

class Scene:
    def __init__(
        self,
        train: Iterable[Tuple[Camera, ArrayLike]],
        test: Iterable[Tuple[Camera, ArrayLike]] = (),
        *,
        points: Optional[ArrayLike] = None,
        point_colors: Optional[ArrayLike] = None,
    ) -> None: ...
    @staticmethod
    def load(path: _Path, **settings: Any) -> Scene: ...
    @property
    def train_views(self) -> list[View]: ...
    @property
    def test_views(self) -> list[View]: ...
    @property
    def points(self) -> _Floats: ...  # (M, 3)
    @property
    def point_colors(self) -> _Bytes: ...  # (M, 3)
    @property
    def extent(self) -> float: ...
    @property
    def source(self) -> str: ...
    @property
    def world_offset(self) -> _Offset: ...

class Picture:
    @property
    def color(self) -> _Floats: ...  # (height, width, 3)
    @property
    def alpha(self) -> _Floats: ...  # (height, width)
    @property
    def depth(self) -> Optional[_Floats]: ...  # (height, width)
    @property
    def normals(self) -> Optional[_Floats]: ...  # (height, width, 3)

class ViewMetrics:
    @property
    def name(self) -> str: ...
    @property
    def psnr(self) -> float: ...
    @property
    def ssim(self) -> float: ...
    @property
    def flip(self) -> float: ...
    @property
    def lpips(self) -> Optional[float]: ...

class Evaluation:
    @property
    def psnr(self) -> float: ...
    @property
    def ssim(self) -> float: ...
    @property
    def flip(self) -> float: ...
    @property
    def lpips(self) -> Optional[float]: ...
    @property
    def views(self) -> list[ViewMetrics]: ...

class Progress:
    @property
    def step(self) -> int: ...
    @property
    def steps(self) -> int: ...
    @property
    def loss(self) -> float: ...
    @property
    def gaussian_count(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    def snapshot(self) -> Model: ...

class _MetricsRow(TypedDict):
    step: int
    loss: float
    gaussian_count: int
    seconds: float

class Result:
    @property
    def model(self) -> Model: ...
    @property
    def evaluation(self) -> Optional[Evaluation]: ...
    @property
    def metrics(self) -> list[_MetricsRow]: ...
    @property
    def steps(self) -> int: ...
    @property
    def stopped_early(self) -> bool: ...
    @property
    def seconds(self) -> float: ...
    @property
    def device(self) -> str: ...
    @property
    def config(self) -> str: ...
    @property
    def output(self) -> Optional[Path]: ...

class _ExportedFile(TypedDict):
    file: Path
    format: str
    gaussians: int
    bytes: int
    psnr: Optional[float]
    ssim: Optional[float]

def load(path: _Path, step: Optional[int] = None) -> Model: ...
def merge(models: Sequence[Model], *, as_stored: bool = False, antialiased: Optional[bool] = None) -> Model: ...
def load_cameras(path: _Path, world_offset: Optional[ArrayLike] = None) -> list[Camera]: ...
@overload
def render(
    model: Model,
    camera: Camera,
    *,
    background: _Background = None,
    device: str = "auto",
    depth: bool = True,
    normals: bool = False,
    config: _Config = None,
) -> Picture: ...
@overload
def render(
    model: Model,
    camera: Iterable[Camera],
    *,
    background: _Background = None,
    device: str = "auto",
    depth: bool = True,
    normals: bool = False,
    config: _Config = None,
) -> list[Picture]: ...
def evaluate(
    model: Model,
    scene: Scene,
    *,
    split: Literal["test", "train"] = "test",
    device: str = "auto",
    config: _Config = None,
) -> Evaluation: ...
def train(
    scene: Union[Scene, _Path],
    config: _Config = None,
    *,
    iterations: Optional[int] = None,
    seed: Optional[int] = None,
    device: Optional[str] = None,
    callback: Optional[Callable[[Progress], Optional[bool]]] = None,
    callback_every: int = 100,
    output: Optional[_Path] = None,
    resume: Union[None, bool, _Path] = None,
    checkpoint_every: Optional[int] = None,
    export: Sequence[str] = (),
    report: bool = True,
    force: bool = False,
) -> Result: ...
def export(
    model: Model,
    path: _Path,
    *,
    cameras: Optional[Iterable[Camera]] = None,
    device: str = "auto",
    replace: bool = False,
    spz_version: int = 3,
    spz_sh_bits: int = 0,
) -> _ExportedFile: ...
def report(folder: _Path, output: Optional[_Path] = None) -> Path: ...
def set_verbosity(name: Literal["quiet", "normal", "verbose"]) -> None: ...
def set_threads(threads: int) -> None: ...
def thread_count() -> int: ...
def cuda_device_count() -> int: ...
