// SPDX-License-Identifier: Apache-2.0
// The method "absgs": the gradient of a mean sums absolute values over pixels, so that pixels that
// pull a large Gaussian to two sides do not cancel.                        Ye et al. 2024, AbsGS
//
// Such sums are about four times as large; the preset absgs has the threshold that fits them.
#include "gs_core/density/growth_method.h"

namespace gs {

GrowthMethod absgs_method() {
  GrowthMethod method;
  method.absolute_gradient = true;
  return method;
}

}  // namespace gs
