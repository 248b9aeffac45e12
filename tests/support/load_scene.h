// SPDX-License-Identifier: Apache-2.0
// Loading a scene's folder as most tests do, and the error of one that must be refused.
#pragma once

#include <filesystem>
#include <string>

#include "data_loaders/scene/load_scene.h"
#include "tests/support/error_of.h"

namespace gs {

inline DatasetConfig dataset_at(const std::filesystem::path& folder) {
  DatasetConfig dataset;
  dataset.source = folder.string();
  return dataset;
}

/// The message of load_scene(), which must throw an Error.
inline std::string error_of(const DatasetConfig& dataset) {
  return error_of([&] { load_scene(dataset); });
}

}  // namespace gs
