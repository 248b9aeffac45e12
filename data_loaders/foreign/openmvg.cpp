// SPDX-License-Identifier: Apache-2.0
// sfm_data.json of OpenMVG, as cereal writes it: a type is named where its number comes first.
#include <spdlog/fmt/fmt.h>

#include <map>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

std::uint32_t camera_of_openmvg(ForeignModel& model, const ForeignJson& json,
                                const std::string& kind, const SortedJson& data) {
  const PhotoSize size = json.size_at(data, "width", "height");
  const auto coefficients = [&](const char* key, std::size_t count) {
    std::vector<double> k = json.numbers(json.at(data, key), key, count);
    k.resize(5);
    return k;
  };
  if (kind == "spherical")
    return model.camera(CameraModel::equirectangular, size,
                        {double(size.width), double(size.height)});
  const double f = json.number_at(data, "focal_length");
  const std::vector<double> c =
      json.numbers(json.at(data, "principal_point"), "principal_point", 2);
  if (kind == "fisheye") {
    const std::vector<double> k = coefficients("fisheye", 4);
    return model.camera(CameraModel::opencv_fisheye, size,
                        {f, f, c[0], c[1], k[0], k[1], k[2], k[3]});
  }
  std::vector<double> k(5);  // k1 k2 k3 t1 t2
  if (kind == "pinhole_radial_k1")
    k = coefficients("disto_k1", 1);
  else if (kind == "pinhole_radial_k3")
    k = coefficients("disto_k3", 3);
  else if (kind == "pinhole_brown_t2")
    k = coefficients("disto_t2", 5);
  else if (kind != "pinhole")
    model.fail(
        fmt::format("gemsplat has no camera like its '{}'; export it by "
                    "openMVG_main_openMVG2Colmap",
                    kind));
  return model.camera(size, {f, f, c[0], c[1], k[0], k[1], k[2], 0, k[3], k[4]});
}

}  // namespace

void read_openmvg(ForeignModel& model) {
  const auto file = read_json_as<SortedJson>(model.file(), "export it again");
  const ForeignJson json(model);
  std::map<double, std::uint32_t> cameras;    // by their keys
  std::map<double, std::string> kinds;        // by the numbers of their types
  constexpr double kFirstUse = 2147483648.0;  // is added to the number
  for (const SortedJson& intrinsic : json.list(file, "intrinsics")) {
    const SortedJson& value = json.at(intrinsic, "value");
    double kind = json.number_at(value, "polymorphic_id");
    if (kind >= kFirstUse) {
      kind -= kFirstUse;
      kinds[kind] = json.text_at(value, "polymorphic_name");
    }
    cameras[json.number_at(intrinsic, "key")] =
        camera_of_openmvg(model, json, kinds[kind], json.at(json.at(value, "ptr_wrapper"), "data"));
  }
  std::map<double, const SortedJson*> poses;
  for (const SortedJson& pose : json.list(file, "extrinsics"))
    poses[json.number_at(pose, "key")] = &json.at(pose, "value");
  for (const SortedJson& view : json.list(file, "views")) {
    const SortedJson& data = json.at(json.at(json.at(view, "value"), "ptr_wrapper"), "data");
    const auto pose = poses.find(json.number_at(data, "id_pose"));
    const auto camera = cameras.find(json.number_at(data, "id_intrinsic"));
    if (pose == poses.end() || camera == cameras.end()) continue;  // a photo that was not placed
    const auto photo = model.photo(json.text_at(data, "filename"));
    if (!photo) continue;
    const SortedJson& rows = json.at(*pose->second, "rotation");
    std::vector<double> R;
    for (const SortedJson& row : rows)
      for (const double number : json.numbers(row, "rotation", 3)) R.push_back(number);
    if (R.size() != 9) model.fail("a rotation has not three rows; export it again");
    model.add_at(*photo, camera->second, transposed(matrix_of_rows(R)),
                 json.vector_at(*pose->second, "center"));
  }
  for (const SortedJson& point : json.list(file, "structure"))
    model.add_point(json.vector_at(json.at(point, "value"), "X"), Vec3d(128.0));
}

}  // namespace gs
