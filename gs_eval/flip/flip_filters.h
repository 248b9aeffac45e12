// SPDX-License-Identifier: Apache-2.0
// The filters of FLIP (Andersson et al. 2020), as separable parts.
#pragma once

#include "gs_eval/row_filter.h"

namespace gs {

/// Filters that are applied along the rows and across them. Each two-dimensional filter is a
/// product of two, except that of the blue-yellow channel, a weighted sum of two such products.
struct FlipFilters {
  // What of a channel's contrast an observer sees; weights add up to 1.
  RowFilter achromatic, red_green, blue_yellow[2];
  double blue_yellow_share[2];  // add up to 1

  // For edges and points: a Gaussian, and its first and second derivatives. The positive weights of
  // a derivative add up to 1, and the negative ones to -1.
  RowFilter feature, feature_slope, feature_curve;

  /// The larger radius of all, in pixels.
  int radius() const;
};

/// For an observer to whom a degree has this many pixels.
FlipFilters flip_filters(double pixels_per_degree);

}  // namespace gs
