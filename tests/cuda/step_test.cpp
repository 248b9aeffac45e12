// SPDX-License-Identifier: Apache-2.0
// The fused training step: compared with the contracts called one after the other, with buffers too
// small for the instances, and in the steady state, in which it may not call the driver.
#include <cuda_runtime_api.h>

#include "data_loaders/photos/photo_pool.h"
#include "gs_train/poses/poses.h"
#include "tests/cuda/fused_step.h"
#include "tests/support/gains.h"
#include "tests/support/lens_scenes.h"
#include "tests/support/own_loss.h"

// The linker redirects these calls to this file (-Wl,--wrap), which counts them.
namespace {
int waits = 0, allocations = 0;
}
extern "C" {
#define GS_COUNT(name, counter, parameters, arguments) \
  cudaError_t __real_##name parameters;                \
  cudaError_t __wrap_##name parameters {               \
    ++counter;                                         \
    return __real_##name arguments;                    \
  }
GS_COUNT(cudaMalloc, allocations, (void** to, size_t bytes), (to, bytes))
GS_COUNT(cudaFree, allocations, (void* pointer), (pointer))
GS_COUNT(cudaHostAlloc, allocations, (void** to, size_t bytes, unsigned flags), (to, bytes, flags))
GS_COUNT(cudaMallocHost, allocations, (void** to, size_t bytes), (to, bytes))
GS_COUNT(cudaFreeHost, allocations, (void* pointer), (pointer))
GS_COUNT(cudaMallocAsync, allocations, (void** to, size_t bytes, cudaStream_t stream),
         (to, bytes, stream))
GS_COUNT(cudaStreamSynchronize, waits, (cudaStream_t stream), (stream))
GS_COUNT(cudaDeviceSynchronize, waits, (), ())
GS_COUNT(cudaEventSynchronize, waits, (cudaEvent_t event), (event))
GS_COUNT(cudaMemcpy, waits, (void* to, const void* from, size_t bytes, cudaMemcpyKind kind),
         (to, from, bytes, kind))
}

namespace gs {
namespace {

// Of a hundred tiles each.
constexpr Recipe kLarge{
    .sigma_low = 30, .sigma_high = 60, .opacity_low = 0.02f, .opacity_high = 0.05f};

class CudaStep : public FusedStepTest {
 protected:
  /// Once `warm_up` has grown the buffers, `steady` may neither wait nor allocate.
  template <class WarmUp, class Steady>
  void expect_steady(TrainingModel& model, WarmUp&& warm_up, Steady&& steady) {
    warm_up();
    gpu().synchronize(model);
    ASSERT_GT(waits, 0) << "the calls are not counted";
    ASSERT_GT(allocations, 0) << "the calls are not counted";
    waits = allocations = 0;
    steady();
    EXPECT_EQ(waits, 0);
    EXPECT_EQ(allocations, 0);
    gpu().synchronize(model);
  }

  /// Trains `count` Gaussians again and again, in `steps` deterministic steps.
  void expect_the_same_bytes_each_time(const std::vector<View>& views, std::size_t count,
                                       int steps) {
    RenderSettings settings;
    for (const Recipe& recipe : {kTypical, kLarge}) {  // large ones fill several segments of a list
      const TrainingModel start = model_of(random_gaussians(recipe, count, views[0].camera, 3));
      const auto after_steps = [&](bool deterministic, bool meets_views_anew) {
        TrainingModel model = on_gpu(start);
        settings.deterministic = deterministic;
        if (meets_views_anew) gpu().device().upload_views(views, 1 << 30);
        for (int step = 0; step < steps; ++step)
          gpu().step(model, views[step % 3], settings, {0.2f}, kRates, {true});
        gpu().synchronize(model);
        return on_host(model);
      };
      const TrainingModel first = after_steps(true, true);
      for (const bool meets_views_anew : {true, false, true}) {
        const TrainingModel again = after_steps(true, meets_views_anew);
        const auto expect_identical = [](const char* name, const auto& a, const auto& b) {
          ASSERT_EQ(a.size(), b.size());
          EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])), 0) << name;
        };
        for_each_array(expect_identical, first.gaussians, again.gaussians);
        for_each_array(expect_identical, float_moments(first), float_moments(again));
        expect_identical("gradient norms", first.statistics.gradient_norm,
                         again.statistics.gradient_norm);
        expect_identical("visits", first.statistics.visits, again.statistics.visits);
      }
      expect_same(first, after_steps(false, true), 2e-2);
    }
  }
};

