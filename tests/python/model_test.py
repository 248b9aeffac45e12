# SPDX-License-Identifier: Apache-2.0
"""gemsplat.Model: arrays in and out, files, and what is refused."""

import gc
import multiprocessing
import subprocess
import sys
import unittest

import numpy as np

import gemsplat
from support import TestCase, random_arrays

STORED = ["means", "log_scales", "rotations", "logit_opacities", "sh0", "sh_rest"]


class Arrays(TestCase):
    def test_stored_values_come_back_bit_for_bit(self):
        for degree in range(4):
            arrays = random_arrays(sh_degree=degree)
            model = gemsplat.Model(**arrays)
            self.assertEqual(len(model), 50)
            self.assertEqual(model.sh_degree, degree)
            for name in STORED:
                np.testing.assert_array_equal(getattr(model, name), arrays[name], name)
                self.assertEqual(getattr(model, name).dtype, np.float32)

    def test_activated_values_and_stored_ones_are_two_forms_of_the_same(self):
        arrays = random_arrays()
        model = gemsplat.Model(**arrays)
        np.testing.assert_allclose(model.scales, np.exp(arrays["log_scales"]), rtol=1e-6)
        np.testing.assert_allclose(model.opacities, 1 / (1 + np.exp(-arrays["logit_opacities"])), rtol=1e-6)
        np.testing.assert_allclose(model.colors, 0.5 + 0.28209479 * arrays["sh0"], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(model.unit_rotations, axis=1), 1, rtol=1e-6)
        again = gemsplat.Model(
            means=model.means, rotations=model.unit_rotations, scales=model.scales,
            opacities=model.opacities, colors=model.colors, sh_rest=model.sh_rest)
        for name in ["means", "log_scales", "logit_opacities", "sh0", "sh_rest"]:
            np.testing.assert_allclose(getattr(again, name), getattr(model, name), rtol=1e-4, atol=1e-5)

    def test_stored_values_are_views_that_keep_the_model(self):
        model = gemsplat.Model(**random_arrays())
        means = model.means
        means[3] = [7, 8, 9]
        np.testing.assert_array_equal(model.means[3], [7, 8, 9])
        del model
        gc.collect()
        np.testing.assert_array_equal(means[3], [7, 8, 9])
        self.assertIsInstance(means.base, gemsplat.Model)

    def test_arguments_are_copied_whatever_their_type_and_order(self):
        arrays = random_arrays()
        given = {name: np.asfortranarray(array.astype(np.float64)) for name, array in arrays.items()}
        model = gemsplat.Model(**given)
        given["means"][:] = 0
        for name in STORED:
            np.testing.assert_array_equal(getattr(model, name), arrays[name], name)
        self.assertEqual(len(gemsplat.Model(means=[[0, 0, 0]], rotations=[[1, 0, 0, 0]], scales=[[1, 1, 1]],
                                            opacities=[0.5], colors=[[1, 0, 0]])), 1)

    def test_a_copy_has_its_own_memory(self):
        model = gemsplat.Model(**random_arrays(), antialiased=True, world_offset=(1, 2, 3))
        copy = model.copy()
        model.means[:] = 0
        self.assertTrue(np.any(copy.means))
        self.assertTrue(copy.antialiased)
        self.assertEqual(copy.world_offset, (1.0, 2.0, 3.0))

    def test_a_model_may_be_empty(self):
        model = gemsplat.Model(**random_arrays(count=0))
        self.assertEqual(model.means.shape, (0, 3))
        self.assertEqual(model.sh_rest.shape, (0, 15, 3))
        self.assertEqual(model.opacities.shape, (0,))


