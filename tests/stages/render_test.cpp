// SPDX-License-Identifier: Apache-2.0
// Stages 1 to 4: the tiled picture in float equals the brute-force picture in double.
#include "gs_render/renderer.h"
#include "tests/support/brute_force.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kLog1e30 = 69.0776f;

/// Tolerance of colors and transmittances near 1: sums of some ten roundings of 6e-8, the 3e-7 of
/// exp_fragment(), and along needles exponents whose terms cancel. Worst seen: 7e-7 for typical
/// Gaussians, 5e-6 with needles.
constexpr double kTolerance = 2e-5;

/// How a picture differs from the reference, without pixels that depend on the last digits.
struct Comparison {
  double worst = 0;  // difference of a color or transmittance
  std::size_t doubtful = 0, wrong_last = 0;
};

/// The Gaussian that a pixel blended last.
std::uint32_t last_blended(const RenderPass& pass, int x, int y) {
  const std::uint32_t last = pass.last_instance[std::size_t(y) * pass.width + x];
  if (last == 0) return kNoGaussian;
  const int tile = y / kTileHeight * pass.tiles_x + x / kTileWidth;
  return pass.tile_splats[pass.tile_ranges[tile] + last - 1];
}

Comparison compare(const RenderPass& pass, const ReferencePicture& reference) {
  Comparison result;
  for (int y = 0; y < pass.height; ++y)
    for (int x = 0; x < pass.width; ++x) {
      const ReferencePixel& expected = reference.at(x, y);
      if (expected.is_doubtful) {
        ++result.doubtful;
        continue;
      }
      const std::size_t i = std::size_t(y) * pass.width + x;
      double difference = std::abs(pass.transmittance[i] - expected.transmittance);
      for (int c = 0; c < 3; ++c)
        difference = std::max(difference,
                              std::abs(pass.image[c * pass.pixel_count() + i] - expected.color[c]));
      result.worst = std::isnan(difference) ? kInfinity : std::max(result.worst, difference);
      result.wrong_last += last_blended(pass, x, y) != expected.last;
    }
  return result;
}

RenderPass render(const Gaussians& gaussians, const Camera& camera,
                  const RenderSettings& settings) {
  RenderPass pass;
  make_scalar_renderer()->forward(gaussians.span(), camera, settings, pass);
  return pass;
}

/// Expects the tiled picture to equal the brute-force one, made of splats that are projected in T.
template <class T = float>
void expect_brute_force_picture(const Gaussians& gaussians, const Camera& camera,
                                const RenderSettings& settings = {}) {
  const RenderPass pass = render(gaussians, camera, settings);
  const ReferenceSplats splats = reference_splats<T>(in_double(gaussians), camera, settings);
  const Comparison result =
      compare(pass, reference_picture(splats, settings, camera.width, camera.height));
  EXPECT_LT(result.worst, kTolerance);
  EXPECT_EQ(result.wrong_last, 0u);
  // A pixel has some tens of fragments; each of them depends on its last digits with a probability
  // of some 1e-4.
  EXPECT_LE(double(result.doubtful), 2 + 0.005 * double(pass.pixel_count()));
}

RenderSettings with(BlendRule rule, Truncation truncation = Truncation::alpha,
                    bool antialias = false) {
  RenderSettings settings;
  settings.blend_rule = rule;
  settings.truncation = truncation;
  settings.antialias = antialias;
  settings.background = {0.1f, 0.5f, 0.9f};
  return settings;
}

const BlendRule kRules[] = {BlendRule::faster_gs, BlendRule::classic};

TEST(Render, MatchesBruteForceInDoubleForTypicalGaussians) {
  const Camera camera = random_camera(75, 50);
  for (const BlendRule rule : kRules)
    expect_brute_force_picture<double>(random_gaussians(kTypical, 400, camera, 1), camera,
                                       with(rule));
}

TEST(Render, MatchesBruteForceForGaussiansOfEveryKindUnderEverySetting) {
  const Camera camera = random_camera(75, 50);
  const Gaussians mixed = mixed_gaussians(60, camera, 2);
  for (const BlendRule rule : kRules) {
    for (const Truncation truncation :
         {Truncation::alpha, Truncation::sigma2, Truncation::sigma3, Truncation::sigma4})
      expect_brute_force_picture(mixed, camera, with(rule, truncation));
    expect_brute_force_picture(mixed, camera, with(rule, Truncation::alpha, true));
    // where pixels become opaque
    expect_brute_force_picture(random_gaussians(kOpaque, 300, camera, 5), camera, with(rule));
  }
}

TEST(Render, MatchesBruteForceAtEveryShDegree) {
  const Camera camera = random_camera(40, 30);
  const Gaussians gaussians = random_gaussians(kTypical, 100, camera, 6);
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    RenderSettings settings;
    settings.sh_degree = degree;
    expect_brute_force_picture(gaussians, camera, settings);
  }
}

