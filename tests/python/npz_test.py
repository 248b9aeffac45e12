# SPDX-License-Identifier: Apache-2.0
"""The .npz of c3dgs against NumPy: its arrays are read, and ours have its names, types and shapes."""

import io
import unittest
import zipfile

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


class Vectree(TestCase):
    """The extreme_saving.zip of LightGaussian."""

    def test_arrays_of_numpy_are_read(self):
        rng = np.random.default_rng(4)
        count, rest = 21, 8  # SH degree 2
        own = rng.random(count) < 0.4
        index = rng.integers(0, 8, count)
        codebook, own_colors = (rng.normal(size=(rows, 3 + 3 * rest)).astype(np.float16) for rows in (8, own.sum()))
        other = rng.normal(size=(count, 8)).astype(np.float16)
        means = rng.normal(size=(count, 3)).astype(np.float32)
        bits = (index[~own, None] >> np.array([2, 1, 0])) & 1
        arrays = {"xyz": means, "other_attribute": other, "codebook": codebook, "non_vq_feats": own_colors,
                  "non_vq_mask": np.packbits(own), "vq_indexs": np.packbits(bits.reshape(-1).astype(bool))}
        with zipfile.ZipFile(self.folder / "extreme_saving.zip", "w") as archive:
            for name, array in arrays.items():
                buffer = io.BytesIO()
                np.savez_compressed(buffer, array)
                archive.writestr(f"somewhere/extreme_saving/{name}.npz", buffer.getvalue())

        model = gemsplat.load(self.folder / "extreme_saving.zip")
        colors = np.empty((count, 3 + 3 * rest), np.float32)
        colors[own], colors[~own] = own_colors, codebook[index[~own]]
        self.assertEqual(model.sh_degree, 2)
        np.testing.assert_array_equal(model.means, means)
        np.testing.assert_array_equal(model.logit_opacities, other[:, 0].astype(np.float32))
        np.testing.assert_array_equal(model.log_scales, other[:, 1:4].astype(np.float32))
        turned = other[:, 4:].astype(np.float32)
        np.testing.assert_allclose(model.rotations, turned / np.linalg.norm(turned, axis=1, keepdims=True), atol=1e-6)
        np.testing.assert_array_equal(model.sh0, colors[:, :3])
        np.testing.assert_array_equal(model.sh_rest[:, :rest], colors[:, 3:].reshape(count, 3, rest).transpose(0, 2, 1))

    def test_numpy_reads_what_gemsplat_writes(self):
        given = random_arrays(count=30)
        gemsplat.Model(**given).save(self.folder / "a.extreme_saving.zip")
        with zipfile.ZipFile(self.folder / "a.extreme_saving.zip") as archive:
            archive.extractall(self.folder)

        def load(name, array="arr_0"):
            return np.load(self.folder / "extreme_saving" / f"{name}.npz", allow_pickle=True)[array]

        self.assertEqual(load("metadata", "metadata").item(), {"input_pc_num": 30, "input_pc_dim": 62, "codebook_size": 8192,
                                                               "codebook_dim": 48})
        own = np.unpackbits(load("non_vq_mask"))[:30].astype(bool)
        self.assertEqual(own.sum(), 12)
        index = np.unpackbits(load("vq_indexs"))[:18 * 13].reshape(18, 13) @ (1 << np.arange(12, -1, -1))
        colors = np.empty((30, 48), np.float32)
        colors[own], colors[~own] = load("non_vq_feats"), load("codebook")[index]
        expected = np.concatenate([given["sh0"], given["sh_rest"].transpose(0, 2, 1).reshape(30, 45)], axis=1)
        np.testing.assert_allclose(colors, expected, rtol=1e-3, atol=1e-3)
        np.testing.assert_array_equal(load("xyz"), given["means"])


if __name__ == "__main__":
    unittest.main()
