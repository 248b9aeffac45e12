# SPDX-License-Identifier: Apache-2.0
"""Makes a small room whose depth is known exactly, by ray casting, with few photos to train on.

    python3 make_depth_scene.py OUT [--seed 1] [--photos 30] [--train 6] [--points 400]

OUT becomes a COLMAP scene with a folder of depth maps for each case of the table in
docs/lab/2026-11-depth.md:

    depth_metric    16-bit PNG, millimeters along the viewing axis
    depth_scaled    the same times a factor of each photo
    depth_inverse   inverse depth, with scale and shift of each photo, as monocular networks give it
    depth_noisy     the same with errors as networks have them: smooth waves of some percent

Names that begin with "t" are to be trained on; OUT/train.txt has the setting that holds out the
others. A wall and the floor have hardly any texture, so that few photos alone do not tell how far they
are. Needs nothing but Python.
"""

import argparse
import math
import pathlib
import random
import struct
import zlib

WIDTH, HEIGHT, FOCAL = 160, 120, 130.0
SAMPLES = ((0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75))  # of a pixel


# --- The room. x to the right, y down, z ahead; units are meters.

def plain(base, slope):
    return lambda p: tuple(min(1, max(0, base[c] + slope[c] * (0.3 * p[0] + 0.2 * p[1] + 0.25 * p[2])))
                           for c in range(3))


def checks(a, b, size):
    def color(p):
        odd = sum(math.floor(v / size + 0.013) for v in p) % 2
        wave = 0.08 * math.sin(9 * p[0] + 5 * p[1] - 7 * p[2])
        return tuple(min(1, max(0, v + wave)) for v in (a if odd else b))
    return color


ROOM = (  # low corner, high corner, color; seen from inside
    (-2.0, -1.2, -1.0), (2.0, 1.0, 5.0),
    {0: checks((0.55, 0.4, 0.3), (0.7, 0.6, 0.45), 0.4),          # left and right
     1: plain((0.5, 0.47, 0.42), (0.06, 0.05, 0.03)),             # floor and ceiling
     2: plain((0.35, 0.45, 0.6), (0.05, 0.04, -0.03))})           # front and back
BOXES = (
    ((-1.5, 0.2, 2.6), (-0.7, 1.0, 3.4), checks((0.75, 0.25, 0.2), (0.9, 0.7, 0.3), 0.2)),
    ((0.5, -0.3, 3.3), (1.3, 1.0, 4.0), plain((0.25, 0.5, 0.3), (0.1, -0.05, 0.08))),
    ((-0.3, 0.6, 1.7), (0.4, 1.0, 2.3), checks((0.2, 0.3, 0.7), (0.8, 0.8, 0.85), 0.13)))
BALLS = (
    ((0.1, 0.25, 2.0), 0.35, plain((0.8, 0.6, 0.2), (-0.1, 0.15, 0.2))),
    ((-0.9, -0.2, 3.0), 0.4, checks((0.5, 0.2, 0.6), (0.85, 0.8, 0.5), 0.17)),
    ((1.2, 0.65, 2.2), 0.35, plain((0.7, 0.7, 0.72), (0.1, 0.05, 0.0))))


def box_hit(origin, ray, low, high, inside):
    """The distance along the ray and the axis of the face."""
    near, far, near_axis, far_axis = -math.inf, math.inf, 0, 0
    for axis in range(3):
        if abs(ray[axis]) < 1e-12:
            if not low[axis] <= origin[axis] <= high[axis]:
                return None
            continue
        a = (low[axis] - origin[axis]) / ray[axis]
        b = (high[axis] - origin[axis]) / ray[axis]
        if a > b:
            a, b = b, a
        if a > near:
            near, near_axis = a, axis
        if b < far:
            far, far_axis = b, axis
    if inside:
        return far, far_axis
    return (near, near_axis) if 1e-6 < near < far else None


def ball_hit(origin, ray, center, radius):
    o = tuple(origin[i] - center[i] for i in range(3))
    a = sum(v * v for v in ray)
    b = sum(o[i] * ray[i] for i in range(3))
    c = sum(v * v for v in o) - radius * radius
    square = b * b - a * c
    if square < 0:
        return None
    near = (-b - math.sqrt(square)) / a
    return near if near > 1e-6 else None


