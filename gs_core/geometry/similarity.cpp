// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/similarity.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/geometry/symmetric_eigen.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/random.h"
#include "gs_core/math/render/rotation.h"

namespace gs {
namespace {

constexpr double kLineWidth = 1e-6;  // of the length; positions less wide are on a line

Vec3d mean_of(const std::vector<Vec3d>& positions) {
  Vec3d sum(0.0);
  for (const Vec3d& at : positions) sum += at;
  return sum / double(positions.size());
}

/// The standard deviations of positions along their main axes, the largest first.
std::array<double, 3> spreads_of(const std::vector<Vec3d>& positions, const Vec3d& mean) {
  Sym3<double> S{};
  for (const Vec3d& at : positions) {
    const Vec3d d = at - mean;
    S.xx += d.x * d.x, S.xy += d.x * d.y, S.xz += d.x * d.z;
    S.yy += d.y * d.y, S.yz += d.y * d.z, S.zz += d.z * d.z;
  }
  const Vec3d value = symmetric_eigen(S).value / double(positions.size());
  std::array<double, 3> spreads;
  for (int i = 0; i < 3; ++i) spreads[i] = std::sqrt(std::max(value[i], 0.0));
  std::sort(spreads.rbegin(), spreads.rend());
  return spreads;
}

bool are_on_a_line(const std::array<double, 3>& spreads) {
  return !(spreads[1] > kLineWidth * spreads[0]);
}

/// The eigenvector of the largest eigenvalue of a symmetric matrix, by sweeps of Jacobi's method.
Quat<double> largest_eigenvector(double (&A)[4][4]) {
  double V[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
  constexpr int kMostSweeps = 30;  // convergence is quadratic: some five do
  for (int sweep = 0; sweep < kMostSweeps; ++sweep)
    for (int p = 0; p < 4; ++p)
      for (int q = p + 1; q < 4; ++q)
        if (A[p][q] != 0) jacobi_turn(A, V, p, q);
  int largest = 0;
  for (int i = 1; i < 4; ++i)
    if (A[i][i] > A[largest][largest]) largest = i;
  return {V[0][largest], V[1][largest], V[2][largest], V[3][largest]};
}

/// The rotation R with the largest sum of b . R a.   Horn 1987, Section 4
Mat3<double> best_rotation(const std::vector<Vec3d>& from, const Vec3d& mean_from,
                           const std::vector<Vec3d>& to, const Vec3d& mean_to) {
  double S[3][3] = {};
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Vec3d a = from[i] - mean_from, b = to[i] - mean_to;
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column) S[row][column] += a[row] * b[column];
  }
  const double trace = S[0][0] + S[1][1] + S[2][2];
  double N[4][4] = {};
  N[0][0] = trace;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    N[0][i + 1] = N[i + 1][0] = S[j][k] - S[k][j];
    N[i + 1][i + 1] = 2 * S[i][i] - trace;
    N[i + 1][j + 1] = N[j + 1][i + 1] = S[i][j] + S[j][i];
  }
  return rotation_matrix(largest_eigenvector(N));
}

/// Three different numbers below `count`: the draw-th of a fixed sequence.
std::array<std::size_t, 3> drawn_triple(const Random& random, int draw, std::size_t count) {
  std::array<std::size_t, 3> triple;
  for (std::uint32_t k = 0; k < 3; ++k) {
    triple[k] = random.below(std::uint32_t(count - k), std::uint64_t(draw), k);
    std::sort(triple.begin(), triple.begin() + k);
    for (std::uint32_t earlier = 0; earlier < k; ++earlier)
      triple[k] += triple[k] >= triple[earlier];  // skips the ones that are taken
  }
  return triple;
}

std::vector<std::array<std::size_t, 3>> triples_to_try(std::size_t count,
                                                       const SimilarityOptions& options) {
  std::vector<std::array<std::size_t, 3>> triples;
  const double all = double(count) * double(count - 1) * double(count - 2) / 6;
  if (all <= options.most_draws) {
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t j = i + 1; j < count; ++j)
        for (std::size_t k = j + 1; k < count; ++k) triples.push_back({i, j, k});
    return triples;
  }
  const Random random{options.seed, RandomStream::alignment};
  for (int draw = 0; draw < options.most_draws; ++draw)
    triples.push_back(drawn_triple(random, draw, count));
  return triples;
}

/// Two sets of positions, pair by pair.
struct Pairs {
  std::vector<Vec3d> from, to;
};

double squared_distance(const Similarity& similarity, const Pairs& pairs, std::size_t i) {
  const Vec3d d = similarity(pairs.from[i]) - pairs.to[i];
  return inner(d, d);
}

