// SPDX-License-Identifier: Apache-2.0
// SH that is updated lazily (optimizer.lazy) on the GPU: steps and row operations against the
// scalar twin and against steps that update all rows, and whole runs.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "gs_train/loop/lazy_choice.h"
#include "tests/cuda/every_form.h"
#include "tests/support/adaptive.h"
#include "tests/support/cuda.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

/// Views of which each sees some other part of the Gaussians.
std::vector<View> views_of_parts(int count = 3) { return shifted_views(count, 50, true); }

TrainingModel lazy_model(const Gaussians& start, MomentForm form = MomentForm::floats) {
  TrainingModel model = model_of(start, form);
  begin_lazy(model, 11);
  return model;
}

class CudaLazyAdam : public CudaTest {
 protected:
  /// Compares parameters, moments, and which updates rows have had.
  void expect_same(const TrainingModel& actual, const TrainingModel& expected, double tolerance) {
    const auto compare = [](const std::string& what, const Gaussians& x, const Gaussians& y,
                            double most) {
      for_each_array(
          [&](const char* name, const auto& of_x, const auto& of_y) {
            EXPECT_LT(norm_difference(downloaded(of_x), downloaded(of_y)), most) << what << name;
          },
          x, y);
    };
    const auto as_floats = [](const TrainingModel& model) {
      return are_codes(model.moment_form) ? decoded(model) : copy_to(host_memory(), model);
    };
    const TrainingModel a = as_floats(actual), b = as_floats(expected);
    compare("", a.gaussians, b.gaussians, tolerance);
    // Where the last bits of two gradients decide, tiny codes differ by an eighth or a quarter.
    const double of_moments = (actual.moment_form == MomentForm::tiny ? 5 : 1) * tolerance;
    compare("m of ", a.first_moment, b.first_moment, of_moments);
    compare("v of ", a.second_moment, b.second_moment, 2 * of_moments);
    EXPECT_EQ(actual.adam_steps, expected.adam_steps);
    EXPECT_EQ(actual.lazy.updates, expected.lazy.updates);
    ASSERT_EQ(actual.lazy.updated_at.size(), expected.lazy.updated_at.size());
    std::size_t different = 0;
    for (std::size_t i = 0; i < actual.lazy.updated_at.size(); ++i)
      different += actual.lazy.updated_at[i] != expected.lazy.updated_at[i];
    EXPECT_LE(double(different), 2e-3 * double(actual.count()));  // at the edge of being visible
  }
  /// Steps of both backends, by single photos or by all of them; then all rows catch up.
  void expect_same_steps(const Gaussians& start, MomentForm form, RenderSettings settings,
                         const DensityStep& density, bool is_batch, int rounds = 3) {
    SCOPED_TRACE(testing::Message()
                 << word_of(form) << ", batch " << is_batch << ", degree " << settings.sh_degree);
    const std::vector<View> views = views_of_parts();
    std::vector<TrainingPhoto> photos;
    for (const View& view : views) photos.push_back({&view, settings});
    TrainingModel expected = lazy_model(start, form);
    TrainingModel actual = on_gpu(expected);
    for (int round = 0; round < rounds; ++round)
      for (std::size_t i = 0; i < photos.size(); i += is_batch ? photos.size() : 1) {
        const Span<const TrainingPhoto> batch{&photos[i], is_batch ? photos.size() : 1};
        const Update update = update_of(int(batch.size));
        cpu().step(expected, batch, {0.2f}, update, density);
        gpu().step(actual, batch, {0.2f}, update, density);
      }
    gpu().synchronize(actual);
    expect_same(on_host(actual), expected, 2e-2);
    cpu().rows().catch_up(expected);
    gpu().rows().catch_up(actual);
    expect_same(on_host(actual), expected, 2e-2);
  }
};

TEST_F(CudaLazyAdam, StepsAreThoseOfTheScalarTwin) {
  for (const Gaussians& start : all_forms())
    for (const int degree : {0, 1, 2, 3})
      for (const MomentForm form : kMomentForms) {
        RenderSettings settings;
        settings.sh_degree = degree;
        expect_same_steps(start, form, settings, {true}, false);
      }
}

TEST_F(CudaLazyAdam, StepsWithRegularizersAndNoiseAreThoseOfTheScalarTwin) {
  for (const Gaussians& start : all_forms()) {
    RenderSettings settings;
    settings.absolute_gradient = true;
    DensityStep density{.gather_statistics = true, .regularizers = {1e-3f, 1e-3f}};
    density.noise = {5e4f, {3, RandomStream::position_noise}, 1};
    expect_same_steps(start, MomentForm::floats, settings, density, false);
  }
}

TEST_F(CudaLazyAdam, BatchesAreThoseOfTheScalarTwin) {
  const DensityStep density{.gather_statistics = true, .regularizers = {1e-3f, 1e-3f}};
  for (const Gaussians& start : all_forms())
    for (const int degree : {0, 1, 3})
      for (const MomentForm form : kMomentForms) {
        RenderSettings settings;
        settings.sh_degree = degree;
        expect_same_steps(start, form, settings, density, true, 2);
      }
}

