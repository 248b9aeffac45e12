# SPDX-License-Identifier: Apache-2.0
"""gemsplat.Trainer: the bytes of train(), losses and strategies of Python, and what happens when they fail."""

import gc
import importlib.util
import re
import shutil
import struct
import subprocess
import sys
import threading
import unittest
import weakref
import zlib

import numpy as np

import gemsplat
from support import COURTYARD, SMALL, SOURCE, TestCase

QUICK = {"density.max_gaussians": 3000}
STILL = {"density": {"from_step": 30000}}  # nothing grows
PARAMETERS = ("means", "log_scales", "rotations", "logit_opacities", "sh0", "sh_rest")
HAS_TORCH = importlib.util.find_spec("torch") is not None
sys.path.insert(0, str(SOURCE / "examples"))


def l1(image, view, step):
    """The mean of absolute differences, and its gradient."""
    difference = image - view.image
    return np.abs(difference).mean(), np.sign(difference) / difference.size


def failing_once(compare, fails_at):
    """The loss `compare`, but for the first call of a step."""
    failed = []

    def loss(image, view, step):
        if step == fails_at and not failed:
            failed.append(step)
            raise ZeroDivisionError("mine")
        return compare(image, view, step)

    return loss


def gray_png(pixels):
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    height, width = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def parameters(trainer):
    return {name: getattr(trainer.rows, name) for name in PARAMETERS}


class Trainers(TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scene = gemsplat.Scene.load(COURTYARD, **SMALL)

    def trainer(self, config=QUICK, **options):
        made = gemsplat.Trainer(self.scene, config, **{"iterations": 30, "device": "cpu", **options})
        self.addCleanup(made.close)
        return made

    def assert_same_models(self, one, other):
        for name in PARAMETERS:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))

    def assert_same_rows(self, one, other):
        for name, array in one.items():
            np.testing.assert_array_equal(array, other[name], name)


    def check_photometric_loss(self, loss, **options):
        native = self.trainer(STILL, **options)
        trainer = self.trainer(STILL, loss=loss, framework="torch", **options)
        before = trainer.evaluate().psnr
        expected, last = native.run().loss, trainer.run().loss
        self.assertAlmostEqual(last, expected, delta=0.02 * expected)
        self.assertGreater(trainer.evaluate().psnr, before + 2)
        self.assertAlmostEqual(trainer.evaluate().psnr, native.evaluate().psnr, delta=0.1)


class Runs(Trainers):
    def test_a_run_without_callbacks_has_the_bytes_of_train(self):
        options = {"iterations": 60, "seed": 7, "device": "cpu"}
        result = gemsplat.train(self.scene, QUICK, **options)
        with self.trainer(**options) as trainer:
            self.assertEqual(trainer.run(20).step, 20)
            snapshot = trainer.model
            progress = trainer.run()
            self.assertEqual((progress.step, progress.steps), (60, 60))
            self.assertEqual(progress.loss, result.metrics[-1]["loss"])
            self.assert_same_models(trainer.model, result.model)
            self.assertEqual(trainer.evaluate().psnr, result.evaluation.psnr)
            np.testing.assert_array_equal(trainer.render(self.scene.test_views[0].camera).color,
                                          gemsplat.render(result.model, self.scene.test_views[0].camera, device="cpu").color)
        self.assertFalse(np.array_equal(snapshot.means[:50], result.model.means[:50]))  # a copy of its own

    def test_batches_and_other_methods_have_the_bytes_of_train_as_well(self):
        for config in ([QUICK, {"train.batch": 3}], ["mcmc", QUICK]):
            result = gemsplat.train(self.scene, config, iterations=31, device="cpu")
            trainer = self.trainer(config, iterations=31)
            trainer.run()
            self.assert_same_models(trainer.model, result.model)

    def test_a_run_goes_on_from_a_checkpoint(self):
        whole = self.trainer()
        whole.run()
        first, second = self.trainer(), self.trainer()
        first.run(17)
        first.save(self.folder / "state.ckpt")
        second.run(3)
        second.load(self.folder / "state.ckpt")
        self.assertEqual(second.step().step, 18)
        second.run()
        self.assert_same_models(second.model, whole.model)
        self.assert_refused("before the last", second.save, self.folder / "late.ckpt")
        with self.assertRaisesRegex(gemsplat.Error, "cannot read"):
            whole.load(__file__)
        self.assertGreater(whole.rows.count, 0)  # which is as it was

    def test_a_run_starts_from_trained_gaussians(self):
        trainer = self.trainer()
        trainer.run()
        trainer.model.save(self.folder / "model.ply")
        again = self.trainer(start_from=self.folder / "model.ply", loss=l1)
        self.assertAlmostEqual(again.evaluate().psnr, trainer.evaluate().psnr, places=2)
        again.step()

    def test_steps_that_are_not_there_are_refused(self):
        trainer = self.trainer(iterations=3)
        self.assert_refused("between 1 and 3", trainer.run, 4)
        self.assert_refused("between 1 and 3", trainer.run, 0)
        first = trainer.step()
        trainer.run()
        self.assert_refused("until the trainer's next step", lambda: first.step)
        self.assert_refused("all 3 steps are taken", trainer.step)

    def test_a_closed_trainer_says_so_and_gives_its_memory_back(self):
        trainer = self.trainer(loss=l1)
        progress, rows = trainer.step(), trainer.rows
        trainer.close()
        for use in (trainer.step, trainer.evaluate, lambda: trainer.model, lambda: rows.means, lambda: rows.count):
            self.assert_refused("closed", use)
        self.assert_refused("next step", lambda: progress.loss)
        trainer.close()
        here = weakref.ref(trainer)
        self.doCleanups()
        del trainer
        gc.collect()
        self.assertIsNone(here())

    def test_what_is_no_keyword_is_refused(self):
        refuse = lambda pattern, **options: self.assert_refused(pattern, self.trainer, **options)
        refuse("Trainer has no keyword iteration; did you mean iterations", iteration=5)
        refuse('framework takes "numpy" or "torch"', framework="jax")
        refuse("loss must be a function", loss=5)
        refuse("strategy must be a word, or an object with after_step", strategy=5)
        refuse("photometric.model", config={"photometric.model": "gains"}, loss=l1)


