// SPDX-License-Identifier: Apache-2.0
// The recipe "a method of density control" of docs/develop/extending.md.
#include <gtest/gtest.h>

#include "gs_train/density/density_control.h"
#include "tests/support/models.h"

// [recipe]
// The method "thinning": growth as by default, but nothing stays that is fainter than a tenth.
#include "gs_core/density/growth_method.h"

namespace gs {
namespace {

constexpr float kLeastOpacity = 0.1f;

}  // namespace

GrowthMethod thinning_method() {
  GrowthMethod method = default_method();
  method.late_prune_opacity = kLeastOpacity;
  return method;
}

}  // namespace gs
// [end]

namespace gs {
namespace {

TEST(RecipeDensityStrategy, RemovesFaintGaussiansAfterTheLastRefinement) {
  Gaussians gaussians(10, host_memory());
  for (std::size_t i = 0; i < 10; ++i)
    set_gaussian(gaussians, i, {float(i), 0, 0}, 0.1f, i < 4 ? 0.09f : 0.5f);
  TrainingModel model = model_of(gaussians);
  Config config;
  config.train.iterations = 30000;
  config.density.max_gaussians = 100;
  config.density.until_step = 14000;
  const GrowthMethod method = thinning_method();
  const NamedMethod row = {"thinning", method};  // as the table of methods has it
  const auto control = make_growth_control(config, row.method, Schedule(config, method, 2), 2);
  const auto backend = make_scalar_backend();
  EXPECT_EQ(control->after_step(model, *backend, 23999).pruned, 0u);
  EXPECT_EQ(control->after_step(model, *backend, 24000).pruned, 4u);
  EXPECT_EQ(model.count(), 6u);
}

}  // namespace
}  // namespace gs
