// SPDX-License-Identifier: Apache-2.0
// Stages 9 and 10 on the GPU: the same rows as the scalar twin, in the same order. Copies have the
// same bits. Only the halves of split rows are computed, and may differ in their last bits.
#include "tests/support/cuda.h"

namespace gs {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kTolerance = 1e-5f;  // of halves' means and log scales, which are of order one
constexpr int kStep = 600;
constexpr AdaptiveRules kRules{.gradient_threshold = 1,
                               .small_scale = 0.1f,
                               .prune_opacity = 0.05f,
                               .prune_scale = 1,
                               .max_gaussians = 0};

/// Breaks a row in one of the ways in which a row can break.
void break_row(const Gaussians& rows, std::size_t i, std::uint32_t way) {
  if (way == 0) rows.logit_opacity[i] = kNan;
  if (way == 1) rows.rotation[i] = {1e-5f, 0, 0, 0};
  if (way == 2) rows.mean[i].y = kNan;
  if (way == 3) rows.mean[i].x = -kInfinity;
  if (way == 4) rows.log_scale[i].z = kNan;
  if (way == 5) rows.log_scale[i].x = kInfinity;
}
constexpr std::uint32_t kWaysToBreak = 6;

/// Sums of gradients over some steps. They take few values, so that many rows have equal means.
void draw_statistics(const DensityStatistics& statistics, Draws& draws) {
  for (std::size_t i = 0; i < statistics.visits.size(); ++i) {
    statistics.visits[i] = float(draws.below(9));
    statistics.gradient_norm[i] = statistics.visits[i] * float(draws.below(32)) / 16;
  }
}

/// Rows for all actions: small, large and huge, faint and broken, with and without gradients. The
/// last SH coefficient holds the number of the row, and the moments that number and more.
TrainingModel random_model(std::size_t count, std::uint64_t seed) {
  Draws draws(seed);
  const Gaussians rows = random_gaussians(kTypical, count, random_camera(40, 30), seed);
  for (std::size_t i = 0; i < count; ++i) {
    rows.log_scale[i] = Vec3f(std::log(draws.log_uniform(0.02f, 2))) + draws.uniform3(-1, 0);
    rows.logit_opacity[i] = logit(draws.log_uniform(0.03f, 0.9f));
    rows.sh_rest[i].coefficient[kShRestCount - 1].z = float(i);
    if (draws.chance(0.1f)) break_row(rows, i, draws.below(kWaysToBreak));
  }
  TrainingModel model = model_of(rows);
  number_moments(model, 1, 1);
  draw_statistics(model.statistics, draws);
  return model;
}

/// The number in random_model() of the row that row i comes from.
std::size_t origin(const Gaussians& rows, std::size_t i) {
  return std::size_t(rows.sh_rest[i].coefficient[kShRestCount - 1].z);
}

bool same_statistics(const TrainingModel& a, const TrainingModel& b) {
  return same_bits(a.statistics.visits, b.statistics.visits) &&
         same_bits(a.statistics.gradient_norm, b.statistics.gradient_norm);
}

void expect_near(const Vec3f& actual, const Vec3f& expected, std::size_t i) {
  for (int axis = 0; axis < 3; ++axis)
    EXPECT_NEAR(actual[axis], expected[axis], kTolerance * std::max(1.0f, std::abs(expected[axis])))
        << "row " << i;
}

/// Expects the same means and log scales: the same bits in rows that are copies of their origins in
/// `before`. Returns the number of rows that are not, the halves of split rows.
std::size_t expect_same_places(const Gaussians& actual, const Gaussians& expected,
                               const Gaussians& before) {
  std::size_t halves = 0;
  for (std::size_t i = 0; i < expected.count(); ++i) {
    if (expected.log_scale[i] == before.log_scale[origin(expected, i)]) {
      EXPECT_EQ(actual.mean[i], expected.mean[i]) << "row " << i;
      EXPECT_EQ(actual.log_scale[i], expected.log_scale[i]) << "row " << i;
    } else {
      expect_near(actual.mean[i], expected.mean[i], i);
      expect_near(actual.log_scale[i], expected.log_scale[i], i);
      ++halves;
    }
  }
  return halves;
}

void expect_same_report(const RefineReport& actual, const RefineReport& expected) {
  EXPECT_EQ(actual.cloned, expected.cloned);
  EXPECT_EQ(actual.split, expected.split);
  EXPECT_EQ(actual.pruned, expected.pruned);
}

class CudaRows : public CudaTest {
 protected:
  /// Splits most rows of the model on the CPU, and of a copy on the GPU. Returns the latter.
  TrainingModel split_by_both(TrainingModel& host) {
    TrainingModel device = on_gpu(host);
    GrowthRules rules{kRules};
    rules.limits.prune_scale = kInfinity;
    const RefineReport expected = cpu().rows().grow(host, rules, 3, kStep);
    EXPECT_GT(expected.split, 300u);
    expect_same_report(gpu().rows().grow(device, rules, 3, kStep), expected);
    return on_host(device);
  }
  /// Expects a refined model of the GPU to equal that of the scalar twin. Returns its number of
  /// halves.
  std::size_t expect_same_model(const TrainingModel& device, const TrainingModel& expected,
                                const Gaussians& before) {
    const TrainingModel actual = on_host(device);
    if (actual.count() != expected.count()) {
      ADD_FAILURE() << actual.count() << " rows instead of " << expected.count();
      return 0;
    }
    EXPECT_TRUE(same_bits(actual.gaussians.rotation, expected.gaussians.rotation));
    EXPECT_TRUE(same_bits(actual.gaussians.logit_opacity, expected.gaussians.logit_opacity));
    EXPECT_TRUE(same_bits(actual.gaussians.sh0, expected.gaussians.sh0));
    EXPECT_TRUE(same_bits(actual.gaussians.sh_rest, expected.gaussians.sh_rest));
    EXPECT_TRUE(same_bits(actual.moments, expected.moments));
    EXPECT_TRUE(same_statistics(actual, expected));
    return expect_same_places(actual.gaussians, expected.gaussians, before);
  }

