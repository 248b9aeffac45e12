// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/tiles/tile_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gs_core/edit/decimate.h"
#include "gs_core/error.h"
#include "gs_core/math/rotation.h"

namespace gs {
namespace {

constexpr double kSigmas = 3;  // half the extent of a Gaussian in a box
constexpr double kRefinedPixels = 16, kSplatPixels = 2;

using Rows = std::vector<std::uint32_t>;

void extend(TileBox& box, const TileBox& by) {
  for (int axis = 0; axis < 3; ++axis) {
    box.low[axis] = std::min(box.low[axis], by.low[axis]);
    box.high[axis] = std::max(box.high[axis], by.high[axis]);
  }
}

/// The box of three standard deviations: along an axis, sigma^2 is an entry of the covariance's
/// diagonal.
TileBox box_of(const Gaussians& g, std::size_t i) {
  const Quatf& q = g.rotation[i];
  const Mat3<double> R = rotation_matrix(Quat<double>{q.w, q.x, q.y, q.z});
  const Vec3d scale(std::exp(double(g.log_scale[i].x)), std::exp(double(g.log_scale[i].y)),
                    std::exp(double(g.log_scale[i].z)));
  Vec3d extent;
  int axis = 0;
  for (const Vec3d& row : {R.row0, R.row1, R.row2}) {
    const Vec3d part = row * scale;
    extent[axis++] = kSigmas * std::sqrt(inner(part, part));
  }
  const Vec3d mean(g.mean[i]);
  return {mean - extent, mean + extent};
}

TileBox box_of(const Gaussians& g) {
  TileBox box = box_of(g, 0);
  for (std::size_t i = 1; i < g.count(); ++i) extend(box, box_of(g, i));
  return box;
}

int longest_axis(const Gaussians& g, const Rows& rows) {
  Vec3f low = g.mean[rows[0]], high = low;
  for (const std::uint32_t i : rows)
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], g.mean[i][axis]);
      high[axis] = std::max(high[axis], g.mean[i][axis]);
    }
  const Vec3f size = high - low;
  return size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
}

/// Moves the upper half of `rows` into the result; both keep the order of the model.
Rows split_at_median(const Gaussians& g, Rows& rows) {
  const int axis = longest_axis(g, rows);
  const auto middle = rows.begin() + std::ptrdiff_t(rows.size() / 2);
  std::nth_element(rows.begin(), middle, rows.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::pair(g.mean[a][axis], a) < std::pair(g.mean[b][axis], b);
  });
  Rows upper(middle, rows.end());
  rows.erase(middle, rows.end());
  std::sort(rows.begin(), rows.end());
  std::sort(upper.begin(), upper.end());
  return upper;
}

/// All Gaussians of two sets, those of the first one first.
Gaussians joined(const Gaussians& a, const Gaussians& b) {
  Gaussians both = rows_like(a, a.count() + b.count(), host_memory());
  for_each_stored_array(
      [](const char*, auto& to, const auto& first, const auto& second) {
        std::copy(first.begin(), first.end(), to.begin());
        std::copy(second.begin(), second.end(), to.begin() + std::ptrdiff_t(first.size()));
      },
      both, a, b);
  return both;
}

Tile tile_of(const Gaussians& g, Rows rows, std::size_t most) {
  Tile tile;
  if (rows.size() <= most) {
    tile.gaussians = rows_of(g, rows);
    tile.box = box_of(tile.gaussians);
    return tile;
  }
  Rows upper = split_at_median(g, rows);
  tile.children.push_back(tile_of(g, std::move(rows), most));
  tile.children.push_back(tile_of(g, std::move(upper), most));
  const Tile &left = tile.children[0], &right = tile.children[1];
  tile.gaussians = joined(left.gaussians, right.gaussians);
  decimate(tile.gaussians, (tile.gaussians.count() + 1) / 2);
  tile.box = box_of(tile.gaussians);
  extend(tile.box, left.box);
  extend(tile.box, right.box);
  tile.geometric_error = std::max({geometric_error_of(tile.gaussians), left.geometric_error,
                                   right.geometric_error});
  return tile;
}

}  // namespace

double geometric_error_of(const Gaussians& gaussians) {
  std::vector<float> largest;
  for (const Vec3f& s : gaussians.log_scale) largest.push_back(std::max({s.x, s.y, s.z}));
  const auto at = largest.begin() + std::ptrdiff_t(largest.size() * 9 / 10);
  std::nth_element(largest.begin(), at, largest.end());
  return kRefinedPixels / kSplatPixels * 2 * std::exp(double(*at));
}

Tile tile_tree(const Gaussians& gaussians, std::size_t most) {
  GS_CHECK(gaussians.count() > 0 && most >= 2);
  Rows rows(gaussians.count());
  std::iota(rows.begin(), rows.end(), 0u);
  return tile_of(gaussians, std::move(rows), most);
}

}  // namespace gs
