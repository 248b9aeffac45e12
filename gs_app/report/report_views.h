// SPDX-License-Identifier: Apache-2.0
// The views of a run's report: figures of all, and pictures of some, in the page itself.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "gs_app/run/run_folder.h"

namespace gs {

/// {"split", "total", "list": [{"name", "psnr", "ssim", "width", "height", "photo", "render", "error"}, ...]}: the test views, or
/// the training views of results.json where nothing was held out. Null where the run was not evaluated at `step`. Pictures are
/// data URIs of JPEGs, at most 800 pixels long, of up to 24 views, evenly chosen, and no more than 12 MiB in all. What is
/// missing is added to `notes`. Throws Error where a file is damaged.
nlohmann::ordered_json report_views(const RunFolder& folder, int step,
                                    std::vector<std::string>& notes);

}  // namespace gs
