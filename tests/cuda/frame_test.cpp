// SPDX-License-Identifier: Apache-2.0
// Frames without a backward pass: launched at once for a number of instances that the frames before
// them suggest, they show what a frame does that counts its instances.
#include "tests/support/cuda.h"
#include "tests/support/frames.h"

namespace gs {
namespace {

// The same view from far behind all Gaussians: it shows none of them.
Camera looking_away(Camera camera) {
  camera.cam_from_world_translation.z -= 1e5f;
  return camera;
}

class CudaFrame : public CudaTest {
 protected:
  Picture picture(const Gaussians& gaussians, const Camera& camera,
                  const RenderSettings& settings) {
    RenderPass pass(gpu().memory());
    gpu().renderer().forward(gaussians.span(), camera, settings, pass);
    return {pass.image.download(), pass.transmittance.download()};
  }
  // The first frame of a renderer.
  Picture counted(const Gaussians& gaussians, const Camera& camera,
                  const RenderSettings& settings) {
    const std::unique_ptr<Backend> fresh = cuda::make_backend({0});
    RenderPass pass(fresh->memory());
    fresh->renderer().forward(gaussians.span(), camera, settings, pass);
    return {pass.image.download(), pass.transmittance.download()};
  }
  // The first two frames count their instances, the others do not.
  void expect_same_frames(const Gaussians& host, const Camera& camera,
                          const RenderSettings& settings) {
    const Gaussians gaussians = on_gpu(host);
    const Picture expected = counted(gaussians, camera, settings);
    for (int frame = 0; frame < 4; ++frame)
      EXPECT_TRUE(picture(gaussians, camera, settings) == expected) << "frame " << frame;
  }
};

TEST_F(CudaFrame, AForecastFrameIsTheCountedOneToTheLastBit) {
  const Camera camera = random_camera(640, 480, 3);
  for (const Recipe& recipe : {kTypical, kHuge, kFaint, kOpaque, kOffScreen, kBehind})
    for (const bool use_tensor_cores : {true, false})
      for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic}) {
        RenderSettings settings = for_viewing();
        settings.use_tensor_cores = use_tensor_cores;
        settings.blend_rule = rule;
        expect_same_frames(random_gaussians(recipe, 5000, camera, 7), camera, settings);
      }
}

