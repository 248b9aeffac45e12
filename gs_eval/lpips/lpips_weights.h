// SPDX-License-Identifier: Apache-2.0
// The networks of LPIPS, and their weights, which the user gives in a file. gemsplat has none of its
// own: docs/method/equations.md says why.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/system/safetensors.h"

namespace gs {

/// A convolution with a bias, and max(0, .) of its result.
struct Convolution {
  FloatArray weights;  // (out, in, kernel, kernel)
  FloatArray bias;     // (out)
  int stride = 1, padding = 0;

  int inputs() const { return int(weights.shape[1]); }
  int outputs() const { return int(weights.shape[0]); }
  int kernel() const { return int(weights.shape[2]); }
};

/// The layers between the features of one stage and those of the next.
struct FeatureStage {
  int pool = 0;  // before the convolutions: the maximum of pool x pool values, every 2nd; 0: none
  std::vector<Convolution> convolutions;
};

/// What a file holds.
struct LpipsWeights {
  std::string network;                 // "alex" or "vgg", the names in Python's package `lpips`
  std::array<double, 3> shift, scale;  // of the colors in [-1, 1]: (color - shift) / scale
  std::vector<FeatureStage> stages;
  std::vector<std::vector<float>> importance;  // of each channel, for each stage
  std::string hash;                            // of the file (SafetensorsFile)
};

/// Reads the state_dict() of the Python package `lpips` with AlexNet or VGG-16. Channels may be of
/// any number, kernels have the networks' sizes. Throws Error, which names the file.
LpipsWeights read_lpips_weights(const std::filesystem::path& file);

/// The shorter side of the smallest picture that has features in each stage.
int smallest_picture(const std::vector<FeatureStage>& stages);

}  // namespace gs
