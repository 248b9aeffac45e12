# SPDX-License-Identifier: Apache-2.0
"""gemsplat.rasterize(), vjp() and jvp() of NumPy arrays: derivatives beside finite differences, pictures beside render()."""

import importlib.util
import os
import re
import subprocess
import sys
import unittest

import numpy as np

import gemsplat
from support import SOURCE, TestCase, camera, random_arrays

COUNT, WIDTH, HEIGHT = 8, 12, 9
ALL = ("image", "alpha", "depth", "inverse_depth")
ROWS = ("visible", "radii", "means2d", "depths", "conics")
RULES = ({"blend_rule": "faster_gs"}, {"blend_rule": "classic"}, {"smooth": True})
STEP = 1e-6  # of finite differences, which double then rounds at about 1e-10
TOLERANCE = 1e-7  # of a slope, beside the largest of its array


def look_at(random):
    """A view matrix and intrinsics of a camera that sees the cube of side 2 around the origin."""
    w, x, y, z = 1, *random.normal(size=3) * 0.1
    n = 2 / (w * w + x * x + y * y + z * z)
    viewmat = np.array([[1 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y), random.uniform(-0.2, 0.2)],
                        [n * (x * y + w * z), 1 - n * (x * x + z * z), n * (y * z - w * x), random.uniform(-0.2, 0.2)],
                        [n * (x * z - w * y), n * (y * z + w * x), 1 - n * (x * x + y * y), 3],
                        [0, 0, 0, 1]])
    return viewmat, np.array([[random.uniform(9, 13), 0, 5.5], [0, random.uniform(9, 13), 4.8], [0, 0, 1]])


def arguments(seed=1, views=None):
    """Arrays of float64 that rasterize() takes. views: None, one view without an axis."""
    random = np.random.default_rng(seed)
    pairs = [look_at(random) for _ in range(views or 1)]
    viewmats, Ks = (np.stack(matrices) if views else matrices[0] for matrices in zip(*pairs))
    return {"means": random.uniform(-1, 1, (COUNT, 3)), "rotations": random.normal(size=(COUNT, 4)),
            "log_scales": random.uniform(-2.5, -0.7, (COUNT, 3)), "logit_opacities": random.uniform(-2, 4, COUNT),
            "colors": random.uniform(0, 1, (COUNT, 3)), "viewmats": viewmats, "Ks": Ks, "width": WIDTH,
            "height": HEIGHT, "background": random.uniform(0, 1, 3), "outputs": ALL + ROWS}


def without(given, *names, **others):
    return {**{name: value for name, value in given.items() if name not in names}, **others}