TEST(Render, MatchesBruteForceAtAnyPictureSize) {
  for (const auto& [width, height] :
       {std::pair{1, 1}, {1, 40}, {15, 17}, {16, 16}, {17, 33}, {33, 15}, {100, 3}}) {
    const Camera camera = random_camera(width, height);
    expect_brute_force_picture(mixed_gaussians(10, camera, 7), camera, with(BlendRule::faster_gs));
  }
}

TEST(Render, OfNoGaussiansIsTheBackground) {
  const RenderSettings settings = with(BlendRule::faster_gs);
  const RenderPass pass = render(Gaussians(), random_camera(20, 10), settings);
  for (std::size_t i = 0; i < pass.pixel_count(); ++i) {
    EXPECT_EQ(pass.image[i], settings.background.x);
    EXPECT_EQ(pass.image[pass.pixel_count() + i], settings.background.y);
    EXPECT_EQ(pass.image[2 * pass.pixel_count() + i], settings.background.z);
    EXPECT_EQ(pass.transmittance[i], 1.0f);
    EXPECT_EQ(pass.last_instance[i], 0u);
  }
}

TEST(Render, OfGaussiansBehindTheCameraIsTheBackground) {
  const Camera camera = random_camera(20, 10);
  const RenderPass pass = render(random_gaussians(kBehind, 50, camera, 8), camera, {});
  EXPECT_EQ(pass.tile_splats.size(), 0u);
  for (const float value : pass.image) EXPECT_EQ(value, 0.0f);
}

TEST(Render, OfGaussiansBesideThePictureIsTheBackground) {
  const Camera camera = plain_camera(20, 10);
  Gaussians gaussians(4, host_memory());
  int i = 0;
  for (const auto& [x, y] :
       {std::pair{-30.0f, 5.0f}, {80.0f, 5.0f}, {10.0f, -30.0f}, {10.0f, 80.0f}})
    set_gaussian(gaussians, i++, behind_pixel(camera, x, y, 1), 2.0f / 64, 0.9f);
  const RenderPass pass = render(gaussians, camera, {});
  EXPECT_EQ(pass.depth_order.size(), 0u);
  for (const float value : pass.image) EXPECT_EQ(value, 0.0f);
}

TEST(Render, OfOneGaussianOverEverythingHitsEveryTile) {
  const Camera camera = random_camera(75, 50);
  Gaussians gaussians(1, host_memory());
  set_gaussian(gaussians, 0, behind_pixel(camera, 40, 20, 2), 50, 0.7f);
  const RenderPass pass = render(gaussians, camera, {});
  EXPECT_EQ(pass.tile_counts[0], pass.tile_count());
  expect_brute_force_picture(gaussians, camera);
}

/// A dot of half a pixel on every pixel center in turn is hit in its own tile. If the mean lies
/// exactly on the first or last center of a tile, a careless tile test loses it.
TEST(Render, ShowsADotOnEveryPixelCenter) {
  const Camera camera = plain_camera(40, 36);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      Gaussians dot(1, host_memory());
      set_gaussian(dot, 0, behind_pixel(camera, float(x) + 0.5f, float(y) + 0.5f, 1), 1e-6f, 0.5f);
      const RenderPass pass = render(dot, camera, {});
      ASSERT_EQ(pass.splats[0].mean2d.x, float(x) + 0.5f);
      ASSERT_NEAR(pass.transmittance[std::size_t(y) * camera.width + x], 0.5f, 1e-6f)
          << x << " " << y;
    }
}

TEST(Render, MatchesBruteForceWithMeansOnPixelCentersAndTileEdges) {
  const Camera camera = plain_camera(48, 40);
  Draws draws(9);
  Gaussians gaussians(300, host_memory());
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const float x = 0.5f * float(draws.below(2 * 48)), y = 0.5f * float(draws.below(2 * 40));
    const Vec3f color = draws.uniform3(0, 1);
    const float opacity = draws.uniform(0.1f, 0.9f);
    const float size = draws.log_uniform(1e-3f, 0.05f);
    set_gaussian(gaussians, i, behind_pixel(camera, x, y, 1), size, opacity, color);
  }
  for (const BlendRule rule : kRules) expect_brute_force_picture(gaussians, camera, with(rule));
}

TEST(Render, BlendsEqualDepthsByIndex) {
  const Camera camera = plain_camera(16, 16);
  Gaussians gaussians(100, host_memory());
  Draws draws(10);
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const float depth = i % 3 == 0 ? 2.0f : 1.0f;
    set_gaussian(gaussians, i, behind_pixel(camera, 8, 8, depth), 0.1f, 0.02f,
                 draws.uniform3(0, 1));
  }
  const RenderPass pass = render(gaussians, camera, {});
  std::vector<std::uint32_t> expected;
  for (std::uint32_t i = 0; i < 100; ++i)
    if (i % 3 != 0) expected.push_back(i);
  for (std::uint32_t i = 0; i < 100; i += 3) expected.push_back(i);
  EXPECT_EQ(pass.depth_order.download(), expected);
  expect_brute_force_picture(gaussians, camera);
}

