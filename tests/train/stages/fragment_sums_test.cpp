// SPDX-License-Identifier: Apache-2.0
// The sums over fragments that scores of density control are made of: against sums in double over
// the pixels of a brute-force picture, through whole steps, and through score passes.
#include "gs_core/memory.h"
#include "gs_render/stages.h"
#include "gs_train/backend.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/brute_force.h"
#include "tests/support/models.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

constexpr int kWidth = 37, kHeight = 26;  // 3 x 2 tiles, the last ones cut
constexpr std::size_t kPixels = std::size_t(kWidth) * kHeight;

struct TestScene {
  Camera camera = random_camera(kWidth, kHeight, 3);
  RenderSettings settings;
  Gaussians gaussians = random_gaussians(kTypical, 9, camera, 21);
  std::vector<float> dL_dimage, values;  // (3, H, W) as of a mean loss; (H, W)

  explicit TestScene(BlendRule rule = BlendRule::faster_gs) {
    settings.blend_rule = rule;
    settings.background = {0.3f, 0.1f, 0.7f};
    Draws draws(5);
    for (std::size_t i = 0; i < 3 * kPixels; ++i)
      dL_dimage.push_back(draws.uniform(-1, 1) / float(3 * kPixels));
    for (std::size_t i = 0; i < kPixels; ++i) values.push_back(draws.uniform(0, 1));
  }
};

/// What the pipeline sums for each Gaussian, and its gradients.
struct Result {
  std::vector<FragmentSums> sums;
  Gaussians gradients;
};
Result result_of(TestScene& scene, FragmentStatistic statistic) {
  scene.settings.fragment_statistic = statistic;
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  renderer->forward(scene.gaussians.span(), scene.camera, scene.settings, pass);
  Buffer<float> dL_dimage;
  dL_dimage.upload(scene.dL_dimage);
  Result result;
  result.gradients.resize(scene.gaussians.count());
  Buffer<Vec2f> dL_dmean2d(scene.gaussians.count(), host_memory());
  renderer->backward(scene.gaussians.span(), scene.camera, scene.settings, pass, dL_dimage.span(),
                     result.gradients.span(), dL_dmean2d.span());
  result.sums.resize(scene.gaussians.count());
  if (statistic != FragmentStatistic::none)
    for (std::size_t i = 0; i < result.sums.size(); ++i)
      if (pass.tile_counts[i]) result.sums[i] = fragment_sums_of(pass, i);
  return result;
}

/// What a score pass sums for each Gaussian.
std::vector<FragmentSums> sums_of_values(const TestScene& scene) {
  RenderPass pass;
  make_scalar_renderer()->forward(scene.gaussians.span(), scene.camera, scene.settings, pass);
  Buffer<float> values;
  values.upload(scene.values);
  blend_values(scene.settings, values.span(), pass);
  std::vector<FragmentSums> sums(scene.gaussians.count());
  for (std::size_t i = 0; i < sums.size(); ++i)
    if (pass.tile_counts[i]) sums[i] = fragment_sums_of(pass, i);
  return sums;
}

/// The same in double, and sums of absolute values.
struct DirectSums {
  double count = 0, force = 0, square = 0, weighted_value = 0, value = 0;
  double absolute_force = 0;
};

struct Fragment {
  std::uint32_t gaussian;
  Vec3d color;
  double alpha, transmittance;
  bool is_clamped;
};

/// The blended fragments of a pixel, front to back.
std::vector<Fragment> fragments_at(const ReferenceSplats& splats, BlendRule rule, int x, int y) {
  std::vector<Fragment> fragments;
  double transmittance = 1;
  for (const ReferenceSplats::Entry& entry : splats.entries) {
    const BasicSplat<double>& s = entry.splat;
    const double exponent = fragment_exponent(s.conic, x + 0.5 - s.mean2d.x, y + 0.5 - s.mean2d.y);
    if (exponent < -s.cutoff) continue;
    const double free = s.opacity * std::exp(exponent);
    const bool is_classic = rule == BlendRule::classic;
    const double alpha = is_classic ? std::min(free, double(kMaxAlphaClassic)) : free;
    const bool ends = is_opaque(transmittance * (1 - alpha));
    if (is_classic && ends) break;
    fragments.push_back(
        {entry.gaussian,
         {std::max(s.color.x, 0.0), std::max(s.color.y, 0.0), std::max(s.color.z, 0.0)},
         alpha,
         transmittance,
         alpha < free});
    transmittance *= 1 - alpha;
    if (ends) break;
  }
  return fragments;
}

