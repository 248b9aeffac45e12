// SPDX-License-Identifier: Apache-2.0
// Loading a scene's folder as most tests do, and the error of one that must be refused.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/scene/load_scene.h"
#include "tests/support/captured_log.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"

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

/// The log of load_scene().
inline std::string log_of(const DatasetConfig& dataset) {
  CapturedLog logged;
  load_scene(dataset);
  return logged.text();
}

inline std::vector<std::string> names_of(const std::vector<View>& views) {
  std::vector<std::string> names;
  for (const View& view : views) names.push_back(view.name);
  return names;
}

/// A test of the scene in a folder of its own.
class SceneTest : public FolderTest {
 protected:
  std::filesystem::path image(const std::string& name) const { return folder() / "images" / name; }
  /// Writes the model, with a plain photo for each image.
  void write(const ColmapModel& model) const { write_scene(folder(), model); }
  DatasetConfig dataset() const { return dataset_at(folder()); }
  Scene load() const { return load_scene(dataset()); }
  std::string error() const { return error_of(dataset()); }
};

}  // namespace gs
