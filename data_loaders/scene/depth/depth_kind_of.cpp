// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/depth/depth_kind_of.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "data_loaders/scene/depth/depth_anchors.h"
#include "data_loaders/scene/depth/depth_map.h"
#include "gs_core/math/loss/depth_loss.h"

namespace gs {
namespace {

constexpr std::size_t kLeastPoints = 20;    // of a photo, for a correlation
constexpr std::size_t kMostPoints = 20000;  // of the scene that are tried
constexpr double kLeastCorrelation = 0.4;   // of ranks; maps of something else have about 0
constexpr double kSameUnit = 1.05;          // most of the ratio of metric maps, and of its inverse
constexpr double kOneFactor = 0.1;          // the largest spread of the logarithm of the ratio

/// What a map and the points say of the same pixels.
struct Pairs {
  std::vector<double> values, depths;
};

Pairs pairs_of(const ImageF& map, const Camera& camera, const std::vector<ScenePoint>& points) {
  Pairs pairs;
  const std::size_t step = 1 + points.size() / kMostPoints;
  for (std::size_t i = 0; i < points.size(); i += step) {
    const auto seen = anchor_of(camera, points[i].position);
    if (!seen) continue;
    const float value = map.at(int(seen->x), int(seen->y), 0);
    if (!is_known_depth(value)) continue;
    pairs.values.push_back(double(value));
    pairs.depths.push_back(double(seen->depth));
  }
  return pairs;
}

/// The same of the points that a photo is known to show.
Pairs anchored_pairs(const ImageF& map, const std::vector<DepthAnchor>& anchors) {
  Pairs pairs;
  for (const DepthAnchor& anchor : anchors) {
    const float value = depth_at(map, double(anchor.x) - 0.5, double(anchor.y) - 0.5);
    if (!is_known_depth(value)) continue;
    pairs.values.push_back(double(value));
    pairs.depths.push_back(double(anchor.depth));
  }
  return pairs;
}

/// The rank of each number among all; equal ones share the mean of their ranks.
std::vector<double> ranks_of(const std::vector<double>& numbers) {
  std::vector<std::size_t> order(numbers.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return numbers[a] < numbers[b]; });
  std::vector<double> ranks(numbers.size());
  for (std::size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    for (end = begin + 1; end < order.size() && numbers[order[end]] == numbers[order[begin]];)
      ++end;
    for (std::size_t k = begin; k < end; ++k) ranks[order[k]] = 0.5 * double(begin + end - 1);
  }
  return ranks;
}

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const double n = double(a.size());
  const double mean_a = std::accumulate(a.begin(), a.end(), 0.0) / n,
               mean_b = std::accumulate(b.begin(), b.end(), 0.0) / n;
  double aa = 0, bb = 0, ab = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    aa += (a[i] - mean_a) * (a[i] - mean_a);
    bb += (b[i] - mean_b) * (b[i] - mean_b);
    ab += (a[i] - mean_a) * (b[i] - mean_b);
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

double median(std::vector<double> numbers) {
  const auto middle = numbers.begin() + std::ptrdiff_t(numbers.size() / 2);
  std::nth_element(numbers.begin(), middle, numbers.end());
  return *middle;
}

std::vector<std::size_t> chosen(const std::vector<Photo>& photos) {
  std::vector<std::size_t> with_map, result;
  for (std::size_t i = 0; i < photos.size(); ++i)
    if (!photos[i].depth_file.empty()) with_map.push_back(i);
  const std::size_t count = std::min(with_map.size(), kMapsLookedAt);
  for (std::size_t k = 0; k < count; ++k) result.push_back(with_map[k * with_map.size() / count]);
  return result;
}

}  // namespace

DepthAgreement depth_agreement(const std::vector<Photo>& photos,
                               const std::vector<ScenePoint>& points) {
  DepthAgreement agreement;
  std::vector<double> logs, deviations;
  for (const std::size_t i : chosen(photos)) {
    Photo photo = photos[i];
    photo.depth_kind = DepthKind::metric;  // so that integers have their unit
    const ImageF map = make_depth(photo);
    const Pairs pairs = is_anchored(photo) ? anchored_pairs(map, photo.depth_anchors)
                                           : pairs_of(map, photo.camera, points);
    if (pairs.values.size() < kLeastPoints) continue;
    ++agreement.maps;
    agreement.correlation += correlation(ranks_of(pairs.values), ranks_of(pairs.depths));
    std::vector<double> of_photo;
    for (std::size_t k = 0; k < pairs.values.size(); ++k)
      of_photo.push_back(std::log(pairs.values[k] / pairs.depths[k]));
    const double middle = median(of_photo);
    for (const double log : of_photo) deviations.push_back(std::abs(log - middle));
    logs.insert(logs.end(), of_photo.begin(), of_photo.end());
  }
  if (agreement.maps == 0) return agreement;
  agreement.correlation /= double(agreement.maps);
  agreement.ratio = std::exp(median(logs));
  agreement.spread = median(deviations);
  return agreement;
}

DepthKind DepthAgreement::kind() const {
  if (maps == 0 || std::abs(correlation) < kLeastCorrelation) return DepthKind::automatic;
  if (correlation < 0) return DepthKind::inverse;
  if (spread > kOneFactor) return DepthKind::relative;
  return ratio < kSameUnit && ratio > 1 / kSameUnit ? DepthKind::metric : DepthKind::scaled;
}

std::string text_of(DepthKind kind) {
  switch (kind) {
    case DepthKind::automatic: break;
    case DepthKind::metric: return "depth in world units";
    case DepthKind::scaled: return "depth up to a factor for each photo";
    case DepthKind::relative: return "depth up to scale and shift for each photo";
    case DepthKind::inverse: return "inverse depth up to scale and shift for each photo";
  }
  return "something that does not go with the sparse points";
}

}  // namespace gs
