#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes a trained model smaller by PyTorch: with masks that are learned, or with fewer bands of SH that a teacher teaches.

    gemsplat train examples/courtyard -o out/demo --eval
    PYTHONPATH=build/default/python python3 examples/shrink_model.py masks out/demo examples/courtyard -o out/masked.ply
    PYTHONPATH=build/default/python python3 examples/shrink_model.py distill out/demo examples/courtyard -o out/distilled.ply

masks: each Gaussian has a number more, and each of its bands of SH. The sigmoids of these are made as small as the loss allows,
and what falls below 0.01 is off: its gradient is that of the sigmoid (straight-through). What is off at the end is removed. These
are the masks of Trick-GS (Armagan et al. 2025), by the rule of Compact-3DGS (Lee et al. 2024), since its own is not published.
distill: the model learns with a lower degree to look as before, from places of the cameras and from beside them (LightGaussian,
Fan et al. 2024). Its opacities stay. Two of three steps are from beside a camera.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

import gemsplat

# Adam's rates at the end of training, for each array that moves; those of means are multiplied by the extent of the cameras.
RATES = {"means": 1.6e-6, "rotations": 1e-3, "log_scales": 5e-3, "logit_opacities": 2.5e-2, "sh0": 2.5e-3, "sh_rest": 1.25e-4}
THRESHOLD = 0.01  # of a mask that is on
BANDS = (slice(0, 3), slice(3, 8), slice(8, 15))  # of sh_rest, for degrees 1 to 3


def switched(logits):
    """1 where the sigmoid is above the threshold and 0 elsewhere, with the gradient of the sigmoid."""
    soft = torch.sigmoid(logits)
    return (soft > THRESHOLD).float() + soft - soft.detach()


def extent_of(cameras):
    """The largest distance of a camera from their middle, world units."""
    centers = np.array([-c.cam_from_world[:3, :3].T @ c.cam_from_world[:3, 3] for c in cameras])
    return float(np.linalg.norm(centers - centers.mean(0), axis=1).max()) or 1.0


def tensors_of(model, device):
    return {name: torch.tensor(getattr(model, name), device=device, requires_grad=True) for name in RATES}


def optimizer_of(tensors, extent, frozen=()):
    groups = [{"params": [tensor], "lr": RATES[name] * (extent if name == "means" else 1)}
              for name, tensor in tensors.items() if name not in frozen]
    return torch.optim.Adam(groups, eps=1e-15)


def learn_masks(model, views, options, random):
    tensors = tensors_of(model, options.device)
    of_rows = torch.zeros(len(model), device=options.device, requires_grad=True)
    of_bands = torch.zeros(len(model), len(BANDS), device=options.device, requires_grad=True)
    optimizer = optimizer_of(tensors, extent_of([camera for camera, _ in views]))
    optimizer.add_param_group({"params": [of_rows, of_bands], "lr": options.rate})
    sizes = torch.tensor([band.stop - band.start for band in BANDS], device=options.device)
    for _ in range(options.steps):
        camera, photo = views[random.integers(len(views))]
        rows, bands = switched(of_rows), torch.repeat_interleave(switched(of_bands), sizes, 1)
        image = gemsplat.rasterize(
            tensors["means"], tensors["rotations"], scales=tensors["log_scales"].exp() * rows[:, None].clamp_min(1e-6),
            opacities=torch.sigmoid(tensors["logit_opacities"]) * rows, sh0=tensors["sh0"],
            sh_rest=tensors["sh_rest"] * bands[:, :tensors["sh_rest"].shape[1], None], cameras=camera).image
        loss = gemsplat.photometric_loss(image, photo)
        loss = loss + options.weight * (torch.sigmoid(of_rows).mean() + torch.sigmoid(of_bands).mean())
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    with torch.no_grad():
        tensors["sh_rest"] *= torch.repeat_interleave(switched(of_bands), sizes, 1)[:, :tensors["sh_rest"].shape[1], None]
        is_on = (torch.sigmoid(of_rows) > THRESHOLD).cpu().numpy()
        bands_on = (torch.sigmoid(of_bands)[torch.sigmoid(of_rows) > THRESHOLD] > THRESHOLD).float().mean(0).tolist()
    write_into(model, tensors)
    print("bands that are on, for degrees 1 to 3: " + ", ".join(f"{100 * share:.0f} %" for share in bands_on))
    return model.keep(is_on)


def distill(model, views, options, random):
    teacher = tensors_of(model, options.device)
    student = model.edit(f"sh-degree {options.degree}")
    tensors = tensors_of(student, options.device)
    cameras = [camera for camera, _ in views]
    extent = extent_of(cameras)
    optimizer = optimizer_of(tensors, extent, frozen=("logit_opacities",))
    rates = torch.optim.lr_scheduler.StepLR(optimizer, max(options.steps // 10, 1), 0.9)
    for step in range(options.steps):
        camera = cameras[random.integers(len(cameras))]
        if step % 3:
            camera = beside(camera, random.normal(0, options.jitter * extent, 3))
        with torch.no_grad():
            wanted = gemsplat.rasterize(**teacher, cameras=camera).image
        loss = gemsplat.photometric_loss(gemsplat.rasterize(**tensors, cameras=camera).image, wanted)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        rates.step()
    write_into(student, tensors)
    return student


def beside(camera, by):
    """The camera, moved by (3,) world units."""
    pose = np.array(camera.cam_from_world)
    pose[:3, 3] -= pose[:3, :3] @ by
    return gemsplat.Camera(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, cam_from_world=pose)


def write_into(model, tensors):
    for name, tensor in tensors.items():
        getattr(model, name)[:] = tensor.detach().cpu().numpy()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("method", choices=("masks", "distill"))
    parser.add_argument("model", help="a run's folder, or a model's file")
    parser.add_argument("scene", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--resolution", type=int, default=0, help="a factor up to 8, or the width of photos")
    parser.add_argument("--weight", type=float, default=5e-4, help="of the masks in the loss")
    parser.add_argument("--rate", type=float, default=0.01, help="Adam's, of the masks")
    parser.add_argument("--degree", type=int, default=2, help="of SH after distill")
    parser.add_argument("--jitter", type=float, default=0.05, help="of places beside cameras, in extents of the cameras")
    options = parser.parse_args()
    options.device = "cuda" if torch.cuda.is_available() and gemsplat.cuda_device_count() > 0 else "cpu"

    model = gemsplat.load(options.model)
    scene = gemsplat.Scene.load(options.scene, eval=True, resolution=options.resolution)
    views = [(view.camera, torch.tensor(view.photo, device=options.device) / 255) for view in scene.train_views]
    before, count = gemsplat.evaluate(model, scene), len(model)
    method = learn_masks if options.method == "masks" else distill
    model = method(model, views, options, np.random.default_rng(0))
    after = gemsplat.evaluate(model, scene)
    print(f"{count} Gaussians with {before.psnr:.2f} dB, SSIM {before.ssim:.4f} before; "
          f"{len(model)} with {after.psnr:.2f} dB, SSIM {after.ssim:.4f} after")
    options.output.parent.mkdir(parents=True, exist_ok=True)
    model.save(options.output, replace=True)


if __name__ == "__main__":
    main()
