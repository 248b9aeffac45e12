// SPDX-License-Identifier: Apache-2.0
// The cameras of gemsplat render.
#pragma once

#include "gs_app/jobs/render/render_job.h"
#include "gs_app/run/open_model.h"
#include "gs_core/geometry/scene_frame.h"

namespace gs {

/// The cameras of --cameras, of --data or of the run itself. A path follows training views unless
/// --split or --through says otherwise.
std::vector<NamedCamera> cameras_to_render(const RenderJob& job, const OpenedModel& opened,
                                           const Config& config);

std::vector<Camera> without_names(const std::vector<NamedCamera>& cameras);

/// Gives the cameras the size and lens of the command line. All frames of a film have the size of
/// the first, and even sides, because H.264 stores one color for 2x2 pixels.
///
/// frame   that of the cameras; it says which way is up
void fit_cameras(const RenderJob& job, ViewPictures& pictures, const SceneFrame& frame,
                 std::vector<NamedCamera>& cameras);

/// A path plays the scene from its begin to its end, if nothing else is said; one of key frames from
/// the time of the first to that of the last, `key_times`.
void set_times_of(const RenderJob& job, bool has_time, const std::vector<float>& key_times,
                  std::vector<NamedCamera>& cameras);

}  // namespace gs
