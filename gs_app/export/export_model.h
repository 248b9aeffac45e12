// SPDX-License-Identifier: Apache-2.0
// The one place that writes files of trained Gaussians for users: gemsplat export, prune and
// train --export, and Python's export() and Model.save(). A file is written, measured, and described by its
// sidecar.
//
//   ExportRequest request{"out/scene.spz"};
//   check_export(request, force);                 // before the work starts
//   ExportedFile file = export_model(model, request, &viewpoints);
//   std::cout << summary(file, &viewpoints);
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "gs_app/export/fidelity.h"
#include "gs_model/formats/sidecar.h"

namespace gs {

struct ExportRequest {
  std::filesystem::path file;  // its ending is the format
  ExportOptions options = {};
  ModelTransform transform = {};
  int sh_degree = kMaxShDegree;  // the file has no higher one
  std::uint64_t most_bytes = 0;  // of the file, by fit_size(); 0: any
  // Where the model was moved before: from its numbers to the photos' frame (OpenedModel).
  std::optional<Mat4d> input_from_model = {};
  std::optional<Georeference> georeference = {};  // of the model's scene, for the sidecar
};

/// Throws UsageError where `file` exists and may not be moved aside (`force`), or is not a file. The
/// message says how to allow it.
void check_place(const std::filesystem::path& file, bool force,
                 std::string_view how_to_force = "add --force");
/// Renames an existing file to FILE.bak-N, and logs that.
void keep_older_aside(const std::filesystem::path& file);

/// Throws UsageError for a name without a format, and where check_place() throws for the file or
/// its sidecar; Error where this build lacks a library for the format. Writes nothing.
void check_export(const ExportRequest& request, bool force,
                  std::string_view how_to_force = "add --force");

/// Whether the file will differ from a model of SH degree `sh_degree` and can be read again, so
/// that the difference can be measured.
bool is_lossy(const ExportRequest& request, int sh_degree);

/// Writes the file and its sidecar; older ones become FILE.bak-N. A lossy file is read again and
/// compared with the model where `viewpoints` are given. Throws Error.
ExportedFile export_model(const GaussianModel& model, const ExportRequest& request,
                          const Viewpoints* viewpoints = nullptr);

/// "out/a.spz: 1.2 MB, 15.8 bytes per Gaussian; 41.20 dB PSNR, 0.9912 SSIM against the model on 7
/// test views"
std::string summary(const ExportedFile& exported, const Viewpoints* viewpoints);

/// The same for many files, as a table in Markdown.
std::string export_table(const std::vector<ExportedFile>& files);

}  // namespace gs