/// The sum of squared distances, each cut at `most`.
double cost_of(const Similarity& similarity, const Pairs& pairs, double most) {
  double cost = 0;
  for (std::size_t i = 0; i < pairs.from.size(); ++i)
    cost += std::min(squared_distance(similarity, pairs, i), most);
  return cost;
}

template <class Chosen>
Pairs chosen_pairs(const Pairs& pairs, const Chosen& is_chosen) {
  Pairs chosen;
  for (std::size_t i = 0; i < pairs.from.size(); ++i)
    if (is_chosen(i)) {
      chosen.from.push_back(pairs.from[i]);
      chosen.to.push_back(pairs.to[i]);
    }
  return chosen;
}

/// The best similarity of three pairs.
std::optional<Similarity> best_of_triples(const Pairs& pairs, const SimilarityOptions& options) {
  const double most = options.most_distance * options.most_distance;
  double least = double(pairs.from.size()) * most;  // of one that no pair agrees with
  std::optional<Similarity> best;
  for (const auto& triple : triples_to_try(pairs.from.size(), options)) {
    const Pairs three{{pairs.from[triple[0]], pairs.from[triple[1]], pairs.from[triple[2]]},
                      {pairs.to[triple[0]], pairs.to[triple[1]], pairs.to[triple[2]]}};
    const auto similarity = fit_similarity(three.from, three.to);
    if (!similarity) continue;
    const double cost = cost_of(*similarity, pairs, most);
    if (cost < least) least = cost, best = similarity;
  }
  return best;
}

/// Which pairs agree, how well, and how sure the turn is.
RobustSimilarity judged(const Similarity& similarity, const Pairs& pairs, double most) {
  RobustSimilarity result{similarity, std::vector<bool>(pairs.from.size())};
  double sum = 0;
  for (std::size_t i = 0; i < pairs.from.size(); ++i) {
    const double square = squared_distance(similarity, pairs, i);
    result.fits[i] = square <= most;
    if (!result.fits[i]) continue;
    ++result.fit_count;
    sum += square;
  }
  if (result.fit_count == 0) return result;
  result.rms = std::sqrt(sum / double(result.fit_count));
  const Pairs fitting = chosen_pairs(pairs, [&](std::size_t i) { return bool(result.fits[i]); });
  // A pair at the distance r from the line turns by e / r for an error e across it; rms / sqrt(3)
  // is the error along one axis.
  const auto spreads = spreads_of(fitting.from, mean_of(fitting.from));
  const double across = similarity.scale * std::hypot(spreads[1], spreads[2]);
  result.turn_error = result.rms / std::sqrt(3.0 * double(result.fit_count)) / across;
  return result;
}

}  // namespace

std::optional<Similarity> fit_similarity(const std::vector<Vec3d>& from,
                                         const std::vector<Vec3d>& to) {
  GS_CHECK(from.size() == to.size());
  if (from.size() < 3) return {};
  const Vec3d mean_from = mean_of(from), mean_to = mean_of(to);
  if (are_on_a_line(spreads_of(from, mean_from)) || are_on_a_line(spreads_of(to, mean_to)))
    return {};
  Similarity result;
  result.R = best_rotation(from, mean_from, to, mean_to);
  double products = 0, squares = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Vec3d a = from[i] - mean_from;
    products += inner(to[i] - mean_to, multiply(result.R, a));
    squares += inner(a, a);
  }
  result.scale = products / squares;
  result.shift = mean_to - result.scale * multiply(result.R, mean_from);
  if (!(result.scale > 0) || !is_finite(result.shift)) return {};
  return result;
}

std::optional<RobustSimilarity> fit_robust_similarity(const std::vector<Vec3d>& from,
                                                      const std::vector<Vec3d>& to,
                                                      const SimilarityOptions& options) {
  GS_CHECK(from.size() == to.size() && options.most_distance > 0);
  if (from.size() < 3) return {};
  const Pairs pairs{from, to};
  const double most = options.most_distance * options.most_distance;
  const auto start = best_of_triples(pairs, options);
  if (!start) return {};
  RobustSimilarity result = judged(*start, pairs, most);
  constexpr int kMostRounds = 20;
  for (int round = 0; round < kMostRounds; ++round) {
    const Pairs fitting = chosen_pairs(pairs, [&](std::size_t i) { return bool(result.fits[i]); });
    const auto refined = fit_similarity(fitting.from, fitting.to);
    if (!refined) return {};
    const RobustSimilarity next = judged(*refined, pairs, most);
    const bool stands = next.fits == result.fits;
    result = next;
    if (stands) break;
  }
  if (result.fit_count < 3) return {};
  return result;
}

}  // namespace gs
