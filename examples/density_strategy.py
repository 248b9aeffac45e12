#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A density strategy in Python: the classic rules, by which Gaussians are cloned, split and removed.

    scripts/setup.sh
    PYTHONPATH=build/default/python python3 examples/density_strategy.py --steps 300

Trains the bundled scene by these rules and by those of gemsplat, and compares the two.
"""

import argparse
from pathlib import Path

import numpy as np

import gemsplat

COURTYARD = Path(__file__).parent / "courtyard"


class Classic:
    """Adaptive density control.   Kerbl et al. 2023, Sec. 5.2"""

    def __init__(self, first, last, every, reset_every, threshold=2e-4):
        self.first, self.last, self.every, self.reset_every = first, last, every, reset_every  # steps
        self.threshold = np.float32(threshold)  # of the mean gradient

    def needs(self, step):
        return {"mean2d", "visible"} if step <= self.last else set()

    def after_step(self, rows, step, random):
        if self.first <= step <= self.last and step % self.every == 0:
            self.refine(rows, removes_large=step > self.reset_every)
        if step % self.reset_every == 0 and step <= self.last:
            rows.lower_opacity(0.01)

    def refine(self, rows, removes_large):
        sums = rows.statistics
        grows = sums["mean2d"] >= self.threshold * np.maximum(sums["visible"], 1)
        largest = rows.log_scales.max(axis=1)
        is_small = largest <= np.log(np.float32(0.01) * np.float32(rows.scene_extent))
        first_clone = rows.count
        rows.clone(grows & is_small)
        splits = np.zeros(rows.count, bool)
        splits[:first_clone] = grows & ~is_small
        rows.split(splits)
        opacity = 1 / (1 + np.exp(-rows.logit_opacities))
        keeps = opacity >= 0.005
        if removes_large:
            keeps &= np.exp(rows.log_scales.max(axis=1)) <= 0.1 * rows.scene_extent
        rows.keep(keeps)
        rows.clear_statistics()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--device", default="auto")
    options = parser.parse_args()
    scene = gemsplat.Scene.load(COURTYARD, eval=True, resolution=8)
    steps = {"first": 50, "every": 50, "last": options.steps - 50, "reset_every": 2 * options.steps}
    for name, strategy in {"in Python": Classic(**steps), "of gemsplat": "adaptive"}.items():
        # Steps in a config are those of a run of 30,000.
        density = {"from_step": 50, "every": 50, "until_step": 30000 - 50 * 30000 // options.steps}
        with gemsplat.Trainer(scene, ["adaptive", {"density": density}], strategy=strategy, iterations=options.steps,
                              device=options.device) as trainer:
            before = trainer.rows.count
            done = trainer.run()
            print(f"rules {name}: {before} Gaussians, then {done.gaussian_count}; {trainer.evaluate().psnr:.1f} dB")


if __name__ == "__main__":
    main()
