// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/normal_map.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "data_loaders/photos/map_file.h"
#include "data_loaders/scene/map_positions.h"
#include "gs_core/config/config_words.h"
#include "gs_core/error.h"
#include "gs_core/math/render/normal_map.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kMapsChecked = 8;
// Of the normals that look at their camera: the least share, since those of networks err at rims, and
// the most that other axes may have more.
constexpr double kLeastFacing = 0.8, kMostLead = 0.03;

/// The normal between four pixels, of length 1; 0 where less than half of it is known.
Vec3f normal_at(const ImageF& map, double x, double y) {
  const double column = std::clamp(x, 0.0, double(map.width - 1)),
               row = std::clamp(y, 0.0, double(map.height - 1));
  const int left = int(column), top = int(row);
  Vec3f sum(0);
  float known = 0;
  for (int corner = 0; corner < 4; ++corner) {
    const bool is_right = corner % 2, is_low = corner / 2;
    const double across = column - left, down = row - top;
    const float weight = float((is_right ? across : 1 - across) * (is_low ? down : 1 - down));
    const float* const n = &map.at(std::min(left + is_right, map.width - 1),
                                   std::min(top + is_low, map.height - 1), 0);
    const Vec3f normal{n[0], n[1], n[2]};
    if (inner(normal, normal) > 0) known += weight;
    sum += weight * normal;
  }
  const float length = std::sqrt(inner(sum, sum));
  return known >= 0.5f && length > 1e-6f ? sum / length : Vec3f(0);
}

/// Calls f(x, y, normal) for each pixel of the view whose normal is known, in the axes of the map.
template <class F>
void for_each_normal(const Photo& photo, F&& f) {
  const ImageF file = read_normal_file(photo.normal_file);
  if (file.width != photo.normal_size.width || file.height != photo.normal_size.height)
    throw Error(fmt::format("{} has changed since the scene was loaded; start again",
                            photo.normal_file.string()));
  const MapPositions positions(photo, photo.normal_size);
  parallel_for(std::size_t(photo.target.height), 16, [&](std::size_t y) {
    for (int x = 0; x < photo.target.width; ++x) {
      const Vec2d at = positions.at(x + 0.5, double(y) + 0.5);
      const Vec3f normal = normal_at(file, at.x - 0.5, at.y - 0.5);
      if (inner(normal, normal) > 0) f(x, int(y), normal);
    }
  });
}

/// How many normals of the map there are, and how many of them look at the camera with each of
/// NormalAxes.
struct FacingNormals {
  double known = 0, facing[std::size(Words<NormalAxes>::kTable)] = {};
};
void add_facing(const Photo& photo, FacingNormals& sums) {
  std::vector<FacingNormals> rows(std::size_t(photo.target.height));
  for_each_normal(photo, [&](int x, int y, const Vec3f& normal) {
    const Camera& camera = photo.camera;
    const Vec3f ray{(float(x) + 0.5f - camera.cx) / camera.fx,
                    (float(y) + 0.5f - camera.cy) / camera.fy, 1};
    FacingNormals& row = rows[std::size_t(y)];
    ++row.known;
    for (std::size_t k = 0; k < std::size(row.facing); ++k)
      row.facing[k] += inner(in_camera(normal, NormalAxes(k), camera), ray) < 0;
  });
  for (const FacingNormals& row : rows) {
    sums.known += row.known;
    for (std::size_t k = 0; k < std::size(row.facing); ++k) sums.facing[k] += row.facing[k];
  }
}

}  // namespace

Vec3f in_camera(const Vec3f& n, NormalAxes axes, const Camera& camera) {
  switch (axes) {
    case NormalAxes::world: return multiply(camera.cam_from_world_rotation, n);
    case NormalAxes::rdf: return n;
    case NormalAxes::rub: return {n.x, -n.y, -n.z};
    case NormalAxes::lub: return -n;
  }
  return n;
}

Image8 make_normals(const Photo& photo) {
  Image8 normals(photo.target.width, photo.target.height, 3);
  for_each_normal(photo, [&](int x, int y, const Vec3f& normal) {
    const NormalBytes n = bytes_of_normal(in_camera(normal, photo.normal_axes, photo.camera));
    std::uint8_t* const to = &normals.at(x, y, 0);
    to[0] = n.x, to[1] = n.y, to[2] = n.z;
  });
  return normals;
}

void check_normal_axes(const std::vector<Photo>& photos, const std::string& place) {
  std::vector<const Photo*> with_map;
  for (const Photo& photo : photos)
    if (!photo.normal_file.empty()) with_map.push_back(&photo);
  FacingNormals sums;
  const std::size_t count = std::min(with_map.size(), kMapsChecked);
  for (std::size_t k = 0; k < count; ++k) add_facing(*with_map[k * with_map.size() / count], sums);
  if (!(sums.known > 0)) return;
  const std::size_t said = std::size_t(with_map[0]->normal_axes);  // rows are in the enum's order
  std::size_t best = said;
  std::string others;
  for (std::size_t k = 0; k < std::size(sums.facing); ++k) {
    if (sums.facing[k] > sums.facing[best]) best = k;
    if (k != said)
      others += fmt::format("{}{:.0f} % with {}", others.empty() ? "" : ", ",
                            100 * sums.facing[k] / sums.known, word_of(NormalAxes(k)));
  }
  const double least =
      std::max(kLeastFacing * sums.known, sums.facing[best] - kMostLead * sums.known);
  if (sums.facing[said] < least)
    throw Error(fmt::format(
        "with dataset.normal_axes = \"{}\" only {:.0f} % of the normals in {} look at their camera "
        "({}); say which axes they have, for example --set dataset.normal_axes={} "
        "(docs/method/surfaces.md)",
        word_of(NormalAxes(said)), 100 * sums.facing[said] / sums.known, place, others,
        word_of(NormalAxes(best))));
}

}  // namespace gs
