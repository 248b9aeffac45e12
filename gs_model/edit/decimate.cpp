// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/decimate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "gs_core/bake_filter.h"
#include "gs_core/error.h"
#include "gs_core/geometry/kd_tree.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr int kMostNeighbors = KdTree::kMostNearest;
constexpr std::size_t kRoundShare = 16;  // a round merges at most one pair of so many Gaussians
constexpr std::size_t kGrain = 512;      // rows of one chunk of a parallel loop

/// An edge of the graph, at its first end.
struct Edge {
  std::uint32_t to;
  float cost;
};

/// The cheapest edge of a row.
struct Proposal {
  float cost;
  std::uint32_t a, b;  // a < b

  bool operator<(const Proposal& other) const {
    if (cost != other.cost) return cost < other.cost;
    return a != other.a ? a < other.a : b < other.b;
  }
};

class Decimation {
 public:
  Decimation(const Gaussians& gaussians, const DecimateOptions& options)
      : g_(gaussians), options_(options), k_(options.neighbors), shapes_(g_.count()),
        edges_(g_.count() * std::size_t(k_)), degree_(g_.count()), partner_(g_.count(), kNone),
        target_(g_.count(), kNone), rows_(g_.count()) {
    std::iota(rows_.begin(), rows_.end(), 0u);
    parallel_for(rows_.size(), kGrain,
                 [&](std::size_t i) { shapes_[i] = merge_shape_of(g_, i, options.importance[i]); });
  }

  /// The rows that are left; each holds what was merged into it.
  const std::vector<std::uint32_t>& reduce_to(std::size_t count) {
    const std::size_t total = rows_.size() - count;
    std::size_t graph_rows = 0;
    while (rows_.size() > count) {
      const bool is_stale = graph_rows == 0 || rows_.size() <= graph_rows / 2;
      if (is_stale) {
        connect();
        graph_rows = rows_.size();
      }
      const std::vector<Proposal> pairs =
          choose(std::clamp<std::size_t>(rows_.size() / kRoundShare, 1, rows_.size() - count));
      if (pairs.empty()) {
        graph_rows = 0;  // what is left of the graph has no edges
        continue;
      }
      merge(pairs);
      if (options_.on_progress) options_.on_progress(total - (rows_.size() - count), total);
    }
    return rows_;
  }

  /// For each row of the beginning: where in the rows that are left it is now.
  std::vector<std::uint32_t> places() const {
    std::vector<std::uint32_t> places(target_.size());
    for (std::size_t n = 0; n < rows_.size(); ++n) places[rows_[n]] = std::uint32_t(n);
    // A row goes into one before it, whose place is known then.
    for (std::size_t i = 0; i < places.size(); ++i)
      if (target_[i] != kNone) places[i] = places[target_[i]];
    return places;
  }

 private:
  Edge* edges_of(std::uint32_t row) { return edges_.data() + std::size_t(row) * std::size_t(k_); }
  float cost(std::uint32_t a, std::uint32_t b) const {
    // The order decides the last bits, and both ends of an edge must agree on its cost.
    return float(merge_cost(shapes_[std::min(a, b)], shapes_[std::max(a, b)]));
  }

  // Gives each row edges to its nearest rows.
  void connect() {
    std::vector<Vec3f> means(rows_.size());
    for (std::size_t n = 0; n < rows_.size(); ++n) means[n] = shapes_[rows_[n]].mean;
    const KdTree tree({means.data(), means.size()});
    parallel_for(rows_.size(), kGrain, [&](std::size_t n) {
      std::uint32_t near[kMostNeighbors];
      const int found = tree.nearest(n, k_, near);
      const std::uint32_t row = rows_[n];
      degree_[row] = std::uint8_t(found);
      for (int e = 0; e < found; ++e)
        edges_of(row)[e] = {rows_[near[e]], cost(row, rows_[near[e]])};
    });
  }

