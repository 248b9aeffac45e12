// SPDX-License-Identifier: Apache-2.0
// reconstruction.json of OpenSfM, which OpenDroneMap has, too. Lengths in a picture are shares of its
// longer side, from its middle.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

std::uint32_t camera_of_opensfm(ForeignModel& model, const ForeignJson& json,
                                const SortedJson& camera) {
  const PhotoSize size = json.size_at(camera, "width", "height");
  const std::string kind = json.text_at(camera, "projection_type");
  const double longer = std::max(size.width, size.height);
  if (kind == "spherical" || kind == "equirectangular")
    return model.camera(CameraModel::equirectangular, size,
                        {double(size.width), double(size.height)});
  const auto number = [&](const char* key) { return json.number_or(camera, key, 0); };
  const double fx = longer * json.number_or(camera, "focal_x", number("focal"));
  const double fy = longer * json.number_or(camera, "focal_y", number("focal"));
  const double cx = longer * number("c_x") + 0.5 * size.width;
  const double cy = longer * number("c_y") + 0.5 * size.height;
  if (kind == "perspective" || kind == "simple_radial" || kind == "radial" || kind == "brown")
    return model.camera(size, {fx, fy, cx, cy, number("k1"), number("k2"), number("k3"), 0,
                               number("p1"), number("p2")});
  if (kind == "fisheye" || kind == "fisheye_opencv")
    return model.camera(CameraModel::opencv_fisheye, size,
                        {fx, fy, cx, cy, number("k1"), number("k2"), number("k3"), number("k4")});
  model.fail(
      fmt::format("gemsplat has no camera like its '{}'; run `opensfm undistort DATASET` and "
                  "`opensfm export_colmap DATASET`",
                  kind));
}

/// The rotation by |v| about v.
Mat3<double> rotation_about(const Vec3d& v) {
  const double angle = length(v);
  const double s = angle > 1e-12 ? std::sin(angle / 2) / angle : 0.5;
  return rotation_matrix(Quat<double>{std::cos(angle / 2), s * v.x, s * v.y, s * v.z});
}

}  // namespace

void read_opensfm(ForeignModel& model) {
  const auto file = read_json_as<SortedJson>(model.file(), "run OpenSfM again");
  const ForeignJson json(model);
  if (!file.is_array() || file.empty())
    model.fail("it has no reconstruction; align the photos first");
  const auto photos_of = [&](const SortedJson& part) { return json.list(part, "shots").size(); };
  const auto largest = std::max_element(
      file.begin(), file.end(),
      [&](const SortedJson& a, const SortedJson& b) { return photos_of(a) < photos_of(b); });
  if (file.size() > 1)
    log_info("{} holds {} reconstructions; the largest has {} photos", model.file().string(),
             file.size(), photos_of(*largest));
  const SortedJson& cameras = json.at(*largest, "cameras");
  for (const auto& [label, shot] : json.list(*largest, "shots").items()) {
    const std::string camera = json.text_at(shot, "camera");
    if (const auto photo = model.photo(label))
      model.add(*photo, camera_of_opensfm(model, json, json.at(cameras, camera.c_str())),
                rotation_about(json.vector_at(shot, "rotation")),
                json.vector_at(shot, "translation"));
  }
  for (const SortedJson& point : json.list(*largest, "points"))
    model.add_point(json.vector_at(point, "coordinates"), json.vector_at(point, "color"));
}

}  // namespace gs