def cases():
    """Arguments that together have every array in every form, and every setting."""
    random = np.random.default_rng(2)
    yield without(arguments(), "colors", sh0=random.normal(size=(COUNT, 3)), sh_rest=random.normal(size=(COUNT, 8, 3)) / 5,
                  features=random.normal(size=(COUNT, 5)), screen=random.normal(size=(COUNT, 2)))
    two = arguments(views=2)
    yield without(two, "log_scales", "logit_opacities", scales=np.exp(two["log_scales"]),
                  opacities=random.uniform(0.1, 1, (COUNT, 1)), colors=random.uniform(0, 1, (2, COUNT, 3)),
                  background=random.uniform(0, 1, (2, 3)), features=random.normal(size=(2, COUNT, 2)),
                  screen=np.zeros((2, COUNT, 2)), antialiased=True, blur=0.5)
    axes = random.normal(size=(COUNT, 3, 3)) / 4
    covariances = (axes @ axes.transpose(0, 2, 1))[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    yield without(two, "rotations", "log_scales", "colors", "background", covariances=covariances,
                  sh=random.normal(size=(COUNT, 16, 3)) / 2, sh_degree=2)
    yield {**arguments(), "camera_model": "fisheye"}
    yield {**arguments(), "camera_model": "ortho"}


def pictures_of(rendering):
    return {name: array for name, array in rendering._asdict().items() if name in (*ALL, "features") and array is not None}


def weights_of(rendering, seed=3):
    """dL/d(pictures) of an L that is linear in them."""
    random = np.random.default_rng(seed)
    return {name: random.normal(size=picture.shape) for name, picture in pictures_of(rendering).items()}


def inner(a, b):
    return sum(np.sum(a[name] * b[name]) for name in a)


def drawn_cases():
    """For each of cases() by each of RULES: the rule, arguments, Rendering, dL by its pictures, and dL by every array."""
    for case in cases():
        for rule in RULES:
            given = {**case, **rule}
            rendering, pull = gemsplat.vjp(**given)
            weights = weights_of(rendering)
            yield rule, given, rendering, weights, pull(**weights)


class Derivatives(TestCase):
    def test_every_gradient_is_that_of_finite_differences(self):
        seen = set()
        for rule, given, rendering, weights, gradients in drawn_cases():
            self.assertEqual(set(gradients), {name for name, value in given.items() if isinstance(value, np.ndarray)})
            for name, gradient in gradients.items():
                with self.subTest(name=name, **rule):
                    self.assertEqual((gradient.shape, gradient.dtype), (given[name].shape, np.float64))
                    expected = self.slopes(given, name, weights)
                    self.assertGreater(np.abs(expected).max(), 1e-3)
                    np.testing.assert_allclose(gradient, expected, rtol=0, atol=TOLERANCE * np.abs(expected).max())
            seen |= set(gradients)
        self.assertEqual(seen, {"means", "rotations", "scales", "log_scales", "covariances", "opacities", "logit_opacities",
                                "colors", "sh0", "sh_rest", "sh", "features", "viewmats", "Ks", "background", "screen"})

    def slopes(self, given, name, weights):
        slopes = np.zeros(given[name].shape)
        for at in np.ndindex(slopes.shape):
            for sign in (1, -1):
                moved = given[name].copy()
                moved[at] += sign * STEP
                pictures = pictures_of(gemsplat.rasterize(**{**given, name: moved}))
                slopes[at] += sign * inner(weights, pictures) / (2 * STEP)
        return slopes

    def test_forward_and_reverse_mode_agree(self):
        for rule, given, rendering, weights, gradients in drawn_cases():
            random = np.random.default_rng(4)
            tangents = {name: random.normal(size=gradient.shape) for name, gradient in gradients.items()}
            again, change = gemsplat.jvp(given, tangents)
            for name, picture in pictures_of(rendering).items():
                np.testing.assert_array_equal(getattr(again, name), picture)
            expected = inner(tangents, gradients)
            self.assertAlmostEqual(inner(weights, pictures_of(change)), expected, delta=1e-11 * abs(expected))
            self.assertIsNone(change.radii)

    def test_tangents_that_are_absent_are_zeros(self):
        given = next(cases())
        tangent = np.ones((COUNT, 3))
        zeros = {name: np.zeros(value.shape) for name, value in given.items() if isinstance(value, np.ndarray)}
        short, whole = (gemsplat.jvp(given, tangents)[1] for tangents in ({"sh0": tangent}, {**zeros, "sh0": tangent}))
        np.testing.assert_array_equal(short.image, whole.image)
        self.assertGreater(np.abs(short.image).max(), 0.1)

    def test_a_gradient_that_is_absent_counts_as_zeros_and_pull_may_be_called_again(self):
        rendering, pull = gemsplat.vjp(**arguments())
        weights = weights_of(rendering)
        whole, again = pull(**weights), pull(**weights)
        parts = [pull(**{name: weight}) for name, weight in weights.items()]
        for name, gradient in whole.items():
            np.testing.assert_array_equal(again[name], gradient)
            np.testing.assert_allclose(sum(part[name] for part in parts), gradient, rtol=1e-10, atol=1e-12)
        self.assertFalse(any(gradient.any() for gradient in pull().values()))

    def test_scales_of_zero_have_a_gradient_of_zero(self):
        flat = without(arguments(), "log_scales", scales=np.full((COUNT, 3), [0.3, 0.2, 0.0]))
        rendering, pull = gemsplat.vjp(**flat)
        gradients = pull(image=np.ones(rendering.image.shape))
        self.assertTrue(np.isfinite(gradients["scales"]).all())
        self.assertFalse(gradients["scales"][:, 2].any())
        self.assertTrue(gradients["scales"][:, :2].all())

    def test_the_number_of_threads_changes_no_bit(self):
        self.addCleanup(gemsplat.set_threads, 0)
        found = []
        for threads in (1, 3):
            gemsplat.set_threads(threads)
            rendering, pull = gemsplat.vjp(**next(cases()))
            found.append({**pictures_of(rendering), **{"dL " + name: gradient for name, gradient
                                                       in pull(**weights_of(rendering)).items()}})
        for name, array in found[0].items():
            np.testing.assert_array_equal(array, found[1][name], name)


class Pictures(TestCase):
    def test_the_image_is_that_of_render(self):
        arrays = random_arrays()
        model, seen = gemsplat.Model(**arrays), camera()
        for rule in ("faster_gs", "classic"):
            expected = gemsplat.render(model, seen, background=(0.1, 0.5, 0.9), blend_rule=rule, device="cpu")
            found = gemsplat.rasterize(**arrays, cameras=seen, background=[0.1, 0.5, 0.9], blend_rule=rule,
                                       outputs=("image", "alpha", "depth"))
            np.testing.assert_allclose(found.image, expected.color, atol=1e-4)
            np.testing.assert_allclose(found.alpha, expected.alpha, atol=1e-4)
            solid = expected.alpha > 0.1
            np.testing.assert_allclose((found.depth / np.maximum(found.alpha, 0.1))[solid], expected.depth[solid], rtol=1e-3)
            self.assertGreater(found.image.std(), 0.05)

    def test_fields_have_their_shapes_and_types(self):
        for dtype in (np.float32, np.float64):
            given = {name: value.astype(dtype) if isinstance(value, np.ndarray) else value
                     for name, value in list(cases())[1].items()}
            rendering, pull = gemsplat.vjp(**given)
            expected = {"image": (2, 9, 12, 3), "alpha": (2, 9, 12), "depth": (2, 9, 12), "inverse_depth": (2, 9, 12),
                        "features": (2, 9, 12, 2), "visible": (2, 8), "radii": (2, 8), "means2d": (2, 8, 2),
                        "depths": (2, 8), "conics": (2, 8, 3)}
            self.assertIsNone(rendering.overflowed)
            self.assertEqual({name: array.shape for name, array in rendering._asdict().items() if array is not None}, expected)
            np.testing.assert_array_equal(rendering.visible, rendering.radii > 0)
            self.assertLess(rendering.radii.min(), 5)  # small ones are visible, too
            types = {"visible": np.dtype(bool), "radii": np.dtype(np.int32)}
            for name in expected:
                array = getattr(rendering, name)
                self.assertEqual(array.dtype, types.get(name, dtype), name)
            self.assertEqual({gradient.dtype for gradient in pull(alpha=np.ones((2, 9, 12))).values()}, {np.dtype(dtype)})
        one = gemsplat.rasterize(**without(arguments(), outputs="alpha"))
        self.assertEqual(one.alpha.shape, (9, 12))
        self.assertEqual([name for name, array in one._asdict().items() if array is not None], ["alpha"])

    def test_views_are_drawn_as_each_alone(self):
        given = list(cases())[1]
        together, pull = gemsplat.vjp(**given)
        weights = weights_of(together)
        sums = {}
        per_view = {"viewmats", "Ks", "colors", "features", "background", "screen"}
        for view in range(2):
            alone, pull_alone = gemsplat.vjp(**{name: value[view] if name in per_view else value for name, value in given.items()})
            for name, array in alone._asdict().items():
                if array is not None:
                    np.testing.assert_array_equal(array, getattr(together, name)[view], name)
            for name, gradient in pull_alone(**{name: weight[view] for name, weight in weights.items()}).items():
                sums.setdefault(name, []).append(gradient)
        for name, gradient in pull(**weights).items():
            np.testing.assert_allclose(gradient, np.stack(sums[name]) if name in per_view else sum(sums[name]), rtol=1e-12,
                                       atol=1e-12)

    def test_cameras_are_their_matrices(self):
        cameras = [camera(WIDTH, HEIGHT, distance) for distance in (3.0, 4.0)]
        given = without(arguments(), "viewmats", "Ks", "width", "height")
        found = gemsplat.rasterize(**given, cameras=cameras)
        viewmats = np.stack([one.cam_from_world for one in cameras])
        Ks = np.stack([[[one.fx, 0, one.cx], [0, one.fy, one.cy], [0, 0, 1]] for one in cameras])
        expected = gemsplat.rasterize(**given, viewmats=viewmats, Ks=Ks, width=WIDTH, height=HEIGHT)
        np.testing.assert_array_equal(found.image, expected.image)
        np.testing.assert_array_equal(gemsplat.rasterize(**given, cameras=cameras[1]).image, expected.image[1])
        self.assertEqual(set(gemsplat.vjp(**given, cameras=cameras)[1]()) & {"viewmats", "Ks"}, set())

    def test_camera_models_project_as_their_equations_say(self):
        given = {**arguments(), "outputs": ROWS}
        viewmat, K = given["viewmats"], given["Ks"]
        x, y, z = viewmat[:3, :3] @ given["means"].T + viewmat[:3, 3:]
        r = np.hypot(x, y)
        for model, u in (("fisheye", np.arctan2(r, z) / r * [x, y]), ("ortho", np.array([x, y]))):
            rows = gemsplat.rasterize(**given, camera_model=model)
            seen = rows.visible
            self.assertGreater(seen.sum(), 3)
            expected = (K[:2, :2] @ u + K[:2, 2:]).T
            np.testing.assert_allclose(rows.means2d[seen], expected[seen], rtol=1e-9)
            np.testing.assert_allclose(rows.depths[seen], z[seen], rtol=1e-9)

    def test_cameras_are_drawn_through_their_lens(self):
        given = without(arguments(), "viewmats", "Ks", "width", "height", means=np.random.default_rng(1).normal(size=(COUNT, 3)))
        around = gemsplat.Camera(40, 40, 8, lens="fisheye")  # 143 degrees to the side
        self.assertEqual((around.lens, camera().lens), ("fisheye", "pinhole"))
        rows = gemsplat.rasterize(**given, cameras=around)
        behind = given["means"][:, 2] < 0
        self.assertTrue((rows.visible & behind).any())
        np.testing.assert_allclose(rows.depths[rows.visible], np.linalg.norm(given["means"], axis=1)[rows.visible], rtol=1e-6)
        parallel = gemsplat.Camera(40, 40, 8, cam_from_world=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 9]], lens="orthographic")
        drawn = gemsplat.rasterize(**given, cameras=[around, parallel])
        self.assertTrue(drawn.visible[1].all())
        np.testing.assert_array_equal(drawn.image[0], rows.image)
        bent = gemsplat.Camera(40, 40, 30, lens="opencv", distortion=(-0.2, 0.02, 0, 0))
        self.assertEqual(bent.lens, "radial_tangential")

    def test_absolute_shares_are_those_of_each_pixel(self):
        given = {**arguments(), "screen": np.zeros((COUNT, 2)), "absolute_screen": np.zeros((COUNT, 2))}
        _, pull = gemsplat.vjp(**given)
        weights = np.random.default_rng(5).normal(size=(HEIGHT, WIDTH, 3))
        expected = 0
        for y in range(HEIGHT):
            for x in range(WIDTH):
                of_pixel = np.zeros_like(weights)
                of_pixel[y, x] = weights[y, x]
                expected = expected + np.abs(pull(image=of_pixel)["screen"])
        np.testing.assert_allclose(pull(image=weights)["absolute_screen"], expected, rtol=1e-9, atol=1e-12)
        self.assertTrue((expected > np.abs(pull(image=weights)["screen"])).any())

    def test_what_is_known_of_a_gaussian_is_that_of_its_ellipse(self):
        given = {"rotations": [[1, 0, 0, 0]] * 3, "scales": [[0.2, 0.1, 0.1]] * 3, "opacities": [1, 1, 0.001],
                 "colors": [[1, 1, 1]] * 3, "cameras": camera(64, 48, 4.0), "outputs": ROWS}
        found = gemsplat.rasterize([[0, 0, 0], [9, 0, 0], [0, 0, 0]], **given)
        np.testing.assert_array_equal(found.visible, [True, False, False])  # one is beside the picture, one faint
        np.testing.assert_allclose(found.means2d[0], [32, 24])
        self.assertEqual(found.depths[0], 4)
        variances = np.array([3.0**2, 1.5**2]) + 0.3
        np.testing.assert_allclose(found.conics[0], [1 / variances[0], 0, 1 / variances[1]], rtol=1e-6)
        for settings, blur in (({"antialiased": True}, 0.1), ({"blur": 0.5}, 0.5), ({"antialiased": True, "blur": 0.7}, 0.7)):
            blurred = gemsplat.rasterize([[0, 0, 0]] * 3, **given, **settings)
            self.assertAlmostEqual(blurred.conics[0, 0], 1 / (3.0**2 + blur), places=6)
        self.assertEqual(found.radii[0], np.ceil(np.sqrt(2 * np.log(255) * variances[0])))
        for array in (found.radii, found.means2d, found.depths, found.conics):
            self.assertFalse(array[1:].any())

    def test_nothing_visible_shows_the_background_and_has_no_gradient(self):
        behind = {**next(cases()), "means": np.full((COUNT, 3), -50.0)}
        none = {name: value[:0] if isinstance(value, np.ndarray) and len(value) == COUNT else value
                for name, value in next(cases()).items()}
        self.assertEqual(none["sh_rest"].shape, (0, 8, 3))
        bad = {**behind, "means": np.full((COUNT, 3), np.nan)}
        for given in (behind, none, bad):
            rendering, pull = gemsplat.vjp(**given)
            np.testing.assert_array_equal(rendering.image, np.broadcast_to(given["background"], (HEIGHT, WIDTH, 3)))
            for name in ("alpha", "depth", "inverse_depth", "features", "visible", "radii", "means2d", "depths", "conics"):
                self.assertFalse(getattr(rendering, name).any(), name)
            gradients = pull(image=np.ones((HEIGHT, WIDTH, 3)))
            np.testing.assert_allclose(gradients.pop("background"), HEIGHT * WIDTH)
            for name, gradient in gradients.items():
                self.assertEqual(gradient.shape, given[name].shape)
                self.assertFalse(gradient.any(), name)

    def test_an_image_needs_colors_and_other_pictures_do_not(self):
        given = without(arguments(), "colors", outputs=("alpha", "depth"))
        np.testing.assert_array_equal(gemsplat.rasterize(**given).depth, gemsplat.rasterize(**arguments()).depth)
        features = {**given, "outputs": (), "features": arguments()["colors"]}
        found = gemsplat.rasterize(**features)
        expected = gemsplat.rasterize(**without(arguments(), "background")).image
        np.testing.assert_allclose(found.features, expected, rtol=1e-14)
        self.assertIsNone(found.alpha)

    def test_a_smooth_picture_keeps_what_is_faint(self):
        given = {"means": [[0, 0, 0]], "rotations": [[1, 0, 0, 0]], "scales": [[0.1, 0.1, 0.1]], "opacities": [0.002],
                 "colors": [[1, 1, 1]], "cameras": camera(64, 48, 4.0)}
        self.assertFalse(gemsplat.rasterize(**given).image.any())
        self.assertAlmostEqual(gemsplat.rasterize(**given, smooth=True).image.max(), 0.002, delta=2e-4)


