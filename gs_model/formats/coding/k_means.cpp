// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/coding/k_means.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr int kCodebookRounds = 60;  // of Lloyd; few values move after 30
constexpr int kPaletteRounds = 8;    // at each level; further ones gain less than 1 % of the error
constexpr std::size_t kCoarseSample = std::size_t(1) << 16;  // points for the coarse clusters

using Rows = std::vector<std::uint32_t>;

double weight_of(const std::vector<float>& weights, std::size_t row) {
  return weights.empty() ? 1 : double(weights[row]);
}

/// k-means among some rows of points (N, d). Centroids start at rows evenly spaced among them.
class Clusters {
 public:
  Clusters(const std::vector<float>& points, const std::vector<float>& weights,
           std::size_t dimensions, const Rows& rows, std::size_t count)
      : points_(points), weights_(weights), d_(dimensions), rows_(rows),
        centroids_(count * dimensions), labels_(rows.size()) {
    for (std::size_t c = 0; c < count; ++c)
      std::copy_n(point(rows[c * rows.size() / count]), d_, &centroids_[c * d_]);
  }

  void improve(int rounds) {
    for (int round = 0; round < rounds; ++round) {
      assign();
      move_to_means();
    }
    assign();
  }
  std::size_t count() const { return centroids_.size() / d_; }
  const std::vector<float>& centroids() const { return centroids_; }
  const Rows& labels() const { return labels_; }  // of each of the rows

  /// The centroid nearest to a point, the first of equals.
  std::uint32_t nearest(const float* p) const {
    thread_local std::vector<float> distances;  // squared, to each centroid
    distances.assign(count(), 0.0f);
    for (std::size_t k = 0; k < d_; ++k) {
      const float* m = &by_dimension_[k * count()];
      for (std::size_t c = 0; c < distances.size(); ++c)
        distances[c] += (p[k] - m[c]) * (p[k] - m[c]);
    }
    return std::uint32_t(std::min_element(distances.begin(), distances.end()) - distances.begin());
  }

 private:
  const float* point(std::uint32_t row) const { return &points_[row * d_]; }
  void assign() {
    by_dimension_.resize(centroids_.size());
    for (std::size_t c = 0; c < count(); ++c)
      for (std::size_t k = 0; k < d_; ++k) by_dimension_[k * count() + c] = centroids_[c * d_ + k];
    parallel_for(rows_.size(), 256, [&](std::size_t i) { labels_[i] = nearest(point(rows_[i])); });
  }
  // Sums are taken in the order of the rows. A centroid without points stays where it is.
  void move_to_means() {
    std::vector<double> sums(centroids_.size(), 0.0);
    std::vector<double> members(count(), 0.0);
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const double weight = weight_of(weights_, rows_[i]);
      members[labels_[i]] += weight;
      for (std::size_t k = 0; k < d_; ++k) sums[labels_[i] * d_ + k] += weight * point(rows_[i])[k];
    }
    for (std::size_t c = 0; c < count(); ++c)
      for (std::size_t k = 0; k < d_ && members[c] > 0; ++k)
        centroids_[c * d_ + k] = float(sums[c * d_ + k] / members[c]);
  }

  const std::vector<float>&points_, &weights_;
  std::size_t d_;
  const Rows& rows_;
  std::vector<float> centroids_;     // (count, d)
  std::vector<float> by_dimension_;  // (d, count): what a processor compares many at a time of
  Rows labels_;
};

// Some of the rows 0..count - 1, evenly spaced.
Rows sample_rows(std::size_t count, std::size_t most) {
  Rows rows(std::min(count, most));
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i] = std::uint32_t(i * count / rows.size());
  return rows;
}

// The number of centroids for each cluster, `size` in all: by its share of the points' weight, at
// least 1 and at most one for each point.
std::vector<std::size_t> shares_of(const std::vector<Rows>& clusters,
                                   const std::vector<float>& weights, std::size_t size) {
  const auto weight_in = [&](const Rows& rows) {
    double sum = 0;
    for (const std::uint32_t row : rows) sum += weight_of(weights, row);
    return sum;
  };
  double all = 0, seen = 0;
  for (const Rows& rows : clusters) all += weight_in(rows);
  std::vector<std::size_t> shares;
  std::size_t given = 0;
  for (const Rows& rows : clusters) {
    seen += weight_in(rows);
    const auto due = std::size_t(seen * double(size) / all);  // all up to this cluster
    const std::size_t share =
        rows.empty() ? 0 : std::clamp<std::size_t>(due - std::min(due, given), 1, rows.size());
    shares.push_back(share);
    given += share;
  }
  for (std::size_t c = shares.size(); given > size && c-- > 0;)  // small ones were rounded up
    while (given > size && shares[c] > 1) --shares[c], --given;
  return shares;
}

