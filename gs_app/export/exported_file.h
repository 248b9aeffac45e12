// SPDX-License-Identifier: Apache-2.0
// One file of an export: written, measured, and described by a sidecar.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "data_loaders/formats/formats.h"
#include "data_loaders/formats/model_transform.h"
#include "gs_app/export/fidelity.h"

namespace gs {

struct ExportRequest {
  std::filesystem::path file;
  ExportOptions options;
  ModelTransform transform;
};

/// What has become of it.
struct ExportedFile {
  std::filesystem::path file;
  const ModelFormat* format = nullptr;
  std::size_t gaussians = 0;
  std::uint64_t bytes = 0;
  std::optional<Fidelity> fidelity;  // of a lossy format that is read, where there were viewpoints

  double bytes_per_gaussian() const { return gaussians ? double(bytes) / double(gaussians) : 0; }
};

/// Throws UsageError for a file that is there already and may not be moved aside (`force`), or is none.
void check_place(const std::filesystem::path& file, bool force);
/// A file that is there gets the name FILE.bak-N, and the log says so; it stays until the newer one is whole.
void keep_older_aside(const std::filesystem::path& file);

/// Throws UsageError for a name that says no format, or one of a file that is there already and may not be moved aside
/// (`force`); Error where this build cannot write the format. To be asked before the work starts.
void check_export(const ExportRequest& request, bool force);

/// Writes the model, and the sidecar (sidecar_of() in open_model.h): {"file", "format", "gaussians", "bytes", "bytes_per_gaussian", "antialiased",
///   "axes": {"x", "y", "z"},               of the numbers in the file
///   "input_from_file", "file_from_input"   4x4 by rows; the input's frame is that of the photos' poses
///   "input_from_train", "train_from_input" the same for the frame that the model was trained in
///   "fidelity": {"psnr", "ssim", "num_views"}}  against the model itself, where it was measured
/// A lossy format is measured where `viewpoints` are given. A file that is there is kept as FILE.bak-N. Throws Error.
ExportedFile export_model(const GaussianModel& model, const ExportRequest& request,
                          const Viewpoints* viewpoints);

/// "out/a.spz: 1.2 MB, 15.8 bytes per Gaussian; 41.20 dB PSNR, 0.9912 SSIM against the model on 7 test views"
std::string summary(const ExportedFile& exported, const Viewpoints* viewpoints);

/// The same of many as a table in Markdown.
std::string export_table(const std::vector<ExportedFile>& files);

}  // namespace gs
