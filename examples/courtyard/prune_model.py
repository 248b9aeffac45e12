#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# SPDX-FileCopyrightText: The gemsplat authors
"""Copy a binary COLMAP model without the 2D keypoints that have no 3D point.

    prune_model.py IN_FOLDER OUT_FOLDER

A point's track names its observations by their place in an image's keypoint list, so those
indices are rewritten; poses, points, colors and errors are copied bit for bit.
"""
import os
import shutil
import struct
import sys

NO_POINT = 2 ** 64 - 1


class Reader:
    def __init__(self, path):
        with open(path, "rb") as file:
            self.data = file.read()
        self.pos = 0

    def bytes(self, count):
        self.pos += count
        if self.pos > len(self.data):
            raise ValueError("truncated model file")
        return self.data[self.pos - count:self.pos]

    def unpack(self, layout):
        return struct.unpack("<" + layout, self.bytes(struct.calcsize("<" + layout)))

    def c_string(self):
        end = self.data.index(b"\0", self.pos) + 1
        return self.bytes(end - self.pos)


def prune_images(source, target):
    """Write the shorter images file; return {(image, old keypoint index): new index}."""
    reader, place = Reader(source), {}
    (count,) = reader.unpack("Q")
    with open(target, "wb") as out:
        out.write(struct.pack("<Q", count))
        for _ in range(count):
            head = reader.bytes(4 + 7 * 8 + 4)           # id, quaternion, translation, camera
            (image,) = struct.unpack_from("<I", head)
            name = reader.c_string()
            (points,) = reader.unpack("Q")
            kept = []
            for index in range(points):
                record = reader.bytes(24)                # x, y, 3D point
                if struct.unpack_from("<Q", record, 16)[0] != NO_POINT:
                    place[image, index] = len(kept)
                    kept.append(record)
            out.write(head + name + struct.pack("<Q", len(kept)) + b"".join(kept))
    return place


def rewrite_tracks(source, target, place):
    reader = Reader(source)
    (count,) = reader.unpack("Q")
    with open(target, "wb") as out:
        out.write(struct.pack("<Q", count))
        for _ in range(count):
            out.write(reader.bytes(8 + 3 * 8 + 3 + 8))   # id, position, color, error
            (length,) = reader.unpack("Q")
            out.write(struct.pack("<Q", length))
            for _ in range(length):
                image, index = reader.unpack("II")
                out.write(struct.pack("<II", image, place[image, index]))


def main():
    source, target = sys.argv[1:3]
    os.makedirs(target, exist_ok=True)
    shutil.copyfile(os.path.join(source, "cameras.bin"), os.path.join(target, "cameras.bin"))
    place = prune_images(os.path.join(source, "images.bin"), os.path.join(target, "images.bin"))
    rewrite_tracks(os.path.join(source, "points3D.bin"), os.path.join(target, "points3D.bin"), place)


if __name__ == "__main__":
    main()
