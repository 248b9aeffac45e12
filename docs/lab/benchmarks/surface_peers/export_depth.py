# SPDX-License-Identifier: Apache-2.0
"""Run by runner.py inside a peer: depth maps of training views and figures of held-out photos.

    export_depth.py -m MODEL --scale-file OUT/scale.json --depth-out FOLDER --report FILE

Depth is the peer's own: the median depth along the viewing axis; in RaDe-GS, as in its mesh_extract.py,
only where the coverage is at least one half. It is written in the units of the plain scene.
"""
import json
import os
import struct
import sys
import time
import zlib
from argparse import ArgumentParser

import numpy as np
import torch
import torch.nn.functional as F

from arguments import ModelParams, PipelineParams, get_combined_args
from gaussian_renderer import render
from scene import GaussianModel, Scene

LIMIT = 16.0  # peer units; the peers' own meshing stops at 8


def write_gray16(path, values):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    height, width = values.shape
    rows = np.zeros((height, 1 + 2 * width), np.uint8)
    rows[:, 1:] = values.astype(">u2").view(np.uint8).reshape(height, 2 * width)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" +
                   chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(rows.tobytes(), 1)) + chunk(b"IEND", b""))


def ssim(a, b):
    """Mean over pixels and channels, window of 11x11 and sigma 1.5, zero padding; (3, H, W)."""
    x = torch.arange(11, device=a.device, dtype=torch.float32) - 5
    line = torch.exp(-x * x / (2 * 1.5**2))
    line = line / line.sum()
    window = (line[:, None] * line[None, :])[None, None]

    def blur(picture):
        return F.conv2d(picture[:, None], window, padding=5)[:, 0]
    ma, mb = blur(a), blur(b)
    va, vb, ab = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    c1, c2 = .01**2, .03**2
    return float((((2 * ma * mb + c1) * (2 * ab + c2)) /
                  ((ma * ma + mb * mb + c1) * (va + vb + c2))).mean())


def psnr(a, b):
    return float(-10 * torch.log10(((a - b) ** 2).mean().clamp_min(1e-12)))


def fitted(picture, photo):
    """Under the gain and offset that fit best, one pair for all channels."""
    x, y = picture.reshape(-1), photo.reshape(-1)
    gain = ((x - x.mean()) * (y - y.mean())).mean() / x.var(unbiased=False).clamp_min(1e-9)
    return (gain * (picture - x.mean()) + y.mean()).clamp(0, 1)


@torch.no_grad()
def main():
    parser = ArgumentParser()
    model, pipeline = ModelParams(parser, sentinel=True), PipelineParams(parser)
    parser.add_argument("--scale-file", required=True)
    parser.add_argument("--depth-out", required=True)
    parser.add_argument("--report", required=True)
    args = get_combined_args(parser)
    dataset, pipe = model.extract(args), pipeline.extract(args)
    is_gggs = hasattr(dataset, "sg_degree")
    gaussians = GaussianModel(dataset.sh_degree, *([dataset.sg_degree] if is_gggs else []))
    scene = Scene(dataset, gaussians, load_iteration=-1, shuffle=False)
    background = torch.zeros(3, device="cuda")
    with open(args.scale_file) as file:
        scale = json.load(file)["scale"]

    def pictures(view):
        made = render(view, gaussians, pipe, background, dataset.kernel_size)
        return (made["render"].clamp(0, 1) * 255).round() / 255, made

    start, depths = time.time(), {}
    for view in scene.getTrainCameras():
        _, made = pictures(view)
        depth = made["median_depth"][0].clone()
        if not is_gggs:
            depth[made["mask"][0] < .5] = 0
        if view.gt_mask is not None:
            depth[view.gt_mask[0] < .5] = 0
        depth[~torch.isfinite(depth) | (depth < 0) | (depth > LIMIT)] = 0
        depths[view.image_name] = depth.cpu().numpy()
    seen = np.concatenate([d[d > 0][::7] for d in depths.values()])
    unit = float(min(LIMIT, 1.05 * max(d.max() for d in depths.values()))) / 65535
    os.makedirs(args.depth_out, exist_ok=True)
    for name, depth in depths.items():
        write_gray16(f"{args.depth_out}/{name}.png", np.round(depth / unit))
    said = {"depth_s": time.time() - start, "depth_unit": unit / scale, "views": len(depths),
            "covered": float(np.mean([np.mean(d > 0) for d in depths.values()])),
            "depth_median": float(np.median(seen)) / scale,
            "gaussians": int(gaussians.get_xyz.shape[0])}

    figures = []
    for view in scene.getTestCameras():
        picture, _ = pictures(view)
        photo = view.original_image[:3].cuda()
        figures.append({"name": view.image_name, "psnr": psnr(picture, photo),
                        "ssim": ssim(picture, photo), "psnr_fit": psnr(fitted(picture, photo), photo)})
    for key in ("psnr", "ssim", "psnr_fit"):
        said[key] = float(np.mean([f[key] for f in figures])) if figures else None
    said["test_views"], said["per_view"] = len(figures), figures
    said["held_out"] = sorted(f["name"] for f in figures)
    with open(args.report, "w") as file:
        json.dump(said, file, indent=1)
    print({k: v for k, v in said.items() if k not in ("per_view",)}, file=sys.__stdout__, flush=True)


main()
