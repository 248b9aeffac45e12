// SPDX-License-Identifier: Apache-2.0
// .sfm of AliceVision, which Meshroom uses. Its numbers are texts.
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <map>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

/// The focal lengths in pixels: as they stand there, or of millimeters of the sensor.
std::pair<double, double> focal_lengths(const ForeignJson& json, const SortedJson& intrinsic,
                                        int width) {
  if (const auto pixels = intrinsic.find("pxFocalLength"); pixels != intrinsic.end()) {
    if (!pixels->is_array()) {
      const double f = json.number(*pixels, "pxFocalLength");
      return {f, f};
    }
    const std::vector<double> f = json.numbers(*pixels, "pxFocalLength", 2);
    return {f[0], f[1]};
  }
  const double f =
      json.number_at(intrinsic, "focalLength") * width / json.number_at(intrinsic, "sensorWidth");
  return {f, f / json.number_or(intrinsic, "pixelRatio", 1)};
}

std::uint32_t camera_of_alicevision(ForeignModel& model, const ForeignJson& json,
                                    const SortedJson& intrinsic) {
  const PhotoSize size = json.size_at(intrinsic, "width", "height");
  const auto [fx, fy] = focal_lengths(json, intrinsic, size.width);
  const std::vector<double> c =
      json.numbers(json.at(intrinsic, "principalPoint"), "principalPoint", 2);
  // From the middle in newer files, from the corner in older ones.
  const bool is_offset = std::abs(c[0]) < 0.25 * size.width && std::abs(c[1]) < 0.25 * size.height;
  const double cx = c[0] + (is_offset ? 0.5 * size.width : 0);
  const double cy = c[1] + (is_offset ? 0.5 * size.height : 0);
  std::string kind = json.text_at(intrinsic, "type");
  if (intrinsic.contains("distortionType") && kind == "pinhole") {
    kind = json.text_at(intrinsic, "distortionType");
    if (kind == "none") kind = "pinhole";
  }
  const SortedJson& list = json.list(intrinsic, "distortionParams");
  std::vector<double> k = json.numbers(list, "distortionParams", list.size());
  k.resize(std::max<std::size_t>(k.size(), 5));
  if (kind == "pinhole") return model.camera(size, {fx, fy, cx, cy});
  if (kind == "radial1" || kind == "radialk1" || kind == "radial3" || kind == "radialk3")
    return model.camera(size, {fx, fy, cx, cy, k[0], k[1], k[2]});
  if (kind == "brown") return model.camera(size, {fx, fy, cx, cy, k[0], k[1], k[2], 0, k[3], k[4]});
  if (kind == "fisheye" || kind == "fisheye4")
    return model.camera(CameraModel::opencv_fisheye, size,
                        {fx, fy, cx, cy, k[0], k[1], k[2], k[3]});
  model.fail(
      fmt::format("gemsplat has no camera like its '{}'; convert it with "
                  "`aliceVision_exportColmap -i FILE.sfm -o FOLDER`",
                  kind));
}

}  // namespace

void read_alicevision(ForeignModel& model) {
  const auto file = read_json_as<SortedJson>(model.file(), "export it again");
  const ForeignJson json(model);
  std::map<std::string, const SortedJson*> intrinsics, poses;
  for (const SortedJson& intrinsic : json.list(file, "intrinsics"))
    intrinsics[json.text_at(intrinsic, "intrinsicId")] = &intrinsic;
  for (const SortedJson& pose : json.list(file, "poses"))
    poses[json.text_at(pose, "poseId")] = &json.at(json.at(pose, "pose"), "transform");
  for (const SortedJson& view : json.list(file, "views")) {
    if (!view.contains("poseId") || !view.contains("intrinsicId")) continue;
    const auto pose = poses.find(json.text_at(view, "poseId"));
    const auto intrinsic = intrinsics.find(json.text_at(view, "intrinsicId"));
    if (pose == poses.end() || intrinsic == intrinsics.end()) continue;  // not placed
    const auto photo = model.photo(json.text_at(view, "path"));
    if (!photo) continue;
    // The rows of the list are the columns of the rotation from world to camera.
    const auto columns = json.numbers(json.at(*pose->second, "rotation"), "rotation", 9);
    model.add_at(*photo, camera_of_alicevision(model, json, *intrinsic->second),
                 matrix_of_rows(columns), json.vector_at(*pose->second, "center"));
  }
  for (const SortedJson& point : json.list(file, "structure"))
    model.add_point(json.vector_at(point, "X"),
                    point.contains("color") ? json.vector_at(point, "color") : Vec3d(128.0));
}

}  // namespace gs
