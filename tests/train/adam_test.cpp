// SPDX-License-Identifier: Apache-2.0
// Stage 8: the optimizer over arrays equals adam_update(), number by number.
#include "gs_core/math/adam.h"

#include <gtest/gtest.h>

#include "gs_core/threads/parallel.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"

namespace gs {
namespace {

constexpr LearningRates kRates{1e-4f, 2e-3f, 3e-3f, 4e-2f, 5e-3f, 6e-4f};

Gaussians random_gradients(std::size_t count, std::uint64_t seed) {
  Gaussians gradients(count, host_memory());
  Draws draws(seed);
  for_each_array(
      [&](const char*, const auto& array) {
        for (float& number : numbers_of(array))
          number = draws.normal() * draws.log_uniform(1e-8f, 1);
      },
      gradients);
  return gradients;
}

TEST(ScalarOptimizer, UpdatesEachNumberAtTheRateOfItsArray) {
  const Camera camera = random_camera(40, 30);
  TrainingModel model = model_of(random_gaussians(kTypical, 100, camera, 1));
  const TrainingModel start = model_of(model.gaussians);
  const Gaussians first = random_gradients(100, 2), second = random_gradients(100, 3);
  const auto optimizer = make_scalar_optimizer();
  optimizer->step(model, first, kRates);
  optimizer->step(model, second, kRates);

  const auto expect = [](const char* name, float rate, const auto& before, const auto& g1,
                         const auto& g2, const auto& after, const auto& m, const auto& v) {
    const Span<float> p = numbers_of(before);
    for (std::size_t i = 0; i < p.size; ++i) {
      float value = p[i], mi = 0, vi = 0;
      adam_update(value, mi, vi, numbers_of(g1)[i], adam_step(1, rate));
      adam_update(value, mi, vi, numbers_of(g2)[i], adam_step(2, rate));
      ASSERT_EQ(numbers_of(after)[i], value) << name << " " << i;
      ASSERT_EQ(numbers_of(m)[i], mi) << name << " " << i;
      ASSERT_EQ(numbers_of(v)[i], vi) << name << " " << i;
    }
  };
  const Gaussians &s = start.gaussians, &g = model.gaussians, &m = model.first_moment,
                  &v = model.second_moment;
  expect("mean", 1e-4f, s.mean, first.mean, second.mean, g.mean, m.mean, v.mean);
  expect("log_scale", 2e-3f, s.log_scale, first.log_scale, second.log_scale, g.log_scale,
         m.log_scale, v.log_scale);
  expect("rotation", 3e-3f, s.rotation, first.rotation, second.rotation, g.rotation, m.rotation,
         v.rotation);
  expect("logit_opacity", 4e-2f, s.logit_opacity, first.logit_opacity, second.logit_opacity,
         g.logit_opacity, m.logit_opacity, v.logit_opacity);
  expect("sh0", 5e-3f, s.sh0, first.sh0, second.sh0, g.sh0, m.sh0, v.sh0);
  expect("sh_rest", 6e-4f, s.sh_rest, first.sh_rest, second.sh_rest, g.sh_rest, m.sh_rest,
         v.sh_rest);
}

TEST(ScalarOptimizer, CountsItsSteps) {
  TrainingModel model = model_of(random_gaussians(kTypical, 3, random_camera(40, 30), 4));
  const Gaussians gradients = random_gradients(3, 5);
  model.adam_steps = 17;
  make_scalar_optimizer()->step(model, gradients, kRates);
  EXPECT_EQ(model.adam_steps, 18);
}

TEST(ScalarOptimizer, MovesRowsWithoutGradientOnByTheirMomentum) {
  TrainingModel model = model_of(random_gaussians(kTypical, 5, random_camera(40, 30), 6));
  Gaussians gradients(5, host_memory());
  for_each_array([](const char*, const auto& array) { number_rows(array, 1); }, gradients);
  const auto optimizer = make_scalar_optimizer();
  optimizer->step(model, gradients, kRates);
  const Gaussians before = copy_of(model.gaussians);
  gradients.fill_zero();
  optimizer->step(model, gradients, kRates);
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
  TrainingModel models[2] = {model_of(start), model_of(start)};
  for (int i = 0; i < 2; ++i) {
    set_thread_count(i + 1);
    make_scalar_optimizer()->step(models[i], gradients, kRates);
  }
  set_thread_count(0);
  EXPECT_TRUE(same_bits(models[0], models[1]));
}

}  // namespace
}  // namespace gs
