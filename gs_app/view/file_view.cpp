// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/file_view.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <map>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_app/export/cameras.h"
#include "gs_app/run/photometric_file.h"
#include "gs_app/view/eye_inside.h"
#include "gs_app/view/photo_looks.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_model/edit/edit_model.h"
#include "gs_model/edit/upright.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Names in our cameras.json have no extension; those of some other trainers have one.
template <class T>
const T* find_camera(const std::map<std::string, T>& by_name, const std::string& name) {
  auto found = by_name.find(name);
  if (found == by_name.end()) found = by_name.find(without_extension(name));
  return found == by_name.end() ? nullptr : &found->second;
}

bool is_of_size(const Camera& a, const Camera& b) {
  return a.width == b.width && a.height == b.height;
}

// All views of the scene. A photo is decoded when the page asks for it.
std::shared_ptr<const Scene> photos_of(DatasetConfig dataset, const Vec3d& world_offset) {
  dataset.refine_cameras = false;
  dataset.exposure = false;
  auto scene = std::make_shared<Scene>(load_scene(dataset, {}, PhotoLoading::when_asked));
  bring_to_offset(*scene, world_offset);
  return scene;
}

// "train" or "test" of each view of the run, by its name in cameras.json.
std::map<std::string, std::string> splits_of(const RunFolder& run) {
  std::map<std::string, std::string> splits;
  if (!fs::exists(run.split())) return splits;
  for (const char* split : {"train", "test"})
    for (const std::string& name : split_names(run, split)) splits[without_extension(name)] = split;
  return splits;
}

void take_photos(ViewScene& scene, const DatasetConfig& dataset, const Vec3d& world_offset) {
  try {
    scene.photos = photos_of(dataset, world_offset);
  } catch (const Error& error) {
    log_warning("{}", error.what());  // not for the page: it names folders of this machine
    scene.notes.push_back("no photos: they cannot be read; the messages of the program say why");
    return;
  }
  std::map<std::string, const View*> views;
  for (const ViewedCamera& viewed : viewed_cameras(*scene.photos))
    views[without_extension(viewed.name)] = viewed.view;
  std::size_t missing = 0;
  for (ViewedCamera& viewed : scene.cameras) {
    const View* const* const view = find_camera(views, viewed.name);
    if (!view || !is_of_size((*view)->camera, viewed.camera)) {
      ++missing;
      continue;
    }
    viewed.view = *view;
    viewed.name = (*view)->name;
  }
  if (missing > 0)
    scene.notes.push_back(fmt::format("{} of {} cameras have no photo of their size in {}", missing,
                                      scene.cameras.size(), name_of(dataset.source)));
  if (dataset.refine_cameras)
    scene.notes.push_back(
        "the run refined its cameras: undistorted photos are shown as before the refinement, and "
        "may be off by some pixels");
}

void take_cameras_of_run(ViewScene& scene, const OpenedModel& opened, const Config& config) {
  const RunFolder& run = *opened.run;
  if (!fs::exists(run.cameras())) {
    scene.notes.push_back("no cameras: the run has no cameras.json; name its scene with --data");
    return;
  }
  const std::map<std::string, std::string> splits = splits_of(run);
  for (const NamedCamera& named : cameras_of_file(run.cameras(), 1, opened.model.world_offset)) {
    const std::string* const split = find_camera(splits, named.name);
    scene.cameras.push_back({named.name, split ? *split : "", named.camera});
  }
  if (config.dataset.source.empty())
    scene.notes.push_back("no photos: the run does not name its scene; name it with --data");
  else
    take_photos(scene, config.dataset, opened.model.world_offset);
}

// The learned colors of the run's photos, by the names of its cameras.
void take_looks(ViewScene& scene, const OpenedModel& opened) {
  if (!opened.run || !fs::exists(opened.run->photometric())) return;
  try {
    scene.looks = std::make_shared<const SceneLooks>(read_photometric(opened.run->photometric()));
  } catch (const Error& error) {
    log_warning("{}", error.what());
    scene.notes.push_back("colors are neutral: photometric.json of the run cannot be read");
    return;
  }
  for (ViewedCamera& camera : scene.cameras) camera.look = photo_in(*scene.looks, camera.name);
}