// The last warp has each number of rows, of which some are late.
TEST_F(CudaLazyAdam, LastWarpsOfEachNumberOfRowsAreThoseOfTheScalarTwin) {
  for (std::size_t count = 4 * 32; count < 5 * 32; ++count)
    for (const Gaussians& start : all_forms(random_camera(131, 77, 1), count)) {
      SCOPED_TRACE(testing::Message() << count << (start.has_slope ? ", colors change" : ""));
      expect_same_steps(start, MomentForm::floats, {}, {true}, false);
    }
}

// Counts of rows that fill neither a warp nor a vector of four numbers.
TEST_F(CudaLazyAdam, StepsOfAnyNumberOfRowsAreThoseOfTheScalarTwin) {
  for (const std::size_t count : {1, 2, 31, 32, 33, 65}) {
    SCOPED_TRACE(count);
    for (const MomentForm form : kMomentForms)
      for (const bool is_batch : {false, true})
        expect_same_steps(all_forms(random_camera(131, 77, 1), count)[0], form, {}, {true},
                          is_batch);
  }
}

// Last bits of colors differ, and what follows from them.
TEST_F(CudaLazyAdam, StepsAreThoseOfAllRowsOnceTheyHaveCaughtUp) {
  const std::vector<View> views = views_of_parts();
  for (const bool is_batch : {false, true}) {
    RenderSettings settings;
    settings.deterministic = true;
    std::vector<TrainingPhoto> photos;
    for (const View& view : views) photos.push_back({&view, settings});
    TrainingModel lazy = on_gpu(lazy_model(all_forms()[0])),
                  prompt = on_gpu(model_of(all_forms()[0]));
    for (TrainingModel* const model : {&lazy, &prompt})
      for (std::size_t step = 0; step < 12; ++step)
        gpu().step(*model,
                   {&photos[is_batch ? 0 : step % photos.size()], is_batch ? photos.size() : 1},
                   {0.2f}, update_of(is_batch ? 3 : 1), {true});
    gpu().rows().catch_up(lazy);
    const TrainingModel a = on_host(lazy), b = on_host(prompt);
    for_each_array(
        [&](const char* name, const auto& x, const auto& y) {
          EXPECT_LT(norm_difference(downloaded(x), downloaded(y)), 1e-4) << name << is_batch;
        },
        a.gaussians, b.gaussians);
  }
}

// The rates are so low that the pictures stay the same.
TEST_F(CudaLazyAdam, AllRowsCatchUpWhenTheTableIsFull) {
  const std::vector<View> views = views_of_parts();
  Update update = update_of();
  for_each_array([](const char*, float& rate) { rate = 0; }, update.rates);
  update.rates.sh0 = update.rates.sh_rest = 1e-7f;
  RenderSettings settings;
  settings.deterministic = true;
  const Gaussians start = std::move(all_forms(random_camera(131, 77, 1), 500)[0]);
  TrainingModel lazy = on_gpu(lazy_model(start)), prompt = on_gpu(model_of(start));
  for (TrainingModel* const model : {&lazy, &prompt})
    for (std::size_t step = 0; step < kLazyWindow + 6; ++step) {
      const TrainingPhoto photo{&views[step < 6 ? step % 3 : 0], settings};
      gpu().step(*model, {&photo, 1}, {0.2f}, update, {true});
    }
  gpu().synchronize(lazy);
  EXPECT_EQ(lazy.lazy.updates, 6);
  for (const std::uint32_t at : lazy.lazy.updated_at.download()) EXPECT_LE(at, 6u);
  gpu().rows().catch_up(lazy);
  const auto way = [&](const TrainingModel& model) {
    std::vector<float> numbers = downloaded(model.gaussians.sh0);
    const std::vector<float> before = downloaded(start.sh0);
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] -= before[i];
    return numbers;
  };
  EXPECT_LT(norm_difference(way(lazy), way(prompt)), 2e-2);  // 1e-7 is a last bit of sh0
  EXPECT_LT(
      norm_difference(downloaded(lazy.second_moment.sh0), downloaded(prompt.second_moment.sh0)),
      1e-3);
}

// Some of these steps find buffers that are too small, and are repeated.
TEST_F(CudaLazyAdam, StepsThatAreRepeatedLoseNothing) {
  std::vector<View> views = views_of_parts();
  const Recipe large{
      .sigma_low = 30, .sigma_high = 60, .opacity_low = 0.02f, .opacity_high = 0.05f};
  const Gaussians start = random_gaussians(large, 20000, random_camera(131, 77, 1), 3);
  for (const bool is_batch : {false, true}) {
    RenderSettings settings;
    settings.deterministic = true;
    std::vector<TrainingPhoto> photos;
    for (const View& view : views) photos.push_back({&view, settings});
    const auto after_steps = [&](bool meets_views_anew) {
      TrainingModel model = on_gpu(lazy_model(start));
      if (meets_views_anew) gpu().upload_views(views, 1 << 30);
      for (std::size_t step = 0; step < 12; ++step)
        gpu().step(model,
                   {&photos[is_batch ? 0 : step % photos.size()], is_batch ? photos.size() : 1},
                   {0.2f}, update_of(is_batch ? 3 : 1), {true});
      gpu().synchronize(model);
      return on_host(model);
    };
    const TrainingModel first = after_steps(true);
    EXPECT_TRUE(same_bits(after_steps(false), first)) << is_batch;
    EXPECT_TRUE(same_bits(after_steps(true), first)) << is_batch;
  }
}

