# SPDX-License-Identifier: Apache-2.0
"""gemsplat.rasterize() and vjp() of CuPy arrays beside the exact renderer; without a GPU by stand-ins for both."""

import re
import unittest
from unittest import mock

try:
    import cupy
except ModuleNotFoundError:
    cupy = None

import numpy as np

import gemsplat
import stand_ins
from drawing import FORMS, HEIGHT, LENSES, SETTINGS, WIDTH, arrays_for, assert_as_exact, assert_near, draw, exact, weights_of_pictures
from support import SOURCE, TestCase


def has_gpu():
    try:
        return cupy is not None and cupy.cuda.runtime.getDeviceCount() > 0 and gemsplat.cuda_device_count() > 0
    except cupy.cuda.runtime.CUDARuntimeError:
        return False


def on_gpu(arrays):
    return {name: cupy.asarray(array) for name, array in arrays.items()}


def on_host(arrays):
    return {name: cupy.asnumpy(array) for name, array in arrays.items() if array is not None}


def pulled(arrays, outputs=("image", "alpha"), **settings):
    """The Rendering and the gradients of L, of CuPy."""
    rendering, pull = gemsplat.vjp(**arrays, width=WIDTH, height=HEIGHT, outputs=outputs, **settings)
    weights = weights_of_pictures(rendering)
    return rendering, pull(**{name: cupy.asarray(by, cupy.float32) for name, by in weights.items()})


@unittest.skipIf(has_gpu(), "CuPy itself is tested")
class StandInTest(TestCase):
    def test_pictures_and_gradients_are_those_of_numpy(self):
        module = stand_ins.cupy()
        with stand_ins.installed("gemsplat._cupy", cupy=module) as ours, mock.patch.object(
                ours, "GpuOperation", stand_ins.HostOperation), mock.patch("gemsplat._rasterize._backend_of", lambda _: ours):
            for form, others in FORMS.items():
                for settings in SETTINGS + LENSES:
                    with self.subTest(form, **settings):
                        arrays = arrays_for(100, **others)
                        given = {name: module.asarray(array) for name, array in arrays.items()}
                        rendering, pull = gemsplat.vjp(**given, width=WIDTH, height=HEIGHT, **{"outputs": ("image", "alpha"), **settings})
                        with mock.patch("gemsplat._rasterize._backend_of", lambda _: gemsplat._numpy):
                            assert_as_exact(self, arrays, rendering, pull(**weights_of_pictures(rendering)), **settings)


