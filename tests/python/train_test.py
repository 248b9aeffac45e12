# SPDX-License-Identifier: Apache-2.0
"""gemsplat.train(): the program's training, watched and stopped from Python."""

import csv
import json
import os
import signal
import subprocess
import sys
import threading
import unittest

import numpy as np

import gemsplat
from support import COURTYARD, SMALL, SMALL_FLAGS, TestCase, run_program

STEPS = 60
QUICK = {"train": {"log_every": 20}, "density.max_gaussians": 3000}
QUICK_FLAGS = ["--set", "train.log_every=20", "--set", "density.max_gaussians=3000"]


def quick(scene, **more):
    return gemsplat.train(scene, **{"config": QUICK, "iterations": STEPS, "device": "cpu", **more})


class Training(TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scene = gemsplat.Scene.load(COURTYARD, **SMALL)

    def test_a_watched_run_is_the_programs_run_to_the_last_bit(self):
        run = self.folder / "run"
        run_program("train", COURTYARD, "-o", run, "-i", STEPS, "--seed", 7, "--eval", *SMALL_FLAGS, *QUICK_FLAGS)
        seen = []
        result = quick(self.scene, seed=7, callback=lambda p: seen.append((p.step, p.loss, p.snapshot())),
                       callback_every=13)
        result.model.save(self.folder / "model.ply")
        ply = run / "point_cloud" / f"iteration_{STEPS}" / "point_cloud.ply"
        self.assertEqual((self.folder / "model.ply").read_bytes(), ply.read_bytes())
        self.assertEqual([step for step, _, _ in seen], [13, 26, 39, 52, 60])
        np.testing.assert_array_equal(seen[-1][2].means, result.model.means)
        test = json.loads((run / "results.json").read_text())["test"]
        self.assertAlmostEqual(result.evaluation.psnr, test["psnr"], places=4)
        for key in "ssim", "flip":
            self.assertAlmostEqual(getattr(result.evaluation, key), test[key], places=4)
        self.assertGreater(test["flip"], 0)
        rows = list(csv.DictReader((run / "metrics.csv").read_text().splitlines()))
        self.assertEqual([row["step"] for row in result.metrics], [int(row["step"]) for row in rows])
        for mine, its in zip(result.metrics, rows):
            self.assertAlmostEqual(mine["loss"], float(its["loss"]), places=6)
            self.assertEqual(mine["gaussian_count"], int(its["num_gaussians"]))
        # The run's folder and the file are one model; in memory its rotations are of other lengths.
        first = gemsplat.load_cameras(run / "cameras.json")[0]
        of_run, of_file, of_result = (gemsplat.render(model, first, device="cpu").color for model in
                                      (gemsplat.load(run), gemsplat.load(self.folder / "model.ply"), result.model))
        np.testing.assert_array_equal(of_run, of_file)
        np.testing.assert_allclose(of_run, of_result, atol=1e-5)

    def test_a_run_on_reduced_photos_first_is_the_programs(self):
        run = self.folder / "run"
        run_program("train", COURTYARD, "-o", run, "-i", STEPS, "--eval", *SMALL_FLAGS, *QUICK_FLAGS,
                    "--set", "train.resolution_ramp=[3, 2]", "--set", "train.resolution_least=100")
        ramp = {"train.resolution_ramp": [3, 2], "train.resolution_least": 100}
        result = quick(self.scene, config=[QUICK, ramp])
        result.model.save(self.folder / "model.ply")
        ply = run / "point_cloud" / f"iteration_{STEPS}" / "point_cloud.ply"
        self.assertEqual((self.folder / "model.ply").read_bytes(), ply.read_bytes())
        self.assertFalse(np.array_equal(result.model.means, quick(self.scene).model.means))
        with self.assertRaisesRegex(gemsplat.UsageError, "resolution_ramp = .*from 1 to 16"):
            quick(self.scene, config={"train.resolution_ramp": [32]})

    def test_another_seed_is_another_run_and_a_folder_is_as_good_as_a_scene(self):
        config = [QUICK, {"dataset": {"eval": True, "resolution": 8}}]
        first = gemsplat.train(str(COURTYARD), config, iterations=20, seed=1, device="cpu")
        again = quick(self.scene, iterations=20, seed=1)
        other = quick(self.scene, iterations=20, seed=2)
        np.testing.assert_array_equal(first.model.means, again.model.means)
        self.assertFalse(np.array_equal(first.model.sh0[:100], other.model.sh0[:100]))
        self.assertEqual(first.config.replace(first.device, ""), again.config.replace(again.device, ""))

    def test_training_on_arrays_is_training_on_their_scene(self):
        pairs = lambda views: [(view.camera, view.photo) for view in views]
        arrays = gemsplat.Scene(pairs(self.scene.train_views), pairs(self.scene.test_views), points=self.scene.points,
                                point_colors=self.scene.point_colors)
        one, other = quick(self.scene, iterations=20), quick(arrays, iterations=20)
        np.testing.assert_array_equal(one.model.means, other.model.means)
        self.assertEqual(one.evaluation.psnr, other.evaluation.psnr)

    def test_a_callback_ends_the_run_by_returning_false(self):
        result = quick(self.scene, callback=lambda p: p.step < 10, callback_every=5)
        self.assertEqual((result.steps, result.stopped_early), (11, True))  # the step after is the last
        self.assertEqual(result.metrics[-1]["step"], 11)
        self.assertGreater(len(result.model), 0)
        result = quick(self.scene, callback=lambda p: np.float32(p.step) < 10, callback_every=5)  # NumPy's own False
        self.assertEqual((result.steps, result.stopped_early), (11, True))
        result = quick(self.scene, iterations=12, callback=lambda p: None, callback_every=5)
        self.assertEqual((result.steps, result.stopped_early), (12, False))

    def test_an_exception_of_a_callback_comes_out(self):
        class Mine(Exception):
            pass

        def fail(progress):
            raise Mine(progress.step)

        with self.assertRaises(Mine) as caught:
            quick(self.scene, callback=fail, callback_every=5)
        self.assertEqual(caught.exception.args, (5,))
        self.assertEqual(quick(self.scene, iterations=5).steps, 5)  # nothing is left behind

    def test_progress_ends_with_its_callback(self):
        kept = []
        refused = []

        def keep(progress):
            kept.append(progress)

            def use_elsewhere():
                try:
                    progress.step
                except gemsplat.UsageError as error:
                    refused.append(error)

            thread = threading.Thread(target=use_elsewhere)
            thread.start()
            thread.join()

        quick(self.scene, iterations=5, callback=keep)
        self.assertEqual(len(refused), 1)
        self.assert_refused("only while the callback", lambda: kept[0].step)
        self.assert_refused("only while the callback", kept[0].snapshot)

    def test_other_threads_run_meanwhile_and_may_train(self):
        ticks = [0]
        done = threading.Event()

        def tick():
            while not done.wait(0.001):
                ticks[0] += 1

        ticker = threading.Thread(target=tick)
        ticker.start()
        results = [None, None]

        def work(i):
            results[i] = quick(self.scene, iterations=30, seed=3)

        workers = [threading.Thread(target=work, args=(i,)) for i in range(2)]
        for thread in workers:
            thread.start()
        for thread in workers:
            thread.join()
        done.set()
        ticker.join()
        self.assertGreater(ticks[0], 5)
        np.testing.assert_array_equal(results[0].model.means, results[1].model.means)

    def test_threads_cannot_change_while_a_run_works(self):
        refused = []

        def change(progress):
            try:
                gemsplat.set_threads(gemsplat.thread_count())  # no change
                gemsplat.set_threads(gemsplat.thread_count() + 1)
            except gemsplat.UsageError as error:
                refused.append(str(error))

        quick(self.scene, iterations=3, callback=change)
        self.assertEqual(len(refused), 1)
        self.assertIn("cannot change while", refused[0])

    def test_what_is_no_setting_is_refused(self):
        refuse = lambda pattern, *arguments, **keywords: self.assert_refused(
            pattern, gemsplat.train, *arguments, **keywords)
        refuse("did you mean train.iterations", self.scene, {"train.iteration": 5})
        refuse("did you mean density.strategy", self.scene, {"density": {"strateg": "mcmc"}})
        refuse("train.iterations", self.scene, {"train.iterations": "many"})
        refuse("the setting train.seed cannot be null", self.scene, {"train": {"seed": None}})
        refuse("config must be an object of settings, a name, or a list", self.scene, 5)
        refuse("callback_every", self.scene, callback_every=0)
        refuse("callback must be a function", self.scene, callback=5)
        with self.assertRaisesRegex(gemsplat.Error, "preset"):
            gemsplat.train(self.scene, "quickest")
        with self.assertRaisesRegex(gemsplat.Error, "no view to train on"):
            gemsplat.train(gemsplat.Scene([]), iterations=1, device="cpu")

    def test_presets_and_dicts_come_in_order(self):
        result = gemsplat.train(self.scene, ["mcmc", {"density.max_gaussians": 2500}], iterations=3, device="cpu")
        self.assertIn('strategy = "mcmc"', result.config)
        self.assertIn("max_gaussians = 2500", result.config)
        self.assertIn("iterations = 3", result.config)


class Interrupt(TestCase):
    def test_ctrl_c_ends_a_run_as_it_ends_a_loop(self):
        script = (
            "import gemsplat, sys\n"
            "scene = gemsplat.Scene.load(sys.argv[1], eval=True, resolution=8)\n"
            "try:\n"
            "    gemsplat.train(scene, iterations=1000000, device='cpu', callback=lambda p: print(p.step, flush=True),\n"
            "                   callback_every=3)\n"
            "except KeyboardInterrupt:\n"
            "    sys.exit(42)\n")
        child = subprocess.Popen([sys.executable, "-c", script, str(COURTYARD)], stdout=subprocess.PIPE, text=True)
        self.assertEqual(child.stdout.readline(), "3\n")
        os.kill(child.pid, signal.SIGINT)
        child.communicate(timeout=60)
        self.assertEqual(child.returncode, 42)


if __name__ == "__main__":
    unittest.main()