class Refusals(TestCase):
    def refuse(self, pattern, *absent, **others):
        self.assert_refused(pattern, gemsplat.rasterize, **without(arguments(), *absent, **others))

    def test_one_of_each_group_is_given(self):
        refuse, zeros = self.refuse, np.zeros
        refuse("give one of scales, log_scales and covariances, and not scales and log_scales", scales=zeros((COUNT, 3)))
        refuse("give one of opacities and logit_opacities, and not none", "logit_opacities")
        refuse("give one of colors, sh0 and sh, and not colors and sh", sh=zeros((COUNT, 4, 3)))
        refuse("give one of colors, sh0 and sh, and not none", "colors")
        refuse("rotations are missing", "rotations")
        refuse("covariances hold their rotation already", "log_scales", covariances=zeros((COUNT, 6)))
        refuse("sh_rest goes with sh0", sh_rest=zeros((COUNT, 3, 3)))
        refuse("sh_degree goes with sh0 or sh", sh_degree=1)
        refuse("nothing to draw", outputs=())

    def test_views_are_given_in_one_way_and_one_size(self):
        refuse, one = self.refuse, camera()
        refuse("give cameras, or viewmats, Ks, width and height, and not cameras, viewmats, Ks, width and height", cameras=one)
        refuse("give cameras, .* and not viewmats, Ks and height", "width")
        refuse("give cameras, .* and not none", "viewmats", "Ks", "width", "height")
        alone = ("viewmats", "Ks", "width", "height")
        refuse("pictures of one size, but have 64x48 and 32x48", *alone, cameras=[one, camera(32)])
        refuse("cameras must be a gemsplat.Camera or a list of them", *alone, cameras=[])
        refuse("cameras must be a gemsplat.Camera or a list of them", *alone, cameras=np.eye(4))
        refuse("cameras must be a gemsplat.Camera or a list of them", *alone, cameras=5)
        refuse("width must be a number of pixels, and not 4.5", width=4.5)
        refuse("height must lie between 1 and 65520 pixels, but is 0", height=0)
        refuse("camera_model takes pinhole, fisheye or ortho, and not 'ftheta'", camera_model="ftheta")
        refuse("cameras have lenses of their own", *alone, cameras=one, camera_model="ortho")
        self.assert_refused("lens must be one of pinhole, opencv, fisheye, orthographic", gemsplat.Camera, 8, 8, 9, lens="toy")
        self.assert_refused("distortion must be 4 finite numbers", gemsplat.Camera, 8, 8, 9, lens="fisheye", distortion=[1])

    def test_shapes_are_named_as_they_are_and_as_they_should_be(self):
        refuse, zeros = self.refuse, np.zeros
        for pattern, name, shape in [
                (r"means must have the shape \(N, 3\), but has \(8, 2\)", "means", (8, 2)),
                (r"log_scales must have the shape \(8, 3\), but has \(7, 3\)", "log_scales", (7, 3)),
                (r"logit_opacities must have the shape \(8,\) or \(8, 1\), but has \(8, 2\)", "logit_opacities", (8, 2)),
                (r"features must have the shape \(8, D\) with D of at least 1, but has \(8, 0\)", "features", (8, 0)),
                (r"background must have the shape \(3,\), but has \(1, 3\)", "background", (1, 3)),
                (r"viewmats must have the shape \(4, 4\), but has \(3, 4\)", "viewmats", (3, 4)),
                (r"Ks must have the shape \(3, 3\), but has \(1, 3, 3\)", "Ks", (1, 3, 3)),
                (r"screen must have the shape \(8, 2\), but has \(1, 8, 2\)", "screen", (1, 8, 2))]:
            refuse(pattern, **{name: zeros(shape)})
        refuse(r"sh must have the shape \(8, K, 3\) with K of 1, 4, 9 or 16, but has \(8, 5, 3\)", "colors", sh=zeros((8, 5, 3)))
        refuse(r"sh_rest must have the shape \(8, R, 3\) with R of 0, 3, 8 or 15", "colors", sh0=zeros((8, 3)),
               sh_rest=zeros((8, 2, 3)))
        refuse("sh_degree must lie between 0 and 1, the degree of sh, but is 2", "colors", sh=zeros((8, 4, 3)), sh_degree=2)
        two = arguments(views=2)
        self.assert_refused(r"colors must have the shape \(8, 3\) or \(2, 8, 3\), but has \(3, 8, 3\)", gemsplat.rasterize,
                            **{**two, "colors": zeros((3, 8, 3))})
        self.assert_refused(r"screen must have the shape \(2, 8, 2\)", gemsplat.rasterize, **two, screen=zeros((8, 2)))

    def test_settings_and_types_are_checked(self):
        refuse = self.refuse
        refuse("outputs takes image, alpha, .* and conics, and not 'normals'", outputs=("image", "normals"))
        refuse("features are drawn wherever they are given", outputs="features")
        refuse("and not None", outputs=None)
        refuse("near must be less than far, but they are 5 and 2", near=5, far=2)
        refuse("blur must be above 0 and fit 32 bits, but is 0", blur=0)
        refuse("near must be a number, and not 'x'", near="x")
        refuse("blend_rule takes faster_gs or classic, and not 'other'", blend_rule="other")
        refuse("smooth must be True or False, and not 2", smooth=2)
        refuse("deterministic must be True, False or None, and not 2", deterministic=2)
        refuse("means must hold real numbers, but is of dtype complex128", means=np.zeros((COUNT, 3), complex))
        refuse("rotations is not an array", rotations=[[1, 2], [1]])
        refuse("means is a builtins.dict, which cannot be drawn; give a NumPy array", means={})

    def test_gradients_and_changes_must_fit(self):
        given = {**arguments(), "outputs": ("image",)}
        _, pull = gemsplat.vjp(**given)
        self.assert_refused("no gradient by depth, which was not drawn", pull, depth=np.zeros((HEIGHT, WIDTH)))
        self.assert_refused(r"of image must have the shape \(9, 12, 3\), but has \(9, 12\)", pull, image=np.zeros((9, 12)))
        self.assert_refused("tangents has sh, which is not among the arrays", gemsplat.jvp, given, {"sh": 0})
        self.assert_refused(r"of means must have the shape \(8, 3\), but has \(3,\)", gemsplat.jvp, given, {"means": np.zeros(3)})
        with self.assertRaisesRegex(TypeError, "unexpected keyword argument 'scale'"):
            gemsplat.vjp(**given, scale=1)


