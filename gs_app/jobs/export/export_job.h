// SPDX-License-Identifier: Apache-2.0
// What gemsplat export is asked for.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/export/export_model.h"
#include "gs_app/jobs/parts/job.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/run/open_model.h"
#include "gs_model/tiles/tileset.h"

namespace gs {

struct ExportJob : JobSettings {
  std::string model;
  std::vector<std::string> outputs;  // none: one beside the model
  ModelChoice choice;
  std::optional<double> time;
  ExportOptions options;
  std::vector<double> up;  // empty: no turn
  double scale = 1;
  double megabytes = 0;  // of each file at most, in millions of bytes; 0: any
  std::string georef;    // empty: that of the scene, if there is one
  std::string title;     // of a page; empty: the name of the scene
  std::size_t tile_gaussians = kTileGaussiansAtMost;
  bool recenter = false, force = false, table = false, unmeasured = false;
};

void visit_options(ExportJob& job, OptionList& option);

/// Whether an output ends in /, and so is the folder of a tileset.
bool is_tileset(const ExportJob& job, const std::string& output);
/// Whether an output ends in .html, and so is the viewer's page with the model inside.
bool is_page(const ExportJob& job, const std::string& output);
/// The table of --table, in its folder.
std::filesystem::path table_file(const std::string& folder);

/// All that is to be written.
struct ExportOutputs {
  std::vector<ExportRequest> files;
  std::vector<TilesetRequest> tilesets;
  std::vector<std::filesystem::path> pages;
};

/// The outputs of the request, which gets one if it has none. Throws UsageError where one of them
/// cannot be written or is there already.
ExportOutputs outputs_of(ExportJob& job, const OpenedModel& opened, const Config& config);

}  // namespace gs