def cast(origin, ray):
    """Distance in units of the ray, and color."""
    low, high, colors = ROOM
    distance, axis = box_hit(origin, ray, low, high, True)
    color, normal = colors[axis], axis
    for low, high, of_box in BOXES:
        hit = box_hit(origin, ray, low, high, False)
        if hit and hit[0] < distance:
            distance, normal, color = hit[0], hit[1], of_box
    shade = (0.92, 1.0, 0.85)[normal]
    for center, radius, of_ball in BALLS:
        hit = ball_hit(origin, ray, center, radius)
        if hit and hit < distance:
            distance, color = hit, of_ball
            up = (origin[1] + hit * ray[1] - center[1]) / radius
            shade = 0.85 - 0.15 * up
    point = tuple(origin[i] + distance * ray[i] for i in range(3))
    return distance, tuple(shade * v for v in color(point))


# --- Cameras

def camera(k, count, draw):
    """World from camera: center and the three axes."""
    angle = 2 * math.pi * k / count
    center = (0.9 * math.cos(angle) + draw.uniform(-0.1, 0.1), 0.35 * math.sin(2 * angle) - 0.15,
              0.35 * math.sin(angle) + draw.uniform(-0.1, 0.1) - 0.2)
    target = (draw.uniform(-0.3, 0.3), 0.2 + draw.uniform(-0.2, 0.2), 2.8)
    z = [target[i] - center[i] for i in range(3)]
    n = math.sqrt(sum(v * v for v in z))
    z = [v / n for v in z]
    n = math.hypot(z[0], z[2])
    x = [z[2] / n, 0.0, -z[0] / n]
    y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]]
    return center, x, y, z


def ray_of(axes, u, v):
    a, b = (u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL
    return tuple(a * axes[0][i] + b * axes[1][i] + axes[2][i] for i in range(3))


def quaternion(rows):
    (a, b, c), (d, e, f), (g, h, i) = rows
    w = math.sqrt(max(0.0, 1 + a + e + i)) / 2
    if w > 0.1:
        return w, (h - f) / (4 * w), (c - g) / (4 * w), (d - b) / (4 * w)
    x = math.sqrt(max(0.0, 1 + a - e - i)) / 2
    return (h - f) / (4 * x), x, (b + d) / (4 * x), (c + g) / (4 * x)


# --- Files

def png(path, width, height, bits, channels, rows):
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))
    header = struct.pack(">IIBBBBB", width, height, bits, 2 if channels == 3 else 0, 0, 0, 0)
    pixels = b"".join(b"\0" + row for row in rows)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) +
                     chunk(b"IDAT", zlib.compress(pixels, 6)) + chunk(b"IEND", b""))


def photo_rows(view):
    center, *axes = view
    rows = []
    for y in range(HEIGHT):
        row = bytearray()
        for x in range(WIDTH):
            colors = [cast(center, ray_of(axes, x + dx, y + dy))[1] for dx, dy in SAMPLES]
            row += bytes(round(255 * sum(c[i] for c in colors) / len(colors)) for i in range(3))
        rows.append(bytes(row))
    return rows


def depths(view):
    """Along the viewing axis: rays have length 1 along it."""
    center, *axes = view
    return [[cast(center, ray_of(axes, x + 0.5, y + 0.5))[0] for x in range(WIDTH)]
            for y in range(HEIGHT)]


def write_depth(path, values):
    png(path, WIDTH, HEIGHT, 16, 1,
        [b"".join(struct.pack(">H", min(65535, max(1, round(v)))) for v in row) for row in values])


def write_maps(out, name, depth, draw):
    factor = math.exp(draw.uniform(-0.5, 0.5))
    scale, shift = draw.uniform(12000, 20000), draw.uniform(1000, 8000)
    waves = [(draw.uniform(0.03, 0.09), draw.uniform(0.03, 0.09), draw.uniform(0, 6.3))
             for _ in range(3)]

    def wave(x, y):
        return 1 + 0.03 * sum(math.sin(a * x + b * y + c) for a, b, c in waves)

    write_depth(out / "depth_metric" / name, [[1000 * z for z in row] for row in depth])
    write_depth(out / "depth_scaled" / name, [[1000 * factor * z for z in row] for row in depth])
    write_depth(out / "depth_inverse" / name,
                [[scale / z + shift for z in row] for row in depth])
    write_depth(out / "depth_noisy" / name,
                [[scale / z * wave(x, y) + shift for x, z in enumerate(row)]
                 for y, row in enumerate(depth)])


