// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/render/render_cameras.h"

#include <algorithm>

#include "gs_app/export/cameras.h"
#include "gs_app/export/key_frames.h"
#include "gs_app/export/view_lens.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

// What --across would be: a pinhole and parallel rays then show the middle of all depths alike.
double usual_width(ViewPictures& pictures, const std::vector<NamedCamera>& cameras) {
  const std::vector<float> depths = pictures.sample_depths(without_names(cameras));
  const Camera& camera = cameras[0].camera;
  const double depth = depths.empty() ? 1 : depths[depths.size() / 2];
  return depth * camera.width / double(camera.fx);
}

// Puts level panoramas where the cameras stand.
void fit_panoramas(const RenderJob& job, const SceneFrame& frame,
                   std::vector<NamedCamera>& cameras) {
  if (!frame.up_is_known)
    log_warning(
        "the cameras are held in all directions or lie on their side, so the way up is a guess: if "
        "the panorama is tilted, turn the model with `gemsplat edit --up`");
  int width = job.size ? job.size->width : 0;
  for (auto& [name, camera] : cameras) {
    camera = panorama_camera(camera, frame.up, width);
    if (job.output.is_film()) width = camera.width;
  }
}

}  // namespace

std::vector<Camera> without_names(const std::vector<NamedCamera>& cameras) {
  std::vector<Camera> result;
  for (const NamedCamera& named : cameras) result.push_back(named.camera);
  return result;
}

std::vector<NamedCamera> cameras_to_render(const RenderJob& job, const OpenedModel& opened,
                                           const Config& config) {
  if (!job.path_file.empty()) return read_key_frames(job.path_file, opened.model.world_offset).keys;
  const int resolution = config.dataset.resolution;
  const Vec3d& offset = opened.model.world_offset;
  const bool has_split =
      job.has("dataset.source") || (opened.run && std::filesystem::exists(opened.run->split()));
  const bool follows_training = job.is_path() && job.path.through.empty() && has_split;
  const std::string split = !job.split.empty() ? job.split : follows_training ? "train" : "all";
  if (job.has("dataset.source")) return cameras_of_scene(config.dataset, split, offset);
  if (job.cameras.empty() && opened.run)
    return cameras_of_run(*opened.run, resolution, split, offset);
  if (job.cameras.empty())
    throw UsageError(
        "there are no cameras to render from; give --cameras with a cameras.json, a "
        "transforms.json or a COLMAP model, or --data SCENE");
  if (!job.split.empty() && job.split != "all")
    throw UsageError("--split goes with --data or a run, not with --cameras");
  return cameras_of_file(job.cameras, resolution, offset);
}

void fit_cameras(const RenderJob& job, ViewPictures& pictures, const SceneFrame& frame,
                 std::vector<NamedCamera>& cameras) {
  if (job.is_panorama()) return fit_panoramas(job, frame, cameras);
  const bool is_film = job.output.is_film();
  std::optional<PictureSize> size = job.size;
  if (is_film && !size) size = PictureSize{cameras[0].camera.width, cameras[0].camera.height};
  for (auto& [name, camera] : cameras) {
    const bool is_other = size && (size->width != camera.width || size->height != camera.height);
    if (is_other) camera = reframed(camera, size->width, size->height);
  }
  std::optional<double> across = job.across;
  if (job.lens == "orthographic" && !across) across = usual_width(pictures, cameras);
  for (auto& [name, camera] : cameras) {
    if (across) camera = with_parallel_rays(camera, *across);
    if (job.lens == "fisheye") camera = with_fisheye(camera, job.field_of_view.value_or(180));
    if (job.lens.empty() && job.field_of_view)
      camera = with_field_of_view(camera, *job.field_of_view);
  }
  if (!is_film || !size || (size->width % 2 == 0 && size->height % 2 == 0)) return;
  const PictureSize even{std::max(2, size->width & ~1), std::max(2, size->height & ~1)};
  log_info("films have even sides: {}x{} becomes {}x{}, without the last row or column",
           size->width, size->height, even.width, even.height);
  for (auto& [name, camera] : cameras) camera.width = even.width, camera.height = even.height;
}

void set_times_of(const RenderJob& job, bool has_time, const std::vector<float>& key_times,
                  std::vector<NamedCamera>& cameras) {
  std::vector<float> times = job.times;
  if (!has_time && !times.empty())
    throw UsageError("the model holds 3D Gaussians, which have no time; leave --time out");
  if (has_time && times.empty() && job.is_path()) times = key_times;
  if (times.empty()) return;
  const float steps = float(std::max<std::size_t>(cameras.size(), 2) - 1);
  for (std::size_t i = 0; i < cameras.size(); ++i)
    cameras[i].camera.time = times[0] + (times.back() - times[0]) * (float(i) / steps);
}

}  // namespace gs
