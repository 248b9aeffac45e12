# SPDX-License-Identifier: Apache-2.0
"""One peer on one scene: prepare, train, depth maps, meshes by gemsplat, figures, a line of results.csv.

    run_one.py gggs|rade SCENE [STEPS]

Variables: GEMSPLAT, the program that fuses and measures; PEER_ARGS, more arguments of train.py;
PEER_SETTINGS=views leaves the decoupled appearance of their DTU scripts out; PEER_TAG marks the
results; PEERS (/tmp/peers).
"""
import csv
import fcntl
import json
import os
import shlex
import shutil
import subprocess
import sys
import time

tools = os.path.dirname(os.path.abspath(__file__))
root = os.environ.get("PEERS", "/tmp/peers")
gemsplat = os.environ.get("GEMSPLAT", "")
settings = os.environ.get("PEER_SETTINGS", "object")
THRESHOLDS = (.007, .014)  # of docs/lab/2026-11-meshes.md, in the scene's units
COLUMNS = ["peer", "scene", "tag", "steps", "status", "gaussians", "train_s", "loop_s", "peak_gib",
           "psnr", "ssim", "psnr_fit", "scale", "covered", "depth_s"] + \
          [f"{kind}_{key}" for kind in ("usual", "own") for key in
           ("mesh_s", "voxel", "triangles", "f1_007", "f1_014", "chamfer", "normals", "mesh_psnr",
            "mesh_ssim")]


def called(command, log, seconds, **how):
    """The exit code, and what the command wrote to standard output; its time goes to the log."""
    start = time.time()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=seconds, **how)
        code, text, errors = done.returncode, done.stdout, done.stderr
    except subprocess.TimeoutExpired:
        code, text, errors = 124, "", "timed out"
    with open(log, "w") as file:
        file.write(f"$ {shlex.join(command)}\n{text}\n{errors}\nexit {code} after "
                   f"{time.time() - start:.1f} s\n")
    return code, text, time.time() - start


def json_of(text):
    """The object in the output of a command; empty if it wrote none."""
    try:
        return json.JSONDecoder().raw_decode(text[text.index("{"):])[0]
    except ValueError:
        return {}


def meshed(row, kind, options, scene, work, unit):
    mesh = f"{work}/mesh_{kind}.ply"
    if os.path.exists(mesh):
        os.remove(mesh)
    code, text, seconds = called(
        [gemsplat, "mesh", f"{work}/data/plain", "--depths", f"{work}/depth", "-o", mesh, "--set",
         f"dataset.depth_unit={unit:.12g}", "--json", "--progress", "none", *options],
        f"{work}/mesh_{kind}.log", 240)
    row[f"{kind}_mesh_s"] = seconds
    if code:
        raise RuntimeError(f"mesh {kind}: exit {code}, see {work}/mesh_{kind}.log")
    said = json_of(text)
    row[f"{kind}_triangles"], row[f"{kind}_voxel"] = said.get("triangles"), said.get("voxel")
    if os.path.exists(f"{scene}/truth.ply"):
        code, text, _ = called([gemsplat, "mesh-error", mesh, f"{scene}/truth.ply", "--threshold",
                                *map(str, THRESHOLDS), "--json"], f"{work}/error_{kind}.json", 240)
        error_figures(row, kind, json_of(text))
    if kind == "usual":
        code, text, _ = called([gemsplat, "mesh-error", mesh, "--data", scene, "--json"],
                               f"{work}/pictures_{kind}.json", 240)
        said = json_of(text).get("pictures") or {}
        row[f"{kind}_mesh_psnr"], row[f"{kind}_mesh_ssim"] = said.get("psnr"), said.get("ssim")


def error_figures(row, kind, said):
    row[f"{kind}_chamfer"] = said.get("chamfer")
    row[f"{kind}_normals"] = said.get("normal_consistency")
    for name, found in zip(("f1_007", "f1_014"), said.get("within") or []):
        row[f"{kind}_{name}"] = found.get("f1")


def trained(row, peer, work, steps):
    command = [sys.executable, f"{tools}/runner.py", peer, root, f"{work}/train.json",
               f"{root}/{peer}/train.py", "-s", f"{work}/data/peer", "-m", f"{work}/model", "--eval",
               "-r", "1", "--iterations", str(steps), "--save_iterations", str(steps),
               "--test_iterations", "-1", "--checkpoint_iterations", "-1"]
    if settings == "object":
        command += ["--use_decoupled_appearance"] + (["3"] if peer == "gggs" else [])
    command += shlex.split(os.environ.get("PEER_ARGS", ""))
    print("train:", shlex.join(command), flush=True)
    start = time.time()
    code = subprocess.run(command, cwd=f"{root}/{peer}").returncode
    row["train_s"] = time.time() - start
    said = {}
    if os.path.exists(f"{work}/train.json"):
        with open(f"{work}/train.json") as file:
            said = json.load(file)
    row["loop_s"], row["peak_gib"] = said.get("loop_s"), said.get("peak_allocated_gib")
    if code:
        raise RuntimeError(f"train: exit {code}: {said.get('status')}")


def main():
    peer, name, steps = sys.argv[1], sys.argv[2], int((sys.argv[3:] or ["30000"])[0])
    tag = os.environ.get("PEER_TAG", "")
    short = os.path.basename(name.rstrip("/"))
    work = f"{root}/out/{peer}-{short}{'-' + tag if tag else ''}"
    shutil.rmtree(work, ignore_errors=True)
    os.makedirs(work)
    row = {"peer": peer, "scene": short, "tag": tag, "steps": steps, "status": ""}
    problems = []
    try:
        scene = os.path.abspath(name)
        subprocess.run([sys.executable, f"{tools}/scale_scene.py", scene, f"{work}/data"], check=True)
        with open(f"{work}/data/scale.json") as file:
            row["scale"] = json.load(file)["scale"]
        trained(row, peer, work, steps)
        print(f"trained in {row['train_s']:.1f} s", flush=True)
        subprocess.run([sys.executable, f"{tools}/runner.py", peer, root, f"{work}/export.json",
                        f"{tools}/export_depth.py", "-m", f"{work}/model", "--scale-file",
                        f"{work}/data/scale.json", "--depth-out", f"{work}/depth", "--report",
                        f"{work}/depth.json"], cwd=f"{root}/{peer}", check=True)
        with open(f"{work}/depth.json") as file:
            said = json.load(file)
        for key in ("gaussians", "psnr", "ssim", "psnr_fit", "covered", "depth_s"):
            row[key] = said[key]
        if not gemsplat:
            problems.append("no GEMSPLAT, no mesh")
        for kind, options in (("usual", []), ("own", ["--voxel", f"{.002 / row['scale']:.6g}",
                                                      "--truncation", "8"])):
            try:
                if gemsplat:
                    meshed(row, kind, options, scene, work, said["depth_unit"])
            except Exception as error:
                problems.append(str(error))
    except Exception as error:
        problems.append(f"{type(error).__name__}: {error}")
    row["status"] = " | ".join(problems).replace("\n", " ") or "ok"
    results = f"{root}/out/results.csv"
    with open(results, "a", newline="") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        writer = csv.DictWriter(file, COLUMNS)
        if file.tell() == 0:
            writer.writeheader()
        writer.writerow({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()})
    print("RESULT", json.dumps(row), flush=True)
    sys.exit(0 if row["status"] == "ok" else 1)


main()
