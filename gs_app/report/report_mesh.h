// SPDX-License-Identifier: Apache-2.0
// The mesh of a run in its report.
#pragma once

#include <string>
#include <vector>

#include "gs_app/run/run_folder.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// {"name", "triangles", "vertices", "texture": [width, height] or null, "pictures": [{"name",
/// "photo", "mesh"}, ...], "views", "psnr", "ssim", "covered"} of the run's mesh (model_mesh.h):
/// means over up to 8 of the views whose photos are in the run's folder, of which up to two are
/// shown. Null if there is no mesh, or none that can be read, which is added to `notes`.
Json report_mesh(const RunFolder& folder, int step, std::vector<std::string>& notes);

}  // namespace gs
