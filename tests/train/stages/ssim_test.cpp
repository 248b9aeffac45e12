// SPDX-License-Identifier: Apache-2.0
// Stage 5: the photometric loss compared with its definition in double, and its gradient with the
// slope of that.
#include "gs_core/math/loss/ssim.h"
#include "gs_train/stages/scalar_stages.h"
#include "gs_train/stages/window.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

/// The window's weight at an offset, from its definition.   Wang et al. 2004
double weight(int dx, int dy) {
  double sum = 0;
  for (int d = -5; d <= 5; ++d) sum += std::exp(-d * d / 4.5);
  return std::exp(-(dx * dx + dy * dy) / 4.5) / (sum * sum);
}

/// Mean of f(x, y) over the 11 x 11 pixels around (x, y), zero outside the picture.
template <class F>
double window_mean(int x, int y, int width, int height, F&& f) {
  double sum = 0;
  for (int v = std::max(y - 5, 0); v <= std::min(y + 5, height - 1); ++v)
    for (int u = std::max(x - 5, 0); u <= std::min(x + 5, width - 1); ++u)
      sum += weight(u - x, v - y) * f(u, v);
  return sum;
}

class WindowedMeans : public ::testing::TestWithParam<std::pair<int, int>> {};
INSTANTIATE_TEST_SUITE_P(Sizes, WindowedMeans,
                         ::testing::Values(std::pair{1, 1}, std::pair{3, 20}, std::pair{20, 3},
                                           std::pair{10, 11}, std::pair{5, 6}, std::pair{37, 26}));

TEST_P(WindowedMeans, AreTheTwoDimensionalConvolution) {
  const int width = GetParam().first, height = GetParam().second;
  constexpr int kPlanes = 2;
  Buffer<float> stack(std::size_t(kPlanes) * width * height, host_memory()), scratch;
  Draws draws(1);
  for (float& value : stack) value = draws.uniform(-1, 1);
  const std::vector<float> before = stack.download();
  window_means(stack.span(), kPlanes, width, height, scratch);
  for (int plane = 0; plane < kPlanes; ++plane)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const std::size_t first = std::size_t(plane) * width * height;
        const double expected = window_mean(x, y, width, height, [&](int u, int v) {
          return before[first + std::size_t(v) * width + u];
        });
        // Values up to 1, 22 roundings of 6e-8, weights with ten digits.
        EXPECT_NEAR(stack[first + std::size_t(y) * width + x], expected, 1e-6);
      }
}

/// A rendered picture and a photo.
struct Pair {
  RenderPass pass;
  View view;

  Pair(int width, int height, std::uint64_t seed) {
    pass.width = view.camera.width = width;
    pass.height = view.camera.height = height;
    view.photo = random_photo(width, height, seed);
    Draws draws(seed + 1);
    pass.image.resize(3 * pass.pixel_count());
    // Near the photo, as in training: there SSIM does not depend on its constants.
    for (int c = 0; c < 3; ++c)
      for (std::size_t i = 0; i < pass.pixel_count(); ++i)
        pass.image[c * pass.pixel_count() + i] =
            0.7f * float(target(c, i)) + draws.uniform(0, 0.3f);
  }
  double target(int c, std::size_t i) const { return view.photo.pixels[3 * i + c] / 255.0; }

  /// Gives the photo a mask of noise, black, white and between, an exposure and a background.
  void weigh(bool over_background, std::uint64_t seed) {
    Draws draws(seed);
    view.mask = Image8(pass.width, pass.height, 1);
    for (std::uint8_t& value : view.mask.pixels)
      value = std::uint8_t(std::clamp(draws.uniform(-200, 455), 0.0f, 255.0f));
    view.exposure = {0.8f, 1.0f, 1.3f};
    view.over_background = over_background;
    pass.background = {0.9f, 0.2f, 0.5f};
  }
  double mask(std::size_t i) const { return view.mask.empty() ? 1 : view.mask.pixels[i] / 255.0; }
  double compared_image(int c, std::size_t i, double X) const {
    return (view.over_background ? 1 : mask(i)) * view.exposure[c] * X;
  }
  /// What the picture pass.image is compared with: the picture itself where it is brighter than a
  /// white photo.
  double compared_photo(int c, std::size_t i) const {
    const double behind = double(view.exposure[c]) * pass.background[c];
    const double photo =
        mask(i) * target(c, i) + (view.over_background ? (1 - mask(i)) * behind : 0);
    const double image = compared_image(c, i, pass.image[c * pass.pixel_count() + i]);
    return view.has_exposure() && target(c, i) >= kPhotoWhite && image > photo ? image : photo;
  }
  std::vector<double> image() const { return {pass.image.begin(), pass.image.end()}; }
  std::size_t values() const { return pass.image.size(); }

