// SPDX-License-Identifier: Apache-2.0
// The scenes in an experiment's tables: the settings that are theirs alone, and the views that runs
// were trained on.
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/tables/table_rows.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// The views of a scene as the runs of some configs saw them.
struct SceneViews {
  std::string scene_hash;
  std::size_t train_views = 0, test_views = 0;
  std::string size;  // "640x480" in pixels; "640x480 and 2 other sizes"

  bool operator==(const SceneViews&) const = default;
};

struct SceneRow {
  struct Variant {
    SceneViews views;
    std::vector<std::string> configs;  // whose runs were trained on these views
  };

  std::string name, path;
  Json settings;  // of the scene's own `set`
  /// Usually one; several if configs change the views, e.g. with different resolutions. Empty
  /// before a run has finished.
  std::vector<Variant> variants;
};

/// A row for every scene of the experiment. Reads split.json and cameras.json of finished runs; a
/// run in which they are missing or damaged is left out.
std::vector<SceneRow> scenes_of(const Experiment& experiment, const std::vector<RunRow>& rows);

}  // namespace gs
