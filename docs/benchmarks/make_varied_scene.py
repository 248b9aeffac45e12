"""Makes a scene whose exposure, white balance and vignetting are known, from renders of a run.

    python3 make_varied_scene.py RUN SCENE OUT [--program gemsplat] [--device cuda]
    python3 make_varied_scene.py --check OUT/truth.json TRAINED_RUN

RUN was trained on SCENE, a COLMAP model of PINHOLE cameras in binary form. The first command renders
each of its photos twice: OUT/plain shows the scene's own colors, and OUT/varied shows photo k under
gains of up to one stop, by channel, and on camera k % 3 + 1, whose lens darkens the corners by 0,
25 and 45 %. Colors are made darker in both, so that no gain makes them white. OUT/truth.json has all
numbers, as photometric.json has them.

The second command compares a run that was trained on OUT/varied with them, and prints the errors of
gains and corners. Photos of one place share an error that other photos need not have, because the
scene may be as much brighter there. Its neutral pictures are to be compared with a run on OUT/plain:

    gemsplat train OUT/varied -o A --eval --set photometric.model=gains \\
        --set photometric.vignetting=true
    gemsplat train OUT/plain -o B --eval
    gemsplat eval A --data OUT/plain         # against the PSNR of B
"""

import argparse
import json
import math
import os
import pathlib
import random
import shutil
import struct
import subprocess
import sys

STOP = math.log(2)
DARKER = -0.9  # log; a gain of one stop and a half-white color then stay below white
# log_vignetting_1 to _3 of the cameras 1 to 3 (gs_core/math/photometric.h)
LENSES = [(0.0, 0.0, 0.0), (0.144, -0.0035, 0.0001), (0.2955, -0.0146, 0.0009)]  # near cos^4
CHANNELS = ("red", "green", "blue")


def arguments():
    parser = argparse.ArgumentParser(prog="make_varied_scene.py")
    parser.add_argument("run")
    parser.add_argument("scene")
    parser.add_argument("out", nargs="?")
    parser.add_argument("--check", action="store_true", help="RUN is truth.json, SCENE a run")
    parser.add_argument("--program", default="gemsplat")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if not options.check and not options.out:
        parser.error("name the folder to make, OUT")
    return options


# --- COLMAP's binary files

