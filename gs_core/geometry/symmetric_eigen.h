// SPDX-License-Identifier: Apache-2.0
// The axes of an ellipsoid: eigenvalues and eigenvectors of a symmetric 3x3 matrix, on the CPU and
// the GPU.
#pragma once

#include <cmath>

#include "gs_core/types.h"

namespace gs {

/// S = R diag(value) R^T with a rotation R; the eigenvectors are its columns. In no order.
struct SymmetricEigen {
  Vec3d value;
  Mat3<double> R;
};

/// One turn of Jacobi's method: makes A[p][q] of a symmetric N x N matrix zero by the smaller one of
/// two rotations, and turns the columns p and q of V with it.
template <int N>
GS_HD void jacobi_turn(double (&A)[N][N], double (&V)[N][N], int p, int q) {
  // tan of the angle
  const double theta = (A[q][q] - A[p][p]) / (2 * A[p][q]);
  const double t = (theta >= 0 ? 1 : -1) / (std::abs(theta) + std::hypot(theta, 1.0));
  const double c = 1 / std::hypot(t, 1.0), s = t * c;
  const double change = t * A[p][q];
  A[p][p] -= change;
  A[q][q] += change;
  A[p][q] = A[q][p] = 0;
  for (int r = 0; r < N; ++r) {
    if (r == p || r == q) continue;
    const double rp = A[r][p], rq = A[r][q];
    A[r][p] = A[p][r] = c * rp - s * rq;
    A[r][q] = A[q][r] = s * rp + c * rq;
  }
  for (auto& row : V) {
    const double vp = row[p], vq = row[q];
    row[p] = c * vp - s * vq;
    row[q] = s * vp + c * vq;
  }
}

/// By Jacobi's method: each rotation makes the largest entry off the diagonal zero. S is finite.
GS_HD SymmetricEigen symmetric_eigen(const Sym3<double>& S) {
  double A[3][3] = {{S.xx, S.xy, S.xz}, {S.xy, S.yy, S.yz}, {S.xz, S.yz, S.zz}};
  double V[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  constexpr int kMostTurns = 50;  // each at least halves what is off the diagonal
  for (int turn = 0; turn < kMostTurns; ++turn) {
    int p = 0, q = 1;
    for (int i = 0; i < 2; ++i)
      if (std::abs(A[i][2]) > std::abs(A[p][q])) p = i, q = 2;
    if (A[p][q] == 0) break;
    jacobi_turn(A, V, p, q);
  }
  return {{A[0][0], A[1][1], A[2][2]},
          {{V[0][0], V[0][1], V[0][2]}, {V[1][0], V[1][1], V[1][2]}, {V[2][0], V[2][1], V[2][2]}}};
}

}  // namespace gs