TEST_F(CudaStep, FusedStepInSpaceAndTimeIsTheScalarOne) {
  std::vector<View> views = some_views(131, 77, 3);
  for (std::size_t i = 0; i < views.size(); ++i) views[i].camera.time = 0.4f + 0.1f * float(i);
  LearningRates rates = kRates;
  rates.right_rotation = 1e-3f;
  rates.time_mean = 8e-4f;
  rates.log_time_scale = 5e-3f;
  for (const int degree : {0, 1, 2, 3}) {
    SCOPED_TRACE(degree);
    RenderSettings settings;
    settings.sh_degree = degree;
    settings.background = {0.3f, 0.6f, 0.9f};
    TrainingModel expected = model_of(
        in_spacetime(random_gaussians(kTypical, 3000, views[0].camera, std::uint64_t(degree)), 8));
    TrainingModel actual = on_gpu(expected);
    step_both(expected, actual, views, settings, rates, {true});
    expect_same(on_host(actual), expected, 2e-2);
  }
}

// Of one pinhole and two lenses, one of which moves, in turns.
TEST_F(CudaStep, FusedStepThroughALensIsTheScalarOne) {
  std::vector<View> views = some_views(131, 77, 3);
  views[1].camera = with_lens(views[1].camera, CameraModel::opencv,
                              {0.9, 0.9, 0.5, 0.5, -0.25, 0.05, 2e-3, -3e-3});
  views[2].camera = with_lens(views[2].camera, CameraModel::simple_fisheye, {0.6, 0.5, 0.4},
                              {{0.08f, -0.1f, 0.12f}, {0.15f, -0.1f, 0.2f}});
  for (const int degree : {0, 1, 2, 3}) {
    SCOPED_TRACE(degree);
    RenderSettings settings;
    settings.sh_degree = degree;
    TrainingModel expected =
        model_of(random_gaussians(kTypical, 3000, views[0].camera, std::uint64_t(degree)));
    TrainingModel actual = on_gpu(expected);
    step_both(expected, actual, views, settings, kRates, {true});
    expect_same(on_host(actual), expected, 2e-2);
  }
}

TEST_F(CudaStep, FusedStepIsTheScalarOne) {
  const std::vector<View> views = some_views(131, 77, 3);
  for (const int degree : {0, 1, 2, 3})
    for (const bool classic : {false, true}) {
      SCOPED_TRACE(degree);
      RenderSettings settings;
      settings.sh_degree = degree;
      settings.background = {0.3f, 0.6f, 0.9f};
      if (classic) {
        settings.blend_rule = BlendRule::classic;
        settings.antialias = true;
        settings.antialias_detach = false;
      }
      TrainingModel expected =
          model_of(random_gaussians(kTypical, 3000, views[0].camera, std::uint64_t(degree)));
      TrainingModel actual = on_gpu(expected);
      step_both(expected, actual, views, settings, kRates, {true});
      // Adam's first steps turn the sign of a tiny gradient into a whole step
      expect_same(on_host(actual), expected, 1e-2);
      EXPECT_NEAR(gpu().loss().value(), cpu().loss().value(), 2e-3 * cpu().loss().value());
    }
}

