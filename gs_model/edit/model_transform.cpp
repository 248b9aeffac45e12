// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/model_transform.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/math/render/sh.h"
#include "gs_core/math/spacetime/spacetime.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr double kSimilar = 1e-6;    // products of a matrix's rows may be off by so much
constexpr double kRounding = 1e-12;  // a turn or scaling by less is none

/// How a turn R mixes SH coefficients: f'(d) = f(R^T d) has, since the basis Y is orthonormal,
///
///   c'_i = sum_j D_ij c_j,   D_ij = integral over the sphere of Y_i(d) Y_j(R^T d)
///
/// The integrand is a polynomial of degree 6 at most. A product rule integrates it exactly: 4 nodes
/// of Gauss and Legendre in z, 8 equal steps around it (Abramowitz & Stegun 1964, 25.4.29). Entries
/// between degrees are 0.
using ShTurn = std::array<std::array<double, kShBasisCount>, kShBasisCount>;

ShTurn sh_turn(const Mat3<double>& R) {
  constexpr double kNodes[2] = {0.33998104358485626, 0.86113631159405258};
  constexpr double kWeights[2] = {0.65214515486254614, 0.34785484513745386};
  constexpr int kAround = 8;
  ShTurn D{};
  for (int node = 0; node < 4; ++node)
    for (int step = 0; step < kAround; ++step) {
      const double z = (node % 2 ? -1 : 1) * kNodes[node / 2];
      const double r = std::sqrt(1 - z * z), angle = 2 * std::numbers::pi * step / kAround;
      const double weight = kWeights[node / 2] * 2 * std::numbers::pi / kAround;
      const Vec3d d{r * std::cos(angle), r * std::sin(angle), z};
      double here[kShBasisCount], there[kShBasisCount];
      sh_basis(kMaxShDegree, d, here);
      sh_basis(kMaxShDegree, multiply_transposed(R, d), there);
      for (int i = 0; i < kShBasisCount; ++i)
        for (int j = 0; j < kShBasisCount; ++j) D[i][j] += weight * here[i] * there[j];
    }
  return D;
}

ShRest turned(const ShRest& rest, const ShTurn& D, int sh_degree) {
  ShRest result{};
  for (int degree = 1; degree <= sh_degree; ++degree) {
    const int first = degree * degree, end = (degree + 1) * (degree + 1);
    for (int i = first; i < end; ++i) {
      Vec3d sum(0.0);
      for (int j = first; j < end; ++j) sum += D[i][j] * Vec3d(rest.coefficient[j - 1]);
      result.coefficient[i - 1] = Vec3f(sum);
    }
  }
  return result;
}

Quatf in_float(const Quat<double>& q) { return {float(q.w), float(q.x), float(q.y), float(q.z)}; }

}  // namespace

Quat<double> turn_upright(const Vec3d& up) {
  const double length = std::sqrt(inner(up, up));
  const Vec3d u = up / length;
  // Half-way quaternion from u to v = (0 -1 0): (1 + u.v, u x v). Where they are opposite it is 0,
  // and half a turn about x does it.
  Quat<double> q{1 - u.y, u.z, 0, -u.x};
  const double norm = std::sqrt(squared_norm(q));
  if (norm < 1e-9) return {0, 1, 0, 0};
  return {q.w / norm, q.x / norm, q.y / norm, q.z / norm};
}

Vec3d median_mean(const GaussianModel& model) {
  Vec3d median(0.0);
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<float> values;
    for (const Vec3f& mean : model.gaussians.mean)
      if (is_finite(mean)) values.push_back(mean[axis]);
    if (values.empty()) return Vec3d(0.0);
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    median[axis] = *middle;
  }
  return median;
}

void transform_model(GaussianModel& model, const ModelTransform& transform) {
  const Gaussians& g = model.gaussians;
  if (transform.is_identity()) return;
  const Mat3<double> R = rotation_matrix(transform.turn);
  const bool turns = transform.turn.w != 1;
  const ShTurn D = sh_turn(R);
  if (g.has_time && transform.scale != 1)
    throw UsageError(
        "Gaussians in space and time cannot be scaled, because their axes mix both; export one "
        "moment with --time, or leave --scale out");
  const auto log_scale = float(std::log(transform.scale));
  parallel_for(g.count(), 4096, [&](std::size_t i) {
    const Vec3d from_center = Vec3d(g.mean[i]) - transform.center;
    g.mean[i] = Vec3f(transform.scale * (turns ? multiply(R, from_center) : from_center));
    g.log_scale[i] += Vec3f(log_scale);
    if (g.has_filter) g.filter_scale[i] *= float(transform.scale);
    if (!turns) return;
    if (g.has_time) {
      const QuatPair<double> turn = turn_of_space(transform.turn);
      g.rotation[i] = in_float(product(turn.left, in_double(g.rotation[i])));
      g.right_rotation[i] = in_float(product(in_double(g.right_rotation[i]), turn.right));
    } else {
      g.rotation[i] = in_float(product(transform.turn, in_double(g.rotation[i])));
    }
    g.sh_rest[i] = turned(g.sh_rest[i], D, model.sh_degree);
  });
  model.world_offset =
      transform.turns_or_scales() ? Vec3d(0.0) : model.world_offset + transform.center;
}

