# SPDX-License-Identifier: Apache-2.0
"""Scenes for the tests of gemsplat.compat, and what rasterize() itself makes of them."""

import contextlib

try:
    import torch
except ModuleNotFoundError:
    torch = None

import numpy as np

import gemsplat

if torch is not None:
    from gemsplat.compat import diff_gaussian_rasterization as dgr, gsplat

WIDTH, HEIGHT = 40, 24
TANGENTS = (0.6, 0.4)  # of half the fields of view
FOCALS = (WIDTH / (2 * TANGENTS[0]), HEIGHT / (2 * TANGENTS[1]))
BACKGROUND = (0.2, 0.4, 0.6)
VIEW = [[0.98, 0, 0.199, 0.1], [0, 1, 0, -0.2], [-0.199, 0, 0.98, 3], [0, 0, 0, 1]]
K = [[FOCALS[0], 0, WIDTH / 2], [0, FOCALS[1], HEIGHT / 2], [0, 0, 1]]
DEVICES = ["cpu"] + ["cuda"] * bool(torch is not None and torch.cuda.is_available() and gemsplat.cuda_device_count())


@contextlib.contextmanager
def without_waiting():
    """In it, what makes the host wait for the GPU is an error; that of gemsplat's own kernels goes unseen."""
    torch.cuda.synchronize()
    torch.cuda.set_sync_debug_mode("error")
    try:
        yield
    finally:
        torch.cuda.set_sync_debug_mode("default")


def near(value, expected, tolerance=1e-12):
    torch.testing.assert_close(value, expected, rtol=tolerance, atol=tolerance)


def near_in_all(value, expected, tolerance):
    """Of arrays whose numbers are sums that cancel: the difference is small beside the whole array."""
    difference = torch.linalg.vector_norm(value.double().cpu() - expected.double().cpu())
    assert difference <= tolerance * torch.linalg.vector_norm(expected.double()), (float(difference), tolerance)


def gaussians(count=20, device="cpu", dtype=None, seed=1):
    """Leaves by the names of rasterize()."""
    random = np.random.default_rng(seed)
    arrays = {"means": random.uniform(-1, 1, (count, 3)), "rotations": random.normal(size=(count, 4)),
              "scales": random.uniform(0.05, 0.3, (count, 3)),
              "opacities": random.uniform(0.1, 1.2, (count, 1)).clip(max=0.9995),  # some above the clamp of alpha
              "sh": random.normal(size=(count, 16, 3)) / 3, "colors": random.uniform(0, 1, (count, 3))}
    return {name: torch.tensor(array, dtype=dtype or torch.float64, device=device, requires_grad=True)
            for name, array in arrays.items()}


def projection(view, offset=(0, 0)):
    """The matrix from world to the picture, from -1 to 1, with its center moved by as much of half its size."""
    row = view.new_tensor
    return torch.stack((view[0] / TANGENTS[0] + offset[0] * view[2], view[1] / TANGENTS[1] + offset[1] * view[2],
                        1.0001 * view[2] + row([0, 0, 0, -0.01]), view[2]))


def settings(like, offset=(0, 0), **others):
    view = torch.tensor(VIEW, dtype=like.dtype, device=like.device)
    given = {"image_height": HEIGHT, "image_width": WIDTH, "tanfovx": TANGENTS[0], "tanfovy": TANGENTS[1],
             "bg": like.new_tensor(BACKGROUND), "scale_modifier": 1.0, "viewmatrix": view.T,
             "projmatrix": projection(view, offset).T, "sh_degree": 3, "campos": torch.linalg.inv(view)[:3, 3],
             "prefiltered": False, "debug": True}
    return dgr.GaussianRasterizationSettings(**{**given, **others})


def expected(arrays, outputs=("image",), matrix=K, **others):
    """By rasterize() itself."""
    means = arrays["means"]
    given = {"viewmats": means.new_tensor(VIEW), "Ks": means.new_tensor(matrix), "width": WIDTH, "height": HEIGHT,
             "background": means.new_tensor(BACKGROUND), "near": 0.2, "far": 1e10, "blur": 0.3, "blend_rule": "classic"}
    return gemsplat.rasterize(**arrays, **{**given, **others}, outputs=outputs)


def loss_of(*pictures):
    """A number that depends on every pixel in a way of its own."""
    return sum((torch.sin(torch.arange(picture.numel(), device=picture.device, dtype=picture.dtype)).view(picture.shape)
                * picture).sum() for picture in pictures)


def slopes(loss, arrays):
    return dict(zip(arrays, torch.autograd.grad(loss, list(arrays.values()))))


def covariances(arrays):
    """(N, 3, 3) of scales and rotations."""
    w, x, y, z = torch.nn.functional.normalize(arrays["rotations"], dim=-1).unbind(-1)
    R = torch.stack((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                     2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                     2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), -1).view(-1, 3, 3)
    M = R * arrays["scales"][:, None]
    return M @ M.transpose(1, 2)


def chosen(arrays, *names):
    return {name: arrays[name] for name in names}


def draw_by_gsplat(arrays, **others):
    like = arrays["means"]
    given = {"means": like, "quats": arrays["rotations"], "scales": arrays["scales"], "opacities": arrays["opacities"].squeeze(-1),
             "colors": arrays.get("colors", arrays.get("sh")), "width": WIDTH, "height": HEIGHT, "near_plane": 0.2, "packed": False}
    for name, matrix in (("viewmats", VIEW), ("Ks", K)):
        if name not in others:
            given[name] = like.new_tensor([matrix])
    return gsplat.rasterization(**{**given, **others})