TEST_F(CudaStep, FusedStepWithA3dFilterIsTheScalarOne) {
  const std::vector<View> views = some_views(131, 77, 3);
  for (const int degree : {0, 1, 2, 3})
    for (const bool regularizes : {false, true}) {
      SCOPED_TRACE(degree);
      RenderSettings settings;
      settings.sh_degree = degree;
      settings.antialias = true;
      settings.antialias_detach = false;
      DensityStep density{.gather_statistics = true};
      if (regularizes) density.regularizers = {1e-3f, 1e-3f};
      TrainingModel expected = model_of(with_filters(
          random_gaussians(kTypical, 3000, views[0].camera, std::uint64_t(degree)), 9));
      TrainingModel actual = on_gpu(expected);
      step_both(expected, actual, views, settings, kRates, density);
      expect_same(on_host(actual), expected, 1e-2);
      EXPECT_TRUE(same_bits(on_host(actual).gaussians.filter_scale,
                            expected.gaussians.filter_scale));  // no step changes it
    }
}

TEST_F(CudaStep, ByALossOfTheProgramIsTheScalarOne) {
  const std::vector<View> views = some_views(131, 77, 3);
  for (const bool sees_depth : {false, true}) {
    TrainingModel expected = model_of(random_gaussians(kTypical, 3000, views[0].camera, 3));
    TrainingModel actual = on_gpu(expected);
    bool throws = true;
    for (Backend* const backend : {&cpu(), &gpu()})
      backend->use({.own_loss = {[&, l1 = l1_loss_in(backend->memory())](const auto& compared) {
                                   if (throws) throw std::runtime_error("no loss");
                                   return l1(compared);
                                 },
                                 sees_depth}});
    for (Backend* const backend : {&cpu(), &gpu()}) {  // which leaves everything as it is
      TrainingModel& model = backend == &gpu() ? actual : expected;
      EXPECT_THROW(backend->step(model, views[0], {}, {0.2f}, kRates, {true}), std::runtime_error);
    }
    throws = false;
    step_both(expected, actual, views, {}, kRates, {true});
    expect_same(on_host(actual), expected, 1e-2);
    EXPECT_NEAR(gpu().loss().value(), cpu().loss().value(), 2e-3 * cpu().loss().value());
  }
}

// The views are known with few instances when a model of many comes. What the loss throws at a
// picture that lacks Gaussians does not count.
TEST_F(CudaStep, ALossOfTheProgramSeesAStepAgainThatHadTooLittleRoom) {
  const std::vector<View> views = some_views(320, 240, 3);
  const TrainingModel few = model_of(random_gaussians(kTypical, 20000, views[0].camera, 3));
  const TrainingModel many = model_of(random_gaussians(kLarge, 20000, views[0].camera, 3));
  RenderSettings settings;
  settings.deterministic = true;
  gpu().device().upload_views(views, 1 << 30);
  int calls = 0, failing_call = 0;
  gpu().use({.own_loss = {[&, l1 = l1_loss_in(gpu().memory())](const auto& compared) {
               if (++calls == failing_call) throw std::runtime_error("it lacks Gaussians");
               return l1(compared);
             }}});
  const auto after_steps = [&](const TrainingModel& start) {
    TrainingModel model = on_gpu(start);
    calls = 0;
    for (int step = 0; step < 6; ++step)
      gpu().step(model, views[std::size_t(step % 3)], settings, {0.2f}, kRates, {true});
    gpu().synchronize(model);
    return on_host(model);
  };
  after_steps(few);
  EXPECT_EQ(calls, 6);
  failing_call = 1;
  const TrainingModel crowded = after_steps(many);
  EXPECT_EQ(calls, 9);  // each view was known with too few
  failing_call = 0;
  const TrainingModel roomy = after_steps(many);
  EXPECT_EQ(calls, 6);
  EXPECT_TRUE(same_bits(crowded, roomy));
}

