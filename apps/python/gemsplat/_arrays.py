# SPDX-License-Identifier: Apache-2.0
"""Functions on models, scenes and cameras in memory. What a command takes, too, comes from its list."""

from __future__ import annotations

from os import PathLike, fspath
from pathlib import Path
from typing import Any, Callable, Iterable, NamedTuple, Optional, Sequence, Union

from numpy.typing import ArrayLike, NDArray
import numpy as np

from . import _gemsplat
from ._gemsplat import Camera, Model, Progress, Scene, UsageError
from ._classes import floats_of, three_numbers
from .jobs import as_json, takes

Text = Union[str, "PathLike[str]"]
Config = Any  # None, a name or path, a dict, or a list of these


class Picture(NamedTuple):
    """The result of render(): float32 arrays that own their memory.

    color: (height, width, 3), red green blue over the background, 0 to 1, sRGB as displayed.
    alpha: (height, width), how much of a pixel the Gaussians cover, 0 to 1.
    depth: (height, width), mean distance of the visible Gaussians along the viewing axis, world units,
    with the weights of the colors; 0 where alpha is close to 0. None unless depth=True.
    normals: (height, width, 3), normals of the surface given by the depth, in world space, of length 1,
    towards the camera; 0 where there is no depth. None unless normals=True.
    """

    color: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth: Optional[NDArray[np.float32]]
    normals: Optional[NDArray[np.float32]]


class ViewMetrics(NamedTuple):
    """One view against its photo: PSNR in dB, 100 if no pixel differs; SSIM; and as in Evaluation."""

    name: str
    psnr: float
    ssim: float
    flip: float
    lpips: Optional[float]


class Evaluation(NamedTuple):
    """Renders compared with photos, as in the papers: means over views, and each view.

    psnr: dB. ssim: 0 to 1. flip: 0 to 1, lower is better, the difference that an observer sees
    (Andersson et al. 2020). lpips: lower is better, the distance of a network's features (Zhang et al.
    2018), where lpips= or the setting eval.lpips names the file of its weights; else None.
    """

    psnr: float
    ssim: float
    flip: float
    lpips: Optional[float]
    views: list[ViewMetrics]

    def __repr__(self):
        return f"<gemsplat.Evaluation: {self.psnr:.2f} dB PSNR, {self.ssim:.4f} SSIM over {len(self.views)} views>"


class Result(NamedTuple):
    """The outcome of train().

    evaluation: of the test views; None if none is held out, and for a run that was finished before.
    metrics: one dict every train.log_every steps and after the last, of this call alone. steps: those
    done, including those before a resume. stopped_early: whether a callback ended the run. seconds: of
    training, without callbacks. device: its name. config: all settings, as TOML. output: the run's folder.
    """

    model: Model
    evaluation: Optional[Evaluation]
    metrics: list[dict[str, Any]]
    steps: int
    stopped_early: bool
    seconds: float
    device: str
    config: str
    output: Optional[Path]

    def __repr__(self):
        return f"<gemsplat.Result: {len(self.model)} Gaussians after {self.steps} steps on {self.device}>"


def _cameras(cameras):
    listed = list(cameras or ())
    if not all(isinstance(camera, Camera) for camera in listed):
        raise UsageError("cameras must be a list of Camera")
    return listed


def _evaluation(figures):
    return figures and Evaluation(*figures[:4], [ViewMetrics(*view) for view in figures[4]])


@takes("train", "images resolution test_every masks mask_mode invert_masks depth depth_kind photo_ram photo_cache eval "
       "refine_cameras exposure output resume checkpoint_every force export save_steps test_steps lpips iterations "
       "max_gaussians start_from filter_3d steps_scaler strategy seed deterministic background white_background "
       "antialiased blend_rule sh_degree device threads")
