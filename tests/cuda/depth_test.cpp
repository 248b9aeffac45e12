// SPDX-License-Identifier: Apache-2.0
// Steps on the GPU by photos with depth maps, against the scalar backend.
#include "tests/cuda/same_steps.h"
#include "tests/support/posed_scene.h"

namespace gs {
namespace {

constexpr float kWeight = 2;  // so that depth has a good part in the gradients
// Relative, of gradients: one of the two backends may keep a fragment at a threshold, and the other
// leave it out.
constexpr double kTolerance = 1e-2;

/// Three views of random photos with maps of holes and noise; the second one has a mask.
Scene three_views(int width, int height, DepthKind kind) {
  Scene scene;
  for (std::size_t i = 0; i < 3; ++i) {
    View view;
    view.name = "view " + std::to_string(i);
    view.camera = random_camera(width, height, 1);
    view.camera.cam_from_world_translation.x += 0.05f * float(i);
    view.camera.time = 0.4f;
    view.photo = random_photo(width, height, i);
    view.depth = ImageF(width, height, 1);
    view.depth_kind = kind;
    view.has_depth_map = true;
    Draws draws(40 + i);
    for (float& value : view.depth.pixels) value = draws.chance(0.1f) ? 0 : draws.uniform(1, 6);
    if (i == 1) {
      view.mask = Image8(width, height, 1);
      for (std::uint8_t& m : view.mask.pixels) m = std::uint8_t(draws.uniform(0, 255.9f));
    }
    scene.train_views.push_back(std::move(view));
  }
  scene.extent = 0.5f;
  return scene;
}

class CudaDepth : public CudaTest {
 protected:
  void SetUp() override {
    CudaTest::SetUp();
    if (!IsSkipped()) use_views(DepthKind::metric);
  }
  /// The backend knows views by their addresses until other ones are announced.
  void use_views(DepthKind kind) {
    scene_ = three_views(131, 77, kind);
    gpu().device().upload_views(scene_.train_views, 0);
  }
  Gaussians plain(std::size_t count = 3000) const {
    return random_gaussians(kTypical, count, scene_.train_views[0].camera, 5);
  }
  void step(Backend& backend, TrainingModel& model, const std::vector<std::size_t>& rows,
            const RenderSettings& settings, float weight = kWeight,
            const DensityStep& density = {true}) const {
    std::vector<TrainingPhoto> batch;
    for (const std::size_t row : rows)
      batch.push_back({&scene_.train_views[row], settings, rows.size() > 1 ? 2 : 1, row});
    LossSettings loss{0.2f};
    loss.depth_weight = weight;
    backend.step(model, {{batch.data(), batch.size()},
                         loss,
                         Update{kRates, batch_rule(int(rows.size()))},
                         density});
  }
  /// The first moments are the gradients times a constant, after one step.
  void expect_same_gradients(const TrainingModel& actual, const TrainingModel& expected,
                             double tolerance) {
    const TrainingModel here = on_host(actual);
    for_each_array(
        [&](const char* name, const auto& a, const auto& b) {
          const Span<float> x = numbers_of(a), y = numbers_of(b);
          EXPECT_LT(norm_difference({x.begin(), x.end()}, {y.begin(), y.end()}), tolerance) << name;
        },
        opened(here).first, opened(expected).first);
    const auto numbers = [](const Buffer<float>& from) { return from.download(); };
    EXPECT_LT(norm_difference(numbers(here.statistics.gradient_norm),
                              numbers(expected.statistics.gradient_norm)),
              tolerance);
  }
  void expect_scalar_step(const Gaussians& gaussians, const RenderSettings& settings = {}) {
    for (const std::vector<std::size_t>& rows :
         {std::vector<std::size_t>{0}, std::vector<std::size_t>{1},
          std::vector<std::size_t>{0, 1, 2, 0}}) {
      TrainingModel expected = model_of(gaussians), actual = on_gpu(expected);
      step(cpu(), expected, rows, settings);
      step(gpu(), actual, rows, settings);
      gpu().synchronize(actual);
      expect_same_gradients(actual, expected, kTolerance);
    }
  }