class Refusals(TestCase):
    def refuse(self, pattern, **changed):
        self.assert_refused(pattern, gemsplat.Model, **{**random_arrays(), **changed})

    def test_wrong_shapes(self):
        self.refuse(r"means must have the shape \(N, 3\), but has \(50, 2\)", means=np.zeros((50, 2)))
        self.refuse(r"rotations must have the shape \(50, 4\), but has \(49, 4\)", rotations=np.ones((49, 4)))
        self.refuse(r"logit_opacities must have the shape \(50,\), but has \(50, 1\)",
                    logit_opacities=np.zeros((50, 1)))
        self.refuse("0, 3, 8 or 15 coefficients .*, and has 4", sh_rest=np.zeros((50, 4, 3)))

    def test_wrong_types(self):
        self.refuse("means must hold real numbers, but is of dtype complex128", means=np.zeros((50, 3), complex))
        self.refuse("means must hold real numbers, but is of dtype bool", means=np.zeros((50, 3), bool))
        self.refuse("means must hold real numbers, but is of dtype <U1", means=[["a", "b", "c"]] * 50)
        self.refuse("means must hold real numbers, but is of dtype object", means=None)

    def test_values_that_are_not_finite(self):
        means = random_arrays()["means"]
        means[7, 1] = np.nan
        self.refuse("means holds nan in row 7", means=means)
        with np.errstate(over="ignore"):
            self.refuse("sh0 holds inf in row 0", sh0=np.full((50, 3), 1e39))

    def test_values_out_of_range(self):
        arrays = random_arrays()
        del arrays["log_scales"], arrays["logit_opacities"]
        ones = {"scales": np.ones((50, 3)), "opacities": np.full(50, 0.5)}
        refuse = lambda pattern, **changed: self.assert_refused(
            pattern, gemsplat.Model, **{**arrays, **ones, **changed})
        refuse("scales must be above 0, and one is 0", scales=np.zeros((50, 3)))
        refuse("opacities must lie between 0 and 1, both excluded, and one is 1", opacities=np.ones(50))
        refuse("quaternion of length 0 in row 0", rotations=np.zeros((50, 4)))

    def test_both_forms_or_none(self):
        self.refuse("give either scales or log_scales", scales=np.ones((50, 3)))
        self.refuse("give either opacities or logit_opacities", logit_opacities=None)
        self.refuse("world_offset must be three numbers", world_offset=[1, 2])


