// SPDX-License-Identifier: Apache-2.0
// Merging Gaussians: moments are kept, near and alike ones go first, and nothing depends on
// threads.
#include "gs_model/edit/decimate.h"

#include "gs_core/geometry/kd_tree.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/random_model.h"
#include "tests/support/same_bits.h"
#include "tests/support/test.h"

namespace gs {
namespace {

constexpr double kFloat = 2e-5;  // roundings of floats, relative

// Small Gaussians at random places of a cube.
Gaussians cloud(std::size_t count) {
  GaussianModel model = random_model(count, 3);
  for (Vec3f& s : model.gaussians.log_scale) s = 0.3f * s - Vec3f(2);
  return std::move(model.gaussians);
}

Sym3<double> sigma_of(const Gaussians& g, std::size_t i) {
  const Quatf& q = g.rotation[i];
  return covariance(rotation_matrix(Quat<double>{q.w, q.x, q.y, q.z}),
                    variance(Vec3d(g.log_scale[i])));
}

double mass_of(const Gaussians& g, std::size_t i) {
  return sigmoid(double(g.logit_opacity[i])) * ellipsoid_area(variance(Vec3d(g.log_scale[i])));
}

TEST(MergeGaussians, TheAreaOfASphereIsExactAndADiscHasTwoSides) {
  EXPECT_NEAR(ellipsoid_area({4, 4, 4}), 4 * M_PI * 4, 1e-9);
  EXPECT_NEAR(ellipsoid_area({1, 1, 0}), 2 * M_PI, 0.011 * 2 * M_PI);  // the formula's own error
}

TEST(MergeGaussians, MeanCovarianceAndColorsAreThoseOfTheMixture) {
  const Gaussians g = cloud(5);
  Gaussians out(1, host_memory());
  const std::vector<std::uint32_t> rows = {4, 1, 2};
  merge_gaussians(g, rows.data(), rows.size(), out, 0);
  double mass = 0;
  for (const auto i : rows) mass += mass_of(g, i);
  Vec3d mean(0.0), sh0(0.0), sh9(0.0);
  for (const auto i : rows) {
    mean += mass_of(g, i) / mass * Vec3d(g.mean[i]);
    sh0 += mass_of(g, i) / mass * Vec3d(g.sh0[i]);
    sh9 += mass_of(g, i) / mass * Vec3d(g.sh_rest[i].coefficient[9]);
  }
  double xx = 0, yz = 0;
  for (const auto i : rows) {
    const Vec3d d = Vec3d(g.mean[i]) - mean;
    xx += mass_of(g, i) / mass * (sigma_of(g, i).xx + d.x * d.x);
    yz += mass_of(g, i) / mass * (sigma_of(g, i).yz + d.y * d.z);
  }
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(out.mean[0][k], mean[k], kFloat);
    EXPECT_NEAR(out.sh0[0][k], sh0[k], kFloat);
    EXPECT_NEAR(out.sh_rest[0].coefficient[9][k], sh9[k], kFloat);
  }
  EXPECT_NEAR(sigma_of(out, 0).xx, xx, kFloat * xx);
  EXPECT_NEAR(sigma_of(out, 0).yz, yz, kFloat * xx);
  EXPECT_NEAR(sigmoid(out.logit_opacity[0]),
              mass / ellipsoid_area(variance(Vec3d(out.log_scale[0]))), kFloat);
}

TEST(MergeGaussians, OneAloneStaysWhatItIs) {
  const Gaussians g = cloud(3);
  Gaussians out(1, host_memory());
  const std::uint32_t row = 1;
  merge_gaussians(g, &row, 1, out, 0);
  const Sym3<double> before = sigma_of(g, 1), after = sigma_of(out, 0);
  EXPECT_EQ(out.mean[0], g.mean[1]);
  EXPECT_NEAR(after.xy, before.xy, kFloat * before.xx);
  EXPECT_NEAR(after.zz, before.zz, kFloat * before.zz);
  EXPECT_NEAR(out.logit_opacity[0], g.logit_opacity[1], 1e-3);
}

// Two that cover each other fully: no more than an opaque one, with a finite logit.
TEST(MergeGaussians, OpacitiesStopAtOne) {
  Gaussians g = cloud(2);
  g.logit_opacity[0] = 5;
  const Gaussians two = rows_of(g, {0, 0});
  Gaussians out(1, host_memory());
  const std::uint32_t rows[] = {0, 1};
  merge_gaussians(two, rows, 2, out, 0);
  EXPECT_NEAR(sigmoid(out.logit_opacity[0]), 0.9999, 1e-6);
}

// The closed form against sums over a fine grid in the planes of the three views.
TEST(MergeCost, IsTheIntegralOfTheSquaredDifference) {
  const Gaussians g = cloud(6);
  for (std::size_t pair = 0; pair < 3; ++pair) {
    const MergeShape a = merge_shape_of(g, 2 * pair), b = merge_shape_of(g, 2 * pair + 1, 3);
    MergeShape near = b;
    near.mean = a.mean + Vec3f(0.1f, -0.05f, 0.07f);
    const MergeShape m = merged_shape(a, near);
    const auto value = [](const MergeShape& s, int u, int v, double x, double y) {
      const double full[3][3] = {{s.sigma.xx, s.sigma.xy, s.sigma.xz},
                                 {s.sigma.xy, s.sigma.yy, s.sigma.yz},
                                 {s.sigma.xz, s.sigma.yz, s.sigma.zz}};
      const double uu = full[u][u], uv = full[u][v], vv = full[v][v], det = uu * vv - uv * uv;
      const double dx = x - s.mean[u], dy = y - s.mean[v];
      return s.opacity * std::exp(-0.5 * (vv * dx * dx - 2 * uv * dx * dy + uu * dy * dy) / det);
    };
    double sum = 0;
    constexpr double kStep = 0.01;
    for (const auto& [u, v] : {std::pair(1, 2), std::pair(0, 2), std::pair(0, 1)})
      for (double x = -1.5; x < 1.5; x += kStep)
        for (double y = -1.5; y < 1.5; y += kStep) {
          const double px = m.mean[u] + x, py = m.mean[v] + y;
          const double va = value(a, u, v, px, py), vb = value(near, u, v, px, py),
                       vm = value(m, u, v, px, py);
          for (int c = 0; c < 4; ++c) {
            const auto color = [&](const MergeShape& s) { return c < 3 ? s.color[c] : 1.0; };
            const double off = va * color(a) + vb * color(near) - vm * color(m);
            sum += off * off * kStep * kStep / 3;
          }
        }
    const double expected = double(std::max(a.importance, near.importance)) * sum;
    EXPECT_NEAR(merge_cost(a, near), expected, 1e-3 * expected);
  }
}

TEST(MergeCost, CountsWhatPicturesShow) {
  const Gaussians g = cloud(2);
  MergeShape hidden = merge_shape_of(g, 0, 0), seen = merge_shape_of(g, 1, 3);
  EXPECT_EQ(merge_cost(hidden, hidden), 0);
  MergeShape as_important = hidden;
  as_important.importance = 3;
  // The hidden one's color is not seen, and so no reason against the merge or for its result.
  EXPECT_LE(merge_cost(hidden, seen), merge_cost(as_important, seen));
  EXPECT_EQ(merged_shape(hidden, seen).color, seen.color);
  EXPECT_LT(merged_shape(hidden, seen).importance, seen.importance);
  const std::uint32_t rows[] = {0, 1};
  const float importance[] = {0, 3};
  Gaussians out = copy_of(g);
  merge_gaussians(g, rows, 2, out, 0, importance);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(out.sh0[0][k], g.sh0[1][k], kFloat);
  EXPECT_EQ(importance_of({8, 5, 0}, {2, 0, 1}), (std::vector<float>{4, 0, 0}));
}

TEST(MergeCost, EqualOnesCostLessThanDistantOnesAndOnesOfAnotherColor) {
  const Gaussians g = cloud(1);
  MergeShape a = merge_shape_of(g, 0), same = a, distant = a, other = a;
  a.opacity = same.opacity = distant.opacity = other.opacity = 0.4f;
  distant.mean.x += 0.5f;
  other.color = Vec3f(1) - a.color + Vec3f(0.3f);
  EXPECT_LT(merge_cost(a, same), merge_cost(a, other));
  EXPECT_LT(merge_cost(a, same), merge_cost(a, distant));
}

TEST(Decimate, LeavesTheNumberThatWasAskedFor) {
  for (const std::size_t count : {2999u, 1500u, 300u, 1u}) {
    Gaussians g = cloud(3000);
    EXPECT_EQ(decimate(g, count), count);
    EXPECT_EQ(g.count(), count);
    for (std::size_t i = 0; i < count; ++i) {
      EXPECT_TRUE(is_finite(g.mean[i]) && is_finite(g.log_scale[i]));
      EXPECT_TRUE(std::isfinite(g.logit_opacity[i]));
    }
  }
  Gaussians g = cloud(20);
  EXPECT_EQ(decimate(g, 50), 20u);
  EXPECT_TRUE(same_bits(g, cloud(20)));
}

TEST(Decimate, TheNumberOfThreadsDoesNotMatter) {
  Gaussians one = cloud(4000), many = cloud(4000);
  set_thread_count(1);
  decimate(one, 400);
  set_thread_count(5);
  decimate(many, 400);
  set_thread_count(0);
  EXPECT_TRUE(same_bits(one, many));
}

TEST(Decimate, CopiesAreMergedFirstAndImportantOnesLast) {
  const Gaussians half = cloud(200);
  std::vector<std::uint32_t> twice;
  for (std::uint32_t i = 0; i < 200; ++i) twice.insert(twice.end(), {i, i});
  Gaussians g = rows_of(half, twice);
  for (float& logit : g.logit_opacity) logit = -2;  // so that two are not more than opaque
  decimate(g, 200);
  for (std::size_t i = 0; i < 200; ++i)
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(g.mean[i][k], half.mean[i][k], kFloat);

  Gaussians weighted = cloud(200);
  DecimateOptions options;
  options.importance.assign(200, 1e-6f);
  for (int i = 0; i < 50; ++i) options.importance[i] = 1e6f;
  decimate(weighted, 60, options);
  const Gaussians all = cloud(200);
  for (std::size_t i = 0; i < 45; ++i) EXPECT_EQ(weighted.mean[i], all.mean[i]);
}

// Where no pictures are known, a small Gaussian may have been seen from near. A model of two
// halves, of which one is a hundred times smaller, loses as many of each.
TEST(Decimate, SizesAreNoReasonToMerge) {
  Gaussians both = cloud(400);
  for (std::size_t i = 200; i < 400; ++i) {
    both.mean[i] = Vec3f(1000, 0, 0) + 0.01f * both.mean[i - 200];
    both.log_scale[i] = both.log_scale[i - 200] + Vec3f(std::log(0.01f));
    both.rotation[i] = both.rotation[i - 200];
    both.logit_opacity[i] = both.logit_opacity[i - 200];
    both.sh0[i] = both.sh0[i - 200];
  }
  const std::vector<float> importance = importance_by_size(both);
  for (std::size_t i = 0; i < 200; ++i)
    EXPECT_NEAR(importance[i + 200] / importance[i], 1e4, 1) << i;
  decimate(both, 200);
  const auto small =
      std::count_if(both.mean.begin(), both.mean.end(), [](const Vec3f& m) { return m.x > 500; });
  EXPECT_NEAR(double(small), 100, 5);
}

TEST(Decimate, RowsThatAreNeverRenderedGoFirstAndEqualPlacesAreNoTrap) {
  Gaussians g = cloud(600);
  for (std::size_t i = 0; i < 300; ++i) g.mean[i] = Vec3f(1, 2, 3);
  g.mean[7].x = NAN;
  g.rotation[9] = {0, 0, 0, 0};
  EXPECT_EQ(decimate(g, 598), 598u);
  EXPECT_EQ(decimate(g, 5), 5u);
}

TEST(Decimate, ProgressIsToldAndTimeIsRefused) {
  Gaussians g = cloud(500);
  std::size_t last = 0;
  DecimateOptions options;
  options.on_progress = [&](std::size_t done, std::size_t total) {
    EXPECT_GT(done, last);
    EXPECT_EQ(total, 400u);
    last = done;
  };
  decimate(g, 100, options);
  EXPECT_EQ(last, 400u);
  GaussianModel moving = random_moving_model(10, 0);
  EXPECT_THROW(decimate(moving.gaussians, 5), UsageError);
}

TEST(KdTreeNearest, TheNearestComeInOrder) {
  const Gaussians g = cloud(500);
  const KdTree tree({g.mean.data(), g.count()});
  for (std::size_t i = 0; i < 20; ++i) {
    std::uint32_t near[8];
    ASSERT_EQ(tree.nearest(i, 8, near), 8);
    const auto squared = [&](std::size_t n) {
      const Vec3f d = g.mean[n] - g.mean[i];
      return inner(d, d);
    };
    std::vector<float> all;
    for (std::size_t n = 0; n < 500; ++n)
      if (n != i) all.push_back(squared(n));
    std::sort(all.begin(), all.end());
    for (int k = 0; k < 8; ++k) EXPECT_EQ(squared(near[k]), all[k]);
  }
}

}  // namespace
}  // namespace gs
