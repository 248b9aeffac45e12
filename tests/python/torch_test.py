# SPDX-License-Identifier: Apache-2.0
"""gemsplat.rasterize() of PyTorch tensors: gradients on the CPU beside finite differences, and the GPU beside the CPU."""

import os
import re
import subprocess
import sys
import threading
import unittest

try:
    import torch
except ModuleNotFoundError:
    torch = None

import numpy as np

import gemsplat
from drawing import FORMS, HEIGHT, LENSES, SETTINGS, WIDTH, arrays_for, draw
from gemsplat._rasterize import CheckedView
from support import SOURCE, TestCase

HAS_GPU = torch is not None and torch.cuda.is_available() and gemsplat.cuda_device_count() > 0


def arguments(count, device="cpu", dtype=None, seed=1, **others):
    """Tensors that rasterize() takes, with gradients."""
    return {name: torch.tensor(array, dtype=dtype or torch.float32, device=device, requires_grad=True)
            for name, array in arrays_for(count, seed, **others).items()}


def loss_of(rendering):
    """A number that depends on every pixel in a way of its own, made of whichever pictures there are."""
    total = 0
    for picture in (rendering.image, rendering.alpha, rendering.depth, rendering.inverse_depth, rendering.features):
        if picture is not None:
            weights = torch.sin(torch.arange(picture.numel(), device=picture.device, dtype=picture.dtype))
            total = total + (picture * weights.view(picture.shape)).sum()
    return total


def gradients(arrays, outputs=("image", "alpha"), **settings):
    """The pictures, and the gradients by every array."""
    rendering = draw(arrays, outputs, **settings)
    return rendering, dict(zip(arrays, torch.autograd.grad(loss_of(rendering), list(arrays.values()))))


@unittest.skipUnless(torch, "PyTorch is not installed")
class OnTheCpuTest(TestCase):
    def test_gradcheck_finds_every_input_right(self):
        arrays = arguments(6, dtype=torch.float64)
        arrays["Ks"] = arrays["Ks"].detach()[:2] / 6
        arrays["Ks"] = torch.cat([arrays["Ks"], arrays["Ks"].new_tensor([[0, 0, 1]])]).requires_grad_()

        def pictures(*tensors):
            drawn = draw(dict(zip(arrays, tensors)), ("image", "alpha", "depth"), 12, 9, smooth=True)
            return drawn.image, drawn.alpha, drawn.depth

        self.assertTrue(torch.autograd.gradcheck(pictures, tuple(arrays.values()), eps=1e-6, atol=1e-6))

    def test_numpy_has_the_same_pictures(self):
        arrays = arguments(30)
        drawn = draw(arrays)
        expected = draw({name: tensor.detach().numpy() for name, tensor in arrays.items()})
        np.testing.assert_array_equal(drawn.image.detach().numpy(), expected.image)

    def test_the_example_fits_a_photo(self):
        printed = subprocess.run([sys.executable, str(SOURCE / "examples" / "fit_picture_torch.py"), "--steps", "60",
                                  "--output", str(self.folder / "fit.ppm")], check=True, capture_output=True, text=True,
                                 env={**os.environ, "CUDA_VISIBLE_DEVICES": ""}).stdout
        before, after = map(float, re.search(r"(\d+\.\d) dB before, (\d+\.\d) after", printed).groups())
        self.assertGreater(after, before + 8)
        self.assertGreater((self.folder / "fit.ppm").stat().st_size, 60 * 45 * 3)

    def test_the_example_shrinks_a_model(self):
        courtyard = SOURCE / "examples" / "courtyard"
        scene = gemsplat.Scene.load(courtyard, eval=True, resolution=24)
        trained = self.folder / "trained.ply"
        gemsplat.train(scene, {"density.max_gaussians": 300}, iterations=60, device="cpu").model.save(trained)

        def shrunk(method, *flags):
            file = self.folder / f"{method}.ply"
            printed = subprocess.run(
                [sys.executable, str(SOURCE / "examples" / "shrink_model.py"), method, str(trained), str(courtyard),
                 "--output", str(file), "--steps", "60", "--resolution", "24", *flags],
                check=True, capture_output=True, text=True, env={**os.environ, "CUDA_VISIBLE_DEVICES": ""}).stdout
            before, after = map(float, re.findall(r"(\d+\.\d+) dB", printed))
            self.assertGreater(after, before - 0.1, printed)
            return gemsplat.load(file)

        count = len(gemsplat.load(trained))
        masked = shrunk("masks", "--rate", "0.3", "--weight", "0.01")
        self.assertLess(len(masked), 0.7 * count)
        self.assertGreater(len(masked), 0.3 * count)
        self.assertLess(np.count_nonzero(masked.sh_rest), 0.2 * masked.sh_rest.size)
        distilled = shrunk("distill", "--degree", "1")
        self.assertEqual(distilled.sh_rest.shape, (count, 3, 3))
        np.testing.assert_array_equal(distilled.logit_opacities, gemsplat.load(trained).logit_opacities)

    def test_a_second_derivative_is_refused(self):
        arrays = arguments(6)
        slope, = torch.autograd.grad(loss_of(draw(arrays)) ** 2, arrays["means"], create_graph=True)
        with self.assertRaisesRegex(RuntimeError, "once_differentiable"):
            slope.sum().backward()

    def test_what_cannot_be_drawn_is_named(self):
        arrays = arguments(6)
        with self.assertRaisesRegex(gemsplat.UsageError, "sh must hold real numbers"):
            draw({**arrays, "sh": arrays["sh"].detach().to(torch.int32)})
        with self.assertRaisesRegex(gemsplat.UsageError, "vjp"):
            gemsplat.vjp(**arrays, width=WIDTH, height=HEIGHT)


