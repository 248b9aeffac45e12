// SPDX-License-Identifier: Apache-2.0
// The views of a run's report: the metrics of all views, and pictures of some, which the page
// contains.
#pragma once

#include <string>
#include <vector>

#include "gs_app/pictures/comparison.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// The views of `count` whose pictures a report shows, ascending.
std::vector<std::size_t> shown_in_report(std::size_t count);

/// A picture with at most 800 pixels on a side, as a data URI of a JPEG.
std::string page_picture(const Image8& image);

/// The names of the views of a split, in the order of their pictures in the folder.
std::vector<std::string> names_of_pictures(const RunFolder& folder, const std::string& split);

/// {"split", "total", "list": [{"name", "psnr", "ssim", "flip", "lpips",
/// "width", "height", "photo", "render", "error", "flip_picture"}, ...]}: the test views, or the training views of results.json if nothing was held out.
/// Null if the run has no evaluation. Pictures are data URIs of JPEGs with at most 800 pixels on a
/// side, of up to 24 evenly chosen views, and at most 12 MiB together. Pictures that are not among
/// `known` are read from the folder. A sentence about missing ones is added to `notes`. Throws Error
/// if a file is damaged.
Json report_views(const RunFolder& folder, int step, const ShownViews& known,
                  std::vector<std::string>& notes);

}  // namespace gs
