// SPDX-License-Identifier: Apache-2.0
// A scene of which it is known where on earth it stands.
#pragma once

#include <string>
#include <vector>

#include "gs_core/geodesy/georeference.h"
#include "gs_core/math/random.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/colmap_writer.h"

namespace gs {

/// One unit of the scene is 7.5 m, and its axes are turned in some way.
inline Georeference true_georeference() {
  const Similarity enu_from_input{7.5, rotation_matrix(Quat<double>{0.4, 0.7, -0.2, 0.5}),
                                  Vec3d(12.0, -30.0, 4.0)};
  return {{15.5, 48.2, 300}, enu_from_input};
}

/// `count` cameras about the origin of the scene, some units apart, and the points of
/// small_model().
inline ColmapModel placed_model(int count, const std::string& ending = ".jpg") {
  ColmapModel model = small_model(0);
  for (int i = 0; i < count; ++i) {
    const Random random{5, RandomStream::test};
    const Vec4f n = random.normal4(std::uint64_t(i)), q = random.normal4(std::uint64_t(i), 1);
    const Quat<double> turn{q.x, q.y, q.z, q.w};
    const double norm = std::sqrt(squared_norm(turn));
    ColmapImage image{std::uint32_t(i + 1), "photo_" + std::to_string(i) + ending, 7};
    image.cam_from_world_rotation = {turn.w / norm, turn.x / norm, turn.y / norm, turn.z / norm};
    const Vec3d center(4.0 * n.x, 3.0 * n.y, 1.0 * n.z);
    image.cam_from_world_translation =
        -multiply(rotation_matrix(image.cam_from_world_rotation), center);
    model.images.push_back(image);
  }
  return model;
}

/// The largest distance in ECEF between where two georeferences put points within 5 units.   meters
inline double meters_apart(const Georeference& a, const Georeference& b,
                           const Vec3d& about = Vec3d(0.0)) {
  double largest = 0;
  for (const double x : {-5.0, 5.0})
    for (const double y : {-5.0, 5.0})
      for (const double z : {-5.0, 5.0}) {
        const Vec3d at = about + Vec3d(x, y, z);
        const Vec3d d = a.ecef_of_input(at) - b.ecef_of_input(at);
        largest = std::max(largest, std::sqrt(inner(d, d)));
      }
  return largest;
}

}  // namespace gs
