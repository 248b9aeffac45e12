// SPDX-License-Identifier: Apache-2.0
// Steps on the GPU with a photometric model, against the scalar backend. The loss under it is in
// loss_test.cpp, whole runs are in photometric_run_test.cpp.
#include "tests/support/cuda.h"
#include "tests/support/gains.h"

namespace gs {
namespace {

constexpr float kRate = 5e-3f;  // of the photos' numbers

/// Photos: a plain one, one with a mask, one over the background.
std::vector<View> three_views(int width, int height) {
  std::vector<View> views(3);
  for (std::size_t i = 0; i < views.size(); ++i) {
    views[i].name = "view " + std::to_string(i);
    views[i].camera = random_camera(width, height, 1);
    views[i].camera.cx += float(3 * i);
    views[i].photo = random_photo(width, height, i);
  }
  views[1].mask = Image8(width, height, 1, 255);
  std::fill_n(views[1].mask.pixels.begin(), std::size_t(width) * std::size_t(height) / 3,
              std::uint8_t(0));
  views[2].mask = Image8(width, height, 1, 150);
  views[2].over_background = true;
  return views;
}

class CudaPhotometric : public CudaTest {
 protected:
  /// Both backends learn gains from now on.
  PhotometricConfig use_gains() {
    PhotometricConfig config{"gains"};
    cpu().use({.photometric = make_photometric_model(config)});
    gpu().use({.photometric = make_photometric_model(config)});
    return config;
  }
  /// A model of views_ on the host.
  TrainingModel started(const PhotometricConfig& gains, std::size_t count = 3000) {
    TrainingModel model = model_of(random_gaussians(kTypical, count, views_[0].camera, 5));
    begin_with_gains(gains, views_, model);
    return model;
  }
  std::vector<TrainingPhoto> photos(const RenderSettings& settings, int reduction = 1) const {
    std::vector<TrainingPhoto> photos;
    for (std::size_t i = 0; i < views_.size(); ++i)
      photos.push_back({&views_[i], settings, reduction, i});
    return photos;
  }
  static Update update_of(int batch = 1) {
    Update update{kRates, batch_rule(batch)};
    update.photometric_rate = kRate;
    update.photo_rule = batch_rule(batch);
    return update;
  }
  static RenderSettings on_a_background() {
    RenderSettings settings;
    settings.background = {0.3f, 0.6f, 0.9f};
    return settings;
  }
  /// The moments say what gradients there were, and the values what Adam made of them.
  void expect_same_numbers(const PhotometricState& actual, const PhotometricState& expected,
                           const PhotometricState& start, double tolerance) {
    const auto moved = [&](const PhotometricState& state) {
      std::vector<float> by = downloaded(state.values), from = downloaded(start.values);
      for (std::size_t i = 0; i < by.size(); ++i) by[i] -= from[i];
      return by;
    };
    EXPECT_LT(norm_difference(moved(actual), moved(expected)), tolerance);
    EXPECT_EQ(actual.adam_steps, expected.adam_steps);
    EXPECT_LT(norm_difference(first_moments(actual), first_moments(expected)), 3 * tolerance);
    EXPECT_LT(norm_difference(second_moments(actual), second_moments(expected)), 6 * tolerance);
  }

