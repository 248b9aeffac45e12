# SPDX-License-Identifier: Apache-2.0
"""Trains Faster-GS on a scene under the conditions of our own runs, so that both can be compared.

    bash PEER/build.sh
    python3 train_faster_gs.py SCENE -o OUT --peer PEER [--iterations 30000] [--seed 1]
        [--eval-every 8]
    gemsplat eval OUT/point_cloud.ply --data SCENE

SCENE holds images/ and a binary COLMAP model of PINHOLE cameras, or transforms_train.json and
transforms_test.json with PNGs, as NeRF-synthetic has them. Of a COLMAP scene every 8th photo by
name is held out, and its points are the first Gaussians. Of the other kind the test views are held
out, transparent photos lie on black, and the first Gaussians are random in a box.

PEER holds FasterGSCudaBackend and fused-ssim, built. They draw, differentiate and step (Adam). The
loop around them and the density control are written here by what the peer's default configuration
says (github.com/nerficg-project/faster-gaussian-splatting, 3cb0b75), without the waiting for the
device in each step that its framework adds. Whatever happens before and after the loop is not
timed. The schedule is that of 30,000 steps, whatever --iterations says.

OUT/point_cloud.ply has the layout of 3DGS. OUT/results.json has the seconds, the count of Gaussians
and, as a cross-check, PSNR and SSIM of the held-out photos by the peer's own renderer. One GPU is
used; CUDA_VISIBLE_DEVICES chooses it. Needs PyTorch with CUDA, NumPy and Pillow.
"""

import argparse
import concurrent.futures
import dataclasses
import json
import math
import pathlib
import statistics
import struct
import sys
import time
import types
import warnings

import numpy
import torch
from PIL import Image


SH_DEGREE = 3
SH_STEPS = range(1000, 1000 * SH_DEGREE + 1, 1000)
DENSITY_STEPS = range(600, 14901, 100)
OPACITY_RESETS = range(3000, 14901, 3000)
MORTON_STEPS = range(0, 15001, 5000)
LARGE_GO_AFTER = 3000  # steps; only then are large Gaussians removed
GRADIENT_THRESHOLD = 2e-4
SMALL_SCALE, LARGE_SCALE = 0.01, 0.1  # of the extent of the cameras
CHILD_SHRINKS = 1.6
LEAST_OPACITY, LAST_LEAST_OPACITY, RESET_OPACITY, FIRST_OPACITY = 0.005, 1 / 255, 0.01, 0.1
LEAST_SQUARED_NORM = 1e-8  # of a quaternion
POSITION_RATES, POSITION_RATE_STEPS = (1.6e-4, 1.6e-6), 30000  # times the extent
RATES = {"means": POSITION_RATES[0], "sh0": 2.5e-3, "sh_rest": 1.25e-4, "opacities": 0.025,
         "scales": 5e-3, "rotations": 1e-3}
SSIM_SHARE = 0.2
NEAR, FAR = 0.2, 1e4
RANDOM_POINTS, RANDOM_BOX = 100_000, 1.3
SH0 = 0.28209479177387814  # the constant basis function


# --- Scenes

@dataclasses.dataclass
class View:
    name: str
    photo: pathlib.Path
    camera_from_world: numpy.ndarray  # (4, 4), with x to the right, y down and z forward
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def center(self):
        rotation, translation = self.camera_from_world[:3, :3], self.camera_from_world[:3, 3]
        return -rotation.T @ translation

    def resized(self, width, height):
        x, y = width / self.width, height / self.height
        return dataclasses.replace(self, fx=self.fx * x, fy=self.fy * y, cx=self.cx * x,
                                   cy=self.cy * y, width=width, height=height)


@dataclasses.dataclass
class Scene:
    train: list
    test: list
    points: numpy.ndarray  # (N, 3)
    colors: numpy.ndarray  # (N, 3), in [0, 1]

    def extent(self):
        """1.1 times the distance from the mean of the training cameras to the farthest of them."""
        centers = numpy.array([view.center() for view in self.train])
        return 1.1 * float(numpy.linalg.norm(centers - centers.mean(axis=0), axis=1).max())


