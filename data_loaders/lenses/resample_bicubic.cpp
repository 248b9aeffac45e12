// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>

#include "data_loaders/lenses/resample.h"

namespace gs {
namespace {

/// Four neighbors in one direction: their rows or columns in the photo, and their weights.
struct Neighbors {
  std::array<int, 4> at;
  std::array<float, 4> weight;
};

/// The weights w(t) of neighbors at distance t                                        Keys 1981
///
///   |t| <= 1:  (a + 2) |t|^3 - (a + 3) |t|^2 + 1
///   |t| <  2:  a |t|^3 - 5a |t|^2 + 8a |t| - 4a,      a = -0.75
std::array<float, 4> cubic_weights(float fraction) {
  constexpr float a = -0.75f;
  const auto near_weight = [](float t) { return ((a + 2) * t - (a + 3)) * t * t + 1; };
  const auto far_weight = [](float t) { return ((a * t - 5 * a) * t + 8 * a) * t - 4 * a; };
  return {far_weight(fraction + 1), near_weight(fraction), near_weight(1 - fraction),
          far_weight(2 - fraction)};
}

/// The neighbors of `position` among `size` pixels. Positions far outside, and NaN, are moved to
/// where all neighbors are the border pixel.
Neighbors neighbors(float position, int size) {
  constexpr float kBefore = -3;
  const float bounded = position > kBefore ? std::min(position, float(size) + 2) : kBefore;
  const int floor = int(std::floor(bounded));
  Neighbors result;
  result.weight = cubic_weights(bounded - float(floor));
  for (int i = 0; i < 4; ++i) result.at[i] = std::clamp(floor + i - 1, 0, size - 1);
  return result;
}

std::uint8_t rounded(float value) { return std::uint8_t(std::clamp(value, 0.0f, 255.0f) + 0.5f); }

}  // namespace

void resample_bicubic(const Image8& photo, const PhotoPositions& positions, std::uint8_t* target) {
  for (std::size_t i = 0; i < positions.x.size(); ++i) {
    const Neighbors columns = neighbors(positions.x[i], photo.width);
    const Neighbors rows = neighbors(positions.y[i], photo.height);
    for (int c = 0; c < photo.channels; ++c) {
      float sum = 0;
      for (int row = 0; row < 4; ++row) {
        float of_row = 0;
        for (int column = 0; column < 4; ++column)
          of_row += columns.weight[column] * photo.at(columns.at[column], rows.at[row], c);
        sum += rows.weight[row] * of_row;
      }
      *target++ = rounded(sum);
    }
  }
}

}  // namespace gs