void limit_sh_degree(GaussianModel& model, int degree) {
  if (degree >= model.sh_degree) return;
  model.sh_degree = degree;
  for (ShRest& rest : model.gaussians.sh_rest)
    std::fill(rest.coefficient + sh_rest_count(degree), std::end(rest.coefficient), Vec3f(0));
}

GaussianModel copy_with_degree(const GaussianModel& model, int degree) {
  GaussianModel copy{copy_of(model.gaussians), model.sh_degree, model.is_ours, model.antialiased,
                     model.world_offset};
  limit_sh_degree(copy, degree);
  return copy;
}

ModelTransform transform_of(const Similarity& similarity, const Vec3d& offset) {
  const Vec3d from_shift = multiply_transposed(similarity.R, similarity.shift) / similarity.scale;
  return {-(offset + from_shift), quaternion_of(similarity.R), similarity.scale};
}

ModelTransform inverse_of(const ModelTransform& transform) {
  const Quat<double>& q = transform.turn;
  const Vec3d origin = multiply(rotation_matrix(q), -transform.center) * transform.scale;
  return {origin, {q.w, -q.x, -q.y, -q.z}, 1 / transform.scale};
}

Mat4d matrix_of(const ModelTransform& transform) {
  const Mat3<double> R = rotation_matrix(transform.turn);
  Mat4d result{};
  int row = 0;
  for (const Vec3d& r : {R.row0, R.row1, R.row2}) {
    for (int column = 0; column < 3; ++column) result.m[row][column] = transform.scale * r[column];
    result.m[row][3] = -transform.scale * inner(r, transform.center);
    ++row;
  }
  result.m[3][3] = 1;
  return result;
}

ModelTransform transform_of(const Mat4d& similarity) {
  const auto row = [&](int i) {
    return Vec3d{similarity.m[i][0], similarity.m[i][1], similarity.m[i][2]};
  };
  double scale = std::sqrt(inner(row(0), row(0)));
  if (std::abs(scale - 1) < kRounding) scale = 1;
  Quat<double> turn = quaternion_of(Mat3<double>{row(0) / scale, row(1) / scale, row(2) / scale});
  if (std::abs(turn.x) + std::abs(turn.y) + std::abs(turn.z) < kRounding) turn = {1, 0, 0, 0};
  const Mat4d back = inverse_of(similarity);
  return {{back.m[0][3], back.m[1][3], back.m[2][3]}, turn, scale};
}

Mat4d matrix_of(const Similarity& similarity) {
  Mat4d result{};
  int row = 0;
  for (const Vec3d& r : {similarity.R.row0, similarity.R.row1, similarity.R.row2}) {
    for (int column = 0; column < 3; ++column) result.m[row][column] = similarity.scale * r[column];
    result.m[row][3] = similarity.shift[row];
    ++row;
  }
  result.m[3][3] = 1;
  return result;
}

Mat4d multiply(const Mat4d& a, const Mat4d& b) {
  Mat4d result{};
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      for (int k = 0; k < 4; ++k) result.m[i][j] += a.m[i][k] * b.m[k][j];
  return result;
}

Mat4d diagonal(const Vec3f& signs) {
  return {{{signs.x, 0, 0, 0}, {0, signs.y, 0, 0}, {0, 0, signs.z, 0}, {0, 0, 0, 1}}};
}

Mat4d translation(const Vec3d& by) {
  return {{{1, 0, 0, by.x}, {0, 1, 0, by.y}, {0, 0, 1, by.z}, {0, 0, 0, 1}}};
}

bool is_similarity(const Mat4d& matrix) {
  const auto row = [&](int i) { return Vec3d{matrix.m[i][0], matrix.m[i][1], matrix.m[i][2]}; };
  const double scale = length(row(0));
  return is_rotation(Mat3<double>{row(0) / scale, row(1) / scale, row(2) / scale}, kSimilar);
}

Camera moved(Camera camera, const ModelTransform& transform) {
  const Mat3<double> R = rotation_matrix(transform.turn);
  const PinholeCamera<double> before = camera_as<double>(camera);
  const Mat3<double>& C = before.cam_from_world_rotation;
  const auto row = [&](const Vec3d& r) { return Vec3f(multiply(R, r)); };
  camera.cam_from_world_rotation = {row(C.row0), row(C.row1), row(C.row2)};
  camera.cam_from_world_translation =
      Vec3f(transform.scale * (multiply(C, transform.center) + before.cam_from_world_translation));
  return camera;
}

Mat4d inverse_of(const Mat4d& a) {
  double square = 0;  // of the scale
  for (int j = 0; j < 3; ++j) square += a.m[0][j] * a.m[0][j];
  Mat4d result{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      result.m[i][j] = a.m[j][i] / square;
      result.m[i][3] -= result.m[i][j] * a.m[j][3];
    }
  result.m[3][3] = 1;
  return result;
}

}  // namespace gs
