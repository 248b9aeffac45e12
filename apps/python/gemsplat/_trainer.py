# SPDX-License-Identifier: Apache-2.0
"""Trainer: training step by step, with a loss and a density strategy of Python in the fused step.

Arrays are copies of what the trainer holds, so that they can be kept. _NumPy and _Torch know the two
kinds of them; nothing here is linked to PyTorch, and it is imported where it is asked for.
"""

from __future__ import annotations

import contextlib
import weakref
from typing import Any, Callable, Mapping, NamedTuple, Optional, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _gemsplat
from ._arrays import Config, Evaluation, Picture, Text, _evaluation, render
from ._classes import floats_of
from ._gemsplat import Camera, Model, Place, Progress, Scene, UsageError
from .jobs import as_json, takes

_NEEDS = ("mean2d", "absolute", "visible")
_SPLIT_SHRINK = 1.6  # kSplitScaleDivisor of gs_core/math/constants.h
# Of Rows: the column, and the shape of a row.
_PARAMETERS = {"means": ("mean", (3,)), "log_scales": ("log_scale", (3,)), "rotations": ("rotation", (4,)),
               "logit_opacities": ("logit_opacity", ()), "sh0": ("sh0", (3,)), "sh_rest": ("sh_rest", (15, 3))}
_STATISTICS = {"visible": "visits", "mean2d": "gradient_norm"}


class StepView(NamedTuple):
    """What a loss compares its image with. Arrays are of the trainer's framework.

    name: of the photo. camera: of the picture, smaller than the photo's while photos are reduced.
    image: (H, W, 3) float32, the photo, 0 to 1, sRGB. mask: (H, W) float32, how much a pixel
    trains, 0 to 1; None if every pixel trains.
    """

    name: str
    camera: Camera
    image: Any
    mask: Any


class Rows:
    """The Gaussians of a Trainer while it trains, for a strategy, or between two steps.

    Arrays are copies, of the trainer's framework, in its memory: assign one to change the rows
    (rows.means = means + 1). An index is an array of row numbers or of N booleans.
    """

    def __init__(self, core: Any, arrays: Any) -> None:
        """Of a Trainer, which has it as `rows`."""
        self._core, self._arrays = core, arrays

    @property
    def count(self) -> int:
        """N, the number of Gaussians."""
        return self._core.count

    @property
    def scene_extent(self) -> float:
        """Radius of the cameras' positions, world units."""
        return self._core.extent

    @property
    def statistics(self) -> Mapping[str, Any]:
        """Sums since they were cleared, (N,) float32 each, over the steps for which a strategy needs them.

        "visible": steps in which a Gaussian was visible. "mean2d": the length of the loss's gradient by
        its place in the picture, in units of half the picture; where the strategy needs "absolute", of a
        gradient that sums absolute values over pixels (AbsGS).
        """
        return {name: self._read(column, ()) for name, column in _STATISTICS.items()}

    def clear_statistics(self) -> None:
        """Sets all of them to 0, as a refinement does in the end."""
        self._core.clear_statistics()

    def keep(self, mask: ArrayLike) -> None:
        """Keeps the Gaussians where `mask`, an array of N booleans, is True."""
        mask = _on_host(mask)
        if mask.dtype != bool or mask.shape != (self.count,):
            raise UsageError(f"mask must be an array of {self.count} booleans, one for each Gaussian")
        self._apply(np.where(mask, _KEEP, _PRUNE))

    def clone(self, index: ArrayLike) -> None:
        """Adds a copy of each of these Gaussians, in their order, at the end, with moments and statistics of 0."""
        self._act(index, _CLONE)

    def split(self, index: ArrayLike, parts: int = 2, shrink: float = 1.6) -> None:
        """Replaces each of these Gaussians by smaller ones, at the end: drawn from it, scales / shrink.

        The draws depend on the seed and the step alone.
        """
        if parts < 1 or not shrink > 0:
            raise UsageError(f"parts must be 1 or more and shrink above 0, but they are {parts} and {shrink}")
        index = self._numbers("index", index)
        first = self.count - len(index)  # of the new ones
        self._act(index, _SPLIT, parts)
        if shrink != _SPLIT_SHRINK:
            scales = self.log_scales
            scales[first:] += float(np.log(_SPLIT_SHRINK / shrink))
            self.log_scales = scales

    def append(self, *, means: ArrayLike, rotations: ArrayLike, log_scales: ArrayLike, logit_opacities: ArrayLike,
               sh0: ArrayLike, sh_rest: Optional[ArrayLike] = None) -> None:
        """Adds Gaussians at the end, by arrays of the shapes of the properties; sh_rest is 0 without one."""
        if self._core.moves:
            raise UsageError("append() makes Gaussians that stand still; train without model.dynamic")
        given = {"means": means, "rotations": rotations, "log_scales": log_scales, "logit_opacities": logit_opacities,
                 "sh0": sh0, **({} if sh_rest is None else {"sh_rest": sh_rest})}
        count, first = len(means), self.count
        taken = {name: self._arrays.taken(name, array, (count, *_PARAMETERS[name][1])) for name, array in given.items()}
        self._core.append(count)
        for name, array in taken.items():
            self._write(_PARAMETERS[name][0], array, first)

    def relocate(self, dead: ArrayLike, source: ArrayLike) -> None:
        """Makes each dead Gaussian a copy of a source, as many as there are of both (3DGS-MCMC).

        A source and its copies together look like the source before; their moments are 0.
        """
        dead, source = self._numbers("dead", dead), self._numbers("source", source, are_several=True)
        if len(dead) != len(source) or np.isin(source, dead).any():
            raise UsageError("dead and source must be of one length, and no Gaussian dead and a source")
        self._core.replace(dead, source)

    def lower_opacity(self, maximum: float) -> None:
        """Lowers opacities to at most `maximum`, and clears their moments."""
        if not 0 < maximum < 1:
            raise UsageError(f"maximum must lie between 0 and 1, but is {maximum}")
        self._core.lower_opacity(maximum)

    def _numbers(self, name, index, are_several=False):
        index = _on_host(index)
        if index.dtype == bool and index.shape == (self.count,):
            return np.flatnonzero(index)
        if index.ndim != 1 or (index.dtype.kind not in "iu" and len(index)):
            raise UsageError(f"{name} must be an array of row numbers, or of {self.count} booleans")
        if len(index) and not (0 <= index.min() and index.max() < self.count):
            raise UsageError(f"{name} must lie between 0 and {self.count - 1}, but has {index.min()} to {index.max()}")
        if not are_several and len(np.unique(index)) < len(index):
            raise UsageError(f"{name} has a row number twice")
        return index.astype(np.int64)

    def _act(self, index, action, parts=2):
        actions = np.full(self.count, _KEEP)
        actions[self._numbers("index", index)] = action
        self._apply(actions, parts)

    def _apply(self, actions, parts=2):
        self._core.apply(actions.astype(np.uint8), parts)

    def _read(self, column, row):
        array = self._arrays.empty((self.count, *row))
        self._arrays.wait()
        self._core.read(column, self._arrays.place(array))
        return array

    def _write(self, column, array, first=0):
        self._arrays.wait()
        self._core.write(column, self._arrays.place(array), first)