  Scene scene_;
};

TEST_F(CudaDepth, AStepIsTheScalarOneForEachKindOfMap) {
  for (const DepthKind kind :
       {DepthKind::metric, DepthKind::scaled, DepthKind::relative, DepthKind::inverse}) {
    use_views(kind);
    expect_scalar_step(plain());
  }
}

TEST_F(CudaDepth, AStepIsTheScalarOneWithEverySetting) {
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    RenderSettings settings;
    settings.sh_degree = degree;
    settings.antialias = degree == 2;
    settings.antialias_detach = false;
    settings.background = {0.2f, 0.5f, 0.8f};
    settings.blend_rule = degree == 1 ? BlendRule::classic : BlendRule::faster_gs;
    settings.absolute_gradient = degree == 3;
    expect_scalar_step(plain(), settings);
  }
}

TEST_F(CudaDepth, AStepWithA3dFilterIsTheScalarOne) {
  expect_scalar_step(with_filters(plain(), 44));
}

TEST_F(CudaDepth, AStepInSpaceAndTimeIsTheScalarOne) {
  expect_scalar_step(in_spacetime(plain(), 41));
}

// The sums of forces are those of the colors, although a depth map adds to the same gradients.
TEST_F(CudaDepth, ForcesAreThoseOfTheScalarStep) {
  const DensityStep density{.gather_statistics = true, .score = GrowthScore::force};
  for (const bool is_deterministic : {false, true})
    for (const std::vector<std::size_t>& rows :
         {std::vector<std::size_t>{0}, std::vector<std::size_t>{0, 1, 2, 0}}) {
      RenderSettings settings;
      settings.deterministic = is_deterministic;
      TrainingModel expected = model_of(plain()), actual = on_gpu(expected);
      step(cpu(), expected, rows, settings, kWeight, density);
      step(gpu(), actual, rows, settings, kWeight, density);
      gpu().synchronize(actual);
      const TrainingModel here = on_host(actual);
      std::vector<float> forces, expected_forces;
      for (std::size_t i = 0; i < here.count(); ++i) {
        forces.push_back(here.statistics.sums[i].first);
        expected_forces.push_back(expected.statistics.sums[i].first);
      }
      EXPECT_LT(norm_difference(forces, expected_forces), 1e-2) << is_deterministic << rows.size();
    }
}

TEST_F(CudaDepth, LearnsTheSameBitsEachTimeIfDeterministic) {
  RenderSettings settings;
  settings.deterministic = true;
  expect_same_bits_each_time(
      gpu(), model_of(plain(20000)),
      [&](TrainingModel& model, std::size_t k) { step(gpu(), model, {k % 3}, settings); });
  TrainingModel expected = model_of(plain()), actual = on_gpu(expected);
  step(cpu(), expected, {0}, settings);
  step(gpu(), actual, {0}, settings);
  gpu().synchronize(actual);
  expect_same_gradients(actual, expected, kTolerance);
}

// The stage leaves nothing behind for photos without a map.
TEST_F(CudaDepth, IsNoPartOfOtherSteps) {
  RenderSettings settings;
  settings.deterministic = true;
  const TrainingModel start = model_of(plain());
  TrainingModel never = on_gpu(start), later = on_gpu(start);
  TrainingModel other = on_gpu(start);
  step(gpu(), never, {0}, settings, 0);
  step(gpu(), other, {0}, settings);
  step(gpu(), later, {0}, settings, 0);
  gpu().synchronize(later);
  EXPECT_TRUE(same_bits(on_host(later), on_host(never)));
  EXPECT_FALSE(same_bits(on_host(other), on_host(never)));
}

TEST_F(CudaDepth, RunsRefinePosesAsWell) {
  Config config;
  config.poses.refine = true;
  TrainingModel expected = model_of(plain());
  begin_poses(config, scene_, expected);
  TrainingModel actual = on_gpu(expected);
  const auto step_with_poses = [&](Backend& backend, TrainingModel& model) {
    const TrainingPhoto photo{&scene_.train_views[0], {}, 1, 0};
    LossSettings loss{0.2f};
    loss.depth_weight = kWeight;
    Update update{kRates};
    update.pose_rate = 1e-3f;
    backend.step(model, {{&photo, 1}, loss, update, {true}});
  };
  step_with_poses(cpu(), expected);
  step_with_poses(gpu(), actual);
  gpu().synchronize(actual);
  EXPECT_LT(norm_difference(first_moments(on_host(actual).poses), first_moments(expected.poses)),
            1e-2);
}

}  // namespace
}  // namespace gs