@unittest.skipUnless(has_gpu(), "there is no CuPy with a GPU, or gemsplat was built without CUDA")
class OnTheGpuTest(TestCase):
    def test_pictures_and_gradients_are_those_of_numpy(self):
        for form, others in FORMS.items():
            for settings in SETTINGS + LENSES:
                with self.subTest(form, **settings):
                    arrays = arrays_for(100, **others)
                    rendering, gradients = pulled(on_gpu(arrays), **settings)
                    self.assertIsInstance(gradients["means"], cupy.ndarray)
                    rendering = gemsplat.Rendering(**on_host(rendering._asdict()))
                    assert_as_exact(self, arrays, rendering, on_host(gradients), **settings)
                    again = draw(on_gpu(arrays), **settings)
                    for name, picture in on_host(again._asdict()).items():
                        assert_near(self, picture, getattr(rendering, name), 1e-6, f"{name} without gradients")

    def test_rows_are_those_of_numpy(self):
        names = ("visible", "radii", "means2d", "depths", "conics")
        arrays = arrays_for(100)
        expected, drawn = draw(arrays, names), draw(on_gpu(arrays), names)
        for name in names:
            array = cupy.asnumpy(getattr(drawn, name))
            self.assertEqual(array.dtype, getattr(expected, name).dtype, name)
            assert_near(self, array, getattr(expected, name), 0.02 if name == "radii" else 1e-4, name)

    def test_gradients_can_be_pulled_again(self):
        arrays = arrays_for(100)
        rendering, pull = gemsplat.vjp(**on_gpu(arrays), width=WIDTH, height=HEIGHT)
        by_image = cupy.asarray(weights_of_pictures(rendering)["image"], cupy.float32)
        first = on_host(pull(image=by_image))
        rendering.image.fill(7)  # the picture is the caller's
        for name, gradient in on_host(pull(image=by_image)).items():
            assert_near(self, gradient, first[name], 1e-5, name)

    def test_a_call_can_ask_for_the_same_bits(self):
        arrays = on_gpu(arrays_for(3000, means=np.random.default_rng(3).uniform(-0.3, 0.3, (3000, 3))))
        first = on_host(pulled(arrays, deterministic=True)[1])
        for _ in range(3):
            for name, gradient in on_host(pulled(arrays, deterministic=True)[1]).items():
                np.testing.assert_array_equal(gradient, first[name], name)

    def test_room_for_instances_saves_the_wait(self):
        arrays = arrays_for(100)
        rendering, gradients = pulled(on_gpu(arrays), max_instances=5000)
        self.assertFalse(bool(rendering.overflowed))
        assert_as_exact(self, arrays, gemsplat.Rendering(**on_host(rendering._asdict())), on_host(gradients))
        rendering, gradients = pulled(on_gpu(arrays), max_instances=1)
        self.assertTrue(bool(rendering.overflowed))
        self.assertEqual(float(abs(gradients["means"]).max()), 0)

    def test_the_current_stream_and_the_pool_are_used(self):
        arrays = arrays_for(100)
        expected, _ = exact(arrays)
        given = on_gpu(arrays)
        pool = cupy.get_default_memory_pool()
        cupy.cuda.runtime.deviceSynchronize()
        with cupy.cuda.Stream(non_blocking=True) as stream:
            for step in range(100):
                image = draw(given).image
                if step == 50:
                    held = pool.total_bytes()
            stream.synchronize()
            assert_near(self, cupy.asnumpy(image), expected.image, 1e-5, "image")
            self.assertEqual(pool.total_bytes(), held)
            before = pool.used_bytes()
            kept = gemsplat.vjp(**given, width=WIDTH, height=HEIGHT)
            self.assertGreater(pool.used_bytes(), before)
            del kept
            self.assertEqual(pool.used_bytes(), before)

    def test_the_guide_runs(self):
        pages = [(SOURCE / "docs" / "guide" / name).read_text() for name in ("differentiable.md", "jax.md")]
        names = {"cupy": cupy}
        exec(re.search(r"^```python\n(.*?)^```", pages[0], re.M | re.S)[1], names)
        exec(re.search(r"^## CuPy.*?^```py\n(.*?)^```", pages[1], re.M | re.S)[1], names)
        self.assertEqual(names["gradients"]["means"].shape, (100, 3))

    def test_nothing_to_draw_is_the_background(self):
        for count in (0, 3):
            with self.subTest(count):
                arrays = arrays_for(count, means=np.full((count, 3), -9))
                rendering, gradients = pulled(on_gpu(arrays))
                self.assertTrue(bool((rendering.image == cupy.asarray(arrays["background"])).all()))
                for name, gradient in gradients.items():
                    self.assertEqual(gradient.shape, arrays[name].shape)
                    self.assertEqual(float(abs(gradient).sum()) > 0, name == "background", name)

    def test_what_cannot_be_drawn_is_named(self):
        arrays = on_gpu(arrays_for(5))
        self.assert_refused("sh must hold real numbers", draw, {**arrays, "sh": arrays["sh"].astype(int)})
        self.assert_refused("depth or inverse_depth", draw, arrays, ("depth", "inverse_depth"))
        self.assert_refused("float64 are drawn on the CPU", draw,
                            {name: array.astype(cupy.float64) for name, array in arrays.items()})
        self.assert_refused("smooth", draw, arrays, smooth=True)
        self.assert_refused("NumPy", gemsplat.jvp, {**arrays, "width": WIDTH, "height": HEIGHT}, {})
        _, pull = gemsplat.vjp(**arrays, width=WIDTH, height=HEIGHT)
        self.assert_refused("which was not drawn", pull, depth=cupy.zeros((HEIGHT, WIDTH)))
        self.assert_refused("must have the shape", pull, image=cupy.zeros((HEIGHT, WIDTH)))


if __name__ == "__main__":
    unittest.main()