/// The color of a pixel if its fragment k had this alpha.
Vec3d color_with(std::vector<Fragment> fragments, std::size_t k, double alpha,
                 const Vec3f& background) {
  fragments[k].alpha = alpha;
  Vec3d color(0.0);
  double transmittance = 1;
  for (const Fragment& fragment : fragments) {
    color += transmittance * fragment.alpha * fragment.color;
    transmittance *= 1 - fragment.alpha;
  }
  return color + transmittance * Vec3d(background);
}

std::vector<DirectSums> direct_sums(const TestScene& scene) {
  const ReferenceSplats splats =
      reference_splats<float>(in_double(scene.gaussians), scene.camera, scene.settings);
  const ReferencePicture picture = reference_picture(splats, scene.settings, kWidth, kHeight);
  std::vector<DirectSums> sums(scene.gaussians.count());
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      EXPECT_FALSE(picture.at(x, y).is_doubtful) << "take another seed";
      const std::size_t at = std::size_t(y) * kWidth + std::size_t(x);
      const Vec3d g{scene.dL_dimage[at], scene.dL_dimage[kPixels + at],
                    scene.dL_dimage[2 * kPixels + at]};
      const auto fragments = fragments_at(splats, scene.settings.blend_rule, x, y);
      for (std::size_t k = 0; k < fragments.size(); ++k) {
        // The color is linear in alpha, so that a difference is its derivative.
        const Vec3d slope = color_with(fragments, k, 1, scene.settings.background) -
                            color_with(fragments, k, 0, scene.settings.background);
        const Fragment& fragment = fragments[k];
        const double f = fragment.is_clamped ? 0 : 3.0 * kPixels * fragment.alpha * inner(slope, g);
        const double weight = fragment.transmittance * fragment.alpha;
        DirectSums& sum = sums[fragment.gaussian];
        sum.count += 1;
        sum.force += f;
        sum.absolute_force += std::abs(f);
        sum.square += f * f;
        sum.weighted_value += weight * scene.values[at];
        sum.value += scene.values[at];
      }
    }
  return sums;
}

void expect_same_fragments(const FragmentSums& sums, const DirectSums& expected, std::size_t i) {
  EXPECT_EQ(sums.count, expected.count) << i;
}

class FragmentSumsOf : public ::testing::TestWithParam<BlendRule> {};

TEST_P(FragmentSumsOf, ForceEqualDirectSums) {
  TestScene scene(GetParam());
  const std::vector<FragmentSums> sums = result_of(scene, FragmentStatistic::force).sums;
  const std::vector<DirectSums> expected = direct_sums(scene);
  for (std::size_t i = 0; i < sums.size(); ++i) {
    expect_same_fragments(sums[i], expected[i], i);
    EXPECT_NEAR(sums[i].first, expected[i].force, 1e-4 * expected[i].absolute_force) << i;
    EXPECT_NEAR(sums[i].second, expected[i].square, 1e-4 * expected[i].square) << i;
  }
  EXPECT_GT(expected[0].count + expected[1].count + expected[2].count, 0);
}

TEST_P(FragmentSumsOf, ValuesEqualDirectSums) {
  TestScene scene(GetParam());
  const std::vector<FragmentSums> sums = sums_of_values(scene);
  const std::vector<DirectSums> expected = direct_sums(scene);
  for (std::size_t i = 0; i < sums.size(); ++i) {
    expect_same_fragments(sums[i], expected[i], i);
    EXPECT_NEAR(sums[i].first, expected[i].weighted_value, 1e-5 * expected[i].weighted_value) << i;
    EXPECT_NEAR(sums[i].second, expected[i].value, 1e-5 * expected[i].value) << i;
  }
}

