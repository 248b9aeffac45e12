// SPDX-License-Identifier: Apache-2.0
// The parts of photometric models: appearances, the loss under them, updates, held-out photos, and
// the metrics. photometric_run_test.cpp trains.
#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include "gs_eval/color_correction.h"
#include "gs_eval/metrics.h"
#include "gs_train/photometric/photometric_start.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

const PhotometricConfig kGains{"gains", 2e-3f};
const LossSettings kLoss{0.2f};

TEST(PhotometricModels, TheSettingTakesEveryModelOfTheTableAndNoOther) {
  for (const std::string& name : photometric_models()) {
    Config config = adaptive_config();
    config.photometric.model = name;
    validate(config);
    if (name == kAutoPhotometricModel) continue;
    EXPECT_EQ(make_photometric_model(config.photometric) == nullptr, name == kNoPhotometricModel);
  }
  EXPECT_EQ(fmt::format("{}", fmt::join(photometric_models(), ", ")), kPhotometricWords);
  EXPECT_THROW(make_photometric_model({"ppisq"}), UsageError);
  EXPECT_THROW(make_photometric_model({kAutoPhotometricModel}), UsageError);  // of TrainSession
}

/// A photo of noise, a picture near it, and the numbers of an appearance.
class GainsOfAPhoto : public ::testing::Test {
 protected:
  static constexpr int kWidth = 24, kHeight = 18;

  GainsOfAPhoto() {
    view_.camera.width = pass_.width = kWidth;
    view_.camera.height = pass_.height = kHeight;
    view_.photo = Image8(kWidth, kHeight, 3);
    pass_.image.resize(3 * pass_.pixel_count());
    Draws draws(3);
    for (std::size_t i = 0; i < pass_.pixel_count(); ++i)
      for (std::size_t c = 0; c < 3; ++c) {
        const float value = draws.uniform(0.1f, 0.8f);
        view_.photo.pixels[3 * i + c] = std::uint8_t(255 * value);
        pass_.image[c * pass_.pixel_count() + i] = 0.8f * value + draws.uniform(0, 0.1f);
      }
  }

  std::unique_ptr<Appearance> appearance() const {
    return model_->appearance({numbers_.data(), 3});
  }
  /// The loss under the appearance, with the gradients of picture and numbers.
  double loss() {
    appearance_ = appearance();
    appearance_->show({pass_.image.data(), kWidth, kHeight});
    if (view_.over_background) appearance_->show_background(pass_.background, kWidth, kHeight);
    LossSettings settings = kLoss;
    settings.appearance = appearance_.get();
    loss_->forward_backward(pass_, view_, settings, dL_dimage_);
    return loss_->value();
  }
  void mask(std::uint8_t value) {
    view_.mask = Image8(kWidth, kHeight, 1);
    std::fill(view_.mask.pixels.begin(), view_.mask.pixels.end(), value);
  }

  RenderPass pass_;
  View view_;
  std::vector<float> numbers_{0.1f, -0.05f, 0.2f};
  const std::unique_ptr<PhotometricModel> model_ = make_photometric_model(kGains);
  const std::unique_ptr<Loss> loss_ = make_l1_ssim_loss();
  std::unique_ptr<Appearance> appearance_;
  Buffer<float> dL_dimage_;
};

TEST_F(GainsOfAPhoto, HaveTheGradientOfFiniteDifferences) {
  loss();
  const std::vector<double> gradient(appearance_->gradient().begin(),
                                     appearance_->gradient().end());
  constexpr float kStep = 5e-4f;  // few pixels cross their photo in it
  for (std::size_t i = 0; i < numbers_.size(); ++i) {
    const float before = numbers_[i];
    numbers_[i] = before + kStep;
    const double more = loss();
    numbers_[i] = before - kStep;
    const double less = loss();
    numbers_[i] = before;
    const double expected = (more - less) / (2 * double(kStep));
    EXPECT_NEAR(gradient[i], expected, 0.01 * std::abs(expected) + 1e-5) << i;
  }
}

