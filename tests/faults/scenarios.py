# SPDX-License-Identifier: Apache-2.0
"""What the campaigns of this folder disturb: verbs of the program on a tiny scene, how each goes on
after a failure, and which bytes have to be the same in the end."""

import hashlib
import json
import math
import re
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

WIDTH, HEIGHT = 40, 32  # pixels; a focal length is 40 pixels
VIEWS, POINTS = 6, 150
STEPS = 24

TRAIN = [
    "--eval", "--test-every", "3", "--device", "cpu", "--threads", "2", "--background", "random",
    "--checkpoint-every", "5", "--save-steps", "8", "--test-steps", "12",
    "--set", "train.log_every=5", "--set", "density.from_step=6", "--set", "density.every=6",
    "--set", "density.gradient_threshold=1e-5",
]  # fmt: skip

EXPERIMENT = """
output = 'out'
scenes = ['scene']
seeds = [1, 2]
[set]
train = {iterations = 8, device = 'cpu', threads = 1, log_every = 4}
dataset = {eval = true, test_every = 3}
[[configs]]
name = 'plain'
"""

# A stand-in for COLMAP: each command writes something, and the mapper copies the model beside it.
COLMAP = """#!/bin/sh
here=$(dirname "$0")
sleep 0.05
case "$*" in *" -h") echo "  --SiftExtraction.use_gpu arg (=1)"; exit 0;; esac
case "$1" in
  feature_extractor)
    n=0
    for name in 0 1 2 3 4 5; do
      n=$((n + 1))
      printf 'Processed file [%d/6]\\n  Name:            view_%d.png\\n' $n $name
      echo "  Features:        500"
    done;;
  exhaustive_matcher) echo "Matching block [1/1, 1/1] in 0.1s";;
  mapper)
    echo "Registering image #3 (3)"; echo "  => Image sees 119 / 933 points"
    while [ "$1" != --output_path ]; do shift; done
    cp -r "$here/model" "$2/0";;
esac
"""


# ---- the scene -----------------------------------------------------------------------------------


def write_png(path, rows):
    """A PNG of 8-bit RGB rows."""
    def chunk(kind, data):
        check = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + check

    header = struct.pack(">IIBBBBB", len(rows[0]) // 3, len(rows), 8, 2, 0, 0, 0)
    pixels = zlib.compress(b"".join(b"\0" + row for row in rows))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) +
                     chunk(b"IEND", b""))


def write_photos(folder):
    folder.mkdir(parents=True)
    for v in range(VIEWS):
        rows = [bytes(c for x in range(WIDTH) for c in (int(128 + 100 * math.sin(0.3 * (x + v))),
                                                        int(128 + 100 * math.sin(0.25 * y)),
                                                        200 - 3 * y)) for y in range(HEIGHT)]
        write_png(folder / f"view_{v}.png", rows)


def write_model(folder, has_lens=False):
    """Cameras on a line, looking along z at points between 3 and 5 world units away. With a lens,
    every other photo was taken through it."""
    folder.mkdir(parents=True)
    lens = f"2 SIMPLE_RADIAL {WIDTH} {HEIGHT} 40 20 16 -0.05\n" if has_lens else ""
    (folder / "cameras.txt").write_text(f"1 PINHOLE {WIDTH} {HEIGHT} 40 40 20 16\n{lens}")
    images = [f"{v + 1} 1 0 0 0 {-0.1 * v:g} 0 0 {1 + v % 2 * has_lens} view_{v}.png\n\n"
              for v in range(VIEWS)]
    (folder / "images.txt").write_text("".join(images))
    points = []
    for p in range(POINTS):
        u, v, w = (p * 0.618034 % 1, p * 0.754878 % 1, p * 0.569840 % 1)
        z = 3 + 2 * w
        x, y = (u - 0.5) * z, (v - 0.5) * z * 0.8
        points.append(f"{p + 1} {x:.5f} {y:.5f} {z:.5f} 120 130 140 0.5\n")
    (folder / "points3D.txt").write_text("".join(points))


OF_THE_USER = "a file of the user's"


# ---- bytes that have to be the same --------------------------------------------------------------

# Values that no two runs share: times, and memory.
TIMES = {"train_seconds", "wall_seconds", "date", "peak_host_bytes", "seconds", "steps_per_second",
         "training / s", "memory / MiB"}
# Files of which only the name counts: they hold times throughout, or grow with every attempt.
LOGS = {"profile.csv", "report.html", "train.log", "colmap.log"}


