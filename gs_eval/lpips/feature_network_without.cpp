// SPDX-License-Identifier: Apache-2.0
// For builds without OpenCV's module dnn.
#include "gs_core/error.h"
#include "gs_eval/lpips/feature_network.h"

namespace gs {

bool can_measure_lpips() { return false; }

struct FeatureNetwork::Nets {};

FeatureNetwork::FeatureNetwork(const std::vector<FeatureStage>&) {
  throw UsageError(
      "this build has no OpenCV with the module dnn, which LPIPS needs; measure without it here "
      "(--lpips none), and run `gemsplat eval RUN --lpips FILE` on a machine that has it (Debian: "
      "libopencv-dev)");
}

FeatureNetwork::~FeatureNetwork() = default;

FeatureMap FeatureNetwork::features(std::size_t, const FeatureMap&) { return {}; }

}  // namespace gs
