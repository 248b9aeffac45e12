// SPDX-License-Identifier: Apache-2.0
// Color correction of a render by its photo, one channel: what is left is not a matter of exposure.
#pragma once

namespace gs {

/// render = slope * photo + offset
struct ColorLine {
  double slope = 1, offset = 0;

  /// The render's value as the photo would have it, in 0..1.
  double corrected(double x) const;
};

/// The line of least squares from photo to render, over the pixels that were added. It is inverted
/// afterwards, as Mildenhall et al. 2022 (RawNeRF) do. If a photo or a render has one value all
/// over, only the means are made equal.
class ColorFit {
 public:
  /// One value of the render and of the photo, and the share of its pixel.
  void add(double render, double photo, double share);
  ColorLine line() const;

 private:
  double share_ = 0, x_ = 0, y_ = 0, xy_ = 0, yy_ = 0;
};

}  // namespace gs