def rotation_of(w, x, y, z):
    w, x, y, z = numpy.array([w, x, y, z]) / math.hypot(w, x, y, z)
    return numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


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


def read_cameras(path):
    """(fx, fy, cx, cy, width, height) of each camera by its number."""
    file = Bytes(path)
    cameras = {}
    for _ in range(file.take("Q")[0]):
        number, model, width, height = file.take("IiQQ")
        if model not in (0, 1):
            sys.exit(f"error: camera {number} of {path} is no pinhole; run `gemsplat undistort` on "
                     "the scene first")
        *focals, cx, cy = file.take("3d" if model == 0 else "4d")
        cameras[number] = (focals[0], focals[-1], cx, cy, width, height)
    return cameras


def read_views(model, photos):
    """All views of a COLMAP model, sorted by name."""
    cameras = read_cameras(model / "cameras.bin")
    file = Bytes(model / "images.bin")
    views = []
    for _ in range(file.take("Q")[0]):
        pose = file.take("I7d")[1:]
        camera = file.take("I")[0]
        name = file.text()
        observations, = file.take("Q")
        file.at += 24 * observations
        matrix = numpy.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation_of(*pose[:4]), pose[4:]
        views.append(View(name, photos / name, matrix, *cameras[camera]))
    return sorted(views, key=lambda view: view.name)


def read_points(path):
    """Positions, and colors in [0, 1]."""
    file = Bytes(path)
    count = file.take("Q")[0]
    points, colors = numpy.empty((count, 3)), numpy.empty((count, 3))
    for k in range(count):
        _, x, y, z, red, green, blue, _, observations = file.take("Q3d3BdQ")
        file.at += 8 * observations
        points[k], colors[k] = (x, y, z), (red, green, blue)
    return points, colors / 255


def read_colmap_scene(folder, eval_every):
    models = [folder / part for part in ("sparse/0", "sparse", ".")]
    model = next((m for m in models if (m / "images.bin").exists()), None)
    if model is None:
        sys.exit(f"error: {folder} has neither sparse/0/images.bin nor transforms_train.json; name "
                 "a scene with a binary COLMAP model or a NeRF-synthetic scene")
    views = read_views(model, folder / "images")
    test = views[::eval_every] if eval_every else []
    train = [view for k, view in enumerate(views) if not eval_every or k % eval_every]
    return Scene(train, test, *read_points(model / "points3D.bin"))


def read_transforms(path):
    """The views of a transforms file of one camera, whose poses have y up and z backward."""
    data = json.loads(path.read_text())
    views = []
    for frame in data["frames"]:
        photo = path.parent / frame["file_path"]
        if not photo.suffix:
            photo = photo.with_suffix(".png")
        with Image.open(photo) as picture:
            width, height = picture.size
        focal = width / 2 / math.tan(data["camera_angle_x"] / 2)
        world_from_camera = numpy.array(frame["transform_matrix"]) @ numpy.diag([1, -1, -1, 1])
        views.append(View(photo.name, photo, numpy.linalg.inv(world_from_camera), focal, focal,
                          width / 2, height / 2, width, height))
    return views


def is_seen(view, points):
    """For each point whether it lies before the camera and inside the picture."""
    rotation, translation = view.camera_from_world[:3, :3], view.camera_from_world[:3, 3]
    x, y, z = (points @ rotation.T + translation).T
    depth = numpy.maximum(z, 1e-8)
    column, row = view.fx * x / depth + view.cx, view.fy * y / depth + view.cy
    return ((z > NEAR) & (z < FAR) & (column >= 0) & (column < view.width)
            & (row >= 0) & (row < view.height))


