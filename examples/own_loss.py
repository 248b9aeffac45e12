#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A loss in PyTorch: that of gemsplat, and differences of what a small network sees.

    scripts/setup.sh
    PYTHONPATH=build/default/python python3 examples/own_loss.py --steps 200

Trains the bundled scene. Put any network in the place of Features, such as one that knows pictures.
"""

import argparse
from pathlib import Path

import torch
from torch import nn

import gemsplat

COURTYARD = Path(__file__).parent / "courtyard"


class Features(nn.Sequential):
    """Layers of edges and textures at two scales, which are drawn at random and stay as they are."""

    def __init__(self):
        super().__init__(nn.Conv2d(3, 16, 5, padding=2), nn.ReLU(), nn.AvgPool2d(2), nn.Conv2d(16, 32, 3, padding=1))
        self.requires_grad_(False)


class Loss:
    def __init__(self, device, weight=0.5):
        torch.manual_seed(0)
        self.features, self.weight = Features().to(device), weight

    def __call__(self, image, view, step):
        seen, wanted = (self.features(picture.permute(2, 0, 1)[None]) for picture in (image, view.image))
        return gemsplat.photometric_loss(image, view.image) + self.weight * (seen - wanted).abs().mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("out/own_loss.ply"))
    parser.add_argument("--steps", type=int, default=200)
    options = parser.parse_args()
    device = "cuda:0" if torch.cuda.is_available() and gemsplat.cuda_device_count() > 0 else "cpu"
    scene = gemsplat.Scene.load(COURTYARD, eval=True, resolution=8)
    with gemsplat.Trainer(scene, loss=Loss(device), framework="torch", iterations=options.steps, device=device) as trainer:
        before = trainer.evaluate().psnr
        for done in range(0, options.steps, 50):
            now = trainer.run(min(50, options.steps - done))
            print(f"step {now.step}: loss {now.loss:.4f}")
        print(f"{before:.1f} dB before, {trainer.evaluate().psnr:.1f} after, on {device}")
        options.output.parent.mkdir(parents=True, exist_ok=True)
        trainer.model.save(options.output, replace=True)


if __name__ == "__main__":
    main()