// The gradient by the opacity is the sum of f / o.
TEST_P(FragmentSumsOf, ForceAgreesWithTheGradientByTheOpacity) {
  TestScene scene(GetParam());
  const Result result = result_of(scene, FragmentStatistic::force);
  for (std::size_t i = 0; i < result.sums.size(); ++i) {
    const double opacity = sigmoid(double(scene.gaussians.logit_opacity[i]));
    const double by_logit = result.gradients.logit_opacity[i] * 3.0 * kPixels;
    EXPECT_NEAR(result.sums[i].first * (1 - opacity), by_logit,
                1e-4 * std::sqrt(double(result.sums[i].second) * result.sums[i].count) + 1e-7);
  }
}

TEST_P(FragmentSumsOf, ForceLeavesTheGradientsAsTheyAre) {
  TestScene scene(GetParam());
  for (const bool is_absolute : {false, true}) {
    scene.settings.absolute_gradient = is_absolute;
    const Result plain = result_of(scene, FragmentStatistic::none);
    EXPECT_TRUE(same_bits(result_of(scene, FragmentStatistic::force).gradients, plain.gradients));
  }
}

INSTANTIATE_TEST_SUITE_P(Rules, FragmentSumsOf,
                         ::testing::Values(BlendRule::faster_gs, BlendRule::classic),
                         [](const auto& rule) {
                           return rule.param == BlendRule::classic ? "Classic" : "FasterGs";
                         });

// ---- values of pixels --------------------------------------------------------------------------

/// A view of 8 x 6 pixels, and a render of it.
struct Picture {
  View view{"view", orbit_camera(0), Image8(8, 6, 3)};
  RenderPass pass;

  Picture() {
    view.camera.width = 8, view.camera.height = 6;
    pass.begin(view.camera, 0);
    pass.image.resize(3 * 48);
    pass.image.fill_zero();
  }
  std::vector<float> values(GrowthScore score, float mask_error = 0.1f) {
    Buffer<float> found;
    find_pixel_values(view, {score, mask_error}, pass, nullptr, found);
    return found.download();
  }
};

TEST(PixelValues, OfTheErrorAreTheMeanDifferenceOfTheChannels) {
  Picture picture;
  picture.view.photo.pixels[3 * 10] = 255;
  picture.view.photo.pixels[3 * 10 + 2] = 51;
  picture.pass.image[48 + 20] = 0.3f;
  const std::vector<float> values = picture.values(GrowthScore::error);
  EXPECT_NEAR(values[10], (1 + 0.2f) / 3, 1e-6f);
  EXPECT_NEAR(values[20], 0.1f, 1e-6f);
  EXPECT_EQ(values[0], 0.0f);
}

TEST(PixelValues, OfTheErrorAreThoseOfTheLossUnderAMaskAndAnExposure) {
  Picture picture;
  picture.view.photo.pixels.assign(3 * 48, 102);
  picture.view.exposure = Vec3f(0.5f);
  picture.view.mask = Image8(8, 6, 1);
  picture.view.mask.pixels.assign(48, 255);
  picture.view.mask.pixels[7] = 0;
  for (float& x : picture.pass.image) x = 0.6f;
  const std::vector<float> values = picture.values(GrowthScore::error);
  EXPECT_NEAR(values[6], 0.1f, 1e-6f);  // |0.5 * 0.6 - 0.4|
  EXPECT_EQ(values[7], 0.0f);
}

TEST(PixelValues, OfTheMaskAreOneAboveAShareOfTheRange) {
  Picture picture;
  for (int c = 0; c < 3; ++c) {
    picture.pass.image[c * 48 + 3] = 1;
    picture.pass.image[c * 48 + 4] = 0.3f;
    picture.pass.image[c * 48 + 5] = 0.2f;
  }
  const std::vector<float> values = picture.values(GrowthScore::mask, 0.25f);
  for (std::size_t i = 0; i < values.size(); ++i) EXPECT_EQ(values[i], i == 3 || i == 4) << i;
}

