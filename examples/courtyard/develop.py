# SPDX-License-Identifier: Apache-2.0
# SPDX-FileCopyrightText: The gemsplat authors
"""Turn the layered EXRs of make_scene.py into the JPEG photos (runs in Blender, needs numpy).

    blender -b -P develop.py -- --out IMAGES_FOLDER [--png FOLDER] ROUND_FOLDER...

Rounds of one view are averaged.  What noise is left sits in the light, not in the textures,
so the picture is taken apart into surface color times light; only the light is smoothed,
never across edges of shape (normal, depth) or of shadow (the light itself), and textures
come through untouched.  Blender then applies the scene's film curve and writes the file.
"""
import argparse
import glob
import os
import struct
import sys

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import make_scene  # noqa: E402  (for the film curve, which must be the scene's own)

RADIUS = 3          # pixels; the filter's window is 7 x 7
SIGMA_SPACE, SIGMA_NORMAL, SIGMA_DEPTH, SIGMA_LIGHT = 1.8, 0.15, 0.02, 0.22


def read_exr(path):
    """Channels by name of an uncompressed scanline EXR (the only kind make_scene writes)."""
    with open(path, "rb") as file:
        data = file.read()
    magic, version = struct.unpack_from("<II", data)
    if magic != 20000630 or version & 0x1A00:
        raise ValueError(path + ": not a plain scanline EXR")
    pos, attributes = 8, {}
    while data[pos]:
        name, kind = data[pos:pos + 600].split(b"\0", 2)[:2]
        pos += len(name) + len(kind) + 2
        (size,) = struct.unpack_from("<I", data, pos)
        attributes[name.decode()] = data[pos + 4:pos + 4 + size]
        pos += 4 + size
    if attributes["compression"] != b"\0":
        raise ValueError(path + ": compressed")
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    fields, listing = [("y", "<i4"), ("size", "<i4")], attributes["channels"]
    while listing[0]:
        name, listing = listing.split(b"\0", 1)
        kind = struct.unpack_from("<I", listing)[0]
        fields.append((name.decode().split(".", 1)[1], {1: "<f2", 2: "<f4"}[kind], (width,)))
        listing = listing[16:]
    rows = np.frombuffer(data, np.dtype(fields), height, pos + 1 + 8 * height)
    return {name: rows[name].astype(np.float32) for name in rows.dtype.names[2:]}


def layer(channels, name, axes="RGB"):
    return np.stack([channels[f"{name}.{axis}"] for axis in axes], -1)


def average_rounds(paths):
    """Mean over the rounds of all that the filter needs; light times color is exact."""
    sums = None
    for path in paths:
        c = read_exr(path)
        color = layer(c, "DiffCol")
        parts = [layer(c, "Combined"), color,
                 (layer(c, "DiffDir") + layer(c, "DiffInd")) * color,
                 layer(c, "Normal", "XYZ"), np.minimum(c["Depth.Z"], 100.0)]
        sums = parts if sums is None else [a + b for a, b in zip(sums, parts)]
    return [s / len(paths) for s in sums]


def shifted(a, dy, dx):
    """The neighbor's value at each pixel; the border repeats."""
    height, width = a.shape[:2]
    rows = np.clip(np.arange(height) + dy, 0, height - 1)
    columns = np.clip(np.arange(width) + dx, 0, width - 1)
    return a[rows][:, columns]


def blur3(a):
    for axis in ((1, 0), (0, 1)):
        a = 0.25 * shifted(a, *axis) + 0.5 * a + 0.25 * shifted(a, -axis[0], -axis[1])
    return a


def smooth(values, guide):
    """Mean of the neighbors, weighed by how near their guide is to the pixel's own."""
    total = np.zeros_like(values)
    weights = np.zeros(values.shape[:2], np.float32)
    for dy in range(-RADIUS, RADIUS + 1):
        for dx in range(-RADIUS, RADIUS + 1):
            apart = shifted(guide, dy, dx) - guide
            w = np.exp(-0.5 * ((apart ** 2).sum(-1) + (dy * dy + dx * dx) / SIGMA_SPACE ** 2))
            total += w[..., None] * shifted(values, dy, dx)
            weights += w
    return total / weights[..., None]


def develop(paths):
    combined, color, diffuse, normal, depth = average_rounds(paths)
    light = diffuse / np.maximum(color, 1e-3)
    gloss = combined - diffuse
    bright = np.log(blur3(light.mean(-1)) + 0.02)
    guide = np.concatenate([normal / SIGMA_NORMAL, (np.log(depth) / SIGMA_DEPTH)[..., None],
                            (bright / SIGMA_LIGHT)[..., None]], -1)
    both = smooth(np.concatenate([light, gloss], -1), guide)
    # Where the color is nearly black the quotient above is cut, so keep what it left out.
    rest = diffuse - light * color
    return np.maximum(both[..., :3] * color + rest + both[..., 3:], 0.0)


def save(picture, path, scene, kind):
    height, width = picture.shape[:2]
    image = bpy.data.images.new("photo", width, height, float_buffer=True)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = picture[::-1]                        # Blender's rows run upwards
    image.pixels.foreach_set(rgba.ravel())
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.quality = kind, "RGB", 90
    settings.color_depth = "8"
    image.save_render(path, scene=scene)
    bpy.data.images.remove(image)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", required=True)
    parser.add_argument("--png", help="also write PNGs here")
    parser.add_argument("rounds", nargs="+")
    args = parser.parse_args(sys.argv[sys.argv.index("--") + 1:])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    os.makedirs(args.out, exist_ok=True)
    for path in sorted(glob.glob(os.path.join(args.rounds[0], "view_*.exr"))):
        name = os.path.splitext(os.path.basename(path))[0]
        paths = [os.path.join(folder, name + ".exr") for folder in args.rounds]
        picture = develop([p for p in paths if os.path.exists(p)])
        scene = bpy.context.scene
        if scene.camera is None:
            scene = make_scene.setup_render(picture.shape[1], picture.shape[0], 1)
        save(picture, os.path.join(args.out, name + ".jpg"), scene, "JPEG")
        if args.png:
            os.makedirs(args.png, exist_ok=True)
            save(picture, os.path.join(args.png, name + ".png"), scene, "PNG")


if __name__ == "__main__":
    main()
