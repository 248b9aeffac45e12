// SPDX-License-Identifier: Apache-2.0
// One photo's appearance: what a photometric model makes of the scene's colors there, and the
// gradient of the numbers that say so.
#pragma once

#include <vector>

#include "gs_core/buffer.h"
#include "gs_core/image.h"
#include "gs_core/types.h"
#include "gs_render/render_pass.h"

namespace gs {

/// A picture as the renderer leaves it: three planes, (3, H, W).
struct Planes {
  const float* data;
  int width, height;

  std::size_t pixel_count() const { return std::size_t(width) * std::size_t(height); }
};

/// One row of a picture: the addresses of its three channels.
template <class T>
struct ColorRow {
  T* channel[3];
  int width;
};

/// A model derives from it and has the formulas of one row. Pictures are in host memory. Each call
/// uses all threads, and its result does not depend on their number.
class Appearance {
 public:
  /// `numbers`: how many the photo has.
  explicit Appearance(std::size_t numbers) : gradient_(numbers, 0.0) {}
  virtual ~Appearance() = default;

  /// Computes what the photo shows of a picture: shown().
  void show(const Planes& picture);
  /// Computes what the photo shows of the background alone: behind(). Only photos over a background
  /// need it.
  void show_background(const Vec3f& background, int width, int height);
  /// (3, H, W), not clamped.
  const std::vector<float>& shown() const { return shown_; }
  const std::vector<float>& behind() const { return behind_; }

  /// Turns dL/d(shown) into dL/d(picture), and computes gradient(). `picture` is that of show().
  ///
  /// shares   (H, W) how much of its gradient a pixel teaches the numbers; empty: all of it
  void pull_back(const Planes& picture, Span<float> dL_dshown, Span<const float> shares);
  /// dL/d(numbers). Rows are added up in their order.
  Span<const double> gradient() const { return {gradient_.data(), gradient_.size()}; }

 protected:
  /// What the photo shows of row y.
  virtual void show_row(int y, const ColorRow<const float>& colors,
                        const ColorRow<float>& shown) const = 0;
  /// Turns `gradient` by what is shown into that by the colors, and adds to `sums`, which has
  /// gradient().size numbers. `shares` may be null.
  virtual void pull_back_row(int y, const ColorRow<const float>& colors,
                             const ColorRow<float>& gradient, const float* shares,
                             double* sums) const = 0;

 private:
  std::vector<float> shown_, behind_;
  std::vector<double> gradient_, row_sums_;
};

/// The picture of the pass, in any memory, as the photo shows it; in 0..1. Calls show().
ImageF shown_image(const RenderPass& pass, Appearance& appearance);
/// What a photo shows of a picture in host memory.
ImageF shown_image(const Planes& picture, Appearance& appearance);

}  // namespace gs
