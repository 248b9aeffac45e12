// SPDX-License-Identifier: Apache-2.0
#include "gs_model/tiles/tile_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/math/render/rotation.h"
#include "gs_model/edit/decimate.h"

namespace gs {
namespace {

constexpr double kSigmas = 3;  // half the extent of a Gaussian in a box
constexpr double kRefinedPixels = 16, kSplatPixels = 2;
constexpr double kSmallShare = 0.1;  // of opacity * area, which may be lost in small splats

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
  copy_rows(a, 0, a.count(), both, 0);
  copy_rows(b, 0, b.count(), both, a.count());
  return both;
}

/// The tile above some tiles, with half of their Gaussians.
Tile tile_above(std::vector<Tile> children) {
  Tile tile;
  tile.gaussians = children.size() == 1 ? copy_of(children[0].gaussians)
                                        : joined(children[0].gaussians, children[1].gaussians);
  decimate(tile.gaussians, (tile.gaussians.count() + 1) / 2);
  tile.box = box_of(tile.gaussians);
  tile.geometric_error = geometric_error_of(tile.gaussians);
  for (const Tile& child : children) {
    extend(tile.box, child.box);
    tile.geometric_error = std::max(tile.geometric_error, child.geometric_error);
  }
  tile.children = std::move(children);
  return tile;
}

Tile tile_of(const Gaussians& g, Rows rows, std::size_t most) {
  if (rows.size() <= most) {
    Tile leaf;
    leaf.gaussians = rows_of(g, rows);
    leaf.box = box_of(leaf.gaussians);
    return leaf;
  }
  Rows upper = split_at_median(g, rows);
  std::vector<Tile> children;
  children.push_back(tile_of(g, std::move(rows), most));
  children.push_back(tile_of(g, std::move(upper), most));
  return tile_above(std::move(children));
}

}  // namespace

double geometric_error_of(const Gaussians& gaussians) {
  std::vector<std::pair<float, double>> splats;  // log of sigma, opacity * area
  double sum = 0;
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const Vec3f& s = gaussians.log_scale[i];
    splats.push_back({std::max({s.x, s.y, s.z}), double(merge_shape_of(gaussians, i).mass())});
    sum += splats.back().second;
  }
  std::sort(splats.begin(), splats.end());
  std::size_t at = 0;
  for (double below = 0; at + 1 < splats.size(); ++at)
    if ((below += splats[at].second) > kSmallShare * sum) break;
  return kRefinedPixels / kSplatPixels * 2 * std::exp(double(splats[at].first));
}

Tile tile_tree(const Gaussians& gaussians, std::size_t most) {
  GS_CHECK(gaussians.count() > 0 && most >= 2);
  Rows rows(gaussians.count());
  std::iota(rows.begin(), rows.end(), 0u);
  Tile root = tile_of(gaussians, std::move(rows), most);
  while (root.gaussians.count() > kRootGaussians) {
    std::vector<Tile> below;
    below.push_back(std::move(root));
    root = tile_above(std::move(below));
  }
  return root;
}

}  // namespace gs
