# SPDX-License-Identifier: Apache-2.0
"""Times HiGS, the experimental renderer of gsplat, on the model of one of our runs.

    python3 time_higs.py RUN -o higs.json [--scales 1 2 3] [--frames 9] [--compression none]
        [--tile-size 8] [--pictures FOLDER]
    gemsplat bench RUN --scales 1,2,3 --frames 9 --against higs.json

RUN is a run of gemsplat with held-out photos (--eval). HiGS draws the same views of the same PLY.
The report has the form of `gemsplat bench -o`, so that `--against` prints both in one table. Frames
are timed as there: by the host's clock around each frame, with a wait for the device at its end;
the median of a view's frames, and the mean over the views. `events` in the report is the same by
CUDA events, and `back_to_back` is the time of a frame where none waits for the one before it.

With --pictures the pictures of `gemsplat render RUN --split test -o FOLDER` are compared with those
of HiGS, which says that both draw the same thing. PNGs of 8 bits bound this PSNR to 59 dB.

Needs PyTorch with CUDA, and gsplat 1.6 or newer (https://github.com/nerfstudio-project/gsplat); it
compiles the renderer when it is first used. NumPy, and Pillow for --pictures.
"""

import argparse
import json
import pathlib
import statistics
import sys
import time

import numpy
import torch
from gsplat.experimental import GaussianInferenceRenderer, GaussianInferenceScene


def read_model(ply):
    """The Gaussians of a 3DGS PLY: each property as a column of floats."""
    with open(ply, "rb") as file:
        head = b""
        while not head.endswith(b"end_header\n"):
            head += file.readline()
        lines = head.decode().splitlines()
        count = int(next(l.split()[2] for l in lines if l.startswith("element vertex")))
        names = [l.split()[2] for l in lines if l.startswith("property float")]
        rows = numpy.fromfile(file, numpy.float32, count * len(names)).reshape(count, len(names))
    return {name: torch.from_numpy(rows[:, k].copy()).cuda() for k, name in enumerate(names)}


