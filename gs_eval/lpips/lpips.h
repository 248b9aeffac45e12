// SPDX-License-Identifier: Apache-2.0
// LPIPS (Zhang, Isola, Efros, Shechtman, Wang 2018: "The Unreasonable Effectiveness of Deep Features
// as a Perceptual Metric"): how far the features of a network that recognizes things lie apart. The
// user gives the weights.
#pragma once

#include <memory>
#include <string>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_eval/compared_pictures.h"
#include "gs_eval/lpips/feature_network.h"
#include "gs_eval/lpips/lpips_weights.h"
#include "gs_eval/metrics.h"

namespace gs {

/// One thread at a time may use it.
class Lpips {
 public:
  /// Throws Error if the file does not hold such a network, and in a build without OpenCV's dnn.
  explicit Lpips(const std::string& file);
  Lpips(const Lpips&) = delete;
  Lpips& operator=(const Lpips&) = delete;

  /// 0 for identical pictures. At least one weight is above 0. Throws Error as check_size() does.
  double distance(const ComparedPictures& pictures);
  /// Throws UsageError for pictures that are too small to have features.
  void check_size(int width, int height) const;
  void check_sizes(const std::vector<View>& views) const;
  LpipsSource source() const { return {file_, weights_.network, weights_.hash}; }

 private:
  FeatureMap input_of(const ImageF& picture) const;

  std::string file_;
  LpipsWeights weights_;
  FeatureNetwork nets_;
};

/// The network that the settings name; null where they name none. Throws UsageError if there is no
/// such file, and Error as Lpips does.
std::unique_ptr<Lpips> make_lpips(const EvalConfig& settings);

}  // namespace gs
