# SPDX-License-Identifier: Apache-2.0
"""Footprints of Gaussians by array operations, for what drop-ins tell of each Gaussian: without gradients, and without the host.

Pictures do not come from here. On a GPU the number of operations is the time for most scenes, so that both axes of a picture
share them. Products are written out because matmul may round to TF32. Shapes: N Gaussians, C views.
"""

from __future__ import annotations

from typing import NamedTuple

import torch

_MARGIN = 0.15  # of the picture's size: kFrustumMargin of gs_core/math/constants.h
_LEAST_ALPHA = 1 / 255  # of a fragment that is drawn
_MOST_RADIUS = 1e9  # pixels, fits int32
_TILE = 16  # pixels


class Footprints(NamedTuple):
    """The Gaussians in each picture. Rows behind the camera have numbers without meaning."""

    means2d: torch.Tensor  # (C, N, 2)  pixels
    depths: torch.Tensor  # (C, N)  along the viewing axis, world units
    variances: torch.Tensor  # (C, N, 2)  xx and yy of the covariance in the picture, with the blur, pixels^2
    xy: torch.Tensor  # (C, N)
    blur: float  # pixels^2

    @property
    def determinants(self):
        return self.variances.prod(-1) - self.xy * self.xy

    @property
    def conics(self):
        """xx xy yy of the inverse covariance.   (C, N, 3), 1 / pixels^2"""
        xx, yy = self.variances.unbind(-1)
        return torch.stack((yy, -self.xy, xx), -1) / self.determinants[..., None]

    @property
    def compensations(self):
        """What antialiasing multiplies opacities with (Yu et al. 2024): sqrt(det without / det with the blur).   (C, N)"""
        without = (self.variances - self.blur).prod(-1) - self.xy * self.xy
        return torch.sqrt((without / self.determinants).clamp_min(0))

    @property
    def largest_sigmas(self):
        """Standard deviation along the longer axis.   (C, N), pixels"""
        xx, yy = self.variances.unbind(-1)
        return torch.sqrt((xx + yy) / 2 + torch.hypot((xx - yy) / 2, self.xy))

    def between(self, near, far):
        """Whether a row can be drawn: between the planes, and with a covariance that has an inverse.   (C, N)"""
        return (self.depths > near) & (self.depths < far) & (self.determinants > 0)

    def touch(self, radii, width, height):
        """Whether boxes (C, N, 1 or 2) of half these sides around the means meet the picture.   (C, N)"""
        sizes = self.means2d.new_full((2,), width)
        sizes[1].fill_(height)
        return ((self.means2d + radii > 0) & (self.means2d - radii < sizes)).all(-1)


@torch.no_grad()
def project(means, shape, viewmats, Ks, width, height, blur):
    """The Footprints of means (N, 3) for viewmats (C, 4, 4) and Ks (C, 3, 3).

    shape: what rasterize() takes, by name: scales (N, 3) and rotations (N, 4), or covariances (N, 6).
    """
    R = viewmats[:, None, :3, :3]
    in_camera = (R * means[:, None]).sum(-1) + viewmats[:, None, :3, 3]  # (C, N, 3)
    depths, focals, centers = in_camera[..., 2:], Ks.diagonal(dim1=1, dim2=2)[:, None, :2], Ks[:, None, :2, 2]
    means2d = torch.addcmul(centers, in_camera[..., :2] / depths, focals)
    places = torch.stack([means2d[..., axis].clamp(-_MARGIN * size, (1 + _MARGIN) * size)
                          for axis, size in enumerate((width, height))], -1)
    slopes = ((places - centers) / focals)[..., None]  # x/z and y/z, clamped for the Jacobian
    rows = (focals / depths)[..., None] * (R[..., :2, :] - slopes * R[..., 2:, :])  # J W, (C, N, 2, 3), pixels / world unit
    if "covariances" in shape:
        xx, xy, xz, yy, yz, zz = shape["covariances"].unbind(-1)
        matrices = torch.stack((xx, xy, xz, xy, yy, yz, xz, yz, zz), -1).view(-1, 1, 3, 3)
        spread = (rows[..., None] * matrices).sum(-2)
    else:
        rows = spread = _turned_back(rows, shape["rotations"]) * shape["scales"][:, None]
    return Footprints(means2d, depths[..., 0], (spread * rows).sum(-1) + blur, (spread[..., 0, :] * rows[..., 1, :]).sum(-1), blur)


def _turned_back(vectors, rotations):
    """R^T v = v + 2 q x (q x v - w v) for vectors (..., N, 2, 3) and quaternions w q (N, 4) of any length."""
    unit = torch.nn.functional.normalize(rotations, dim=-1)[:, None]
    w, q = unit[..., :1], unit[..., 1:].expand(vectors.shape)
    return torch.add(vectors, torch.cross(q, torch.cross(q, vectors, dim=-1) - w * vectors, dim=-1), alpha=2)


def _whole(radii, is_visible):
    return torch.where(is_visible, radii.clamp(max=_MOST_RADIUS), radii.new_zeros(())).to(torch.int32)


@torch.no_grad()
def square_radii(footprints, near, far, width, height, tile=_TILE):
    """Half the side of the square of three standard deviations, rounded up; 0 where it meets no tile.   (C, N) int32, pixels

    Opacities do not count. tile: 1 to ask for a square that meets the picture itself.
    """
    radii = torch.ceil(3 * footprints.largest_sigmas)
    is_met = footprints.touch(radii[..., None], -(-width // tile) * tile, -(-height // tile) * tile)
    return _whole(radii, footprints.between(near, far) & is_met)


@torch.no_grad()
def box_radii(footprints, opacities, near, far, width, height, clip):
    """Half the sides of the box outside of which no fragment is drawn, rounded up; 0 where it misses the picture.

    opacities: (C, N), as they are drawn. clip: a box is left out where both numbers are at most this, pixels. Returns
    (C, N, 2) int32, pixels.
    """
    reach = torch.sqrt(2 * torch.log(opacities.clamp_min(_LEAST_ALPHA) / _LEAST_ALPHA)).clamp_max(3.33)
    radii = torch.ceil(reach[..., None] * torch.sqrt(footprints.variances))
    is_visible = footprints.between(near, far) & (radii > clip).any(-1)
    return _whole(radii, (is_visible & footprints.touch(radii, width, height))[..., None])
