#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Disturbs the poses of a scene's training photos, and says how far a run has brought them back.

    python3 disturb_poses.py SCENE OUT [--degrees 0.5] [--shift 0.01] [--seed 1] [--test-every 8]
    python3 disturb_poses.py --check SCENE RUN

The first command copies SCENE, a COLMAP model in binary form, and turns each photo that is not held
out about its own center by `degrees`, and moves it by `shift` times the extent of the cameras, both
in random directions. Held-out photos (the first of every --test-every by name) stay where they are.
The second command compares RUN/poses.json with the poses of SCENE: root mean squares of degrees and
of shares of the extent, as they are and after the similarity that fits the camera centers best,
which no picture shows.
"""

import argparse
import json
import math
import pathlib
import random
import shutil
import struct

import numpy as np


def rotation(q):
    w, x, y, z = np.array(q) / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def product(a, b):
    w, x, y, z = a
    W, X, Y, Z = b
    return [w * W - x * X - y * Y - z * Z, w * X + x * W + y * Z - z * Y,
            w * Y - x * Z + y * W + z * X, w * Z + x * Y - y * X + z * W]


def read_images(path):
    """Each image of images.bin: its id, quaternion, translation, camera, name and points' bytes."""
    data = path.read_bytes()
    count, at, images = struct.unpack_from("<Q", data)[0], 8, []
    for _ in range(count):
        image = struct.unpack_from("<I7dI", data, at)
        end = data.index(b"\0", at + 64)
        name = data[at + 64:end].decode()
        points = struct.unpack_from("<Q", data, end + 1)[0]
        after = end + 9 + 24 * points
        images.append({"id": image[0], "q": list(image[1:5]), "t": np.array(image[5:8]),
                       "camera": image[8], "name": name, "points": data[end + 1:after]})
        at = after
    return images


def write_images(path, images):
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(images)))
        for image in images:
            file.write(struct.pack("<I7dI", image["id"], *image["q"], *image["t"], image["camera"]))
            file.write(image["name"].encode() + b"\0" + image["points"])


def center(image):
    return -rotation(image["q"]).T @ image["t"]


def extent_of(images):
    centers = np.array([center(image) for image in images])
    return 1.1 * np.linalg.norm(centers - centers.mean(axis=0), axis=1).max()


def random_direction(draws):
    direction = np.array([draws.gauss(0, 1) for _ in range(3)])
    return direction / np.linalg.norm(direction)


def held_out(images, every):
    names = sorted(image["name"] for image in images)
    return set(names[::every])


def disturb(options):
    source, out = pathlib.Path(options.paths[0]), pathlib.Path(options.paths[1])
    if out.exists():
        raise SystemExit(f"error: {out} exists; name another folder")
    shutil.copytree(source, out)
    path = out / "sparse/0/images.bin"
    images = read_images(path)
    extent, kept = extent_of(images), held_out(images, options.test_every)
    draws = random.Random(options.seed)
    half = math.radians(options.degrees) / 2
    for image in sorted(images, key=lambda image: image["name"]):
        if image["name"] in kept:
            continue
        moved = center(image) + options.shift * extent * random_direction(draws)
        axis = random_direction(draws) * math.sin(half)
        image["q"] = product([math.cos(half), *axis], image["q"])
        image["t"] = -rotation(image["q"]) @ moved
    write_images(path, images)
    # COLMAP 3.12 writes the poses of rigs a second time.
    for other in ("frames.bin", "rigs.bin"):
        (out / "sparse/0" / other).unlink(missing_ok=True)
    print(f"{len(images) - len(kept)} photos disturbed, {len(kept)} held out, extent {extent:.4g}")


def similarity(a, b):
    """Scale, rotation and translation of least squares that bring points a to points b."""
    mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
    u, singular, vt = np.linalg.svd((b - mean_b).T @ (a - mean_a))
    sign = np.diag([1, 1, np.linalg.det(u @ vt)])
    turn = u @ sign @ vt
    scale = np.trace(np.diag(singular) @ sign) / ((a - mean_a) ** 2).sum()
    return scale, turn, mean_b - scale * turn @ mean_a


def check(options):
    images = read_images(pathlib.Path(options.paths[0]) / "sparse/0/images.bin")
    photos = json.loads((pathlib.Path(options.paths[1]) / "poses.json").read_text())["photos"]
    extent, truth = extent_of(images), {image["name"]: image for image in images}
    names = [name for name in photos if name in truth]
    turns = [np.array(photos[name]["rotation"]).reshape(3, 3) for name in names]
    centers = np.array([-turn.T @ np.array(photos[name]["translation"])
                        for turn, name in zip(turns, names)])
    known = np.array([center(truth[name]) for name in names])
    scale, turn, move = similarity(centers, known)
    for title, s, r, t in (("as they are", 1, np.eye(3), np.zeros(3)),
                           ("after the similarity that fits best", scale, turn, move)):
        degrees = [math.degrees(math.acos(max(-1, min(1, (np.trace(
            rotation(truth[name]["q"]) @ (own @ r.T).T) - 1) / 2))))
            for name, own in zip(names, turns)]
        shifts = np.linalg.norm(s * centers @ r.T + t - known, axis=1) / extent
        print(f"{title}: {np.sqrt(np.mean(np.square(degrees))):.4f} degrees, "
              f"{100 * np.sqrt(np.mean(shifts ** 2)):.4f} % of the extent, {len(names)} photos")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs=2)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--degrees", type=float, default=0.5)
    parser.add_argument("--shift", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--test-every", type=int, default=8)
    options = parser.parse_args()
    check(options) if options.check else disturb(options)


if __name__ == "__main__":
    main()