class Example(TestCase):
    def test_the_example_fits_a_photo(self):
        if importlib.util.find_spec("scipy") is None:
            self.skipTest(f"{sys.executable} has no SciPy; Debian's package is python3-scipy")
        picture = self.folder / "fit.ppm"
        done = subprocess.run([sys.executable, SOURCE / "examples" / "fit_picture.py", "--output", picture],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        before, after = map(float, re.findall(r"(\d+\.\d) dB", done.stdout))
        self.assertLess(before, 15)
        self.assertGreater(after, 23)
        self.assertEqual(len(picture.read_bytes()), len(b"P6\n64 32\n255\n") + 64 * 32 * 3)

    def test_levenberg_marquardt_and_adam_both_lower_the_loss(self):
        if importlib.util.find_spec("scipy") is None:
            self.skipTest(f"{sys.executable} has no SciPy; Debian's package is python3-scipy")
        table = self.folder / "finish.csv"
        done = subprocess.run([sys.executable, SOURCE / "examples" / "levenberg_marquardt.py", "--resolution", "24", "--photos", "2",
                               "--gaussians", "60", "--steps", "30", "--seconds", "0.1", "--output", table],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        rows = [line.split(",") for line in table.read_text().split()[1:]]
        for method in ("levenberg_marquardt", "adam"):
            losses = [float(loss) for name, _, loss, _ in rows if name == method]
            self.assertGreater(len(losses), 1)
            self.assertLess(losses[-1], losses[0], method)


class Imports(TestCase):
    def test_no_framework_is_imported(self):
        frameworks = ("torch", "jax", "cupy")
        for name in frameworks:
            (self.folder / f"{name}.py").write_text("")  # there for whoever imports it
        script = ("import gemsplat, sys\n"
                  "gemsplat.rasterize([[0, 0, 1]], covariances=[[1, 0, 0, 1, 0, 1]], opacities=[1], colors=[[1, 1, 1]],\n"
                  "                   cameras=gemsplat.Camera(8, 8, 8))\n"
                  "print(*sorted(sys.modules))\n")
        path = os.pathsep.join([str(self.folder), *filter(None, [os.environ.get("PYTHONPATH")])])
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path})
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("gemsplat._numpy", done.stdout.split())
        self.assertEqual(set(frameworks) & set(done.stdout.split()), set())


if __name__ == "__main__":
    unittest.main()