TEST(PixelValues, OfEdgesAreLargestAtADot) {
  Picture picture;
  for (int c = 0; c < 3; ++c) picture.view.photo.pixels[3 * (2 * 8 + 4) + c] = 200;
  const std::vector<float> values = picture.values(GrowthScore::edge);
  for (int y = 0; y < 6; ++y)
    for (int x = 0; x < 8; ++x) {
      const bool is_near = std::abs(x - 4) <= 1 && std::abs(y - 2) <= 1;
      const float expected = x == 4 && y == 2 ? 1 : is_near ? 0.125f : 0;
      EXPECT_NEAR(values[y * 8 + x], expected, 1e-6f) << x << " " << y;
    }
}

TEST(PixelValues, OfAViewWithoutContrastAreZero) {
  Picture picture;
  for (const GrowthScore score : {GrowthScore::edge, GrowthScore::mask})
    EXPECT_EQ(picture.values(score), std::vector<float>(48));
}

// ---- steps -------------------------------------------------------------------------------------

/// `action` on a new backend with each single allocation failing leaves a model as `start` made it,
/// and then succeeds: `check` looks at the result.
template <class Start, class Action, class Check>
void expect_repeatable(int least_failures, Start&& start, Action&& action, Check&& check) {
  for (int k = 1;; ++k) {
    const auto backend = make_scalar_backend();  // without the buffers of an earlier step
    TrainingModel model = start();
    bool has_failed = false;
    {
      const FailingMemory memory(k);
      try {
        action(*backend, model);
      } catch (const Error&) {
        has_failed = true;
      }
    }
    if (!has_failed) {
      EXPECT_GT(k, least_failures);
      return;
    }
    EXPECT_TRUE(same_bits(model, start())) << "allocation " << k;
    action(*backend, model);
    check(model);
  }
}

class GatheringStep : public ::testing::Test {
 protected:
  static TrainingModel start() {
    TrainingModel model = model_of(small_truth());
    number_rows(model.gaussians.sh0, 0.1f);
    return model;
  }
  /// One step on some views.
  void step(Backend& backend, TrainingModel& model, const std::vector<int>& views,
            GrowthScore score) const {
    std::vector<TrainingPhoto> batch;
    for (const int view : views) batch.push_back({&scene_.train_views[std::size_t(view)], {}});
    DensityStep density;
    density.gather_statistics = true;
    density.score = score;
    backend.step(model, {{batch.data(), batch.size()}, {0.2f}, {kRates}, density});
  }
  TrainingModel after(const std::vector<int>& views, GrowthScore score) {
    TrainingModel model = start();
    step(*backend_, model, views, score);
    return model;
  }

