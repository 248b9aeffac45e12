// SPDX-License-Identifier: Apache-2.0
// Where a model to edit comes from, and the cameras that move with it.
//
//   OpenedModel opened = open_model("out/scene", {});
//   const RunFolder run = *opened.run;
//   EditModel model = model_to_edit(std::move(opened));
//   model.cameras = cameras_to_edit(run, model);
//   keep_rows(model, rows_marked(marks));                        // select.h
//   straighten(model);
//   ExportRequest request{"small.spz"};
//   request.input_from_model = model.input_from_model;
//   export_model(model.model, request);
#pragma once

#include <filesystem>
#include <vector>

#include "gs_app/run/open_model.h"
#include "gs_model/edit/edit_model.h"

namespace gs {

/// The model of a file or run, without cameras.
EditModel model_to_edit(OpenedModel opened);

/// The cameras of a run, of a file (read_cameras.h) or of a scene, in the frame of the model.
/// Throws Error.
std::vector<EditCamera> cameras_to_edit(const RunFolder& run, const EditModel& model);
std::vector<EditCamera> cameras_to_edit(const std::filesystem::path& file, const EditModel& model);
std::vector<EditCamera> cameras_to_edit(const DatasetConfig& scene, const EditModel& model);

}  // namespace gs