// The whole gradient of a factor of the picture is that of the same factor of each pixel.
TEST_F(GainsOfAPhoto, LeaveThePictureTheGradientOfTheMultipliedOne) {
  numbers_ = {0.1f, 0.1f, 0.1f};
  loss();
  double by_picture = 0, by_gains = 0;
  for (std::size_t i = 0; i < dL_dimage_.size(); ++i)
    by_picture += double(dL_dimage_[i]) * double(pass_.image[i]);
  for (std::size_t c = 0; c < 3; ++c) by_gains += appearance_->gradient()[c];
  EXPECT_NEAR(by_picture, by_gains, 1e-6 * std::abs(by_gains) + 1e-8);
}

TEST_F(GainsOfAPhoto, OfOneLeaveLossAndGradientAsTheyAreExceptWhereThePhotoIsWhite) {
  numbers_.assign(3, 0.0f);
  const double with = loss();
  const std::vector<float> gradient(dL_dimage_.begin(), dL_dimage_.end());
  Buffer<float> plain;
  loss_->forward_backward(pass_, view_, kLoss, plain);
  EXPECT_NEAR(with, loss_->value(), 1e-6);
  for (std::size_t i = 0; i < gradient.size(); ++i) EXPECT_NEAR(gradient[i], plain[i], 1e-6) << i;
}

TEST_F(GainsOfAPhoto, AreThoseOfAnExposure) {
  numbers_ = {std::log(0.8f), 0, std::log(1.25f)};
  for (const bool over_background : {false, true}) {
    mask(128);
    view_.over_background = over_background;
    pass_.background = {0.9f, 0.2f, 0.5f};
    view_.exposure = Vec3f(1);
    const double learned = loss();
    const std::vector<float> gradient(dL_dimage_.begin(), dL_dimage_.end());
    view_.exposure = {0.8f, 1, 1.25f};
    loss_->forward_backward(pass_, view_, kLoss, dL_dimage_);
    EXPECT_NEAR(learned, loss_->value(), 1e-6);
    for (std::size_t i = 0; i < gradient.size(); ++i)
      EXPECT_NEAR(gradient[i], dL_dimage_[i], 1e-6) << i;
  }
}

TEST_F(GainsOfAPhoto, LearnNothingFromMaskedPixelsNorFromTheBackground) {
  mask(0);
  pass_.background = {0.9f, 0.2f, 0.5f};
  for (const bool over_background : {false, true}) {
    view_.over_background = over_background;
    loss();
    for (const double by_number : appearance_->gradient()) EXPECT_EQ(by_number, 0);
  }
}

TEST_F(GainsOfAPhoto, AreSummedInOneOrder) {
  const auto gradient = [&] {
    loss();
    return std::vector<double>(appearance_->gradient().begin(), appearance_->gradient().end());
  };
  EXPECT_EQ(with_threads(1, gradient), with_threads(3, gradient));
}

TEST_F(GainsOfAPhoto, WeighThePixelValuesOfDensityControl) {
  numbers_ = {std::log(0.8f), 0, std::log(1.25f)};
  const PixelRule rule{GrowthScore::error};
  loss();
  Buffer<float> learned, exposed;
  find_pixel_values(view_, rule, pass_, appearance_.get(), learned);
  view_.exposure = {0.8f, 1, 1.25f};
  find_pixel_values(view_, rule, pass_, nullptr, exposed);
  for (std::size_t i = 0; i < learned.size(); ++i) EXPECT_NEAR(learned[i], exposed[i], 1e-6) << i;
}

// ---- updates -----------------------------------------------------------------------------------

Config gains_config() {
  Config config = short_run();
  config.photometric = kGains;
  return config;
}

TrainingModel begun(const Scene& scene) {
  TrainingModel model;
  begin_photometric(gains_config(), scene, model);
  return model;
}

/// Some updates by a gradient that only the first photo has in nine of ten steps.
PhotometricState after_updates(int updates) {
  const auto model = make_photometric_model(kGains);
  TrainingModel training = begun(small_scene());
  Draws draws(8);
  for (int i = 0; i < updates; ++i) {
    std::vector<double> gradient(training.photometric.size(), 0.0);
    const std::size_t photo = i % 10 == 9 ? std::size_t(i / 10 % 8) : 0;
    for (std::size_t c = 0; c < 3; ++c)
      gradient[training.photometric.begin_of(photo) + c] = draws.uniform(-0.5f, 1);
    update_table(training.photometric, model->pulls(training.photometric), 2e-3f, {}, gradient);
  }
  return std::move(training.photometric);
}

