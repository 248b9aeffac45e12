# SPDX-License-Identifier: Apache-2.0
"""What the peers use of the package plyfile: elements without lists, read and written in binary."""
import numpy as np

_TYPES = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
          "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
          "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
_NAMES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint",
          "f4": "float", "f8": "double"}


class PlyProperty:
    def __init__(self, name, kind):
        self.name, self.val_dtype = name, kind


class PlyElement:
    def __init__(self, name, data):
        self.name, self.data = name, data

    @staticmethod
    def describe(data, name, *_, **__):
        return PlyElement(name, np.asarray(data))

    @property
    def properties(self):
        return tuple(PlyProperty(n, self.data.dtype[n].str[1:]) for n in self.data.dtype.names)

    @property
    def count(self):
        return len(self.data)

    def __getitem__(self, key):
        return self.data[key]

    def __len__(self):
        return len(self.data)


class PlyData:
    def __init__(self, elements=(), text=False, byte_order="<", comments=(), obj_info=()):
        self.elements = list(elements)

    def __getitem__(self, name):
        for element in self.elements:
            if element.name == name:
                return element
        raise KeyError(name)

    def __contains__(self, name):
        return any(element.name == name for element in self.elements)

    @staticmethod
    def read(path):
        with (open(path, "rb") if isinstance(path, str) else path) as file:
            if file.readline().strip() != b"ply":
                raise ValueError(f"{path} is no PLY file")
            order, header = "<", []
            while True:
                words = file.readline().decode("ascii").split()
                if not words:
                    raise ValueError(f"{path} ends in its header")
                if words[0] == "end_header":
                    break
                if words[0] == "format":
                    if words[1] == "ascii":
                        raise ValueError(f"{path} is in ASCII")
                    order = "<" if words[1] == "binary_little_endian" else ">"
                elif words[0] == "element":
                    header.append((words[1], int(words[2]), []))
                elif words[0] == "property":
                    if words[1] == "list":
                        raise ValueError(f"{path} has lists")
                    header[-1][2].append((words[2], order + _TYPES[words[1]]))
            return PlyData([PlyElement(name, np.frombuffer(
                file.read(np.dtype(fields).itemsize * count), np.dtype(fields)).copy())
                for name, count, fields in header])

    def write(self, path):
        with (open(path, "wb") if isinstance(path, str) else path) as file:
            file.write(b"ply\nformat binary_little_endian 1.0\n")
            for e in self.elements:
                file.write(f"element {e.name} {len(e.data)}\n".encode())
                for p in e.properties:
                    file.write(f"property {_NAMES[p.val_dtype]} {p.name}\n".encode())
            file.write(b"end_header\n")
            for e in self.elements:
                little = np.dtype([(n, "<" + e.data.dtype[n].str[1:]) for n in e.data.dtype.names])
                file.write(np.ascontiguousarray(e.data.astype(little)).tobytes())