def train(scene: Union[Scene, Text], config: Config = None, *, callback: Optional[Callable[[Progress], Any]] = None,
          callback_every: int = 100, report: bool = True, **options: Any) -> Result:
    """Trains Gaussians on a Scene, or on the scene in a folder, and returns a Result.

    config: the name of a preset, a TOML file or a run's folder; a dict of settings, nested or with
    dots in the names ({"density.max_gaussians": 100000}); or a list of these, the later over the
    earlier; keyword arguments win. Settings of [dataset] are those of the Scene, where one is given.

    callback(progress) is called after every callback_every-th step and after the last. If it returns
    False, the run ends after one more step, with a Result. If it raises an exception, or Ctrl-C comes,
    the run ends at once and train() raises it. The GIL is released except during callbacks.

    Without output nothing is written. With output=FOLDER the run writes what `gemsplat train -o
    FOLDER` writes (docs/reference/run_folder.md); report=False leaves out report.html. There an
    exception or Ctrl-C ends the run after one more step, with model and checkpoint saved.
    """
    if callback_every < 1:
        raise UsageError("callback_every must be 1 or more")
    if not (callback is None or callable(callback)):
        raise UsageError("callback must be a function of one argument")

    def goes_on(progress):
        answer = callback(progress)
        return answer is not False and not (isinstance(answer, np.bool_) and not answer)

    has_folder = bool(options.get("output") or options.get("resume"))
    for name in ("checkpoint_every", "export", "force"):
        if options.get(name) and not has_folder:
            raise UsageError(f"{name} needs a run with a folder: give output=FOLDER")
    loaded = scene if isinstance(scene, Scene) else None
    if loaded is None:
        options["scene"] = scene
    found = _gemsplat.train(loaded, as_json(config), as_json(options), has_folder, callback and goes_on, callback_every,
                            report)
    return Result(**{**found, "evaluation": _evaluation(found["evaluation"])})


@takes("render", "device white_background antialiased blend_rule sh_degree")
def render(model: Model, camera: Union[Camera, Iterable[Camera]], *, background: Union[None, str, ArrayLike] = None,
           depth: bool = True, normals: bool = False, config: Config = None, **options: Any) -> Any:
    """Renders a Picture of the model from a Camera, or a list of them from an iterable of cameras.

    A GPU then gets the model only once. background: "black", "white" or three numbers 0 to 1; else the
    model's. Depth, and normals from it, take another pass like that of color and alpha. config:
    settings of [render] and [model] over the model's own, as train() takes them. Several threads may
    render; on one device they take turns.
    """
    if isinstance(background, str):
        options["background"], background = background, None
    elif background is not None:
        background = three_numbers("background", background)
    is_one = isinstance(camera, Camera)
    found = _gemsplat.render(model, [camera] if is_one else _cameras(camera), background, depth, normals,
                             as_json(config), as_json(options))
    pictures = [Picture(*arrays) for arrays in found]
    return pictures[0] if is_one else pictures


@takes("eval", "split device lpips background antialiased blend_rule sh_degree")
def evaluate(model: Model, scene: Scene, *, config: Config = None, **options: Any) -> Evaluation:
    """Renders the scene's test (or train) views and compares them with their photos."""
    return _evaluation(_gemsplat.evaluate(model, scene, as_json(config), as_json(options)))


@takes("export", "device spz_version spz_sh_bits duration")
def export(model: Model, path: Text, *, cameras: Optional[Iterable[Camera]] = None, replace: bool = False,
           **options: Any) -> dict[str, Any]:
    """Writes a model in the format that the name ends in, as `gemsplat export` does.

    A file beside it, NAME.transforms.json, has what the format cannot say (antialiased, world_offset).
    Returns a dict: file, format, gaussians, bytes, psnr, ssim. The last two compare pictures of the file
    with pictures of the model; they are None unless the format is lossy and cameras are given. A file
    that is there already is refused (UsageError), or with replace=True kept as NAME.bak-N.
    """
    names = ("file", "format", "gaussians", "bytes", "psnr", "ssim")
    return dict(zip(names, _gemsplat.export(model, path, _cameras(cameras), replace, as_json(options))))