  /// Refines the same model on both backends and expects the same result. Returns that of the
  /// scalar twin.
  TrainingModel refine_both(TrainingModel model, const AdaptiveRules& rules, std::uint64_t seed) {
    const GrowthRules growth{rules};
    const Gaussians before = copy_of(model.gaussians);
    TrainingModel device = on_gpu(model);
    expected_ = cpu().rows().grow(model, growth, seed, kStep);
    expect_same_report(gpu().rows().grow(device, growth, seed, kStep), expected_);
    halves_ = expect_same_model(device, model, before);
    return model;
  }

  /// Expects every array of a model of the GPU to have the bits of the scalar twin's.
  void expect_same_bits(const TrainingModel& device, const TrainingModel& expected) {
    const TrainingModel actual = on_host(device);
    EXPECT_TRUE(same_bits(actual, expected));
    EXPECT_TRUE(same_statistics(actual, expected));
  }

  RefineReport expected_;   // of the last refine_both()
  std::size_t halves_ = 0;  // in that refinement
};

TEST_F(CudaRows, RefinesRowsOfAllKindsAsTheScalarTwin) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    refine_both(random_model(3000, seed), kRules, seed);
    EXPECT_GT(expected_.cloned, 100u);
    EXPECT_GT(expected_.split, 100u);
    EXPECT_GT(expected_.pruned, 100u);
    EXPECT_GT(halves_, 100u);
    EXPECT_LT(halves_, 2 * expected_.split);  // some halves were pruned
  }
}

TEST_F(CudaRows, RefinesTheSameRowsOfARegion) {
  const TrainingModel model = random_model(3000, 4);
  std::vector<float> x;
  for (const Vec3f& mean : model.gaussians.mean.download())
    if (std::isfinite(mean.x)) x.push_back(mean.x);
  std::nth_element(x.begin(), x.begin() + std::ptrdiff_t(x.size() / 2), x.end());
  AdaptiveRules rules = kRules;
  refine_both(random_model(3000, 4), rules, 4);
  const std::size_t everywhere = expected_.cloned;
  rules.region.half_spaces[0] = {{1, 0, 0}, x[x.size() / 2]};
  rules.region.count = 1;
  refine_both(random_model(3000, 4), rules, 4);
  EXPECT_GT(expected_.cloned, 50u);
  EXPECT_LT(expected_.cloned, everywhere - 50);
}

TEST_F(CudaRows, RefinesAnyNumberOfRows) {
  for (const std::size_t count : {0, 1, 2, 31, 255, 256, 257, 511, 513}) {
    SCOPED_TRACE(std::to_string(count) + " rows");
    refine_both(random_model(count, 5), kRules, 1);
  }
}

TEST_F(CudaRows, RefinesASingleRowOfAnyAction) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16}) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    refine_both(random_model(1, seed), kRules, seed);
  }
}

