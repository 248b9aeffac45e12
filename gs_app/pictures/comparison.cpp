// SPDX-License-Identifier: Apache-2.0
#include "gs_app/pictures/comparison.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "data_loaders/photos/photos.h"
#include "gs_app/pictures/color_ramp.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_core/types.h"
#include "gs_eval/flip/flip.h"

namespace gs {
namespace {

constexpr int kMinPanelWidth = 320, kMaxPanelWidth = 640;  // pixels
constexpr int kGap = 4;                                    // pixels between panels of one view
constexpr int kMargin = 16;                                // pixels around views
// A quarter of the range becomes full scale.
constexpr float kErrorGain = 4;

/// Weights of the four pixels around a position that lies `t` after the second.
///                                                              Catmull-Rom (Keys 1981, a = -1/2)
std::array<float, 4> cubic_weights(float t) {
  return {((-0.5f * t + 1.0f) * t - 0.5f) * t, (1.5f * t - 2.5f) * t * t + 1.0f,
          ((-1.5f * t + 2.0f) * t + 0.5f) * t, (0.5f * t - 0.5f) * t * t};
}

/// A larger picture by cubic interpolation. It is for people only: no metric is computed on it.
Image8 enlarged(const Image8& image, int width, int height) {
  Image8 result(width, height, 3);
  for (int y = 0; y < height; ++y) {
    const float v = (float(y) + 0.5f) * float(image.height) / float(height) - 0.5f;
    const auto wy = cubic_weights(v - std::floor(v));
    for (int x = 0; x < width; ++x) {
      const float u = (float(x) + 0.5f) * float(image.width) / float(width) - 0.5f;
      const auto wx = cubic_weights(u - std::floor(u));
      Vec3f sum(0);
      for (int j = 0; j < 4; ++j) {
        const int row = std::clamp(int(std::floor(v)) + j - 1, 0, image.height - 1);
        for (int i = 0; i < 4; ++i) {
          const int column = std::clamp(int(std::floor(u)) + i - 1, 0, image.width - 1);
          for (int c = 0; c < 3; ++c) sum[c] += wx[i] * wy[j] * float(image.at(column, row, c));
        }
      }
      for (int c = 0; c < 3; ++c)
        result.at(x, y, c) = std::uint8_t(std::clamp(sum[c] + 0.5f, 0.0f, 255.0f));
    }
  }
  return result;
}

Image8 at_width(const Image8& image, int width) {
  const int height = std::max(1, int(std::lround(double(image.height) * width / image.width)));
  return width > image.width ? enlarged(image, width, height) : area_resized(image, width, height);
}

void paste(const Image8& picture, int left, int top, Image8& canvas) {
  for (int y = 0; y < picture.height; ++y) {
    const auto from = picture.pixels.begin() + std::ptrdiff_t(y) * picture.width * 3;
    std::copy(from, from + picture.width * 3, &canvas.at(left, top + y, 0));
  }
}

}  // namespace

Image8 error_picture(const Image8& photo, const Image8& render) {
  Image8 result(photo.width, photo.height, 3);
  for (std::size_t i = 0; i < photo.pixels.size(); i += 3) {
    int difference = 0;
    for (int c = 0; c < 3; ++c)
      difference += std::abs(int(photo.pixels[i + c]) - int(render.pixels[i + c]));
    const Rgb& color =
        color_ramp()[std::size_t(std::min(kErrorGain * float(difference) / 3, 255.0f))];
    std::copy(color.begin(), color.end(), result.pixels.begin() + std::ptrdiff_t(i));
  }
  return result;
}

Image8 flip_picture(const Image8& photo, const Image8& render) {
  const auto in_float = [](const Image8& image) {
    ImageF result(image.width, image.height, image.channels);
    std::transform(image.pixels.begin(), image.pixels.end(), result.pixels.begin(),
                   [](std::uint8_t value) { return value * kPerByte; });
    return result;
  };
  const ImageF map = flip_map(in_float(render), in_float(photo));
  Image8 result(map.width, map.height, 3);
  for (std::size_t i = 0; i < map.pixels.size(); ++i) {
    const Rgb& color = color_ramp()[std::size_t(std::lround(255 * map.pixels[i]))];
    std::copy(color.begin(), color.end(), result.pixels.begin() + std::ptrdiff_t(3 * i));
  }
  return result;
}

Image8 side_by_side(const Image8& left, const Image8& right) {
  Image8 canvas(left.width + kGap + right.width, std::max(left.height, right.height), 3, 255);
  paste(left, 0, 0, canvas);
  paste(right, left.width + kGap, 0, canvas);
  return canvas;
}

Image8 comparison_picture(const std::vector<Comparison>& comparisons) {
  GS_CHECK(!comparisons.empty());
  const Image8& first = comparisons.front().photo;
  const int width = std::clamp(first.width, kMinPanelWidth, kMaxPanelWidth);
  const int columns = first.height > first.width && comparisons.size() > 1 ? 2 : 1;

  std::vector<std::array<Image8, 3>> views(comparisons.size());
  parallel_for(3 * views.size(), 1, [&](std::size_t i) {
    const auto& [photo, render] = comparisons[i / 3];
    const std::size_t panel = i % 3;
    views[i / 3][panel] = at_width(panel == 0   ? photo
                                   : panel == 1 ? render
                                                : error_picture(photo, render),
                                   width);
  });
  int height = 0;  // of the tallest
  for (const auto& view : views) height = std::max(height, view[0].height);
  const int rows = (int(views.size()) + columns - 1) / columns;
  const int view_width = 3 * width + 2 * kGap;
  Image8 canvas(kMargin + columns * (view_width + kMargin), kMargin + rows * (height + kMargin), 3,
                255);
  for (int i = 0; i < int(views.size()); ++i) {
    const int left = kMargin + i % columns * (view_width + kMargin);
    const int top = kMargin + i / columns * (height + kMargin);
    for (int panel = 0; panel < 3; ++panel)
      paste(views[std::size_t(i)][std::size_t(panel)], left + panel * (width + kGap), top, canvas);
  }
  return canvas;
}

}  // namespace gs