TEST(Render, LastInstanceIsZeroExactlyWhereNothingWasBlended) {
  const Camera camera = random_camera(60, 60);
  const RenderPass pass = render(random_gaussians(kSharp, 300, camera, 11), camera, {});
  std::size_t empty = 0;
  for (std::size_t i = 0; i < pass.pixel_count(); ++i) {
    EXPECT_EQ(pass.last_instance[i] == 0, pass.transmittance[i] == 1.0f);
    empty += pass.last_instance[i] == 0;
  }
  EXPECT_GT(empty, 100u);
  EXPECT_LT(empty, pass.pixel_count() - 100);
}

TEST(Render, EndsAnOpaquePixelAfterOrBeforeTheFragmentThatClosesIt) {
  const Camera camera = plain_camera(16, 16);
  Gaussians gaussians(20, host_memory());
  for (std::size_t i = 0; i < gaussians.count(); ++i)
    set_gaussian(gaussians, i, behind_pixel(camera, 8.5f, 8.5f, 1 + 0.1f * float(i)), 10, 0.92f);
  const std::size_t middle = 8 * 16 + 8;
  const RenderPass after = render(gaussians, camera, with(BlendRule::faster_gs));
  EXPECT_NEAR(after.transmittance[middle] / 4.096e-5, 1, 1e-3);  // 0.08^4 after 0.08^3
  EXPECT_EQ(after.last_instance[middle], 4u);
  const RenderPass before = render(gaussians, camera, with(BlendRule::classic));
  EXPECT_NEAR(before.transmittance[middle] / 5.12e-4, 1, 1e-3);
  EXPECT_EQ(before.last_instance[middle], 3u);
}

/// 256 x 257 tiles: tile numbers do not fit in 16 bits. One small Gaussian in each corner and in
/// the middle.
TEST(Render, DrawsInTheRightPlaceAmongMoreThan65536Tiles) {
  Camera camera = plain_camera(4096, 4112);
  camera.fx = camera.fy = 8192;
  Gaussians gaussians(5, host_memory());
  const std::pair<float, float> places[] = {
      {3.2f, 5.1f}, {4090.7f, 8.3f}, {6.4f, 4107.9f}, {4091.3f, 4108.2f}, {2047.6f, 2100.8f}};
  for (int i = 0; i < 5; ++i)
    set_gaussian(gaussians, i, behind_pixel(camera, places[i].first, places[i].second, 1),
                 2.0f / 8192, 0.8f, {0.2f * float(i), 0.5f, 1});
  const RenderPass pass = render(gaussians, camera, {});
  ASSERT_GT(pass.tile_count(), 65536u);
  EXPECT_EQ(pass.tile_ranges[pass.tile_count()], pass.tile_splats.size());
  const ReferenceSplats splats = reference_splats<float>(in_double(gaussians), camera, {});
  double missing_there = 0, missing = 0;
  for (const auto& [px, py] : places)
    for (int y = std::max(int(py) - 12, 0); y < std::min(int(py) + 12, camera.height); ++y)
      for (int x = std::max(int(px) - 12, 0); x < std::min(int(px) + 12, camera.width); ++x) {
        const ReferencePixel expected =
            reference_pixel<BlendRule::faster_gs>(splats, Vec3f(0.0f), x, y);
        const std::size_t at = std::size_t(y) * camera.width + x;
        missing_there += 1.0 - pass.transmittance[at];
        if (expected.is_doubtful) continue;
        ASSERT_NEAR(pass.image[at], expected.color.x, kTolerance);
        ASSERT_NEAR(pass.transmittance[at], expected.transmittance, kTolerance);
      }
  for (const float T : pass.transmittance) missing += 1.0 - T;
  EXPECT_NEAR(missing, missing_there, 1e-9) << "something was drawn elsewhere";
}

/// One odd value in one parameter of one Gaussian among ordinary ones, and whether it may be
/// visible then.
struct OddValue {
  const char* name;
  std::function<void(const Gaussians&, std::size_t)> put;
  enum { dropped, drawn, either } action;
};