// Twenty thousand large Gaussians exceed the first estimate.
TEST_F(CudaStep, TooLittleRoomLosesNothing) {
  const std::vector<View> views = some_views(320, 240, 3);
  const TrainingModel start = model_of(random_gaussians(kLarge, 20000, views[0].camera, 3));
  TrainingModel crowded = on_gpu(start), roomy = on_gpu(start);
  // The forecast knows these views when the second model comes.
  for (TrainingModel* const model : {&crowded, &roomy}) {
    for (int step = 0; step < 12; ++step)
      gpu().step(*model, views[step % 3], {}, {0.2f}, kRates, {true});
    gpu().synchronize(*model);
  }
  EXPECT_EQ(crowded.adam_steps, 12);
  expect_same(on_host(crowded), on_host(roomy), 2e-2);
}

TEST_F(CudaStep, SteadyBatchesNeitherWaitNorAllocate) {
  const std::vector<View> views = some_views(200, 150, 5);
  TrainingModel model = on_gpu(model_of(random_gaussians(kTypical, 20000, views[0].camera, 7)));
  gpu().device().upload_views(views, 1 << 30);
  const std::vector<TrainingPhoto> batch = batch_of(views, {});
  const auto run = [&](int steps) {
    for (int step = 0; step < steps; ++step)
      gpu().step(model, {{batch.data(), batch.size()}, {0.2f}, {kRates}, {true}});
  };
  expect_steady(
      model, [&] { run(20); }, [&] { run(60); });
}

TEST_F(CudaStep, SteadyStepsOnReducedPhotosNeitherWaitNorAllocate) {
  const std::vector<View> views = some_views(400, 300, 5);
  TrainingModel model = on_gpu(model_of(random_gaussians(kTypical, 20000, views[0].camera, 7)));
  gpu().device().upload_views(views, 1 << 30);
  const auto run = [&](int steps, int reduction) {
    for (int step = 0; step < steps; ++step) {
      const TrainingPhoto photo{&views[std::size_t(step % 5)], {}, reduction};
      gpu().step(model, {{&photo, 1}, {0.2f}, {kRates}, {true}});
    }
  };
  expect_steady(
      model, [&] { run(50, 2); },
      [&] {
        run(100, 2);
        run(100, 4);  // smaller photos need no more memory
      });
  gpu().device().upload_views({}, 0);
}

// ---- Adam's rule -------------------------------------------------------------------------------

TEST_F(CudaStep, AStepByTheRuleOfABatchIsTheScalarOne) {
  const std::vector<View> views = some_views(131, 77, 3);
  const Update update{kRates, batch_rule(4)};
  TrainingModel expected = model_of(random_gaussians(kTypical, 3000, views[0].camera, 4));
  TrainingModel actual = on_gpu(expected), usual = on_gpu(expected);
  for (int step = 0; step < 6; ++step) {
    const TrainingPhoto photo{&views[std::size_t(step % 3)], {}};
    cpu().step(expected, {{&photo, 1}, {0.2f}, update, {true}});
    gpu().step(actual, {{&photo, 1}, {0.2f}, update, {true}});
    gpu().step(usual, {{&photo, 1}, {0.2f}, {kRates}, {true}});
  }
  gpu().synchronize(actual);
  expect_same(on_host(actual), expected, 2e-2);
  gpu().synchronize(usual);
  EXPECT_GT(
      norm_difference(downloaded(opened(usual).second.sh0), downloaded(opened(actual).second.sh0)),
      0.5);
}

// ---- hostile models ----------------------------------------------------------------------------

TEST_F(CudaStep, MoreThan2To32InstancesAreRefused) {
  std::vector<View> views = some_views(16, 16, 1);
  views[0].camera = camera_of_65536_tiles();
  views[0].photo = random_photo(4096, 4096, 1);
  TrainingModel model = on_gpu(model_of(gaussians_over_every_tile(65537)));
  const auto train = [&] {
    gpu().step(model, views[0], {}, {0.2f}, kRates, {true});
    gpu().synchronize(model);
  };
  EXPECT_THROW(train(), Error);
}

