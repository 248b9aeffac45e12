# SPDX-License-Identifier: Apache-2.0
"""gemsplat.train(output=...), export() and report(): runs with a folder, as the program writes them."""

import json
import subprocess
import sys
import unittest

import numpy as np

import gemsplat
from support import COURTYARD, SMALL, SMALL_FLAGS, SOURCE, TestCase, run_program

STEPS = 40
QUICK = {"train": {"log_every": 10}, "density.max_gaussians": 3000}
QUICK_FLAGS = ["--set", "train.log_every=10", "--set", "density.max_gaussians=3000"]


class Runs(TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scene = gemsplat.Scene.load(COURTYARD, **SMALL)

    def train(self, output, **more):
        keywords = {"config": QUICK, "iterations": STEPS, "device": "cpu", "output": self.folder / output, **more}
        return gemsplat.train(self.scene, **keywords)

    def ply(self, output, step=STEPS):
        return (self.folder / output / "point_cloud" / f"iteration_{step}" / "point_cloud.ply").read_bytes()

    def test_a_run_writes_the_folder_that_the_program_writes(self):
        result = self.train("mine")
        run_program("train", COURTYARD, "-o", self.folder / "its", "-i", STEPS, "--eval", *SMALL_FLAGS, *QUICK_FLAGS)
        names = lambda run: {str(path.relative_to(self.folder / run)) for path in (self.folder / run).rglob("*")}
        self.assertEqual(names("mine"), names("its"))
        self.assertEqual(self.ply("mine"), self.ply("its"))
        figures = [json.loads((self.folder / run / "results.json").read_text()) for run in ("mine", "its")]
        self.assertEqual(figures[0]["test"], figures[1]["test"])
        self.assertEqual(figures[0]["scene_hash"], figures[1]["scene_hash"])
        self.assertEqual(result.output, (self.folder / "mine").absolute())
        self.assertEqual((result.steps, result.stopped_early), (STEPS, False))
        self.assertAlmostEqual(result.evaluation.psnr, figures[0]["test"]["psnr"], places=9)
        self.assertEqual([row["step"] for row in result.metrics], [10, 20, 30, 40])

    def test_a_stopped_run_goes_on_to_the_bytes_of_one_never_stopped(self):
        self.train("whole")
        stopped = self.train("out", callback=lambda now: now.step < 10, callback_every=5)
        self.assertEqual((stopped.steps, stopped.stopped_early), (11, True))
        self.assertGreater(stopped.evaluation.psnr, 1)
        self.assertFalse((self.folder / "out" / "results.json").exists())
        resumed = self.train("out", resume=True)
        self.assertEqual((resumed.steps, resumed.stopped_early), (STEPS, False))
        self.assertEqual(self.ply("out"), self.ply("whole"))
        np.testing.assert_array_equal(self.train("out", resume=True).model.means, gemsplat.load(self.folder / "out").means)

    def test_an_exception_of_a_callback_comes_out_and_the_run_can_go_on(self):
        def fail(progress):
            raise KeyError(progress.step)

        with self.assertRaises(KeyError):
            self.train("out", callback=fail, callback_every=7)
        self.assertTrue((self.folder / "out" / "checkpoints" / "step_8.ckpt").exists())
        self.assertEqual(gemsplat.train(COURTYARD, {"dataset": SMALL}, resume=self.folder / "out").steps, STEPS)

    def test_checkpoints_come_as_often_as_asked_for(self):
        seen = []
        self.train("out", checkpoint_every=15, callback_every=20, report=False,
                   callback=lambda now: seen.extend(path.name for path in (self.folder / "out").glob("checkpoints/*")))
        self.assertIn("step_15.ckpt", seen)
        self.assertFalse((self.folder / "out" / "report.html").exists())

    def test_a_run_starts_from_a_model(self):
        self.train("first")
        start = self.folder / "first" / "point_cloud" / f"iteration_{STEPS}" / "point_cloud.ply"
        result = self.train("second", config=[QUICK, {"model.start_from": start}])
        self.assertIn(f'start_from = "{start}"', result.config)
        with self.assertRaisesRegex(gemsplat.UsageError, "output=FOLDER"):
            gemsplat.train(self.scene, {"model.start_from": start}, iterations=5, device="cpu")

    def test_a_folder_that_holds_a_run_is_refused_or_moved_aside(self):
        self.train("out")
        self.assert_refused("holds a run already", self.train, "out")
        self.train("out", force=True, seed=1)
        self.assertTrue((self.folder / "out.bak-1" / "results.json").exists())

    def test_what_needs_a_folder_is_refused_without_one(self):
        for name, value in {"checkpoint_every": 5, "export": ["spz"], "force": True}.items():
            self.assert_refused(name + " .*output=FOLDER", gemsplat.train, self.scene, **{name: value})
        self.assert_refused("ksplat", self.train, "out", export=["ksplat"])

    def test_exports_stand_beside_the_model(self):
        result = self.train("out", export=["glb"])
        file = self.folder / "out" / "point_cloud" / f"iteration_{STEPS}" / "point_cloud.glb"
        self.assertEqual(len(gemsplat.load(file)), len(result.model))


class Outputs(TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scene = gemsplat.Scene.load(COURTYARD, **SMALL)
        cls.model = gemsplat.train(cls.scene, QUICK, iterations=10, device="cpu").model

    def test_an_export_is_measured_and_has_a_sidecar(self):
        file = self.folder / "model.splat"
        written = gemsplat.export(self.model, file, cameras=[view.camera for view in self.scene.test_views], device="cpu")
        self.assertEqual((written["file"], written["format"]), (file, "splat"))
        self.assertEqual(written["bytes"], file.stat().st_size)
        self.assertEqual(written["gaussians"], len(self.model))
        self.assertGreater(written["psnr"], 20)
        self.assertTrue((self.folder / "model.splat.transforms.json").exists())
        self.assertIsNone(gemsplat.export(self.model, self.folder / "model.ply")["psnr"])

    def test_a_file_that_is_there_is_refused_or_kept_aside(self):
        file = self.folder / "model.ply"
        gemsplat.export(self.model, file)
        self.assert_refused("model.ply", gemsplat.export, self.model, file)
        gemsplat.export(self.model, file, replace=True)
        self.assertTrue((self.folder / "model.ply.bak-1").exists())

    def test_what_cannot_be_exported_is_refused(self):
        self.assert_refused("ksplat", gemsplat.export, self.model, self.folder / "model.ksplat")
        self.assert_refused("cameras must be", gemsplat.export, self.model, self.folder / "model.splat", cameras=[5])

    def test_a_report_is_written_of_a_run_and_of_nothing_else(self):
        run = self.folder / "run"
        gemsplat.train(self.scene, QUICK, iterations=10, device="cpu", output=run, report=False)
        self.assert_refused("not a folder", gemsplat.report, self.folder / "absent")
        try:
            page = gemsplat.report(run)
        except gemsplat.Error as error:
            if "npm" not in str(error):
                raise
            self.skipTest(str(error))  # this build carries no page
        self.assertEqual(page, run / "report.html")
        self.assertIn("<html", page.read_text()[:2000])
        other = gemsplat.report(run, self.folder / "other.html")
        self.assertTrue(other.exists())


class Example(TestCase):
    def test_the_example_trains_the_bundled_scene_and_renders_a_picture(self):
        script = SOURCE / "examples" / "train.py"
        done = subprocess.run([sys.executable, script, "--steps", "20", "--device", "cpu", "--output", self.folder / "out"],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"step 20 of 20: loss 0\.\d+, [\d,]+ Gaussians")
        self.assertRegex(done.stdout, r"\d+\.\d+ dB PSNR on 5 held-out views")
        picture = (self.folder / "out" / "view.ppm").read_bytes()
        self.assertTrue(picture.startswith(b"P6\n120 90\n255\n"))
        self.assertEqual(len(picture), len(b"P6\n120 90\n255\n") + 120 * 90 * 3)
        self.assertTrue((self.folder / "out" / "results.json").exists())


if __name__ == "__main__":
    unittest.main()