@unittest.skipUnless(HAS_GPU, "there is no PyTorch with a GPU, or gemsplat was built without CUDA")
class OnTheGpuTest(TestCase):
    def assert_near(self, tensor, expected, tolerance, name):
        tensor, expected = tensor.detach().double().cpu(), expected.detach().double()
        difference = torch.linalg.vector_norm(tensor - expected)
        self.assertLessEqual(float(difference), tolerance * max(1e-6, float(torch.linalg.vector_norm(expected))), name)

    def test_pictures_and_gradients_are_those_of_the_cpu(self):
        for form, others in FORMS.items():
            for settings in SETTINGS + LENSES:
                with self.subTest(form, **settings):
                    expected, by_cpu = gradients(arguments(100, dtype=torch.float64, **others), **settings)
                    drawn, by_gpu = gradients(arguments(100, "cuda", **others), **settings)
                    for name, picture in expected._asdict().items():
                        if picture is not None:
                            self.assert_near(getattr(drawn, name), picture, 1e-5, name)
                    for name, gradient in by_cpu.items():
                        self.assert_near(by_gpu[name], gradient, 3e-4, name)

    def test_long_lists_have_checkpoints(self):
        names = ("image", "alpha", "depth")
        crowd = {"means": np.random.default_rng(3).uniform(-0.3, 0.3, (3000, 3)), "logit_opacities": np.full(3000, -4.0)}
        expected, by_cpu = gradients(arguments(3000, dtype=torch.float64, **crowd), names)
        drawn, by_gpu = gradients(arguments(3000, "cuda", **crowd), names)
        self.assert_near(drawn.depth, expected.depth, 1e-5, "depth")
        for name, gradient in by_cpu.items():
            self.assert_near(by_gpu[name], gradient, 1e-3, name)

    def test_rows_are_those_of_the_cpu(self):
        names = ("visible", "radii", "means2d", "depths", "conics")
        expected = draw(arguments(100, dtype=torch.float64), names)
        drawn = draw(arguments(100, "cuda"), names)
        for name in names:
            self.assert_near(getattr(drawn, name), getattr(expected, name), 1e-4 if name != "radii" else 0.02, name)

    def test_footprints_by_the_rules_of_others_are_those_of_the_cpu(self):
        for others in ({}, FORMS["activated"], FORMS["covariances"]):
            for shape, settings in (("square", {"tile": 16}), ("box", {"clip": 2.0, "antialiased": True}), ("box", {"far": 3.2})):
                with self.subTest(shape, given=[*others], **settings):
                    expected, found = (
                        CheckedView(width=WIDTH, height=HEIGHT, outputs="alpha", **{**given, "screen": None},
                              **{name: value for name, value in settings.items() if name not in ("tile", "clip")}).footprints(
                                  shape, **{name: value for name, value in settings.items() if name in ("tile", "clip")})
                        for given in (arguments(100, dtype=torch.float64, **others), arguments(100, "cuda", **others)))
                    seen = (expected.radii > 0).all(-1)
                    both = seen & (found.radii.cpu() > 0).all(-1)
                    self.assertGreater(int(both.sum()), 30)
                    self.assertLess(int((seen != (found.radii.cpu() > 0).all(-1)).sum()), 3)  # of radii near a limit
                    self.assertLessEqual(int((expected.radii - found.radii.cpu())[both].abs().max()), 1)
                    for name in ("means2d", "depths", "conics", "compensations"):
                        self.assert_near(getattr(found, name).cpu()[both], getattr(expected, name)[both], 1e-4, name)

    def test_the_guide_runs(self):
        page = (SOURCE / "docs" / "guide" / "differentiable.md").read_text()
        programs = re.findall(r"^```(python|py)\n(.*?)^```", page, re.M | re.S)
        names = {"torch": torch}
        exec(programs[0][1], names)
        exec(next(text for kind, text in programs if kind == "py"), names)
        self.assertEqual(names["tensors"]["means"].grad.shape, (100, 3))

    def test_absolute_shares_are_those_of_the_cpu(self):
        zeros = {"absolute_screen": np.zeros((100, 2))}
        _, by_cpu = gradients(arguments(100, dtype=torch.float64, **zeros))
        _, by_gpu = gradients(arguments(100, "cuda", **zeros))
        self.assert_near(by_gpu["absolute_screen"], by_cpu["absolute_screen"], 3e-4, "absolute_screen")
        self.assertGreater(float(by_cpu["absolute_screen"].sum()), float(by_cpu["screen"].abs().sum()))

    def test_room_for_instances_saves_the_wait(self):
        arrays = arguments(100, "cuda")
        expected, slopes = gradients(arrays)
        self.assertIsNone(expected.overflowed)
        drawn, with_room = gradients(arrays, max_instances=5000)
        self.assertTrue(torch.equal(drawn.image, expected.image))
        self.assertFalse(bool(drawn.overflowed))
        for name, slope in slopes.items():
            self.assert_near(with_room[name], slope.cpu(), 1e-5, name)
        for room in (1, 20):
            drawn, with_room = gradients(arrays, max_instances=room)
            self.assertTrue(bool(drawn.overflowed))
            self.assertEqual(float(with_room["means"].abs().max()), 0)

    def test_a_cuda_graph_repeats_a_step(self):
        arrays = arguments(100, "cuda")
        tensors = list(arrays.values())

        def step():
            return torch.autograd.grad(loss_of(draw(arrays, max_instances=5000)), tensors)

        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(3):
                step()
        torch.cuda.current_stream().wait_stream(stream)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            recorded = step()
        for seed in range(2, 30):
            others = arguments(100, "cuda", seed=seed)
            with torch.no_grad():
                for name, tensor in arrays.items():
                    tensor.copy_(others[name])
            graph.replay()
            for name, slope, expected in zip(arrays, recorded, gradients(others)[1].values()):
                self.assert_near(slope, expected.cpu(), 1e-4, name)

    def test_lower_degrees_leave_the_higher_coefficients_alone(self):
        arrays = arguments(100, "cuda")
        _, slopes = gradients(arrays, sh_degree=1)
        self.assertEqual(float(slopes["sh"][:, 4:].abs().max()), 0)
        self.assertGreater(float(slopes["sh"][:, :4].abs().max()), 0)

    def test_gradients_can_be_asked_for_again(self):
        torch.use_deterministic_algorithms(True, warn_only=True)
        try:
            arrays = arguments(100, "cuda")
            loss = loss_of(draw(arrays))
            tensors = list(arrays.values())
            first = torch.autograd.grad(loss, tensors, retain_graph=True)
            again = torch.autograd.grad(loss, tensors)
            anew = torch.autograd.grad(loss_of(draw(arrays)), tensors)
        finally:
            torch.use_deterministic_algorithms(False)
        for others in (again, anew):
            for one, other in zip(first, others):
                self.assertTrue(torch.equal(one, other))

    def test_a_call_can_ask_for_the_same_bits(self):
        arrays = arguments(3000, "cuda", means=np.random.default_rng(3).uniform(-0.3, 0.3, (3000, 3)))
        _, first = gradients(arrays, deterministic=True)
        for _ in range(3):
            for name, slope in gradients(arrays, deterministic=True)[1].items():
                self.assertTrue(torch.equal(slope, first[name]), name)

    def test_saved_tensors_may_be_moved(self):
        arrays = arguments(100, "cuda")
        _, expected = gradients(arrays)
        with torch.autograd.graph.save_on_cpu():
            loss = loss_of(draw(arrays))
        for name, slope in zip(arrays, torch.autograd.grad(loss, list(arrays.values()))):
            self.assert_near(slope, expected[name].cpu(), 1e-5, name)

    def test_pictures_may_be_changed_in_place(self):
        arrays = arguments(100, "cuda")
        _, expected = gradients(arrays)
        rendering = draw(arrays)
        loss = loss_of(rendering)
        with torch.no_grad():
            rendering.image.fill_(7)
        slopes = torch.autograd.grad(loss, list(arrays.values()))
        for name, slope in zip(arrays, slopes):
            self.assert_near(slope, expected[name].cpu(), 1e-5, name)

    def test_arrays_with_gaps_need_no_copy_and_give_the_same(self):
        arrays = arguments(100, "cuda")
        expected = draw(arrays).image
        table = torch.full((100, 80), float("nan"), device="cuda")
        spread = dict(arrays)
        begin = 0
        for name in ("means", "rotations", "log_scales", "sh"):
            size = arrays[name][0].numel()
            table[:, begin:begin + size] = arrays[name].detach().reshape(100, size)
            spread[name] = table[:, begin:begin + size].unflatten(1, arrays[name].shape[1:]) if name == "sh" else table[:, begin:begin + size]
            begin += size
        self.assertTrue(torch.equal(draw(spread).image, expected))

    def test_nothing_to_draw_is_the_background(self):
        for count in (0, 3):
            with self.subTest(count):
                arrays = arguments(count, "cuda", means=np.full((count, 3), -9))
                rendering, slopes = gradients(arrays)
                self.assertTrue(torch.equal(rendering.image, arrays["background"].expand_as(rendering.image)))
                for name, slope in slopes.items():
                    self.assertEqual(slope.shape, arrays[name].shape)
                    self.assertEqual(float(slope.abs().sum()) > 0, name == "background")

    def test_rows_of_no_numbers_are_not_drawn(self):
        arrays = arguments(100, "cuda")
        with torch.no_grad():
            arrays["means"][3] = float("nan")
            arrays["log_scales"][5] = float("inf")
            arrays["sh"][7, 0] = float("nan")
        rendering, slopes = gradients(arrays)
        self.assertTrue(torch.isfinite(rendering.image).all())
        for name, slope in slopes.items():
            self.assertTrue(torch.isfinite(slope).all(), name)

    def test_threads_on_streams_of_their_own_do_not_meet(self):
        expected = [draw(arguments(100, "cuda", seed=seed)).image.detach() for seed in (1, 2)]
        torch.cuda.synchronize()
        failures = []

        def work(index):
            arrays = arguments(100, "cuda", seed=index + 1)
            torch.cuda.synchronize()
            with torch.cuda.stream(torch.cuda.Stream()):
                for _ in range(100):
                    image = draw(arrays).image
                    image.sum().backward()
                    if not torch.equal(image, expected[index]):
                        failures.append(index)

        threads = [threading.Thread(target=work, args=(index,)) for index in (0, 1)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(failures, [])

    def test_steps_take_no_more_memory_as_time_goes_by(self):
        arrays = arguments(100, "cuda")
        sizes = []
        for step in range(300):
            loss_of(draw(arrays)).backward()
            if step % 100 == 99:
                torch.cuda.synchronize()
                sizes.append((torch.cuda.memory_allocated(), torch.cuda.memory_reserved()))
        self.assertEqual(sizes[1], sizes[2])

    def test_pictures_without_gradients_are_the_same(self):
        arrays = arguments(100, "cuda", **FORMS["many features"])
        expected = draw(arrays)
        with torch.no_grad():
            drawn = draw(arrays)
        for name in ("image", "features"):
            self.assert_near(getattr(drawn, name), getattr(expected, name).detach().cpu(), 1e-6, name)

    def test_what_a_gpu_does_not_draw_is_named(self):
        with self.assertRaisesRegex(gemsplat.UsageError, "float64 are drawn on the CPU"):
            draw(arguments(5, "cuda", dtype=torch.float64))
        with self.assertRaisesRegex(gemsplat.UsageError, "background is on cpu, but means on cuda:0"):
            draw({**arguments(5, "cuda"), "background": torch.zeros(3)})
        with self.assertRaisesRegex(gemsplat.UsageError, "depth or inverse_depth"):
            draw(arguments(5, "cuda"), ("depth", "inverse_depth"))


@unittest.skipUnless(hasattr(torch, "library") and hasattr(torch.library, "custom_op"), "there is no PyTorch of 2.4 or later")
class CompiledTest(TestCase):
    DEVICES = ["cpu"] + ["cuda"] * HAS_GPU
    OUTPUTS = ("image", "alpha", "inverse_depth", "visible", "radii", "means2d")

    def compiled(self, function, fullgraph=True):
        torch._dynamo.reset()
        return torch.compile(function, backend="aot_eager", fullgraph=fullgraph)

    def assert_same(self, found, expected, device):
        """Bit by bit on the CPU; the sums of a GPU have no order."""
        for one, other in zip(found, expected):
            if one is not None and other is not None:
                tolerance = 0 if device == "cpu" else 1e-4 * float(other.abs().max()) if other.is_floating_point() else 0
                torch.testing.assert_close(one, other, rtol=0, atol=tolerance)

    def assert_compiles(self, device, arrays, fullgraph=True, **settings):
        tensors = list(arrays.values())
        rendering = self.compiled(lambda: draw(arrays, self.OUTPUTS, **settings), fullgraph)()
        expected = draw(arrays, self.OUTPUTS)
        self.assert_same(rendering, expected, device)
        self.assertEqual([rendering.means2d.requires_grad, rendering.image.requires_grad], [False, True])
        self.assert_same(*(torch.autograd.grad(loss_of(each), tensors) for each in (rendering, expected)), device)
        return rendering

    def test_with_room_for_instances_there_is_one_graph(self):
        for device in self.DEVICES:
            for form, others in FORMS.items():
                with self.subTest(device, form=form):
                    rendering = self.assert_compiles(device, arguments(100, device, **others), max_instances=9999)
                    self.assertEqual(rendering.overflowed is None, device == "cpu")

    def test_without_room_the_graph_ends_and_begins_again(self):
        for device in self.DEVICES:
            arrays = arguments(100, device)
            self.assert_compiles(device, arrays, fullgraph=False)
            with self.assertRaises(torch._dynamo.exc.Unsupported):
                self.compiled(lambda: draw(arrays))()

    def test_what_does_not_train_gets_no_gradient(self):
        arrays = arguments(20)
        arrays["sh"].requires_grad_(False)
        given = {**arrays, "background": [0.1, 0.2, 0.3]}
        trained = [arrays["means"], arrays["log_scales"]]
        function = lambda: loss_of(draw(given, max_instances=999))
        self.assert_same(*(torch.autograd.grad(each(), trained) for each in (self.compiled(function), function)), "cpu")

    def test_counts_and_settings_may_change(self):
        function = lambda arrays, width, **settings: loss_of(draw(arrays, width=width, **settings))
        compiled = self.compiled(function)
        for count, degree, near, width in ((20, 0, 0.2, 70), (30, 1, 2.8, 70), (40, 2, 0.3, 71), (50, 3, 0.4, 72)):
            arrays = arguments(count)
            found, expected = (each(arrays, width, sh_degree=degree, near=near, max_instances=999) for each in (compiled, function))
            self.assert_same(*(torch.autograd.grad(each, list(arrays.values())) for each in (found, expected)), "cpu")

    def test_the_operators_are_as_torch_wants_them(self):
        from gemsplat import _torch_graph

        torch.use_deterministic_algorithms(True, warn_only=True)
        self.addCleanup(torch.use_deterministic_algorithms, False)
        for device in self.DEVICES:
            arrays = arguments(20, device)
            settings = " ".join(arrays), " ".join(self.OUTPUTS), WIDTH, HEIGHT, None, 0.2, 1e4, None, False, "classic", False, 999, None
            torch.library.opcheck(_torch_graph._draw, (list(arrays.values()), *settings))
            tensors = [tensor.detach() for tensor in arrays.values()]
            by = [torch.ones(HEIGHT, WIDTH, 3, device=device)]
            torch.library.opcheck(_torch_graph._pull_back, (tensors, by, "image", "means sh", *settings))


if __name__ == "__main__":
    unittest.main()
