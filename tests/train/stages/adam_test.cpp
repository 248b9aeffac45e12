// SPDX-License-Identifier: Apache-2.0
// Stage 8: the optimizer over arrays equals adam_update(), number by number.
#include "gs_core/math/update/adam.h"

#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"

namespace gs {
namespace {

TEST(ScalarOptimizer, UpdatesEachNumberAtTheRateOfItsArray) {
  const Camera camera = random_camera(40, 30);
  TrainingModel model = model_of(random_gaussians(kTypical, 100, camera, 1));
  const TrainingModel start = model_of(model.gaussians);
  const Gaussians first = random_gradients(100, 2), second = random_gradients(100, 3);
  update_by_adam(model, first, {kRates});
  update_by_adam(model, second, {kRates});

  const auto expect = [](const char* name, const auto& before, const auto& g1, const auto& g2,
                         const auto& after, const auto& moments, float rate) {
    const Span<float> p = numbers_of(before);
    for (std::size_t i = 0; i < p.size; ++i) {
      float value = p[i];
      FloatMoments expected{};
      adam_update(value, expected, numbers_of(g1)[i], adam_step(1, rate));
      adam_update(value, expected, numbers_of(g2)[i], adam_step(2, rate));
      ASSERT_EQ(numbers_of(after)[i], value) << name << " " << i;
      ASSERT_EQ(moments_in(moments)[i], expected) << name << " " << i;
    }
  };
  for_each_array(expect, start.gaussians, first, second, model.gaussians, float_moments(model),
                 kRates);
  EXPECT_EQ(model.adam_steps, 2);
}

// Where all gradients are alike, the moments are those of as many updates by one photo each.
TEST(ScalarOptimizer, ABatchStandsForAsManyUpdatesAsItHasPhotos) {
  const TrainingModel start = model_of(random_gaussians(kTypical, 50, random_camera(40, 30), 9));
  const Gaussians gradients = random_gradients(50, 10);
  TrainingModel singles = model_of(start.gaussians), batch = model_of(start.gaussians);
  for (int photo = 0; photo < 4; ++photo) update_by_adam(singles, gradients, {kRates});
  update_by_adam(batch, gradients, {kRates, batch_rule(4)});
  EXPECT_EQ(batch.adam_steps, 4);
  const auto expect_near = [](const char* name, const auto& a, const auto& b) {
    for (std::size_t i = 0; i < numbers_of(a).size; ++i)
      ASSERT_NEAR(numbers_of(a)[i] / numbers_of(b)[i], 1, 1e-4) << name << " " << i;
  };
  for_each_array(expect_near, opened(batch).first, opened(singles).first);
  for_each_array(expect_near, opened(batch).second, opened(singles).second);
}

TEST(BatchRule, ForOnePhotoIsTheRuleOfAdam) {
  const AdamRule one = batch_rule(1), plain;
  EXPECT_EQ(one.beta1, plain.beta1);
  EXPECT_EQ(one.one_minus_beta1, plain.one_minus_beta1);
  EXPECT_EQ(one.beta2, plain.beta2);
  EXPECT_EQ(one.one_minus_beta2, plain.one_minus_beta2);
  EXPECT_EQ(one.epsilon, plain.epsilon);
  EXPECT_EQ(one.steps, plain.steps);
  EXPECT_EQ(batch_rate(1), 1.0f);
}

// Malladi et al. 2022: gradients that are noise move a parameter as far in one update by B photos as
// in B updates by one photo.
TEST(BatchRule, KeepsHowFarNoiseMovesAParameter) {
  constexpr int kPhotos = 16, kUpdates = 400, kParameters = 2000;
  Draws draws(3);
  double singles = 0, batches = 0;
  for (int k = 0; k < kParameters; ++k) {
    float single = 0, batch = 0;
    FloatMoments moments{}, batch_moments{};
    for (int update = 1; update <= kUpdates; ++update) {
      float mean = 0;
      for (int photo = 0; photo < kPhotos; ++photo) {
        const float gradient = draws.normal();
        adam_update(single, moments, gradient,
                    adam_step((update - 1) * kPhotos + photo + 1, 1e-3f));
        mean += gradient / kPhotos;
      }
      adam_update(batch, batch_moments, mean,
                  adam_step(update * kPhotos, 1e-3f * batch_rate(kPhotos)), batch_rule(kPhotos));
    }
    singles += double(single) * single;
    batches += double(batch) * batch;
  }
  EXPECT_NEAR(std::sqrt(batches / singles), 1, 0.1);
}

TEST(ScalarOptimizer, MovesRowsWithoutGradientOnByTheirMomentum) {
  TrainingModel model = model_of(random_gaussians(kTypical, 5, random_camera(40, 30), 6));
  Gaussians gradients(5, host_memory());
  for_each_array([](const char*, const auto& array) { number_rows(array, 1); }, gradients);
  update_by_adam(model, gradients, {kRates});
  const Gaussians before = copy_of(model.gaussians);
  gradients.fill_zero();
  update_by_adam(model, gradients, {kRates});
  for_each_array(
      [](const char* name, const auto& a, const auto& b) {
        for (std::size_t i = 0; i < numbers_of(a).size; ++i)
          EXPECT_LT(numbers_of(a)[i], numbers_of(b)[i]) << name;
      },
      model.gaussians, before);
}

TEST(ScalarOptimizer, GivesTheSameBitsForAnyNumberOfThreads) {
  const Gaussians start = random_gaussians(kTypical, 3000, random_camera(40, 30), 7);
  const Gaussians gradients = random_gradients(3000, 8);
  const auto updated = [&] {
    TrainingModel model = model_of(start);
    update_by_adam(model, gradients, {kRates});
    return model;
  };
  EXPECT_TRUE(same_bits(with_threads(1, updated), with_threads(3, updated)));
}

}  // namespace
}  // namespace gs