TEST(UpdatePhotometric, KeepsAMeanOfZeroHoweverUnevenlyPhotosAreDrawn) {
  const PhotometricState state = after_updates(1000);
  for (std::size_t c = 0; c < 3; ++c) {
    double sum = 0, size = 0;
    for (std::size_t i = 0; i < 8; ++i) {
      sum += double(state.row(i)[c]);
      size += std::abs(double(state.row(i)[c]));
    }
    EXPECT_NEAR(sum / 8, 0, 1e-6);
    EXPECT_GT(size, 0.1);
  }
}

// A photo that is drawn once moves on by its moments in later steps, up to the common mean.
TEST(UpdatePhotometric, MovesPhotosThatAreNotDrawnAsAdamSays) {
  const auto model = make_photometric_model(kGains);
  TrainingModel training = begun(small_scene());
  PhotometricState& state = training.photometric;
  float value = 0;
  FloatMoments moments{};
  for (int t = 1; t <= 50; ++t) {
    std::vector<double> gradient(state.size(), 0.0);
    if (t == 1) gradient[state.begin_of(3)] = 0.5;
    adam_update(value, moments, t == 1 ? 0.5f : 0.0f, adam_step(t, 2e-3f));
    update_table(state, model->pulls(state), 2e-3f, {}, gradient);
  }
  EXPECT_LT(value, -0.01f);  // five times the rate of one step
  EXPECT_NEAR(state.row(3)[0] - state.row(4)[0], value, 1e-5);
}

TEST(UpdatePhotometric, PullsGainsToTheSolvedOnes) {
  Scene scene = small_scene();
  scene.train_views[2].exposure = {1.5f, 1, 0.8f};
  TrainingModel training = begun(scene);
  PhotometricState& state = training.photometric;
  EXPECT_TRUE(state.is_solved);
  const float solved = state.row(2)[0];
  EXPECT_NEAR(solved, std::log(1.5f) * 7 / 8, 1e-6);  // the mean is taken away
  state.row(2)[0] += 0.3f;
  const auto model = make_photometric_model(kGains);
  std::vector<double> gradient(state.size(), 0.0);
  update_table(state, model->pulls(state), 2e-3f, {}, gradient);
  EXPECT_GT(gradient[state.begin_of(2)], 0);
  EXPECT_EQ(gradient[state.begin_of(3)], 0);
}

TEST(BeginPhotometric, RefusesOtherPhotos) {
  Scene scene = small_scene();
  TrainingModel training = begun(scene);
  EXPECT_EQ(training.photometric.rows, 8u);
  EXPECT_EQ(training.photometric.numbers, 3u);
  scene.train_views.pop_back();
  EXPECT_THROW(begin_photometric(gains_config(), scene, training), Error);
}

// Pixels grow with the root of the light. A photo without the tags starts as the mean of the
// others.
TEST(BeginPhotometric, TakesTheExposuresOfExifWhereNoneWereSolvedFor) {
  Scene scene = small_scene();
  for (std::size_t i = 0; i < 4; ++i) scene.train_views[i].exposure_stops = float(i);
  const PhotometricState exif = std::move(begun(scene).photometric);
  EXPECT_FALSE(exif.is_solved);
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(exif.row(3)[c] - exif.row(1)[c], std::log(2.0f), 1e-5) << c;
    EXPECT_NEAR(exif.row(5)[c], (exif.row(1)[c] + exif.row(2)[c]) / 2, 1e-5) << c;
    EXPECT_EQ(exif.start[3 * 3 + c], exif.row(3)[c]) << c;
  }
  scene.train_views[0].exposure = {1.5f, 1, 1};
  const PhotometricState solved = std::move(begun(scene).photometric);
  EXPECT_TRUE(solved.is_solved);
  EXPECT_NEAR(solved.row(3)[0], solved.row(1)[0], 1e-6);
}

// ---- photos that nobody trained on -------------------------------------------------------------

