// SPDX-License-Identifier: Apache-2.0
// Methods that grow on the GPU: the same rows as the scalar twin, in the same order, and the
// same sums over fragments. Children, opacities and sums may differ in their last bits.
#include "tests/support/cuda.h"

namespace gs {
namespace {

constexpr int kStep = 600;
constexpr std::uint64_t kSeed = 5;
constexpr GrowthScore kScores[] = {GrowthScore::gradient, GrowthScore::force, GrowthScore::error,
                                   GrowthScore::mask, GrowthScore::edge};

/// Rows of all kinds with statistics that take few values, so that many scores are equal. The last
/// SH coefficient holds the number of the row.
TrainingModel random_model(std::size_t count, std::uint64_t seed) {
  Draws draws(seed);
  const Gaussians rows = random_gaussians(kTypical, count, random_camera(40, 30), seed);
  for (std::size_t i = 0; i < count; ++i) {
    rows.log_scale[i] = Vec3f(std::log(draws.log_uniform(0.02f, 2))) + draws.uniform3(-1, 0);
    rows.logit_opacity[i] = logit(draws.log_uniform(0.03f, 0.9f));
    rows.sh_rest[i].coefficient[kShRestCount - 1].z = float(i);
    if (draws.chance(0.05f)) rows.mean[i].y = kNan;
  }
  TrainingModel model = model_of(rows);
  number_moments(model, 1, 1);
  begin_sums(model);
  const auto few = [&](std::uint32_t values) { return float(draws.below(values)) / 16; };
  for (std::size_t i = 0; i < count; ++i) {
    model.statistics.visits[i] = float(draws.below(9));
    model.statistics.gradient_norm[i] = model.statistics.visits[i] * few(32);
    model.statistics.sums[i] = {float(draws.below(9)), few(32), few(64)};
  }
  return model;
}

GrowthRules some_rules(GrowthScore score, GrowthSelection select, std::int64_t target) {
  GrowthRules rules;
  rules.limits = {0, 0.1f, 0.05f, 1, target};
  rules.score = score;
  rules.select = select;
  rules.prunes_unseen = score != GrowthScore::gradient;
  return rules;
}

/// The half of space above x = 0.
Region half_of_space() {
  Region region;
  region.half_spaces[0] = {{1, 0, 0}, 0};
  region.count = 1;
  return region;
}

class CudaGrow : public CudaTest {
 protected:
  /// Grows the same model on both backends and expects the same result.
  void grow_both(TrainingModel model, const GrowthRules& rules) {
    TrainingModel device = on_gpu(model);
    const RefineReport expected = cpu().rows().grow(model, rules, kSeed, kStep);
    const RefineReport report = gpu().rows().grow(device, rules, kSeed, kStep);
    EXPECT_EQ(report.cloned, expected.cloned);
    EXPECT_EQ(report.split, expected.split);
    EXPECT_EQ(report.pruned, expected.pruned);
    const TrainingModel actual = on_host(device);
    ASSERT_EQ(actual.count(), model.count());
    EXPECT_TRUE(same_bits(actual.gaussians.sh_rest, model.gaussians.sh_rest));  // the origins
    EXPECT_TRUE(same_bits(actual.gaussians.rotation, model.gaussians.rotation));
    EXPECT_TRUE(same_bits(actual.moments, model.moments));
    EXPECT_TRUE(same_bits(actual.statistics.sums, model.statistics.sums));
    expect_near(actual.gaussians.mean, model.gaussians.mean);
    expect_near(actual.gaussians.log_scale, model.gaussians.log_scale);
    expect_near(actual.gaussians.logit_opacity, model.gaussians.logit_opacity);
  }
  template <class T>
  static void expect_near(const Buffer<T>& actual, const Buffer<T>& expected) {
    const std::vector<float> a = downloaded(actual), b = downloaded(expected);
    for (std::size_t i = 0; i < b.size(); ++i) {
      if (std::isnan(b[i])) continue;
      ASSERT_NEAR(a[i], b[i], 2e-5f * std::max(1.0f, std::abs(b[i]))) << i;
    }
  }
};

TEST_F(CudaGrow, TakesTheSameRowsByEveryScore) {
  for (const GrowthScore score : kScores)
    for (const GrowthSelection select : {GrowthSelection::top_k, GrowthSelection::race})
      for (const std::int64_t target : {0, 1, 2500, 2900, 9000}) {
        SCOPED_TRACE(std::to_string(int(score)) + " up to " + std::to_string(target));
        grow_both(random_model(3000, 1), some_rules(score, select, target));
      }
}

TEST_F(CudaGrow, TakesTheSameRowsOfARegion) {
  for (const GrowthScore score : kScores) {
    GrowthRules rules = some_rules(score, GrowthSelection::top_k, 3300);
    rules.limits.region = half_of_space();
    grow_both(random_model(3000, 7), rules);
  }
}

TEST_F(CudaGrow, PrunesTheSameShare) {
  for (const std::size_t count : {0, 1, 2, 257, 3000})
    for (const PruneOrder order : {PruneOrder::opacity, PruneOrder::sensitivity})
      for (const double share : {0.0, 0.2, 0.8, 0.99}) {
        SCOPED_TRACE(std::to_string(count) + " rows, " + std::to_string(share));
        TrainingModel host = random_model(count, 7);
        for (std::size_t i = 0; i < count; i += 50) host.gaussians.logit_opacity[i] = kNan;
        TrainingModel device = on_gpu(host);
        const std::size_t expected = cpu().rows().prune_share(host, order, share);
        EXPECT_EQ(gpu().rows().prune_share(device, order, share), expected);
        const TrainingModel actual = on_host(device);
        ASSERT_EQ(actual.count(), host.count());
        EXPECT_TRUE(same_bits(actual, host));
        EXPECT_TRUE(same_bits(actual.statistics.sums, host.statistics.sums));
        EXPECT_TRUE(same_bits(actual.statistics.visits, host.statistics.visits));
      }
}

TEST_F(CudaGrow, TakesAnyNumberOfRows) {
  for (const std::size_t count : {0, 1, 2, 31, 255, 256, 257, 513}) {
    SCOPED_TRACE(std::to_string(count) + " rows");
    grow_both(random_model(count, 2),
              some_rules(GrowthScore::error, GrowthSelection::race, std::int64_t(count) * 5 / 4));
  }
}

TEST_F(CudaGrow, MakesTheSameChildren) {
  GrowthRules rules = some_rules(GrowthScore::force, GrowthSelection::race, 2600);
  for (const SplitPlacement place : {SplitPlacement::draw, SplitPlacement::axis})
    for (const bool keeps_parent : {false, true})
      for (const float opacity_factor : {1.0f, 0.9f}) {
        rules.split = {place, 1.35f, 0.55f, 0.893f, keeps_parent, opacity_factor};
        grow_both(random_model(2000, 3), rules);
      }
}

TEST_F(CudaGrow, AppliesGivenActionsAsTheScalarTwin) {
  for (const std::size_t count : {0, 1, 257, 3000})
    for (const unsigned parts : {2u, 3u}) {
      TrainingModel host = random_model(count, 5), device = on_gpu(host);
      std::vector<GrowthAction> actions;
      Draws draws(6);
      for (std::size_t i = 0; i < count; ++i) actions.push_back(GrowthAction(draws.below(4)));
      SplitRules split;
      split.parts = parts;
      const Span<const GrowthAction> given{actions.data(), count};
      const RefineReport expected = cpu().rows().apply(host, given, split, kSeed, kStep);
      const RefineReport report = gpu().rows().apply(device, given, split, kSeed, kStep);
      EXPECT_EQ(report.pruned, expected.pruned);
      const TrainingModel actual = on_host(device);
      ASSERT_EQ(actual.count(), host.count());
      EXPECT_TRUE(same_bits(actual.gaussians.sh_rest, host.gaussians.sh_rest));  // the origins
      EXPECT_TRUE(same_bits(actual.moments, host.moments));
      EXPECT_TRUE(same_bits(actual.statistics.visits, host.statistics.visits));
      EXPECT_TRUE(same_bits(actual.statistics.sums, host.statistics.sums));
      expect_near(actual.gaussians.mean, host.gaussians.mean);
      expect_near(actual.gaussians.log_scale, host.gaussians.log_scale);
    }
}

TEST_F(CudaGrow, LowersOpacitiesAsTheScalarTwin) {
  for (const OpacityPolicy policy :
       {OpacityPolicy::none, OpacityPolicy::reset, OpacityPolicy::halve})
    for (const MomentClearing clears :
         {MomentClearing::none, MomentClearing::opacity, MomentClearing::all}) {
      TrainingModel host = random_model(1000, 4), device = on_gpu(host);
      cpu().rows().lower_opacity(host, {policy, 0.1f, clears});
      gpu().rows().lower_opacity(device, {policy, 0.1f, clears});
      const TrainingModel actual = on_host(device);
      expect_near(actual.gaussians.logit_opacity, host.gaussians.logit_opacity);
      EXPECT_TRUE(same_bits(actual.moments, host.moments));
    }
}

// ---- sums over fragments -----------------------------------------------------------------------

/// Differences of single numbers of all rows, relative to the norm of the column.
void expect_same_sums(const TrainingModel& actual, const TrainingModel& expected) {
  ASSERT_TRUE(actual.statistics.has_sums);
  const std::vector<float> a = downloaded(actual.statistics.sums),
                           b = downloaded(expected.statistics.sums);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t column = 0; column < 4; ++column) {
    std::vector<float> x, y;
    for (std::size_t i = column; i < b.size(); i += 4) x.push_back(a[i]), y.push_back(b[i]);
    EXPECT_LT(norm_difference(x, y), 2e-3) << "column " << column;
    EXPECT_GT(norm_difference(x, std::vector<float>(x.size())), 0) << "column " << column;
  }
}

class CudaFragmentSums : public CudaTest {
 protected:
  /// A photo with a mask and an exposure among others.
  Scene scene() {
    Scene scene = small_scene();
    scene.train_views[1].mask = Image8(48, 36, 1, 255);
    std::fill_n(scene.train_views[1].mask.pixels.begin(), 48 * 12, std::uint8_t(0));
    scene.train_views[2].exposure = {0.9f, 1.0f, 1.1f};
    return scene;
  }
  static TrainingModel start() {
    TrainingModel model = model_of(small_truth());
    number_rows(model.gaussians.sh0, 0.1f);
    return model;
  }
  static DensityStep gathering(GrowthScore score) {
    DensityStep density;
    density.gather_statistics = true;
    density.score = score;
    return density;
  }
  /// After one step with a photo of 640 x 360 pixels.
  TrainingModel after_large_photo(Backend& backend, GrowthScore score, bool is_deterministic) {
    const Camera camera = random_camera(640, 360);
    const View view{"large", camera, random_photo(640, 360, 3)};
    RenderSettings settings;
    settings.deterministic = is_deterministic;
    TrainingModel model =
        copy_to(backend.memory(), model_of(random_gaussians(kTypical, 300, camera, 1)));
    const TrainingPhoto photo{&view, settings, 1};
    backend.step(model, {{&photo, 1}, {0.2f}, {kRates}, gathering(score)});
    backend.synchronize(model);
    return on_host(model);
  }
  TrainingModel after(Backend& backend, const Scene& scene, GrowthScore score,
                      const RenderSettings& settings, std::size_t batch_size, int reduction = 1) {
    TrainingModel model = copy_to(backend.memory(), start());
    for (std::size_t view = 0; view < 4; view += batch_size) {
      std::vector<TrainingPhoto> batch;
      for (std::size_t k = 0; k < batch_size; ++k)
        batch.push_back({&scene.train_views[view + k], settings, reduction});
      backend.step(model, {{batch.data(), batch.size()}, {0.2f}, {kRates}, gathering(score)});
    }
    backend.synchronize(model);
    return on_host(model);
  }
};

TEST_F(CudaFragmentSums, AreThoseOfTheScalarTwin) {
  const Scene scene = this->scene();
  for (const bool is_classic : {false, true})
    for (const bool is_deterministic : {false, true})
      for (const std::size_t batch : {1, 2}) {
        SCOPED_TRACE(is_deterministic ? "fixed" : "float");
        RenderSettings settings;
        settings.blend_rule = is_classic ? BlendRule::classic : BlendRule::faster_gs;
        settings.deterministic = is_deterministic;
        settings.absolute_gradient = is_classic;
        settings.background = {0.2f, 0.4f, 0.6f};
        expect_same_sums(after(gpu(), scene, GrowthScore::force, settings, batch),
                         after(cpu(), scene, GrowthScore::force, settings, batch));
      }
}

// The forces of the mean loss fall with the number of pixels, and their squares twice as fast: sums
// in fixed point must not round them to zero.
TEST_F(CudaFragmentSums, OfALargePhotoAreThoseOfTheScalarTwin) {
  for (const bool is_deterministic : {false, true}) {
    SCOPED_TRACE(is_deterministic ? "fixed" : "float");
    expect_same_sums(after_large_photo(gpu(), GrowthScore::force, is_deterministic),
                     after_large_photo(cpu(), GrowthScore::force, false));
  }
}

TEST_F(CudaFragmentSums, OfReducedPhotosAreThoseOfTheScalarTwin) {
  const Scene scene = this->scene();
  for (const int reduction : {2, 3}) {
    SCOPED_TRACE(reduction);
    expect_same_sums(after(gpu(), scene, GrowthScore::force, {}, 1, reduction),
                     after(cpu(), scene, GrowthScore::force, {}, 1, reduction));
  }
}

TEST_F(CudaFragmentSums, LeaveTheStepAsItIs) {
  const Scene scene = this->scene();
  RenderSettings settings;
  settings.deterministic = true;
  const TrainingModel plain = after(gpu(), scene, GrowthScore::gradient, settings, 1);
  EXPECT_FALSE(plain.statistics.has_sums);
  EXPECT_TRUE(same_bits(after(gpu(), scene, GrowthScore::force, settings, 1), plain));
}

TEST_F(CudaFragmentSums, HaveTheSameBitsAgainInDeterministicSteps) {
  const Scene scene = this->scene();
  RenderSettings settings;
  settings.deterministic = true;
  const TrainingModel once = after(gpu(), scene, GrowthScore::force, settings, 2);
  for (int again = 0; again < 5; ++again)
    EXPECT_TRUE(same_bits(after(gpu(), scene, GrowthScore::force, settings, 2).statistics.sums,
                          once.statistics.sums));
}

// ---- score passes ------------------------------------------------------------------------------

class CudaScorePass : public CudaFragmentSums {
 protected:
  /// The sums after one step and a pass over all photos.
  TrainingModel scored(Backend& backend, const Scene& scene, const PixelRule& rule,
                       const RenderSettings& settings, int reduction = 1) {
    TrainingModel model = copy_to(backend.memory(), start());
    std::vector<TrainingPhoto> photos;
    for (const View& view : scene.train_views) photos.push_back({&view, settings, reduction});
    backend.step(model, {{photos.data(), 1}, {0.2f}, {kRates}, {}});
    backend.score_photos(model, {photos.data(), photos.size()}, rule);
    backend.synchronize(model);
    return on_host(model);
  }
};

TEST_F(CudaScorePass, SumsWhatTheScalarTwinSums) {
  const Scene scene = this->scene();
  for (const GrowthScore score : {GrowthScore::error, GrowthScore::edge})
    for (const bool is_classic : {false, true})
      for (const int reduction : {1, 2, 3}) {
        SCOPED_TRACE(std::to_string(int(score)) + " " + std::to_string(reduction));
        RenderSettings settings;
        settings.blend_rule = is_classic ? BlendRule::classic : BlendRule::faster_gs;
        settings.background = {0.2f, 0.4f, 0.6f};
        expect_same_sums(scored(gpu(), scene, {score}, settings, reduction),
                         scored(cpu(), scene, {score}, settings, reduction));
      }
}

// A pixel at the limit of the mask may fall on either side.
TEST_F(CudaScorePass, SumsNearlyTheMaskOfTheScalarTwin) {
  const Scene scene = this->scene();
  const PixelRule rule{GrowthScore::mask, 0.3f};
  const TrainingModel actual = scored(gpu(), scene, rule, {}),
                      expected = scored(cpu(), scene, rule, {});
  EXPECT_LT(
      norm_difference(downloaded(actual.statistics.sums), downloaded(expected.statistics.sums)),
      1e-2);
}

TEST_F(CudaScorePass, HasTheSameBitsAgain) {
  const Scene scene = this->scene();
  RenderSettings settings;
  settings.deterministic = true;  // of the step before
  const TrainingModel once = scored(gpu(), scene, {GrowthScore::error}, settings);
  for (int again = 0; again < 5; ++again)
    EXPECT_TRUE(same_bits(scored(gpu(), scene, {GrowthScore::error}, settings).statistics.sums,
                          once.statistics.sums));
}

// ---- runs --------------------------------------------------------------------------------------

class CudaGrowthRun : public CudaTest {
 protected:
  CudaGrowthRun() { config_.train.deterministic = true; }
  TrainingModel trained() { return model_of_run(scene_, config_, gpu()); }

