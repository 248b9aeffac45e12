// SPDX-License-Identifier: Apache-2.0
// Steps on the GPU that refine poses, against the scalar backend.
#include "gs_train/poses/poses.h"

#include "tests/cuda/same_steps.h"
#include "tests/support/poses.h"

namespace gs {
namespace {

constexpr float kRate = 1e-3f;  // of the poses

/// Three views, of which two are those of a rig at one moment.
Scene three_views(int width, int height) {
  Scene scene;
  for (std::size_t i = 0; i < 3; ++i) {
    View view;
    view.name = "view " + std::to_string(i);
    view.camera = random_camera(width, height, 1);
    view.camera.cx += float(3 * i);
    view.camera.cam_from_world_translation.x += 0.05f * float(i);
    view.camera.time = 0.4f;
    view.rig_frame = i == 0 ? 0 : 7;
    view.photo = random_photo(width, height, i);
    scene.train_views.push_back(std::move(view));
  }
  scene.extent = 0.5f;
  return scene;
}

class CudaPoses : public CudaTest {
 protected:
  /// A model on the host whose poses are disturbed.
  TrainingModel started(const Gaussians& gaussians) const {
    TrainingModel model = model_of(gaussians);
    Config config = adaptive_config();
    config.poses.refine = true;
    begin_poses(config, scene_, model);
    disturb(model.poses, 0.005, 0.01);
    return model;
  }
  Gaussians plain(std::size_t count = 3000) const {
    return random_gaussians(kTypical, count, scene_.train_views[0].camera, 5);
  }
  /// Steps by these photos, in one batch.
  void step(Backend& backend, TrainingModel& model, const std::vector<std::size_t>& rows,
            const RenderSettings& settings, float rate = kRate) const {
    std::vector<TrainingPhoto> batch;
    for (const std::size_t row : rows)
      batch.push_back({&scene_.train_views[row], settings, rows.size() > 1 ? 2 : 1, row});
    Update update{kRates, batch_rule(int(rows.size()))};
    update.pose_rate = rate;
    update.photo_rule = batch_rule(int(rows.size()));
    backend.step(model, {{batch.data(), batch.size()}, {0.2f}, update, {true}});
  }
  /// The moments say what gradients there were, and the values what Adam made of them.
  void expect_same_poses(const PoseState& actual, const PoseState& expected, double tolerance) {
    EXPECT_LT(norm_difference(first_moments(actual), first_moments(expected)), tolerance);
    EXPECT_LT(norm_difference(second_moments(actual), second_moments(expected)), 2 * tolerance);
    EXPECT_LT(norm_difference(downloaded(actual.values), downloaded(expected.values)), tolerance);
    EXPECT_EQ(actual.adam_steps, expected.adam_steps);
  }
  void expect_scalar_step(const Gaussians& gaussians, const RenderSettings& settings) {
    for (const std::vector<std::size_t>& rows :
         {std::vector<std::size_t>{0}, std::vector<std::size_t>{1},
          std::vector<std::size_t>{0, 1, 2, 0}}) {
      TrainingModel expected = started(gaussians), actual = on_gpu(expected);
      step(cpu(), expected, rows, settings);
      step(gpu(), actual, rows, settings);
      gpu().synchronize(actual);
      expect_same_poses(on_host(actual).poses, expected.poses, 1e-2);
    }
  }