_KEEP, _CLONE, _SPLIT, _PRUNE = range(4)  # GrowthAction of gs_core/math/density/growth.h


def _parameter(name, column, row):
    def get(self) -> Any:
        return self._read(column, row)

    def set(self, array: ArrayLike) -> None:
        self._write(column, self._arrays.taken(name, array, (self.count, *row)))

    return property(get, set, doc=f"(N{''.join(f', {length}' for length in row)}) float32: as Model has them. A copy.")


for _name, (_column, _row) in _PARAMETERS.items():
    setattr(Rows, _name, _parameter(_name, _column, _row))


class Trainer:
    """Trains Gaussians step by step: what train() computes, with a loss and a strategy of your own in it.

    Drawing, its gradient, and the update by Adam stay the fused ones of train(). Use it as a `with`
    block, or call close() where the memory of a GPU is wanted back.
    """

    @takes("train", "images resolution test_every masks mask_mode invert_masks depth depth_kind photo_ram photo_cache "
           "eval refine_cameras exposure lpips iterations max_gaussians start_from filter_3d steps_scaler seed "
           "deterministic background white_background antialiased blend_rule sh_degree device threads")
    def __init__(self, scene: Union[Scene, Text], config: Config = None, *, loss: Optional[Callable[..., Any]] = None,
                 sees_depth: bool = False, strategy: Any = None, framework: str = "numpy", **options: Any) -> None:
        """Of a Scene, or the scene in a folder; config and other keywords as train() takes them.

        loss(image, view, step) takes the place of the settings' loss. image: (H, W, 3) float32, as drawn,
        of the framework, "numpy" or "torch". With torch it is a leaf that requires a gradient, on the
        trainer's device, and the loss returns a scalar tensor, on which backward() is called. Any loss may
        return a tuple instead: its value, and its gradient by image, (H, W, 3). An exception ends the
        step before it has changed anything, and comes out of step(), which can be called again.

        sees_depth: the loss is loss(image, view, step, alpha, depth), both (H, W) as of rasterize(), and a
        tuple has their gradients, too. The settings' depth loss rests then.

        strategy: a word of density.strategy, or an object with after_step(rows, step, random), which is
        called after every step with Rows and a numpy.random.Generator of seed and step. needs(step)
        names the statistics that the step gathers, of "mean2d", "absolute" and "visible"; an object without it
        has "mean2d" and "visible". An exception comes out of step(), which is done.
        """
        if framework not in ("numpy", "torch"):
            raise UsageError(f'framework takes "numpy" or "torch", and not {framework!r}')
        if not (loss is None or callable(loss)):
            raise UsageError("loss must be a function of image, view and step")
        if isinstance(strategy, str):
            options["strategy"], strategy = strategy, None
        if not (strategy is None or callable(getattr(strategy, "after_step", None))):
            raise UsageError("strategy must be a word, or an object with after_step(rows, step, random)")
        self._loss, self._sees_depth, self._strategy = loss, sees_depth, strategy
        loaded = scene if isinstance(scene, Scene) else None
        if loaded is None:
            options["scene"] = scene
        this = weakref.ref(self)  # the core does not keep this object alive
        self._core = _gemsplat.TrainerCore(
            loaded, as_json(config), as_json(options), loss and (lambda picture, step: this()._compare(picture, step)), sees_depth,
            strategy and (lambda step: this()._needs(step)), strategy and (lambda step: this()._after_step(step)))
        self._device = self._core.device.split()[0]
        self._arrays = (_NumPy if framework == "numpy" else _Torch)(self._device)
        self._rows = Rows(self._core, self._arrays)

    def step(self) -> Progress:
        """Takes the next step, or batch of steps. Progress holds until the next one.

        The last step ends the run as train() does: faint Gaussians are removed, and all are sorted.
        """
        return self._core.step()

    def run(self, steps: Optional[int] = None) -> Progress:
        """Takes so many steps, or those that are left, and returns Progress."""
        left = self._core.steps - self._core.steps_done
        if steps is not None and not 1 <= steps <= left:
            raise UsageError(f"steps must lie between 1 and {left}, which are left, but is {steps}")
        goal = self._core.steps_done + (left if steps is None else steps)
        progress = self.step()
        while progress.step < goal:
            progress = self.step()
        return progress

    @property
    def model(self) -> Model:
        """The Model as the run would leave it if it ended now. A copy."""
        return self._core.model()

    @property
    def rows(self) -> Rows:
        """The Gaussians as they are trained."""
        return self._rows

    def render(self, camera: Camera, **options: Any) -> Picture:
        """A Picture of the model now, as render() draws it."""
        return render(self.model, camera, **{"device": self._device, **options})

    def evaluate(self) -> Evaluation:
        """Compares the model now with the photos of the views that are held out."""
        return _evaluation(self._core.evaluate())

    def save(self, path: Text) -> None:
        """Writes a checkpoint, from which load() goes on: docs/reference/checkpoints.md.

        Where the strategy has state_dict(), a dict of arrays and numbers, PATH.strategy.npz has it.
        """
        self._core.save(path)
        if hasattr(self._strategy, "state_dict"):
            np.savez(f"{path}.strategy.npz", **{name: _on_host(value) for name, value in self._strategy.state_dict().items()})

    def load(self, path: Text) -> None:
        """Goes on from a checkpoint of a run on the same scene, with the settings of this trainer.

        A strategy gets its state back by load_state_dict(), as NumPy arrays. Nothing changes where a file
        cannot be read.
        """
        state = None
        if hasattr(self._strategy, "state_dict"):
            with np.load(f"{path}.strategy.npz", allow_pickle=False) as file:
                state = dict(file)
        self._core.load(path)
        if state is not None:
            self._strategy.load_state_dict(state)

    def close(self) -> None:
        """Gives all memory back. The trainer cannot be used any more."""
        self._core.close()

    def __enter__(self) -> Trainer:
        return self

    def __exit__(self, *error: Any) -> None:
        self.close()

    def _compare(self, picture, step):
        with self._arrays.beside(self._core.stream):
            return self._pulled_back(picture, step)

    def _pulled_back(self, picture, step):
        arrays, camera = self._arrays, picture.camera
        size = camera.height, camera.width
        planes = [arrays.empty(shape) for shape in ((3, *size), size, size)[:3 if self._sees_depth else 1]]
        photo = [arrays.empty((*size, 3), "uint8")] + ([arrays.empty(size, "uint8")] if picture.has_mask else [])
        picture.read(*([arrays.place(array) for array in pictures] for pictures in (planes, photo)))
        shown = [arrays.share_of_255(array) for array in photo]
        view = StepView(camera.name, camera, shown[0], shown[1] if picture.has_mask else None)
        pictures = [arrays.pixels_of(planes[0]), *(1 - left for left in planes[1:2]), *planes[2:]]
        answer = arrays.compare(self._loss, pictures, view, step)
        if not (isinstance(answer, tuple) and len(answer) == 1 + len(pictures)):
            raise UsageError("a loss returns a scalar tensor of torch, or a tuple: its value, and its gradient by each picture")
        value, *gradients = answer
        if all(gradient is None for gradient in gradients):
            raise UsageError("a loss must depend on image; compute it from that")
        pulled = [arrays.taken("the gradient of a loss", 0 * of if by is None else by, tuple(of.shape), packed=False)
                  for by, of in zip(gradients, pictures)]
        pulled = [arrays.planes_of(pulled[0]), *(arrays.packed(by) for by in pulled[1:])]
        picture.write([arrays.place(array) for array in pulled])
        return value

    def _needs(self, step):
        words = self._strategy.needs(step) if hasattr(self._strategy, "needs") else ("mean2d", "visible")
        for word in words:
            if word not in _NEEDS:
                raise UsageError(f"a strategy needs some of {', '.join(_NEEDS)}, and not {word!r}")
        return list(words)

    def _after_step(self, step):
        self._strategy.after_step(self._rows, step, np.random.default_rng((self._core.seed, step)))


