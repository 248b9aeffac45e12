// SPDX-License-Identifier: Apache-2.0
// Exports of Record3D: one file with the camera and the poses of all photos, which are numbered. Depth
// maps have the same numbers.
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
namespace {

constexpr const char* kFolders[] = {"rgb", "rgbd"};  // that Record3D writes photos to

/// The photos with a number for a name, by their numbers: those in its folders, or else all.
std::vector<std::pair<std::size_t, std::string>> numbered_photos(const ForeignModel& model) {
  std::vector<std::pair<std::size_t, std::string>> all, own;
  for (const std::string& name : picture_names_in(model.photos())) {
    const std::filesystem::path path = name;
    std::size_t number = 0;
    if (lowercase_ending(path) == ".exr" || !parse_number(path.stem().string(), number)) continue;
    all.emplace_back(number, name);
    if (std::find(std::begin(kFolders), std::end(kFolders), path.parent_path().filename()) !=
        std::end(kFolders))
      own.emplace_back(number, name);
  }
  std::vector<std::pair<std::size_t, std::string>>& photos = own.empty() ? all : own;
  std::sort(photos.begin(), photos.end());
  for (std::size_t i = 1; i < photos.size(); ++i)
    if (photos[i].first == photos[i - 1].first)
      model.fail(fmt::format(
          "both {} and {} in {} have the number {}; name the folder of the photos with "
          "--set dataset.images=FOLDER",
          photos[i - 1].second, photos[i].second, model.photos().string(), photos[i].first));
  return photos;
}

}  // namespace

void read_record3d(ForeignModel& model) {
  const auto file = read_json_as<SortedJson>(model.file(), "export it again");
  const ForeignJson json(model);
  const PhotoSize whole = json.size_at(file, "w", "h");
  const std::vector<double> K = json.numbers(json.at(file, "K"), "K", 9);  // by columns
  const SortedJson& poses = json.at(file, "poses");
  // fx, fy, cx, cy of each photo, since autofocus changes them
  const SortedJson& of_frames = json.list(file, "perFrameIntrinsicCoeffs");
  const auto photos = numbered_photos(model);
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
    BrownLens lens{K[0], K[4], K[6], K[7]};
    if (of_frames.size() == poses.size()) {
      const std::vector<double> c = json.numbers(of_frames[row], "perFrameIntrinsicCoeffs", 4);
      lens = {c[0], c[1], c[2], c[3]};
    }
    const std::uint32_t camera =
        model.camera(size, {sx * lens.fx, sy * lens.fy, sx * lens.cx, sy * lens.cy});
    const Quat<double> q{p[3], p[0], p[1], p[2]};
    if (is_degenerate(q)) model.fail(fmt::format("the pose of '{}' has no rotation", photo));
    model.add_at(photo, camera, rotation_matrix(q), {p[4], p[5], p[6]}, true);
  }
}

}  // namespace gs
