// SPDX-License-Identifier: Apache-2.0
#include "gs_app/edit/lasso.h"

#include "data_loaders/cameras/camera_file.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/edit/select.h"

namespace gs {
namespace {

constexpr const char* kRemedyOfLasso = "save the lasso in the viewer again";
constexpr std::size_t kMostCorners = 10'000;

[[noreturn]] void fail_lasso(const std::filesystem::path& file, const std::string& what) {
  cannot_read(file, what + "; " + kRemedyOfLasso);
}

Vec2f corner_of(const SortedJson& json) {
  return {json.at(0).get<float>(), json.at(1).get<float>()};
}

}  // namespace

bool Lasso::holds(const Vec3f& point) const {
  const std::optional<Vec2f> at = pixel_in_sight(camera, point);
  if (!at) return false;
  bool is_inside = false;
  for (std::size_t i = 0, j = line.size() - 1; i < line.size(); j = i++) {
    const Vec2f &a = line[i], &b = line[j];
    if ((a.y > at->y) != (b.y > at->y) && at->x < a.x + (b.x - a.x) * ((at->y - a.y) / (b.y - a.y)))
      is_inside = !is_inside;
  }
  return is_inside;
}

Lasso read_lasso(const std::filesystem::path& file, const Vec3d& world_offset) {
  const SortedJson json = read_json_as<SortedJson>(file, kRemedyOfLasso);
  return take_from_json(file, kRemedyOfLasso, [&] {
    if (json.at("format") != "gemsplat lasso" || json.at("version") != 1)
      fail_lasso(file, "it is no lasso of version 1");
    Lasso lasso;
    lasso.camera =
        cameras_of_json(SortedJson::array({json.at("camera")}), file, world_offset).at(0).camera;
    const SortedJson& line = json.at("line");
    if (!line.is_array() || line.size() < 3 || line.size() > kMostCorners)
      fail_lasso(file, "its line does not have 3 to 10,000 corners");
    for (const SortedJson& corner : line) lasso.line.push_back(corner_of(corner));
    return lasso;
  });
}

}  // namespace gs
