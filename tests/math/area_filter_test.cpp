// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/loss/area_filter.h"

#include <cstdlib>

#include "gs_core/math/loss/photo_weight.h"
#include "tests/support/test.h"

namespace gs {
namespace {

PinholeCamera<double> some_camera() {
  PinholeCamera<double> camera;
  camera.width = 131, camera.height = 77;
  camera.fx = 90, camera.fy = 110, camera.cx = 61.3, camera.cy = 40.7;
  camera.time = 0.25;
  return camera;
}

/// Bytes from 0 to 255 without an order.
std::vector<std::uint8_t> some_bytes(std::size_t count, std::uint32_t seed) {
  std::vector<std::uint8_t> bytes(count);
  for (std::uint8_t& byte : bytes) byte = std::uint8_t((seed = seed * 1664525 + 1013904223) >> 24);
  return bytes;
}

TEST(ReducedCamera, SeesEachPointAtAFractionOfItsPlace) {
  const PinholeCamera<double> whole = some_camera(), small = reduced(whole, 4);
  EXPECT_EQ(small.width, 32);
  EXPECT_EQ(small.height, 19);
  EXPECT_EQ(small.time, whole.time);
  for (const Vec3d& point : {Vec3d(0.3, -0.2, 2), Vec3d(-1, 0.5, 7)}) {
    const auto place = [&](const PinholeCamera<double>& camera) {
      return Vec2<double>(camera.fx * point.x / point.z + camera.cx,
                          camera.fy * point.y / point.z + camera.cy);
    };
    EXPECT_DOUBLE_EQ(place(small).x, place(whole).x / 4);
    EXPECT_DOUBLE_EQ(place(small).y, place(whole).y / 4);
  }
}

// 5 x 3 pixels, reduced twice: two blocks side by side. The last column and row belong to none.
TEST(ReducedPhoto, IsTheRoundedMeanOfWholeBlocks) {
  const std::vector<std::uint8_t> gray = {10,  20,  30,  40,  255,  //
                                          11,  21,  32,  41,  255,  //
                                          255, 255, 255, 255, 255};
  std::vector<std::uint8_t> photo;
  for (const std::uint8_t value : gray)
    photo.insert(photo.end(), {value, std::uint8_t(255 - value), 7});
  const PhotoBytes bytes{photo.data(), nullptr};
  EXPECT_EQ(reduced_value(bytes, 5, 2, 0, 0, 0), 16);   // 62 / 4 = 15.5
  EXPECT_EQ(reduced_value(bytes, 5, 2, 1, 0, 0), 36);   // 143 / 4 = 35.75
  EXPECT_EQ(reduced_value(bytes, 5, 2, 1, 0, 1), 219);  // 877 / 4 = 219.25
  EXPECT_EQ(reduced_value(bytes, 5, 2, 1, 0, 2), 7);
}

TEST(ReducedPhoto, OfASinglePixelAMaskDoesNotChangeIt) {
  const std::vector<std::uint8_t> photo = some_bytes(3 * 6, 1), mask = {0, 255, 3, 128, 1, 254};
  const PhotoBytes bytes{photo.data(), mask.data()};
  for (int x = 0; x < 3; ++x) {
    for (int c = 0; c < 3; ++c)
      EXPECT_EQ(reduced_value(bytes, 3, 1, x, 1, c), photo[std::size_t(3 * (3 + x) + c)]);
    EXPECT_EQ(reduced_mask(bytes, 3, 1, x, 1), mask[std::size_t(3 + x)]);
  }
}

// A person whom a mask hides has no part in the color beside it.
TEST(ReducedPhoto, LeavesOutPixelsThatDoNotTrain) {
  const std::vector<std::uint8_t> photo = {100, 100, 100, 250, 0, 9, 250, 0, 9, 104, 100, 100};
  const std::vector<std::uint8_t> mask = {255, 0, 0, 255}, none(4, 0);
  EXPECT_EQ(reduced_value({photo.data(), mask.data()}, 2, 2, 0, 0, 0), 102);
  EXPECT_EQ(reduced_mask({photo.data(), mask.data()}, 2, 2, 0, 0), 128);
  EXPECT_EQ(reduced_value({photo.data(), none.data()}, 2, 2, 0, 0, 0), 176);  // the plain mean
  EXPECT_EQ(reduced_mask({photo.data(), none.data()}, 2, 2, 0, 0), 0);
}

// What the loss compares at a reduced pixel is the mean of what it compares at its pixels, whether
// the mask says what trains or what is covered. Mask and value are rounded to 1 / 255 each.
TEST(ReducedPhoto, IsComparedAsTheMeanOfItsPixels) {
  constexpr int kFactor = 4, kWidth = 3 * kFactor;
  const std::vector<std::uint8_t> photo = some_bytes(3 * kWidth * 2 * kFactor, 5),
                                  mask = some_bytes(kWidth * 2 * kFactor, 9);
  const PhotoBytes bytes{photo.data(), mask.data()};
  const auto compared = [](double m, double y, bool over_background) {
    const PhotoWeight<double> weight = photo_weight(m, 1.0, 0.75, over_background);
    return weight.cover * y + weight.backdrop;
  };
  for (const bool over_background : {false, true})
    for (int y = 0; y < 2; ++y)
      for (int x = 0; x < 3; ++x)
        for (int c = 0; c < 3; ++c) {
          double mean = 0;
          for (int j = 0; j < kFactor; ++j)
            for (int i = 0; i < kFactor; ++i) {
              const std::size_t pixel = std::size_t((y * kFactor + j) * kWidth + x * kFactor + i);
              mean += compared(mask[pixel] / 255.0, photo[3 * pixel + std::size_t(c)] / 255.0,
                               over_background);
            }
          mean /= kFactor * kFactor;
          const double reduced =
              compared(reduced_mask(bytes, kWidth, kFactor, x, y) / 255.0,
                       reduced_value(bytes, kWidth, kFactor, x, y, c) / 255.0, over_background);
          EXPECT_NEAR(reduced, mean, 1.0 / 255);
        }
}

// Sixteen times sixteen white pixels under a white mask are the largest sum: it fits 32 bits.
TEST(ReducedPhoto, SumsOfTheLargestFactorDoNotOverflow) {
  const std::vector<std::uint8_t> white(3 * 16 * 16, 255);
  EXPECT_EQ(reduced_value({white.data(), white.data()}, 16, 16, 0, 0, 2), 255);
  EXPECT_EQ(reduced_mask({white.data(), white.data()}, 16, 16, 0, 0), 255);
}

}  // namespace
}  // namespace gs