class Files(TestCase):
    def test_a_ply_gives_the_same_bits(self):
        model = gemsplat.Model(**random_arrays(sh_degree=2), antialiased=True)
        self.assertEqual(model.save(self.folder / "model.ply"), 50)
        again = gemsplat.load(self.folder / "model.ply")
        self.assertEqual(again.sh_degree, 2)
        for name in ["means", "log_scales", "logit_opacities", "sh0", "sh_rest"]:
            np.testing.assert_array_equal(getattr(again, name), getattr(model, name), name)
        np.testing.assert_allclose(again.rotations, model.unit_rotations, atol=1e-7)

    def test_lossy_formats_come_near(self):
        model = gemsplat.Model(**random_arrays(sh_degree=3))
        for ending in ["spz", "sog", "compressed.ply"]:
            path = self.folder / f"model.{ending}"
            self.assertEqual(model.save(str(path)), 50)
            again = gemsplat.load(str(path))
            self.assertEqual(len(again), 50)
            np.testing.assert_allclose(np.sort(again.means[:, 0]), np.sort(model.means[:, 0]), atol=1e-2)

    def test_a_file_that_is_there_is_kept_unless_it_may_be_replaced(self):
        path = self.folder / "model.ply"
        path.write_bytes(b"mine")
        model = gemsplat.Model(**random_arrays())
        self.assert_refused("is there already; .*replace=True", model.save, path)
        self.assertEqual(path.read_bytes(), b"mine")
        model.save(path, replace=True)
        self.assertEqual(len(gemsplat.load(path)), 50)
        self.assertEqual((self.folder / "model.ply.bak-1").read_bytes(), b"mine")

    def test_what_a_sidecar_said_of_an_older_file_is_not_taken_for_the_newer_one(self):
        path, sidecar = self.folder / "model.ply", self.folder / "model.ply.transforms.json"
        sidecar.write_text("{}")
        model = gemsplat.Model(**random_arrays())
        self.assert_refused("transforms.json is there already", model.save, path)
        model.save(path, replace=True)
        self.assertNotEqual(sidecar.read_text(), "{}")
        self.assertEqual((self.folder / "model.ply.transforms.json.bak-1").read_text(), "{}")

    def test_a_saved_file_keeps_what_its_format_cannot_say(self):
        model = gemsplat.Model(**random_arrays(), antialiased=True, world_offset=(1e6, 2e6, 0))
        for save in [model.save, lambda path: gemsplat.export(model, path)]:
            path = self.folder / save.__name__.strip("<>") / "model.splat"
            path.parent.mkdir()
            save(path)
            again = gemsplat.load(path)
            self.assertTrue(again.antialiased)
            self.assertEqual(again.world_offset, (1e6, 2e6, 0))

    def test_saving_and_exporting_refuse_another_version_of_spz(self):
        model = gemsplat.Model(**random_arrays())
        path = self.folder / "model.spz"
        self.assert_refused("spz_version takes 2, 3 or 4, and not 5", model.save, path, spz_version=5)
        self.assert_refused("spz_version takes 2, 3 or 4, and not 5", gemsplat.export, model, path, spz_version=5)
        self.assert_refused("spz_sh_bits takes a whole number from 1 to 8", model.save, path, spz_sh_bits=9)

    def test_a_process_that_was_forked_ends(self):
        gemsplat.Model(**random_arrays()).save(self.folder / "model.ply")  # starts the threads
        child = multiprocessing.get_context("fork").Process(target=sys.exit)
        child.start()
        child.join(30)
        self.assertEqual(child.exitcode, 0)

    def test_rows_that_became_nan_are_left_out(self):
        model = gemsplat.Model(**random_arrays())
        model.means[5] = np.nan
        self.assertEqual(model.save(self.folder / "model.ply"), 49)
        self.assertEqual(len(gemsplat.load(self.folder / "model.ply")), 49)

    def test_trouble_with_files_is_an_error_with_the_text_of_the_program(self):
        model = gemsplat.Model(**random_arrays())
        self.assert_refused("gemsplat does not write .txt; it writes .ply", model.save, self.folder / "model.txt")
        with self.assertRaisesRegex(gemsplat.Error, "missing.ply"):
            gemsplat.load(self.folder / "missing.ply")
        (self.folder / "broken.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\n")
        with self.assertRaisesRegex(gemsplat.Error, "broken.ply"):
            gemsplat.load(self.folder / "broken.ply")
        with self.assertRaisesRegex(gemsplat.Error, "holds no point_cloud"):
            gemsplat.load(self.folder)


class Points(TestCase):
    def test_distances_to_the_nearest_points_are_those_of_numpy(self):
        points = np.random.default_rng(1).normal(size=(60, 3)).astype(np.float32)
        squares = np.sort(((points[:, None].astype(np.float64) - points)**2).sum(-1), 1)  # the first is the point itself
        np.testing.assert_allclose(gemsplat.nearest_distances(points), squares[:, 1:4].mean(1), rtol=1e-5)
        np.testing.assert_allclose(gemsplat.nearest_distances(points, 5), squares[:, 1:6].mean(1), rtol=1e-5)
        np.testing.assert_array_equal(gemsplat.nearest_distances([[1, 2, 3], [1, 2, 5]]), [4, 4])
        np.testing.assert_array_equal(gemsplat.nearest_distances([[1, 2, 3]]), [0])
        self.assertEqual(gemsplat.nearest_distances(np.zeros((0, 3))).shape, (0,))

    def test_points_and_numbers_that_cannot_be_are_refused(self):
        self.assert_refused("k must lie between 1 and 16, but is 17", gemsplat.nearest_distances, np.zeros((4, 3)), 17)
        self.assert_refused("points holds nan in row 1", gemsplat.nearest_distances, [[0, 0, 0], [0, float("nan"), 0]])


