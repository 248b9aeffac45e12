# SPDX-License-Identifier: Apache-2.0
"""gemsplat.compat: modules as scripts find them, and those that draw nothing."""

import importlib
import math
import os
import subprocess
import sys
import unittest

import numpy as np

import gemsplat
import gemsplat.compat
from compat_support import (BACKGROUND, DEVICES, HEIGHT, K, VIEW, WIDTH, chosen, draw_by_gsplat, gaussians, loss_of, near,
                            near_in_all, settings, torch)
from support import TestCase

if torch is not None:
    from gemsplat.compat import _harmonics, _screen, diff_gaussian_rasterization as dgr, fused_ssim, gsplat, simple_knn


@unittest.skipUnless(torch, "PyTorch is not installed")
class OtherModulesTest(TestCase):
    def test_harmonics_of_the_fourth_degree_are_orthonormal(self):
        directions = torch.randn(200_000, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
        values = _harmonics.basis(4, torch.nn.functional.normalize(directions, dim=-1))
        near(values.T @ values * (4 * math.pi / len(values)), torch.eye(25).double(), 0.03)

    @unittest.skipUnless("cuda" in DEVICES, "there is no PyTorch with a GPU, or gemsplat was built without CUDA")
    def test_constants_are_written_before_any_stream_or_graph_reads_them(self):
        device = torch.device("cuda", 0)
        busy, other = torch.cuda.Stream(), torch.cuda.Stream()
        with torch.cuda.stream(busy):
            torch.cuda._sleep(10**9)  # clock cycles
            _screen.constants((3, 5), device, torch.float32)
        with torch.cuda.stream(other):
            self.assertEqual(_screen.constants((3, 5), device, torch.float32).tolist(), [3, 5])
        torch.cuda.synchronize()
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            recorded = _screen.constants((7, 9), device, torch.float32) + 0
        self.assertEqual(_screen.constants((7, 9), device, torch.float32).tolist(), [7, 9])
        graph.replay()
        self.assertEqual(recorded.tolist(), [7, 9])

    def test_distances_are_those_of_gemsplat(self):
        points = torch.randn(60, 3, generator=torch.Generator().manual_seed(1), requires_grad=True)
        near(simple_knn._C.distCUDA2(points), torch.from_numpy(gemsplat.nearest_distances(points.detach().numpy(), 3)))

    def test_ssim_is_that_of_its_formula(self):
        x, y = (torch.rand(2, 3, 15, 17, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)) for seed in (1, 2))
        line = np.exp(-np.arange(-5, 6)**2 / (2 * 1.5**2))
        window = np.outer(line, line) / line.sum()**2
        for padding, edge in (("same", 5), ("valid", 0)):
            a, b = (np.pad(each.numpy(), ((0, 0), (0, 0), (edge, edge), (edge, edge))) for each in (x, y))
            values = []
            for row in range(a.shape[2] - 10):
                for column in range(a.shape[3] - 10):
                    p, q = (each[:, :, row:row + 11, column:column + 11] for each in (a, b))
                    mean = lambda picture: (picture * window).sum((2, 3))
                    mp, mq = mean(p), mean(q)
                    vp, vq, c = mean(p * p) - mp * mp, mean(q * q) - mq * mq, mean(p * q) - mp * mq
                    values.append((2 * mp * mq + 1e-4) * (2 * c + 9e-4) / ((mp * mp + mq * mq + 1e-4) * (vp + vq + 9e-4)))
            self.assertAlmostEqual(float(fused_ssim.fused_ssim(x, y, padding=padding)), float(np.mean(values)), places=12)
        small = x[:1, :1, :6, :5].clone().requires_grad_()
        self.assertTrue(torch.autograd.gradcheck(lambda image: fused_ssim.fused_ssim(image, y[:1, :1, :6, :5]), small))
        for device in DEVICES[1:]:
            for padding in ("same", "valid"):
                with self.subTest(device, padding=padding):
                    pictures = [torch.rand(2, 3, 45, 211, generator=torch.Generator().manual_seed(seed)) for seed in (3, 4)]
                    found, expected = (pictures[0].to(device).requires_grad_(), pictures[0].double().requires_grad_())
                    value = fused_ssim.fused_ssim(found, pictures[1].to(device), padding)
                    of_double = fused_ssim.fused_ssim(expected, pictures[1].double(), padding)
                    near(value.cpu().double(), of_double, 1e-6)
                    slope, of_double = torch.autograd.grad(3 * value, found)[0], torch.autograd.grad(3 * of_double, expected)[0]
                    near_in_all(slope, of_double, 1e-4)
        self.assertFalse(fused_ssim.fused_ssim(small, y[:1, :1, :6, :5], train=False).requires_grad)
        self.assert_refused("padding takes same or valid", fused_ssim.fused_ssim, x, y, "full")
        self.assert_refused("hold no window of 11 pixels", fused_ssim.fused_ssim, x[..., :9], y[..., :9], "valid")

    def test_the_photometric_loss_is_that_of_training(self):
        for device in DEVICES:
            x, y = (torch.rand(33, 47, 3, generator=torch.Generator().manual_seed(seed)).to(device) for seed in (1, 2))
            x.requires_grad_()
            planes = (picture.movedim(-1, 0)[None] for picture in (x, y))
            loss = gemsplat.photometric_loss(x, y, ssim_weight=0.3)
            expected = 0.7 * (x - y).abs().mean() + 0.3 * (1 - fused_ssim.fused_ssim(*planes))
            near(loss, expected, 1e-6)
            near_in_all(*(torch.autograd.grad(each, x)[0] for each in (loss, expected)), 1e-5)
        self.assert_refused("image must be a tensor", gemsplat.photometric_loss, x.detach().cpu().numpy(), y)


