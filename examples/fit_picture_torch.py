#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fits Gaussians to a photo by PyTorch: autograd, Adam and any loss of PyTorch, on a GPU if there is one.

    scripts/setup.sh
    PYTHONPATH=build/default/python python3 examples/fit_picture_torch.py --output out/fit.ppm

The picture that it writes shows the photo and the fit side by side.
"""

import argparse
from pathlib import Path

import torch

import gemsplat

COURTYARD = Path(__file__).parent / "courtyard"


def a_photo(device, resolution):
    """(H, W, 3), 0 to 1: a photo of the bundled scene, and a camera that stands at the origin."""
    photo = gemsplat.Scene.load(COURTYARD, resolution=resolution).train_views[0].photo
    height, width = photo.shape[:2]
    return torch.tensor(photo, device=device) / 255, gemsplat.Camera(width, height, width)


def initial_gaussians(count, camera, device):
    """Tensors that rasterize() takes: gray Gaussians before the camera, at random places of the picture."""
    depths = 2 + torch.rand(count, 1, device=device)
    corner = torch.tensor([camera.width / camera.fx / 2, camera.height / camera.fy / 2], device=device)
    places = (2 * torch.rand(count, 2, device=device) - 1) * corner
    tensors = {"means": torch.cat([places * depths, depths], 1), "rotations": torch.randn(count, 4, device=device),
               "log_scales": torch.full((count, 3), -3.0, device=device), "logit_opacities": torch.zeros(count, device=device),
               "colors": torch.full((count, 3), 0.5, device=device)}
    return {name: tensor.requires_grad_() for name, tensor in tensors.items()}


def fit(photo, camera, gaussians, steps):
    optimizer = torch.optim.Adam(gaussians.values(), lr=0.01)
    for _ in range(steps):
        image = gemsplat.rasterize(**gaussians, cameras=camera).image
        loss = (image - photo).abs().mean()  # or whatever PyTorch can differentiate
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()


def psnr(a, b):
    """dB"""
    return float(-10 * torch.log10(((a - b) ** 2).mean()))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("out/fit.ppm"), help="a picture, .ppm")
    parser.add_argument("--gaussians", type=int, help="[20,000 on a GPU, 200 on the CPU]")
    parser.add_argument("--steps", type=int, default=300)
    options = parser.parse_args()
    has_gpu = torch.cuda.is_available() and gemsplat.cuda_device_count() > 0
    device = "cuda" if has_gpu else "cpu"
    torch.manual_seed(0)
    photo, camera = a_photo(device, 1 if has_gpu else 8)
    gaussians = initial_gaussians(options.gaussians or (20_000 if has_gpu else 200), camera, device)
    with torch.no_grad():
        before = psnr(gemsplat.rasterize(**gaussians, cameras=camera).image, photo)
    fit(photo, camera, gaussians, options.steps)
    with torch.no_grad():
        image = gemsplat.rasterize(**gaussians, cameras=camera).image
    print(f"{photo.shape[1]}x{photo.shape[0]} pixels on {device}: {before:.1f} dB before, {psnr(image, photo):.1f} after")
    both = (torch.cat([photo, image], 1).clamp(0, 1) * 255).round().to(torch.uint8).cpu().contiguous()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_bytes(b"P6\n%d %d\n255\n" % (both.shape[1], both.shape[0]) + both.numpy().tobytes())


if __name__ == "__main__":
    main()
