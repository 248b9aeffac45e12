# SPDX-License-Identifier: Apache-2.0
"""A drop-in for the module diff_gaussian_rasterization, by gemsplat.rasterize().

docs/guide/compat.md says what differs. Shapes: N Gaussians, pictures of H x W pixels.
"""

from __future__ import annotations

from typing import NamedTuple, Optional

import torch

from .. import UsageError
from .._rasterize import CheckedView
from .._torch import eagerly
from . import _report
from ._screen import ScreenTap, constants

VARIANTS = {"2023": (), "aa": ("inverse_depth",), "accel": ("inverse_depth",), "depth_alpha": ("depth", "alpha")}
NEAR, FAR, BLUR = 0.2, 1e10, 0.3  # world units, and pixels^2
_TILE = 16  # pixels
_TOLERANCE = 1e-3  # of matrices that should agree, beside their largest entry

variant: Optional[str] = None  # of VARIANTS, as install() was asked for; None: by what a call gives


class GaussianRasterizationSettings(NamedTuple):
    """One view, and how it is drawn. Matrices (4, 4) are transposed: points are rows, which they multiply from the right."""

    image_height: int  # pixels
    image_width: int
    tanfovx: float  # of half the field of view
    tanfovy: float
    bg: torch.Tensor  # (3,)
    scale_modifier: float  # scales are multiplied with it
    viewmatrix: torch.Tensor  # (4, 4), from world to camera coordinates
    projmatrix: torch.Tensor  # (4, 4), viewmatrix and then the projection
    sh_degree: int  # in use
    campos: torch.Tensor  # (3,), read with debug alone: where the camera is follows from viewmatrix
    prefiltered: bool = False  # without effect
    debug: bool = False  # checks that the matrices agree, for which the host waits for the GPU
    antialiasing: Optional[bool] = None  # given by the variants aa and accel


class GaussianRasterizer(torch.nn.Module):
    """Draws Gaussians in the view of `raster_settings`."""

    def __init__(self, raster_settings: GaussianRasterizationSettings):
        super().__init__()
        self.raster_settings = raster_settings

    def forward(self, means3D, means2D, opacities, shs=None, colors_precomp=None, scales=None, rotations=None,
                cov3D_precomp=None, *, dc=None):
        """(color (3, H, W), radii (N,) int32), and what the variant adds: pictures (1, H, W).

        means2D: a tensor (N, 3) that gets the gradient by the means in the picture, x times W/2 and y times H/2; or None.
        shs: (N, K, 3), or (N, K - 1, 3) beside dc (N, 1, 3); or colors_precomp (N, 3).
        scales (N, 3) and rotations (N, 4), or cov3D_precomp (N, 6).

        Throws UsageError where both or neither of two choices are given.
        """
        return rasterize_gaussians(means3D, means2D, shs, colors_precomp, opacities, scales, rotations, cov3D_precomp,
                                   self.raster_settings, dc=dc)

    def markVisible(self, positions):
        """Whether points (N, 3) are in front of the camera, beyond the near plane.   (N,) bool"""
        with torch.no_grad():
            viewmatrix = self.raster_settings.viewmatrix
            return positions @ viewmatrix[:3, 2] + viewmatrix[3, 2] > NEAR

    @eagerly
    def visible_filter(self, means3D, scales=None, rotations=None, cov3D_precomp=None):
        """The radii of forward(), without a picture.   (N,) int32, pixels"""
        _report.count("diff_gaussian_rasterization.visible_filter")
        shape = _shape(_given(scales), _given(rotations), _given(cov3D_precomp), self.raster_settings)
        with torch.no_grad():
            return _radii(_scene(self.raster_settings, *_matrices(self.raster_settings), means=means3D, opacities=means3D[:, 0],
                                 **shape, outputs=("alpha",)))


@eagerly
def rasterize_gaussians(means3D, means2D, sh, colors_precomp, opacities, scales, rotations, cov3Ds_precomp, raster_settings, *,
                        dc=None):
    """What GaussianRasterizer.forward() returns; an empty tensor counts as None."""
    _report.count("diff_gaussian_rasterization.rasterize_gaussians")
    settings = raster_settings
    names = VARIANTS[variant or ("2023" if settings.antialiasing is None and dc is None else "aa")]
    shape = _shape(_given(scales), _given(rotations), _given(cov3Ds_precomp), settings)
    colors = _colors(_given(sh), _given(colors_precomp), dc, settings)
    height, width = int(settings.image_height), int(settings.image_width)
    if not len(means3D):
        return (means3D.new_zeros((3, height, width)), torch.zeros(0, dtype=torch.int32, device=means3D.device),
                *(means3D.new_zeros((1, height, width)) for _ in names))
    viewmat, K = _matrices(settings)
    if settings.debug:
        _check(settings, viewmat, K)
    has_tap = means2D is not None and means2D.requires_grad and torch.is_grad_enabled()
    scene = _scene(settings, viewmat, K, means=means3D, opacities=opacities, **shape, **colors, outputs=("image", *names),
                   background=settings.bg.detach().to(means3D), antialiased=bool(settings.antialiasing), blend_rule="classic")
    pictures = scene.draw(screen=ScreenTap.apply(means2D, (width / 2, height / 2)) if has_tap else None)
    return (pictures.image.permute(2, 0, 1), _radii(scene), *(getattr(pictures, name)[None] for name in names))


