# SPDX-License-Identifier: Apache-2.0
"""Makes what a peer reads of a COLMAP scene: lengths scaled, the principal point in the middle.

    scale_scene.py SCENE OUT [--distance 3.4]

OUT/peer      photos and sparse/0 (.bin) in scaled units
OUT/plain     the same cameras and photos in the units of SCENE; the depth maps go with these
OUT/scale.json  {"scale": peer units per unit of SCENE, ...}

The peers' lengths are absolute. Scenes whose cameras are 2.5 to 5 units from the median sparse point
keep their unit; others get --distance, that of DTU's scans in their own preparation. The peers know
no principal point: photos are cut, and shifted by the fraction of a pixel that is left.
"""
import argparse
import json
import os
import struct
import sys

import numpy as np

MODELS = {"SIMPLE_PINHOLE": (0, 3), "PINHOLE": (1, 4), "SIMPLE_RADIAL": (2, 4), "RADIAL": (3, 5),
          "OPENCV": (4, 8)}
NAMES = {number: (name, count) for name, (number, count) in MODELS.items()}


class Reader:
    def __init__(self, path):
        with open(path, "rb") as file:
            self.data, self.at = file.read(), 0

    def take(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values

    def name(self):
        end = self.data.index(b"\0", self.at)
        text, self.at = self.data[self.at:end].decode(), end + 1
        return text


def read_binary(folder):
    r, cameras, images = Reader(f"{folder}/cameras.bin"), {}, []
    for _ in range(r.take("Q")[0]):
        key, model, width, height = r.take("iiQQ")
        name, count = NAMES[model]
        cameras[key] = (name, width, height, r.take(f"{count}d"))
    r = Reader(f"{folder}/images.bin")
    for _ in range(r.take("Q")[0]):
        key, *pose, camera = r.take("i7di")
        name = r.name()
        count = r.take("Q")[0]
        r.at += 24 * count
        images.append((key, np.array(pose[:4]), np.array(pose[4:]), camera, name))
    r, points, colors = Reader(f"{folder}/points3D.bin"), [], []
    for _ in range(r.take("Q")[0]):
        _, x, y, z, red, green, blue, _, length = r.take("Q3d3BdQ")
        r.at += 8 * length
        points.append((x, y, z))
        colors.append((red, green, blue))
    return cameras, images, np.array(points), np.array(colors, np.uint8)


def read_text(folder):
    def lines(name):
        with open(f"{folder}/{name}.txt") as file:
            return [line.rstrip("\n") for line in file if not line.startswith("#")]
    cameras, images, points, colors = {}, [], [], []
    for words in (line.split() for line in lines("cameras") if line.strip()):
        cameras[int(words[0])] = (words[1], int(words[2]), int(words[3]),
                                  tuple(map(float, words[4:])))
    for line in lines("images")[::2]:  # every other line holds the points of a photo, or nothing
        words = line.split(maxsplit=9)
        if len(words) == 10:
            numbers = list(map(float, words[1:8]))
            images.append((int(words[0]), np.array(numbers[:4]), np.array(numbers[4:]),
                           int(words[8]), words[9]))
    for words in (line.split() for line in lines("points3D") if line.strip()):
        points.append(tuple(map(float, words[1:4])))
        colors.append(tuple(map(int, words[4:7])))
    return cameras, images, np.array(points), np.array(colors, np.uint8)


def write_binary(folder, cameras, images, points, colors):
    os.makedirs(folder, exist_ok=True)
    with open(f"{folder}/cameras.bin", "wb") as file:
        file.write(struct.pack("<Q", len(cameras)))
        for key, (name, width, height, numbers) in cameras.items():
            number, count = MODELS[name]
            file.write(struct.pack(f"<iiQQ{count}d", key, number, width, height, *numbers))
    with open(f"{folder}/images.bin", "wb") as file:
        file.write(struct.pack("<Q", len(images)))
        for key, turn, move, camera, name in images:
            file.write(struct.pack("<i7di", key, *turn, *move, camera) + name.encode() + b"\0" +
                       struct.pack("<Q", 0))
    with open(f"{folder}/points3D.bin", "wb") as file:
        file.write(struct.pack("<Q", len(points)))
        for i, (p, c) in enumerate(zip(points, colors)):
            file.write(struct.pack("<Q3d3BdQ", i + 1, *p, *map(int, c), .3, 0))


def rotation(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def middle_cut(camera):
    """Left, top, width, height and the fraction of a pixel by which the photo must move so that the
    principal point is the middle of the cut; None where it is there."""
    model, width, height, numbers = camera
    if model not in ("PINHOLE", "SIMPLE_PINHOLE"):
        sys.exit(f"cameras are {model}; run `gemsplat undistort SCENE -o FLAT` and take FLAT")
    cut = []
    for size, center in ((width, numbers[-2]), (height, numbers[-1])):
        if abs(center - size / 2) < .02:
            cut.append((0, size, 0.0))
            continue
        half = int(np.floor(min(center, size - center)))
        first = int(np.clip(round(center - half), 0, size - 2 * half))
        cut.append((first, 2 * half, center - half - first))
    return cut if any(c[0] or c[2] for c in cut) else None


def cut_photo(source, target, cut):
    from PIL import Image
    (left, width, dx), (top, height, dy) = cut
    photo = Image.open(source)
    photo = photo if photo.mode in ("RGB", "RGBA") else photo.convert("RGB")
    photo.transform((width, height), Image.AFFINE, (1, 0, left + dx, 0, 1, top + dy),
                    resample=Image.BICUBIC).save(target)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    parser.add_argument("out")
    parser.add_argument("--distance", type=float, default=3.4)
    options = parser.parse_args()
    scene, out = os.path.abspath(options.scene), os.path.abspath(options.out)
    model = f"{scene}/sparse/0"
    read = read_binary if os.path.exists(f"{model}/cameras.bin") else read_text
    cameras, images, points, colors = read(model)
    images.sort(key=lambda image: image[4])
    stems = [os.path.basename(image[4]).split(".")[0] for image in images]
    if len(set(stems)) < len(stems):
        sys.exit("photos in several folders have equal names, which the peers mix up")
    places = np.array([-rotation(q).T @ t for _, q, t, _, _ in images])
    distance = float(np.median(np.linalg.norm(places - np.median(points, 0), axis=1)))
    scale = 1.0 if 2.5 <= distance <= 5 else options.distance / distance

    cuts = {key: middle_cut(camera) for key, camera in cameras.items()}
    for key, cut in cuts.items():
        name, width, height, numbers = cameras[key]
        if cut:
            width, height = cut[0][1], cut[1][1]
        cameras[key] = (name, width, height, (*numbers[:-2], width / 2, height / 2))
    os.makedirs(f"{out}/peer", exist_ok=True)
    is_cut = any(cuts.values())
    if is_cut:
        os.makedirs(f"{out}/peer/images", exist_ok=True)
        for image, stem in zip(images, stems):
            source, target = f"{scene}/images/{image[4]}", f"{out}/peer/images/{stem}.png"
            if cuts[image[3]]:
                cut_photo(source, target, cuts[image[3]])
            else:
                from PIL import Image
                Image.open(source).save(target)
        images = [(*image[:4], stem + ".png") for image, stem in zip(images, stems)]
        photos = f"{out}/peer/images"
    else:
        photos = f"{scene}/images"
        if not os.path.lexists(f"{out}/peer/images"):
            os.symlink(photos, f"{out}/peer/images")
    os.makedirs(f"{out}/plain", exist_ok=True)
    if not os.path.lexists(f"{out}/plain/images"):
        os.symlink(photos, f"{out}/plain/images")
    write_binary(f"{out}/plain/sparse/0", cameras, images, points, colors)
    scaled = [(key, q, scale * t, camera, name) for key, q, t, camera, name in images]
    write_binary(f"{out}/peer/sparse/0", cameras, scaled, scale * points, colors)
    with open(f"{out}/scale.json", "w") as file:
        json.dump({"scale": scale, "distance": distance, "photos": len(images), "is_cut": is_cut,
                   "size": list(next(iter(cameras.values()))[1:3])}, file)
    print(f"{scene}: cameras {distance:.3g} away, scale {scale:.4g}"
          + (", photos cut to the principal point" if is_cut else ""))


if __name__ == "__main__":
    main()