@unittest.skipUnless(torch, "PyTorch is not installed")
class TrainingTest(TestCase):
    def test_a_loop_of_the_usual_form_fits_a_picture(self):
        target = dgr.GaussianRasterizer(settings(torch.zeros(1)))(**self.inputs(gaussians(dtype=torch.float32)))[0].detach()
        arrays = chosen(gaussians(dtype=torch.float32, seed=2), "means", "rotations", "scales", "opacities", "sh")
        optimizer = dgr.SparseGaussianAdam([{"params": [array], "lr": 0.01} for array in arrays.values()], lr=0.0, eps=1e-15)
        errors = []
        for _ in range(40):
            means2D = torch.zeros_like(arrays["means"], requires_grad=True) + 0
            means2D.retain_grad()
            color, radii = dgr.GaussianRasterizer(settings(arrays["means"], debug=False))(**{**self.inputs(arrays), "means2D": means2D})
            errors.append((color - target).abs().mean())
            (0.8 * errors[-1] + 0.2 * (1 - fused_ssim.fused_ssim(color[None], target[None]))).backward()
            self.assertTrue((torch.linalg.vector_norm(means2D.grad[:, :2], dim=-1)[radii > 0] > 0).any())
            optimizer.step(radii > 0, len(radii))
            optimizer.zero_grad(set_to_none=True)
        self.assertLess(float(errors[-1]), 0.5 * float(errors[0]))

    @unittest.skipUnless(hasattr(torch, "compile"), "there is no PyTorch of 2.0 or later")
    def test_drop_ins_are_drawn_beside_the_graphs_of_torch_compile(self):
        for device in DEVICES:
            arrays = gaussians(device=device, dtype=torch.float32)
            means2D = torch.zeros_like(arrays["means"], requires_grad=True)

            def loss():
                color, _ = dgr.GaussianRasterizer(settings(arrays["means"], debug=False))(**{**self.inputs(arrays), "means2D": means2D})
                colors, alphas, _ = draw_by_gsplat(arrays, render_mode="RGB+ED")
                photometric = gemsplat.photometric_loss(color.movedim(0, -1), colors[0, ..., :3].detach())
                return loss_of(color, colors, alphas) + photometric

            found, expected = (torch.autograd.grad(each(), [*arrays.values(), means2D])
                               for each in (torch.compile(loss, backend="aot_eager"), loss))
            for one, other in zip(found, expected):
                near_in_all(one, other, 1e-4)

    def inputs(self, arrays):
        return {"means3D": arrays["means"], "means2D": None, "opacities": arrays["opacities"].clamp(0.01, 0.99), "shs": arrays["sh"],
                "scales": arrays["scales"].clamp_min(0.01), "rotations": arrays["rotations"]}


SCRIPT = """
import sys
import torch
from diff_gaussian_rasterization import GaussianRasterizationSettings, GaussianRasterizer
from fused_ssim import fused_ssim
from simple_knn._C import distCUDA2
import helper

view = torch.eye(4)
view[3, 2] = 3  # transposed: 3 in front of the camera
means = torch.rand(10, 3) - 0.5
projection = view @ torch.tensor([[2.0, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 1], [0, 0, -0.01, 0]])
settings = GaussianRasterizationSettings(image_height=20, image_width=30, tanfovx=0.5, tanfovy=0.5, bg=torch.zeros(3),
    scale_modifier=1.0, viewmatrix=view, projmatrix=projection, sh_degree=0, campos=torch.tensor([0.0, 0, -3]), prefiltered=False,
    debug=False)
screen = torch.zeros(10, 3, requires_grad=True)
color, radii = GaussianRasterizer(raster_settings=settings)(means3D=means, means2D=screen, opacities=torch.full((10, 1), 0.5),
    colors_precomp=torch.rand(10, 3), scales=torch.full((10, 3), 0.1), rotations=torch.ones(10, 4))
(1 - fused_ssim(color[None], torch.rand(1, 3, 20, 30))).backward()
print(__name__, sys.argv[1:], helper.VALUE, tuple(color.shape), bool((screen.grad != 0).any()), distCUDA2(means).shape)
"""
PACKAGE = {
    "__init__.py": "from .rendering import rasterization\n__version__ = '1.5.3'\nclass DefaultStrategy: pass\n",
    "rendering.py": "def rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height,\n"
                    "                  camera_model='pinhole', shutter='global', **others):\n    return camera_model, sorted(others)\n",
}


