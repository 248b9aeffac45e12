// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/gs4d/moving_gaussian.h"

#include <algorithm>
#include <cmath>

#include "gs_core/geometry/symmetric_eigen.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/quaternion.h"

namespace gs {
namespace {

// A covariance that rounding has made flat keeps this share of its largest variance.
constexpr double kLeastShare = 1e-14;

struct Matrix4 {
  double m[4][4];
};

/// S = R diag(value) R^T; the eigenvectors are the columns of R, which may be a reflection.
struct Eigen4 {
  double value[4];
  Matrix4 R;
};

// By Jacobi's method, in sweeps over all entries above the diagonal.
Eigen4 symmetric_eigen4(Matrix4 S) {
  auto& A = S.m;
  Eigen4 result{{}, {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}}};
  constexpr int kMostSweeps = 30;  // the error is squared in each of the last ones
  for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
    bool is_diagonal = true;
    for (int p = 0; p < 3; ++p)
      for (int q = p + 1; q < 4; ++q) {
        if (A[p][q] == 0) continue;
        is_diagonal = false;
        jacobi_turn(A, result.R.m, p, q);
      }
    if (is_diagonal) break;
  }
  for (int i = 0; i < 4; ++i) result.value[i] = A[i][i];
  return result;
}

double determinant(const Matrix4& A) {
  const auto& m = A.m;
  const auto minor = [&](int i, int j) {  // of the first two rows; the other two have the rest
    return m[0][i] * m[1][j] - m[0][j] * m[1][i];
  };
  const auto other = [&](int i, int j) { return m[2][i] * m[3][j] - m[2][j] * m[3][i]; };
  return minor(0, 1) * other(2, 3) - minor(0, 2) * other(1, 3) + minor(0, 3) * other(1, 2) +
         minor(1, 2) * other(0, 3) - minor(1, 3) * other(0, 2) + minor(2, 3) * other(0, 1);
}

Quat<double> unit(int i) {
  return {double(i == 0), double(i == 1), double(i == 2), double(i == 3)};
}

/// The quaternions l and r with R = L(l) Q(r). Both factors are linear in their quaternion, and the
/// sixteen products L(unit i) Q(unit j) are orthogonal, with the squared norm 4. So
/// <R, L(unit i) Q(unit j)> / 4 = l_i r_j, of which the row with the largest norm gives r.
QuatPair<double> pair_of(const Matrix4& R) {
  double product[4][4];
  int best = 0;
  double largest = -1;
  for (int i = 0; i < 4; ++i) {
    double norm2 = 0;
    for (int j = 0; j < 4; ++j) {
      const Mat4<double> basis = multiply(left_factor(unit(i)), right_factor(unit(j)));
      product[i][j] = 0;
      for (int k = 0; k < 4; ++k)
        product[i][j] += inner({R.m[k][0], R.m[k][1], R.m[k][2], R.m[k][3]}, basis.row[k]) / 4;
      norm2 += product[i][j] * product[i][j];
    }
    if (norm2 > largest) best = i, largest = norm2;
  }
  const double norm = std::sqrt(largest);
  if (!(norm > 0)) return {unit(0), unit(0)};
  double r[4], l[4] = {};
  for (int j = 0; j < 4; ++j) r[j] = product[best][j] / norm;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) l[i] += product[i][j] * r[j];
  return {{l[0], l[1], l[2], l[3]}, {r[0], r[1], r[2], r[3]}};
}

double half_log(double variance, double least) { return 0.5 * std::log(std::max(variance, least)); }

}  // namespace

MovingGaussian moving_gaussian(const SpacetimeShape<double>& shape) {
  const SpacetimeCovariance<double> S = covariance(shape);
  const SymmetricEigen axes = symmetric_eigen(condition(S, 0.0).covariance);
  const double largest = std::max({axes.value.x, axes.value.y, axes.value.z, 1e-300});
  MovingGaussian moving{};
  moving.mean = shape.mean;
  moving.drift = S.mixed / std::sqrt(S.time);
  moving.time_mean = shape.time_mean;
  moving.log_time_scale = 0.5 * std::log(S.time);
  for (int k = 0; k < 3; ++k) moving.log_scale[k] = half_log(axes.value[k], kLeastShare * largest);
  moving.rotation = quaternion_of(axes.R);
  return moving;
}

SpacetimeShape<double> shape_of(const MovingGaussian& moving) {
  const Sym3<double> C = covariance(rotation_matrix(moving.rotation), variance(moving.log_scale));
  const Vec3d& d = moving.drift;
  const double s = std::exp(moving.log_time_scale);
  const Matrix4 S{{{C.xx + d.x * d.x, C.xy + d.x * d.y, C.xz + d.x * d.z, d.x * s},
                   {C.xy + d.x * d.y, C.yy + d.y * d.y, C.yz + d.y * d.z, d.y * s},
                   {C.xz + d.x * d.z, C.yz + d.y * d.z, C.zz + d.z * d.z, d.z * s},
                   {d.x * s, d.y * s, d.z * s, s * s}}};
  Eigen4 axes = symmetric_eigen4(S);
  // The fourth axis is the one nearest to time.
  int nearest = 0;
  for (int k = 1; k < 4; ++k)
    if (std::abs(axes.R.m[3][k]) > std::abs(axes.R.m[3][nearest])) nearest = k;
  std::swap(axes.value[nearest], axes.value[3]);
  for (auto& row : axes.R.m) std::swap(row[nearest], row[3]);
  if (determinant(axes.R) < 0)
    for (auto& row : axes.R.m) row[0] = -row[0];
  const double least =
      kLeastShare * std::max({axes.value[0], axes.value[1], axes.value[2], axes.value[3], 1e-300});
  SpacetimeShape<double> shape{};
  shape.mean = moving.mean;
  for (int k = 0; k < 3; ++k) shape.log_scale[k] = half_log(axes.value[k], least);
  shape.log_time_scale = half_log(axes.value[3], least);
  shape.rotations = pair_of(axes.R);
  shape.time_mean = moving.time_mean;
  return shape;
}

}  // namespace gs