std::vector<OddValue> odd_values() {
  using G = const Gaussians&;
  using I = std::size_t;
  std::vector<OddValue> odd;
  for (const float v : {kNan, kInfinity, -kInfinity}) {
    odd.push_back({"mean.x", [v](G g, I i) { g.mean[i].x = v; }, OddValue::dropped});
    odd.push_back({"mean.z", [v](G g, I i) { g.mean[i].z = v; }, OddValue::dropped});
    odd.push_back({"rotation.w", [v](G g, I i) { g.rotation[i].w = v; }, OddValue::dropped});
    odd.push_back({"rotation.z", [v](G g, I i) { g.rotation[i].z = v; }, OddValue::dropped});
    odd.push_back({"sh0", [v](G g, I i) { g.sh0[i].y = v; }, OddValue::dropped});
    odd.push_back(
        {"sh_rest", [v](G g, I i) { g.sh_rest[i].coefficient[7].z = v; }, OddValue::dropped});
  }
  for (const float v : {kNan, kInfinity, kLog1e30})
    odd.push_back({"log_scale.y", [v](G g, I i) { g.log_scale[i].y = v; }, OddValue::dropped});
  for (const float v : {-kInfinity, -kLog1e30})
    odd.push_back({"log_scale.y", [v](G g, I i) { g.log_scale[i].y = v; }, OddValue::drawn});
  odd.push_back({"1e30", [](G g, I i) { g.log_scale[i] = Vec3f(kLog1e30); }, OddValue::dropped});
  odd.push_back({"1e-30", [](G g, I i) { g.log_scale[i] = Vec3f(-kLog1e30); }, OddValue::drawn});
  odd.push_back({"opacity NaN", [](G g, I i) { g.logit_opacity[i] = kNan; }, OddValue::dropped});
  odd.push_back({"opacity 1", [](G g, I i) { g.logit_opacity[i] = kInfinity; }, OddValue::drawn});
  // Under the sigma rules a Gaussian with opacity 0 is drawn, without any effect.
  odd.push_back({"opacity 0", [](G g, I i) { g.logit_opacity[i] = -kInfinity; }, OddValue::either});
  odd.push_back({"rotation 0", [](G g, I i) { g.rotation[i] = {0, 0, 0, 0}; }, OddValue::dropped});
  odd.push_back({"rotation 1e30",
                 [](G g, I i) {
                   g.rotation[i] = {1e30f, 0, 0, 0};
                 },
                 OddValue::either});
  return odd;
}

TEST(Render, StaysFiniteWithOddValuesAndDropsGaussiansThatAreNot) {
  const Camera camera = random_camera(33, 20);
  for (const Truncation truncation : {Truncation::alpha, Truncation::sigma3})
    for (const bool antialias : {false, true})
      for (const OddValue& odd : odd_values()) {
        SCOPED_TRACE(odd.name);
        RenderSettings settings = with(BlendRule::faster_gs, truncation, antialias);
        Gaussians gaussians = random_gaussians(kTypical, 5, camera, 12);
        gaussians.mean[2] = behind_pixel(camera, 15, 10, 2);
        odd.put(gaussians, 2);
        const RenderPass pass = render(gaussians, camera, settings);
        for (const float value : pass.image) ASSERT_TRUE(std::isfinite(value));
        if (odd.action == OddValue::dropped) {
          EXPECT_EQ(pass.tile_counts[2], 0u);
        }
        // The antialiasing factor of a Gaussian without extent is 0.
        if (odd.action == OddValue::drawn && !antialias) {
          EXPECT_GT(pass.tile_counts[2], 0u);
        }
      }
}

TEST(Render, RefusesMoreThan2To32InstancesInAView) {
  const Gaussians many = gaussians_over_every_tile(65537);
  RenderPass pass;
  EXPECT_THAT(
      [&] {
        make_scalar_renderer()->forward(many.span(), camera_of_65536_tiles(), RenderSettings(),
                                        pass);
      },
      FailsWith(ExitCode::out_of_memory));
}

TEST(Render, LeavesTheSamePictureInAUsedPass) {
  const Camera large = random_camera(75, 50), small = random_camera(20, 30, 2);
  const Gaussians many = mixed_gaussians(30, large, 13),
                  few = random_gaussians(kTypical, 20, small, 14);
  const auto renderer = make_scalar_renderer();
  RenderPass used;
  renderer->forward(many.span(), large, {}, used);
  renderer->forward(few.span(), small, {}, used);
  const RenderPass fresh = render(few, small, {});
  EXPECT_EQ(used.image.download(), fresh.image.download());
  EXPECT_EQ(used.transmittance.download(), fresh.transmittance.download());
  EXPECT_EQ(used.last_instance.download(), fresh.last_instance.download());
}

TEST(ImageOf, ClampsAndInterleaves) {
  RenderPass pass;
  pass.width = 2;
  pass.height = 1;
  pass.image.upload({-1.0f, 0.1f, 0.2f, 2.0f, 0.3f, 0.4f});
  EXPECT_EQ(image_of(pass).pixels, (std::vector<float>{0.0f, 0.2f, 0.3f, 0.1f, 1.0f, 0.4f}));
}

}  // namespace
}  // namespace gs
