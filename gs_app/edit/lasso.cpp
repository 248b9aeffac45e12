// SPDX-License-Identifier: Apache-2.0
#include "gs_app/edit/lasso.h"

#include <algorithm>
#include <cmath>

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

std::vector<Vec2f> corners_of(const std::filesystem::path& file, const SortedJson& json,
                              std::size_t least) {
  if (!json.is_array() || json.size() < least || json.size() > kMostCorners)
    fail_lasso(file, "its line does not have " + std::to_string(least) + " to 10,000 corners");
  std::vector<Vec2f> corners;
  for (const SortedJson& corner : json) corners.push_back(corner_of(corner));
  return corners;
}

bool is_inside(const std::vector<Vec2f>& line, const Vec2f& at) {
  bool result = false;
  for (std::size_t i = 0, j = line.size() - 1; i < line.size(); j = i++) {
    const Vec2f &a = line[i], &b = line[j];
    if ((a.y > at.y) != (b.y > at.y) && at.x < a.x + (b.x - a.x) * ((at.y - a.y) / (b.y - a.y)))
      result = !result;
  }
  return result;
}

float distance_to_segment(const Vec2f& at, const Vec2f& from, const Vec2f& to) {
  const Vec2f along = to - from, there = at - from;
  const float square = along.x * along.x + along.y * along.y;
  const float dot = there.x * along.x + there.y * along.y;
  const Vec2f foot = square > 0 ? std::clamp(dot / square, 0.0f, 1.0f) * along : Vec2f(0.0f);
  return std::hypot(there.x - foot.x, there.y - foot.y);
}

bool is_under(const std::vector<Vec2f>& stroke, float radius, const Vec2f& at) {
  for (std::size_t i = 0; i < stroke.size(); ++i)
    if (distance_to_segment(at, stroke[i > 0 ? i - 1 : 0], stroke[i]) <= radius) return true;
  return false;
}

}  // namespace

bool Lasso::holds(const Vec3f& point) const {
  const std::optional<Vec2f> at = pixel_in_sight(camera, point);
  if (!at || at->x < 0 || at->y < 0 || at->x > camera.width || at->y > camera.height) return false;
  if (!line.empty()) return is_inside(line, *at);
  return std::any_of(strokes.begin(), strokes.end(),
                     [&](const auto& stroke) { return is_under(stroke, radius, *at); });
}

Lasso read_lasso(const std::filesystem::path& file, const Vec3d& world_offset) {
  const SortedJson json = read_json_as<SortedJson>(file, kRemedyOfLasso);
  return take_from_json(file, kRemedyOfLasso, [&] {
    if (json.at("format") != "gemsplat lasso" || json.at("version") != 1)
      fail_lasso(file, "it is no lasso of version 1");
    Lasso lasso;
    lasso.camera =
        cameras_of_json(SortedJson::array({json.at("camera")}), file, world_offset).at(0).camera;
    if (!json.contains("strokes")) {
      lasso.line = corners_of(file, json.at("line"), 3);
      return lasso;
    }
    lasso.radius = json.at("radius").get<float>();
    if (!(lasso.radius > 0)) fail_lasso(file, "its brush has no width");
    for (const SortedJson& stroke : json.at("strokes"))
      lasso.strokes.push_back(corners_of(file, stroke, 1));
    return lasso;
  });
}

}  // namespace gs