  // At most `count` pairs without a common row, the cheapest first.
  std::vector<Proposal> choose(std::size_t count) {
    std::vector<Proposal> proposals(rows_.size());
    parallel_for(rows_.size(), 4 * kGrain, [&](std::size_t n) {
      const std::uint32_t row = rows_[n];
      Proposal best{std::numeric_limits<float>::infinity(), kNone, kNone};
      for (int e = 0; e < degree_[row]; ++e) {
        const Edge& edge = edges_of(row)[e];
        best = std::min(best, {edge.cost, std::min(row, edge.to), std::max(row, edge.to)});
      }
      proposals[n] = best;
    });
    std::erase_if(proposals, [](const Proposal& p) { return p.a == kNone; });
    // Mostly both ends propose their pair, and some pairs share a row.
    const std::size_t looked_at = std::min(proposals.size(), 4 * count);
    if (looked_at < proposals.size())
      std::nth_element(proposals.begin(), proposals.begin() + std::ptrdiff_t(looked_at),
                       proposals.end());
    std::sort(proposals.begin(), proposals.begin() + std::ptrdiff_t(looked_at));
    std::vector<Proposal> chosen;
    for (std::size_t n = 0; n < looked_at && chosen.size() < count; ++n) {
      const Proposal& p = proposals[n];
      if (partner_[p.a] != kNone || partner_[p.b] != kNone) continue;
      partner_[p.a] = p.b;
      partner_[p.b] = p.a;
      chosen.push_back(p);
    }
    return chosen;
  }

  // Merges pairs: b goes into a. Then edges lead to what is there, and have its costs.
  void merge(const std::vector<Proposal>& pairs) {
    parallel_for(pairs.size(), 64, [&](std::size_t n) {
      const std::uint32_t both[2] = {pairs[n].a, pairs[n].b};
      const MergeShape shape = merged_shape(shapes_[both[0]], shapes_[both[1]]);
      const float importance[2] = {shapes_[both[0]].importance, shapes_[both[1]].importance};
      merge_gaussians(g_, both, 2, g_, both[0], importance);
      shapes_[both[0]] = merge_shape_of(g_, both[0], shape.importance);
      target_[both[1]] = both[0];
    });
    std::erase_if(rows_, [&](std::uint32_t row) { return target_[row] != kNone; });
    parallel_for(rows_.size(), kGrain, [&](std::size_t n) { refresh(rows_[n]); });
    for (const Proposal& pair : pairs) partner_[pair.a] = partner_[pair.b] = kNone;
  }

  // The edges of a row after a round: those of both parts if it was merged, without duplicates, the
  // cheapest ones. Writes nothing but the row's own edges.
  void refresh(std::uint32_t row) {
    Edge found[2 * kMostNeighbors];
    int count = 0;
    const bool is_merged = partner_[row] != kNone;
    const auto add = [&](const Edge& edge) {
      const std::uint32_t to = target_[edge.to] == kNone ? edge.to : target_[edge.to];
      if (to == row) return;
      for (int e = 0; e < count; ++e)
        if (found[e].to == to) return;
      found[count++] = {to, is_merged || partner_[to] != kNone ? cost(row, to) : edge.cost};
    };
    for (int e = 0; e < degree_[row]; ++e) add(edges_of(row)[e]);
    if (is_merged) {
      const std::uint32_t other = partner_[row];
      for (int e = 0; e < degree_[other]; ++e) add(edges_of(other)[e]);
    }
    if (count > k_) {
      std::sort(found, found + count, [](const Edge& a, const Edge& b) {
        return a.cost != b.cost ? a.cost < b.cost : a.to < b.to;
      });
      count = k_;
    }
    degree_[row] = std::uint8_t(count);
    std::copy(found, found + count, edges_of(row));
  }