/// Photos "a" to "l" on a line; every third is held out.
class HeldOut : public ::testing::Test {
 protected:
  HeldOut() {
    for (int i = 0; i < 12; ++i) {
      View view;
      view.name = std::string(1, char('a' + i));
      view.camera.cam_from_world_rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
      view.camera.cam_from_world_translation = {float(i), 0, 0};
      (i % 3 == 1 ? scene_.test_views : scene_.train_views).push_back(view);
    }
  }
  /// The numbers of the photos are f(place in the alphabet).
  template <class F>
  HeldOutPhotos predicted(F&& f) {
    PhotometricState state;
    state.begin(8, 1);
    for (std::size_t i = 0; i < 8; ++i)
      state.values[i] = f(float(scene_.train_views[i].name[0] - 'a'));
    return predict_held_out(state, scene_);
  }
  Scene scene_;
};

TEST_F(HeldOut, LieBetweenTheirNeighborsWherePhotosChangeSteadily) {
  const HeldOutPhotos photos = predicted([](float i) { return 0.1f * i; });
  EXPECT_EQ(photos.rule, "neighbors");
  for (std::size_t k = 0; k < 4; ++k)
    EXPECT_NEAR(photos.numbers[k][0], 0.1 * double(3 * k + 1), 1e-6);
}

TEST_F(HeldOut, AreTheMeanWhereNeighborsSayNothing) {
  const HeldOutPhotos photos = predicted([](float i) { return int(i) % 2 ? 0.1f : -0.1f; });
  EXPECT_EQ(photos.rule, "mean");
  EXPECT_NEAR(photos.numbers[0][0], 0, 1e-6);
}

// Names say nothing here: neighbors by name stand at opposite ends.
TEST_F(HeldOut, AreLikePhotosThatWereTakenNearby) {
  const auto side = [](int i) { return i % 2 ? 100.0f : 0.0f; };
  for (auto* views : {&scene_.train_views, &scene_.test_views})
    for (View& view : *views) {
      const int i = view.name[0] - 'a';
      view.camera.cam_from_world_translation = {side(i) + 0.1f * float(i), 0, 0};
    }
  const HeldOutPhotos photos = predicted([&](float i) { return side(int(i)) / 500; });
  EXPECT_EQ(photos.rule, "nearest");
  EXPECT_GT(photos.numbers[0][0], 0.1);  // "b", at 100
  EXPECT_LT(photos.numbers[1][0], 0.1);  // "e", at 0
}

// Each number has a line of its own, whose slope nobody knows beforehand.
TEST_F(HeldOut, FollowExifWhereItExplainsThePhotos) {
  const auto stops = [](float i) { return float(int(7 * i) % 5); };
  for (auto* views : {&scene_.train_views, &scene_.test_views})
    for (View& view : *views) view.exposure_stops = stops(float(view.name[0] - 'a'));
  const HeldOutPhotos photos = predicted([&](float i) { return 0.3f * stops(i) - 0.2f; });
  EXPECT_EQ(photos.rule, "exif");
  EXPECT_NEAR(photos.rules.back().spread, 0, 1e-5);
  for (std::size_t k = 0; k < 4; ++k)
    EXPECT_NEAR(photos.numbers[k][0], 0.3f * stops(float(3 * k + 1)) - 0.2f, 1e-5) << k;
}

// A photo without the tags has the mean; and where no photo has them, the rule is not tried.
TEST_F(HeldOut, AreTheMeanWhereExifIsMissing) {
  const auto f = [](float i) { return 0.1f * float(int(5 * i) % 3); };
  EXPECT_EQ(predicted(f).rules.size(), 3u);
  for (View& view : scene_.train_views) view.exposure_stops = f(float(view.name[0] - 'a'));
  const HeldOutPhotos photos = predicted(f);
  EXPECT_EQ(photos.rule, "exif");
  double mean = 0;
  for (const View& view : scene_.train_views) mean += double(*view.exposure_stops) / 8;
  EXPECT_NEAR(photos.numbers[0][0], mean, 1e-6);
}

TEST_F(HeldOut, AreLikePhotosOfTheSameCamera) {
  for (auto* views : {&scene_.train_views, &scene_.test_views})
    for (View& view : *views) view.camera_id = view.name[0] < 'g' ? 1 : 2;
  const HeldOutPhotos photos = predicted([](float i) { return i < 6 ? 0.2f : -0.2f; });
  for (const HeldOutRule& rule : photos.rules) EXPECT_NEAR(rule.spread, 0, 1e-6) << rule.name;
  EXPECT_NEAR(photos.numbers[1][0], 0.2, 1e-6);
  EXPECT_NEAR(photos.numbers[2][0], -0.2, 1e-6);
}