  const std::vector<View> views_ = three_views(131, 77);
};

TEST_F(CudaPhotometric, AStepIsTheScalarOne) {
  for (const bool is_solved : {false, true})
    for (const TrainingPhoto& photo : photos(on_a_background())) {
      SCOPED_TRACE(testing::Message() << "photo " << photo.photo_row << ", solved " << is_solved);
      const PhotometricConfig config = use_gains();
      TrainingModel expected = started(config);
      expected.photometric.is_solved = is_solved;
      const TrainingModel start = copy_to(host_memory(), expected);
      TrainingModel actual = on_gpu(start);
      cpu().step(expected, {{&photo, 1}, {0.2f}, update_of(), {true}});
      gpu().step(actual, {{&photo, 1}, {0.2f}, update_of(), {true}});
      gpu().synchronize(actual);
      EXPECT_NEAR(gpu().loss().value(), cpu().loss().value(), 1e-3 * cpu().loss().value());
      expect_same_numbers(on_host(actual).photometric, expected.photometric, start.photometric,
                          1e-2);
    }
}

TEST_F(CudaPhotometric, ManyStepsAreTheScalarOnes) {
  for (const int reduction : {1, 3}) {
    SCOPED_TRACE(testing::Message() << "reduced " << reduction << " times");
    const PhotometricConfig config = use_gains();
    TrainingModel expected = started(config);
    const TrainingModel start = copy_to(host_memory(), expected);
    TrainingModel actual = on_gpu(start);
    const std::vector<TrainingPhoto> all = photos(on_a_background(), reduction);
    for (std::size_t step = 0; step < 15; ++step) {
      cpu().step(expected, {{&all[step % 3], 1}, {0.2f}, update_of(), {true}});
      gpu().step(actual, {{&all[step % 3], 1}, {0.2f}, update_of(), {true}});
    }
    gpu().synchronize(actual);
    expect_same_numbers(on_host(actual).photometric, expected.photometric, start.photometric, 3e-2);
    EXPECT_LT(norm_difference(downloaded(actual.gaussians.sh0), downloaded(expected.gaussians.sh0)),
              2e-2);
  }
}

TEST_F(CudaPhotometric, ABatchIsThatOfTheScalarBackend) {
  const PhotometricConfig config = use_gains();
  TrainingModel expected = started(config);
  const TrainingModel start = copy_to(host_memory(), expected);
  TrainingModel actual = on_gpu(start);
  std::vector<TrainingPhoto> batch = photos(on_a_background());
  batch.push_back(batch[0]);  // the same photo twice
  batch[1].reduction = 2;
  for (int step = 0; step < 4; ++step) {
    cpu().step(expected, {{batch.data(), batch.size()}, {0.2f}, update_of(4), {true}});
    gpu().step(actual, {{batch.data(), batch.size()}, {0.2f}, update_of(4), {true}});
  }
  gpu().synchronize(actual);
  expect_same_numbers(on_host(actual).photometric, expected.photometric, start.photometric, 3e-2);
}

// The scores of density control see what the photo shows.
TEST_F(CudaPhotometric, TheErrorsOfPixelsAreTheScalarOnes) {
  const PhotometricConfig config = use_gains();
  TrainingModel expected = started(config);
  TrainingModel actual = on_gpu(expected);
  const std::vector<TrainingPhoto> all = photos(on_a_background());
  for (const TrainingPhoto& photo : all) {
    cpu().step(expected, {{&photo, 1}, {0.2f}, update_of(), {}});
    gpu().step(actual, {{&photo, 1}, {0.2f}, update_of(), {}});
  }
  cpu().score_photos(expected, {all.data(), all.size()}, {GrowthScore::error});
  gpu().score_photos(actual, {all.data(), all.size()}, {GrowthScore::error});
  gpu().synchronize(actual);
  EXPECT_LT(
      norm_difference(downloaded(actual.statistics.sums), downloaded(expected.statistics.sums)),
      1e-2);
}

TEST_F(CudaPhotometric, RestsWhereItsRateIsZero) {
  TrainingModel expected = started(use_gains());
  const TrainingModel start = copy_to(host_memory(), expected);
  TrainingModel actual = on_gpu(start);
  Update update = update_of();
  update.photometric_rate = 0;
  for (const TrainingPhoto& photo : photos(on_a_background())) {
    cpu().step(expected, {{&photo, 1}, {0.2f}, update, {true}});
    gpu().step(actual, {{&photo, 1}, {0.2f}, update, {true}});
    EXPECT_NEAR(gpu().loss().value(), cpu().loss().value(), 2e-3 * cpu().loss().value());
  }
  gpu().synchronize(actual);
  EXPECT_TRUE(same_bits(on_host(actual).photometric, start.photometric));
}

// Sums have one order, with --deterministic and without it. The Gaussians have it only with it, so
// that the numbers of later steps differ without it.
TEST_F(CudaPhotometric, LearnsTheSameBitsEachTime) {
  const TrainingModel start = started(use_gains(), 20000);
  const auto after = [&](int steps, bool deterministic) {
    TrainingModel model = on_gpu(start);
    RenderSettings settings = on_a_background();
    settings.deterministic = deterministic;
    const std::vector<TrainingPhoto> all = photos(settings);
    for (int step = 0; step < steps; ++step)
      gpu().step(model, {{&all[std::size_t(step) % 3], 1}, {0.2f}, update_of(), {true}});
    gpu().synchronize(model);
    return on_host(model);
  };
  const TrainingModel one = after(1, false), many = after(30, true);
  for (int again = 0; again < 3; ++again) {
    EXPECT_TRUE(same_bits(after(1, false).photometric, one.photometric));
    EXPECT_TRUE(same_bits(after(30, true), many));
  }
}

// What the common update leaves is 0, however unevenly photos are drawn.
TEST_F(CudaPhotometric, KeepsAMeanOfZero) {
  const PhotometricConfig config = use_gains();
  TrainingModel model = on_gpu(started(config, 300));
  const std::vector<TrainingPhoto> all = photos(on_a_background());
  for (std::size_t step = 0; step < 1000; ++step)
    gpu().step(model, {{&all[step % 10 == 9 ? step / 10 % 3 : 0], 1}, {0.2f}, update_of(), {}});
  gpu().synchronize(model);
  const TrainingModel learned = on_host(model);
  double common[3] = {0, 0, 0};
  for (std::size_t photo = 0; photo < 3; ++photo)
    for (std::size_t c = 0; c < 3; ++c) common[c] += learned.photometric.row(photo)[c] / 3.0;
  // Numbers grow to some units, where a float has steps of 5e-7.
  for (const double number : common) EXPECT_NEAR(number, 0, 2e-6);
}

// Buffers that are too small for some steps: these steps are taken again, and gains are learned
// once.
TEST_F(CudaPhotometric, TooLittleRoomLosesNothing) {
  const std::vector<View> views = three_views(320, 240);
  const Recipe large{
      .sigma_low = 30, .sigma_high = 60, .opacity_low = 0.02f, .opacity_high = 0.05f};
  RenderSettings settings;
  settings.deterministic = true;
  std::vector<TrainingPhoto> batch;
  for (std::size_t i = 0; i < 3; ++i) batch.push_back({&views[i], settings, 1, i});
  for (const bool in_batches : {false, true}) {
    SCOPED_TRACE(testing::Message() << "in batches " << in_batches);
    TrainingModel start = model_of(random_gaussians(large, 20000, views[0].camera, 3));
    begin_with_gains(use_gains(), views, start);
    const auto after_steps = [&](bool meets_views_anew) {
      if (meets_views_anew) gpu().device().upload_views(views, 1 << 30);
      TrainingModel model = on_gpu(start);
      for (std::size_t step = 0; step < 9; ++step) {
        if (in_batches)
          gpu().step(model, {{batch.data(), 3}, {0.2f}, update_of(3), {true}});
        else
          gpu().step(model, {{&batch[step % 3], 1}, {0.2f}, update_of(), {true}});
      }
      gpu().synchronize(model);
      return on_host(model);
    };
    const TrainingModel crowded = after_steps(true), roomy = after_steps(false);
    EXPECT_TRUE(same_bits(crowded, roomy));
    EXPECT_EQ(crowded.photometric.adam_steps, in_batches ? 27 : 9);
    EXPECT_FALSE(same_bits(crowded.photometric, start.photometric));
  }
  gpu().device().upload_views({}, 0);  // these views end here
}

TEST_F(CudaPhotometric, LeavesStepsWithoutAModelAsTheyAre) {
  const TrainingModel start = model_of(random_gaussians(kTypical, 3000, views_[0].camera, 5));
  RenderSettings settings = on_a_background();
  settings.deterministic = true;
  const auto after_steps = [&] {
    TrainingModel model = on_gpu(start);
    const std::vector<TrainingPhoto> all = photos(settings);
    for (std::size_t step = 0; step < 6; ++step)
      gpu().step(model, {{&all[step % 3], 1}, {0.2f}, update_of(), {true}});
    gpu().synchronize(model);
    return on_host(model);
  };
  gpu().use({});
  const TrainingModel before = after_steps();
  TrainingModel learned = on_gpu(started(use_gains()));
  for (const TrainingPhoto& photo : photos(settings))
    gpu().step(learned, {{&photo, 1}, {0.2f}, update_of(), {true}});
  gpu().synchronize(learned);

  gpu().use({});
  EXPECT_TRUE(same_bits(after_steps(), before));
}

}  // namespace
}  // namespace gs
