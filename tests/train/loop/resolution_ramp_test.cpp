// SPDX-License-Identifier: Apache-2.0
// Runs that train on reduced photos first.
#include "gs_train/reduced_view.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

/// The small scene with a masked photo, one with alpha, one with an exposure, and one elsewhere.
class OnePhotoSource final : public PhotoSource {
 public:
  explicit OnePhotoSource(View view) : view_(std::make_shared<View>(std::move(view))) {}
  std::shared_ptr<const View> view(std::size_t) override { return view_; }
  void prefetch_decode(std::size_t) override {}
  void release(std::size_t) override {}

 private:
  std::shared_ptr<const View> view_;
};

Scene varied_scene() {
  Scene scene = small_scene();
  std::vector<View>& views = scene.train_views;
  const int width = views[0].camera.width, height = views[0].camera.height;
  views[1].mask = Image8(width, height, 1, 255);
  std::fill_n(views[1].mask.pixels.begin(), std::size_t(width) * 11 + 3, std::uint8_t(0));
  views[2].mask = Image8(width, height, 1, 150);
  views[2].over_background = true;
  views[3].exposure = {0.9f, 1.0f, 1.1f};
  views[4].source = std::make_shared<OnePhotoSource>(views[4]);
  views[4].photo = {};
  return scene;
}

/// The same scene with each photo reduced beforehand.
Scene reduced_scene(const Scene& scene, int factor) {
  Scene result = scene;
  for (View& view : result.train_views) view = reduced_view(*with_photo(view), factor);
  return result;
}

class ResolutionRamp : public SceneRun {
 protected:
  ResolutionRamp() : SceneRun(varied_scene()) {}

  /// 90 steps with refinements, of which each factor has 30.
  static Config run_with(const std::vector<int>& ramp) {
    Config config = growing_run(90);
    config.density.until_step = 30000;
    config.train.resolution_ramp = ramp;
    config.train.resolution_every = 10000;
    config.train.resolution_least = 1;
    return config;
  }
  TrainingModel trained_on(const Scene& scene, const Config& config) {
    return model_of_run(scene, config, *backend_);
  }
};

TEST_F(ResolutionRamp, TrainsAsOnASceneOfReducedPhotos) {
  for (const int factor : {2, 3, 5}) {  // 48 x 36 pixels: five leave columns and a row over
    const TrainingModel expected = trained_on(reduced_scene(scene_, factor), run_with({}));
    EXPECT_GT(expected.count(), scene_.points.size());  // it was refined
    EXPECT_TRUE(same_bits(trained(run_with({factor, factor, factor})), expected)) << factor;
  }
}

TEST_F(ResolutionRamp, GoesOnWithTheNextFactorAndThenWithWholePhotos) {
  const Config config = run_with({4, 2});
  std::optional<TrainingState> state;
  for (const int factor : {4, 2}) {
    const Scene scene = reduced_scene(scene_, factor);
    state = stopped_after(factor == 4 ? 29 : 59, scene, run_with({}), *backend_, std::move(state));
  }
  Trainer last(scene_, run_with({}), *backend_, std::move(*state));
  last.run();
  EXPECT_TRUE(same_bits(trained(config), last.model()));
  EXPECT_FALSE(same_bits(trained(config), trained(run_with({}))));
}

TEST_F(ResolutionRamp, OfFactorOneIsARunWithoutARamp) {
  EXPECT_TRUE(same_bits(trained(run_with({1, 1})), trained(run_with({}))));
  Config config = run_with({4, 2});
  config.train.resolution_least = 48 * 36;
  EXPECT_TRUE(same_bits(trained(config), trained(run_with({}))));
}

TEST_F(ResolutionRamp, GivesTheSameBitsForAnyNumberOfThreads) {
  expect_same_bits_on_any_threads(run_with({4, 2}));
}

TEST_F(ResolutionRamp, GoesOnAfterAnyStep) {
  Config config = run_with({4, 2});
  expect_goes_on_after({10, 28, 29, 30, 31, 59, 60, 75}, config);
  config.train.batch = 7;  // photos of one batch have two sizes
  expect_goes_on_after({10, 23, 27, 30, 59, 75}, config);
}

// Scores sum over pixels of the reduced photo.
TEST_F(ResolutionRamp, WorksWithEveryMethod) {
  Config config = run_with({4, 2});
  config.density.max_gaussians = 150;
  for (const char* strategy : {"adaptive", "mcmc"}) {
    config.density.strategy = strategy;
    expect_goes_on_after({30}, config);
  }
  config.density.gradient_threshold = 0;
  for (const NamedMethod& row : growth_methods()) {
    config.density.strategy = row.name;
    EXPECT_GT(trained(config).count(), scene_.points.size()) << row.name;
  }
}

TEST_F(ResolutionRamp, EndsAsCloseToThePhotosAsARunWithoutOne) {
  Config config = short_run();
  const double without = psnr_after(config);
  config.train.resolution_ramp = {4, 2};
  config.train.resolution_least = 1;
  EXPECT_GT(psnr_after(config), without - 1);
}

}  // namespace
}  // namespace gs