def _given(tensor):
    return None if tensor is None or tensor.shape == (0,) else tensor


def _shape(scales, rotations, covariances, settings):
    """Of rasterize(): scales and rotations, or covariances."""
    if (covariances is None) == (scales is None) or (scales is None) != (rotations is None):
        raise UsageError("give scales and rotations, or cov3D_precomp, and not both or neither")
    if covariances is not None:
        return {"covariances": covariances}
    modifier = float(settings.scale_modifier)
    return {"scales": scales if modifier == 1 else scales * modifier, "rotations": rotations}


def _colors(sh, colors, dc, settings):
    """Of rasterize(): colors, sh, or sh0 and sh_rest."""
    if (colors is None) == (sh is None and dc is None):
        raise UsageError("give shs, or colors_precomp, and not both or neither")
    if colors is not None:
        return {"colors": colors}
    degree = int(settings.sh_degree)
    if dc is None:
        return {"sh": sh if sh.shape[1] in (1, 4, 9, 16) else sh[:, :(degree + 1)**2], "sh_degree": degree}
    rest = {} if sh is None else {"sh_rest": sh}
    return {"sh0": dc.reshape(len(dc), 3), **rest, "sh_degree": degree}


def _matrices(settings):
    """The view matrix and the intrinsics, on the device of viewmatrix; the host reads no value.   (4, 4), (3, 3)

    Of the rows of a projection matrix the third of the view matrix is a part. It moves the center of the picture by as much
    of the half of its size.
    """
    viewmatrix, half = settings.viewmatrix, (int(settings.image_width) / 2, int(settings.image_height) / 2)
    kind = viewmatrix.device, viewmatrix.dtype
    base = constants((half[0] / float(settings.tanfovx), 0, half[0], 0, half[1] / float(settings.tanfovy), half[1], 0, 0, 1), *kind)
    with torch.no_grad():
        offset = (settings.projmatrix[:3, :2] * viewmatrix[:3, 2:3]).sum(0)  # 0 where the center is that of the picture
        K = base.clone().view(3, 3)
        K[:2, 2].addcmul_(constants(half, *kind), offset)
    return viewmatrix.T, K


def _scene(settings, viewmat, K, **given):
    return CheckedView(viewmats=viewmat, Ks=K, width=int(settings.image_width), height=int(settings.image_height), near=NEAR, far=FAR,
                 blur=BLUR, **given)


def _radii(scene):
    return scene.footprints("square", tile=_TILE, names=("radii",)).radii[:, 0].contiguous()


def _check(settings, viewmat, K):
    """Throws UsageError where the matrices and campos are not those of one camera. The host waits."""
    viewmat, K, campos = (matrix.detach().double().cpu() for matrix in (viewmat, K, settings.campos))
    if not torch.allclose(campos.view(3), torch.linalg.inv(viewmat)[:3, 3], rtol=_TOLERANCE, atol=_TOLERANCE):
        raise UsageError("campos is not where viewmatrix has the camera; give inverse(viewmatrix.T)[:3, 3]")
    projection = settings.projmatrix.detach().double().cpu().T
    for axis, size in enumerate((settings.image_width, settings.image_height)):
        expected = 2 * K[axis, axis] / size * viewmat[axis] + (2 * K[axis, 2] / size - 1) * viewmat[2]
        if not torch.allclose(projection[axis], expected, rtol=_TOLERANCE, atol=_TOLERANCE * float(projection.abs().max())):
            raise UsageError(f"projmatrix disagrees with viewmatrix and {('tanfovx', 'tanfovy')[axis]}; "
                             "give viewmatrix @ projection of the same field of view")


class SparseGaussianAdam(torch.optim.Adam):
    """Adam of the Gaussians that a step has seen; moments are not corrected for their start at zero."""

    def __init__(self, params, lr=1e-3, eps=1e-8, **options):
        super().__init__(params, lr=lr, eps=eps, **options)

    @torch.no_grad()
    def step(self, visibility, N=None):
        """Updates the rows where `visibility` (N,) is True; the host reads no value of it."""
        for group in self.param_groups:
            beta1, beta2 = group["betas"]
            for parameter in group["params"]:
                if parameter.grad is None:
                    continue
                state = self.state[parameter]
                if not state:
                    state.update(step=torch.zeros(()), exp_avg=torch.zeros_like(parameter), exp_avg_sq=torch.zeros_like(parameter))
                is_seen = visibility.view(-1, *(1,) * (parameter.dim() - 1))
                gradient, m, v = parameter.grad, state["exp_avg"], state["exp_avg_sq"]
                m.copy_(torch.where(is_seen, beta1 * m + (1 - beta1) * gradient, m))
                v.copy_(torch.where(is_seen, beta2 * v + (1 - beta2) * gradient * gradient, v))
                change = group["lr"] * m / (torch.sqrt(v) + group["eps"])
                parameter.sub_(torch.where(is_seen, change, change.new_zeros(())))
                state["step"] += 1
