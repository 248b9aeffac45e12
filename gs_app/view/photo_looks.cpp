// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/photo_looks.h"

#include <cmath>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/math/ppisp.h"
#include "gs_train/photometric/gains.h"
#include "gs_train/photometric/ppisp.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

Json list_of(const Vec3f& v) { return {v.x, v.y, v.z}; }

// A camera that took no training photo has no vignetting that is known.
Json vignetting_json(const SceneLooks& looks, const PhotoLook& photo) {
  const auto camera = looks.cameras.find(photo.camera_id);
  if (camera == looks.cameras.end() || camera->second.numbers.size() < 3) return {0, 0, 0};
  const std::vector<float>& b = camera->second.numbers;
  return {b[0], b[1], b[2]};
}

Json gains_json(const PhotoLook& photo) {
  const std::vector<float>& a = photo.numbers;
  return {{"gain", list_of({std::exp(a[0]), std::exp(a[1]), std::exp(a[2])})}};
}

Json ppisp_json(const PhotoLook& photo) {
  ColorLatents<float> latents;
  for (std::size_t i = 0; i < latents.size(); ++i) latents[i] = photo.numbers[1 + i];
  const ColorMatrix<float> matrix = color_matrix(latents);
  Json json = {{"gain", list_of(Vec3f(std::exp2(photo.numbers[0])))}};
  json["matrix"] = Json::array();
  for (const Vec3f& row : {matrix.M.row0, matrix.M.row1, matrix.M.row2})
    for (int c = 0; c < 3; ++c) json["matrix"].push_back(row[c]);
  json["factors"] = list_of(matrix.k);
  return json;
}

}  // namespace

std::string photo_in(const SceneLooks& looks, const std::string& name) {
  if (looks.photos.contains(name)) return name;
  for (const auto& [photo, look] : looks.photos)
    if (without_extension(photo) == name) return photo;
  return {};
}

Json look_json(const SceneLooks& looks, const std::string& photo) {
  const PhotoLook& look = looks.photos.at(photo);
  Json json = make_photometric_model(looks.config)->name() == kGainsModel ? gains_json(look)
                                                                          : ppisp_json(look);
  json["vignetting"] = vignetting_json(looks, look);
  return json;
}

std::unique_ptr<Appearance> look_on_frame(const SceneLooks& looks, const std::string& photo,
                                          const Camera& camera, const Camera& frame) {
  View view;
  view.name = photo;
  view.camera = frame;
  const float scale = frame.fx / camera.fx;
  view.camera.width = std::max(1, int(std::lround(scale * float(camera.width))));
  view.camera.height = std::max(1, int(std::lround(scale * float(camera.height))));
  return appearances(looks)(view);
}

}  // namespace gs
