// SPDX-License-Identifier: Apache-2.0
// The file that a browser gets of a model: the model's own where the page's renderer reads its kind, else a PLY made of it.
#pragma once

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "data_loaders/formats/formats.h"
#include "gs_app/run/open_model.h"
#include "gs_core/io/scratch_folder.h"

namespace gs {

struct ServedModel {
  std::filesystem::path file;
  const ModelFormat* format = nullptr;  // of `file`
  std::string name;                     // of the model's own file
  std::size_t gaussians = 0;
  int sh_degree = 0;
  bool antialiased = false;
  std::shared_ptr<const ScratchFolder> scratch = {};  // holds `file` where it was made
};

/// Whether the page reads the file as it is: a binary little-endian PLY all of floats or a compressed one, .spz up to version 3,
/// .sog, .splat. Throws Error where it cannot be read.
bool is_served_as_it_is(const std::filesystem::path& file);

/// Throws Error where a PLY has to be made and cannot be written.
ServedModel serve_model(const OpenedModel& opened);

/// "model" of /scene.json: {"format", "gaussians", "bytes", "sh_degree", "antialiased", "name", "world_from_file"}. The
/// matrix, 4x4 by rows, takes the file's axes to those of the cameras.
nlohmann::ordered_json model_json(const ServedModel& model);

/// The same of bytes in memory.
nlohmann::ordered_json model_json(const ModelFormat& format, const std::string& name,
                                  std::size_t gaussians, std::uint64_t bytes, int sh_degree,
                                  bool antialiased);

}  // namespace gs