// How many units of the photos' frame one unit of the model is.
double scale_of(const std::optional<Mat4d>& input_from_model) {
  if (!input_from_model) return 1;
  const auto& m = input_from_model->m;
  return std::sqrt(m[0][0] * m[0][0] + m[1][0] * m[1][0] + m[2][0] * m[2][0]);
}

// Without cameras the model itself says which way is up, and whether it is a place to be in.
void guess_first_view(ViewScene& scene, const GaussianModel& model) {
  std::optional<Gaussians> storage;
  const Gaussians& gaussians = drawn_gaussians(model, storage);
  scene.frame.up = up_of_levels(gaussians);
  scene.eye = eye_inside(gaussians, scene.frame);
}

std::string title_of(const OpenedModel& opened) {
  return name_of(opened.run ? opened.run->root() : opened.ply);
}

}  // namespace

ViewScene view_scene_of(const OpenedModel& opened, const Config& config, bool has_scene,
                        const std::string& cameras) {
  ViewScene scene;
  scene.title = title_of(opened);
  take_settings(scene, view_settings(opened, config));
  if (has_scene) {
    scene.photos = photos_of(config.dataset, opened.model.world_offset);
    scene.cameras = viewed_cameras(*scene.photos);
  } else if (!cameras.empty()) {
    for (const NamedCamera& named : cameras_of_file(cameras, 1, opened.model.world_offset))
      scene.cameras.push_back({named.name, "", named.camera});
  } else if (opened.run) {
    take_cameras_of_run(scene, opened, config);
  }
  scene.world_offset = opened.model.world_offset;
  take_looks(scene, opened);
  take_meters(scene, config.dataset.source, scale_of(opened.input_from_model));
  scene.moves = opened.model.gaussians.has_time;
  scene.frame = frame_of(scene.cameras, opened.model.gaussians.mean.span());
  if (scene.cameras.empty()) guess_first_view(scene, opened.model);
  return scene;
}

LookOf look_of(const ViewScene& scene) {
  if (!scene.looks) return {};
  return [looks = scene.looks,
          cameras = scene.cameras](std::size_t index) -> std::unique_ptr<Appearance> {
    View view;
    view.name = cameras.at(index).look;
    return appearances(*looks)(view);
  };
}

FileView::FileView(ViewScene scene, std::size_t gaussians, std::unique_ptr<FrameRenderer> renderer)
    : scene_(std::move(scene)), renderer_(std::move(renderer)) {
  model_.gaussians = gaussians;
}

Json FileView::mode_and_model() {
  if (renderer_)
    return {{"mode", "remote"},
            {"model", {{"gaussians", model_.gaussians}}},
            {"device", renderer_->device()}};
  return {{"mode", "file"}, {"model", model_json(model_)}};
}

HttpAnswer FileView::model() {
  if (renderer_) return http_error(404, "`gemsplat view --remote` sends frames, not the model");
  HttpAnswer answer;
  answer.type = "application/octet-stream";
  answer.file = model_.file;
  return answer;
}

HttpAnswer FileView::frame(const HttpRequest& request) {
  if (!renderer_) return ViewSource::frame(request);
  try {
    FrameRequest wanted = frame_request_of(request);
    for (const auto& [name, camera] : {std::pair("look", wanted.look), {"lens", wanted.lens}})
      if (camera && *camera >= scene_.cameras.size())
        throw UsageError(fmt::format("/frame cannot use {}: there is no such camera", name));
    if (wanted.lens && wanted.quantity == Quantity::normal)
      throw UsageError("/frame cannot use lens: normals are known of pinholes alone");
    if (wanted.lens) wanted.camera.lens = scene_.cameras[*wanted.lens].camera.lens;
    const std::optional<RenderedFrame> frame = renderer_->frame(wanted);
    if (!frame) return http_error(409, "a newer request has replaced this one");
    HttpAnswer answer = http_text(frame->jpeg, "image/jpeg");
    answer.headers = {{"X-Render-Ms", fmt::format("{:.2f}", frame->milliseconds)}};
    return answer;
  } catch (const UsageError& error) {
    return http_error(400, error.what());
  }
}

}  // namespace gs
