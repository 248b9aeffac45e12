// SPDX-License-Identifier: Apache-2.0
// The similarity (turn, even scale, shift) that takes one set of positions to another, in the sense
// of least squares, and where some of the pairs are wrong.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "gs_core/types.h"

namespace gs {

/// x -> scale R x + shift
struct Similarity {
  double scale = 1;
  Mat3<double> R{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  Vec3d shift{0.0, 0.0, 0.0};

  Vec3d operator()(const Vec3d& x) const { return scale * multiply(R, x) + shift; }
};

/// The similarity with the least sum of squared distances |s R a_i + t - b_i|^2:
///
///   R      of the quaternion that is the eigenvector of the largest eigenvalue of a symmetric 4x4
///          matrix of the sums of products a_i b_i^T                                   Horn 1987
///   s      sum b_i . R a_i / sum |a_i|^2, t = mean b - s R mean a, all about the means
///          (the same minimum as Umeyama 1991, never a mirror image)
///
/// None for fewer than three pairs, and where the positions of either set lie on a line, so that
/// the turn about it is open.
std::optional<Similarity> fit_similarity(const std::vector<Vec3d>& from,
                                         const std::vector<Vec3d>& to);

struct SimilarityOptions {
  double most_distance = 1;  // of a pair that fits, in units of `to`; > 0
  int most_draws = 2000;     // of three pairs
  std::uint64_t seed = 0;
};

/// A similarity that most pairs agree with.
struct RobustSimilarity {
  Similarity to_from_from;
  std::vector<bool> fits;     // (N)   within most_distance
  std::size_t fit_count = 0;  // of them
  double rms = 0;             // distance of the pairs that fit, units of `to`
  // Standard deviation of the turn about the line along which the positions lie best, if the
  // distances are independent errors of single positions.   radians
  double turn_error = 0;
};

/// Draws three pairs again and again, keeps the similarity with the least sum of squared distances,
/// each cut at most_distance^2 (MSAC: Torr & Zisserman 2000), and fits it anew to the pairs that
/// agree until they stay the same. Of few pairs all triples are tried. The result depends on
/// nothing but the arguments. None if no three pairs agree.
std::optional<RobustSimilarity> fit_robust_similarity(const std::vector<Vec3d>& from,
                                                      const std::vector<Vec3d>& to,
                                                      const SimilarityOptions& options);

}  // namespace gs