// ---- metrics -----------------------------------------------------------------------------------

TEST(ColorCorrection, OfAPictureThatIsHalfThePhotoFindsThePhoto) {
  ColorFit fit;
  for (int i = 0; i < 100; ++i) fit.add(0.005 * i + 0.1, 0.01 * i, 1);
  EXPECT_NEAR(fit.line().slope, 0.5, 1e-9);
  EXPECT_NEAR(fit.line().offset, 0.1, 1e-9);
  EXPECT_NEAR(fit.line().corrected(0.3), 0.4, 1e-9);
}

TEST(ColorCorrection, OfPicturesWithNothingInCommonMovesTheMeanAlone) {
  ColorFit flat, opposite;
  for (int i = 0; i < 100; ++i) {
    flat.add(0.01 * i, 0.5, 1);
    opposite.add(1 - 0.01 * i, 0.01 * i, 1);
  }
  for (const ColorFit& fit : {flat, opposite}) EXPECT_EQ(fit.line().slope, 1);
  EXPECT_NEAR(flat.line().corrected(0.495), 0.5, 1e-9);
}

TEST(ColorCorrection, LeavesOutPixelsWithoutAShare) {
  ColorFit fit;
  for (int i = 0; i < 100; ++i) fit.add(0.005 * i, 0.01 * i, 1);
  fit.add(1, 0, 0);
  EXPECT_NEAR(fit.line().slope, 0.5, 1e-9);
}

TEST(EvaluatePhotometric, MeasuresNeutralShownAndCorrectedPicturesApart) {
  Scene scene = small_scene();
  const Gaussians truth = small_truth();
  const auto renderer = make_scalar_renderer();
  for (View& view : scene.train_views)
    for (std::uint8_t& value : view.photo.pixels) value = std::uint8_t(std::lround(0.5 * value));
  SceneLooks looks;
  looks.config = kGains;
  looks.photos["view 0"] = {0, true, std::vector<float>(3, std::log(0.5f))};
  EvaluationOptions options;
  options.appearance_of = appearances(looks);
  options.is_corrected = true;
  const Evaluation found = evaluate(*renderer, truth.span(), scene.train_views, {}, {}, options);
  EXPECT_LT(found.views[0].psnr, 25);
  EXPECT_GT(found.views[0].photometric->psnr, 50);
  EXPECT_GT(found.views[0].corrected->psnr, 45);  // clamped values above 1 are lost
  EXPECT_FALSE(found.views[1].photometric);       // an unknown photo
  EXPECT_EQ(found.photometric->psnr, found.views[0].photometric->psnr);
  const Evaluation plain = evaluate(*renderer, truth.span(), scene.train_views, {});
  EXPECT_FALSE(plain.photometric || plain.corrected);
  EXPECT_EQ(plain.psnr, found.psnr);
}

// Solved gains know nothing of the factor that learned ones have in common, because a scene is as
// bright as the middle of its photos.
TEST(EvaluatePhotometric, ShowsSolvedGainsInTheBrightnessOfTheLearnedScene) {
  Scene scene = small_scene();
  const Gaussians truth = small_truth();
  SceneLooks looks;
  looks.config = kGains;
  for (std::size_t k = 0; k < 8; ++k) {  // the same looks as learned and as solved for
    View& view = scene.train_views[k];
    view.exposure = k % 2 ? Vec3f(0.8f) : Vec3f(1.25f);
    looks.photos[view.name] = {0, false, std::vector<float>(3, std::log(view.exposure.x) - 0.2f)};
  }
  EvaluationOptions options;
  options.appearance_of = appearances(looks);
  const auto psnr = [&] {
    const Evaluation found =
        evaluate(*make_scalar_renderer(), truth.span(), scene.train_views, {}, {}, options);
    return std::pair{found.photometric->psnr, found.psnr_exposure};
  };
  const auto [learned, without] = psnr();
  options.solved_appearance_of = solved_appearances(looks, scene);
  EXPECT_NEAR(psnr().second, learned, 1e-4);
  EXPECT_GT(std::abs(without - learned), 0.1);
}

}  // namespace
}  // namespace gs
