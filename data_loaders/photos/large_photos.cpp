// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/large_photos.h"

#include <spdlog/fmt/fmt.h>

namespace gs {
namespace {

constexpr double kLargePixels = 6e6;  // more seldom shows in the result, and takes memory and time
constexpr int kUsualWidth = 1600;     // pixels, to which Kerbl et al.'s trainer reduces photos

}  // namespace

std::string advice_on_large_photos(const PhotoSize& largest, int resolution) {
  const double scale = resolution <= 8 ? 1.0 / resolution : double(resolution) / largest.width;
  const double pixels = double(largest.width) * double(largest.height);
  if (pixels * scale * scale <= kLargePixels || largest.width <= kUsualWidth) return "";
  const double share = double(kUsualWidth) / (scale * largest.width);
  return fmt::format(
      "the photos train at {:.0f} megapixels; -r {} trains at a width of {} pixels, which takes "
      "{:.0f} % of the memory and time for photos",
      1e-6 * pixels * scale * scale, kUsualWidth, kUsualWidth, 100 * share * share);
}

}  // namespace gs
