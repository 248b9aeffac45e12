# SPDX-License-Identifier: Apache-2.0
"""Reads .gs4d files by the words of docs/formats/gs4d.md alone, and compares every Gaussian with
the PLY that gemsplat wrote the file from: where it is at several times, its covariance, opacity and
color.

  python3 gs4d_test.py PROGRAM FOLDER      exit code 1 if a value differs by more than its rounding
  python3 gs4d_test.py --make FILE.ply [COUNT LONGEST]     only writes a model that moves
"""

import math
import random
import struct
import subprocess
import sys
from pathlib import Path

SH0 = 0.28209479177387814
COUNT = 700  # three blocks


def columns(degree):
    rest = 3 * ((degree + 1) ** 2 - 1)
    return (["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"] + [f"f_rest_{i}" for i in range(rest)]
            + ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
            + ["right_rot_0", "right_rot_1", "right_rot_2", "right_rot_3", "time_mean", "time_scale"])


def unit(values):
    length = math.sqrt(sum(v * v for v in values))
    return [v / length for v in values]


def make_ply(path, degree, still=False, count=COUNT, longest=0.6):
    """Round and long Gaussians about the origin, which move a little and come and go. `longest` is
    the largest scale in time."""
    rng = random.Random(4 + degree)
    names = columns(degree)[:-6] if still else columns(degree)
    rows = []
    for _ in range(count):
        left = unit([rng.gauss(0, 1) for _ in range(4)])
        # The right factor of a turn of space is (w, x, -y, -z) of this left one's own quaternion; a
        # small tilt makes the Gaussian move.
        w, z, y, x = left[0], left[1], -left[2], left[3]
        right = unit([c + rng.gauss(0, 0.08) for c in (w, z, -y, -x)])
        row = [rng.gauss(0, 0.7) for _ in range(3)]
        row += [rng.uniform(-1.6, 1.6) for _ in range(3)]
        row += [rng.uniform(-0.3, 0.3) for _ in range(3 * ((degree + 1) ** 2 - 1))]
        row += [rng.uniform(-1, 4)] + [math.log(rng.uniform(0.03, 0.2)) for _ in range(3)] + left
        if not still:
            row += right + [rng.uniform(-0.1, 1.1), math.log(rng.uniform(longest / 12, longest))]
        rows.append(row)
    head = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {count}\n"
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    data = b"".join(struct.pack(f"<{len(names)}f", *row) for row in rows)
    Path(path).write_bytes(head.encode() + data)
    # as the file has them: floats
    return [dict(zip(names, struct.unpack(f"<{len(names)}f", struct.pack(f"<{len(names)}f", *row))))
            for row in rows]


def matrix_product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(len(b))) for j in range(len(b[0]))] for i in range(len(a))]


def transposed(a):
    return [list(row) for row in zip(*a)]


