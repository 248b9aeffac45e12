# SPDX-License-Identifier: Apache-2.0
"""gemsplat.render() and evaluate(): the program's pictures and figures, from arrays."""

import json
import sys
import threading
import unittest

import numpy as np

import gemsplat
from support import COURTYARD, SMALL, SMALL_FLAGS, SOURCE, TestCase, camera, in_8_bits, random_arrays, run_program

sys.path.insert(0, str(SOURCE / "tests/train/metrics"))
import lpips_reference  # noqa: E402

CPU = {"device": "cpu"}


def png_as_photo(path, named):
    """The pixels of a PNG as the scene loader reads them: through a scene of that one picture."""
    folder = path.parent / (path.stem + "_scene")
    (folder / "images").mkdir(parents=True)
    (folder / "images" / path.name).write_bytes(path.read_bytes())
    (folder / "sparse" / "0").mkdir(parents=True)
    text = {"cameras": f"1 PINHOLE {named.width} {named.height} 10 10 5 5\n",
            "images": f"1 1 0 0 0 0 0 0 1 {path.name}\n\n", "points3D": ""}
    for name, lines in text.items():
        (folder / "sparse" / "0" / f"{name}.txt").write_text(lines)
    return gemsplat.Scene.load(folder).train_views[0].photo


class AgainstTheProgram(TestCase):
    def setUp(self):
        super().setUp()
        self.scene = gemsplat.Scene.load(COURTYARD, **SMALL)
        self.model = self.folder / "model.ply"
        random = random_arrays(count=400)
        random["means"] *= 3
        gemsplat.Model(**random).save(self.model)

    def test_pictures_agree_bit_for_bit(self):
        run_program("render", self.model, "-o", self.folder / "pictures", "--data", COURTYARD, "--split", "test",
                    *SMALL_FLAGS)
        views = self.scene.test_views
        pictures = gemsplat.render(gemsplat.load(self.model), [view.camera for view in views], depth=False, **CPU)
        spread = 0
        for view, picture in zip(views, pictures):
            file = (self.folder / "pictures" / view.name).with_suffix(".png")
            np.testing.assert_array_equal(in_8_bits(picture.color), png_as_photo(file, view.camera), view.name)
            spread += picture.color.std()
        self.assertGreater(spread / len(views), 0.02)  # there is something to see

    def test_evaluation_agrees(self):
        text = run_program("eval", self.model, "--data", COURTYARD, "--json", "--split", "test", *SMALL_FLAGS)
        expected = json.loads(text)
        found = gemsplat.evaluate(gemsplat.load(self.model), self.scene, **CPU)
        self.assertAlmostEqual(found.psnr, expected["psnr"], places=4)
        for key in "ssim", "flip":
            self.assertAlmostEqual(getattr(found, key), expected[key], places=4)
            self.assertAlmostEqual(getattr(found.views[0], key), expected["views"][found.views[0].name][key], places=4)
        self.assertEqual(len(found.views), expected["num_views"])
        self.assertIsNone(found.lpips)

    def test_lpips_agrees_with_the_program_and_with_numpy(self):
        arrays, file = lpips_reference.weights("alex", [4, 6, 5, 3, 4]), self.folder / "net.safetensors"
        lpips_reference.write(file, arrays)
        model = gemsplat.load(self.model)
        try:
            found = gemsplat.evaluate(model, self.scene, config={"eval.lpips": str(file)}, **CPU)
        except gemsplat.UsageError as error:
            self.assertIn("no OpenCV with the module dnn", str(error))
            self.skipTest(str(error))
        text = run_program("eval", self.model, "--data", COURTYARD, "--json", "--lpips", file, *SMALL_FLAGS)
        expected = json.loads(text)
        self.assertAlmostEqual(found.lpips, expected["lpips"], places=4)
        for view, figures in zip(self.scene.test_views, found.views):
            render = gemsplat.render(model, view.camera, depth=False, **CPU).color.astype(np.float64)
            distance = lpips_reference.lpips("alex", arrays, render, view.photo / 255)
            self.assertAlmostEqual(figures.lpips, distance, delta=1e-5 * distance)