def read_synthetic_scene(folder, seed):
    train = read_transforms(folder / "transforms_train.json")
    test = read_transforms(folder / "transforms_test.json")
    draws = numpy.random.default_rng(seed)
    points = draws.uniform(-RANDOM_BOX, RANDOM_BOX, (RANDOM_POINTS, 3))
    points = points[numpy.any([is_seen(view, points) for view in train], axis=0)]
    return Scene(train, test, points, numpy.full_like(points, 0.5))


def read_scene(folder, eval_every, seed):
    if (folder / "transforms_train.json").exists():
        return read_synthetic_scene(folder, seed)
    return read_colmap_scene(folder, eval_every)


def read_photo(view):
    """Bytes (height, width, 3), or 4 channels if the photo has transparency."""
    with Image.open(view.photo) as picture:
        has_alpha = "A" in picture.getbands() or "transparency" in picture.info
        return numpy.array(picture.convert("RGBA" if has_alpha else "RGB"))


def picture_of(photo, device):
    """A photo over black as floats (3, height, width)."""
    picture = torch.from_numpy(photo).to(device).permute(2, 0, 1).contiguous().float() / 255
    return picture if len(picture) == 3 else picture[:3] * picture[3:]


# --- Gaussians

def mean_squared_distances(points, neighbors=3):
    """From each point (N, 3) to its nearest others."""
    rows = max(1, (1 << 28) // len(points))
    parts = []
    for part in points.split(rows):
        # Squares are exact only where they are not taken apart into a matrix product.
        distances = torch.cdist(part, points, compute_mode="donot_use_mm_for_euclid_dist")
        nearest = distances.topk(neighbors + 1, dim=1, largest=False, sorted=True).values
        parts.append(nearest[:, 1:].square().mean(dim=1))
    return torch.cat(parts)


def spread_bits(numbers):
    """Puts two zeros before each of the lower 21 bits."""
    for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
                        (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):
        numbers = (numbers | numbers << shift) & mask
    return numbers


def morton_codes(points):
    """Of points (N, 3) in the smallest cube from their lower corner."""
    lower, upper = points.amin(dim=0), points.amax(dim=0)
    cells = ((points - lower) / (upper - lower).amax()).clamp(0, 1) * (2 ** 21 - 1)
    x, y, z = spread_bits(cells.long()).unbind(dim=1)
    return x | y << 1 | z << 2


def rotated(quaternions, vectors):
    unit = torch.nn.functional.normalize(quaternions)
    real, imaginary = unit[:, :1], unit[:, 1:]
    twist = 2 * torch.cross(imaginary, vectors, dim=1)
    return vectors + real * twist + torch.cross(imaginary, twist, dim=1)


def logit(share):
    return math.log(share / (1 - share))


def position_rate(step, extent):
    """Goes from the first to the last rate along a straight line of logarithms."""
    done = min(step / POSITION_RATE_STEPS, 1)
    first, last = POSITION_RATES
    return extent * math.exp((1 - done) * math.log(first) + done * math.log(last))


class Gaussians:
    """Parameters as the peer's rasterizer takes them, with one optimizer group for each.

    `growth` holds, for each Gaussian, in how many steps it was seen and the sum of the norms of its
    gradients in the picture. The rasterizer adds to it; it is None when no more are to be added.
    """

    def __init__(self, scene, make_optimizer, device):
        points = torch.tensor(scene.points, dtype=torch.float32, device=device)
        colors = torch.tensor(scene.colors, dtype=torch.float32, device=device)
        count = len(points)
        self.extent = scene.extent()
        self.sh_degree = 0
        rotations = torch.zeros(count, 4, device=device)
        rotations[:, 0] = 1
        scales = mean_squared_distances(points).clamp_min(1e-7).sqrt().log()
        rest = (SH_DEGREE + 1) ** 2 - 1
        self.tensors = {
            "means": points, "sh0": ((colors - 0.5) / SH0)[:, None],
            "sh_rest": torch.zeros(count, rest, 3, device=device),
            "opacities": torch.full((count, 1), logit(FIRST_OPACITY), device=device),
            "scales": scales[:, None].repeat(1, 3), "rotations": rotations}
        self.tensors = {name: torch.nn.Parameter(tensor.contiguous())
                        for name, tensor in self.tensors.items()}
        self.optimizer = make_optimizer([{"params": [tensor], "lr": RATES[name], "name": name}
                                         for name, tensor in self.tensors.items()])
        self.clear_growth()

    def __len__(self):
        return len(self.tensors["means"])

    def clear_growth(self):
        means = self.tensors["means"]
        self.growth = torch.zeros(2, len(means), device=means.device)

    def set_position_rate(self, rate):
        for group in self.optimizer.param_groups:
            if group["name"] == "means":
                group["lr"] = rate

    def rebuild(self, rebuilt):
        """Makes each tensor, and each of its moments, rebuilt(name, tensor, is_moment)."""
        for group in self.optimizer.param_groups:
            name, old = group["name"], group["params"][0]
            new = torch.nn.Parameter(rebuilt(name, old.detach(), False))
            state = self.optimizer.state.pop(old, {})
            for moment in ("exp_avg", "exp_avg_sq"):
                if moment in state:
                    state[moment] = rebuilt(name, state[moment], True)
            if state:
                self.optimizer.state[new] = state
            group["params"][0] = self.tensors[name] = new

    def select(self, which):
        """Keeps those of a mask, or brings all into the order of indices."""
        self.rebuild(lambda name, tensor, is_moment: tensor[which])
        if self.growth is not None:
            self.growth = self.growth[:, which].contiguous()

    def sort(self):
        self.select(morton_codes(self.tensors["means"].detach()).argsort())

    def densify(self, large_go):
        """Doubles small Gaussians that are pulled much, splits large ones, and removes others."""
        visible, pulled = self.growth
        scales = self.tensors["scales"].amax(dim=1)
        grows = pulled >= GRADIENT_THRESHOLD * visible.clamp_min(1)
        small = scales <= math.log(SMALL_SCALE * self.extent)
        twins, parents = grows & small, grows & ~small
        added = {name: torch.cat([tensor[twins], tensor[parents], tensor[parents]])
                 for name, tensor in self.tensors.items()}
        children = slice(int(twins.sum()), None)
        sigmas = added["scales"][children].exp()
        added["means"][children] += rotated(added["rotations"][children],
                                            sigmas * torch.randn_like(sigmas))
        added["scales"][children] -= math.log(CHILD_SHRINKS)

        def extended(name, tensor, is_moment):
            return torch.cat([tensor, torch.zeros_like(added[name]) if is_moment else added[name]])

        self.growth = None
        self.rebuild(extended)
        goes = self.useless(LEAST_OPACITY)
        goes[:len(parents)] |= parents
        if large_go:
            goes |= self.tensors["scales"].amax(dim=1) > math.log(LARGE_SCALE * self.extent)
        self.select(~goes)

    def useless(self, least_opacity):
        faint = self.tensors["opacities"].flatten() < logit(least_opacity)
        return faint | (self.tensors["rotations"].square().sum(dim=1) < LEAST_SQUARED_NORM)

    def reset_opacities(self):
        opacities = self.tensors["opacities"]
        opacities.clamp_(max=logit(RESET_OPACITY))
        state = self.optimizer.state.get(opacities, {})
        for moment in ("exp_avg", "exp_avg_sq"):
            if moment in state:
                state[moment].zero_()

    def finish(self):
        self.growth = None
        self.select(~self.useless(LAST_LEAST_OPACITY))
        self.sort()


@torch.no_grad()
def prepare(gaussians, step):
    """What the schedule asks for before a step; says whether Gaussians were added and removed."""
    if step in SH_STEPS:
        gaussians.sh_degree += 1
    if step in DENSITY_STEPS:
        gaussians.densify(large_go=step > LARGE_GO_AFTER)
        if step < DENSITY_STEPS[-1]:
            gaussians.clear_growth()
    if step in MORTON_STEPS:
        gaussians.sort()
    if step in OPACITY_RESETS:
        gaussians.reset_opacities()
    gaussians.set_position_rate(position_rate(step + 1, gaussians.extent))
    return step in DENSITY_STEPS


def write_ply(path, tensors):
    """In the layout of 3DGS: raw values, and the SH coefficients channel after channel."""
    columns = {name: tensor.detach().cpu().numpy() for name, tensor in tensors.items()}
    means, rest = columns["means"], columns["sh_rest"]
    rows = numpy.concatenate(
        [means, numpy.zeros_like(means), columns["sh0"][:, 0],
         rest.transpose(0, 2, 1).reshape(len(rest), -1),
         columns["opacities"], columns["scales"], columns["rotations"]], axis=1)
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{k}" for k in range(3 * rest.shape[1])]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    head += [f"property float {name}" for name in names] + ["end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(head).encode())
        file.write(rows.astype("<f4").tobytes())


