// SPDX-License-Identifier: Apache-2.0
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "data_loaders/lenses/resample.h"

namespace gs {

std::string resampler_name() { return "OpenCV " CV_VERSION; }

void resample(const Image8& photo, const PhotoPositions& positions, std::uint8_t* target) {
  const auto matrix = [](int height, int width, int type, const void* values) {
    return cv::Mat(height, width, type, const_cast<void*>(values));
  };
  const int type = CV_8UC(photo.channels);
  const cv::Mat source = matrix(photo.height, photo.width, type, photo.pixels.data());
  const cv::Mat x = matrix(positions.height, positions.width, CV_32F, positions.x.data());
  const cv::Mat y = matrix(positions.height, positions.width, CV_32F, positions.y.data());
  cv::Mat result = matrix(positions.height, positions.width, type, target);
  cv::remap(source, result, x, y, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
}

}  // namespace gs
