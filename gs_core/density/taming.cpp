// SPDX-License-Identifier: Apache-2.0
// The method "taming": a score draws the Gaussians that grow, and their number follows a parabola up
// to a budget.                                              Mallick et al. 2024, Taming 3DGS
//
// Source: the code of June 2025, github.com/humansensinglab/taming-3dgs. Its budgets,
// density.max_gaussians here, go by scene; 680,000 is their mean on Mip-NeRF 360. What differs: the
// score is the error alone, not a sum of nine terms; every faint Gaussian is pruned, not a random half; opacities are trained to the end.
#include "gs_core/density/growth_method.h"

namespace gs {
namespace {

constexpr int kPhotos = 10;

}  // namespace

GrowthMethod taming_method() {
  GrowthMethod method;
  method.score = GrowthScore::error;
  method.score_photos = kPhotos;
  method.select = GrowthSelection::race;
  method.curve = GrowthCurve::parabola;
  return method;
}

}  // namespace gs
