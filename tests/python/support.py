# SPDX-License-Identifier: Apache-2.0
"""Helpers of these tests: the bundled scene, models of random Gaussians, the program."""

import os
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np

import gemsplat

SOURCE = Path(os.environ["GS_SOURCE_DIR"])
COURTYARD = SOURCE / "examples" / "courtyard"
SMALL = {"eval": True, "resolution": 8}  # pictures of 60x45 pixels
SMALL_FLAGS = ["-r", "8", "--device", "cpu", "-q"]


def random_arrays(count=50, sh_degree=3, seed=1):
    """Gaussians in a cube of side 2 around the origin, as Model takes them."""
    random = np.random.default_rng(seed)
    rest = (sh_degree + 1) ** 2 - 1
    return {
        "means": random.uniform(-1, 1, (count, 3)).astype(np.float32),
        "log_scales": random.uniform(-3, -1.5, (count, 3)).astype(np.float32),
        "rotations": random.normal(size=(count, 4)).astype(np.float32),
        "logit_opacities": random.uniform(-2, 3, count).astype(np.float32),
        "sh0": random.uniform(-1.5, 1.5, (count, 3)).astype(np.float32),
        "sh_rest": random.uniform(-0.2, 0.2, (count, rest, 3)).astype(np.float32),
    }


def camera(width=64, height=48, distance=4.0):
    """At `distance` from the origin, on the axis along which it looks."""
    pose = np.eye(4)
    pose[2, 3] = distance
    return gemsplat.Camera(width, height, 60.0, cam_from_world=pose, name="front")


def in_8_bits(color):
    """As PNGs of the program hold it."""
    return (np.clip(color, 0, 1) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def run_program(*arguments):
    command = [os.environ["GS_PROGRAM"], *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise AssertionError(f"{command} returned {done.returncode}: {done.stderr}")
    return done.stdout


class TestCase(unittest.TestCase):
    """With a folder of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="gemsplat-test-")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def assert_refused(self, pattern, function, *arguments, **keywords):
        """A UsageError, which is an Error and a ValueError, with a text that says what is wrong."""
        with self.assertRaisesRegex(gemsplat.UsageError, pattern) as caught:
            function(*arguments, **keywords)
        self.assertIsInstance(caught.exception, gemsplat.Error)
        self.assertIsInstance(caught.exception, ValueError)
