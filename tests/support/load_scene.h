// SPDX-License-Identifier: Apache-2.0
// Loading a scene's folder as most tests do, and the error of one that must be refused.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "data_loaders/scene/load_scene.h"
#include "gs_core/error.h"

namespace gs {

inline DatasetConfig dataset_at(const std::filesystem::path& folder) {
  DatasetConfig dataset;
  dataset.source = folder.string();
  return dataset;
}

/// The message of load_scene(), which must throw an Error.
inline std::string error_of(const DatasetConfig& dataset) {
  try {
    load_scene(dataset);
  } catch (const Error& error) {
    return error.what();
  }
  ADD_FAILURE() << "load_scene threw no Error";
  return "";
}

}  // namespace gs