TEST_F(CudaRows, GrowsTheSameRowsUpToTheCap) {
  for (const int room : {-5000, 0, 1, 100, 257, 600, 5000}) {
    SCOPED_TRACE("about " + std::to_string(room) + " rows of room");
    const std::size_t count = 3000;
    AdaptiveRules rules = kRules;
    rules.max_gaussians = std::max(1, int(count) * 3 / 4 + room);
    refine_both(random_model(count, 6), rules, 2);
  }
}

TEST_F(CudaRows, LetsRowsOfEqualGradientsGrowInRowOrder) {
  AdaptiveRules rules = kRules;
  for (const float gradient : {2.0f, 1.0f}) {
    TrainingModel model = random_model(1000, 7);
    for (std::size_t i = 0; i < model.count(); ++i)
      model.statistics.gradient_norm[i] = gradient * std::max(model.statistics.visits[i], 1.0f);
    rules.gradient_threshold = gradient;
    rules.max_gaussians = 1000;
    const TrainingModel refined = refine_both(std::move(model), rules, 3);
    EXPECT_GT(expected_.cloned + expected_.split, 0u);
    EXPECT_LE(refined.count(), 1000u);
  }
}

TEST_F(CudaRows, MayPruneEverything) {
  AdaptiveRules rules = kRules;
  rules.prune_opacity = 1;
  EXPECT_EQ(refine_both(random_model(700, 8), rules, 4).count(), 0u);
}

TEST_F(CudaRows, KeepsEverythingWhereNothingIsAsked) {
  TrainingModel model = random_model(700, 9);
  cpu().rows().prune(model, kRules.prune_opacity);
  for (std::size_t i = 0; i < model.count(); ++i)
    model.gaussians.sh_rest[i].coefficient[kShRestCount - 1].z = float(i);
  AdaptiveRules rules = kRules;
  rules.gradient_threshold = rules.prune_scale = kInfinity;
  model.statistics.visits.fill_zero();
  model.statistics.gradient_norm.fill_zero();
  const std::size_t count = model.count();
  EXPECT_EQ(refine_both(std::move(model), rules, 5).count(), count);
}

// Each round makes more rows than the arrays and the scratch memory of the one before can hold.
TEST_F(CudaRows, GrowsBeyondWhatItsArraysHold) {
  GrowthRules rules{kRules};
  rules.limits.gradient_threshold = 0;  // all grow
  TrainingModel host = random_model(500, 10);
  TrainingModel device = on_gpu(host);
  for (int round = 0; round < 4; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    for (std::size_t i = 0; i < host.count(); ++i)
      host.gaussians.sh_rest[i].coefficient[kShRestCount - 1].z = float(i);
    device.gaussians.sh_rest.upload(host.gaussians.sh_rest.download());
    // Both start with the same bits, so that differences in last bits do not add up.
    device.gaussians.mean.upload(host.gaussians.mean.download());
    device.gaussians.log_scale.upload(host.gaussians.log_scale.download());
    for (TrainingModel* const model : {&host, &device})
      model->statistics.gradient_norm.upload(std::vector<float>(host.count(), 1.0f));
    const Gaussians before = copy_of(host.gaussians);
    const RefineReport expected = cpu().rows().grow(host, rules, 6, round);
    expect_same_report(gpu().rows().grow(device, rules, 6, round), expected);
    expect_same_model(device, host, before);
  }
  EXPECT_GT(host.count(), 2000u);
}

TEST_F(CudaRows, PrunesTheSameRows) {
  for (const std::size_t count : {0, 1, 256, 2000}) {
    SCOPED_TRACE(std::to_string(count) + " rows");
    TrainingModel host = random_model(count, 11);
    TrainingModel device = on_gpu(host);
    const std::size_t expected = cpu().rows().prune(host, 0.05f);
    EXPECT_EQ(gpu().rows().prune(device, 0.05f), expected);
    expect_same_bits(device, host);
    EXPECT_EQ(gpu().rows().prune(device, 0.05f), 0u);  // nothing is left to prune
    expect_same_bits(device, host);
  }
}

TEST_F(CudaRows, ResetsOpacitiesAndTheirMomentsToTheSameBits) {
  for (const std::size_t count : {0, 1, 2000}) {
    SCOPED_TRACE(std::to_string(count) + " rows");
    TrainingModel host = random_model(count, 12);
    TrainingModel device = on_gpu(host);
    cpu().rows().reset_opacity(host, 0.1f);
    gpu().rows().reset_opacity(device, 0.1f);
    expect_same_bits(device, host);
  }
}