class Moments(TestCase):
    def test_a_model_that_moves_is_rendered_at_the_time_of_the_camera_as_the_program_does(self):
        views = gemsplat.Scene.load(COURTYARD, resolution=8).train_views[:6]
        photos = [(view.camera.at_time(i % 2), view.photo // (1 + 3 * (i % 2))) for i, view in enumerate(views)]
        run = self.folder / "run"
        config = {"model": {"dynamic": True, "random_box": 3.0, "initial_time_scale": 0.2}}
        trained = gemsplat.train(gemsplat.Scene(photos), config, iterations=60, device="cpu", output=run)
        camera = views[0].camera
        first, last = gemsplat.render(trained.model, [camera.at_time(0), camera.at_time(1)], depth=False, **CPU)
        self.assertGreater(first.color.mean(), last.color.mean() + 0.02)  # the photos of the end are dark
        run_program("render", run, "-o", self.folder / "late", "--cameras", run / "cameras.json", "--time", "1",
                    "--device", "cpu", "-q")
        model = gemsplat.load(run)
        for named in gemsplat.load_cameras(run / "cameras.json")[:2]:
            file = (self.folder / "late" / named.name).with_suffix(".png")
            picture = gemsplat.render(model, named.at_time(1), depth=False, **CPU)
            np.testing.assert_array_equal(in_8_bits(picture.color), png_as_photo(file, named), named.name)


class Pictures(TestCase):
    def test_one_large_gaussian_gives_its_color_its_depth_and_its_normal(self):
        model = gemsplat.Model(means=[[0, 0, 1]], rotations=[[1, 0, 0, 0]], scales=[[5, 5, 0.01]], opacities=[0.9],
                               colors=[[0.2, 0.5, 0.8]])
        picture = gemsplat.render(model, camera(), normals=True, **CPU)
        self.assertEqual(picture.color.shape, (48, 64, 3))
        self.assertEqual((picture.alpha.shape, picture.depth.shape), ((48, 64), (48, 64)))
        self.assertEqual({a.dtype for a in (picture.color, picture.alpha, picture.depth)}, {np.dtype(np.float32)})
        middle = (24, 32)
        self.assertAlmostEqual(picture.alpha[middle], 0.9, places=2)
        np.testing.assert_allclose(picture.color[middle], picture.alpha[middle] * np.array([0.2, 0.5, 0.8]), atol=1e-3)
        self.assertAlmostEqual(picture.depth[middle], 5, places=4)
        np.testing.assert_allclose(picture.normals[middle], [0, 0, -1], atol=1e-5)

    def test_the_background_is_behind(self):
        model = gemsplat.Model(**random_arrays())
        black = gemsplat.render(model, camera(), **CPU)
        np.testing.assert_array_equal(black.color, gemsplat.render(model, camera(), background="black", **CPU).color)
        for background in ["white", (1, 1, 1)]:
            white = gemsplat.render(model, camera(), background=background, **CPU)
            expected = np.clip(black.color + (1 - black.alpha[..., None]), 0, 1)
            unclamped = black.color < 1
            np.testing.assert_allclose(white.color[unclamped], expected[unclamped], atol=1e-5)

    def test_an_empty_model_is_background(self):
        picture = gemsplat.render(gemsplat.Model(**random_arrays(count=0)), camera(), background=(0.25, 0.5, 1), **CPU)
        np.testing.assert_array_equal(picture.color, np.broadcast_to(np.float32([0.25, 0.5, 1]), (48, 64, 3)))
        np.testing.assert_array_equal(picture.depth, np.zeros((48, 64)))

    def test_many_cameras_give_what_each_gives(self):
        model = gemsplat.Model(**random_arrays())
        cameras = [camera(distance=d) for d in (3, 4, 5)]
        together = gemsplat.render(model, (c for c in cameras), **CPU)
        for one, picture in zip(cameras, together):
            alone = gemsplat.render(model, one, **CPU)
            np.testing.assert_array_equal(alone.color, picture.color)
            np.testing.assert_array_equal(alone.depth, picture.depth)
        self.assertIsNone(gemsplat.render(model, cameras[0], depth=False, **CPU).depth)

    def test_writing_to_the_model_shows(self):
        model = gemsplat.Model(**random_arrays())
        before = gemsplat.render(model, camera(), **CPU).color
        model.logit_opacities[:] = -20
        self.assertLess(gemsplat.render(model, camera(), **CPU).color.max(), 1e-3)
        self.assertGreater(before.max(), 0.1)

    def test_settings_are_taken_and_checked(self):
        model = gemsplat.Model(**random_arrays())
        full = gemsplat.render(model, camera(), **CPU).color
        flat = gemsplat.render(model, camera(), config={"model": {"sh_degree": 0}}, **CPU).color
        self.assertGreater(np.abs(full - flat).max(), 1e-3)
        self.assert_refused("did you mean render.truncation", gemsplat.render, model, camera(),
                            config={"render.truncatio": "alpha"}, **CPU)
        self.assert_refused('train.device = "gpu" cannot be used', gemsplat.render, model, camera(), device="gpu")
        self.assert_refused('train.device = "cuda:x" cannot be used', gemsplat.render, model, camera(), device="cuda:x")
        self.assert_refused("background must be three numbers", gemsplat.render, model, camera(), background=(1, 1), **CPU)
        if gemsplat.cuda_device_count() == 0:
            with self.assertRaisesRegex(gemsplat.Error, "CUDA|GPU"):
                gemsplat.render(model, camera(), device="cuda")


class Threads(TestCase):
    def test_threads_render_at_the_same_time_and_get_what_is_theirs(self):
        model = gemsplat.Model(**random_arrays(count=300))
        cameras = [camera(distance=3 + 0.1 * i) for i in range(8)]
        expected = [gemsplat.render(model, c, **CPU).color for c in cameras]
        failures = []

        def work(i):
            for _ in range(10):
                if not np.array_equal(gemsplat.render(model, cameras[i], **CPU).color, expected[i]):
                    failures.append(i)

        threads = [threading.Thread(target=work, args=(i,)) for i in range(len(cameras))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(failures, [])

    def test_the_number_of_threads_changes_no_bit(self):
        model = gemsplat.Model(**random_arrays(count=300))
        self.addCleanup(gemsplat.set_threads, 0)
        gemsplat.set_threads(1)
        self.assertEqual(gemsplat.thread_count(), 1)
        alone = gemsplat.render(model, camera(), **CPU)
        gemsplat.set_threads(3)
        np.testing.assert_array_equal(gemsplat.render(model, camera(), **CPU).color, alone.color)
        self.assert_refused("number of threads", gemsplat.set_threads, -1)


if __name__ == "__main__":
    unittest.main()
