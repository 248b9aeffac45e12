// SPDX-License-Identifier: Apache-2.0
// Stage 5 on the GPU against its scalar twin, and the ways in which photos get to the GPU.
#include "gs_train/photometric/photometric_model.h"
#include "tests/support/cuda.h"

namespace gs {
namespace {

/// The kind of rendered picture.
enum class Picture {
  noise,   // has nothing to do with the photo
  near,    // the photo with noise, as while training
  smooth,  // a smooth photo, a little darker: hardly any local variance
  equal,   // the photo
};

/// A view with a photo, and a rendered picture.
struct Pair {
  View view;
  std::vector<float> image;  // (3, H, W)

  Pair(int width, int height, Picture picture, std::uint64_t seed) {
    view.camera.width = width;
    view.camera.height = height;
    view.photo = picture == Picture::smooth ? smooth_photo(width, height)
                                            : random_photo(width, height, seed);
    Draws draws(seed + 1);
    const std::size_t plane = std::size_t(width) * height;
    image.resize(3 * plane);
    for (int c = 0; c < 3; ++c)
      for (std::size_t i = 0; i < plane; ++i)
        image[c * plane + i] =
            rendered(picture, view.photo.pixels[3 * i + c] * (1.0f / 255.0f), draws);
  }

  /// Gives the photo a mask of noise with black and white areas.
  void mask(bool over_background, std::uint64_t seed) {
    Draws draws(seed);
    view.mask = Image8(view.photo.width, view.photo.height, 1);
    for (int y = 0; y < view.photo.height; ++y)
      for (int x = 0; x < view.photo.width; ++x) {
        const int area = (x / 20 + y / 15) % 3;
        view.mask.at(x, y, 0) = area == 0   ? 0
                                : area == 1 ? 255
                                            : std::uint8_t(draws.uniform(0, 255.9f));
      }
    view.over_background = over_background;
  }

  RenderPass pass(Memory& memory) const {
    RenderPass pass(memory);
    pass.background = {0.9f, 0.2f, 0.5f};
    pass.width = view.photo.width;
    pass.height = view.photo.height;
    pass.image.upload(image);
    return pass;
  }