# --- The peer

def import_peer(folder):
    for part in ("FasterGSCudaBackend", "fused-ssim"):
        sys.path.insert(0, str(folder.resolve() / part))
    try:
        from FasterGSCudaBackend import torch_bindings
        from fused_ssim import fused_ssim
    except ImportError as problem:
        sys.exit(f"error: {folder} cannot be imported ({problem}); run `bash {folder}/build.sh`")
    return types.SimpleNamespace(
        settings=torch_bindings.RasterizerSettings, adam=torch_bindings.FusedAdam,
        draw=torch_bindings.diff_rasterize, draw_only=torch_bindings.rasterize, ssim=fused_ssim)


def settings_of(peer, view, device):
    """All that the rasterizer wants to know of a view; the SH bases are named at each step."""
    def row(values):
        return torch.tensor(values, dtype=torch.float32, device=device)

    return peer.settings(
        w2c=row(view.camera_from_world), cam_position=row(view.center()), bg_color=row([0.0] * 3),
        active_sh_bases=1, width=view.width, height=view.height, focal_x=view.fx, focal_y=view.fy,
        center_x=view.cx, center_y=view.cy, near_plane=NEAR, far_plane=FAR,
        proper_antialiasing=False)


def arguments_of(gaussians, settings):
    """The keywords that both of the peer's rasterizers take."""
    tensors, bases = gaussians.tensors, (gaussians.sh_degree + 1) ** 2
    return {"means": tensors["means"], "scales": tensors["scales"],
            "rotations": tensors["rotations"], "opacities": tensors["opacities"],
            "sh_coefficients_0": tensors["sh0"], "sh_coefficients_rest": tensors["sh_rest"],
            "rasterizer_settings": settings._replace(active_sh_bases=bases)}


