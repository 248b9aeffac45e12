#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes wheels, one for each Python: the module gemsplat, and the program with its pages and the bundled scene.

    wheel.py --module FOLDER --program FOLDER --version V OUT

FOLDER/gemsplat is the package, with a compiled part for each Python; the program's folder has bin/ and
share/, as `cmake --install` writes them. Prints the wheels' paths. The name of a file says which C
library the wheel needs; time stamps are those of SOURCE_DATE_EPOCH, so that the same files give the same bytes.
"""
import argparse
import base64
import hashlib
import os
import platform
import re
import subprocess
import sys
import time
import zipfile
from pathlib import Path

METADATA = """Metadata-Version: 2.1
Name: gemsplat
Version: {version}
Summary: Trains 3D Gaussians from photos
License: Apache-2.0
Requires-Python: =={python}.*
Requires-Dist: numpy (>=1.22)
Provides-Extra: torch
Requires-Dist: torch (>=2.4) ; extra == 'torch'
Provides-Extra: jax
Requires-Dist: jax (>=0.11.2) ; extra == 'jax'
Provides-Extra: cupy
Requires-Dist: cupy-cuda12x (>=13) ; extra == 'cupy'
"""


def compiled_parts(module):
    parts = sorted((module / "gemsplat").glob("_gemsplat*.so"))
    if not parts:
        sys.exit(f"error: {module}/gemsplat has no compiled part; build the target gs_python")
    return parts


def python_version(part):
    """3.11 from _gemsplat.cpython-311-x86_64-linux-gnu.so"""
    found = re.search(r"cpython-3(\d+)-", part.name)
    if not found:
        sys.exit(f"error: the name of {part} does not say for which Python it is")
    return 3, int(found.group(1))


def oldest_glibc(files):
    """The oldest version of the C library that has all symbols, such as (2, 35)."""
    versions = {(2, 17)}  # the first that manylinux names by number
    for file in files:
        text = subprocess.run(["readelf", "-VW", file], capture_output=True, text=True, check=True).stdout
        versions |= {(int(a), int(b)) for a, b in re.findall(r"GLIBC_(\d+)\.(\d+)", text)}
    return max(versions)


def entries(module, part, program, version):
    """Pairs of a path in the wheel and a file."""
    others = set(compiled_parts(module)) - {part}
    found = [(file.relative_to(module).as_posix(), file) for file in (module / "gemsplat").rglob("*")
             if file.is_file() and file not in others and "__pycache__" not in file.parts]
    data = f"gemsplat-{version}.data"
    for file in program.rglob("*"):
        name = file.relative_to(program).as_posix()
        if not file.is_file():
            continue
        if name.startswith("bin/"):
            found.append((f"{data}/scripts/{name[4:]}", file))
        elif name.startswith("share/doc/"):
            found.append((f"gemsplat-{version}.dist-info/licenses/{file.name}", file))
        else:
            found.append((f"{data}/data/{name}", file))
    return found


def digest(data):
    return "sha256=" + base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


def write_wheel(path, contents, seconds):
    """`contents`: name -> (bytes, is executable); the last one is RECORD."""
    moment = time.gmtime(max(seconds, 315532800))[:6]  # a zip file begins in 1980
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, (data, is_executable) in contents.items():
            entry = zipfile.ZipInfo(name, moment)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # permissions of Unix follow
            entry.external_attr = (0o100755 if is_executable else 0o100644) << 16
            archive.writestr(entry, data)


def make_wheel(arguments, part):
    """The path of the wheel for the Python of a compiled part."""
    python = python_version(part)
    interpreter = f"cp{python[0]}{python[1]}"
    glibc = oldest_glibc([part, arguments.program / "bin" / "gemsplat"])
    tag = f"{interpreter}-{interpreter}-manylinux_{glibc[0]}_{glibc[1]}_{platform.machine()}"

    contents = {name: (file.read_bytes(), os.access(file, os.X_OK) and file.suffix != ".so")
                for name, file in sorted(entries(arguments.module, part, arguments.program, arguments.version))}
    info = f"gemsplat-{arguments.version}.dist-info"
    metadata = METADATA.format(version=arguments.version, python=f"{python[0]}.{python[1]}")
    wheel = f"Wheel-Version: 1.0\nGenerator: gemsplat\nRoot-Is-Purelib: false\nTag: {tag}\n"
    contents[f"{info}/METADATA"] = (metadata.encode(), False)
    contents[f"{info}/WHEEL"] = (wheel.encode(), False)
    lines = [f"{name},{digest(data)},{len(data)}" for name, (data, _) in contents.items()]
    contents[f"{info}/RECORD"] = ("\n".join([*lines, f"{info}/RECORD,,"]).encode() + b"\n", False)

    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / f"gemsplat-{arguments.version}-{tag}.whl"
    write_wheel(path, contents, int(os.environ.get("SOURCE_DATE_EPOCH") or time.time()))
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("--module", "--program"):
        parser.add_argument(name, type=Path, required=True)
    parser.add_argument("--version", required=True)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()

    if not (arguments.program / "bin" / "gemsplat").is_file():
        sys.exit(f"error: {arguments.program}/bin/gemsplat was not found; build the target gemsplat and install it there")
    for part in compiled_parts(arguments.module):
        print(make_wheel(arguments, part))


if __name__ == "__main__":
    main()
