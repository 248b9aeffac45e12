// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/view_scene.h"

#include <spdlog/fmt/fmt.h>

#include "data_loaders/georef/georef_file.h"
#include "gs_app/view/photo_looks.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

Mat3<double> rotation_of(const Camera& camera) {
  const Mat3<float>& R = camera.cam_from_world_rotation;
  return {Vec3d(R.row0), Vec3d(R.row1), Vec3d(R.row2)};
}

Vec3d position_of(const Camera& camera) {
  return -multiply_transposed(rotation_of(camera), Vec3d(camera.cam_from_world_translation));
}

Json camera_json(const ViewedCamera& viewed, std::size_t index) {
  const Camera& camera = viewed.camera;
  const Mat3<float>& R = camera.cam_from_world_rotation;
  const Vec3d p = position_of(camera);
  Json json = {{"name", viewed.name},     {"split", viewed.split}, {"width", camera.width},
               {"height", camera.height}, {"fx", camera.fx},       {"fy", camera.fy},
               {"cx", camera.cx},         {"cy", camera.cy}};
  json["world_from_camera"] = {R.row0.x, R.row1.x, R.row2.x, p.x,  //
                               R.row0.y, R.row1.y, R.row2.y, p.y,  //
                               R.row0.z, R.row1.z, R.row2.z, p.z,  //
                               0,        0,        0,        1};
  if (camera.has_lens()) json["has_lens"] = true;
  json["photo"] = viewed.view ? Json(fmt::format("photo/{}", index)) : Json();
  return json;
}

}  // namespace

SceneFrame frame_of(const std::vector<ViewedCamera>& cameras, Span<const Vec3f> points) {
  std::vector<Camera> plain;
  for (const ViewedCamera& viewed : cameras) plain.push_back(viewed.camera);
  return scene_frame(plain, points);
}

std::string name_of(const std::filesystem::path& path) {
  const auto whole = std::filesystem::absolute(path).lexically_normal();
  return (whole.has_filename() ? whole : whole.parent_path()).filename().string();
}

Json list_of(const Vec3d& v) { return {v.x, v.y, v.z}; }

Json cameras_json(const std::vector<ViewedCamera>& cameras) {
  Json json = Json::array();
  for (std::size_t i = 0; i < cameras.size(); ++i) json.push_back(camera_json(cameras[i], i));
  return json;
}

Json scene_json(const ViewScene& scene) {
  Json json = {{"title", scene.title},
               {"background", {scene.background.x, scene.background.y, scene.background.z}},
               {"up", list_of(scene.frame.up)},
               {"center", list_of(scene.frame.center)},
               {"radius", scene.frame.radius},
               {"near", scene.near_plane},
               {"far", scene.far_plane},
               {"moves", scene.moves},
               {"notes", scene.notes}};
  if (!scene.cameras.empty()) json["up_is_known"] = scene.frame.up_is_known;
  if (scene.eye) json["eye"] = list_of(*scene.eye);
  if (scene.time) json["time"] = *scene.time;
  json["world_offset"] = list_of(scene.world_offset);
  if (scene.meters_per_unit) json["meters_per_unit"] = *scene.meters_per_unit;
  if (!scene.mesh.empty()) json["mesh"] = {{"name", name_of(scene.mesh)}};
  json["cameras"] = cameras_json(scene.cameras);
  for (std::size_t i = 0; i < scene.cameras.size(); ++i)
    if (const std::string& look = scene.cameras[i].look; scene.looks && !look.empty())
      json["cameras"][i]["look"] = look_json(*scene.looks, look);
  return json;
}

void take_meters(ViewScene& scene, const std::filesystem::path& source, double input_from_model) {
  if (source.empty() || !std::filesystem::exists(georef_file_of(source))) return;
  try {
    scene.meters_per_unit =
        read_georef(georef_file_of(source)).enu_from_input.scale * input_from_model;
  } catch (const Error& error) {
    log_warning("{}", error.what());
    scene.notes.push_back("lengths have no meters: georef.json of the scene cannot be read");
  }
}

void take_settings(ViewScene& scene, const RenderSettings& settings) {
  scene.background = settings.background;
  scene.near_plane = settings.near_plane;
  scene.far_plane = settings.far_plane;
}

std::vector<ViewedCamera> viewed_cameras(const Scene& scene) {
  std::vector<ViewedCamera> cameras;
  for (const View& view : scene.test_views)
    cameras.push_back({view.name, "test", view.camera, &view});
  for (const View& view : scene.train_views)
    cameras.push_back({view.name, "train", view.camera, &view});
  return cameras;
}

}  // namespace gs
