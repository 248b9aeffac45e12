// SPDX-License-Identifier: Apache-2.0
// The model's file as the page gets it: the original if the page can read it, otherwise a file made
// from it: a .gs4d of Gaussians in space and time, a PLY of others.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "gs_app/run/open_model.h"
#include "gs_core/system/files/scratch_folder.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/formats.h"

namespace gs {

struct ServedModel {
  std::filesystem::path file;
  const ModelFormat* format = nullptr;  // of `file`
  std::string name;                     // of the original file
  std::size_t gaussians = 0;
  int sh_degree = 0;
  bool antialiased = false;
  std::shared_ptr<const ScratchFolder> scratch = {};  // holds `file` if it was made
};

/// Whether the page can read the file: a binary little-endian PLY whose properties are all floats,
/// a compressed PLY, .spz up to version 3, .sog, .splat, .gs4d or .rad. Throws Error if the file
/// cannot be read.
bool is_served_as_it_is(const std::filesystem::path& file);

/// Gaussians: 400 MB and more as a PLY, and the first picture comes after a twentieth of the bytes.
inline constexpr std::size_t kWorthStreaming = 2'000'000;

/// Makes another file if one is needed. A model of `stream_from` Gaussians or more that stands still
/// becomes a .rad, which the page streams; 0: none does. Throws Error if a file cannot be written.
ServedModel serve_model(const OpenedModel& opened, std::size_t stream_from = kWorthStreaming);

/// "model" of /scene.json: {"format", "gaussians", "bytes", "sh_degree", "antialiased", "name",
/// "world_from_file"}. The matrix, 4x4 by rows, transforms the file's axes to those of the cameras.
Json model_json(const ServedModel& model);

/// The same for a file in memory.
Json model_json(const ModelFormat& format, const std::string& name, std::size_t gaussians,
                std::uint64_t bytes, int sh_degree, bool antialiased);

}  // namespace gs