  /// The loss of a picture in double.
  double loss(const std::vector<double>& X, double lambda) const {
    const std::size_t plane = pass.pixel_count();
    double l1 = 0, ssim = 0;
    for (int c = 0; c < 3; ++c)
      for (int y = 0; y < pass.height; ++y)
        for (int x = 0; x < pass.width; ++x) {
          const auto index = [&](int u, int v) { return std::size_t(v) * pass.width + u; };
          const auto at = [&](int u, int v) {
            return compared_image(c, index(u, v), X[c * plane + index(u, v)]);
          };
          const auto photo = [&](int u, int v) { return compared_photo(c, index(u, v)); };
          const auto mean = [&](auto&& f) { return window_mean(x, y, pass.width, pass.height, f); };
          l1 += std::abs(at(x, y) - photo(x, y));
          ssim += ssim_index(WindowMeans<double>{
              mean(at), mean(photo), mean([&](int u, int v) { return at(u, v) * at(u, v); }),
              mean([&](int u, int v) { return photo(u, v) * photo(u, v); }),
              mean([&](int u, int v) { return at(u, v) * photo(u, v); })});
        }
    return (1 - lambda) * l1 / double(X.size()) + lambda * (1 - ssim / double(X.size()));
  }
};

/// The loss of a picture, and its gradient.
struct Result {
  double value;
  Buffer<float> dL_dimage;
};

Result loss_of(const Pair& pair, float lambda = 0.2f) {
  const auto loss = make_l1_ssim_loss();
  Buffer<float> dL_dimage;
  loss->forward_backward(pair.pass, pair.view, {lambda}, dL_dimage);
  return {loss->value(), std::move(dL_dimage)};
}

void expect_same(const Result& a, const Result& b) {
  EXPECT_EQ(a.dL_dimage.download(), b.dL_dimage.download());
  EXPECT_EQ(a.value, b.value);
}

class PhotometricLoss : public ::testing::TestWithParam<std::pair<int, int>> {};
INSTANTIATE_TEST_SUITE_P(Sizes, PhotometricLoss,
                         ::testing::Values(std::pair{17, 7}, std::pair{4, 6}, std::pair{1, 1}));

TEST_P(PhotometricLoss, HasTheValueOfItsDefinition) {
  const Pair pair(GetParam().first, GetParam().second, 2);
  for (const float lambda : {0.0f, 0.2f, 1.0f})  // float moments
    EXPECT_NEAR(loss_of(pair, lambda).value, pair.loss(pair.image(), lambda), 2e-6);
}

/// The largest difference between the gradient and the slope of the definition, over the largest
/// slope.
double worst_slope(const Pair& pair, float lambda, const Buffer<float>& dL_dimage) {
  constexpr double h = 1e-5;
  std::vector<double> X = pair.image();
  double largest = 0, worst = 0;
  for (std::size_t i = 0; i < pair.values(); i += 1 + pair.values() / 60) {
    const double value = X[i];
    X[i] = value + h;
    const double high = pair.loss(X, lambda);
    X[i] = value - h;
    const double low = pair.loss(X, lambda);
    X[i] = value;
    const double slope = (high - low) / (2 * h);
    largest = std::max(largest, std::abs(slope));
    worst = std::max(worst, std::abs(slope - dL_dimage[i]));
  }
  return worst / largest;
}

TEST_P(PhotometricLoss, HasTheGradientOfItsDefinition) {
  const Pair pair(GetParam().first, GetParam().second, 3);
  for (const float lambda : {0.2f, 1.0f}) {
    const Buffer<float> dL_dimage = loss_of(pair, lambda).dL_dimage;
    ASSERT_EQ(dL_dimage.size(), pair.values());
    // Float rounds moments at 6e-8, their differences and quotients at some ten times that.
    EXPECT_LT(worst_slope(pair, lambda, dL_dimage), 5e-6);
  }
}

TEST(WeightedLoss, HasTheValueAndTheGradientOfItsDefinition) {
  for (const bool over_background : {false, true})
    for (const float lambda : {0.0f, 0.2f, 1.0f}) {
      Pair pair(17, 7, 8);
      pair.weigh(over_background, 9);
      const Result result = loss_of(pair, lambda);
      EXPECT_NEAR(result.value, pair.loss(pair.image(), lambda), 2e-6);  // float moments
      EXPECT_LT(worst_slope(pair, lambda, result.dL_dimage), 5e-6) << over_background << lambda;
    }
}

