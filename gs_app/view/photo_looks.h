// SPDX-License-Identifier: Apache-2.0
// The looks of photos in the viewer: what a run's photometric model has learned of each of them
// (photometric.json), for the page's shader and for frames of --remote.
#pragma once

#include <string>

#include "gs_core/system/text/json.h"
#include "gs_eval/looks/scene_looks.h"

namespace gs {

/// The name in `looks` of a photo that may be called without its extension; "" if there is none.
std::string photo_in(const SceneLooks& looks, const std::string& name);

/// The look of a photo, which the page computes as in look.js: {"gain": [r, g, b]}
Json look_json(const SceneLooks& looks, const std::string& photo);

}  // namespace gs
