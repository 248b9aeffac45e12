// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/merge_gaussians.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/error.h"
#include "gs_core/geometry/symmetric_eigen.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"

namespace gs {
namespace {

constexpr double kAreaPower = 1.6075;
constexpr double kMostOpacity = 0.9999, kLeastOpacity = 1e-6;
// A merged covariance that rounding has made flat keeps this share of its largest variance.
constexpr double kLeastShare = 1e-14;

Sym3<double> in_double(const Sym3<float>& s) { return {s.xx, s.xy, s.xz, s.yy, s.yz, s.zz}; }
Sym3<float> in_float(const Sym3<double>& s) {
  return {float(s.xx), float(s.xy), float(s.xz), float(s.yy), float(s.yz), float(s.zz)};
}

Vec3d variance_of(const Gaussians& gaussians, std::size_t i) {
  return variance(Vec3d(gaussians.log_scale[i]));
}
Sym3<double> covariance_of(const Gaussians& gaussians, std::size_t i) {
  const Quatf& q = gaussians.rotation[i];
  return covariance(rotation_matrix(Quat<double>{q.w, q.x, q.y, q.z}), variance_of(gaussians, i));
}

void add(Sym3<double>& sum, double weight, const Sym3<double>& s, const Vec3d& d) {
  sum.xx += weight * (s.xx + d.x * d.x);
  sum.xy += weight * (s.xy + d.x * d.y);
  sum.xz += weight * (s.xz + d.x * d.z);
  sum.yy += weight * (s.yy + d.y * d.y);
  sum.yz += weight * (s.yz + d.y * d.z);
  sum.zz += weight * (s.zz + d.z * d.z);
}

// The eigenvalues of a covariance in closed form, with errors of 1e-15 of the largest.  Smith 1961
Vec3d eigenvalues(const Sym3<double>& s) {
  const double mean = (s.xx + s.yy + s.zz) / 3;
  const double x = s.xx - mean, y = s.yy - mean, z = s.zz - mean;
  const double off = s.xy * s.xy + s.xz * s.xz + s.yz * s.yz;
  const double spread = std::sqrt((x * x + y * y + z * z + 2 * off) / 6);
  if (!(spread > 0)) return Vec3d(mean);
  const double determinant =
      x * (y * z - s.yz * s.yz) - s.xy * (s.xy * z - s.yz * s.xz) + s.xz * (s.xy * s.yz - y * s.xz);
  const double angle =
      std::acos(std::clamp(determinant / (2 * spread * spread * spread), -1.0, 1.0)) / 3;
  const double largest = mean + 2 * spread * std::cos(angle);
  const double least = mean + 2 * spread * std::cos(angle + 2 * std::numbers::pi / 3);
  return {largest, 3 * mean - largest - least, least};
}

// The opacity with which a surface has the mass.
double merged_opacity(double mass, double area) {
  return area > 0 ? std::min(1.0, mass / area) : 0;
}

/// Two shapes and their merge as one view along an axis shows them.
struct FlatSplat {
  double xx, xy, yy, det;  // 2x2 covariance
  double x, y;             // mean
};

FlatSplat splat_along(int axis, const Sym3<double>& s, const Vec3d& mean) {
  FlatSplat p = axis == 0   ? FlatSplat{s.yy, s.yz, s.zz, 0, mean.y, mean.z}
                : axis == 1 ? FlatSplat{s.xx, s.xz, s.zz, 0, mean.x, mean.z}
                            : FlatSplat{s.xx, s.xy, s.yy, 0, mean.x, mean.y};
  p.det = std::max(0.0, p.xx * p.yy - p.xy * p.xy);
  return p;
}

// integral G_a G_b / (2 pi)
double overlap(const FlatSplat& a, const FlatSplat& b) {
  const double xx = a.xx + b.xx, xy = a.xy + b.xy, yy = a.yy + b.yy;
  const double det = xx * yy - xy * xy;
  const double both = a.det * b.det;
  if (!(both > 0) || !(det > 0)) return 0;  // one of them is seen edge-on
  const double dx = a.x - b.x, dy = a.y - b.y;
  const double power = -0.5 * (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / det;
  return std::sqrt(both / det) * std::exp(power);
}

// The merged shape in double precision.
struct Merged {
  Vec3d mean, color;
  Sym3<double> sigma;
  double opacity, area, importance;
};

// The share of the first of two weights.
double share_of(double a, double b, double if_both_are_0) {
  return a + b > 0 ? a / (a + b) : if_both_are_0;
}

Merged merge(const MergeShape& a, const MergeShape& b) {
  const double ma = a.mass(), mb = b.mass(), mass = ma + mb;
  const double wa = share_of(ma, mb, 0.5), wb = 1 - wa;
  const double va = share_of(ma * a.importance, mb * b.importance, wa), vb = 1 - va;
  Merged m;
  m.mean = wa * Vec3d(a.mean) + wb * Vec3d(b.mean);
  m.color = va * Vec3d(a.color) + vb * Vec3d(b.color);
  m.sigma = {};
  add(m.sigma, wa, in_double(a.sigma), Vec3d(a.mean) - m.mean);
  add(m.sigma, wb, in_double(b.sigma), Vec3d(b.mean) - m.mean);
  m.area = ellipsoid_area(eigenvalues(m.sigma));
  m.opacity = merged_opacity(mass, m.area);
  m.importance = wa * a.importance + wb * b.importance;
  return m;
}

double inner_color(const Vec3d& a, const Vec3d& b) { return inner(a, b) + 1; }

}  // namespace

double ellipsoid_area(const Vec3d& squares) {
  const auto term = [](double square) { return std::pow(std::max(square, 0.0), kAreaPower / 2); };
  const double a = term(squares.x), b = term(squares.y), c = term(squares.z);
  return 4 * std::numbers::pi * std::pow((a * b + a * c + b * c) / 3, 1 / kAreaPower);
}

MergeShape merge_shape_of(const Gaussians& gaussians, std::size_t i, float importance) {
  return {gaussians.mean[i],
          in_float(covariance_of(gaussians, i)),
          sigmoid(gaussians.logit_opacity[i]),
          float(ellipsoid_area(variance_of(gaussians, i))),
          Vec3f(float(kColorOffset)) + float(kSh0) * gaussians.sh0[i],
          importance};
}

MergeShape merged_shape(const MergeShape& a, const MergeShape& b) {
  const Merged m = merge(a, b);
  return {Vec3f(m.mean), in_float(m.sigma), float(m.opacity),
          float(m.area), Vec3f(m.color),    float(m.importance)};
}

double merge_cost(const MergeShape& a, const MergeShape& b) {
  const Merged m = merge(a, b);
  const Vec3d ca(a.color), cb(b.color);
  const double oa = a.opacity, ob = b.opacity;
  const double aa = oa * oa * inner_color(ca, ca), bb = ob * ob * inner_color(cb, cb),
               mm = m.opacity * m.opacity * inner_color(m.color, m.color),
               ab = 2 * oa * ob * inner_color(ca, cb),
               am = -2 * oa * m.opacity * inner_color(ca, m.color),
               bm = -2 * ob * m.opacity * inner_color(cb, m.color);
  const Sym3<double> sa = in_double(a.sigma), sb = in_double(b.sigma);
  // Relative to the merged mean, so that coordinates far from the origin lose nothing.
  const Vec3d da = Vec3d(a.mean) - m.mean, db = Vec3d(b.mean) - m.mean;
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const FlatSplat pa = splat_along(axis, sa, da), pb = splat_along(axis, sb, db),
                    pm = splat_along(axis, m.sigma, Vec3d(0.0));
    sum += 0.5 * (aa * std::sqrt(pa.det) + bb * std::sqrt(pb.det) + mm * std::sqrt(pm.det)) +
           ab * overlap(pa, pb) + am * overlap(pa, pm) + bm * overlap(pb, pm);
  }
  const double importance = std::max(a.importance, b.importance);
  return std::max(0.0, importance * 2 * std::numbers::pi / 3 * sum);
}

void merge_gaussians(const Gaussians& from, const std::uint32_t* rows, std::size_t count,
                     const Gaussians& to, std::size_t to_row, const float* importance) {
  GS_CHECK(count > 0 && !from.has_time && !from.has_filter);
  const auto mass_of = [&](std::size_t i) {
    return double(sigmoid(double(from.logit_opacity[i]))) * ellipsoid_area(variance_of(from, i));
  };
  const auto shown_of = [&](std::size_t k) {
    return mass_of(rows[k]) * (importance ? double(importance[k]) : 1.0);
  };
  double mass = 0, shown = 0;
  for (std::size_t k = 0; k < count; ++k) mass += mass_of(rows[k]), shown += shown_of(k);
  const auto weight = [&](std::size_t k) {
    return mass > 0 ? mass_of(rows[k]) / mass : 1 / double(count);
  };
  const auto color_weight = [&](std::size_t k) {
    return shown > 0 ? shown_of(k) / shown : weight(k);
  };
  Vec3d mean(0.0), sh0(0.0), rest[kShRestCount];
  std::fill(rest, rest + kShRestCount, Vec3d(0.0));
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint32_t i = rows[k];
    const double v = color_weight(k);
    mean += weight(k) * Vec3d(from.mean[i]);
    sh0 += v * Vec3d(from.sh0[i]);
    for (int c = 0; c < kShRestCount; ++c) rest[c] += v * Vec3d(from.sh_rest[i].coefficient[c]);
  }
  Sym3<double> sigma{};
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint32_t i = rows[k];
    add(sigma, weight(k), covariance_of(from, i), Vec3d(from.mean[i]) - mean);
  }
  const SymmetricEigen axes = symmetric_eigen(sigma);
  const double largest = std::max({axes.value.x, axes.value.y, axes.value.z, 1e-60});
  const Quat<double> q = quaternion_of(axes.R);
  to.mean[to_row] = Vec3f(mean);
  for (int axis = 0; axis < 3; ++axis)
    to.log_scale[to_row][axis] =
        float(0.5 * std::log(std::max(axes.value[axis], kLeastShare * largest)));
  to.rotation[to_row] = {float(q.w), float(q.x), float(q.y), float(q.z)};
  to.logit_opacity[to_row] = float(logit(
      std::clamp(merged_opacity(mass, ellipsoid_area(axes.value)), kLeastOpacity, kMostOpacity)));
  to.sh0[to_row] = Vec3f(sh0);
  for (int c = 0; c < kShRestCount; ++c) to.sh_rest[to_row].coefficient[c] = Vec3f(rest[c]);
}

}  // namespace gs