def left_matrix(w, x, y, z):
    return [[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]


def right_matrix(w, x, y, z):
    return [[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]]


def turned(R, variances):
    n = len(R)
    return [[sum(R[i][k] * variances[k] * R[j][k] for k in range(n)) for j in range(n)] for i in range(n)]


def moving_of_ply(g):
    """Mean, velocity, conditional covariance and time scale, by docs/method/equations.md."""
    R = matrix_product(left_matrix(*unit([g[f"rot_{i}"] for i in range(4)])),
                       right_matrix(*unit([g[f"right_rot_{i}"] for i in range(4)])))
    S = turned(R, [math.exp(2 * g[name]) for name in ("scale_0", "scale_1", "scale_2", "time_scale")])
    mixed, tt = [S[i][3] for i in range(3)], S[3][3]
    return {"mean": [g["x"], g["y"], g["z"]], "velocity": [m / tt for m in mixed], "time_mean": g["time_mean"],
            "time_scale": math.sqrt(tt), "opacity": 1 / (1 + math.exp(-g["opacity"])),
            "covariance": [[S[i][j] - mixed[i] * mixed[j] / tt for j in range(3)] for i in range(3)]}


def rotation_matrix(w, x, y, z):
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def read_gs4d(path):
    data = Path(path).read_bytes()
    magic, version, count, chunks, degree, flags, zero, duration = struct.unpack_from("<4s3I2BHf", data)
    assert (magic, zero) == (b"GS4D", 0) and version == 1, "header"
    floats = 18
    table = [struct.unpack_from("<2I2f", data, 32 + 16 * c) for c in range(chunks)]
    at, rest = 32 + 16 * chunks, 3 * ((degree + 1) ** 2 - 1)
    gaussians = []
    for n, size, begin, end in table:
        end_of_chunk = at + size
        blocks = [struct.unpack_from(f"<{floats}f", data, at + 4 * floats * b) for b in range((n + 255) // 256)]
        at += 4 * floats * len(blocks)

        def array(code, each):
            nonlocal at
            values = struct.unpack_from(f"<{n * each}{code}", data, at)
            at += struct.calcsize(f"<{n * each}{code}")
            return [values[each * i:each * (i + 1)] for i in range(n)]

        words, places, drifts, times = array("I", 1), array("H", 3), array("h", 3), array("H", 2)
        scales, opacities, colors, sh = array("B", 3), array("B", 1), array("B", 3), array("b", rest)
        assert at == end_of_chunk, "size of a chunk"
        for i in range(n):
            b = blocks[i // 256]
            largest, word, parts = words[i][0] >> 30, words[i][0], []
            for _ in range(3):
                parts.append(((word & 1023) ^ 512) - 512)
                word >>= 10
            parts = [p / (511 * math.sqrt(2)) for p in parts]
            parts.insert(largest, math.sqrt(max(0, 1 - sum(p * p for p in parts))))
            time_scale = math.exp(b[11] + b[12] * times[i][1])
            gaussians.append({
                "mean": [b[k] + b[3 + k] * places[i][k] for k in range(3)],
                "velocity": [b[6 + k] * drifts[i][k] / time_scale for k in range(3)],
                "time_mean": b[9] + b[10] * times[i][0], "time_scale": time_scale,
                "covariance": turned(rotation_matrix(*unit(parts)),
                                     [math.exp(2 * (b[13] + b[14] * s)) for s in scales[i]]),
                "opacity": opacities[i][0] / 255, "sh0": [b[15] + b[16] * c for c in colors[i]],
                "sh": [b[17] * c for c in sh[i]], "begin": begin, "end": end})
    assert at == len(data) and len(gaussians) == count, "size of the file"
    begins = [begin for _, _, begin, _ in table]
    return {"degree": degree, "antialiased": bool(flags & 1), "duration": duration, "gaussians": gaussians, "begins": begins}


def largest_difference(a, b):
    return max(abs(x - y) for x, y in zip(a, b))


def compare(rows, file, degree):
    """The largest difference of each quantity."""
    worst = {}

    def note(name, value):
        worst[name] = max(worst.get(name, 0), value)

    left = list(file["gaussians"])
    for row in rows:
        want = moving_of_ply(row)
        got = min(left, key=lambda g: largest_difference(g["mean"], want["mean"]) + abs(g["time_mean"] - want["time_mean"]))
        left.remove(got)
        reach = math.sqrt(2 * math.log(20))
        for t in (-reach, -1, 0, 1, reach):  # in time scales
            time = want["time_mean"] + t * want["time_scale"]
            place = lambda g: [m + v * (time - g["time_mean"]) for m, v in zip(g["mean"], g["velocity"])]
            note("place", largest_difference(place(got), place(want)))
            factor = lambda g: math.exp(-((time - g["time_mean"]) / g["time_scale"]) ** 2 / 2)
            note("opacity", abs(got["opacity"] * factor(got) - want["opacity"] * factor(want)))
            if 0 <= time <= 1 and abs(t) < 2:
                assert got["begin"] <= time <= got["end"], "a chunk's begin and end"
        size = sum(want["covariance"][k][k] for k in range(3))
        note("covariance", max(largest_difference(x, y) for x, y in zip(got["covariance"], want["covariance"])) / size)
        note("sh0", largest_difference(got["sh0"], [row[f"f_dc_{k}"] for k in range(3)]))
        rest = (degree + 1) ** 2 - 1  # the PLY has all red coefficients first
        if rest:
            note("sh", largest_difference(got["sh"], [row[f"f_rest_{k * rest + c}"] for c in range(rest) for k in range(3)]))
    return worst


# Rounding: half a step of 16 bits in a box of 5 units, at both ends of a life; half a step of 8 bits
# of sizes within e^4, twice; 10 bits of a rotation; half a step of 3.2 / 255 and of 0.3 / 127.
MOST = {"place": 5e-4, "opacity": 0.0025, "covariance": 0.03, "sh0": 0.0065, "sh": 0.0013}


def main():
    if sys.argv[1] == "--make":
        count, longest = sys.argv[3:5] or (COUNT, 0.6)
        make_ply(sys.argv[2], 1, count=int(count), longest=float(longest))
        return 0
    program, folder = sys.argv[1], Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    failed = False
    for degree in range(4):
        ply, out, again = folder / f"model{degree}.ply", folder / f"model{degree}.gs4d", folder / "again.gs4d"
        rows = make_ply(ply, degree)
        run = lambda to: subprocess.run([program, "export", ply, to, "--no-measure", "--force", "-q", "--duration", "2.5"], check=True)
        run(out)
        run(again)
        assert out.read_bytes() == again.read_bytes(), "the same model has other bytes"
        file = read_gs4d(out)
        assert file["degree"] == degree and file["duration"] == 2.5 and not file["antialiased"], "header"
        assert len(file["gaussians"]) == COUNT and file["begins"] == sorted(file["begins"])
        worst = compare(rows, file, degree)
        print(f"SH degree {degree}, {out.stat().st_size / COUNT:.1f} bytes each:", ", ".join(f"{k} {v:.2g}" for k, v in worst.items()))
        failed |= any(value > MOST[name] for name, value in worst.items())
    make_ply(folder / "still.ply", 0, still=True)
    refused = subprocess.run([program, "export", folder / "still.ply", folder / "still.gs4d"], capture_output=True, text=True)
    failed |= refused.returncode == 0 or "choose .spz or .sog" not in refused.stderr or (folder / "still.gs4d").exists()
    print("FAILED" if failed else "all values are those of the PLY")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
