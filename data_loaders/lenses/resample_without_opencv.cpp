// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/lenses/resample.h"

namespace gs {

std::string resampler_name() { return "gemsplat 1"; }

void resample(const Image8& photo, const PhotoPositions& positions, std::uint8_t* target) {
  resample_bicubic(photo, positions, target);
}

}  // namespace gs