def use_expandable_segments():
    """As the peer asks of PyTorch's allocator; says whether this machine can."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            torch.cuda.memory._set_allocator_settings("expandable_segments:True")
            torch.empty(1 << 26, device="cuda")
        except (AttributeError, RuntimeError, ValueError) as problem:
            print(f"no expandable segments: {problem}")
            torch.cuda.memory._set_allocator_settings("expandable_segments:False")
            return False
    return not any("expandable_segments" in str(warning.message) for warning in caught)


def load_on_device(peer, views, device):
    """(settings, picture) of each view. Cameras take the size of their photo if it is another."""
    loaded = []
    with concurrent.futures.ThreadPoolExecutor() as pool:
        for view, photo in zip(views, pool.map(read_photo, views)):
            height, width = photo.shape[:2]
            if (width, height) != (view.width, view.height):
                print(f"{view.name}: {width}x{height}, its camera {view.width}x{view.height}")
                view = view.resized(width, height)
            loaded.append((settings_of(peer, view, device), picture_of(photo, device)))
    return loaded


def train(gaussians, views, peer, iterations, keeps_memory):
    """Returns the seconds of the loop, and (steps, Gaussians, seconds) of every 1,000 steps."""
    nothing = torch.empty(0, device="cuda")
    order, progress = [], []
    torch.cuda.synchronize()
    begin = time.perf_counter()
    for step in range(iterations):
        if prepare(gaussians, step) and not keeps_memory:
            torch.cuda.empty_cache()
        order = order or torch.randperm(len(views)).tolist()
        settings, photo = views[order.pop()]
        is_counting = gaussians.growth is not None and step < DENSITY_STEPS[-1]
        picture = peer.draw(densification_info=gaussians.growth if is_counting else nothing,
                            **arguments_of(gaussians, settings))
        loss = ((1 - SSIM_SHARE) * torch.nn.functional.l1_loss(picture, photo)
                + SSIM_SHARE * (1 - peer.ssim(picture[None], photo[None])))
        loss.backward()
        gaussians.optimizer.step()
        gaussians.optimizer.zero_grad()
        if (step + 1) % 1000 == 0:
            progress.append((step + 1, len(gaussians), round(time.perf_counter() - begin, 2)))
            print("step {}: {} Gaussians, {} s".format(*progress[-1]), flush=True)
    torch.cuda.synchronize()
    return time.perf_counter() - begin, progress


@torch.no_grad()
def measure(gaussians, views, peer):
    """(PSNR, SSIM) of each view."""
    figures = []
    for settings, photo in views:
        picture = peer.draw_only(**arguments_of(gaussians, settings), to_chw=True,
                                 clamp_output=True)
        error = torch.nn.functional.mse_loss(picture, photo).item()
        ssim = peer.ssim(picture[None], photo[None], train=False).item()
        figures.append((-10 * math.log10(max(error, 1e-10)), ssim))
    return figures


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", type=pathlib.Path)
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--peer", type=pathlib.Path, required=True)
    parser.add_argument("--iterations", type=int, default=30000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--eval-every", type=int, default=8, help="0 holds nothing out")
    options = parser.parse_args()

    scene = read_scene(options.scene, options.eval_every, options.seed)
    keeps_memory = use_expandable_segments()
    peer = import_peer(options.peer)
    torch.manual_seed(options.seed)
    device = torch.device("cuda")
    gaussians = Gaussians(scene, lambda groups: peer.adam(groups, lr=0.0, eps=1e-15), device)
    views = load_on_device(peer, scene.train, device)
    print(f"{options.scene}: {len(views)} photos, {len(scene.test)} held out, {len(gaussians)} "
          f"points, extent {gaussians.extent:.3f}", flush=True)
    seconds, progress = train(gaussians, views, peer, options.iterations, keeps_memory)
    peak = torch.cuda.max_memory_allocated() / 2 ** 30

    with torch.no_grad():
        gaussians.finish()
    del views
    figures = measure(gaussians, load_on_device(peer, scene.test, device), peer)
    options.output.mkdir(parents=True, exist_ok=True)
    write_ply(options.output / "point_cloud.ply", gaussians.tensors)
    results = {
        "program": "Faster-GS 3cb0b75", "scene": str(options.scene), "seed": options.seed,
        "device": torch.cuda.get_device_name(), "torch": torch.__version__,
        "iterations": options.iterations, "seconds": seconds, "gaussians": len(gaussians),
        "peak_gib": peak, "expandable_segments": keeps_memory, "photos": len(scene.train),
        "held_out": len(scene.test), "points": len(scene.points), "extent": gaussians.extent,
        "psnr": statistics.mean(f[0] for f in figures) if figures else None,
        "ssim": statistics.mean(f[1] for f in figures) if figures else None,
        "views": {view.name: figure for view, figure in zip(scene.test, figures)},
        "progress": progress}
    (options.output / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    print(f"{seconds:.1f} s, {len(gaussians)} Gaussians, PSNR {results['psnr']}")


if __name__ == "__main__":
    main()
