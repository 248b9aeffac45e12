// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/appearance.h"

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/renderer.h"

namespace gs {
namespace {

constexpr std::size_t kRowsAtATime = 8;

template <class T>
ColorRow<T> row_of(T* planes, int width, int height, std::size_t y) {
  const std::size_t plane = std::size_t(width) * std::size_t(height), at = y * std::size_t(width);
  return {{planes + at, planes + plane + at, planes + 2 * plane + at}, width};
}

}  // namespace

void Appearance::show(const Planes& picture) {
  shown_.resize(3 * picture.pixel_count());
  parallel_for(std::size_t(picture.height), kRowsAtATime, [&](std::size_t y) {
    show_row(int(y), row_of(picture.data, picture.width, picture.height, y),
             row_of(shown_.data(), picture.width, picture.height, y));
  });
}

void Appearance::show_background(const Vec3f& background, int width, int height) {
  behind_.resize(3 * std::size_t(width) * std::size_t(height));
  std::vector<float> colors(3 * std::size_t(width));
  for (std::size_t i = 0; i < colors.size(); ++i)
    colors[i] = background[int(i / std::size_t(width))];
  const ColorRow<const float> row = row_of<const float>(colors.data(), width, 1, 0);
  parallel_for(std::size_t(height), kRowsAtATime, [&](std::size_t y) {
    show_row(int(y), row, row_of(behind_.data(), width, height, y));
  });
}

void Appearance::pull_back(const Planes& picture, Span<float> dL_dshown, Span<const float> shares) {
  GS_CHECK(dL_dshown.size == 3 * picture.pixel_count());
  const std::size_t numbers = gradient_.size(), rows = std::size_t(picture.height);
  row_sums_.assign(rows * numbers, 0.0);
  parallel_for(rows, kRowsAtATime, [&](std::size_t y) {
    pull_back_row(int(y), row_of(picture.data, picture.width, picture.height, y),
                  row_of(dL_dshown.data, picture.width, picture.height, y),
                  shares.empty() ? nullptr : shares.data + y * std::size_t(picture.width),
                  row_sums_.data() + y * numbers);
  });
  gradient_.assign(numbers, 0.0);
  for (std::size_t i = 0; i < row_sums_.size(); ++i) gradient_[i % numbers] += row_sums_[i];
}

ImageF shown_image(const RenderPass& pass, Appearance& appearance) {
  const std::vector<float> planes = pass.image.download();
  return shown_image({planes.data(), pass.width, pass.height}, appearance);
}

ImageF shown_image(const Planes& picture, Appearance& appearance) {
  appearance.show(picture);
  const std::vector<float>& shown = appearance.shown();
  return image_of({shown.data(), shown.size()}, picture.width, picture.height);
}

}  // namespace gs
