// SPDX-License-Identifier: Apache-2.0
// Stands in for refine_*.cpp in a build without Ceres: says what is missing.
#include <spdlog/fmt/fmt.h>

#include "data_loaders/refine/refine_cameras.h"
#include "data_loaders/refine/refine_exposure.h"
#include "gs_core/error.h"

namespace gs {

bool can_refine() { return false; }

void check_can_refine(const char* option) {
  throw Error(
      fmt::format("{} needs Ceres, and this build has none; install libceres-dev and build again, "
                  "or leave it out",
                  option));
}

ExposureFit fit_exposures(const std::vector<ColorSample>&, const std::vector<bool>&) {
  GS_CHECK(can_refine());
  return {};
}

double spread_of(const std::vector<ColorSample>&, std::size_t) {
  GS_CHECK(can_refine());
  return 0;
}

CameraRefinement refine_cameras(ColmapModel&, const RefinementProgress&) {
  GS_CHECK(can_refine());
  return {};
}

}  // namespace gs
