// SPDX-License-Identifier: Apache-2.0
// The convolutions of a network, by OpenCV's module dnn. A build without it has no such network.
#pragma once

#include <memory>
#include <vector>

#include "gs_eval/lpips/lpips_weights.h"

namespace gs {

/// What a stage of a network says of a picture, or the picture itself.
struct FeatureMap {
  int channels = 0, height = 0, width = 0;
  std::vector<float> values;  // (channels, height, width)

  const float* row(int channel, int y) const {
    return values.data() + (std::size_t(channel) * height + y) * width;
  }
};

/// Whether this build has OpenCV's module dnn.
bool can_measure_lpips();

/// One thread at a time may use it.
class FeatureNetwork {
 public:
  /// Throws Error in a build without OpenCV's dnn. `stages` outlives the network.
  explicit FeatureNetwork(const std::vector<FeatureStage>& stages);
  ~FeatureNetwork();

  /// The features of one stage, from those of the stage before it. Throws Error if the memory does
  /// not suffice.
  FeatureMap features(std::size_t stage, const FeatureMap& before);

 private:
  struct Nets;
  std::unique_ptr<Nets> nets_;
};

}  // namespace gs
