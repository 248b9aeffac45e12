// SPDX-License-Identifier: Apache-2.0
// The method "dash_gaussian": photos are reduced at first, and the number of Gaussians follows their
// size.                                                                              DashGaussian
//
// Source: the code of December 2025, github.com/YouyuChen0207/DashGaussian. What differs: its limit
// is found from the growth, about 2.4 million on Mip-NeRF 360, and is density.max_gaussians here;
// the number follows photos whose spectrum falls as 1 / frequency, not the measured spectrum.
#include "gs_core/density/growth_method.h"

namespace gs {
namespace {

constexpr float kRampFrom = 4;  // times smaller than the photos: the first pictures of its code
constexpr float kMostGrowth = 0.2f;

}  // namespace

GrowthMethod dash_gaussian_method() {
  GrowthMethod method;
  method.curve = GrowthCurve::ramp;
  method.ramp_from = kRampFrom;
  method.most_growth = kMostGrowth;
  return method;
}

}  // namespace gs
