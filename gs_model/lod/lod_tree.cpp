// SPDX-License-Identifier: Apache-2.0
#include "gs_model/lod/lod_tree.h"

#include <algorithm>
#include <numeric>

#include "gs_core/bake_filter.h"
#include "gs_core/error.h"
#include "gs_core/math/density/morton.h"
#include "gs_model/edit/decimate.h"

namespace gs {
namespace {

using Rows = std::vector<std::uint32_t>;

/// The box around the means of rows order[begin], ..., order[end - 1].
struct MeanBox {
  Vec3f low, high;

  int longest_axis() const {
    const Vec3f size = high - low;
    return size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  }
  float longest() const { return (high - low)[longest_axis()]; }
};

MeanBox box_of(const Gaussians& g, const Rows& order, std::size_t begin, std::size_t end) {
  MeanBox box{g.mean[order[begin]], g.mean[order[begin]]};
  for (std::size_t n = begin; n < end; ++n)
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], g.mean[order[n]][axis]);
      box.high[axis] = std::max(box.high[axis], g.mean[order[n]][axis]);
    }
  return box;
}

/// Cuts the rows into the leaves of a k-d tree.
class CellSplit {
 public:
  CellSplit(const Gaussians& g, std::size_t leaf_rows) : g_(g), leaf_rows_(leaf_rows) {
    order.resize(g.count());
    std::iota(order.begin(), order.end(), 0u);
    split(0, order.size());
    leaf_begin.push_back(order.size());
  }

  Rows order;                           // leaf after leaf
  std::vector<std::size_t> leaf_begin;  // in `order`

 private:
  void split(std::size_t begin, std::size_t end) {
    const MeanBox box = box_of(g_, order, begin, end);
    if (end - begin <= leaf_rows_) {
      sort_along_curve(box, begin, end);
      leaf_begin.push_back(begin);
      return;
    }
    const std::size_t middle = begin + (end - begin) / 2;
    const int axis = box.longest_axis();
    const auto at = [&](std::size_t n) { return order.begin() + std::ptrdiff_t(n); };
    std::nth_element(at(begin), at(middle), at(end), [&](std::uint32_t a, std::uint32_t b) {
      return g_.mean[a][axis] != g_.mean[b][axis] ? g_.mean[a][axis] < g_.mean[b][axis] : a < b;
    });
    split(begin, middle);
    split(middle, end);
  }

  void sort_along_curve(const MeanBox& box, std::size_t begin, std::size_t end) {
    std::vector<std::pair<std::uint64_t, std::uint32_t>> coded;
    for (std::size_t n = begin; n < end; ++n)
      coded.emplace_back(morton_code(g_.mean[order[n]], box.low, std::max(box.longest(), 1e-30f)),
                         order[n]);
    std::sort(coded.begin(), coded.end());
    for (std::size_t n = begin; n < end; ++n) order[n] = coded[n - begin].second;
  }

  const Gaussians& g_;
  std::size_t leaf_rows_;
};

std::size_t reduced(std::size_t count, std::size_t ratio) { return (count + ratio - 1) / ratio; }

std::size_t num_levels(std::size_t count, const LodOptions& options) {
  std::size_t levels = 1;
  while (count > 1 && (count = reduced(count, options.ratio)) >= options.coarsest_rows) ++levels;
  return levels;
}

Rows range(std::size_t begin, std::size_t end) {
  Rows rows(end - begin);
  std::iota(rows.begin(), rows.end(), std::uint32_t(begin));
  return rows;
}

// The first rows of all leaves one level up.
std::vector<std::size_t> reduced_leaves(const std::vector<std::size_t>& begin, std::size_t ratio) {
  std::vector<std::size_t> result = {0};
  for (std::size_t leaf = 0; leaf + 1 < begin.size(); ++leaf)
    result.push_back(result.back() + reduced(begin[leaf + 1] - begin[leaf], ratio));
  return result;
}

// Makes a level of the one before it, leaf by leaf, and gives that one its `parent`.
LodLevel coarser(LodLevel& finer, std::size_t ratio) {
  LodLevel level{
      rows_like(finer.gaussians, 0, host_memory()), reduced_leaves(finer.leaf_begin, ratio), {}};
  level.gaussians.resize(level.leaf_begin.back());
  for (std::size_t leaf = 0; leaf + 1 < finer.leaf_begin.size(); ++leaf) {
    const std::size_t first = level.leaf_begin[leaf];
    Gaussians rows =
        rows_of(finer.gaussians, range(finer.leaf_begin[leaf], finer.leaf_begin[leaf + 1]));
    Rows merged_into;
    DecimateOptions options;
    options.merged_into = &merged_into;
    GS_CHECK(decimate(rows, level.count(leaf), options) == level.count(leaf));
    copy_rows(rows, 0, rows.count(), level.gaussians, first);
    for (const std::uint32_t row : merged_into) finer.parent.push_back(std::uint32_t(first) + row);
  }
  return level;
}

}  // namespace

LodTree build_lod_tree(Gaussians gaussians, const LodOptions& options) {
  GS_CHECK(options.leaf_rows > 0 && options.ratio > 1 && options.coarsest_rows > 0);
  if (gaussians.has_time)
    throw UsageError(
        "Gaussians in space and time have no levels of detail; write one moment of the model first "
        "(gemsplat export --time T)");
  bake_filter(gaussians);
  const Rows rendered = rendered_rows(gaussians);
  if (rendered.empty()) throw UsageError("a model without Gaussians has no levels of detail");
  if (rendered.size() < gaussians.count()) gaussians = rows_of(gaussians, rendered);

  const CellSplit cells(gaussians, options.leaf_rows);
  LodTree tree;
  tree.levels.push_back({rows_of(gaussians, cells.order), cells.leaf_begin, {}});
  const std::size_t levels = num_levels(gaussians.count(), options);
  gaussians = Gaussians();
  while (tree.levels.size() < levels)
    tree.levels.push_back(coarser(tree.levels.back(), options.ratio));
  return tree;
}

}  // namespace gs