  const Scene scene_ = three_views(131, 77);
};

TEST_F(CudaPoses, AStepIsTheScalarOne) {
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    RenderSettings settings;
    settings.sh_degree = degree;
    settings.antialias = degree == 2;
    settings.antialias_detach = false;
    expect_scalar_step(plain(), settings);
  }
}

TEST_F(CudaPoses, AStepWithA3dFilterIsTheScalarOne) {
  expect_scalar_step(with_filters(plain(), 44), {});
}

TEST_F(CudaPoses, AStepInSpaceAndTimeIsTheScalarOne) {
  expect_scalar_step(in_spacetime(plain(), 41), {});
}

TEST_F(CudaPoses, ManyStepsAreTheScalarOnes) {
  TrainingModel expected = started(plain()), actual = on_gpu(expected);
  for (std::size_t k = 0; k < 15; ++k) {
    step(cpu(), expected, {k % 3}, {});
    step(gpu(), actual, {k % 3}, {});
  }
  gpu().synchronize(actual);
  expect_same_poses(on_host(actual).poses, expected.poses, 3e-2);
}

TEST_F(CudaPoses, RestWhereTheirRateIsZero) {
  const TrainingModel start = started(plain());
  TrainingModel actual = on_gpu(start);
  for (std::size_t k = 0; k < 3; ++k) step(gpu(), actual, {k}, {}, 0);
  gpu().synchronize(actual);
  EXPECT_TRUE(same_bits(on_host(actual).poses, start.poses));
}

// Sums have one order, with --deterministic and without it.
TEST_F(CudaPoses, LearnTheSameBitsEachTime) {
  RenderSettings settings;
  settings.deterministic = true;
  expect_same_bits_each_time(
      gpu(), started(plain(20000)),
      [&](TrainingModel& model, std::size_t k) { step(gpu(), model, {k % 3}, settings); });
}

// Buffers that are too small for some steps: these steps are taken again, and poses learn once.
TEST_F(CudaPoses, TooLittleRoomLosesNothing) {
  const Recipe large{
      .sigma_low = 30, .sigma_high = 60, .opacity_low = 0.02f, .opacity_high = 0.05f};
  const TrainingModel start =
      started(random_gaussians(large, 20000, scene_.train_views[0].camera, 3));
  RenderSettings settings;
  settings.deterministic = true;
  const auto after_steps = [&](bool meets_views_anew) {
    if (meets_views_anew) gpu().device().upload_views(scene_.train_views, 1 << 30);
    TrainingModel model = on_gpu(start);
    for (std::size_t k = 0; k < 6; ++k) step(gpu(), model, {k % 3}, settings);
    gpu().synchronize(model);
    return on_host(model);
  };
  const TrainingModel crowded = after_steps(true), roomy = after_steps(false);
  EXPECT_TRUE(same_bits(crowded, roomy));
  EXPECT_EQ(crowded.poses.adam_steps, 6);
  gpu().device().upload_views({}, 0);  // these views end here
}

// The first picture is that of the camera as the poses have it, before anything was learned.
TEST_F(CudaPoses, ThePictureIsThatOfTheRefinedCamera) {
  TrainingModel start = started(plain());
  disturb(start.poses, 0.1, 0.2, 5);
  const auto loss_of = [&](Backend& backend, bool is_refined) {
    TrainingModel model = copy_to(backend.memory(), start);
    if (!is_refined) model.poses = PoseState();
    step(backend, model, {1}, {}, 0);
    backend.synchronize(model);
    return backend.loss().value();
  };
  const double refined = loss_of(cpu(), true), given = loss_of(cpu(), false);
  EXPECT_LT(std::abs(loss_of(gpu(), true) - refined), 0.1 * std::abs(given - refined));
  EXPECT_LT(std::abs(loss_of(gpu(), false) - given), 0.1 * std::abs(given - refined));
}

// What the host writes between two steps counts, as after a step back to a checkpoint.
TEST_F(CudaPoses, GoOnFromWhatTheHostHasReplaced) {
  const TrainingModel start = started(plain());
  TrainingModel model = on_gpu(start);
  step(gpu(), model, {0}, {});
  gpu().synchronize(model);
  const TrainingModel after_one = on_host(model);
  EXPECT_FALSE(same_bits(after_one.poses, start.poses));
  for (const std::size_t row : {1, 2}) step(gpu(), model, {row}, {});
  gpu().synchronize(model);
  step(gpu(), model, {1}, {});  // is not brought back: the model is replaced at once
  model = on_gpu(after_one);
  gpu().synchronize(model);
  EXPECT_TRUE(same_bits(on_host(model).poses, after_one.poses));
  step(gpu(), model, {1}, {}, 0);
  gpu().synchronize(model);
  EXPECT_TRUE(same_bits(on_host(model).poses, after_one.poses));
}

// Two models take turns: each keeps its own poses.
TEST_F(CudaPoses, ArePartOfTheirModel) {
  const TrainingModel start = started(plain());
  RenderSettings settings;
  settings.deterministic = true;
  const auto after = [&](std::size_t steps, bool in_turns) {
    TrainingModel model = on_gpu(start), other = on_gpu(start);
    for (std::size_t k = 0; k < steps; ++k) {
      step(gpu(), model, {0}, settings);
      if (in_turns) step(gpu(), other, {1}, settings);
    }
    gpu().synchronize(other);
    gpu().synchronize(model);
    return on_host(model);
  };
  EXPECT_TRUE(same_bits(after(4, true), after(4, false)));
}

}  // namespace
}  // namespace gs
