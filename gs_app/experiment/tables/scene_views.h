// SPDX-License-Identifier: Apache-2.0
// The views of an experiment's scenes, as its runs were trained on them.
#pragma once

#include <string>

#include "gs_app/experiment/experiment_run.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// The views of a scene as a list of {"configs", "scene_hash", "train_views", "test_views", "size"}:
/// usually one entry; several if configs change the views, e.g. with different resolutions. "size"
/// is "640x480" in pixels, or "640x480 and 2 other sizes". `runs` are entries of "runs" in
/// results.json. Reads split.json and cameras.json of those that are finished; a run in which they
/// are missing or damaged is left out.
Json views_json(const std::string& scene, const Json& runs);

}  // namespace gs
