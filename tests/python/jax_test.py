# SPDX-License-Identifier: Apache-2.0
"""gemsplat.rasterize() of JAX arrays beside the exact renderer, on the CPU and on a GPU; without JAX by a stand-in for it."""

import json
import os
import re
import subprocess
import sys
import unittest
from unittest import mock

try:
    import jax
    import jax.numpy as jnp
except ModuleNotFoundError:
    jax = None

import numpy as np

import gemsplat
import stand_ins
from drawing import (FORMS, HEIGHT, K, PICTURES, SETTINGS, VIEW, WIDTH, arrays_for, assert_as_exact, assert_near, draw, exact,
                     weights_of, weights_of_pictures)
from support import SOURCE, TestCase, camera


def gpus():
    try:
        return jax.devices("cuda") if jax and gemsplat.cuda_device_count() > 0 else []
    except RuntimeError:  # this jaxlib has no CUDA
        return []


@unittest.skipIf(jax, "JAX itself is tested")
class StandInTest(TestCase):
    def test_pictures_and_gradients_are_those_of_numpy(self):
        module = stand_ins.jax(str(self.folder))
        with stand_ins.installed("gemsplat._jax", jax=module, **{"jax.numpy": module.numpy}) as ours, mock.patch(
                "gemsplat._rasterize._backend_of", lambda _: ours):
            for form, others in FORMS.items():
                for settings in SETTINGS:
                    with self.subTest(form, **settings):
                        self._check(ours, arrays_for(100, **others), **settings)
            with mock.patch.multiple("gemsplat._gemsplat", cuda_device_count=lambda: 1, jax_kept_bytes=lambda call: call["count"]):
                self._check(ours, arrays_for(100), max_instances=9)
            arrays = {name: module.numpy.asarray(array) for name, array in arrays_for(100).items()}
            with self.assertRaisesRegex(RuntimeError, "width"):
                ours._draw.function(ours._draw.calls[0][0].replace('"width"', '"breadth"'), ours._draw.calls[0][1])
            drawn = draw(arrays, ("visible", "radii", "means2d", "depths", "conics"), max_instances=9)
            self.assertFalse(drawn.overflowed)
            with mock.patch("gemsplat._rasterize._backend_of", lambda _: gemsplat._numpy):
                expected = draw(arrays, ("visible", "radii", "means2d", "depths", "conics"))
            for name in ("visible", "radii", "means2d", "depths", "conics"):
                assert_near(self, getattr(drawn, name), getattr(expected, name), 1e-6, name)

    def _check(self, ours, arrays, **settings):
        ours._draw.calls.clear()
        rendering = draw({name: ours.jnp.asarray(array) for name, array in arrays.items()}, **settings)
        with mock.patch("gemsplat._rasterize._backend_of", lambda _: gemsplat._numpy):
            expected, by_exact = exact(arrays, **settings)
        for name, picture in expected._asdict().items():
            if name != "overflowed":
                self.assertEqual(getattr(rendering, name) is None, picture is None, name)
            if picture is not None:
                assert_near(self, getattr(rendering, name), picture, 1e-5, name)
        if settings.get("deterministic") and "features" in arrays:  # three at a time are drawn as colors
            passes = [json.loads(text) for text, _ in ours._draw.calls[1:]]
            self.assertEqual([call["deterministic"] and "colors" in call["wanted"] for call in passes],
                             [True] * -(-arrays["features"].shape[1] // 3))
        # What autograd does between the passes and the arguments is done by hand for a single pass.
        if len(ours._draw.calls) == 1:
            (text, given), = ours._draw.calls
            weights = weights_of_pictures(rendering)
            by = {"features": weights.get("features"), "depth": weights.get("depth", weights.get("inverse_depth"))}
            if "image" in weights:
                by["image"] = np.moveaxis(weights["image"], -1, 0)
                by["alpha"] = weights.get("alpha", 0) - weights["image"] @ np.float64(arrays["background"])
            shape = (HEIGHT, WIDTH)
            by = {name: np.asarray(np.zeros(shape) if value is None else value, np.float32) for name, value in by.items()}
            if "features" in given:
                by["features"] = ours._gpu.padded(by["features"], given["features"].shape[1], np)
            _, residuals = ours._draw_forward(text, given)
            self.assertEqual(len(residuals[1]), ("features" in given) + bool(settings.get("max_instances")))
            gradients, = ours._draw_backward(text, residuals, by)
            for name, gradient in by_exact.items():
                if name != "background":
                    found = gradients[name][:, :gradient.shape[1]] if name == "features" else gradients[name]
                    assert_near(self, found, gradient, 3e-4, name)


class Tests:
    """On self.device."""

    def setUp(self):
        super().setUp()
        here = jax.default_device(self.device)
        here.__enter__()
        self.addCleanup(here.__exit__, None, None, None)

    @staticmethod
    def loss_of(rendering):
        """L, whose gradients are weights_of_pictures()."""
        drawn = [getattr(rendering, name) for name in PICTURES]
        return sum((picture * weights_of(picture.shape).astype(np.float32)).sum() for picture in drawn if picture is not None)

    def loss(self, **settings):
        def of(arrays):
            rendering = draw(arrays, **settings)
            return self.loss_of(rendering), rendering

        return of

    def on_device(self, arrays):
        return {name: jax.device_put(array, self.device) for name, array in arrays.items()}

    @staticmethod
    def on_host(arrays):
        return {name: np.asarray(array) for name, array in arrays.items() if array is not None}

    def differentiated(self, arrays, wrap=lambda function: function, **settings):
        """The Rendering and the gradients of L, as NumPy arrays."""
        function = wrap(jax.grad(self.loss(**settings), has_aux=True))
        gradients, rendering = function(self.on_device(arrays))
        return gemsplat.Rendering(**self.on_host(rendering._asdict())), self.on_host(gradients)

    def test_pictures_and_gradients_are_those_of_numpy(self):
        for form, others in FORMS.items():
            for settings in SETTINGS:
                with self.subTest(form, **settings):
                    arrays = arrays_for(100, **others)
                    assert_as_exact(self, arrays, *self.differentiated(arrays, **settings), **settings)

    def test_jit_and_checkpoint_change_nothing(self):
        arrays = arrays_for(100, **FORMS["features"])
        settings = {"outputs": ("image", "alpha", "depth")}
        assert_as_exact(self, arrays, *self.differentiated(arrays, jax.jit, **settings), **settings)
        remat = jax.grad(jax.checkpoint(lambda arrays: self.loss(**settings)(arrays)[0]))
        _, expected = exact(arrays, **settings)
        for name, gradient in self.on_host(jax.jit(remat)(self.on_device(arrays))).items():
            assert_near(self, gradient, expected[name], 3e-4, name)

    def test_vmap_takes_one_camera_after_the_other(self):
        arrays = arrays_for(100)
        others = np.array([[[90, 0, 30], [0, 80, 20], [0, 0, 1]], K, K], np.float32)
        viewmats = np.array([VIEW, VIEW, np.eye(4)], np.float32)
        viewmats[1, 2, 3], viewmats[2, 2, 3] = 4, 5
        shared = {name: array for name, array in arrays.items() if name not in ("viewmats", "Ks", "screen")}

        def images(arrays, viewmats, Ks):
            return jax.vmap(lambda viewmat, K: draw({**arrays, "viewmats": viewmat, "Ks": K}).image)(viewmats, Ks)

        def loss(*given):
            drawn = images(*given)
            return (drawn * weights_of(drawn.shape).astype(np.float32)).sum()

        given = self.on_device(shared), *jax.device_put((viewmats, others), self.device)
        expected, by_exact = exact({**shared, "viewmats": viewmats, "Ks": others}, ("image",))
        assert_near(self, jax.jit(images)(*given), expected.image, 1e-5, "image")
        gradients, by_viewmats, by_Ks = jax.jit(jax.grad(loss, (0, 1, 2)))(*given)
        for name, gradient in {**gradients, "viewmats": by_viewmats, "Ks": by_Ks}.items():
            assert_near(self, gradient, by_exact[name], 3e-4, name)

    def test_cameras_are_taken_as_well(self):
        arrays = {name: array for name, array in arrays_for(100).items() if name not in ("viewmats", "Ks", "screen")}
        for cameras in (camera(), [camera(), camera(distance=5.0)]):
            expected = gemsplat.rasterize(**arrays, cameras=cameras).image
            drawn = jax.jit(lambda arrays: gemsplat.rasterize(**arrays, cameras=cameras).image)(self.on_device(arrays))
            assert_near(self, drawn, expected, 1e-5, "image")

    def test_rows_are_those_of_numpy(self):
        names = ("visible", "radii", "means2d", "depths", "conics")
        arrays = arrays_for(100)
        expected = draw(arrays, names)
        drawn = jax.jit(lambda arrays: draw(arrays, names))(self.on_device(arrays))
        for name in names:
            self.assertEqual(getattr(drawn, name).dtype, getattr(expected, name).dtype, name)
            assert_near(self, getattr(drawn, name), getattr(expected, name), 0.02 if name == "radii" else 1e-4, name)

    def test_lower_degrees_leave_the_higher_coefficients_alone(self):
        for degree in (0, 1):
            for form in ("as models are stored", "sh0 and sh_rest"):
                arrays = arrays_for(100, **FORMS[form])
                assert_as_exact(self, arrays, *self.differentiated(arrays, sh_degree=degree), sh_degree=degree)

    def test_absolute_shares_are_those_of_numpy(self):
        arrays = arrays_for(100, absolute_screen=np.zeros((100, 2)))
        assert_as_exact(self, arrays, *self.differentiated(arrays))

    def test_nothing_to_draw_is_the_background(self):
        for count in (0, 3):
            arrays = arrays_for(count, means=np.full((count, 3), -9))
            rendering, gradients = self.differentiated(arrays)
            np.testing.assert_allclose(rendering.image, np.broadcast_to(arrays["background"], rendering.image.shape), rtol=1e-6)
            for name, gradient in gradients.items():
                self.assertEqual(np.abs(gradient).sum() > 0, name == "background", name)

    def test_the_guide_runs(self):
        pages = [(SOURCE / "docs" / "guide" / name).read_text() for name in ("differentiable.md", "jax.md")]
        program = re.search(r"^```python\n(.*?)^```", pages[0], re.M | re.S)[1]
        names = {}
        exec(program, names)
        for text in re.findall(r"^```py\n(.*?)^```", pages[1].partition("## CuPy")[0], re.M | re.S):
            exec(text, names)
        self.assertEqual(names["by_arrays"]["means"].shape, (100, 3))

    def test_what_cannot_be_drawn_is_named(self):
        arrays = {name: jnp.asarray(array) for name, array in arrays_for(5).items()}
        self.assert_refused("sh must hold real numbers", draw, {**arrays, "sh": arrays["sh"].astype(int)})
        self.assert_refused("sh must have the shape", jax.jit(draw), {**arrays, "sh": arrays["sh"][:, :2]})
        self.assert_refused("depth or inverse_depth", draw, arrays, ("depth", "inverse_depth"))
        self.assert_refused("jax.vjp", gemsplat.vjp, **arrays, width=WIDTH, height=HEIGHT)
        self.assert_refused("NumPy", gemsplat.jvp, {**arrays, "width": WIDTH, "height": HEIGHT}, {})
        slope = jax.grad(lambda means: draw({**arrays, "means": means}).image.sum())
        with self.assertRaisesRegex(ValueError, "cannot be differentiated"):
            jax.grad(lambda means: slope(means).sum())(arrays["means"])


@unittest.skipUnless(jax, "JAX is not installed")
class OnTheCpuTest(Tests, TestCase):
    device = jax and jax.devices("cpu")[0]

    def test_the_example_fits_a_photo(self):
        printed = subprocess.run([sys.executable, str(SOURCE / "examples" / "fit_picture_jax.py"), "--steps", "60",
                                  "--output", str(self.folder / "fit.ppm")], check=True, capture_output=True, text=True,
                                 env={**os.environ, "JAX_PLATFORMS": "cpu"}).stdout
        before, after = map(float, re.search(r"(\d+\.\d) dB PSNR before, (\d+\.\d) dB after", printed).groups())
        self.assertGreater(after, before + 5)
        self.assertGreater((self.folder / "fit.ppm").stat().st_size, 2 * 32 * 32 * 3)

    def test_float64_is_drawn_on_the_cpu(self):
        code = ("import sys, numpy as np, jax; sys.path.insert(0, sys.argv[1]); jax.config.update('jax_enable_x64', True)\n"
                "import jax.numpy as jnp; from drawing import *\n"
                "arrays = {name: np.float64(array) for name, array in arrays_for(100).items()}\n"
                "loss = lambda arrays: (lambda image: (image * weights_of(image.shape)).sum())(draw(arrays, smooth=True).image)\n"
                "found = jax.grad(loss)({name: jnp.asarray(array) for name, array in arrays.items()})\n"
                "_, expected = exact(arrays, ('image',), smooth=True)\n"
                "print(max(float(np.abs(found[name] - expected[name]).max()) for name in expected))")
        printed = subprocess.run([sys.executable, "-c", code, str(SOURCE / "tests" / "python")], check=True, capture_output=True,
                                 text=True, env={**os.environ, "JAX_PLATFORMS": "cpu"}).stdout
        self.assertLess(float(printed), 1e-9)


@unittest.skipUnless(gpus(), "there is no JAX with a GPU, or gemsplat was built without CUDA")
class OnTheGpuTest(Tests, TestCase):
    device = next(iter(gpus()), None)

    def test_room_for_instances_saves_the_wait(self):
        arrays = arrays_for(100)
        for wrap in (jax.jit, lambda function: function):
            rendering, gradients = self.differentiated(arrays, wrap, max_instances=5000)
            self.assertFalse(rendering.overflowed)
            assert_as_exact(self, arrays, rendering, gradients)
            rendering, gradients = self.differentiated(arrays, wrap, max_instances=1)
            self.assertTrue(rendering.overflowed)
            self.assertEqual(np.abs(gradients["means"]).max(), 0)

    def test_a_call_can_ask_for_the_same_bits(self):
        arrays = arrays_for(3000, means=np.random.default_rng(3).uniform(-0.3, 0.3, (3000, 3)))
        _, first = self.differentiated(arrays, jax.jit, deterministic=True)
        for _ in range(3):
            for name, gradient in self.differentiated(arrays, jax.jit, deterministic=True)[1].items():
                np.testing.assert_array_equal(gradient, first[name], name)

    def test_long_lists_and_many_steps(self):
        crowd = arrays_for(3000, means=np.random.default_rng(3).uniform(-0.3, 0.3, (3000, 3)), logit_opacities=np.full(3000, -4.0))
        _, expected = exact(crowd)
        step = jax.jit(jax.grad(lambda arrays: self.loss()(arrays)[0]))
        given = self.on_device(crowd)
        sizes = []
        for index in range(60):
            gradients = jax.block_until_ready(step(given))
            if index % 20 == 19:
                sizes.append(self.device.memory_stats()["bytes_in_use"])
        self.assertEqual(sizes[1], sizes[2])
        for name, gradient in gradients.items():
            assert_near(self, gradient, expected[name], 1e-3, name)

    def test_what_a_gpu_does_not_draw_is_named(self):
        arrays = self.on_device(arrays_for(5))
        with self.assertRaisesRegex(Exception, "smooth is for arrays on the CPU"):
            jax.block_until_ready(draw(arrays, smooth=True).image)


if __name__ == "__main__":
    unittest.main()