@unittest.skipUnless(torch, "PyTorch is not installed")
class InstallTest(TestCase):
    def setUp(self):
        super().setUp()
        self.addCleanup(gemsplat.compat.uninstall)

    def test_modules_are_found_and_given_back(self):
        names = ("diff_gaussian_rasterization", "simple_knn", "simple_knn._C", "fused_ssim", "gsplat")
        before = {name: sys.modules.get(name) for name in names}
        sys.modules["fused_ssim"] = sys
        self.addCleanup(sys.modules.pop, "fused_ssim", None)
        for name in ("diff_gaussian_rasterization", "simple_knn", "fused_ssim", "gsplat"):
            gemsplat.compat.install(name)
        from diff_gaussian_rasterization import GaussianRasterizer
        from fused_ssim import fused_ssim as function
        from gsplat.rendering import rasterization
        from simple_knn._C import distCUDA2
        self.assertEqual([GaussianRasterizer, function, rasterization, distCUDA2],
                         [dgr.GaussianRasterizer, fused_ssim.fused_ssim, gsplat.rasterization, simple_knn.distCUDA2])
        gemsplat.compat.install("diff_gaussian_rasterization", variant="aa")
        gemsplat.compat.uninstall()
        self.assertIsNone(dgr.variant)
        self.assertIs(sys.modules.pop("fused_ssim"), sys)
        self.assertEqual({name: sys.modules.get(name) for name in before}, before)

    def test_unknown_names_are_refused(self):
        self.assert_refused("did you mean simple_knn", gemsplat.compat.install, "simple-knn")
        self.assert_refused("variant is one of 2023, aa, accel, depth_alpha, and not 'b'", gemsplat.compat.install,
                            "diff_gaussian_rasterization", variant="b")
        self.assert_refused("gsplat has no option apis; did you mean api", gemsplat.compat.install, "gsplat", apis="1.4")

    def test_an_installed_gsplat_gets_what_is_not_drawn(self):
        (self.folder / "gsplat").mkdir()
        for name, text in PACKAGE.items():
            (self.folder / "gsplat" / name).write_text(text)
        sys.path.insert(0, str(self.folder))
        self.addCleanup(lambda: [sys.modules.pop(name, None) for name in ("gsplat", "gsplat.rendering")])
        self.addCleanup(sys.path.remove, str(self.folder))
        importlib.invalidate_caches()
        gemsplat.compat.install("gsplat")
        import gsplat as package
        self.assertEqual(gsplat._api(), "1.5")
        self.assertIs(package.rasterization, gsplat.rasterization)
        self.assertIs(package.rendering.rasterization, gsplat.rasterization)
        self.assertIs(gsplat.DefaultStrategy, package.DefaultStrategy)
        passed = draw_by_gsplat(gaussians(), camera_model="ftheta", with_ut=True)
        self.assertEqual(passed, ("ftheta", ["near_plane", "packed", "with_ut"]))
        self.assertEqual(draw_by_gsplat(gaussians(), shutter="global")[0].shape, (1, HEIGHT, WIDTH, 3))
        self.assertIn("gsplat.rasterization: 1 call passed to the installed package: camera_model='ftheta'", gemsplat.compat.report())
        gemsplat.compat.uninstall()
        self.assertEqual(package.rasterization.__module__, "gsplat.rendering")

    def run_script(self, *flags):
        (self.folder / "script.py").write_text(SCRIPT)
        (self.folder / "helper.py").write_text("VALUE = 7\n")
        return subprocess.run([sys.executable, "-m", "gemsplat.compat", *flags], capture_output=True, text=True, env=os.environ)

    def test_a_script_runs_unchanged(self):
        script = str(self.folder / "script.py")
        for flags in ((), ("--dgr=2023",), ("--dgr",)):
            done = self.run_script(*flags, "--report", script, "-s", "scene", "--report")
            self.assertEqual(done.stdout, "__main__ ['-s', 'scene', '--report'] 7 (3, 20, 30) True torch.Size([10])\n", done.stderr)
            self.assertIn("diff_gaussian_rasterization.rasterize_gaussians: 1 call by gemsplat", done.stderr)
            self.assertIn("simple_knn.distCUDA2: 1 call by gemsplat", done.stderr)

    def test_what_cannot_run_is_named(self):
        self.assertRegex(self.run_script("--gsplat", "missing.py").stderr, "cannot read missing.py")
        self.assertRegex(self.run_script("--dgr=b", "missing.py").stderr, "variant is one of")
        done = self.run_script("--gsplat", str(self.folder / "script.py"))
        self.assertRegex(done.stderr, "No module named 'diff_gaussian_rasterization'")


class ImportTest(TestCase):
    def test_gemsplat_and_its_compat_import_no_torch(self):
        code = "import sys, gemsplat, gemsplat.compat; print(any(name in sys.modules for name in ('torch', 'jax', 'cupy')))"
        self.assertEqual(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout, "False\n")


if __name__ == "__main__":
    unittest.main()