// Compute-sanitizer finds an illegal access here (scripts/gpu_check.sh).
TEST_F(CudaStep, ModelsOfAnyNumbersAreTrained) {
  const std::vector<View> views = some_views(131, 77, 3);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (const float value : {nan, infinity, -infinity, 1e30f, -1e30f, 1e-38f}) {
    SCOPED_TRACE(value);
    Gaussians odd = random_gaussians(kTypical, 600, views[0].camera, 1);
    for (std::size_t i = 0; i < odd.count(); i += 2) {
      switch (i / 2 % 6) {
        case 0: odd.mean[i].x = value; break;
        case 1: odd.mean[i].z = value; break;
        case 2: odd.log_scale[i].y = value; break;
        case 3: odd.rotation[i].w = value; break;
        case 4: odd.logit_opacity[i] = value; break;
        default: odd.sh0[i].y = value;
      }
    }
    TrainingModel model = on_gpu(model_of(odd));
    for (int step = 0; step < 6; ++step)
      gpu().step(model, views[step % 3], {}, {0.2f}, kRates, {true});
    gpu().synchronize(model);
    EXPECT_EQ(model.adam_steps, 6);
  }
}

// All of a view's Gaussians lie on one tile.
TEST_F(CudaStep, AMillionGaussiansOnOneTileAreTrained) {
  std::vector<View> views = some_views(160, 120, 1);
  views[0].camera = plain_camera(160, 120);
  Gaussians pile(1'000'000, host_memory());
  for (std::size_t i = 0; i < pile.count(); ++i)
    set_gaussian(pile, i, behind_pixel(views[0].camera, 24, 24, 2), 0.01f, 0.01f);
  TrainingModel model = on_gpu(model_of(pile));
  for (int step = 0; step < 3; ++step) gpu().step(model, views[0], {}, {0.2f}, kRates, {true});
  gpu().synchronize(model);
  EXPECT_EQ(model.adam_steps, 3);
  for (const float number : downloaded(model.gaussians.mean)) EXPECT_TRUE(std::isfinite(number));
}

