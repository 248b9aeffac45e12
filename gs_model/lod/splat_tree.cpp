// SPDX-License-Identifier: Apache-2.0
#include "gs_model/lod/splat_tree.h"

#include <algorithm>

#include "gs_core/error.h"
#include "gs_model/edit/decimate.h"

namespace gs {
namespace {

constexpr std::size_t kRatio = 4;  // of the levels above the coarsest one of the LodTree

using Rows = std::vector<std::uint32_t>;

/// A level, and for each of its rows the row of the next one that holds it; none for the last.
struct Step {
  const Gaussians* gaussians;
  Rows parent;
};

/// The levels above the coarsest one, until one Gaussian is left.
struct Top {
  std::vector<Gaussians> levels;
  std::vector<Rows> parents;  // of the level before each of `levels`
};

Top top_of(const Gaussians& coarsest) {
  Top top;
  const Gaussians* last = &coarsest;
  while (last->count() > 1) {
    Rows merged_into;
    DecimateOptions options;
    options.merged_into = &merged_into;
    Gaussians fewer = copy_of(*last);
    decimate(fewer, (last->count() + kRatio - 1) / kRatio, options);
    top.levels.push_back(std::move(fewer));
    top.parents.push_back(std::move(merged_into));
    last = &top.levels.back();
  }
  return top;
}

// Rows by parent: those of parent p are order[begin[p]], ..., order[begin[p + 1] - 1], ascending.
struct Families {
  Rows begin, order;
};

Families families_of(const Rows& parent, std::size_t num_parents) {
  Families families{Rows(num_parents + 1), Rows(parent.size())};
  for (const std::uint32_t p : parent) ++families.begin[p + 1];
  for (std::size_t p = 0; p < num_parents; ++p) families.begin[p + 1] += families.begin[p];
  Rows next = families.begin;
  for (std::uint32_t row = 0; row < parent.size(); ++row) families.order[next[parent[row]]++] = row;
  return families;
}

/// The tree in the making.
class Builder {
 public:
  explicit Builder(const Gaussians& root) { add(root, 0); }

  /// Adds the rows of the level below the one to which `node_` belongs. A row that was not merged
  /// is its parent, and gets no node of its own.
  void descend(const Step& level) {
    const Families families = families_of(level.parent, node_.size());
    Rows node(level.parent.size());
    for (std::size_t p = 0; p < node_.size(); ++p) {
      const std::uint32_t begin = families.begin[p], end = families.begin[p + 1];
      if (end - begin == 1) {
        node[families.order[begin]] = node_[p];
        continue;
      }
      start_[node_[p]] = std::uint32_t(sources_.size());
      count_[node_[p]] = end - begin;
      for (std::uint32_t n = begin; n < end; ++n) {
        node[families.order[n]] = std::uint32_t(sources_.size());
        add(*level.gaussians, families.order[n]);
      }
    }
    node_ = std::move(node);
  }

  SplatTree take() {
    SplatTree tree{rows_like(*sources_.front().from, sources_.size(), host_memory()),
                   std::move(start_), std::move(count_)};
    for (std::size_t i = 0, end = 0; i < sources_.size(); i = end) {  // one level after another
      std::vector<std::uint32_t> rows;
      for (; end < sources_.size() && sources_[end].from == sources_[i].from; ++end)
        rows.push_back(sources_[end].row);
      copy_rows(rows_of(*sources_[i].from, rows), 0, rows.size(), tree.gaussians, i);
    }
    return tree;
  }

 private:
  struct Source {
    const Gaussians* from;
    std::uint32_t row;
  };
  void add(const Gaussians& from, std::uint32_t row) {
    sources_.push_back({&from, row});
    start_.push_back(0);
    count_.push_back(0);
  }

  std::vector<Source> sources_;  // of the nodes
  Rows start_, count_;           // children of the nodes
  Rows node_ = {0};              // of the rows of the level at hand
};

}  // namespace

SplatTree splat_tree_of(const LodTree& lod) {
  const Top top = top_of(lod.levels.back().gaussians);
  std::vector<Step> steps;  // the finest first; the last one is the root
  for (const LodLevel& level : lod.levels) steps.push_back({&level.gaussians, level.parent});
  for (std::size_t i = 0; i < top.levels.size(); ++i) {
    steps.back().parent = top.parents[i];
    steps.push_back({&top.levels[i], {}});
  }
  Builder builder(*steps.back().gaussians);
  for (std::size_t i = steps.size() - 1; i-- > 0;) builder.descend(steps[i]);
  return builder.take();
}

}  // namespace gs