  const Scene scene_ = small_scene();
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

TEST_F(GatheringStep, ChangesNothingWhereMemoryRunsOut) {
  const TrainingModel expected = after({1, 4}, GrowthScore::force);
  expect_repeatable(
      20, start,
      [&](Backend& backend, TrainingModel& model) {
        step(backend, model, {1, 4}, GrowthScore::force);
      },
      [&](const TrainingModel& model) {
        EXPECT_TRUE(same_bits(model, expected));
        EXPECT_TRUE(same_bits(model.statistics.sums, expected.statistics.sums));
      });
}

TEST_F(GatheringStep, HasNoSumsForOtherScores) {
  for (const GrowthScore score : {GrowthScore::gradient, GrowthScore::edge}) {
    const TrainingModel model = after({1}, score);
    EXPECT_FALSE(model.statistics.has_sums);
    EXPECT_TRUE(model.statistics.sums.empty());
  }
}

TEST_F(GatheringStep, UpdatesTheModelAsWithoutSums) {
  const TrainingModel plain = after({1, 4}, GrowthScore::gradient);
  const TrainingModel model = after({1, 4}, GrowthScore::force);
  EXPECT_TRUE(same_bits(model, plain));
  EXPECT_TRUE(same_bits(model.statistics.gradient_norm, plain.statistics.gradient_norm));
  EXPECT_TRUE(model.statistics.has_sums);
}

/// The sums of a model are those of two others together.
void expect_added_sums(const TrainingModel& both, const TrainingModel& a, const TrainingModel& b) {
  double total = 0;
  for (std::size_t i = 0; i < both.count(); ++i) {
    FragmentSums sum = a.statistics.sums[i];
    add_to(sum, b.statistics.sums[i]);
    EXPECT_EQ(both.statistics.sums[i].count, sum.count);
    EXPECT_FLOAT_EQ(both.statistics.sums[i].first, sum.first);
    EXPECT_FLOAT_EQ(both.statistics.sums[i].second, sum.second);
    total += sum.second;
  }
  EXPECT_GT(total, 0);
}

TEST_F(GatheringStep, AddsTheSumsOfTheViewsOfABatch) {
  const GrowthScore score = GrowthScore::force;
  expect_added_sums(after({1, 4}, score), after({1}, score), after({4}, score));
}

TEST_F(GatheringStep, GivesTheSameBitsForAnyNumberOfThreads) {
  const auto sums = [&] { return after({2, 5, 6}, GrowthScore::force).statistics.sums; };
  EXPECT_TRUE(same_bits(with_threads(1, sums), with_threads(3, sums)));
}

// ---- a score pass ------------------------------------------------------------------------------

class ScorePass : public GatheringStep {
 protected:
  /// A model whose sums were of something else.
  static TrainingModel used() {
    TrainingModel model = start();
    begin_sums(model);
    for (std::size_t i = 0; i < model.count(); ++i) model.statistics.sums[i] = {7, 7, 7};
    return model;
  }
  TrainingModel scored(const std::vector<int>& views, const PixelRule& rule) {
    TrainingModel model = used();
    score(*backend_, model, views, rule);
    return model;
  }
  void score(Backend& backend, TrainingModel& model, const std::vector<int>& views,
             const PixelRule& rule) const {
    std::vector<TrainingPhoto> photos;
    for (const int view : views) photos.push_back({&scene_.train_views[std::size_t(view)], {}});
    backend.score_photos(model, {photos.data(), photos.size()}, rule);
  }
};

TEST_F(ScorePass, ReplacesTheSumsAndNothingElse) {
  const TrainingModel model = scored({1}, {GrowthScore::error}), before = used();
  EXPECT_TRUE(same_bits(model, before));
  double total = 0;
  for (std::size_t i = 0; i < model.count(); ++i) {
    const FragmentSums& sums = model.statistics.sums[i];
    EXPECT_EQ(sums.count, std::floor(sums.count)) << i;
    EXPECT_LE(sums.first, sums.second) << i;  // weights are at most 1
    total += sums.first;
  }
  EXPECT_GT(total, 0);
}

TEST_F(ScorePass, AddsUpItsPhotos) {
  for (const GrowthScore score : {GrowthScore::error, GrowthScore::mask, GrowthScore::edge}) {
    const PixelRule rule{score, 0.1f};
    expect_added_sums(scored({1, 4}, rule), scored({1}, rule), scored({4}, rule));
  }
}

TEST_F(ScorePass, GivesTheSameBitsForAnyNumberOfThreads) {
  const auto sums = [&] { return scored({2, 5, 6}, {GrowthScore::mask, 0.1f}).statistics.sums; };
  EXPECT_TRUE(same_bits(with_threads(1, sums), with_threads(3, sums)));
}

TEST_F(ScorePass, CanBeRepeatedWhereMemoryRunsOut) {
  const TrainingModel expected = scored({1, 4}, {GrowthScore::edge});
  expect_repeatable(
      10, start,
      [&](Backend& backend, TrainingModel& model) {
        score(backend, model, {1, 4}, {GrowthScore::edge});
      },
      [&](const TrainingModel& model) {
        EXPECT_TRUE(same_bits(model.statistics.sums, expected.statistics.sums));
      });
}

}  // namespace
}  // namespace gs