@takes("export", "spz_version spz_sh_bits duration")
def save(self: Model, path: Text, *, replace: bool = False, **options: Any) -> int:
    """Writes a file as export() does, whole or not at all, and returns the number of Gaussians in it.

    Rows with NaN or infinity are left out, with a warning.
    """
    return export(self, path, replace=replace, **options)["gaussians"]


@takes("edit", "about plane whole decimate_by device")
def edit(self: Model, *operations: str, cameras: Optional[Iterable[Camera]] = None, **options: Any) -> Model:
    """A new model after operations, in their order: those of `gemsplat edit`, without dashes.

    model.edit("drop opacity=..0.05", "straighten", "decimate 0.5"); docs/guide/edit.md lists them.
    cameras: in the model's coordinates, all of which count as training views; by default those of the
    run from which the model was loaded.
    """
    if not all(isinstance(operation, str) for operation in operations):
        raise UsageError('operations are words, such as "keep opacity=0.1.."; rows of an array are kept with Model.keep')
    return _gemsplat.edit(self, operations, _cameras(cameras), as_json(options))


def keep(self: Model, rows: ArrayLike) -> Model:
    """A new model of the Gaussians where `rows`, an array of N booleans, is True."""
    rows = np.asarray(rows)
    if rows.dtype != bool or rows.shape != (len(self),):
        raise UsageError(f"rows must be an array of {len(self)} booleans, one for each Gaussian, such as model.opacities > 0.1")
    return _gemsplat.keep(self, rows)


def drop(self: Model, rows: ArrayLike) -> Model:
    """A new model of the Gaussians where `rows`, an array of N booleans, is False."""
    rows = np.asarray(rows)
    return self.keep(~rows if rows.dtype == bool else rows)


def merge(models: Sequence[Model], *, as_stored: bool = False, antialiased: Optional[bool] = None) -> Model:
    """A new model of all Gaussians of several models, in the frame of the first.

    Each one is brought there by way of the photos' frame; as_stored=True takes the numbers as they are.
    antialiased: whether the result is, where the models do not agree.
    """
    return _gemsplat.merge(models, as_stored, antialiased)


def load(path: Text, step: Optional[int] = None) -> Model:
    """Reads the model of a file of any format, of a folder of SOG files, or of a run's folder.

    Of a run it is the newest one, or that after `step`. Values stay as they are in the file, also NaN
    and infinity.
    """
    return _gemsplat.load(path, step)


def load_scene(path: Text, **settings: Any) -> Scene:
    """A folder with photos and a COLMAP model, or a transforms.json.

    Keywords are the settings of [dataset] (docs/reference/settings.md): eval=True holds out every
    test_every-th view, resolution=4 divides the photos' size by 4, 16 and more is their width, images,
    masks, model, and so on.
    """
    return _gemsplat.load_scene(path, as_json({"dataset": settings}))


def report(folder: Text, output: Optional[Text] = None) -> Path:
    """Writes the report of a run's folder, finished or not, or of an experiment's output.

    It is one HTML file that opens in a browser, FOLDER/report.html by default. Returns its path.
    """
    return _gemsplat.write_report(folder, output or Path(folder) / "report.html")


def load_cameras(path: Text, world_offset: Optional[ArrayLike] = None) -> list[Camera]:
    """The cameras of a cameras.json, as runs hold one, with `world_offset` (a model's) taken off."""
    return _gemsplat.load_cameras(path, three_numbers("world_offset", (0, 0, 0) if world_offset is None else world_offset))


def nearest_distances(points: ArrayLike, k: int = 3) -> NDArray[np.float32]:
    """Mean squared distance from each of N points (N, 3) to its k nearest others, 1 to 16.   (N,)

    Where there are fewer than k others, it is the mean over all of them; a single point has 0.
    """
    if k not in range(1, _gemsplat.MOST_NEAREST + 1):
        raise UsageError(f"k must lie between 1 and {_gemsplat.MOST_NEAREST}, but is {k!r}")
    return _gemsplat.nearest_distances(floats_of("points", points, (None, 3)), int(k))


Model.save, Model.edit, Model.keep, Model.drop = save, edit, keep, drop
Scene.load = staticmethod(load_scene)