def _on_host(array):
    """As a NumPy array, also of a tensor on a GPU."""
    return np.asarray(array.detach().cpu() if hasattr(array, "detach") else array)


class _NumPy:
    """Arrays in host memory."""

    def __init__(self, device):
        pass

    def empty(self, shape, dtype="float32"):
        return np.empty(shape, dtype)

    def taken(self, name, array, shape, packed=True):
        return floats_of(name, array, shape)

    def packed(self, array):
        return array

    def place(self, array):
        return Place(array.ctypes.data, True)

    def wait(self):
        pass

    def beside(self, _):
        return contextlib.nullcontext()

    def share_of_255(self, array):
        return array / np.float32(255)

    def pixels_of(self, planes):
        return planes.transpose(1, 2, 0)

    def planes_of(self, pixels):
        return np.ascontiguousarray(pixels.transpose(2, 0, 1))

    def compare(self, loss, pictures, view, step):
        """What the loss returns, of torch with its gradients."""
        image, *more = pictures
        return loss(image, view, step, *more)


class _Torch:
    """Tensors in the memory of the device."""

    def __init__(self, device):
        import torch

        self._torch, self._device = torch, torch.device(device)

    def empty(self, shape, dtype="float32"):
        return self._torch.empty(shape, dtype=getattr(self._torch, dtype), device=self._device)

    def taken(self, name, array, shape, packed=True):
        tensor = self._torch.as_tensor(array, dtype=self._torch.float32, device=self._device).detach()
        if tuple(tensor.shape) != shape:
            raise UsageError(f"{name} must have the shape {shape}, but has {tuple(tensor.shape)}")
        return self.packed(tensor) if packed else tensor

    def packed(self, tensor):
        return tensor.contiguous()

    def place(self, tensor):
        return Place(tensor.data_ptr(), self._device.type == "cpu")

    def wait(self):
        """Until torch has done what it was asked for: the trainer works on a stream of its own."""
        if self._device.type == "cuda":
            self._torch.cuda.current_stream(self._device).synchronize()

    @contextlib.contextmanager
    def beside(self, stream):
        """What torch does in it is done on the trainer's stream, and in the order of the caller's own."""
        if not stream:
            yield
            return
        cuda = self._torch.cuda
        theirs, ours = cuda.current_stream(self._device), cuda.ExternalStream(stream, self._device)
        ours.wait_stream(theirs)
        with cuda.stream(ours):
            yield
        theirs.wait_stream(ours)

    def share_of_255(self, tensor):
        # Planes of a photo lie apart, as those of the image do: kernels that take planes copy neither.
        return self.pixels_of(self.planes_of(tensor) / 255) if tensor.dim() == 3 else tensor / 255

    def pixels_of(self, planes):
        return planes.permute(1, 2, 0)

    def planes_of(self, pixels):
        return pixels.permute(2, 0, 1).contiguous()

    def compare(self, loss, pictures, view, step):
        image, *more = (picture.requires_grad_() for picture in pictures)
        with self._torch.enable_grad():
            answer = loss(image, view, step, *more)
            if not isinstance(answer, self._torch.Tensor):
                return answer
            answer.backward()
        return answer.detach(), image.grad, *(picture.grad for picture in more)