def seen(view, point):
    """Where a photo shows a point, unless something hides it."""
    center, *axes = view
    offset = [point[i] - center[i] for i in range(3)]
    x, y, z = (sum(axis[i] * offset[i] for i in range(3)) for axis in axes)
    if z < 0.1:
        return None
    u, v = FOCAL * x / z + WIDTH / 2, FOCAL * y / z + HEIGHT / 2
    if not (0 < u < WIDTH and 0 < v < HEIGHT):
        return None
    return (u, v) if z < 1.03 * cast(center, ray_of(axes, u, v))[0] else None


def write_model(out, views, names, points):
    folder = out / "sparse" / "0"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text(
        f"1 PINHOLE {WIDTH} {HEIGHT} {FOCAL} {FOCAL} {WIDTH / 2} {HEIGHT / 2}\n")
    lines, tracks = [], [[] for _ in points]
    for k, (center, *axes) in enumerate(views):
        shift = [-sum(axis[i] * center[i] for i in range(3)) for axis in axes]
        numbers = " ".join(f"{v:.9f}" for v in (*quaternion(axes), *shift))
        places = [(i, seen(views[k], p)) for i, (p, _) in enumerate(points)]
        places = [(i, place) for i, place in places if place]
        for index, (i, _) in enumerate(places):
            tracks[i].append(f"{k + 1} {index}")
        lines.append(f"{k + 1} {numbers} 1 {names[k]}\n" +
                     " ".join(f"{u:.3f} {v:.3f} {i + 1}" for i, (u, v) in places) + "\n")
    (folder / "images.txt").write_text("".join(lines))
    (folder / "points3D.txt").write_text("".join(
        f"{k + 1} {p[0]:.5f} {p[1]:.5f} {p[2]:.5f} {c[0]} {c[1]} {c[2]} 0.5 "
        f"{' '.join(tracks[k])}\n" for k, (p, c) in enumerate(points)))


def texture(center, axes, u, v):
    """How much the color differs around a place of a photo; structure from motion needs it."""
    here = cast(center, ray_of(axes, u, v))[1]
    there = [cast(center, ray_of(axes, u + dx, v + dy))[1] for dx, dy in ((2, 0), (0, 2))]
    return sum(abs(here[i] - color[i]) for color in there for i in range(3))


def sparse_points(views, count, draw):
    """Points on surfaces where there is texture, with errors of a centimeter."""
    points = []
    while len(points) < count:
        center, *axes = draw.choice(views)
        u, v = draw.uniform(2, WIDTH - 4), draw.uniform(2, HEIGHT - 4)
        if texture(center, axes, u, v) < 0.12:
            continue
        ray = ray_of(axes, u, v)
        distance, color = cast(center, ray)
        points.append((tuple(center[i] + distance * ray[i] + draw.gauss(0, 0.01) for i in range(3)),
                       tuple(round(255 * min(1, c)) for c in color)))
    return points


def main():
    parser = argparse.ArgumentParser(prog="make_depth_scene.py")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--photos", type=int, default=30)
    parser.add_argument("--train", type=int, default=6)
    parser.add_argument("--points", type=int, default=400)
    options = parser.parse_args()
    draw = random.Random(options.seed)
    views = [camera(k, options.photos, draw) for k in range(options.photos)]
    step = options.photos // options.train
    trained = {k * step for k in range(options.train)}
    names = [f"{'t' if k in trained else 'v'}{k:03d}.png" for k in range(options.photos)]
    for k, view in enumerate(views):
        png(options.out / "images" / names[k], WIDTH, HEIGHT, 8, 3, photo_rows(view))
        write_maps(options.out, names[k], depths(view), draw)
    points = sparse_points([views[k] for k in sorted(trained)], options.points, draw)
    write_model(options.out, views, names, points)
    (options.out / "train.txt").write_text(
        "dataset.test_names=" + ",".join(n for n in names if n[0] == "v") + "\n")


if __name__ == "__main__":
    main()
