// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/world_offset.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <locale>
#include <sstream>

#include "gs_core/geometry/outliers.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/system/files/atomic_file.h"

namespace gs {

constexpr double kSingleRounding = 0x1p-24;  // of a number, at most

Vec3d world_offset_of(const Vec3d& median, double spread, double most_lost) {
  const bool is_near = !(length(median) * kSingleRounding > most_lost * spread);
  if (is_near || !(spread > 0) || !std::isfinite(length(median))) return Vec3d(0.0);
  const double digits = std::floor(std::log10(spread));
  const double step = std::pow(10.0, std::abs(digits));  // a whole number, and exact
  Vec3d offset;
  for (int axis = 0; axis < 3; ++axis)
    offset[axis] = digits >= 0 ? std::round(median[axis] / step) * step
                               : std::round(median[axis] * step) / step;
  return offset + Vec3d(0.0);  // no -0
}

Vec3d world_offset_of(const std::vector<Vec3d>& positions, double most_lost) {
  if (positions.empty()) return Vec3d(0.0);
  const Vec3d median = median_position(positions);
  return world_offset_of(median, ordinary_distance(median, positions), most_lost);
}

bool are_nearer_to(const Vec3d& offset, const std::vector<Vec3d>& positions) {
  if (offset == Vec3d(0.0)) return false;
  std::size_t nearer = 0;
  for (const Vec3d& at : positions) nearer += inner(at - offset, at - offset) < inner(at, at);
  return 2 * nearer > positions.size();
}

std::string text_of_offset(const Vec3d& offset) {
  return fmt::format("{} {} {}", offset.x, offset.y, offset.z);
}

Vec3d offset_of_comments(const std::vector<std::string>& comments) {
  constexpr std::string_view kWord = "world_offset ";
  for (const std::string& comment : comments) {
    if (!comment.starts_with(kWord)) continue;
    std::istringstream numbers(comment.substr(kWord.size()));
    numbers.imbue(std::locale::classic());
    Vec3d offset(0.0);
    if (numbers >> offset.x >> offset.y >> offset.z && is_finite(offset)) return offset;
  }
  return Vec3d(0.0);
}

void write_world_offset(const std::filesystem::path& path, const Vec3d& offset) {
  AtomicFile file(path);
  file.write(fmt::format("{{\"world_offset\": [{}, {}, {}]}}\n", offset.x, offset.y, offset.z));
  file.commit();
}

}  // namespace gs
