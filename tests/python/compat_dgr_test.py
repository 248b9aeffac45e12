# SPDX-License-Identifier: Apache-2.0
"""gemsplat.compat.diff_gaussian_rasterization beside gemsplat.rasterize() and finite differences."""

import math
import unittest

import numpy as np

import gemsplat.compat
from compat_support import (DEVICES, FOCALS, HEIGHT, K, VIEW, WIDTH, chosen, covariances, expected, gaussians, loss_of, near,
                            near_in_all, settings, slopes, torch, without_waiting)
from support import TestCase

if torch is not None:
    from gemsplat.compat import diff_gaussian_rasterization as dgr


@unittest.skipUnless(torch, "PyTorch is not installed")
class DiffGaussianRasterizationTest(TestCase):
    NAMES = ("means", "rotations", "scales", "opacities", "sh")

    def draw(self, arrays, means2D=None, given=None, **others):
        rasterizer = dgr.GaussianRasterizer(raster_settings=given or settings(arrays["means"]))
        inputs = {"shs": arrays["sh"], "scales": arrays["scales"], "rotations": arrays["rotations"], **others}
        return rasterizer(means3D=arrays["means"], means2D=means2D, opacities=arrays["opacities"],
                          **{name: value for name, value in inputs.items() if value is not None})

    def test_pictures_and_gradients_are_those_of_rasterize(self):
        for device in DEVICES:
            for dtype in (torch.float64, torch.float32) if device == "cpu" else (torch.float32,):
                with self.subTest(device, dtype=dtype):
                    arrays = chosen(gaussians(device=device, dtype=dtype), *self.NAMES)
                    color, radii = self.draw(arrays)
                    image = expected(arrays).image
                    self.assertEqual((color.shape, color.dtype), ((3, HEIGHT, WIDTH), dtype))
                    self.assertEqual((radii.shape, radii.dtype), ((20,), torch.int32))
                    tolerance = 1e-10 if dtype == torch.float64 else 1e-4
                    near(color.permute(1, 2, 0), image, tolerance)
                    wanted = slopes(loss_of(image), arrays)
                    for name, slope in slopes(loss_of(color.permute(1, 2, 0)), arrays).items():
                        near_in_all(slope, wanted[name], tolerance)

    def test_every_form_of_the_inputs_draws_the_same(self):
        arrays = gaussians()
        color, radii = self.draw(arrays)
        matrices = covariances(arrays)
        triangles = torch.stack([matrices[:, row, column] for row in range(3) for column in range(row, 3)], -1)
        forms = {"covariances": {"scales": None, "rotations": None, "cov3D_precomp": triangles},
                 "dc": {"shs": arrays["sh"][:, 1:], "dc": arrays["sh"][:, :1]},
                 "modifier": {"scales": arrays["scales"] / 2, "given": settings(arrays["means"], scale_modifier=2.0)}}
        for name, others in forms.items():
            with self.subTest(name):
                again = self.draw(arrays, **others)
                near(again[0], color, 1e-8)
                self.assertTrue(torch.equal(again[1], radii))
        empty = torch.Tensor([])
        again = dgr.rasterize_gaussians(arrays["means"], None, arrays["sh"], empty, arrays["opacities"], arrays["scales"],
                                        arrays["rotations"], empty, settings(arrays["means"]))
        near(again[0], color)
        given = self.draw(arrays, shs=None, colors_precomp=arrays["colors"])[0]
        near(given.permute(1, 2, 0), expected(chosen(arrays, *self.NAMES[:4], "colors")).image, 1e-8)

    def test_the_means_in_the_picture_get_their_gradient_in_units_of_half_the_picture(self):
        arrays = chosen(gaussians(), *self.NAMES)
        means2D = torch.full((20, 3), 7.0, dtype=torch.float64, requires_grad=True)  # the value does not count
        color, _ = self.draw(arrays, means2D)
        screen = torch.zeros((20, 2), dtype=torch.float64, requires_grad=True)
        image = expected(arrays, screen=screen).image
        near(color.permute(1, 2, 0), image)
        by_pixels, = torch.autograd.grad(loss_of(image), screen)
        slope, = torch.autograd.grad(loss_of(color.permute(1, 2, 0)), means2D)
        near(slope[:, :2], by_pixels * torch.tensor([WIDTH / 2, HEIGHT / 2]), 1e-9)
        self.assertEqual(float(slope[:, 2].abs().max()), 0)

    def test_finite_differences_find_the_gradient(self):
        arrays = chosen(gaussians(6), *self.NAMES)
        loss = lambda: loss_of(self.draw(arrays)[0])
        for name, slope in slopes(loss(), arrays).items():
            with self.subTest(name), torch.no_grad():
                values = arrays[name].view(-1)
                place = int(slope.abs().argmax())
                found = []
                for step in (1e-6, -1e-6):
                    values[place] += step
                    found.append(float(loss()))
                    values[place] -= step
                self.assertAlmostEqual((found[0] - found[1]) / 2e-6, float(slope.view(-1)[place]),
                                       delta=1e-4 * float(slope.abs().max()))

    def test_without_gradients_the_picture_is_the_same(self):
        arrays = chosen(gaussians(), *self.NAMES)
        means2D = torch.zeros(20, 3, dtype=torch.float64, requires_grad=True)
        with torch.no_grad():
            color, _ = self.draw(arrays, means2D)
        self.assertFalse(color.requires_grad)
        near(color, self.draw(arrays, means2D)[0])

    def test_variants_return_their_pictures(self):
        arrays = chosen(gaussians(), *self.NAMES)
        pictures = expected(arrays, ("image", "alpha", "depth", "inverse_depth"))
        smooth = expected(arrays, ("image", "inverse_depth"), antialiased=True)
        _, _, inverse = self.draw(arrays, given=settings(arrays["means"], antialiasing=False))
        near(inverse, pictures.inverse_depth[None], 1e-9)
        color, _, inverse = self.draw(arrays, given=settings(arrays["means"], antialiasing=True))
        near(color.permute(1, 2, 0), smooth.image, 1e-9)
        near(inverse, smooth.inverse_depth[None], 1e-9)
        self.assertEqual(len(self.draw(arrays, shs=arrays["sh"][:, 1:], dc=arrays["sh"][:, :1])), 3)
        gemsplat.compat.install("diff_gaussian_rasterization", variant="depth_alpha")
        self.addCleanup(gemsplat.compat.uninstall)
        _, _, depth, alpha = self.draw(arrays)
        near(depth, pictures.depth[None], 1e-9)
        near(alpha, pictures.alpha[None], 1e-9)
        wanted = slopes(loss_of(pictures.depth), chosen(arrays, "means", "opacities"))
        for name, slope in slopes(loss_of(depth[0]), chosen(arrays, "means", "opacities")).items():
            near(slope, wanted[name], 1e-8)

    def test_a_center_beside_the_middle_comes_from_projmatrix(self):
        arrays = chosen(gaussians(), *self.NAMES)
        color, _ = self.draw(arrays, given=settings(arrays["means"], offset=(0.2, -0.1)))
        moved = [[K[0][0], 0, WIDTH / 2 * 1.2], [0, K[1][1], HEIGHT / 2 * 0.9], K[2]]
        near(color.permute(1, 2, 0), expected(arrays, matrix=moved).image, 1e-3)

    def test_alpha_is_at_most_99_percent(self):
        arrays = gaussians(1)
        arrays.update(means=torch.zeros(1, 3).double(), scales=torch.full((1, 3), 0.6).double(), opacities=torch.ones(1, 1).double())
        color, _ = self.draw(arrays, shs=None, colors_precomp=torch.ones(1, 3).double(),
                             given=settings(arrays["means"], bg=torch.zeros(3)))
        self.assertAlmostEqual(float(color.max()), 0.99, places=6)

    def test_radii_are_three_deviations_whatever_the_opacity(self):
        arrays = gaussians()
        rows = expected(chosen(arrays, *self.NAMES), ("means2d", "conics", "visible"))
        _, radii = self.draw({**arrays, "opacities": torch.full_like(arrays["opacities"], 1e-3)})
        for row in torch.nonzero(rows.visible)[:, 0]:
            xx, xy, yy = rows.conics[row].tolist()
            largest = np.linalg.eigvalsh(np.linalg.inv([[xx, xy], [xy, yy]])).max()
            self.assertEqual(int(radii[row]), math.ceil(3 * math.sqrt(largest) - 1e-9))
        self.assertTrue(torch.equal(radii, dgr.GaussianRasterizer(settings(arrays["means"])).visible_filter(
            arrays["means"], scales=arrays["scales"], rotations=arrays["rotations"])))

    def test_what_is_behind_the_camera_or_beside_the_tiles_is_not_visible(self):
        arrays = {name: tensor.detach() for name, tensor in gaussians(4).items()}
        center = -torch.tensor(VIEW).double()[:3, :3].T @ torch.tensor(VIEW).double()[:3, 3]
        away = torch.tensor(VIEW).double()[2, :3]
        side = torch.tensor(VIEW).double()[0, :3]
        at = lambda pixel: center + 3 * away + 3 * (pixel - WIDTH / 2) / FOCALS[0] * side
        arrays["means"] = torch.stack((center + 3 * away, center - away, center + 0.1 * away, at(4 * WIDTH), at(WIDTH + 6),
                                       at(WIDTH + 12)))
        arrays = {name: tensor[:1].expand(6, *tensor.shape[1:]) if name != "means" else tensor for name, tensor in arrays.items()}
        arrays["scales"] = torch.full((6, 3), 1e-3, dtype=torch.float64)
        _, radii = self.draw(arrays)
        self.assertEqual((radii > 0).tolist(), [True, False, False, False, True, False])  # the last tile ends 8 pixels outside
        marked = dgr.GaussianRasterizer(settings(arrays["means"])).markVisible(arrays["means"])
        self.assertEqual(marked.tolist(), [True, False, False, True, True, True])

    def test_of_no_gaussians_there_is_black(self):
        color, radii = self.draw(gaussians(0))
        self.assertEqual((tuple(color.shape), float(color.abs().max()), len(radii)), ((3, HEIGHT, WIDTH), 0, 0))

    def test_both_or_neither_are_refused(self):
        arrays = gaussians()
        for others in ({"colors_precomp": arrays["colors"]}, {"shs": None}, {"rotations": None}, {"scales": None, "rotations": None},
                       {"cov3D_precomp": torch.zeros(20, 6, dtype=torch.float64)}):
            with self.subTest(list(others)):
                self.assert_refused("not both or neither", self.draw, arrays, **others)

    def test_debug_finds_matrices_that_disagree(self):
        arrays = gaussians()
        self.assert_refused("projmatrix disagrees with viewmatrix and tanfovx", self.draw, arrays,
                            given=settings(arrays["means"], tanfovx=0.5))
        self.assert_refused("campos is not where", self.draw, arrays, given=settings(arrays["means"], campos=torch.ones(3).double()))

    @unittest.skipUnless("cuda" in DEVICES, "there is no PyTorch with a GPU, or gemsplat was built without CUDA")
    def test_the_host_does_not_wait(self):
        arrays = chosen(gaussians(device="cuda", dtype=torch.float32), *self.NAMES)
        means2D = torch.zeros_like(arrays["means"], requires_grad=True)
        given = settings(arrays["means"], debug=False, antialiasing=True)
        optimizer = dgr.SparseGaussianAdam(list(arrays.values()), lr=1e-3)
        with without_waiting():
            color, radii, inverse = self.draw(arrays, means2D, given)
            (color.sum() + inverse.sum()).backward()
            optimizer.step(radii > 0, 20)

    def test_a_model_of_anchors_trains(self):
        """The two calls of Scaffold-GS: which anchors are seen, and a picture of the Gaussians that a network makes of these."""
        for device in DEVICES:
            with self.subTest(device):
                anchors = gaussians(device=device, dtype=torch.float32)
                with torch.no_grad():
                    anchors["means"][::4, 2] -= 20  # behind the camera
                rasterizer = dgr.GaussianRasterizer(raster_settings=settings(anchors["means"], sh_degree=1))
                radii = rasterizer.visible_filter(means3D=anchors["means"], scales=anchors["scales"], rotations=anchors["rotations"],
                                                  cov3D_precomp=None)
                _, expected_radii = self.draw(anchors, given=rasterizer.raster_settings)
                self.assertTrue(torch.equal(radii, expected_radii))
                matrices = covariances(anchors)
                triangles = torch.stack([matrices[:, row, column] for row in range(3) for column in range(row, 3)], -1)
                self.assertTrue(torch.equal(rasterizer.visible_filter(anchors["means"], cov3D_precomp=triangles) > 0, radii > 0))
                seen = radii > 0
                self.assertFalse(bool(seen[::4].any()))
                count = 2 * int(seen.sum())  # Gaussians
                self.assertGreater(count, 10)
                weights = torch.full((8, 3), 0.1, device=device, requires_grad=True)
                features = torch.sin(torch.arange(8 * count, device=device, dtype=torch.float32)).view(count, 8)
                means = (anchors["means"][seen][:, None] + 0.1 * features.view(-1, 2, 8)[..., :3]).flatten(0, 1)
                shape = {name: anchors[name][seen].repeat_interleave(2, 0) for name in ("scales", "rotations", "opacities")}
                colors = torch.sigmoid(features @ weights)
                means2D = torch.zeros_like(means, requires_grad=True) + 0
                means2D.retain_grad()
                color, radii = rasterizer(means3D=means, means2D=means2D, shs=None, colors_precomp=colors,
                                          opacities=shape["opacities"], scales=shape["scales"], rotations=shape["rotations"],
                                          cov3D_precomp=None)
                image = expected({"means": means, "colors": colors, **shape}).image
                near(color.permute(1, 2, 0), image, 1e-4)
                trained = [weights, anchors["means"]]
                wanted = torch.autograd.grad(loss_of(image), trained, retain_graph=True)
                loss_of(color.permute(1, 2, 0)).backward()
                for tensor, slope in zip(trained, wanted):
                    near_in_all(tensor.grad, slope, 1e-3)
                self.assertGreater(float(means2D.grad[radii > 0, :2].norm(dim=-1).max()), 0)

    def test_sparse_adam_moves_what_was_seen(self):
        parameter = torch.nn.Parameter(torch.tensor([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]))
        optimizer = dgr.SparseGaussianAdam([{"params": [parameter], "lr": 0.1}], lr=0.0, eps=1e-15)
        values, m, v = parameter.detach().double().numpy().copy(), np.zeros((3, 2)), np.zeros((3, 2))
        for seen in ([True, False, True], [True, True, False]):
            parameter.grad = torch.tensor([[1.0, -2.0], [0.5, 0.1], [3.0, 1.0]])
            optimizer.step(torch.tensor(seen), 3)
            gradient = parameter.grad.double().numpy()
            m[seen] = 0.9 * m[seen] + 0.1 * gradient[seen]
            v[seen] = 0.999 * v[seen] + 0.001 * gradient[seen]**2
            values[seen] -= 0.1 * m[seen] / (np.sqrt(v[seen]) + 1e-15)
        np.testing.assert_allclose(parameter.detach().numpy(), values, rtol=1e-5)


if __name__ == "__main__":
    unittest.main()