TEST(WeightedLoss, OfAnExposureAloneIsThatOfThePictureTimesIt) {
  Pair pair(12, 9, 10), multiplied(12, 9, 10);
  pair.view.exposure = {0.5f, 2.0f, 1.0f};
  for (Pair* p : {&pair, &multiplied})
    for (std::uint8_t& value : p->view.photo.pixels) value /= 2;  // none is white
  for (std::size_t i = 0; i < pair.values(); ++i)
    multiplied.pass.image[i] *= pair.view.exposure[int(i / pair.pass.pixel_count())];
  const Result of_exposed = loss_of(pair), of_multiplied = loss_of(multiplied);
  EXPECT_EQ(of_exposed.value, of_multiplied.value);
  for (std::size_t i = 0; i < pair.values(); ++i)
    EXPECT_EQ(of_exposed.dL_dimage[i],
              of_multiplied.dL_dimage[i] * pair.view.exposure[int(i / pair.pass.pixel_count())]);
}

TEST(WeightedLoss, UnderAnExposureAsksOfAWhitePhotoThatThePictureIsNoDarker) {
  for (const float picture : {0.7f, 0.97f}) {
    for (const bool is_exposed : {false, true}) {
      Pair pair(6, 4, 16);
      if (is_exposed) pair.view.exposure = Vec3f(1.25f);
      std::fill(pair.view.photo.pixels.begin(), pair.view.photo.pixels.end(), std::uint8_t(240));
      for (float& value : pair.pass.image) value = picture / (is_exposed ? 1.25f : 1.0f);
      const Result result = loss_of(pair);
      const bool is_free = is_exposed && picture > 240 / 255.0f;
      EXPECT_EQ(result.value < 1e-6, is_free) << picture << " " << is_exposed;
      for (const float g : result.dL_dimage)
        if (is_free)
          EXPECT_NEAR(g, 0, 1e-6);
        else
          EXPECT_GT(std::abs(g), 1e-3);
    }
  }
}

TEST(WeightedLoss, OfAFullMaskIsThatWithoutOne) {
  const Pair plain(20, 15, 11);
  Pair masked(20, 15, 11);
  masked.view.mask = Image8(20, 15, 1, 255);
  expect_same(loss_of(plain), loss_of(masked));
}

TEST(WeightedLoss, DoesNotSeeWhatTheMaskCovers) {
  Pair pair(20, 15, 12), garbage(20, 15, 12);
  pair.weigh(false, 13);
  garbage.weigh(false, 13);
  std::size_t covered = 0;
  for (std::size_t i = 0; i < pair.pass.pixel_count(); ++i) {
    if (pair.view.mask.pixels[i] > 0) continue;
    ++covered;
    for (int c = 0; c < 3; ++c) {
      garbage.view.photo.pixels[3 * i + c] ^= 0xa5;
      garbage.pass.image[c * pair.pass.pixel_count() + i] += 5;
    }
  }
  ASSERT_GT(covered, 20u);
  const Result result = loss_of(pair);
  expect_same(result, loss_of(garbage));
  for (std::size_t i = 0; i < pair.pass.pixel_count(); ++i) {
    if (pair.view.mask.pixels[i] == 0) {
      ASSERT_EQ(result.dL_dimage[i], 0) << i;
    }
  }
}

TEST(PhotometricLossOfEqualPictures, IsZeroAndHasNoGradient) {
  Pair pair(20, 15, 4);
  for (int c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < pair.pass.pixel_count(); ++i)
      pair.pass.image[c * pair.pass.pixel_count() + i] =
          pair.view.photo.pixels[3 * i + c] * (1.0f / 255.0f);
  const Result result = loss_of(pair);
  EXPECT_NEAR(result.value, 0, 1e-6);
  // sign(0) = 0, otherwise a value would be 0.8 / 900; SSIM is at its maximum.
  for (const float g : result.dL_dimage) EXPECT_NEAR(g, 0, 1e-6);
}

TEST(L1, HasTheSignOfTheDifferenceAndZeroForNone) {
  Pair pair(3, 1, 5);
  pair.view.photo.pixels = {255, 255, 255, 0, 0, 0, 51, 51, 51};
  pair.pass.image.upload({1, 0.5f, 0.1f, 2, 0, 0.3f, 0, -1, 51 * (1.0f / 255.0f)});
  const Buffer<float> dL_dimage = loss_of(pair, 0).dL_dimage;
  const float n = 1.0f / 9;
  const float expected[] = {0, n, -n, n, 0, n, -n, -n, 0};
  for (int i = 0; i < 9; ++i) EXPECT_FLOAT_EQ(dL_dimage[i], expected[i]) << i;
}

TEST(PhotometricLoss, OfALaterPictureDoesNotDependOnAnEarlierOne) {
  const Pair large(40, 30, 6), small(12, 9, 7);
  const auto used = make_l1_ssim_loss();
  Buffer<float> gradient;
  used->forward_backward(large.pass, large.view, {0.2f}, gradient);
  used->forward_backward(small.pass, small.view, {0.2f}, gradient);
  expect_same({used->value(), std::move(gradient)}, loss_of(small));
}

}  // namespace
}  // namespace gs
