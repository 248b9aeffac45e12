// SPDX-License-Identifier: Apache-2.0
// What gemsplat export is asked for.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gs_app/export/export_model.h"
#include "gs_app/jobs/job.h"
#include "gs_app/jobs/shared_options.h"
#include "gs_model/tiles/tileset.h"

namespace gs {

struct ExportJob : JobSettings {
  std::string model;
  std::vector<std::string> outputs;
  ModelChoice choice;
  std::optional<double> time;
  ExportOptions options;
  std::vector<double> up;  // empty: no turn
  double scale = 1;
  std::string georef;  // empty: that of the scene, if there is one
  std::string title;   // of a page; empty: the name of the scene
  std::size_t tile_gaussians = kTileGaussiansAtMost;
  bool recenter = false, force = false, table = false, unmeasured = false;
};

void visit_options(ExportJob& job, OptionList& option);
Outcome run(const ExportJob& job, JobEvents& events);

}  // namespace gs
