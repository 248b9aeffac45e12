// SPDX-License-Identifier: Apache-2.0
// A finished model as `gemsplat view` serves it: its file, or frames that are rendered here.
#pragma once

#include <memory>

#include "gs_app/run/open_model.h"
#include "gs_app/view/frame_renderer.h"
#include "gs_app/view/served_model.h"
#include "gs_app/view/view_server.h"

namespace gs {

class FileView final : public ViewSource {
 public:
  FileView(ViewScene scene, ServedModel model)
      : scene_(std::move(scene)), model_(std::move(model)) {}
  /// Frames instead of the file, from `renderer`, which is not null.
  FileView(ViewScene scene, std::size_t gaussians, std::unique_ptr<FrameRenderer> renderer);

  const ViewScene& scene() const override { return scene_; }
  nlohmann::ordered_json mode_and_model() override;
  nlohmann::ordered_json state() override { return finished_state(model_.gaussians); }
  HttpAnswer model() override;
  HttpAnswer frame(const HttpRequest& request) override;

 private:
  ViewScene scene_;
  ServedModel model_;  // without a file where frames are served
  std::unique_ptr<FrameRenderer> renderer_;
};

/// The cameras and photos to look at a model with: those of `cameras` (a cameras.json), of dataset.source where `has_scene`,
/// else of the run, whose photos are looked for where it was trained; none where there is none of these. Throws Error for what
/// was asked for and cannot be read; what a run lacks is a note.
ViewScene view_scene_of(const OpenedModel& opened, const Config& config, bool has_scene,
                        const std::string& cameras);

}  // namespace gs
