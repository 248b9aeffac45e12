// SPDX-License-Identifier: Apache-2.0
// FILE.transforms.json, the sidecar of an exported file: where its numbers lie, and what its format
// cannot say.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "gs_core/gaussians.h"
#include "gs_core/geodesy/georeference.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/formats/formats.h"

namespace gs {

/// How much of a model a lossy file has kept: means over views, of the picture of the file against
/// the picture of the model, both in 8 bits.
struct Fidelity {
  double psnr = 0, ssim = 0;  // psnr in dB, 100 where no pixel differs
  std::size_t num_views = 0;
};

/// The frames of an exported file. "train" is the frame of the model in memory, "input" that of the
/// photos' poses (train + world offset), "file" that of the numbers in the file.
struct FileFrames {
  Mat4d file_from_train, input_from_train;

  Mat4d input_from_file() const { return multiply(input_from_train, inverse_of(file_from_train)); }
};

/// The frames of a model that `transform` moves on its way into a file of `format`.
FileFrames frames_of(const ModelFormat& format, const GaussianModel& model,
                     const ModelTransform& transform);

/// A file of Gaussians that was written.
struct ExportedFile {
  std::filesystem::path file;
  const ModelFormat* format = nullptr;
  FileFrames frames;
  int sh_degree = 0;  // of the file
  bool antialiased = false;
  std::size_t gaussians = 0;
  std::uint64_t bytes = 0;
  std::optional<Fidelity> fidelity = {};          // where it was measured
  bool was_moved = false;                         // before: the model has a frame of its own
  std::optional<Georeference> georeference = {};  // where it is known

  double bytes_per_gaussian() const { return gaussians ? double(bytes) / double(gaussians) : 0; }
};

/// FILE.transforms.json
std::filesystem::path sidecar_of(const std::filesystem::path& file);

/// Writes the sidecar, whole or not at all; throws Error. It is a JSON object:
///   "file", "format", "gaussians", "bytes", "bytes_per_gaussian", "sh_degree", "antialiased"
///   "axes": {"x", "y", "z"}                of the numbers in the file: "right", "up", ...
///   "input_from_file", "file_from_input"   4x4 by rows
///   "input_from_train", "train_from_input"
///   "was_moved": true                      only where a model was moved on purpose (gemsplat edit)
///   "fidelity": {"psnr", "ssim", "num_views"}
///   "georeference": {"origin": [longitude, latitude, height], "enu_from_file", "ecef_from_file"}
void write_sidecar(const ExportedFile& exported);

/// Takes from the sidecar of `file`, where there is one, what the format cannot say: whether the
/// model is antialiased, its world offset, and that gemsplat wrote it. A damaged sidecar is
/// ignored, with a warning. `model` is what read_model() gave.
///
/// A file that was turned or scaled, or moved by `gemsplat edit`, has a frame of its own, and no
/// world offset is taken. Returned is then the matrix from the model's numbers to the photos'
/// frame.
std::optional<Mat4d> take_sidecar(const std::filesystem::path& file, GaussianModel& model);

}  // namespace gs
