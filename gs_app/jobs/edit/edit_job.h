// SPDX-License-Identifier: Apache-2.0
// What gemsplat edit is asked for.
#pragma once

#include <string>
#include <vector>

#include "gs_app/blocks/blocks_file.h"
#include "gs_app/edit/edit_step.h"
#include "gs_app/jobs/parts/job.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/run/open_model.h"
#include "gs_model/formats/formats.h"

namespace gs {

struct EditJob : JobSettings {
  std::vector<std::string> inputs, block_runs;
  std::string output, cameras, picture, picture_view;
  Operations operations;
  std::string about = "0,0,0", plane = "xz", decimate_by = "merge", antialiased;
  ModelChoice choice;
  ExportOptions options;
  bool whole = false, as_stored = false, measure = false, dry_run = false, force = false;

  /// Whether the input is what `gemsplat partition` has written.
  bool has_blocks() const { return inputs.size() == 1 && is_partition(inputs.front()); }
};

void visit_options(EditJob& job, OptionList& option);

/// All models as one, with what is known of them.
struct EditInputs {
  EditModel model;
  Config config;                 // that of the first
  std::optional<RunFolder> run;  // of the first
  Json described = Json::array();
};

/// Reads them, with the cameras that go with them if asked for. Throws Error.
EditInputs open_inputs(const EditJob& job, bool with_cameras);

/// "house.ply", or "3 models merged".
std::string name_of_inputs(const EditJob& job, const EditInputs& inputs);

}  // namespace gs
