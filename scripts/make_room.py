#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes scenes of one furnished room, ray-cast in NumPy, for training through lenses: panoramas of 360
degrees, fisheyes of 200 degrees and pinholes, each in a folder with its COLMAP model and exact poses.

    scripts/make_room.py out/room                    # 60 photos each, some minutes
    gemsplat train out/room/panoramas -o out/run --eval
    gemsplat eval out/run --data out/room/pinholes   # the same room from elsewhere
"""

import argparse
import struct
import zlib
from pathlib import Path

import numpy as np

ROOM = np.array([3.0, 1.4, 2.5])  # half sides, meters; y points down
LIGHT = np.array([0.5, -1.2, 0.3])
BOXES = [((-1.9, 0.8, 1.2), (0.5, 0.6, 0.4)), ((2.1, 0.9, -1.5), (0.4, 0.5, 0.6)), ((0.3, 1.1, 1.9), (0.7, 0.3, 0.3))]
SPHERES = [((0.2, 0.95, 0.0), 0.45), ((-2.0, 1.05, -1.6), 0.35), ((2.2, 1.1, 1.5), 0.3), ((-1.9, -0.1, 1.2), 0.3)]
WAVES = np.random.default_rng(0).normal(size=(16, 3)) * np.geomspace(2, 30, 16)[:, None]  # radians per meter


def surface_color(points, normals, number):
    """Colors of points: a hue of each surface under checkers, waves of all lengths and one lamp."""
    hue = 0.55 + 0.35 * np.sin(2.4 * number[:, None] + np.array([0, 2.1, 4.2]))
    checker = np.where(np.floor(4 * points + 0.01).sum(1) % 2 == 0, 1.0, 0.75)
    waves = np.sin(points @ WAVES.T + 1.7 * number[:, None]).mean(1)
    to_light = LIGHT - points
    lambert = np.abs((normals * to_light).sum(1)) / np.linalg.norm(to_light, axis=1)
    return np.clip(hue * (checker * (0.55 + 0.45 * lambert) * (1 + 0.6 * waves))[:, None], 0, 1)


def box_hits(eye, rays, center, half, from_inside):
    """Distances to a box, and the normals there."""
    with np.errstate(divide="ignore", invalid="ignore"):
        near = ((center - half) - eye) / rays
        far = ((center + half) - eye) / rays
    low, high = np.fmin(near, far), np.fmax(near, far)
    axes, distance = (high.argmin(1), high.min(1)) if from_inside else (low.argmax(1), low.max(1))
    if not from_inside:
        distance = np.where((distance < high.min(1)) & (distance > 0), distance, np.inf)
    return distance, np.eye(3)[axes]


def sphere_hits(eye, rays, center, radius):
    to_center = np.asarray(center) - eye
    along = rays @ to_center
    squared = radius**2 - to_center @ to_center + along**2
    distance = np.where((squared > 0) & (along > 0), along - np.sqrt(np.maximum(squared, 0)), np.inf)
    return distance, (eye + np.where(np.isfinite(distance), distance, 0)[:, None] * rays - center) / radius


def cast(eye, rays):
    """Where rays of length 1 end, and the colors there."""
    distance, normals = box_hits(eye, rays, np.zeros(3), ROOM, True)
    number = normals @ [1, 2, 3] + 3 * ((rays * normals).sum(1) > 0)
    things = [(10 + i, box_hits(eye, rays, np.array(center), np.array(half), False)) for i, (center, half) in enumerate(BOXES)]
    things += [(20 + i, sphere_hits(eye, rays, *sphere)) for i, sphere in enumerate(SPHERES)]
    for name, (other, of_other) in things:
        is_nearer = other < distance
        distance = np.where(is_nearer, other, distance)
        normals = np.where(is_nearer[:, None], of_other, normals)
        number = np.where(is_nearer, name, number)
    points = eye + distance[:, None] * rays
    return points, surface_color(points, normals, number)


class Panorama:
    def __init__(self, width=1024):
        self.width, self.height = width, width // 2
        self.model = f"EQUIRECTANGULAR {width} {self.height} {width} {self.height}"

    def rays(self, x, y):
        east, down = (x / self.width - 0.5) * 2 * np.pi, (y / self.height - 0.5) * np.pi
        return np.stack([np.cos(down) * np.sin(east), np.sin(down), np.cos(down) * np.cos(east)], -1)


class Fisheye:
    """Equidistant, 100 degrees to each side; what lies beyond is black, and masked."""

    width = height = 800
    focal_length = float(400 / np.radians(100))
    model = f"SIMPLE_FISHEYE 800 800 {focal_length!r} 400 400"

    def angle(self, x, y):
        return np.hypot(x - 400, y - 400) / self.focal_length

    def rays(self, x, y):
        theta = self.angle(x, y)
        scale = np.sinc(theta / np.pi) / self.focal_length
        return np.stack([scale * (x - 400), scale * (y - 400), np.cos(theta)], -1)


class Pinhole:
    width, height = 800, 600
    model = "PINHOLE 800 600 500 500 400 300"

    def rays(self, x, y):
        rays = np.stack([(x - 400) / 500, (y - 300) / 500, np.ones_like(x)], -1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def photo(lens, eye, turn):
    """8-bit pixels, each the mean of four rays. turn: cam_from_world."""
    y, x = np.mgrid[:lens.height, :lens.width].astype(float)
    sums = 0
    for dx, dy in ((0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)):
        sums = sums + cast(eye, lens.rays(x.ravel() + dx, y.ravel() + dy) @ turn)[1]
    return np.uint8(np.round(255 * sums / 4).reshape(lens.height, lens.width, 3))


def write_png(path, pixels):
    height, width = pixels.shape[:2]
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    head = struct.pack(">2I5B", width, height, 8, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", zlib.compress(rows, 6)), (b"IEND", b"")]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks))


def pose(random, i, count, is_level):
    """An eye on a round through the room, outside of all things, and the rotation of a camera there."""
    around = 2 * np.pi * i / count
    eye = np.array([1.5 * np.cos(around), random.uniform(-0.8, 0.2), 1.2 * np.sin(around)]) + random.uniform(-0.2, 0.2, 3)
    yaw, pitch = random.uniform(0, 2 * np.pi), 0 if is_level else random.normal(0, 0.3)
    c, s, d, t = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    return eye, np.array([[1, 0, 0], [0, d, -t], [0, t, d]]) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def quaternion(R):
    w = np.sqrt(max(0, 1 + np.trace(R))) / 2
    if w > 1e-3:
        return w, *(np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4 * w))
    axis = np.linalg.svd(R - np.eye(3))[2][2]  # half a turn
    return 0, *axis


def write_scene(folder, lens, count, seed):
    random = np.random.default_rng(seed)
    model = folder / "sparse" / "0"
    model.mkdir(parents=True, exist_ok=True)
    images, points = [], []
    for i in range(count):
        eye, turn = pose(random, i, count, isinstance(lens, Panorama))
        pixels = photo(lens, eye, turn)
        if isinstance(lens, Fisheye):
            y, x = np.mgrid[:lens.height, :lens.width] + 0.5
            is_seen = lens.angle(x, y) < np.radians(100)
            pixels[~is_seen] = 0
            write_png(folder / "masks" / f"{i:03}.png", np.uint8(255 * is_seen))
        write_png(folder / "images" / f"{i:03}.png", pixels)
        images.append(" ".join(map(repr, map(float, (*quaternion(turn), *(-turn @ eye))))))
        rays = random.normal(size=(200, 3))
        points += zip(*cast(eye, rays / np.linalg.norm(rays, axis=1, keepdims=True)))
    (model / "cameras.txt").write_text(f"1 {lens.model}\n")
    (model / "images.txt").write_text("".join(f"{i + 1} {at} 1 {i:03}.png\n\n" for i, at in enumerate(images)))
    (model / "points3D.txt").write_text("".join(
        f"{i + 1} {at[0]:.6f} {at[1]:.6f} {at[2]:.6f} {' '.join(str(int(255 * c)) for c in color)} 0.5 1 0 2 0\n"
        for i, (at, color) in enumerate(points)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--photos", type=int, default=60)
    given = parser.parse_args()
    for seed, (name, lens) in enumerate({"panoramas": Panorama(), "fisheyes": Fisheye(), "pinholes": Pinhole()}.items()):
        write_scene(given.output / name, lens, given.photos, seed)
        print(given.output / name)


if __name__ == "__main__":
    main()
