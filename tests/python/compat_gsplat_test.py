# SPDX-License-Identifier: Apache-2.0
"""gemsplat.compat.gsplat beside gemsplat.rasterize()."""

import unittest

import numpy as np

import gemsplat.compat
from compat_support import (BACKGROUND, DEVICES, HEIGHT, K, VIEW, WIDTH, chosen, covariances, draw_by_gsplat, expected,
                            gaussians, loss_of, near, near_in_all, torch, without_waiting)
from support import TestCase

if torch is not None:
    from gemsplat.compat import gsplat


@unittest.skipUnless(torch, "PyTorch is not installed")
class GsplatTest(TestCase):
    NAMES = ("means", "rotations", "scales", "opacities", "colors")

    def test_every_mode_is_that_of_rasterize_with_its_gradients(self):
        for device in DEVICES:
            dtype, tolerance = (torch.float64, 1e-9) if device == "cpu" else (torch.float32, 1e-3)
            arrays = chosen(gaussians(device=device, dtype=dtype), *self.NAMES)
            backgrounds = arrays["means"].new_tensor([BACKGROUND])
            cpu = chosen(gaussians(dtype=torch.float64), *self.NAMES)
            drawn = expected(cpu, ("image", "alpha", "depth"))
            mean = drawn.depth / drawn.alpha.clamp_min(1e-10)
            wanted = {"RGB": [drawn.image], "D": [drawn.depth[..., None]], "ED": [mean[..., None]],
                      "RGB+D": [drawn.image, drawn.depth[..., None]], "RGB+ED": [drawn.image, mean[..., None]]}
            for mode, pictures in wanted.items():
                for packed in (False, True):
                    with self.subTest(device, mode=mode, packed=packed):
                        colors, alphas, _ = draw_by_gsplat(arrays, render_mode=mode, packed=packed, backgrounds=backgrounds)
                        picture = torch.cat(pictures, -1)
                        near(colors[0].cpu().double(), picture, tolerance)
                        near(alphas[0, ..., 0].cpu().double(), drawn.alpha, tolerance)
                        ours, theirs = ([*chosen(each, *self.NAMES[:4]).values()] for each in (arrays, cpu))
                        slope = torch.autograd.grad(loss_of(colors[0], alphas[0]), ours)
                        right = torch.autograd.grad(loss_of(picture, drawn.alpha[..., None]), theirs, retain_graph=True)
                        for one, other in zip(slope, right):
                            near_in_all(one, other, tolerance)

    def test_poses_and_intrinsics_have_gradients(self):
        arrays = chosen(gaussians(), *self.NAMES)
        matrices = {name: torch.tensor([matrix], dtype=torch.float64, requires_grad=True)
                    for name, matrix in (("viewmats", VIEW), ("Ks", K))}
        colors, _, _ = draw_by_gsplat(arrays, **matrices)
        image = expected(arrays, viewmats=matrices["viewmats"][0], Ks=matrices["Ks"][0], background=torch.zeros(3).double()).image
        wanted = torch.autograd.grad(loss_of(image), list(matrices.values()))
        for one, other in zip(torch.autograd.grad(loss_of(colors), list(matrices.values())), wanted):
            near(one, other, 1e-9)

    def test_fisheyes_and_parallel_rays_are_drawn(self):
        arrays = chosen(gaussians(), *self.NAMES)
        for model in ("fisheye", "ortho"):
            colors, _, meta = draw_by_gsplat(arrays, camera_model=model, packed=False)
            near(colors[0], expected(arrays, background=torch.zeros(3).double(), camera_model=model).image, 1e-9)
            wanted = expected(arrays, ("means2d",), camera_model=model).means2d
            seen = wanted.abs().sum(-1) > 0
            near(meta["means2d"][0][seen].detach().double(), wanted[seen].detach(), 1e-6)

    def test_without_gradients_the_picture_is_the_same(self):
        arrays = gaussians()
        with torch.no_grad():
            colors, _, meta = draw_by_gsplat(arrays)
        self.assertFalse(meta["means2d"].requires_grad)
        near(colors, draw_by_gsplat(arrays)[0])

    def test_coefficients_features_and_covariances_are_drawn(self):
        arrays = gaussians()
        shape = chosen(arrays, *self.NAMES[:4])
        for degree in (1, 3):
            near(draw_by_gsplat({**shape, "colors": arrays["sh"]}, sh_degree=degree)[0][0],
                 expected({**shape, "sh": arrays["sh"]}, sh_degree=degree, background=torch.zeros(3).double()).image)
        features = torch.cat((arrays["colors"], arrays["sh"][:, 0, :2]), 1)
        over = torch.tensor([[0.1, 0.2, 0.3, 0.4, 0.5]]).double()
        drawn = expected({**shape, "features": features}, ("alpha",))
        near(draw_by_gsplat({**shape, "colors": features}, backgrounds=over)[0][0],
             drawn.features + (1 - drawn.alpha[..., None]) * over[0])
        near(draw_by_gsplat(arrays, covars=covariances(arrays), quats=None, scales=None)[0], draw_by_gsplat(arrays)[0], 1e-9)

    def test_the_fourth_degree_and_colors_of_views_are_drawn(self):
        arrays = gaussians()
        more = torch.cat((arrays["sh"], torch.zeros(20, 9, 3).double()), 1)
        near(draw_by_gsplat({**arrays, "colors": more}, sh_degree=4)[0],
             draw_by_gsplat({**arrays, "colors": arrays["sh"]}, sh_degree=3)[0], 1e-9)
        two = {"viewmats": torch.tensor(np.array([VIEW, np.eye(4) + np.diag([0, 0, 3], 1)])), "Ks": torch.tensor([K, K]).double()}
        colors, _, meta = draw_by_gsplat(arrays, colors=torch.stack((arrays["colors"], 1 - arrays["colors"])), **two)
        for view in (0, 1):
            near(colors[view], draw_by_gsplat(arrays, colors=(arrays["colors"], 1 - arrays["colors"])[view],
                                         **{name: matrix[view:view + 1] for name, matrix in two.items()})[0][0])
        self.assertEqual(meta["n_cameras"], 2)

    def test_batches_are_drawn_one_by_one(self):
        one, other = gaussians(seed=1), gaussians(seed=2)
        both = {name: torch.stack((one[name], other[name])) for name in self.NAMES}
        like = {name: one["means"].new_tensor([[matrix], [matrix]]) for name, matrix in (("viewmats", VIEW), ("Ks", K))}
        colors, alphas, meta = draw_by_gsplat(both, **like)
        self.assertEqual((tuple(colors.shape), tuple(alphas.shape)), ((2, 1, HEIGHT, WIDTH, 3), (2, 1, HEIGHT, WIDTH, 1)))
        self.assertEqual(tuple(meta["radii"].shape), (2, 1, 20, 2))
        near(colors[1], draw_by_gsplat(other)[0])
        two = {name: matrices.expand(2, 2, *matrices.shape[2:]) for name, matrices in like.items()}
        packed, meta = (draw_by_gsplat(both, **two, packed=packed)[2] for packed in (True, False))
        for name in ("isect_ids", "isect_offsets"):
            self.assertTrue(torch.equal(packed[name], meta[name]))
        colors, _, _ = draw_by_gsplat({**both, "colors": one["sh"]}, **like, sh_degree=3)  # coefficients in common
        near(colors[1], draw_by_gsplat({**other, "colors": one["sh"]}, sh_degree=3)[0])

    def test_antialiasing_and_planes_are_those_of_rasterize(self):
        arrays = chosen(gaussians(), *self.NAMES)
        arrays["scales"] = arrays["scales"].detach() / 10
        colors, _, meta = draw_by_gsplat(arrays, rasterize_mode="antialiased", near_plane=2.8, far_plane=3.4)
        given = {"antialiased": True, "near": 2.8, "far": 3.4, "background": torch.zeros(3).double()}
        near(colors[0], expected(arrays, **given).image)
        is_seen = (meta["radii"][0] > 0).all(-1)
        self.assertEqual(set(((2.8 < meta["depths"][0]) & (meta["depths"][0] < 3.4))[is_seen].tolist()), {True})
        lowered = {**arrays, "opacities": meta["opacities"][0][:, None]}
        near(colors[0], expected(lowered, near=2.8, far=3.4, background=torch.zeros(3).double()).image, 1e-6)
        colors, _, _ = draw_by_gsplat(arrays, viewmats=torch.tensor(np.array(VIEW) + np.diag([0, 0, 3e4], 1))[None])
        self.assertGreater(float(colors.max()), 0)  # beyond what training draws

    def test_alpha_is_at_most_99_percent(self):
        arrays = gaussians(1)
        arrays.update(means=torch.zeros(1, 3).double(), scales=torch.full((1, 3), 0.6).double(), opacities=torch.ones(1, 1).double())
        self.assertAlmostEqual(float(draw_by_gsplat(arrays)[1].max()), 0.99, places=6)

    def test_boxes_end_where_alpha_does(self):
        arrays = gaussians()
        rows = expected(chosen(arrays, *self.NAMES), ("conics", "visible"))
        _, _, meta = draw_by_gsplat(arrays)
        for row in torch.nonzero(rows.visible)[:, 0]:
            xx, xy, yy = rows.conics[row].tolist()
            variances = np.linalg.inv([[xx, xy], [xy, yy]]).diagonal()
            reach = np.sqrt(2 * np.log(255 * float(arrays["opacities"][row])) * variances)
            self.assertEqual(meta["radii"][0, row].tolist(), np.ceil(reach - 1e-6).tolist())

    def test_the_dict_has_what_rasterize_tells(self):
        arrays = chosen(gaussians(), *self.NAMES)
        arrays["means"], arrays["scales"] = 2.5 * arrays["means"].detach(), 4 * arrays["scales"].detach()  # beyond the border
        rows = expected(arrays, ("visible", "means2d", "depths", "conics"))
        _, _, meta = draw_by_gsplat(arrays)
        is_seen = (meta["radii"] > 0).all(-1)[0]
        self.assertTrue(bool((is_seen | ~rows.visible).all()))
        is_seen &= rows.visible  # a box may meet the picture where its ellipse does not
        near(meta["means2d"][0][is_seen], rows.means2d[is_seen])
        near(meta["depths"][0][is_seen], rows.depths[is_seen])
        near(meta["conics"][0][is_seen], rows.conics[is_seen], 1e-6)  # rasterize() takes the blur as a float of 32 bits
        _, _, packed = draw_by_gsplat(arrays, packed=True)
        ids = (meta["radii"][0] > 0).all(-1).nonzero()[:, 0]
        self.assertTrue(torch.equal(packed["gaussian_ids"], ids))
        for name in ("means2d", "depths", "conics", "radii", "opacities"):
            near(packed[name], meta[name][0][ids])

    def test_means_in_the_picture_have_their_gradient(self):
        arrays = chosen(gaussians(), *self.NAMES)
        screen = torch.zeros((20, 2), dtype=torch.float64, requires_grad=True)
        wanted, = torch.autograd.grad(loss_of(expected(arrays, screen=screen, background=torch.zeros(3).double()).image), screen)
        for packed in (False, True):
            with self.subTest(packed=packed):
                colors, _, meta = draw_by_gsplat(arrays, packed=packed)
                meta["means2d"].retain_grad()
                loss_of(colors).backward()
                near(meta["means2d"].grad, wanted[meta["gaussian_ids"]] if packed else wanted[None], 1e-9)

    def test_absgrad_sums_the_absolute_values_of_pixels(self):
        arrays = chosen(gaussians(), *self.NAMES)
        zeros = torch.zeros(len(arrays["means"]), 2, dtype=torch.float64, requires_grad=True)
        wanted, = torch.autograd.grad(loss_of(expected(arrays, absolute_screen=zeros, background=torch.zeros(3).double()).image), zeros)
        for packed in (False, True):
            colors, _, meta = draw_by_gsplat(arrays, packed=packed, absgrad=True)
            loss_of(colors).backward()
            sums = meta["means2d"].absgrad
            near(sums if packed else sums[0], wanted[meta["gaussian_ids"]] if packed else wanted, 1e-9)
            self.assertTrue((sums >= meta["means2d"].grad.abs() - 1e-12).all())

    def test_sparse_gradients_have_the_rows_that_are_seen(self):
        arrays = gaussians()
        with torch.no_grad():
            arrays["means"][:5] += 100
        names = ("means", "rotations", "scales")
        dense = torch.autograd.grad(loss_of(draw_by_gsplat(arrays)[0]), [arrays[name] for name in names])
        colors, _, meta = draw_by_gsplat(arrays, packed=True, sparse_grad=True)
        for one, other in zip(torch.autograd.grad(loss_of(colors), [arrays[name] for name in names]), dense):
            self.assertTrue(torch.equal(one._indices()[0], meta["gaussian_ids"]))
            near(one.to_dense(), other, 1e-9)

    def test_of_no_gaussians_there_is_the_background(self):
        for packed in (False, True):
            colors, alphas, meta = draw_by_gsplat(gaussians(0), packed=packed, backgrounds=torch.tensor([BACKGROUND]).double())
            near(colors, torch.tensor(BACKGROUND).double().expand(1, HEIGHT, WIDTH, 3))
            self.assertEqual((float(alphas.max()), len(meta["flatten_ids"])), (0, 0))

    def test_a_gaussian_that_is_too_small_is_left_out(self):
        arrays = gaussians()
        _, _, meta = draw_by_gsplat(arrays)
        clip = float(meta["radii"][0].max(-1).values.double().median())
        colors, _, clipped = draw_by_gsplat(arrays, radius_clip=clip)
        large = meta["radii"][0].max(-1).values > clip
        self.assertTrue(torch.equal((clipped["radii"] > 0).all(-1)[0], large))
        near(colors, draw_by_gsplat({name: tensor[large] for name, tensor in arrays.items()})[0], 1e-9)

    def test_lists_of_tiles_hold_each_gaussian_by_depth(self):
        arrays = gaussians()
        across, down = -(-WIDTH // 16), -(-HEIGHT // 16)
        two = {"viewmats": torch.tensor([VIEW, VIEW]).double(), "Ks": torch.tensor([K, K]).double()}
        for packed in (False, True):
            _, _, meta = draw_by_gsplat(arrays, packed=packed, **two)
            depths, means2d, radii = (meta[name].detach().reshape(-1, *meta[name].shape[1 if packed else 2:]).tolist()
                                      for name in ("depths", "means2d", "radii"))
            cameras = meta["camera_ids"].tolist() if packed else [row // 20 for row in range(40)]
            wanted = []
            for camera in range(2):
                for top in range(down):
                    for left in range(across):
                        inside = [row for row in range(len(depths)) if cameras[row] == camera and min(radii[row]) > 0 and all(
                            abs(middle - place * 16 - 8) < radius + 8
                            for middle, radius, place in zip(means2d[row], radii[row], (left, top)))]
                        wanted.append(sorted(inside, key=lambda row: depths[row]))
            self.assertEqual(meta["flatten_ids"].tolist(), sum(wanted, []))
            self.assertEqual(tuple(meta["isect_offsets"].shape), (2, down, across))
            self.assertEqual(meta["isect_offsets"].flatten().tolist(), np.cumsum([0, *map(len, wanted[:-1])]).tolist())
            self.assertEqual(int(meta["tiles_per_gauss"].sum()), len(meta["isect_ids"]))

    @unittest.skipUnless("cuda" in DEVICES, "there is no PyTorch with a GPU, or gemsplat was built without CUDA")
    def test_the_host_does_not_wait(self):
        arrays = chosen(gaussians(device="cuda", dtype=torch.float32), *self.NAMES)
        given = {"viewmats": arrays["means"].new_tensor([VIEW]), "Ks": arrays["means"].new_tensor([K])}
        with without_waiting():
            for mode in ("RGB", "RGB+ED"):
                colors, alphas, _ = draw_by_gsplat(arrays, render_mode=mode, radius_clip=1.0, **given)
                (colors.sum() + alphas.sum()).backward()

    def test_a_model_of_nerfstudio_trains(self):
        """The call of splatfacto (nerfstudio 1.1, api 1.4) with a camera of its own, and what it and density control read."""
        gemsplat.compat.install("gsplat", api="1.4")
        self.addCleanup(gemsplat.compat.uninstall)
        from gsplat.rendering import rasterization

        pose = torch.tensor([[0.98, 0, -0.199, 0.2], [0, 1, 0, -0.1], [0.199, 0, 0.98, 3], [0, 0, 0, 1]])  # camera to world
        view = torch.linalg.inv(pose @ torch.diag(torch.tensor([1.0, -1, -1, 1])))  # its axes are those of OpenGL
        for device in DEVICES:
            given = gaussians(device=device, dtype=torch.float32)
            arrays = {"means": given["means"], "rotations": given["rotations"], "scales": given["scales"].log(),
                      "opacities": given["opacities"].clamp(max=0.9).logit(), "sh": given["sh"]}
            arrays = {name: array.detach().requires_grad_() for name, array in arrays.items()}
            matrices = {"viewmats": view[None].to(device), "Ks": torch.tensor([K], device=device)}
            background = torch.tensor(BACKGROUND, device=device)
            for mode, rule, degree in (("RGB", "classic", 3), ("RGB+ED", "antialiased", 1), ("RGB+ED", "classic", None)):
                with self.subTest(device, mode=mode, rule=rule, degree=degree):
                    colors = arrays["sh"] if degree is not None else arrays["sh"][:, 0].sigmoid()
                    scales, opacities = arrays["scales"].exp(), arrays["opacities"].sigmoid()
                    render, alpha, info = rasterization(
                        means=arrays["means"], quats=arrays["rotations"], scales=scales, opacities=opacities.squeeze(-1), colors=colors,
                        **matrices, width=WIDTH, height=HEIGHT, packed=False, near_plane=0.01, far_plane=1e10, render_mode=mode,
                        sh_degree=degree, sparse_grad=False, absgrad=True, rasterize_mode=rule)
                    info["means2d"].retain_grad()
                    image = render[:, ..., :3] + (1 - alpha) * background
                    self.assertEqual((image.shape, alpha.shape), ((1, HEIGHT, WIDTH, 3), (1, HEIGHT, WIDTH, 1)))
                    drawn = expected({"means": arrays["means"], "rotations": arrays["rotations"], "scales": scales,
                                      "opacities": opacities, **({"colors": colors} if degree is None else {"sh": colors})},
                                     ("image", "alpha", "depth"), near=0.01, viewmats=matrices["viewmats"][0],
                                     antialiased=rule == "antialiased", sh_degree=degree)
                    near(image[0], drawn.image, 1e-4)
                    if mode == "RGB+ED":
                        near(render[0, ..., 3], drawn.depth / drawn.alpha.clamp_min(1e-10), 1e-3)
                    slope = torch.autograd.grad(loss_of(drawn.image), list(arrays.values()), retain_graph=True)
                    loss_of(image[0]).backward()
                    for array, by_array in zip(arrays.values(), slope):
                        near_in_all(array.grad, by_array, 1e-3)
                        array.grad = None
                    means2d, radii = info["means2d"], info["radii"]
                    self.assertEqual((tuple(radii.shape), info["width"], info["height"], info["n_cameras"]), ((1, 20), WIDTH, HEIGHT, 1))
                    seen = radii > 0
                    self.assertGreater(int(seen.sum()), 5)
                    self.assertTrue((means2d.absgrad[seen] >= means2d.grad[seen].abs() * (1 - 1e-4) - 1e-6).all())
                    self.assertGreater(float(means2d.absgrad[seen].norm(dim=-1).max()), 0)

    def test_older_versions_have_one_radius(self):
        gemsplat.compat.install("gsplat", api="1.4")
        self.addCleanup(gemsplat.compat.uninstall)
        arrays = gaussians()
        _, _, meta = draw_by_gsplat(arrays)
        self.assertEqual(tuple(meta["radii"].shape), (1, 20))
        seen = meta["radii"] > 0
        xx, xy, yy = meta["conics"][seen].detach().unbind(-1)
        least = (xx + yy) / 2 - torch.hypot((xx - yy) / 2, xy)  # eigenvalue of the conic
        self.assertTrue(torch.equal(meta["radii"][seen], torch.ceil(3 / torch.sqrt(least)).int()))
        self.assertEqual(meta["isect_offsets"].shape, (1, 2, 3))

    def test_what_is_not_drawn_is_named(self):
        arrays = gaussians()
        for others in ({"camera_model": "ftheta"}, {"render_mode": "RGB+N"}, {"with_ut": True}, {"tile_size": 8},
                       {"radial_coeffs": torch.zeros(1, 6)}):
            with self.subTest(others), self.assertRaisesRegex(NotImplementedError, list(others)[0]):
                draw_by_gsplat(arrays, **others)
        draw_by_gsplat(arrays, with_ut=False, global_z_order=True, radial_coeffs=None, tile_size=None)
        self.assert_refused(r"viewmats must have the shape \(1, 4, 4\)", draw_by_gsplat, arrays, viewmats=torch.eye(3)[None])
        self.assert_refused(r"colors must have 16 coefficients or more for sh_degree=3, but have 9", draw_by_gsplat,
                            arrays, colors=arrays["sh"][:, :9], sh_degree=3)
        with self.assertRaisesRegex(ImportError, "DefaultStrategy is gsplat's own"):
            gsplat.DefaultStrategy


if __name__ == "__main__":
    unittest.main()
