// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/model_moment.h"

#include <algorithm>
#include <cmath>

#include "gs_core/geometry/symmetric_eigen.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/spacetime/spacetime_splat.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

// A covariance that rounding has made flat keeps this share of its largest variance.
constexpr double kLeastVarianceShare = 1e-12;

double marginal_of(const Gaussians& gaussians, std::size_t i, double time) {
  const SpacetimeShape<double> shape = spacetime_shape_of(gaussians, i);
  if (is_degenerate(shape.rotations)) return 0;
  return condition(covariance(shape), time - shape.time_mean).marginal;
}

std::vector<std::uint32_t> visible_rows(const Gaussians& gaussians, double time) {
  std::vector<std::uint8_t> is_visible(gaussians.count());
  parallel_for(gaussians.count(), 4096, [&](std::size_t i) {
    const double marginal = marginal_of(gaussians, i, time);
    is_visible[i] = is_alive(marginal) &&
                    sigmoid(double(gaussians.logit_opacity[i])) * marginal >= double(kMinAlpha);
  });
  std::vector<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < is_visible.size(); ++i)
    if (is_visible[i]) rows.push_back(i);
  return rows;
}

// Row i of `to` becomes what Gaussian `from_row` is at the time.
void write_moment(const Gaussians& from, std::size_t from_row, double time, const Gaussians& to,
                  std::size_t i) {
  const SpacetimeShape<double> shape = spacetime_shape_of(from, from_row);
  const Instant<double> moment = condition(covariance(shape), time - shape.time_mean);
  const SymmetricEigen axes = symmetric_eigen(moment.covariance);
  const double least =
      kLeastVarianceShare * std::max({axes.value.x, axes.value.y, axes.value.z, 1e-300});
  to.mean[i] = Vec3f(shape.mean + moment.shift);
  for (int k = 0; k < 3; ++k)
    to.log_scale[i][k] = float(0.5 * std::log(std::max(axes.value[k], least)));
  const Quat<double> q = quaternion_of(axes.R);
  to.rotation[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
  to.logit_opacity[i] = float(logit(sigmoid(shape.logit_opacity) * moment.marginal));
  to.sh0[i] = from.sh0[from_row];
  to.sh_rest[i] = from.sh_rest[from_row];
}

}  // namespace

SpacetimeShape<double> spacetime_shape_of(const Gaussians& gaussians, std::size_t i) {
  return {Vec3d(gaussians.mean[i]),
          Vec3d(gaussians.log_scale[i]),
          {in_double(gaussians.rotation[i]), in_double(gaussians.right_rotation[i])},
          gaussians.logit_opacity[i],
          gaussians.time_mean[i],
          gaussians.log_time_scale[i]};
}

GaussianModel moment_of(const GaussianModel& model, double time) {
  const Gaussians& from = model.gaussians;
  if (!from.has_time)
    return {copy_of(from), model.sh_degree, model.is_ours, model.antialiased, model.world_offset};
  const std::vector<std::uint32_t> rows = visible_rows(from, time);
  GaussianModel result{Gaussians(rows.size(), host_memory()), model.sh_degree, model.is_ours,
                       model.antialiased, model.world_offset};
  parallel_for(rows.size(), 1024,
               [&](std::size_t i) { write_moment(from, rows[i], time, result.gaussians, i); });
  return result;
}

Gaussians middles_of_lives(const Gaussians& gaussians) {
  Gaussians result(gaussians.count(), host_memory());
  parallel_for(gaussians.count(), 1024, [&](std::size_t i) {
    write_moment(gaussians, i, gaussians.time_mean[i], result, i);
    if (is_degenerate(spacetime_shape_of(gaussians, i).rotations)) result.log_scale[i] = Vec3f(NAN);
  });
  return result;
}

Life life_of(const Gaussians& gaussians, std::size_t i) {
  const SpacetimeShape<double> shape = spacetime_shape_of(gaussians, i);
  // exp(-dt^2 / (2 S_tt)) is kMinMarginal at either end
  const double half = std::sqrt(-2 * std::log(double(kMinMarginal)) * covariance(shape).time);
  return {shape.time_mean - half, shape.time_mean + half};
}

}  // namespace gs