TEST_F(CudaLazyAdam, LooksChangeNothing) {
  const std::vector<View> views = views_of_parts();
  for (const MomentForm form : kMomentForms) {
    TrainingModel model = on_gpu(lazy_model(all_forms()[3], form));
    for (const View& view : views) {
      const TrainingPhoto photo{&view, {}};
      gpu().step(model, {&photo, 1}, {0.2f}, update_of(), {true});
    }
    gpu().synchronize(model);
    const TrainingModel before = on_host(model);
    Gaussians shown;
    {
      const CurrentSh current(model, gpu().rows());
      shown = host_copy(model.gaussians, kMaxShDegree, false).gaussians;
    }
    EXPECT_TRUE(same_bits(on_host(model), before));
    EXPECT_FALSE(same_bits(shown.sh0, before.gaussians.sh0));
    gpu().rows().catch_up(model);
    EXPECT_TRUE(same_bits(shown, on_host(model).gaussians));
  }
}

TEST_F(CudaLazyAdam, RowsCatchUpBeforeTheyMove) {
  const std::vector<View> views = views_of_parts();
  const auto expect_caught_up = [&](const char* what, auto&& operation) {
    TrainingModel model = on_gpu(lazy_model(all_forms()[0]));
    for (const View& view : views) {
      const TrainingPhoto photo{&view, {}};
      gpu().step(model, {&photo, 1}, {0.2f}, update_of(), {true});
    }
    operation(gpu().rows(), model);
    EXPECT_EQ(model.lazy.updates, 0) << what;
    EXPECT_EQ(model.lazy.updated_at.size(), model.count()) << what;
    for (const std::uint32_t at : model.lazy.updated_at.download()) EXPECT_EQ(at, 0u) << what;
  };
  using Rows = RowOps&;
  using Model = TrainingModel&;
  expect_caught_up("morton", [](Rows rows, Model model) { rows.sort_by_morton(model); });
  expect_caught_up("prune", [](Rows rows, Model model) { rows.prune(model, 0.1f); });
  expect_caught_up(
      "share", [](Rows rows, Model model) { rows.prune_share(model, PruneOrder::opacity, 0.1); });
  expect_caught_up("opacity", [](Rows rows, Model model) {
    rows.lower_opacity(model, {OpacityPolicy::reset, 0.01f, MomentClearing::all});
  });
  expect_caught_up("relocate", [](Rows rows, Model model) {
    rows.relocate(model, {0.05f, std::int64_t(model.count()) + 100}, 1, 600);
  });
  expect_caught_up("refine", [](Rows rows, Model model) {
    constexpr AdaptiveRules kRules{.gradient_threshold = 1e-5f,
                                   .small_scale = 0.1f,
                                   .prune_opacity = 0.05f,
                                   .prune_scale = 1,
                                   .max_gaussians = 0};
    rows.refine(model, kRules, {1, RandomStream::split_gaussians}, 600);
  });
}

// ---- runs --------------------------------------------------------------------------------------

class CudaLazyRun : public CudaTest {
 protected:
  TrainingModel trained(const Config& config) { return model_of_run(scene_, config, gpu()); }
  double psnr_after(const Config& config) {
    Trainer trainer(scene_, config, gpu());
    trainer.run();
    return evaluate(gpu().renderer(), trainer.model().gaussians.span(), scene_.train_views,
                    trainer.evaluation_settings())
        .psnr;
  }
  const Scene scene_ = scene_of_two_halves();
};

TEST_F(CudaLazyRun, RepeatsItselfAndGoesOnWhereItWasStoppedInDeterministicSteps) {
  for (const LazyMode mode : {LazyMode::on, LazyMode::automatic})
    for (const int batch : {1, 3})
      for (const MomentForm moments : kMomentForms) {
        SCOPED_TRACE(testing::Message() << int(mode) << " " << batch << " " << int(moments));
        Config config = busy_run();
        config.optimizer.lazy = mode;
        config.optimizer.moments = moments;
        config.train.deterministic = true;
        config.train.batch = batch;
        const TrainingModel whole = trained(config);
        EXPECT_FALSE(whole.lazy.is_on);
        EXPECT_TRUE(same_bits(trained(config), whole));
        EXPECT_TRUE(same_bits(resumed_after(43, scene_, config, gpu()), whole));
      }
}

TEST_F(CudaLazyRun, EndsAsGoodAsWithoutIt) {
  for (Config config : {short_run(), short_mcmc_run()}) {
    const double prompt = psnr_after(config);
    config.optimizer.lazy = LazyMode::on;
    EXPECT_NEAR(psnr_after(config), prompt, 0.5) << config.density.strategy;
  }
}

}  // namespace
}  // namespace gs