def comparable(name, data):
    """The bytes of a file without what differs between two runs."""
    base = name.rsplit("/", 1)[-1]
    if base in LOGS:
        return b""
    if data.startswith(OF_THE_USER.encode()):
        return data
    if base.endswith(".json"):
        return json.dumps(without_times(json.loads(data))).encode()
    if base.endswith(".csv"):
        return without_columns(data, b",")
    if base == "results.md":
        return without_columns(re.sub(rb"written [0-9TZ:-]+", b"", data), b" | ")
    if base.endswith(".ckpt"):
        return payload_of_checkpoint(data)
    return data


def without_times(value):
    if isinstance(value, dict):
        return {key: without_times(v) for key, v in value.items() if key not in TIMES}
    return [without_times(v) for v in value] if isinstance(value, list) else value


def without_columns(data, separator):
    """Tables without the columns of times. A row of names begins the file, or follows a line that
    is no row."""
    kept, dropped, is_table = [], set(), False
    for line in data.split(b"\n"):
        cells = line.removesuffix(b" |").split(separator)
        if len(cells) > 1 and not is_table:
            dropped = {i for i, cell in enumerate(cells) if cell.decode() in TIMES}
        is_table = len(cells) > 1 or line.startswith(b"|---")
        kept.append(separator.join(c for i, c in enumerate(cells) if i not in dropped))
    return b"\n".join(kept)


def payload_of_checkpoint(data):
    """All sections of a checkpoint but the time of training, and the checksum over it."""
    kept, at = data[:16], 16
    while at + 40 <= len(data):
        name = data[at:at + 32].rstrip(b"\0")
        size = struct.unpack_from("<Q", data, at + 32)[0]
        section = data[at + 40:at + 40 + size]
        at += 40 + size
        if name != b"end":
            kept += name + b"\0" + re.sub(rb'"train_seconds": *[-0-9.e+]+', b"", section)
    return kept


def digest(data):
    return hashlib.sha256(data).hexdigest()[:16]


def files_below(folder):
    return {p.relative_to(folder).as_posix(): p for p in sorted(folder.rglob("*")) if p.is_file()}


# ---- the verbs -----------------------------------------------------------------------------------



@dataclass(frozen=True)
class Verb:
    """A command of the program in a folder, relative to which its paths are."""

    name: str
    arguments: tuple
    needs: tuple = ()  # made before: "scene", "lens", "photos", "run", "cut" (a run that was killed)
    user_files: tuple = ()  # files of the user's in and beside the output
    faults_in_children: bool = False  # in the runs of an experiment, and not in itself
    may_lack: tuple = ()  # beginnings of names of files that a warning may replace
    again: tuple = ()  # flags that the error names for going on
    before: tuple = ()  # commands that are given before, undisturbed
    visit: str = ""  # who looks at the page meanwhile (visitor.py): "look", which ends it, "control"
    varies: str = "$^"  # names of files that depend on the moment of a visitor's request


def train(*more):
    return ("train", "scene", "-o", "run", *TRAIN, "--iterations", str(STEPS), "--export",
            "spz,sog", "--resume", "auto", *more)


# Far more steps than a visitor needs to pause the run.
WATCHED_STEPS = 120
WATCHED = [*TRAIN[:TRAIN.index("--save-steps")], *TRAIN[TRAIN.index("--test-steps") + 2:],
           "--iterations", str(WATCHED_STEPS), "--viewer", "--viewer-port", "0"]  # fmt: skip
SAVED_BY_A_VISITOR = rf"run/point_cloud/iteration_(?!{WATCHED_STEPS}/)"

PARTITION = ("partition", "scene", "--blocks", "2", "--eval", "--test-every", "3", "--iterations",
             "8", "--device", "cpu", "--threads", "2")  # fmt: skip
PLACE = ("georef", "scene", "--origin", "8.5,47.4,400")

RUN_FILES = ("run/point_cloud/", "run/metrics.csv", "run/profile.csv", "run/report.html",
             "run/comparison.png", "run/test/", "run/checkpoints/",
             "run/scene/reconstruct.json")  # fmt: skip

# What a warning says in place of a file's name: the list of a work folder that could not be removed
# still has it, and a film of another codec is another film.
SIGNS = {"reconstruct.json": ".gemsplat-", "film.json": "MPEG-4", "film.mp4": "MPEG-4"}