class Losses(Trainers):
    CONFIG = [QUICK, {"loss.lambda_dssim": 0}]

    def test_a_loss_in_numpy_trains_as_the_same_loss_of_the_program(self):
        native = self.trainer(self.CONFIG, iterations=100)
        expected = native.run().loss
        seen = []

        def loss(image, view, step):
            self.assertEqual(image.shape, (view.camera.height, view.camera.width, 3))
            self.assertEqual((image.dtype, view.image.dtype), (np.float32, np.float32))
            value, gradient = l1(image, view, step)
            seen.append((step, view.name, value))
            return value, gradient

        trainer = self.trainer(self.CONFIG, iterations=100, loss=loss)
        last = trainer.run().loss
        steps, names, values = zip(*seen)
        self.assertEqual(steps, tuple(range(1, 101)))
        self.assertLessEqual(set(names), {view.name for view in self.scene.train_views})
        self.assertLess(np.mean(values[-20:]), np.mean(values[:20]) / 1.15)
        self.assertAlmostEqual(last, values[-1], places=6)
        self.assertAlmostEqual(last, expected, delta=0.03 * expected)
        self.assertAlmostEqual(trainer.evaluate().psnr, native.evaluate().psnr, delta=0.15)

    def test_the_photo_is_the_views_own_also_where_it_is_reduced(self):
        photos = {view.name: view.photo for view in self.scene.train_views}
        shapes = []

        def loss(image, view, step):
            photo = photos[view.name].astype(np.float32) / 255
            if step <= 4:  # means of 2x2 pixels, rounded to 8 bits
                height, width = photo.shape[0] // 2 * 2, photo.shape[1] // 2 * 2
                photo = photo[:height, :width].reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
            np.testing.assert_allclose(view.image, photo, atol=0.51 / 255)
            self.assertIsNone(view.mask)
            shapes.append(image.shape)
            return l1(image, view, step)

        trainer = self.trainer({"train": {"resolution_ramp": [2], "resolution_every": 4000, "resolution_least": 1}}, loss=loss)
        trainer.run(6)
        self.assertEqual(shapes[4], shapes[5])
        self.assertEqual(shapes[3][0], shapes[4][0] // 2)

    def test_each_photo_of_a_batch_has_its_step(self):
        seen = []
        trainer = self.trainer({"train.batch": 3}, iterations=7, loss=lambda *given: (seen.append(given[2]), l1(*given))[1])
        self.assertEqual(trainer.step().step, 3)
        trainer.run()
        self.assertEqual(seen, [1, 2, 3, 4, 5, 6, 7])

    def test_a_loss_gets_the_mask_of_its_view(self):
        size = self.scene.train_views[0].photo.shape[:2]
        pixels = np.zeros((8 * size[0], 8 * size[1]), np.uint8)
        pixels[:, :4 * size[1]] = 255  # the left half trains
        scene = self.folder / "scene"
        shutil.copytree(COURTYARD, scene, ignore=shutil.ignore_patterns("masks"))
        (scene / "masks").mkdir()
        for photo in (scene / "images").iterdir():
            (scene / "masks" / f"{photo.name}.png").write_bytes(gray_png(pixels))
        masks = []

        def loss(image, view, step):
            masks.append(view.mask)
            value, gradient = l1(image, view, step)
            return value, gradient * view.mask[..., None]

        trainer = gemsplat.Trainer(scene, {"dataset": SMALL}, loss=loss, iterations=4, device="cpu")
        trainer.run(2)
        trainer.close()
        self.assertEqual((masks[0].shape, masks[0].dtype), (size, np.float32))
        self.assertEqual((masks[0][:, :size[1] // 2].min(), masks[0][:, size[1] // 2:].max()), (1, 0))

    def test_a_gradient_of_zero_leaves_the_colors_alone(self):
        trainer = self.trainer([STILL, {"density.opacity_regularizer": 0.0}], loss=lambda image, *_: (0, np.zeros_like(image)))
        trainer.step()
        before = parameters(trainer)
        trainer.run(3)
        self.assert_same_rows(parameters(trainer), before)

    def test_an_exception_stops_the_step_before_anything_changes(self):
        def run(fails_at):
            trainer = self.trainer(self.CONFIG, loss=failing_once(l1, fails_at))
            if fails_at:
                if fails_at > 1:
                    trainer.run(fails_at - 1)
                before = parameters(trainer)
                with self.assertRaisesRegex(ZeroDivisionError, "mine"):
                    trainer.step()
                if fails_at > 1:
                    self.assert_same_rows(parameters(trainer), before)
            trainer.run()
            return trainer.model

        plain = run(None)
        for step in (1, 9):
            self.assert_same_models(run(step), plain)

    def test_what_a_loss_must_return(self):
        refuse = lambda pattern, loss: self.assert_refused(pattern, self.trainer(loss=loss).step)
        refuse("returns a scalar tensor of torch, or a tuple", lambda image, *_: 0.5)
        refuse(r"must have the shape \(45, 60, 3\), but has \(45, 60\)", lambda image, *_: (0.5, image[..., 0]))

    def test_a_loss_that_sees_depth_gets_the_pictures_of_the_model_and_moves_them(self):
        def loss(image, view, step, alpha, depth):
            if step == 1:
                drawn = gemsplat.render(first, view.camera, device="cpu")
                np.testing.assert_allclose(alpha, drawn.alpha, atol=1e-5)
                covered = drawn.alpha > 0.5
                np.testing.assert_allclose((depth / np.maximum(alpha, 1e-6))[covered], drawn.depth[covered], rtol=1e-3)
            means.append((alpha.mean(), depth.mean()))
            return 0.0, None, *(weight * np.full_like(alpha, 1 / alpha.size) for weight in weights)

        ends = {}
        for weights in (1, 0), (-1, 0), (0, 1), (0, -1):
            means = []
            trainer = self.trainer(STILL, loss=loss, sees_depth=True, iterations=40)
            first = trainer.model
            trainer.run()
            ends[weights] = np.mean(means[-10:], axis=0)
        self.assertLess(ends[1, 0][0], ends[-1, 0][0])
        self.assertLess(ends[0, 1][1], ends[0, -1][1])
        self.assert_refused("its gradient by each picture", self.trainer(loss=lambda image, *_: (0, 0 * image), sees_depth=True).step)

    def test_a_loss_cannot_use_the_trainer_meanwhile(self):
        refused = []

        def loss(image, view, step):
            for use in (trainer.step, trainer.close, trainer.evaluate, lambda: trainer.model, lambda: trainer.rows.means,
                        lambda: trainer.save("never.ckpt")):
                with self.assertRaises(gemsplat.UsageError) as caught:
                    use()
                refused.append(caught.exception)
            thread = threading.Thread(target=lambda: self.assertRaises(gemsplat.UsageError, trainer.step))
            thread.start()
            thread.join()
            return l1(image, view, step)

        trainer = self.trainer(loss=loss)
        trainer.step()
        self.assertEqual(len(refused), 6)

    def test_pictures_that_are_kept_stay_as_they_are(self):
        kept = []

        def loss(image, view, step):
            kept.append((image, image.copy(), view.image, view.image.copy()))
            return l1(image, view, step)

        with self.trainer(loss=loss) as trainer:
            trainer.run(5)
        for image, image_then, photo, photo_then in kept:
            np.testing.assert_array_equal(image, image_then)
            np.testing.assert_array_equal(photo, photo_then)


@unittest.skipUnless(HAS_TORCH, "PyTorch is not installed")
class Torch(Trainers):
    def test_autograd_gives_the_gradient_of_the_same_loss_in_numpy(self):
        config = [QUICK, {"loss.lambda_dssim": 0}]
        by_numpy = self.trainer(config, loss=l1)
        by_torch = self.trainer(config, loss=lambda image, view, step: (image - view.image).abs().mean(), framework="torch")
        a, b = by_numpy.run(10), by_torch.run(10)
        self.assertAlmostEqual(a.loss, b.loss, places=5)
        np.testing.assert_allclose(by_torch.rows.means.numpy(), by_numpy.rows.means, atol=1e-4)

    def test_l1_and_ssim_of_torch_train_as_those_of_the_program(self):
        import torch

        losses = []

        def loss(image, view, step):
            self.assertTrue(image.is_leaf and image.requires_grad and torch.is_grad_enabled())
            value = gemsplat.photometric_loss(image, view.image)
            losses.append(value.item())
            return value

        with torch.no_grad():
            self.check_photometric_loss(loss, iterations=80)
        self.assertLess(np.mean(losses[-20:]), np.mean(losses[:20]) / 1.1)

    def test_tuples_tensors_and_what_does_not_depend_on_the_image(self):
        import torch

        self.trainer(loss=lambda image, *_: (0.5, torch.zeros_like(image)), framework="torch").step()
        self.assert_refused("must depend on image", self.trainer(
            loss=lambda image, *_: torch.ones((), requires_grad=True) * 2, framework="torch").step)

    def test_autograd_differentiates_alpha_and_depth(self):
        values = []

        def loss(image, view, step, alpha, depth):
            value = 0.2 * alpha.mean() + 0 * depth.mean()
            values.append(value.item())
            return value

        self.trainer(STILL, loss=loss, sees_depth=True, framework="torch").run()
        self.assertLess(np.mean(values[-5:]), np.mean(values[:5]))

    def test_rows_are_tensors_and_take_tensors(self):
        import torch

        rows = self.trainer(framework="torch").rows
        means = rows.means
        rows.means = means + torch.ones(3, dtype=torch.float64)
        torch.testing.assert_close(rows.means, means + 1)
        count = rows.count
        rows.keep(rows.log_scales.amax(1) > rows.log_scales.amax(1).median())
        self.assertLess(rows.count, count)

    def test_the_example_of_a_loss_raises_the_psnr(self):
        done = subprocess.run([sys.executable, SOURCE / "examples" / "own_loss.py", "--steps", "60", "--output",
                               self.folder / "out" / "model.ply"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        before, after = map(float, re.search(r"([\d.]+) dB before, ([\d.]+) after", done.stdout).groups())
        self.assertGreater(after, before + 2)
        self.assertGreater(len(gemsplat.load(self.folder / "out" / "model.ply")), 100)


class Recorder:
    """A strategy that does what a function says."""

    def __init__(self, act=lambda rows, step, random: None, needs=("mean2d", "visible")):
        self.act, self.words = act, needs

    def needs(self, step):
        return self.words

    def after_step(self, rows, step, random):
        self.act(rows, step, random)


class Strategies(Trainers):
    def test_the_classic_rules_in_python_are_those_of_the_program_to_the_last_bit(self):
        from density_strategy import Classic

        density = {"from_step": 20, "every": 20, "until_step": 22500, "reset_opacity_every": 50, "reset_opacity_until": 30000,
                   "gradient_threshold": 1e-4}
        config = ["adaptive", {"density": density}]
        native = self.trainer(config, iterations=120)
        trainer = self.trainer(config, iterations=120, strategy=Classic(20, 110, 20, 50, 1e-4))
        start = native.rows.count
        for step in range(10, 111, 10):
            native.run(10)
            trainer.run(10)
            self.assert_same_rows(parameters(trainer), parameters(native))
        self.assertGreater(native.rows.count, 1.2 * start)
        native.run()
        trainer.run()
        self.assert_same_models(trainer.model, native.model)

    def test_a_strategy_is_called_after_every_step_with_numbers_that_depend_on_seed_and_step(self):
        def numbers(seed, steps=4):
            seen = []
            trainer = self.trainer(STILL, strategy=Recorder(lambda rows, step, random: seen.append((step, random.random()))),
                                   seed=seed)
            trainer.run(steps)
            return seen

        one = numbers(1)
        self.assertEqual([step for step, _ in one], [1, 2, 3, 4])
        self.assertEqual(one, numbers(1))
        self.assertFalse({value for _, value in one} & {value for _, value in numbers(2)})

    def test_statistics_are_gathered_in_the_steps_that_need_them(self):
        trainer = self.trainer(STILL, strategy=Recorder(needs=()))
        trainer.run(2)
        self.assertEqual(trainer.rows.statistics["visible"].max(), 0)
        sums = {}
        for words in ("mean2d",), ("absolute", "visible"):
            trainer = self.trainer(STILL, strategy=Recorder(needs=words))
            trainer.run(2)
            sums[words[0]] = trainer.rows.statistics
            self.assertEqual(trainer.rows.statistics["visible"].max(), 2)
        self.assertGreater(sums["absolute"]["mean2d"].sum(), 1.2 * sums["mean2d"]["mean2d"].sum())
        self.assert_refused("needs some of mean2d, absolute, visible, and not 'max_radius'",
                            self.trainer(strategy=Recorder(needs=("max_radius",))).step)

    def test_an_exception_comes_out_of_a_step_that_is_done(self):
        def act(rows, step, random):
            if step == 2:
                raise KeyError("mine")

        trainer, plain = (self.trainer(STILL, strategy=Recorder(does)) for does in (act, lambda *_: None))
        trainer.step()
        with self.assertRaisesRegex(KeyError, "mine"):
            trainer.step()
        self.assertEqual(trainer.step().step, 3)
        plain.run()
        trainer.run()
        self.assert_same_models(trainer.model, plain.model)

    def test_a_strategy_uses_rows_but_takes_no_step(self):
        def act(rows, step, random):
            self.assertIs(rows, trainer.rows)
            self.assertGreater(len(trainer.model), 0)
            for use in (trainer.step, trainer.close, lambda: trainer.load("never.ckpt")):
                self.assert_refused("a strategy works on its rows", use)

        trainer = self.trainer(strategy=Recorder(act))
        trainer.step()

    def test_a_strategys_state_is_saved_beside_the_checkpoint(self):
        class Counting(Recorder):
            calls = np.zeros(2)

            def after_step(self, rows, step, random):
                self.calls = self.calls + 1

            def state_dict(self):
                return {"calls": self.calls, "number": 7}

            def load_state_dict(self, state):
                self.calls, self.number = state["calls"], int(state["number"])

        first, second = self.trainer(strategy=Counting()), self.trainer(strategy=(strategy := Counting()))
        first.run(5)
        first.save(self.folder / "state.ckpt")
        second.load(self.folder / "state.ckpt")
        second.step()
        self.assertEqual((strategy.calls.tolist(), strategy.number), ([6, 6], 7))

    def test_the_example_of_a_strategy_counts_as_the_program_does(self):
        done = subprocess.run([sys.executable, SOURCE / "examples" / "density_strategy.py", "--steps", "150", "--device", "cpu"],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        python, program = re.findall(r"rules .*: (\d+) Gaussians, then (\d+); ([\d.]+) dB", done.stdout)
        self.assertEqual(python, program)
        self.assertGreater(int(python[1]), int(python[0]))


class Rows(Trainers):
    def setUp(self):
        super().setUp()
        self.made = self.trainer(STILL, strategy=Recorder())
        self.made.run(2)
        self.rows = self.made.rows

    def test_arrays_are_copies_that_outlive_the_trainer(self):
        means, statistics = self.rows.means, self.rows.statistics["visible"]
        kept = means.copy(), statistics.copy()
        means[:] += 1
        np.testing.assert_array_equal(self.rows.means, kept[0])
        self.rows.clone(np.arange(self.rows.count))
        self.made.step()
        self.made.close()
        gc.collect()
        np.testing.assert_array_equal(means - 1, (kept[0] + 1) - 1)
        np.testing.assert_array_equal(statistics, kept[1])

    def test_assigned_arrays_become_the_rows(self):
        for name in PARAMETERS:
            array = getattr(self.rows, name) + np.float32(0.25)
            setattr(self.rows, name, array)
            np.testing.assert_array_equal(getattr(self.rows, name), array)
        self.assert_refused("means must have the shape", setattr, self.rows, "means", np.zeros((3, 3)))
        self.assert_refused("means holds nan in row 0", setattr, self.rows, "means", self.rows.means * np.nan)
        self.assertEqual(self.made.step().step, 3)

    def test_rows_are_kept_cloned_and_split(self):
        before, visible, count = parameters(self.made), self.rows.statistics["visible"], self.rows.count
        mask = before["means"][:, 0] > np.median(before["means"][:, 0])
        self.rows.keep(mask)
        for name in PARAMETERS:
            np.testing.assert_array_equal(getattr(self.rows, name), before[name][mask])
        np.testing.assert_array_equal(self.rows.statistics["visible"], visible[mask])
        kept, left = parameters(self.made), self.rows.count
        self.rows.clone([5, 2])
        for name in PARAMETERS:
            np.testing.assert_array_equal(getattr(self.rows, name)[left:], kept[name][[2, 5]])
        self.assertEqual(self.rows.statistics["visible"][left:].tolist(), [0, 0])
        self.rows.split(np.array([0, 3]), parts=3, shrink=2)
        self.assertEqual(self.rows.count, left + 2 - 2 + 6)
        np.testing.assert_allclose(self.rows.log_scales[-6:], np.repeat(kept["log_scales"][[0, 3]], 3, axis=0) - np.log(2),
                                   atol=1e-5)
        self.assertEqual(len(np.unique(self.rows.means[-6:], axis=0)), 6)
        self.assertLess(self.rows.count, count)
        self.made.run()

    def test_rows_are_added_moved_and_made_fainter(self):
        first = self.rows.count
        self.rows.append(means=np.ones((2, 3)), rotations=[[1, 0, 0, 0]] * 2, log_scales=np.full((2, 3), -4),
                         logit_opacities=[0, 1], sh0=np.zeros((2, 3)))
        self.assertEqual(self.rows.count, first + 2)
        np.testing.assert_array_equal(self.rows.means[first:], np.ones((2, 3)))
        self.assertEqual(self.rows.sh_rest[first:].any(), False)
        source, opacity = self.rows.means[7].copy(), 1 / (1 + np.exp(-self.rows.logit_opacities[7]))
        self.rows.relocate([first, first + 1], [7, 7])
        np.testing.assert_array_equal(self.rows.means[[first, first + 1]], [source] * 2)
        shared = 1 / (1 + np.exp(-self.rows.logit_opacities[[7, first, first + 1]]))
        self.assertAlmostEqual(1 - np.prod(1 - shared), opacity, places=5)
        self.rows.lower_opacity(0.01)
        self.assertLessEqual(self.rows.logit_opacities.max(), np.log(0.01 / 0.99) + 1e-5)
        self.rows.clear_statistics()
        self.assertEqual(self.rows.statistics["visible"].max(), 0)
        self.made.run()

    def test_wrong_rows_are_refused(self):
        rows = self.rows
        self.assert_refused("booleans", rows.keep, [0, 1])
        self.assert_refused(f"between 0 and {rows.count - 1}", rows.clone, [rows.count])
        self.assert_refused("array of row numbers", rows.clone, [0.5])
        self.assert_refused("parts must be 1 or more", rows.split, [0], parts=0)
        self.assert_refused("dead has a row number twice", rows.relocate, [1, 1], [2, 3])
        self.assert_refused("dead and a source", rows.relocate, [1, 2], [2, 3])
        self.assert_refused("between 0 and 1", rows.lower_opacity, 2)
        rows.clone([])
        rows.keep(np.ones(rows.count, bool))


@unittest.skipUnless(HAS_TORCH and gemsplat.cuda_device_count(), "there is no GPU, or no PyTorch")
class OnAGpu(Trainers):
    ADAPTIVE = ["adaptive", {"loss.lambda_dssim": 0, "density": {"from_step": 20, "every": 20, "until_step": 25000}}]

    def setUp(self):
        super().setUp()
        import torch

        if not torch.cuda.is_available():
            self.skipTest("PyTorch sees no GPU")
        self.options = {"device": "cuda:0", "deterministic": True, "iterations": 100}

    def test_a_run_without_callbacks_has_the_bytes_of_train(self):
        result = gemsplat.train(self.scene, self.ADAPTIVE, **self.options)
        trainer = self.trainer(self.ADAPTIVE, **self.options)
        trainer.run()
        self.assert_same_models(trainer.model, result.model)

    def test_losses_of_torch_and_numpy_train_as_the_one_of_the_program(self):
        devices = set()

        def loss(image, view, step):
            devices.add((str(image.device), str(view.image.device)))
            return (image - view.image).abs().mean()

        by_program = self.trainer([self.ADAPTIVE, STILL], **self.options)
        by_torch = self.trainer([self.ADAPTIVE, STILL], loss=loss, framework="torch", **self.options)
        by_numpy = self.trainer([self.ADAPTIVE, STILL], loss=l1, **self.options)
        losses = [trainer.run().loss for trainer in (by_program, by_torch, by_numpy)]
        self.assertEqual(devices, {("cuda:0", "cuda:0")})
        for other in by_torch, by_numpy:
            self.assertAlmostEqual(other.evaluate().psnr, by_program.evaluate().psnr, delta=0.1)
        self.assertAlmostEqual(losses[1], losses[0], delta=0.02 * losses[0])
        self.assertAlmostEqual(losses[2], losses[1], places=4)

    def test_l1_and_ssim_of_torch_train_as_those_of_the_program(self):
        self.check_photometric_loss(lambda image, view, step: gemsplat.photometric_loss(image, view.image), **self.options)

    def test_an_exception_stops_the_step_before_anything_changes(self):
        def run(fails_at):
            loss = failing_once(lambda image, view, step: (image - view.image).abs().mean(), fails_at)
            trainer = self.trainer(self.ADAPTIVE, loss=loss, framework="torch", **self.options)
            if fails_at:
                trainer.run(fails_at - 1)
                self.assertRaises(ZeroDivisionError, trainer.step)
            trainer.run()
            return trainer.model

        self.assert_same_models(run(35), run(None))

    def test_the_classic_rules_in_python_are_those_of_the_program(self):
        from density_strategy import Classic

        native = self.trainer(self.ADAPTIVE, **self.options)
        trainer = self.trainer(self.ADAPTIVE, strategy=Classic(20, 100, 20, 1000), **self.options)
        start = native.rows.count
        self.assertGreater(native.run(99).gaussian_count, start)
        self.assertAlmostEqual(trainer.run(99).gaussian_count, native.rows.count, delta=0.01 * native.rows.count)

    def test_autograd_differentiates_alpha_and_depth(self):
        values = []

        def loss(image, view, step, alpha, depth):
            values.append(alpha.mean().item())
            return 0.2 * alpha.mean() + 0 * depth.mean()

        self.trainer(STILL, loss=loss, sees_depth=True, framework="torch", **self.options).run()
        self.assertLess(np.mean(values[-10:]), np.mean(values[:10]))

    def test_rows_are_tensors_on_the_gpu(self):
        import torch

        trainer = self.trainer(STILL, framework="torch", **self.options)
        trainer.run(2)
        rows, means = trainer.rows, trainer.rows.means
        self.assertEqual(str(means.device), "cuda:0")
        rows.means = means + 1
        torch.testing.assert_close(rows.means, means + 1)
        rows.split(rows.statistics["visible"] > 0, shrink=2)
        rows.clone(torch.arange(5, device="cuda"))
        rows.relocate(torch.tensor([0, 1], device="cuda"), torch.tensor([7, 7], device="cuda"))
        torch.testing.assert_close(rows.means[0], rows.means[7])
        rows.append(means=means[:3], rotations=torch.ones(3, 4), log_scales=torch.zeros(3, 3), logit_opacities=torch.zeros(3),
                    sh0=torch.zeros(3, 3))
        torch.testing.assert_close(rows.means[-3:], means[:3])
        trainer.step()


if __name__ == "__main__":
    unittest.main()
