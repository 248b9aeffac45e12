// SPDX-License-Identifier: Apache-2.0
// In a score pass: the value of each pixel that a score of density control sums over the fragments of
// a Gaussian.
#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/image.h"
#include "gs_core/math/loss/photo_weight.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_train/stages/scalar_stages.h"
#include "gs_train/stages/shown_values.h"

namespace gs {
namespace {

constexpr std::size_t kPixelsAtATime = 4096;

// The mean absolute difference of the channels, of what the loss compares (photo_weight.h).
void find_errors(const View& view, const RenderPass& pass, const Appearance* appearance,
                 Buffer<float>& values) {
  const std::size_t plane = pass.pixel_count();
  const ShownValues shown(view, pass, appearance);
  parallel_for(plane, kPixelsAtATime, [&](std::size_t i) {
    const float m = view.mask.empty() ? 1.0f : view.mask.pixels[i] * kPerByte;
    float sum = 0;
    for (int c = 0; c < 3; ++c) {
      const PhotoWeight<float> weight = shown.weight(m, c, i);
      const float x = weight.gain * shown.picture()[c * plane + i];
      const float y = view.photo.pixels[3 * i + c] * kPerByte;
      sum += std::abs(x - compared_photo(x, weight.cover * y + weight.backdrop, y, shown.white()));
    }
    values[i] = sum / 3.0f;
  });
}

// |-8 g + the sum of its eight neighbors| of the gray photo; pixels beyond the border repeat it.
void find_edges(const View& view, const RenderPass& pass, Buffer<float>& values) {
  const Image8& photo = view.photo;
  const auto gray = [&](int x, int y) {
    x = std::clamp(x, 0, photo.width - 1);
    y = std::clamp(y, 0, photo.height - 1);
    const std::uint8_t* const rgb =
        photo.pixels.data() + 3 * (std::size_t(y) * photo.width + std::size_t(x));
    return (rgb[0] + rgb[1] + rgb[2]) * (kPerByte / 3.0f);
  };
  parallel_for(std::size_t(pass.height), 8, [&](std::size_t row) {
    const int y = int(row);
    for (int x = 0; x < pass.width; ++x) {
      float sum = -9.0f * gray(x, y);
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) sum += gray(x + dx, y + dy);
      values[row * std::size_t(pass.width) + std::size_t(x)] = std::abs(sum);
    }
  });
}

// To the range 0 to 1 of the view. A view of one value has zeros.
void stretch(Span<float> values) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const float from = *low, range = *high - *low;
  const float scale = range > 0 ? 1 / range : 0;
  parallel_for(values.size, kPixelsAtATime,
               [=](std::size_t i) { values[i] = (values[i] - from) * scale; });
}

}  // namespace

void find_pixel_values(const View& view, const PixelRule& rule, const RenderPass& pass,
                       const Appearance* appearance, Buffer<float>& values) {
  const HostStage stage("pixel values");
  GS_CHECK(view.photo.width == pass.width && view.photo.height == pass.height);
  values.resize_discard(pass.pixel_count());
  if (rule.score == GrowthScore::edge)
    find_edges(view, pass, values);
  else
    find_errors(view, pass, appearance, values);
  if (rule.score == GrowthScore::error) return;
  stretch(values.span());
  if (rule.score == GrowthScore::edge) return;
  parallel_for(values.size(), kPixelsAtATime,
               [&](std::size_t i) { values[i] = values[i] > rule.mask_error ? 1.0f : 0.0f; });
}

}  // namespace gs