// Where an optimal codebook begins: as dense as the cube root of the density of the values (Panter
// & Dite 1951), of which a histogram tells. `values` ascend.
std::vector<float> spread_entries(const std::vector<float>& values, std::size_t size) {
  const std::size_t bins = std::clamp<std::size_t>(values.size() / 16, 16, 1024);
  const double low = values.front(), width = double(values.back()) - low;
  std::vector<double> weight(bins, 0.0);
  for (const float value : values)
    weight[width > 0 ? std::min(bins - 1, std::size_t((value - low) / width * double(bins))) : 0] +=
        1;
  double total = 0;
  for (double& w : weight) total += w = std::cbrt(w);
  std::vector<float> entries;
  double before = 0;  // weight of all bins before this one
  for (std::size_t bin = 0; bin < bins && entries.size() < size; before += weight[bin++])
    while (entries.size() < size &&
           (double(entries.size()) + 0.5) / double(size) * total <= before + weight[bin]) {
      const double due = (double(entries.size()) + 0.5) / double(size) * total - before;
      entries.push_back(float(low + width * (double(bin) + due / weight[bin]) / double(bins)));
    }
  entries.resize(size, values.back());
  return entries;
}

}  // namespace

std::vector<float> codebook_of(std::vector<float> values, std::size_t size) {
  GS_CHECK(!values.empty() && size > 0);
  std::sort(values.begin(), values.end());
  std::vector<float> distinct = values;
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  if (distinct.size() <= size) {  // each stands for itself
    distinct.resize(size, values.back());
    return distinct;
  }
  std::vector<double> sums(values.size() + 1, 0.0);  // of all values before an index
  for (std::size_t i = 0; i < values.size(); ++i) sums[i + 1] = sums[i] + values[i];
  std::vector<float> book = spread_entries(values, size);
  for (int round = 0; round < kCodebookRounds; ++round) {
    const std::vector<float> before = book;
    std::size_t begin = 0;
    for (std::size_t c = 0; c < size; ++c) {
      const float border = c + 1 < size ? 0.5f * (before[c] + before[c + 1]) : values.back();
      const std::size_t end =
          c + 1 < size ? std::size_t(std::upper_bound(values.begin() + std::ptrdiff_t(begin),
                                                      values.end(), border) -
                                     values.begin())
                       : values.size();
      if (end > begin) book[c] = float((sums[end] - sums[begin]) / double(end - begin));
      begin = end;
    }
    std::sort(book.begin(), book.end());
    if (book == before) break;
  }
  return book;
}

std::size_t nearest_entry(const std::vector<float>& codebook, float value) {
  const auto above = std::lower_bound(codebook.begin(), codebook.end(), value);
  if (above == codebook.begin()) return 0;
  if (above == codebook.end()) return codebook.size() - 1;
  const auto below = above - 1;
  return std::size_t((value - *below <= *above - value ? below : above) - codebook.begin());
}

Palette palette_of(const std::vector<float>& points, std::size_t dimensions, std::size_t size,
                   const std::vector<float>& weights) {
  const std::size_t count = points.size() / dimensions;
  GS_CHECK(size > 0 && size <= count);
  const Rows sample = sample_rows(count, kCoarseSample);
  Clusters coarse(points, weights, dimensions, sample,
                  std::min<std::size_t>(sample.size(), std::size_t(std::sqrt(double(size)))));
  coarse.improve(kPaletteRounds);
  std::vector<std::uint32_t> cluster_of(count);
  parallel_for(count, 256,
               [&](std::size_t i) { cluster_of[i] = coarse.nearest(&points[i * dimensions]); });
  std::vector<Rows> clusters(coarse.count());
  for (std::size_t i = 0; i < count; ++i) clusters[cluster_of[i]].push_back(std::uint32_t(i));

  const std::vector<std::size_t> shares = shares_of(clusters, weights, size);
  std::vector<std::size_t> first(shares.size() + 1, 0);
  std::partial_sum(shares.begin(), shares.end(), first.begin() + 1);
  Palette palette{std::vector<float>(first.back() * dimensions), Rows(count)};
  parallel_for(clusters.size(), 1, [&](std::size_t c) {
    if (clusters[c].empty()) return;
    Clusters fine(points, weights, dimensions, clusters[c], shares[c]);
    fine.improve(kPaletteRounds);
    std::copy(fine.centroids().begin(), fine.centroids().end(),
              palette.centroids.begin() + std::ptrdiff_t(first[c] * dimensions));
    for (std::size_t i = 0; i < clusters[c].size(); ++i)
      palette.labels[clusters[c][i]] = std::uint32_t(first[c]) + fine.labels()[i];
  });
  return palette;
}

}  // namespace gs
