// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/polygon.h"

namespace gs {

bool Polygon::holds(const Vec2<double>& point) const {
  bool is_inside = false;
  for (const std::vector<Vec2<double>>& ring : rings_)
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Vec2<double>&a = ring[i], &b = ring[(i + 1) % ring.size()];
      if ((a.y > point.y) == (b.y > point.y)) continue;  // also where both ends are level
      const double x = a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x);
      if (point.x < x) is_inside = !is_inside;
    }
  return is_inside;
}

}  // namespace gs
