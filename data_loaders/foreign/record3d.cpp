// SPDX-License-Identifier: Apache-2.0
// Exports of Record3D: one file with the camera and the poses of all photos, which are numbered.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "data_loaders/foreign/foreign_model.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/text/parse_number.h"
#include "gs_core/system/text/read_json.h"

namespace gs {

void read_record3d(ForeignModel& model) {
  const auto file = read_json_as<SortedJson>(model.file(), "export it again");
  const ForeignJson json(model);
  const PhotoSize whole = json.size_at(file, "w", "h");
  const std::vector<double> K = json.numbers(json.at(file, "K"), "K", 9);  // by columns
  const SortedJson& poses = json.at(file, "poses");
  std::vector<std::pair<std::size_t, std::string>> photos;  // by their numbers
  for (const std::string& name : picture_names_in(model.photos())) {
    std::size_t number = 0;
    if (parse_number(std::filesystem::path(name).stem().string(), number))
      photos.emplace_back(number, name);
  }
  std::sort(photos.begin(), photos.end());
  if (!poses.is_array() || poses.size() < photos.size())
    model.fail(
        fmt::format("it has {} poses for {} photos with a number for a name; export all of "
                    "them again",
                    poses.size(), photos.size()));
  for (std::size_t i = 0; i < photos.size(); ++i) {
    const auto& [number, photo] = photos[i];
    const std::size_t row = photos.back().first < poses.size() ? number : i;
    const std::vector<double> p = json.numbers(poses[row], "poses", 7);  // x y z w, center
    const PhotoSize size = model.size_of(photo);  // photos may be smaller than the sensor
    const double sx = double(size.width) / whole.width, sy = double(size.height) / whole.height;
    const std::uint32_t camera = model.camera(size, {sx * K[0], sy * K[4], sx * K[6], sy * K[7]});
    const Quat<double> q{p[3], p[0], p[1], p[2]};
    if (is_degenerate(q)) model.fail(fmt::format("the pose of '{}' has no rotation", photo));
    model.add_at(photo, camera, rotation_matrix(q), {p[4], p[5], p[6]}, true);
  }
}

}  // namespace gs