def packed_scene(columns, compression):
    def stack(*names):
        return torch.stack([columns[name] for name in names], dim=1)

    sh = [stack("f_dc_0", "f_dc_1", "f_dc_2")[:, None]]
    rest = sum(name.startswith("f_rest_") for name in columns)
    if rest:  # channel after channel
        by_channel = stack(*(f"f_rest_{k}" for k in range(rest))).reshape(-1, 3, rest // 3)
        sh.append(by_channel.transpose(1, 2))
    colors = torch.cat(sh, dim=1).contiguous()
    quaternions = torch.nn.functional.normalize(stack("rot_0", "rot_1", "rot_2", "rot_3"), dim=1)
    return GaussianInferenceScene.from_gaussian_tensors(
        stack("x", "y", "z"), quaternions, stack("scale_0", "scale_1", "scale_2").exp(),
        columns["opacity"].sigmoid(), colors, int(colors.shape[1] ** 0.5) - 1, compression,
        id="model")


def held_out_cameras(run):
    """(name, world to camera (4, 4), fx, fy, cx, cy, width, height) of each held-out photo."""
    names = json.loads((run / "split.json").read_text())["test"]
    stems = {name.rsplit(".", 1)[0] for name in names}
    cameras = []
    for camera in json.loads((run / "cameras.json").read_text()):
        if camera["img_name"] not in stems:
            continue
        world_from_camera = numpy.eye(4)
        world_from_camera[:3, :3] = camera["rotation"]
        world_from_camera[:3, 3] = camera["position"]
        matrix = torch.tensor(numpy.linalg.inv(world_from_camera), dtype=torch.float32).cuda()
        cameras.append((camera["img_name"], matrix.contiguous(), camera["fx"], camera["fy"],
                        camera["cx"], camera["cy"], camera["width"], camera["height"]))
    return cameras


def seconds_of(draw):
    """(by the host's clock, by events) of one frame on an idle device."""
    first, last = (torch.cuda.Event(enable_timing=True) for _ in range(2))
    torch.cuda.synchronize()
    begin = time.perf_counter()
    first.record()
    draw()
    last.record()
    torch.cuda.synchronize()
    return time.perf_counter() - begin, first.elapsed_time(last) / 1000


def seconds_back_to_back(draw, frames):
    begin = time.perf_counter()
    for _ in range(frames):
        draw()
    torch.cuda.synchronize()
    return (time.perf_counter() - begin) / frames


def psnr_of(picture, png):
    """Of a picture (H, W, 3) against a PNG of 8 bits."""
    from PIL import Image
    ours = numpy.asarray(Image.open(png).convert("RGB")) / 255.0
    theirs = picture.float().clamp(0, 1).cpu().numpy()
    return -10 * numpy.log10(numpy.mean((ours - theirs) ** 2))


def time_view(renderer, camera, scale, options):
    """The figures of one view, by the names that they have in the report, in milliseconds and dB."""
    name, matrix, fx, fy, cx, cy, width, height = camera
    K = torch.tensor([[fx * scale, 0, cx * scale], [0, fy * scale, cy * scale], [0, 0, 1]],
                     dtype=torch.float32).cuda()

    def draw():
        return renderer.render(viewmat=matrix, K=K, width=round(width * scale),
                               height=round(height * scale), near_plane=0.2, far_plane=1e4)

    for _ in range(3):
        picture = draw().frame[0, ..., :3]
    figures = {}
    if options.pictures and scale == 1:
        figures["psnr"] = psnr_of(picture, options.pictures / f"{name}.png")
    host, events = zip(*(seconds_of(draw) for _ in range(options.frames)))
    figures["ms_per_frame"] = 1000 * statistics.median(host)
    figures["events"] = 1000 * statistics.median(events)
    figures["back_to_back"] = 1000 * seconds_back_to_back(draw, options.frames)
    return figures


def time_scale(renderer, cameras, scale, options):
    """The same as means over the views, with what they are of."""
    views = [time_view(renderer, camera, scale, options) for camera in cameras]
    width, height = cameras[-1][-2:]
    return {"width": round(width * scale), "height": round(height * scale), "views": len(views),
            "frames": options.frames,
            **{figure: statistics.mean(view[figure] for view in views) for figure in views[0]}}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("run", type=pathlib.Path)
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--scales", type=float, nargs="+", default=[1, 2, 3])
    parser.add_argument("--frames", type=int, default=9)
    parser.add_argument("--compression", choices=["none", "32b", "16b"], default="none")
    parser.add_argument("--tile-size", type=int, choices=[8, 16], default=8)
    parser.add_argument("--pictures", type=pathlib.Path)
    options = parser.parse_args()

    plys = sorted(options.run.glob("point_cloud/iteration_*/point_cloud.ply"),
                  key=lambda ply: int(ply.parent.name.split("_")[1]))
    if not plys:
        sys.exit(f"error: {options.run} has no point_cloud/iteration_N/point_cloud.ply; name the "
                 "folder of a run of `gemsplat train`")
    cameras = held_out_cameras(options.run)
    if not cameras:
        sys.exit(f"error: {options.run} holds no photos out; train with --eval")
    columns = read_model(plys[-1])
    scene = packed_scene(columns, options.compression)
    report = {
        "program": f"HiGS ({options.compression}, tiles of {options.tile_size})",
        "device": torch.cuda.get_device_name(), "model": str(plys[-1]),
        "num_gaussians": len(columns["x"]), "sh_degree": scene.sh_degree,
        "protocol": {"frame": "the host's clock around one call of "
                     "GaussianInferenceRenderer.render, with the wait for the device at the end of "
                     "each frame; the median of a view's frames, the mean over the views; the "
                     "scene lies packed in memory; the picture is RGBT in fp16"},
        "render": []}
    with torch.inference_mode(), GaussianInferenceRenderer(
            scene, tile_size=options.tile_size) as renderer:
        for scale in options.scales:
            report["render"].append(time_scale(renderer, cameras, scale, options))
            print(json.dumps(report["render"][-1]))
    options.output.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