class Bytes:
    def __init__(self, path):
        self.path, self.data, self.at = path, path.read_bytes(), 0

    def take(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values

    def text(self):
        end = self.data.index(b"\0", self.at)
        word = self.data[self.at:end].decode()
        self.at = end + 1
        return word


def read_images(path):
    """(id, pose, name, observations as bytes) of each image, sorted by name."""
    file = Bytes(path)
    images = []
    for _ in range(file.take("Q")[0]):
        number, *pose = file.take("I7d")
        file.take("I")
        name = file.text()
        count, = file.take("Q")
        seen = file.data[file.at:file.at + 24 * count]
        file.at += 24 * count
        images.append((number, pose, name, seen))
    return sorted(images, key=lambda image: image[2])


def read_pinhole(path):
    file = Bytes(path)
    if file.take("Q")[0] != 1:
        sys.exit(f"{path} has several cameras; take a scene of one")
    _, model, width, height = file.take("IiQQ")
    if model not in (0, 1):
        sys.exit(f"the camera of {path} is no pinhole; run `gemsplat undistort` on the scene first")
    return model, width, height, file.take("3d" if model == 0 else "4d")


def write_model(folder, scene, images):
    """The model of the scene, whose image k has camera k % 3 + 1 and a PNG."""
    folder.mkdir(parents=True)
    model, width, height, parameters = read_pinhole(scene / "sparse/0/cameras.bin")
    cameras = struct.pack("<Q", len(LENSES))
    for camera in range(len(LENSES)):
        cameras += struct.pack("<IiQQ", camera + 1, model, width, height)
        cameras += struct.pack(f"<{len(parameters)}d", *parameters)
    (folder / "cameras.bin").write_bytes(cameras)
    data = struct.pack("<Q", len(images))
    for k, (number, pose, name, seen) in enumerate(images):
        data += struct.pack("<I7dI", number, *pose, k % len(LENSES) + 1)
        data += png(name).encode() + b"\0" + struct.pack("<Q", len(seen) // 24) + seen
    (folder / "images.bin").write_bytes(data)
    shutil.copy(scene / "sparse/0/points3D.bin", folder)
    for name in ("rigs.bin", "frames.bin"):
        if (scene / "sparse/0" / name).exists():
            print(f"{name} is left out: it names the cameras of the scene")


def png(name):
    return str(pathlib.PurePosixPath(name).with_suffix(".png"))


# --- What photos show

def truth_of(images, seed):
    draws = random.Random(seed)
    photos = {}
    for k, (_, _, name, _) in enumerate(images):
        stop = draws.uniform(-1, 1) * (STOP - 0.1)
        tint = [draws.uniform(-0.1, 0.1) for _ in CHANNELS]
        photos[name] = {"camera": k % len(LENSES) + 1}
        for channel, more in zip(CHANNELS, tint):
            photos[name]["log_gain_" + channel] = stop + more
    return photos


def looks_of(photos, is_varied, width, height):
    """photometric.json: the gains mean the middle of the photos, where B is B(0)."""
    looks = {"model": "gains", "vignetting": True, "photos": {}, "held_out": {}, "cameras": {},
             "rule": "mean", "spreads": {"mean": 0}}
    for name, photo in photos.items():
        middle = lens(LENSES[photo["camera"] - 1], 0) if is_varied else 0
        looks["photos"][name] = {"camera": photo["camera"]}
        for channel in CHANNELS:
            gain = photo["log_gain_" + channel] if is_varied else 0
            looks["photos"][name]["log_gain_" + channel] = DARKER + gain + middle
    for camera, numbers in enumerate(LENSES):
        looks["cameras"][str(camera + 1)] = {
            "width": width, "height": height, "cx": width / 2, "cy": height / 2,
            **{f"log_vignetting_{i + 1}": b if is_varied else 0.0 for i, b in enumerate(numbers)}}
    return looks


def lens(numbers, rho):
    s = 2 * rho - 1
    legendre = (s, (3 * s * s - 1) / 2, (5 * s ** 3 - 3 * s) / 2)
    return sum(b * p for b, p in zip(numbers, legendre))


def render(options, looks, folder):
    """Renders all views of the run, each under its look."""
    run = pathlib.Path(options.out) / "run"  # the run with another photometric.json
    shutil.rmtree(run, ignore_errors=True)
    run.mkdir(parents=True)
    for entry in pathlib.Path(options.run).resolve().iterdir():
        if entry.name not in ("photometric.json", ".lock"):
            os.symlink(entry, run / entry.name)
    (run / "photometric.json").write_text(json.dumps(looks))
    subprocess.run([options.program, "render", str(run), "--data", options.scene, "--split", "all",
                    "-r", "1", "--like", "each", "--device", options.device, "-o", str(folder)],
                   check=True)
    shutil.rmtree(run)


def make(options):
    scene, out = pathlib.Path(options.scene), pathlib.Path(options.out)
    if (out / "truth.json").exists():
        sys.exit(f"{out} holds such a scene already; name another folder")
    images = read_images(scene / "sparse/0/images.bin")
    _, width, height, _ = read_pinhole(scene / "sparse/0/cameras.bin")
    photos = truth_of(images, options.seed)
    for name, is_varied in (("plain", False), ("varied", True)):
        write_model(out / name / "sparse/0", scene, images)
        render(options, looks_of(photos, is_varied, width, height), out / name / "images")
    truth = {"photos": {png(name): photo for name, photo in photos.items()},
             "cameras": {str(k + 1): numbers for k, numbers in enumerate(LENSES)}}
    (out / "truth.json").write_text(json.dumps(truth, indent=2) + "\n")
    print(f"{len(images)} photos in {out}/varied and {out}/plain")


# --- What a run has learned

def root_mean_square(values):
    return math.sqrt(sum(value ** 2 for value in values) / len(values))


def check(truth_file, run):
    truth = json.loads(pathlib.Path(truth_file).read_text())
    learned = json.loads((pathlib.Path(run) / "photometric.json").read_text())

    def numbers(camera):
        entry = learned["cameras"][camera]
        return [entry.get(f"log_vignetting_{i}", 0.0) for i in (1, 2, 3)]

    # A factor of all photos is the scene's.
    errors, steps = [], []
    for channel in CHANNELS:
        of_photos = {}
        for name, photo in learned["photos"].items():
            middle = lens(numbers(str(photo["camera"])), 0)
            of_photos[name] = (photo["log_gain_" + channel] - middle
                               - truth["photos"][name]["log_gain_" + channel])
        mean = sum(of_photos.values()) / len(of_photos)
        errors += [(abs(error - mean), name) for name, error in of_photos.items()]
        in_order = [of_photos[name] for name in sorted(of_photos)]
        steps += [(b - a) / math.sqrt(2) for a, b in zip(in_order, in_order[1:])]
    print(f"error of a log gain: {root_mean_square([e for e, _ in errors]):.4f} in the root mean "
          f"square, {max(errors)[0]:.4f} at worst, of {max(errors)[1]}; what neighbors by name do "
          f"not share of it: {root_mean_square(steps):.4f}")
    for camera, known in truth["cameras"].items():
        corner = lens(numbers(camera), 1) - lens(numbers(camera), 0)
        error = corner - (lens(known, 1) - lens(known, 0))
        print(f"camera {camera}: corner of {math.exp(-corner):.3f}, log error {error:+.4f}")


if __name__ == "__main__":
    given = arguments()
    if given.check:
        check(given.run, given.scene)
    else:
        make(given)