// 75, 4275 and 16,950 tiles: the last ones are not ordered.
TEST_F(CudaFrame, PicturesOfAnySizeAreTheSame) {
  const RenderSettings settings = for_viewing();
  for (const int side : {1, 17, 150, 900, 1800}) {
    const Camera camera = random_camera(4 * side / 3 + 1, side, 5);
    expect_same_frames(random_gaussians(kTypical, 20'000, camera, 8), camera, settings);
  }
}

// The tiles of the smaller pictures are ordered, and those of the larger one are not.
TEST_F(CudaFrame, APassMayShowSmallerPicturesBeforeALargerOne) {
  const Camera small = random_camera(400, 300, 5), large = random_camera(2401, 1800, 5);
  const Gaussians gaussians = on_gpu(random_gaussians(kTypical, 20'000, large, 8));
  for (const bool use_tensor_cores : {true, false}) {
    RenderSettings settings = for_viewing();
    settings.use_tensor_cores = use_tensor_cores;
    const Picture expected = picture(gaussians, large, settings);
    RenderPass pass(gpu().memory());
    for (const Camera& camera : {small, large, small, large}) {
      gpu().renderer().forward(gaussians.span(), camera, settings, pass);
      if (camera.width != large.width) continue;
      EXPECT_TRUE((Picture{pass.image.download(), pass.transmittance.download()} == expected));
    }
  }
}

TEST_F(CudaFrame, SmallAndEmptyScenes) {
  const Camera camera = random_camera(160, 120, 3);
  for (const std::size_t count : {0, 1, 2, 31, 33})
    expect_same_frames(random_gaussians(kTypical, count, camera, 9), camera, for_viewing());
}

TEST_F(CudaFrame, GaussiansInSpaceAndTimeAndWithFilters) {
  Camera camera = random_camera(320, 240, 3);
  camera.time = 0.5f;
  const Gaussians still = random_gaussians(kTypical, 3000, camera, 9);
  expect_same_frames(in_spacetime(still, 7), camera, for_viewing());
  expect_same_frames(with_filters(still, 9), camera, for_viewing());
}

// Sides whose pixels are not a multiple of the four that a thread packs. Values far out of range
// are clamped.
TEST_F(CudaFrame, AnEightBitPictureIsTheRoundedOne) {
  for (const int side : {1, 3, 17, 150}) {
    const Camera camera = random_camera(4 * side / 3 + 1, side, 5);
    RenderSettings settings = for_viewing();
    settings.background = {-3, 0.5f, 7};
    const Gaussians gaussians = on_gpu(random_gaussians(kFaint, 3000, camera, 8));
    RenderPass pass(gpu().memory());
    gpu().renderer().forward(gaussians.span(), camera, settings, pass);
    const Image8 expected = to_image8(image_of(pass)), actual = gpu().renderer().picture_of(pass);
    ASSERT_EQ(actual.pixels.size(), expected.pixels.size());
    EXPECT_EQ(actual.width, expected.width);
    std::size_t apart = 0;
    for (std::size_t k = 0; k < expected.pixels.size(); ++k) {
      ASSERT_NEAR(actual.pixels[k], expected.pixels[k], 1) << k;
      apart += actual.pixels[k] != expected.pixels[k];
    }
    EXPECT_LE(apart, 1 + expected.pixels.size() / 10'000);  // halfway between two bytes
  }
}

// With 20,000 Gaussians, fewer rows than are visible are sorted by depth in the first attempt.
TEST_F(CudaFrame, AnOverflowIsDrawnAgain) {
  const Camera camera = random_camera(640, 480, 3), away = looking_away(camera);
  for (const std::size_t count : {2000, 20'000}) {
    const Gaussians gaussians = on_gpu(random_gaussians(kHuge, count, camera, 4));
    const RenderSettings settings = for_viewing();
    const Picture expected = counted(gaussians, camera, settings),
                  nothing = counted(gaussians, away, settings);
    EXPECT_FALSE(expected == nothing);
    for (int round = 0; round < 2; ++round) {
      for (int frame = 0; frame < 3; ++frame)
        EXPECT_TRUE(picture(gaussians, away, settings) == nothing);
      for (int frame = 0; frame < 3; ++frame)
        EXPECT_TRUE(picture(gaussians, camera, settings) == expected);
    }
  }
}

// A frame that overflows must not halt training.
TEST_F(CudaFrame, AnOverflowBetweenTwoStepsChangesNothing) {
  const Camera camera = random_camera(160, 120, 3);
  std::vector<View> views(1);
  views[0].camera = camera;
  views[0].photo = random_photo(camera.width, camera.height, 2);
  gpu().device().upload_views(views, std::size_t(1) << 30);
  const TrainingModel start = model_of(random_gaussians(kHuge, 3000, camera, 4));
  const auto trained = [&](bool draws) {
    TrainingModel model = CudaTest::on_gpu(start);
    RenderSettings settings;
    settings.deterministic = true;
    LearningRates rates{};
    rates.sh0 = 1e-2f;
    for (int step = 0; step < 4; ++step) {
      gpu().step(model, views[0], settings, {0.2f}, rates, {});
      gpu().synchronize(model);
      if (!draws) continue;
      for (const Camera& at : {looking_away(camera), looking_away(camera), camera})
        picture(model.gaussians, at, for_viewing());
    }
    return downloaded(model.gaussians.sh0);
  };
  EXPECT_EQ(trained(true), trained(false));
}

TEST_F(CudaFrame, MoreThan2To32InstancesAreRefused) {
  const Gaussians many = on_gpu(gaussians_over_every_tile(65'537));
  const Camera camera = camera_of_65536_tiles(), away = looking_away(camera);
  for (int frame = 0; frame < 2; ++frame) picture(many, away, for_viewing());
  EXPECT_THAT([&] { picture(many, camera, for_viewing()); }, FailsWith(ExitCode::out_of_memory));
}

}  // namespace
}  // namespace gs