class WithoutNumPy(TestCase):
    def test_the_import_names_the_python_that_lacks_it(self):
        script = "import sys; sys.modules['numpy'] = None; import gemsplat"
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn(f"gemsplat needs NumPy, and {sys.executable} lacks it", done.stderr)


class Edits(TestCase):
    def test_rows_are_kept_or_dropped_by_an_array_and_the_model_stays(self):
        model = gemsplat.Model(**random_arrays(), antialiased=True, world_offset=(1, 2, 3))
        faint = model.opacities < 0.5
        kept, dropped = model.keep(faint), model.drop(faint)
        np.testing.assert_array_equal(kept.means, model.means[faint])
        np.testing.assert_array_equal(dropped.sh_rest, model.sh_rest[~faint])
        self.assertEqual(len(model), 50)
        self.assertEqual((kept.antialiased, kept.world_offset, kept.sh_degree), (True, (1.0, 2.0, 3.0), 3))

    def test_operations_apply_in_their_order(self):
        model = gemsplat.Model(**random_arrays())
        edited = model.edit("move 10,0,0", "keep x=10..", "sh-degree 1")
        right = model.means[:, 0] >= 0
        np.testing.assert_allclose(edited.means, model.means[right] + [10, 0, 0], rtol=1e-6)
        self.assertEqual(edited.sh_rest.shape[1], 3)
        self.assertEqual(len(model.edit("decimate 0.5")), 25)
        self.assertEqual(len(model.edit("decimate 10", decimate_by="drop")), 10)
        turned = model.edit("turn 0,0,90", about=(1, 0, 0))
        np.testing.assert_allclose(turned.means[:, 0], 1 - model.means[:, 1], atol=1e-5)

    def test_cameras_choose(self):
        model = gemsplat.Model(**random_arrays())
        camera = gemsplat.Camera(64, 48, 60, name="front")
        seen = model.edit("keep view=front", cameras=[camera])
        self.assertTrue(np.all(seen.means[:, 2] > 0))
        self.assertGreater(len(seen), 0)
        self.assertLessEqual(len(model.edit("keep seen=1", cameras=[camera], device="cpu")), 50)
        self.assert_refused("needs cameras", model.edit, "keep seen=1")

    def test_models_are_merged_in_the_frame_of_the_first(self):
        model = gemsplat.Model(**random_arrays())
        both = gemsplat.merge([model, model.edit("move 5,0,0")])
        np.testing.assert_allclose(both.means[50:], model.means, atol=1e-5)
        both = gemsplat.merge([model, model.edit("move 5,0,0")], as_stored=True)
        np.testing.assert_allclose(both.means[50:], model.means + [5, 0, 0], atol=1e-5)

    def test_a_moved_model_is_saved_with_the_way_back(self):
        gemsplat.Model(**random_arrays()).edit("move 5,0,0").save(self.folder / "moved.ply")
        again = gemsplat.load(self.folder / "moved.ply")
        np.testing.assert_allclose(again.means[:, 0], random_arrays()["means"][:, 0] + 5, rtol=1e-5)
        back = gemsplat.merge([gemsplat.Model(**random_arrays()), again])
        np.testing.assert_allclose(back.means[50:], back.means[:50], atol=1e-5)

    def test_mistakes_are_refused(self):
        model = gemsplat.Model(**random_arrays())
        self.assert_refused("did you mean opacity", model.edit, "keep opacty=0.1..")
        self.assert_refused("operations are words", model.edit, model.opacities > 0.5)
        self.assert_refused("an array of 50 booleans", model.keep, [True])
        self.assert_refused("an array of 50 booleans", model.keep, np.arange(50))
        self.assert_refused("decimate_by takes merge or drop, and not", model.edit, "decimate 5", decimate_by="magic")
        self.assert_refused("one model at least", gemsplat.merge, [])


if __name__ == "__main__":
    unittest.main()