// Decisions are made of products and sums that are not fused, so that both sides see the same rows.
TEST_F(CudaRows, MeasuresTheSame3dFilters) {
  std::vector<Camera> cameras;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) cameras.push_back(random_camera(40, 30, seed));
  for (const std::size_t count : {0, 1, 256, 5000}) {
    SCOPED_TRACE(std::to_string(count) + " rows");
    TrainingModel host = random_model(count, 14);
    TrainingModel device = on_gpu(host);
    for (int times = 0; times < 2; ++times) {
      cpu().rows().measure_filter(host, cameras, 0.2f);
      gpu().rows().measure_filter(device, cameras, 0.2f);
      expect_same_bits(device, host);
    }
    std::vector<float> scales = host.gaussians.filter_scale.download();
    std::sort(scales.begin(), scales.end());
    if (count <= 256) continue;
    EXPECT_LT(scales.front(), 0.5f * scales.back());
  }
}

TEST_F(CudaRows, With3dFiltersRefinePruneAndResetTheSameRows) {
  TrainingModel start = random_model(2000, 15);
  start.gaussians = with_filters(start.gaussians, 16);
  const Gaussians before = copy_of(start.gaussians);
  TrainingModel device = on_gpu(start), host = on_host(start);
  const std::size_t pruned = cpu().rows().prune(host, 0.05f);
  EXPECT_GT(pruned, 200u);
  EXPECT_EQ(gpu().rows().prune(device, 0.05f), pruned);
  expect_same_bits(device, host);

  const TrainingModel refined = refine_both(on_host(start), kRules, 3);
  EXPECT_TRUE(refined.gaussians.has_filter);
  for (std::size_t i = 0; i < refined.count(); ++i)
    EXPECT_EQ(refined.gaussians.filter_scale[i], before.filter_scale[origin(refined.gaussians, i)]);

  for (const bool by_rule : {false, true}) {
    TrainingModel host_reset = on_host(start), device_reset = on_gpu(start);
    for (auto [rows, model] :
         {std::pair{&cpu().rows(), &host_reset}, std::pair{&gpu().rows(), &device_reset}})
      by_rule ? rows->lower_opacity(*model, {OpacityPolicy::reset, 0.1f, MomentClearing::opacity})
              : rows->reset_opacity(*model, 0.1f);
    const std::vector<float> expected = host_reset.gaussians.logit_opacity.download(),
                             actual = device_reset.gaussians.logit_opacity.download();
    for (std::size_t i = 0; i < expected.size(); ++i) {
      if (std::isnan(expected[i])) continue;
      EXPECT_NEAR(actual[i], expected[i], 1e-4f) << i;
    }
  }
}

TEST_F(CudaRows, SortsBrokenAndEqualRowsAlongTheSameCurve) {
  for (const std::size_t count : {0, 1, 255, 5000}) {
    SCOPED_TRACE(std::to_string(count) + " rows");
    TrainingModel host = random_model(count, 13);
    for (std::size_t i = 0; i < count / 4; ++i)
      host.gaussians.mean[count - 1 - i] = host.gaussians.mean[i];
    TrainingModel device = on_gpu(host);
    cpu().rows().sort_by_morton(host);
    gpu().rows().sort_by_morton(device);
    expect_same_bits(device, host);
  }
}

TEST_F(CudaRows, SortsPointsThatHaveNoBox) {
  for (const float coordinate : {2.5f, kNan, kInfinity}) {
    TrainingModel host = random_model(300, 14);
    std::fill(host.gaussians.mean.begin(), host.gaussians.mean.end(), Vec3f(coordinate));
    TrainingModel device = on_gpu(host);
    cpu().rows().sort_by_morton(host);
    gpu().rows().sort_by_morton(device);
    expect_same_bits(device, host);
  }
}

TEST_F(CudaRows, AllocatesNothingOnceItsRoomHasGrown) {
  TrainingModel device = on_gpu(random_model(2000, 15));
  gpu().rows().sort_by_morton(device);
  const cuda::Usage grown = cuda::usage();
  gpu().rows().sort_by_morton(device);
  EXPECT_EQ(cuda::usage().allocated_bytes, grown.allocated_bytes);
  EXPECT_EQ(cuda::usage().peak_allocated_bytes, grown.peak_allocated_bytes);
}

}  // namespace
}  // namespace gs