  const Scene scene_ = small_scene();
  Config config_ = busy_run();
};

TEST_F(CudaGrowthRun, RepeatsItselfInDeterministicSteps) {
  for (const int batch : {1, 3}) {
    config_.train.batch = batch;
    const TrainingModel once = trained();
    EXPECT_NE(once.count(), scene_.points.size());  // rows came and went
    EXPECT_TRUE(same_bits(trained(), once)) << batch;
  }
}

TEST_F(CudaGrowthRun, GoesOnFromAnyStep) {
  const TrainingModel whole = trained();
  for (const int stop : {36, 57, 60, 63, 64, 77}) {
    EXPECT_TRUE(same_bits(resumed_after(stop, scene_, config_, gpu()), whole)) << stop;
  }
}

TEST_F(CudaGrowthRun, WithScorePassesRepeatsItselfAndGoesOn) {
  config_.density.strategy = "taming";
  const TrainingModel whole = trained();
  EXPECT_GT(whole.count(), scene_.points.size());
  EXPECT_TRUE(same_bits(resumed_after(61, scene_, config_, gpu()), whole));
}

TEST_F(CudaGrowthRun, HasAboutAsManyGaussiansAsTheScalarTwin) {
  Trainer trainer(scene_, config_, cpu());
  trainer.run();
  const double expected = double(trainer.gaussian_count());
  EXPECT_NEAR(double(trained().count()), expected, 0.2 * expected);
}

}  // namespace
}  // namespace gs
