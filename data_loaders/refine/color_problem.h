// SPDX-License-Identifier: Apache-2.0
// What the problems over the colors of points share: those of refine_exposure.cpp and of
// refine_vignetting.cpp. Only for files that are built with Ceres.
#pragma once

#include <ceres/ceres.h>

namespace gs {

// Display sRGB: the difference of one point's color between well-fitted photos (docs/data.md).
inline constexpr double kColorNoise = 0.02;
// Of log exposures; matters only where there is little data.
inline constexpr double kExposureSpread = 0.5;

/// value / spread
template <int kNumbers>
struct Prior : ceres::SizedCostFunction<kNumbers, kNumbers> {
  explicit Prior(double spread) : spread(spread) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    for (int i = 0; i < kNumbers; ++i) {
      residuals[i] = parameters[0][i] / spread;
      for (int k = 0; jacobians && jacobians[0] && k < kNumbers; ++k)
        jacobians[0][kNumbers * i + k] = i == k ? 1 / spread : 0;
    }
    return true;
  }
  double spread;
};

/// A problem that does not own its loss functions, since two solutions share them.
inline ceres::Problem::Options color_problem_options() {
  ceres::Problem::Options options;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

/// Colors, group 0 of the ordering, are eliminated first. The caller puts blocks into the ordering.
inline ceres::Solver::Options color_solver_options() {
  ceres::Solver::Options options;
  options.linear_solver_ordering.reset(new ceres::ParameterBlockOrdering);
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  options.max_num_iterations = 100;
  options.num_threads = 1;  // sums in one order
  options.logging_type = ceres::SILENT;
  return options;
}

}  // namespace gs