VERBS = {verb.name: verb for verb in [
    Verb("train", train(), ("scene",), ("run/notes.txt", "notes.txt"), may_lack=RUN_FILES),
    Verb("resume", train(), ("scene", "cut"), ("run/notes.txt",), may_lack=RUN_FILES),
    Verb("export", ("export", "run", "out/m.spz", "out/m.sog", "out/m.ply", "out/m.glb", "--force"),
         ("scene", "run"), ("out/m.spz", "out/m.ply", "out/notes.txt", "out/m.spz.txt")),
    Verb("edit", ("edit", "run", "-o", "out/part.ply", "--straighten", "--keep", "seen=1..",
                  "--measure", "--picture", "out/part.png", "--force"),
         ("scene", "run"), ("out/part.ply", "out/part.png", "out/notes.txt")),
    Verb("partition", (*PARTITION, "-o", "city", "--force"), ("scene",),
         ("city/block0.toml", "city/notes.txt", "notes.txt")),
    Verb("merge", ("edit", "city", "-o", "out/whole.ply", "--force"), ("scene",),
         ("out/whole.ply", "out/notes.txt"),
         before=((*PARTITION, "-o", "city"), ("experiment", "city/blocks.toml"))),
    Verb("georef", (*PLACE, "-o", "out/georef.json", "--force"), ("scene",),
         ("out/georef.json", "out/notes.txt")),
    Verb("tiles", ("export", "run", "out/tiles/", "--georef", "place.json", "--tile-gaussians",
                   "100", "--device", "cpu", "--force"),
         ("scene", "run"), ("out/tiles/tileset.json", "out/tiles/notes.txt", "out/notes.txt"),
         before=((*PLACE, "-o", "place.json"),)),
    Verb("mesh", ("mesh", "run", "-o", "out/m.glb", "--device", "cpu", "--force"), ("scene", "run"),
         ("out/m.glb", "out/notes.txt")),
    Verb("undistort", ("undistort", "scene", "-o", "flat"), ("scene", "lens"), ("notes.txt",),
         again=("--force",)),
    Verb("view", ("view", "run", "--port", "0", "--no-open", "--stream-from", "1"),
         ("scene", "run"), ("run/notes.txt", "notes.txt"), visit="look"),
    Verb("control", ("train", "scene", "-o", "run", *WATCHED, "--resume", "auto"), ("scene",),
         ("run/notes.txt", "notes.txt"), may_lack=RUN_FILES, visit="control",
         varies=SAVED_BY_A_VISITOR),
    Verb("render", ("render", "run", "-o", "out", "--split", "test"), ("scene", "run"),
         ("out/notes.txt",), again=("--force",)),
    Verb("film", ("render", "run", "-o", "out/film.mp4", "--path", "orbit", "--frames", "3"),
         ("scene", "run"), ("out/notes.txt",), again=("--force",), may_lack=("out/film.",)),
    Verb("experiment", ("experiment", "e.toml"), ("scene",), ("out/notes.txt",)),
    Verb("its runs", ("experiment", "e.toml"), ("scene",), ("out/notes.txt",),
         faults_in_children=True, may_lack=("out/scene/",)),
    Verb("reconstruct", ("reconstruct", "photos", "-o", "rec", "--colmap", "./colmap"), ("photos",),
         ("rec/mapping/notes.txt", "rec/photos.txt"), may_lack=("rec/reconstruct.json",)),
    Verb("photos", ("train", "photos", "-o", "run", "--device", "cpu", "--iterations", "5",
                    "--resume", "auto", "--set", "reconstruct.colmap=./colmap"),
         ("photos",), ("run/notes.txt",), may_lack=RUN_FILES),
]}  # fmt: skip


def write_inputs(verb, folder):
    """All that the user has before the command, except runs that the program makes."""
    folder.mkdir(parents=True)
    for name in ("tmp", "cache"):
        (folder / name).mkdir()
    if "scene" in verb.needs:
        write_photos(folder / "scene/images")
        write_model(folder / "scene/sparse/0", "lens" in verb.needs)
    if "photos" in verb.needs:
        write_photos(folder / "photos")
        write_model(folder / "model")
        (folder / "colmap").write_text(COLMAP)
        (folder / "colmap").chmod(0o755)
    if verb.arguments[0] == "experiment":
        (folder / "e.toml").write_text(EXPERIMENT)


def write_user_files(verb, folder):
    for name in verb.user_files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"{OF_THE_USER}, {name}\n")
