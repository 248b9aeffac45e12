// SPDX-License-Identifier: Apache-2.0
// A finished model in the viewer (`gemsplat view`): the page gets its file, or with --remote frames
// rendered here.
#pragma once

#include <memory>

#include "gs_app/run/open_model.h"
#include "gs_app/view/frame_renderer.h"
#include "gs_app/view/served_model.h"
#include "gs_app/view/view_server.h"
#include "gs_core/system/text/json.h"

namespace gs {

class FileView final : public ViewSource {
 public:
  FileView(ViewScene scene, ServedModel model)
      : scene_(std::move(scene)), model_(std::move(model)) {}
  /// Serves frames from `renderer` instead of the file. `renderer` is not null.
  FileView(ViewScene scene, std::size_t gaussians, std::unique_ptr<FrameRenderer> renderer);

  const ViewScene& scene() const override { return scene_; }
  Json mode_and_model() override;
  Json state(int) override { return finished_state(model_.gaussians); }
  HttpAnswer model() override;
  HttpAnswer frame(const HttpRequest& request) override;

 private:
  ViewScene scene_;
  ServedModel model_;  // without a file if frames are served
  std::unique_ptr<FrameRenderer> renderer_;
};

/// The looks of the scene's photos for a FrameRenderer; empty if it has none. Needs nothing of
/// `scene` afterwards.
LookOf look_of(const ViewScene& scene);

/// The cameras and photos beside a model. They come from the first of these that is there:
///   1. the scene config.dataset.source, if `has_scene` (--data);
///   2. the file `cameras`, if it is not empty (--cameras): cameras without photos;
///   3. the run's cameras.json, with the photos of the scene that it was trained on.
/// Throws Error if 1 or 2 cannot be read. A run that lacks files or photos gets a note instead.
ViewScene view_scene_of(const OpenedModel& opened, const Config& config, bool has_scene,
                        const std::string& cameras);

}  // namespace gs
