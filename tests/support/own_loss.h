// SPDX-License-Identifier: Apache-2.0
// A loss that a program brings, for any backend.
#pragma once

#include <cmath>
#include <vector>

#include "gs_core/memory.h"
#include "gs_train/loss.h"

namespace gs {

/// The mean of absolute differences, computed on the host; where it sees depth, and the means of
/// alpha and of a tenth of the depth.
inline LossFunction l1_loss_in(Memory& memory) {
  return [&memory](const ComparedPicture& compared) {
    const auto pixels = std::size_t(compared.camera.width) * std::size_t(compared.camera.height);
    std::vector<float> image(3 * pixels), gradient(3 * pixels);
    std::vector<std::uint8_t> photo(3 * pixels);
    memory.download(image.data(), compared.image, image.size() * sizeof(float));
    memory.download(photo.data(), compared.photo.photo, photo.size());
    double sum = 0;
    for (std::size_t k = 0; k < image.size(); ++k) {
      const float difference = image[k] - float(photo[k % pixels * 3 + k / pixels]) / 255;
      sum += std::abs(difference);
      gradient[k] = float((difference > 0) - (difference < 0)) / float(image.size());
    }
    memory.upload(compared.dL_dimage, gradient.data(), gradient.size() * sizeof(float));
    double value = sum / double(image.size());
    if (!compared.depth) return value;
    const float share = 1 / float(pixels), depth_share = 0.1f * share;
    std::vector<float> left(pixels), depth(pixels);
    memory.download(left.data(), compared.transmittance, pixels * sizeof(float));
    memory.download(depth.data(), compared.depth, pixels * sizeof(float));
    for (std::size_t i = 0; i < pixels; ++i)
      value += double(share) * double(1 - left[i]) + double(depth_share) * double(depth[i]);
    left.assign(pixels, share);
    depth.assign(pixels, depth_share);
    memory.upload(compared.dL_dalpha, left.data(), pixels * sizeof(float));
    memory.upload(compared.dL_ddepth, depth.data(), pixels * sizeof(float));
    return value;
  };
}

}  // namespace gs