 private:
  static float rendered(Picture picture, float photo, Draws& draws) {
    switch (picture) {
      case Picture::noise: return draws.uniform(-0.1f, 1.2f);  // blending can leave 0..1
      case Picture::near: return 0.7f * photo + draws.uniform(0, 0.3f);
      case Picture::smooth: return 0.9f * photo + 0.02f;
      case Picture::equal: return photo;
    }
    return 0;
  }
  static Image8 smooth_photo(int width, int height) {
    Image8 photo(width, height, 3);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c)
          photo.at(x, y, c) = std::uint8_t(128 + 60 * std::sin(0.02f * float(x + 30 * c)) +
                                           50 * std::cos(0.03f * float(y)));
    return photo;
  }
};

struct Answer {
  double value;
  std::vector<float> dL_dimage;
};

Answer answer_of(Backend& backend, const Pair& pair, float lambda) {
  const RenderPass pass = pair.pass(backend.memory());
  Buffer<float> dL_dimage(backend.memory());
  backend.loss().forward_backward(pass, pair.view, {lambda}, dL_dimage);
  return {backend.loss().value(), dL_dimage.download()};
}

/// How far the two backends may differ: in the loss, and in the gradient relative to its largest
/// value.
struct Tolerance {
  double value, gradient;
};
// The sums are rounded at 6e-8 some twenty times, in another order than in the twin, and so are the
// moments; local variances of such pictures are of the order of the moments themselves, so that
// little cancels.
constexpr Tolerance kRounding{1e-5, 2e-5};
// In smooth pictures s_xx = E[xx] - E[x]^2 cancels. An error of some 1e-7 remains; divided by B =
// s_xx + s_yy + C2, some 1e-3, this is 1e-4. The parts of dL/dX, with factors 2 X and Y, cancel
// once more. The scalar loss itself differs from the same in double by up to 2e-3 of the largest
// gradient, the GPU's by up to 1.5e-3.
constexpr Tolerance kCancellation{2e-3, 5e-3};

constexpr std::pair<int, int> kSizes[] = {{1, 1},   {5, 3},   {11, 11},   {32, 32},
                                          {33, 65}, {97, 41}, {640, 360}, {1200, 897}};

class CudaLossTest : public CudaTest {
 protected:
  /// `weigh` may give the pair's photo a mask and an exposure.
  template <class Weigh>
  void expect_parity(Picture picture, std::uint64_t seed, const Tolerance& tolerance,
                     Weigh&& weigh) {
    for (const auto& [width, height] : kSizes) {
      Pair pair(width, height, picture, seed);
      weigh(pair);
      for (const float lambda : {0.0f, 0.2f, 1.0f}) {
        SCOPED_TRACE(testing::Message() << width << " x " << height << ", lambda " << lambda);
        const Answer actual = answer_of(gpu(), pair, lambda);
        const Answer expected = answer_of(cpu(), pair, lambda);
        // 1 - SSIM cancels, too, if the pictures are alike.
        EXPECT_NEAR(actual.value, expected.value, tolerance.value * std::max(expected.value, 0.1));
        EXPECT_LT(relative_difference(actual.dL_dimage, expected.dL_dimage), tolerance.gradient);
      }
    }
  }
  void expect_parity(Picture picture, std::uint64_t seed, const Tolerance& tolerance) {
    expect_parity(picture, seed, tolerance, [](Pair&) {});
  }
};

TEST_F(CudaLossTest, OfNoiseIsTheScalarOne) { expect_parity(Picture::noise, 1, kRounding); }

TEST_F(CudaLossTest, OfAPictureNearThePhotoIsTheScalarOne) {
  expect_parity(Picture::near, 2, kRounding);
}

TEST_F(CudaLossTest, OfASmoothPictureIsTheScalarOne) {
  expect_parity(Picture::smooth, 3, kCancellation);
}

TEST_F(CudaLossTest, OfMaskedPhotosIsTheScalarOne) {
  for (const bool over_background : {false, true}) {
    SCOPED_TRACE(over_background);
    expect_parity(Picture::near, 6, kRounding, [&](Pair& pair) { pair.mask(over_background, 7); });
  }
}

TEST_F(CudaLossTest, OfExposedPhotosIsTheScalarOne) {
  const auto expose = [](Pair& pair) { pair.view.exposure = {0.8f, 1.0f, 1.3f}; };
  expect_parity(Picture::near, 8, kRounding, expose);
  for (const bool over_background : {false, true}) {
    SCOPED_TRACE(over_background);
    expect_parity(Picture::near, 9, kRounding, [&](Pair& pair) {
      expose(pair);
      pair.mask(over_background, 10);
    });
  }
}

TEST_F(CudaLossTest, OfAFullMaskIsThatWithoutOne) {
  const Pair plain(97, 41, Picture::near, 11);
  Pair masked(97, 41, Picture::near, 11);
  masked.view.mask = Image8(97, 41, 1, 255);
  const Answer expected = answer_of(gpu(), plain, 0.2f), actual = answer_of(gpu(), masked, 0.2f);
  // Products with 1 are exact; what the compiler fuses may differ.
  EXPECT_NEAR(actual.value, expected.value, 1e-6);
  EXPECT_LT(relative_difference(actual.dL_dimage, expected.dL_dimage), kRounding.gradient);
}

TEST_F(CudaLossTest, DoesNotSeeWhatTheMaskCovers) {
  Pair pair(130, 90, Picture::near, 12);
  pair.mask(false, 13);
  Pair garbage = pair;
  const std::size_t plane = pair.view.mask.pixels.size();
  for (std::size_t i = 0; i < plane; ++i)
    for (int c = 0; c < 3 && pair.view.mask.pixels[i] == 0; ++c) {
      garbage.view.photo.pixels[3 * i + c] ^= 0xa5;
      garbage.image[c * plane + i] += 5;
    }
  const Answer expected = answer_of(gpu(), pair, 0.2f), actual = answer_of(gpu(), garbage, 0.2f);
  EXPECT_EQ(actual.value, expected.value);
  EXPECT_EQ(actual.dL_dimage, expected.dL_dimage);
}

TEST_F(CudaLossTest, OfEqualPicturesIsZeroAndHasNoL1Gradient) {
  for (const auto& [width, height] : kSizes) {
    const Pair pair(width, height, Picture::equal, 4);
    const Answer l1 = answer_of(gpu(), pair, 0.0f);
    EXPECT_EQ(l1.value, 0);
    for (const float g : l1.dL_dimage) ASSERT_EQ(g, 0);
    EXPECT_NEAR(answer_of(gpu(), pair, 1.0f).value, 0, 1e-6);
  }
}

TEST_F(CudaLossTest, TellsTheSameTwice) {
  const Pair pair(97, 41, Picture::near, 5);
  const Answer first = answer_of(gpu(), pair, 0.2f), second = answer_of(gpu(), pair, 0.2f);
  EXPECT_EQ(first.value, second.value);
  EXPECT_EQ(first.dL_dimage, second.dL_dimage);
}

// ---- learned appearances -----------------------------------------------------------------------

/// Log gains of a photo, up to a third of a stop.
using LogGains = std::vector<float>;
const LogGains kLogGains{0.2f, -0.1f, 0.05f};

/// The answer under a learned appearance, and its gradient.
struct LearnedAnswer : Answer {
  std::vector<double> gradient;
};

class CudaLearnedLossTest : public CudaLossTest {
 protected:
  LearnedAnswer of_cpu(const Pair& pair, float lambda, const LogGains& learned) {
    const auto appearance =
        make_photometric_model(PhotometricConfig{"gains"})->appearance({learned.data(), 3});
    const RenderPass pass = pair.pass(host_memory());
    appearance->show({pass.image.data(), pass.width, pass.height});
    if (pair.view.over_background)
      appearance->show_background(pass.background, pass.width, pass.height);
    Buffer<float> dL_dimage;
    LossSettings settings{lambda};
    settings.appearance = appearance.get();
    cpu().loss().forward_backward(pass, pair.view, settings, dL_dimage);
    return {{cpu().loss().value(), dL_dimage.download()},
            {appearance->gradient().begin(), appearance->gradient().end()}};
  }
  /// Adds the gradient to `sums`, if they are there.
  LearnedAnswer of_gpu(const Pair& pair, float lambda, const LogGains& learned,
                       const Buffer<double>* sums = nullptr, double weight = 1) {
    Memory& memory = gpu().memory();
    Buffer<float> of_photo(memory), dL_dimage(memory);
    of_photo.upload(learned);
    Buffer<double> own(3, memory);
    own.fill_zero();
    const PhotoOnDevice photo{of_photo.data(), sums ? sums->data() : own.data(), weight};
    LossSettings settings{lambda};
    settings.photo_on_device = &photo;
    const RenderPass pass = pair.pass(memory);
    gpu().loss().forward_backward(pass, pair.view, settings, dL_dimage);
    return {{gpu().loss().value(), dL_dimage.download()}, (sums ? *sums : own).download()};
  }
  /// What the GPU shows differs by some 3e-7 from that of the CPU. So the sign of X - Y differs at
  /// some values, and whether a bright value counts as white, about at three in a million.
  void expect_same_answer(const Pair& pair, float lambda, const LogGains& learned) {
    const LearnedAnswer actual = of_gpu(pair, lambda, learned);
    const LearnedAnswer expected = of_cpu(pair, lambda, learned);
    EXPECT_NEAR(actual.value, expected.value, 1e-5 * std::max(expected.value, 0.1));
    ASSERT_EQ(actual.dL_dimage.size(), expected.dL_dimage.size());
    double largest = 0, shares = 0;
    for (std::size_t i = 0; i < expected.dL_dimage.size(); ++i) {
      largest = std::max(largest, std::abs(double(expected.dL_dimage[i])));
      shares += std::abs(double(expected.dL_dimage[i]) * double(pair.image[i]));
    }
    std::size_t others = 0;
    for (std::size_t i = 0; i < expected.dL_dimage.size(); ++i)
      others +=
          !(std::abs(actual.dL_dimage[i] - expected.dL_dimage[i]) <= kRounding.gradient * largest);
    EXPECT_LE(others, 3 + 3 * (expected.dL_dimage.size() / 100'000));
    ASSERT_EQ(actual.gradient.size(), expected.gradient.size());
    for (std::size_t i = 0; i < expected.gradient.size(); ++i)
      EXPECT_NEAR(actual.gradient[i], expected.gradient[i], 1e-4 * shares) << i;
  }
};

TEST_F(CudaLearnedLossTest, IsTheScalarOne) {
  for (const Picture picture : {Picture::noise, Picture::near})
    for (const auto& [width, height] : kSizes)
      for (const float lambda : {0.0f, 0.2f, 1.0f}) {
        SCOPED_TRACE(testing::Message() << width << " x " << height << ", lambda " << lambda);
        Pair pair(width, height, picture, 31);
        expect_same_answer(pair, lambda, kLogGains);
      }
}

TEST_F(CudaLearnedLossTest, OfMaskedPhotosIsTheScalarOne) {
  for (const bool over_background : {false, true})
    for (const auto& [width, height] : {std::pair{33, 65}, {97, 41}, {640, 360}}) {
      SCOPED_TRACE(testing::Message()
                   << width << " x " << height << ", over the background " << over_background);
      Pair pair(width, height, Picture::near, 32);
      pair.mask(over_background, 33);
      pair.view.exposure = {3, 3, 3};  // the learned appearance takes its place
      expect_same_answer(pair, 0.2f, kLogGains);
    }
}

TEST_F(CudaLearnedLossTest, OfPicturesThatTheMaskCoversTeachesNothing) {
  for (const bool over_background : {false, true}) {
    Pair pair(97, 41, Picture::near, 34);
    pair.view.mask = Image8(97, 41, 1, 0);
    pair.view.over_background = over_background;
    for (const double number : of_gpu(pair, 0.2f, kLogGains).gradient) EXPECT_EQ(number, 0);
  }
}

TEST_F(CudaLearnedLossTest, OfNumbersOfZeroIsThatOfNoModelWherePhotosAreNotWhite) {
  Pair pair(97, 41, Picture::near, 35);
  for (std::uint8_t& value : pair.view.photo.pixels) value = std::uint8_t(value / 2);
  const LearnedAnswer neutral = of_gpu(pair, 0.2f, {0, 0, 0});
  const Answer plain = answer_of(gpu(), pair, 0.2f);
  EXPECT_NEAR(neutral.value, plain.value, 1e-6);
  EXPECT_LT(relative_difference(neutral.dL_dimage, plain.dL_dimage), kRounding.gradient);
}

// Whatever --deterministic says: the loss does not know it.
TEST_F(CudaLearnedLossTest, TellsTheSameBitsTwice) {
  const Pair pair(640, 360, Picture::near, 36);
  const LearnedAnswer first = of_gpu(pair, 0.2f, kLogGains);
  for (int again = 0; again < 5; ++again) {
    const LearnedAnswer second = of_gpu(pair, 0.2f, kLogGains);
    EXPECT_EQ(first.value, second.value);
    EXPECT_EQ(first.dL_dimage, second.dL_dimage);
    EXPECT_EQ(first.gradient, second.gradient);
  }
}

TEST_F(CudaLearnedLossTest, AddsUpTheWeightedGradientsOfABatch) {
  const Pair one(97, 41, Picture::near, 37), other(33, 65, Picture::near, 38);
  const std::vector<double> of_one = of_gpu(one, 0.2f, kLogGains).gradient;
  const std::vector<double> of_other = of_gpu(other, 0.2f, kLogGains).gradient;
  Buffer<double> sums(of_one.size(), gpu().memory());
  sums.fill_zero();
  of_gpu(one, 0.2f, kLogGains, &sums, 0.5);
  const std::vector<double> both = of_gpu(other, 0.2f, kLogGains, &sums, 0.5).gradient;
  for (std::size_t i = 0; i < both.size(); ++i)
    EXPECT_NEAR(both[i], (of_one[i] + of_other[i]) / 2, 1e-12 + 1e-9 * std::abs(both[i]));
}

/// Five views of different sizes with their pictures, and the order in which the test uses them.
class CudaPhotosTest : public CudaLossTest {
 protected:
  static constexpr std::size_t kOrder[] = {0, 3, 1, 1, 4, 2, 0, 4, 3, 2, 2, 1, 0, 0, 3, 4};

  void SetUp() override {
    CudaLossTest::SetUp();
    if (IsSkipped()) return;
    const std::pair<int, int> sizes[] = {{40, 30}, {7, 90}, {130, 20}, {64, 64}, {33, 11}};
    for (const auto& [width, height] : sizes) {
      pairs_.emplace_back(width, height, Picture::near, std::uint64_t(10 + width));
      if (pairs_.size() % 2 == 0) pairs_.back().mask(false, std::uint64_t(width));
      views_.push_back(pairs_.back().view);
    }
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      passes_.push_back(pairs_[i].pass(gpu().memory()));
      expected_.push_back(answer_of(cpu(), pairs_[i], 0.2f).value);
    }
  }
  /// The loss of a view and its picture must be the scalar one; the photo of another view would
  /// give a very different loss.
  void expect_loss_of(std::size_t i) {
    gpu().loss().forward_backward(passes_[i], views_[i], {0.2f}, dL_dimage_);
    EXPECT_NEAR(gpu().loss().value(), expected_[i], kRounding.value * expected_[i]) << "view " << i;
  }

  std::vector<Pair> pairs_;
  std::vector<View> views_;
  std::vector<RenderPass> passes_;
  std::vector<double> expected_;
  Buffer<float> dL_dimage_{host_memory()};
};

TEST_F(CudaPhotosTest, AreFetchedWhenAskedFor) {
  dL_dimage_ = Buffer<float>(gpu().memory());
  for (const std::size_t i : kOrder) expect_loss_of(i);
}

TEST_F(CudaPhotosTest, AreThereOncePrepared) {
  dL_dimage_ = Buffer<float>(gpu().memory());
  gpu().device().upload_views(views_, std::size_t(1) << 30);
  for (const std::size_t i : kOrder) expect_loss_of(i);
}

TEST_F(CudaPhotosTest, AreFetchedOneViewAhead) {
  dL_dimage_ = Buffer<float>(gpu().memory());
  gpu().device().prefetch_next(views_[kOrder[0]]);
  for (std::size_t step = 0; step < std::size(kOrder); ++step) {
    if (step + 1 < std::size(kOrder)) gpu().device().prefetch_next(views_[kOrder[step + 1]]);
    expect_loss_of(kOrder[step]);
  }
}

TEST_F(CudaPhotosTest, MayBeAnnouncedInVain) {
  dL_dimage_ = Buffer<float>(gpu().memory());
  for (const std::size_t i : kOrder) {
    for (const View& view : views_) gpu().device().prefetch_next(view);
    expect_loss_of(i);
  }
}

// Steps run asynchronously: a photo stays on the GPU until the work on it is done.
TEST_F(CudaPhotosTest, StayWhileTheHostRunsAhead) {
  std::vector<Buffer<float>> gradients;
  gpu().device().prefetch_next(views_[kOrder[0]]);
  for (std::size_t step = 0; step < std::size(kOrder); ++step) {
    if (step + 1 < std::size(kOrder)) gpu().device().prefetch_next(views_[kOrder[step + 1]]);
    Buffer<float>& dL_dimage = gradients.emplace_back(gpu().memory());
    const std::size_t i = kOrder[step];
    gpu().loss().forward_backward(passes_[i], views_[i], {0.2f}, dL_dimage);
  }
  for (std::size_t step = 0; step < std::size(kOrder); ++step) {
    const Answer expected = answer_of(cpu(), pairs_[kOrder[step]], 0.2f);
    EXPECT_LT(relative_difference(gradients[step].download(), expected.dL_dimage),
              kRounding.gradient);
  }
}
}  // namespace
}  // namespace gs
