// SPDX-License-Identifier: Apache-2.0
// Stage 5: the photometric loss against its definition in double, and its gradient against the slope of that.
#include <gtest/gtest.h>

#include <cmath>

#include "gs_core/math/ssim.h"
#include "gs_train/scalar_stages.h"
#include "gs_train/window.h"
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

class WindowMeans : public ::testing::TestWithParam<std::pair<int, int>> {};
INSTANTIATE_TEST_SUITE_P(Sizes, WindowMeans,
                         ::testing::Values(std::pair{1, 1}, std::pair{3, 20}, std::pair{20, 3},
                                           std::pair{10, 11}, std::pair{5, 6}, std::pair{37, 26}));

TEST_P(WindowMeans, AreTheTwoDimensionalConvolution) {
  const auto [width, height] = GetParam();
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
    // Near the photo, as while training: SSIM is far from its constants then.
    for (int c = 0; c < 3; ++c)
      for (std::size_t i = 0; i < pass.pixel_count(); ++i)
        pass.image[c * pass.pixel_count() + i] =
            0.7f * float(target(c, i)) + draws.uniform(0, 0.3f);
  }
  double target(int c, std::size_t i) const { return view.photo.pixels[3 * i + c] / 255.0; }
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
          const auto at = [&](int u, int v) { return X[c * plane + index(u, v)]; };
          const auto photo = [&](int u, int v) { return target(c, index(u, v)); };
          const auto mean = [&](auto&& f) { return window_mean(x, y, pass.width, pass.height, f); };
          l1 += std::abs(at(x, y) - photo(x, y));
          ssim += ssim_index(LocalMoments<double>{
              mean(at), mean(photo), mean([&](int u, int v) { return at(u, v) * at(u, v); }),
              mean([&](int u, int v) { return photo(u, v) * photo(u, v); }),
              mean([&](int u, int v) { return at(u, v) * photo(u, v); })});
        }
    return (1 - lambda) * l1 / double(X.size()) + lambda * (1 - ssim / double(X.size()));
  }
};

class PhotometricLoss : public ::testing::TestWithParam<std::pair<int, int>> {
 protected:
  const std::unique_ptr<Loss> loss_ = make_scalar_loss();
  Buffer<float> dL_dimage_;
};
INSTANTIATE_TEST_SUITE_P(Sizes, PhotometricLoss,
                         ::testing::Values(std::pair{23, 14}, std::pair{4, 6}, std::pair{1, 1}));

TEST_P(PhotometricLoss, HasTheValueOfItsDefinition) {
  const Pair pair(GetParam().first, GetParam().second, 2);
  for (const float lambda : {0.0f, 0.2f, 1.0f}) {
    loss_->forward_backward(pair.pass, pair.view, lambda, dL_dimage_);
    EXPECT_NEAR(loss_->value(), pair.loss(pair.image(), lambda), 2e-6);  // float moments
  }
}

TEST_P(PhotometricLoss, HasTheGradientOfItsDefinition) {
  const Pair pair(GetParam().first, GetParam().second, 3);
  constexpr double h = 1e-5;
  for (const float lambda : {0.2f, 1.0f}) {
    loss_->forward_backward(pair.pass, pair.view, lambda, dL_dimage_);
    ASSERT_EQ(dL_dimage_.size(), pair.values());
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
      worst = std::max(worst, std::abs(slope - dL_dimage_[i]));
    }
    // Float rounds moments at 6e-8, their differences and quotients at some ten times that.
    EXPECT_LT(worst / largest, 5e-6);
  }
}

TEST(PhotometricLossOfEqualPictures, IsZeroAndHasNoGradient) {
  Pair pair(20, 15, 4);
  for (int c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < pair.pass.pixel_count(); ++i)
      pair.pass.image[c * pair.pass.pixel_count() + i] =
          pair.view.photo.pixels[3 * i + c] * (1.0f / 255.0f);
  const auto loss = make_scalar_loss();
  Buffer<float> dL_dimage;
  loss->forward_backward(pair.pass, pair.view, 0.2f, dL_dimage);
  EXPECT_NEAR(loss->value(), 0, 1e-6);
  // sign(0) = 0, or a value would be 0.8 / 900; SSIM is at its maximum.
  for (const float g : dL_dimage) EXPECT_NEAR(g, 0, 1e-6);
}

TEST(L1, HasTheSignOfTheDifferenceAndZeroForNone) {
  Pair pair(3, 1, 5);
  pair.view.photo.pixels = {255, 255, 255, 0, 0, 0, 51, 51, 51};
  pair.pass.image.upload({1, 0.5f, 0.1f, 2, 0, 0.3f, 0, -1, 51 * (1.0f / 255.0f)});
  const auto loss = make_scalar_loss();
  Buffer<float> dL_dimage;
  loss->forward_backward(pair.pass, pair.view, 0, dL_dimage);
  const float n = 1.0f / 9;
  const float expected[] = {0, n, -n, n, 0, n, -n, -n, 0};
  for (int i = 0; i < 9; ++i) EXPECT_FLOAT_EQ(dL_dimage[i], expected[i]) << i;
}

TEST(PhotometricLoss, OfALaterPictureDoesNotDependOnAnEarlierOne) {
  const Pair large(40, 30, 6), small(12, 9, 7);
  const auto used = make_scalar_loss(), fresh = make_scalar_loss();
  Buffer<float> a, b;
  used->forward_backward(large.pass, large.view, 0.2f, a);
  used->forward_backward(small.pass, small.view, 0.2f, a);
  fresh->forward_backward(small.pass, small.view, 0.2f, b);
  EXPECT_EQ(a.download(), b.download());
  EXPECT_EQ(used->value(), fresh->value());
}

}  // namespace
}  // namespace gs
