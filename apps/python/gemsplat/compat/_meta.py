# SPDX-License-Identifier: Apache-2.0
"""The third result of gsplat's rasterization(): a dict, whose lists of tiles are computed when they are read."""

from __future__ import annotations

import torch

_LISTS = ("tiles_per_gauss", "isect_ids", "flatten_ids", "isect_offsets")


class Meta(dict):
    """tiles_per_gauss, isect_ids, flatten_ids and isect_offsets come with the first look at one of them; the host then waits.

    shape: of the pictures, batches and cameras.
    """

    def __init__(self, shape, **entries):
        super().__init__(**entries)
        self.shape = shape

    def __missing__(self, key):
        if key not in _LISTS:
            raise KeyError(key)
        self.update(_lists_of(self))
        return self[key]

    def get(self, key, default=None):
        return self[key] if key in self or key in _LISTS else default


def _lists_of(meta):
    """Tiles that boxes meet, in the order of picture, tile and depth. Pictures are I = batches times cameras."""
    with torch.no_grad():
        across, down, size = meta["tile_width"], meta["tile_height"], meta["tile_size"]
        pictures = meta["n_batches"] * meta["n_cameras"]
        radii, shape = meta["radii"], meta["means2d"].shape[:-1]
        radii = radii if radii.dim() > len(shape) else radii[..., None].expand(*shape, 2)
        means2d, radii, depths = meta["means2d"].detach().reshape(-1, 2), radii.reshape(-1, 2), meta["depths"].reshape(-1)
        if meta["gaussian_ids"] is None:
            picture = torch.arange(pictures, device=depths.device).repeat_interleave(len(depths) // pictures)
        else:
            picture = meta["batch_ids"] * meta["n_cameras"] + meta["camera_ids"]
        first = torch.floor((means2d - radii) / size).long()
        last = torch.ceil((means2d + radii) / size).long()
        left, right = (places[:, 0].clamp(0, across) for places in (first, last))
        top, bottom = (places[:, 1].clamp(0, down) for places in (first, last))
        counts = torch.where((radii > 0).all(-1), (right - left) * (bottom - top), 0)
        row = torch.arange(len(counts), device=counts.device).repeat_interleave(counts)
        place = torch.arange(len(row), device=row.device) - (counts.cumsum(0) - counts)[row]
        columns = (right - left)[row]
        tile = (top[row] + torch.div(place, columns, rounding_mode="floor")) * across + left[row] + place % columns
        tile_bits = int(across * down).bit_length()
        keys = ((picture[row] << tile_bits | tile) << 32) | depths[row].float().view(torch.int32).long()
        keys, order = keys.sort(stable=True)
        starts = torch.searchsorted(picture[row][order] * across * down + tile[order],
                                    torch.arange(pictures * across * down, device=row.device))
        return {"tiles_per_gauss": counts.to(torch.int32).view(shape), "isect_ids": keys,
                "flatten_ids": row[order].to(torch.int32), "isect_offsets": starts.to(torch.int32).view(*meta.shape, down, across)}