// Some of these steps find buffers that are too small, and are repeated.
TEST_F(CudaStep, DeterministicStepsGiveTheSameBytesEachTime) {
  expect_the_same_bytes_each_time(some_views(320, 240, 3), 20'000, 30);
}

// So few that racecheck comes to their end (scripts/gpu_check.sh).
TEST_F(CudaStep, FewDeterministicStepsGiveTheSameBytesEachTime) {
  expect_the_same_bytes_each_time(some_views(80, 64, 3), 700, 6);
}

// A view that was seen before has room for few instances, so that its visible rows are selected
// before the depth sort. The step is that of the whole sort to the last bit.
TEST_F(CudaStep, SelectingTheVisibleRowsChangesNothing) {
  const std::vector<View> views = some_views(131, 77, 1);
  Gaussians rows = random_gaussians(kTypical, 100'000, views[0].camera, 1);
  for (std::size_t i = 0; i < rows.count(); ++i)
    if (i % 97) rows.mean[i] = behind_pixel(views[0].camera, 60, 40, -5);  // behind the camera
  const TrainingModel start = model_of(rows);
  RenderSettings settings;
  settings.deterministic = true;
  const auto after_step = [&] {
    TrainingModel model = on_gpu(start);
    gpu().step(model, views[0], settings, {0.2f}, kRates, {true});
    gpu().synchronize(model);
    return on_host(model);
  };
  gpu().device().upload_views(views, 1 << 30);
  const TrainingModel sorted_whole = after_step(), selected = after_step();
  EXPECT_TRUE(same_bits(selected, sorted_whole));
  TrainingModel expected = copy_to(host_memory(), start);
  cpu().step(expected, views[0], settings, {0.2f}, kRates, {true});
  expect_same(selected, expected, 1e-2);
}

TEST_F(CudaStep, SteadyStepsNeitherWaitNorAllocate) {
  const std::vector<View> views = some_views(200, 150, 5);
  for (const MomentStorage form : kMomentStorages) {
    TrainingModel model =
        on_gpu(model_of(random_gaussians(kTypical, 20000, views[0].camera, 7), form));
    RenderSettings settings;
    gpu().device().upload_views(views, 1 << 30);
    const auto run = [&](int steps) {
      for (int step = 0; step < steps; ++step) {
        gpu().device().prefetch_next(views[(step + 1) % views.size()]);
        gpu().step(model, views[step % views.size()], settings, {0.2f}, kRates, {true});
      }
    };
    expect_steady(
        model, [&] { run(50); }, [&] { run(100); });
  }
}

// The numbers of photos are learned on the device alone: one photo at a time, and in batches.
TEST_F(CudaStep, SteadyStepsWithAPhotometricModelNeitherWaitNorAllocate) {
  std::vector<View> views = some_views(200, 150, 5);
  const PhotometricConfig config{"gains"};
  gpu().use({.photometric = make_photometric_model(config)});
  TrainingModel start = model_of(random_gaussians(kTypical, 20000, views[0].camera, 7));
  begin_with_gains(config, views, start);
  TrainingModel model = on_gpu(start);
  gpu().device().upload_views(views, 1 << 30);
  Update update{kRates};
  update.photometric_rate = 2e-3f;
  std::vector<TrainingPhoto> batch = batch_of(views, {});
  for (std::size_t i = 0; i < batch.size(); ++i) batch[i].photo_row = i;
  const auto run = [&](int steps) {
    for (int step = 0; step < steps; ++step) {
      gpu().device().prefetch_next(views[(std::size_t(step) + 1) % views.size()]);
      gpu().step(model, {{&batch[std::size_t(step) % batch.size()], 1}, {0.2f}, update, {true}});
    }
    for (int step = 0; step < steps / 5; ++step)
      gpu().step(model, {{batch.data(), batch.size()}, {0.2f}, update, {true}});
  };
  expect_steady(
      model, [&] { run(50); }, [&] { run(100); });
  gpu().use({});
}

// The device makes the cameras of later steps from the poses that earlier ones have learned.
TEST_F(CudaStep, SteadyStepsThatRefinePosesNeitherWaitNorAllocate) {
  Scene scene;
  scene.train_views = some_views(200, 150, 5);
  Config config = adaptive_config();
  config.poses.refine = true;
  TrainingModel start = model_of(random_gaussians(kTypical, 20000, scene.train_views[0].camera, 7));
  begin_poses(config, scene, start);
  TrainingModel model = on_gpu(start);
  gpu().device().upload_views(scene.train_views, 1 << 30);
  Update update{kRates};
  update.pose_rate = 1e-4f;
  std::vector<TrainingPhoto> batch = batch_of(scene.train_views, {});
  for (std::size_t i = 0; i < batch.size(); ++i) batch[i].photo_row = i;
  const auto run = [&](int steps) {
    for (int step = 0; step < steps; ++step) {
      gpu().device().prefetch_next(*batch[(std::size_t(step) + 1) % batch.size()].view);
      gpu().step(model, {{&batch[std::size_t(step) % batch.size()], 1}, {0.2f}, update, {true}});
    }
    for (int step = 0; step < steps / 5; ++step)
      gpu().step(model, {{batch.data(), batch.size()}, {0.2f}, update, {true}});
  };
  expect_steady(
      model, [&] { run(50); }, [&] { run(100); });
  EXPECT_GT(model.poses.adam_steps, 0);
  gpu().device().upload_views({}, 0);  // these views end here
}

// The same with photos that do not fit into the budget and are copied one step ahead.
TEST_F(CudaStep, StreamedPhotosGiveTheSameSteps) {
  const std::vector<View> views = some_views(200, 150, 5);
  const TrainingModel start = model_of(random_gaussians(kTypical, 5000, views[0].camera, 7));
  TrainingModel streamed = on_gpu(start), resident = on_gpu(start);
  RenderSettings settings;
  for (TrainingModel* model : {&streamed, &resident}) {
    gpu().device().upload_views(views, model == &streamed ? 0 : 1 << 30);
    for (int step = 0; step < 40; ++step) {
      gpu().device().prefetch_next(views[(step + 1) % views.size()]);
      gpu().step(*model, views[step % views.size()], settings, {0.2f}, kRates, {});
    }
    gpu().synchronize(*model);
  }
  EXPECT_LT(norm_difference(downloaded(streamed.gaussians.sh0), downloaded(resident.gaussians.sh0)),
            1e-3);
}

// The photos do not fit into host memory either. Some of them go to the GPU beforehand; the others
// are decoded a few steps ahead, two at a time.
TEST_F(CudaStep, PhotosOfAPoolGiveTheSameSteps) {
  const std::vector<View> here = some_views(200, 150, 7);
  const std::size_t bytes = photo_bytes(here[0]);
  const auto pool = std::make_shared<PhotoPool>(
      std::vector<PhotoCost>(here.size(), {bytes, bytes}), [&](std::size_t i) { return here[i]; },
      2 * bytes, 2);
  std::vector<View> elsewhere = here;
  for (std::size_t i = 0; i < here.size(); ++i) {
    elsewhere[i].photo = {};
    elsewhere[i].source = pool;
    elsewhere[i].index = i;
  }
  const TrainingModel start = model_of(random_gaussians(kTypical, 5000, here[0].camera, 7));
  const auto run = [&](const std::vector<View>& views, std::size_t budget) {
    TrainingModel model = on_gpu(start);
    gpu().device().upload_views(views, budget);
    for (int step = 0; step < 40; ++step) {
      gpu().device().prefetch_decode(views[(step + 3) % views.size()]);
      gpu().device().prefetch_next(views[(step + 1) % views.size()]);
      gpu().step(model, views[step % views.size()], {}, {0.2f}, kRates, {});
    }
    gpu().synchronize(model);
    return downloaded(model.gaussians.sh0);
  };
  const auto expected = run(here, 1 << 30);
  EXPECT_LT(norm_difference(run(elsewhere, 0), expected), 1e-3);
  EXPECT_LT(norm_difference(run(elsewhere, 3 * (bytes + 16)), expected), 1e-3);
  const std::size_t decoded = pool->counts().decoded;
  EXPECT_LT(norm_difference(run(elsewhere, 1 << 30), expected), 1e-3);
  EXPECT_LE(pool->counts().decoded, decoded + here.size());  // only for the upload
  EXPECT_LE(pool->counts().peak_bytes, 2 * bytes);
  gpu().device().upload_views({}, 0);  // these views end here
}

// The host looks at the device's report in its own memory.
TEST_F(CudaStep, FramesForViewingNeitherSynchronizeNorAllocate) {
  const Camera camera = random_camera(320, 240, 3);
  TrainingModel model = on_gpu(model_of(random_gaussians(kTypical, 5000, camera, 4)));
  RenderSettings settings;
  settings.for_backward = false;
  Renderer& renderer = gpu().renderer();
  const auto packed = renderer.pack(model.gaussians.span(), settings);
  RenderPass pass(gpu().memory()), unpacked(gpu().memory());
  const auto draw = [&](int frames) {
    for (int frame = 0; frame < frames; ++frame) {
      renderer.draw(*packed, camera, settings, pass);
      renderer.forward(model.gaussians.span(), camera, settings, unpacked);
    }
  };
  expect_steady(
      model, [&] { draw(3); }, [&] { draw(10); });
}

}  // namespace
}  // namespace gs
