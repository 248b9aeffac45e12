# SPDX-License-Identifier: Apache-2.0
"""The .npz of c3dgs against NumPy: its arrays are read, and ours have its names, types and shapes."""

import unittest

import numpy as np

import gemsplat
from support import TestCase, random_arrays


def quantized(arrays, name, values):
    """Adds int8 values with a scale and a zero point, and returns what they stand for."""
    low, high = min(values.min(), 0), max(values.max(), 0)
    scale = np.float32((high - low) / 255)
    zero = np.int32(-128 - np.round(low / scale))
    arrays[name] = np.clip(np.round(values / scale) + zero, -128, 127).astype(np.int8)
    arrays[name + "_scale"], arrays[name + "_zero_point"] = np.array([scale]), np.array([zero])
    return (arrays[name].astype(np.float32) - zero) * scale


class Npz(TestCase):
    def test_a_file_of_numpy_is_read(self):
        rng = np.random.default_rng(3)
        count, colors, shapes = 40, 7, 5
        arrays = {"quantization": np.array(True)}
        arrays["xyz"] = rng.uniform(-2, 2, (count, 3)).astype(np.float16)
        arrays["feature_indices"] = rng.integers(0, colors, count).astype(np.int32)
        arrays["gaussian_indices"] = rng.integers(0, shapes, count).astype(np.int32)
        opacity = quantized(arrays, "opacity", rng.uniform(0.05, 0.9, (count, 1)))
        dc = quantized(arrays, "features_dc", rng.normal(size=(colors, 1, 3)))
        rest = quantized(arrays, "features_rest", rng.normal(size=(colors, 15, 3)))
        scaling = quantized(arrays, "scaling", rng.uniform(0.2, 1, (shapes, 3)))
        factor = quantized(arrays, "scaling_factor", rng.uniform(-6, -1, (count, 1)))
        rotation = quantized(arrays, "rotation", rng.normal(size=(shapes, 4)))
        np.savez_compressed(self.folder / "model.npz", **arrays)

        model = gemsplat.load(self.folder / "model.npz")
        of_color, of_shape = arrays["feature_indices"], arrays["gaussian_indices"]
        self.assertEqual(model.sh_degree, 3)
        np.testing.assert_array_equal(model.means, arrays["xyz"].astype(np.float32))
        np.testing.assert_allclose(model.opacities, opacity[:, 0], atol=1e-5)
        np.testing.assert_allclose(model.sh0, dc[of_color, 0], atol=1e-5)
        np.testing.assert_allclose(model.sh_rest, rest[of_color], atol=1e-5)
        unit = np.maximum(scaling, 0) / np.linalg.norm(np.maximum(scaling, 0), axis=1, keepdims=True)
        np.testing.assert_allclose(model.scales, np.exp(factor) * unit[of_shape], rtol=1e-4)
        turned = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True))[of_shape]
        np.testing.assert_allclose(model.unit_rotations, turned, atol=1e-5)

    def test_a_file_without_quantization_and_codebooks_is_read(self):
        given = random_arrays(count=30)
        np.savez(
            self.folder / "model.npz", quantization=np.array(False), xyz=given["means"],
            opacity=given["logit_opacities"][:, None], features_dc=given["sh0"][:, None],
            features_rest=given["sh_rest"], scaling=given["log_scales"], rotation=given["rotations"])
        model = gemsplat.load(self.folder / "model.npz")
        for name in ["means", "logit_opacities", "sh0", "sh_rest", "log_scales"]:
            np.testing.assert_array_equal(getattr(model, name), given[name], name)

    def test_numpy_reads_what_gemsplat_writes(self):
        for degree in range(4):
            count = 50
            model = gemsplat.Model(**random_arrays(count=count, sh_degree=degree), antialiased=True)
            file = self.folder / f"degree_{degree}.npz"
            model.save(file)
            with np.load(file) as data:
                arrays = dict(data)
            sides = {"xyz": (count, 3), "opacity": (count, 1), "scaling_factor": (count, 1),
                     "feature_indices": (count,), "gaussian_indices": (count,),
                     "features_dc": (count, 1, 3), "features_rest": (count, (degree + 1) ** 2 - 1, 3),
                     "scaling": (count, 3), "rotation": (count, 4), "quantization": (), "mip_splatting": ()}
            types = {"xyz": np.float16, "feature_indices": np.int32, "gaussian_indices": np.int32,
                     "quantization": np.bool_, "mip_splatting": np.bool_}
            for name, shape in sides.items():
                self.assertEqual(arrays[name].shape, shape, name)
                self.assertEqual(arrays[name].dtype, types.get(name, np.int8), name)
                if arrays[name].dtype == np.int8:
                    self.assertEqual(arrays[name + "_scale"].dtype, np.float32)
                    self.assertEqual(arrays[name + "_zero_point"].dtype, np.int32)
            self.assertTrue(arrays["mip_splatting"])
            # The opacities, in another order.
            opacity = (arrays["opacity"].astype(np.float32) - arrays["opacity_zero_point"]) * arrays["opacity_scale"]
            np.testing.assert_allclose(np.sort(opacity[:, 0]), np.sort(model.opacities), atol=0.003)
            self.assertTrue(gemsplat.load(file).antialiased)


if __name__ == "__main__":
    unittest.main()