  const Gaussians& g_;
  const DecimateOptions& options_;
  int k_;
  std::vector<MergeShape> shapes_;
  std::vector<Edge> edges_;  // k_ places for each row, of which degree_ are in use
  std::vector<std::uint8_t> degree_;
  std::vector<std::uint32_t> partner_;  // in this round
  std::vector<std::uint32_t> target_;   // of rows that are gone: the row that holds them
  std::vector<std::uint32_t> rows_;     // that are left, ascending
};

bool is_rendered(const Gaussians& g, std::size_t i) {
  return is_finite(g.mean[i]) && is_finite(g.log_scale[i]) && is_finite(g.sh0[i]) &&
         std::isfinite(g.logit_opacity[i]) && std::isfinite(squared_norm(g.rotation[i])) &&
         !is_degenerate(g.rotation[i]) &&
         std::all_of(std::begin(g.sh_rest[i].coefficient), std::end(g.sh_rest[i].coefficient),
                     [](const Vec3f& c) { return is_finite(c); });
}

// Rows of the result for all rows of the beginning, of which only `rendered` were looked at.
std::vector<std::uint32_t> spread_out(const std::vector<std::uint32_t>& places,
                                      const std::vector<std::uint32_t>& rendered,
                                      std::size_t count) {
  std::vector<std::uint32_t> all(count, kNotRendered);
  for (std::size_t n = 0; n < rendered.size(); ++n) all[rendered[n]] = places[n];
  return all;
}

}  // namespace

std::vector<float> importance_of(const std::vector<float>& contributions,
                                 const std::vector<float>& coverages) {
  GS_CHECK(contributions.size() == coverages.size());
  std::vector<float> importance(contributions.size(), 0.0f);
  for (std::size_t i = 0; i < importance.size(); ++i)
    if (coverages[i] > 0) importance[i] = contributions[i] / coverages[i];
  return importance;
}

std::vector<float> importance_by_size(const Gaussians& gaussians) {
  std::vector<float> importance(gaussians.count(), 0.0f);
  parallel_for(importance.size(), kGrain, [&](std::size_t i) {
    const float area = merge_shape_of(gaussians, i).area;
    if (std::isfinite(1 / area)) importance[i] = 1 / area;
  });
  return importance;
}

std::vector<std::uint32_t> rendered_rows(const Gaussians& gaussians) {
  std::vector<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < gaussians.count(); ++i)
    if (is_rendered(gaussians, i)) rows.push_back(i);
  return rows;
}

std::size_t decimate(Gaussians& gaussians, std::size_t count, const DecimateOptions& given) {
  if (gaussians.has_time)
    throw UsageError(
        "Gaussians in space and time cannot be merged, because each of a pair lives at its own "
        "time; write one moment of the model first (gemsplat export --time T)");
  GS_CHECK(given.neighbors >= 2 && given.neighbors <= kMostNeighbors);
  GS_CHECK(given.importance.empty() || given.importance.size() == gaussians.count());
  if (gaussians.has_filter) bake_filter(gaussians);
  DecimateOptions options = given;
  const std::size_t given_count = gaussians.count();
  const std::vector<std::uint32_t> rendered = rendered_rows(gaussians);
  if (rendered.size() < gaussians.count()) {
    if (!options.importance.empty())
      for (std::size_t n = 0; n < rendered.size(); ++n)
        options.importance[n] = given.importance[rendered[n]];
    gaussians = rows_of(gaussians, rendered);
    if (!options.importance.empty()) options.importance.resize(rendered.size());
  }
  if (options.importance.empty()) options.importance = importance_by_size(gaussians);
  std::vector<std::uint32_t> places(rendered.size());
  std::iota(places.begin(), places.end(), 0u);
  count = std::max<std::size_t>(count, 1);
  if (gaussians.count() > count) {
    Decimation decimation(gaussians, options);
    gaussians = rows_of(gaussians, decimation.reduce_to(count));
    places = decimation.places();
  }
  if (given.merged_into) *given.merged_into = spread_out(places, rendered, given_count);
  return gaussians.count();
}

}  // namespace gs
