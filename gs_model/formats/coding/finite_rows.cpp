// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/coding/finite_rows.h"

#include <bit>
#include <cmath>

#include "gs_core/system/log.h"

namespace gs {
namespace {

constexpr double kUnitTolerance = 0x1p-21;  // of a quaternion's length: a few roundings of float

bool is_finite(float value) {
  constexpr std::uint32_t kExponent = 0x7f800000u;
  return (std::bit_cast<std::uint32_t>(value) & kExponent) != kExponent;
}

}  // namespace

std::vector<std::uint32_t> finite_rows(const Gaussians& gaussians, int sh_degree) {
  const int rest_floats = 3 * sh_rest_count(sh_degree);
  const auto all_finite = [](const auto& row, int count) {
    const float* values = reinterpret_cast<const float*>(&row);
    bool finite = true;
    for (int i = 0; i < count; ++i) finite &= is_finite(values[i]);
    return finite;
  };
  std::vector<std::uint32_t> rows;
  rows.reserve(gaussians.count());
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const bool is_timeless = !gaussians.has_time;
    if ((is_timeless ||
         (all_finite(gaussians.right_rotation[i], 4) && is_finite(gaussians.time_mean[i]) &&
          is_finite(gaussians.log_time_scale[i]))) &&
        all_finite(gaussians.mean[i], 3) && all_finite(gaussians.log_scale[i], 3) &&
        all_finite(gaussians.rotation[i], 4) && is_finite(gaussians.logit_opacity[i]) &&
        all_finite(gaussians.sh0[i], 3) && all_finite(gaussians.sh_rest[i], rest_floats)) {
      rows.push_back(std::uint32_t(i));
    }
  }
  return rows;
}

std::size_t warn_of_left_out(const std::string& file, std::size_t written, std::size_t all) {
  if (written < all)
    log_warning("{}: {} of {} Gaussians hold NaN or infinity and were left out", file,
                all - written, all);
  return all - written;
}

void normalize(float* wxyz) {
  double squared = 0;
  for (int i = 0; i < 4; ++i) squared += double(wxyz[i]) * wxyz[i];
  const double length = std::sqrt(squared);
  if (length == 0) {
    wxyz[0] = 1;
  } else if (std::abs(length - 1) > kUnitTolerance) {
    for (int i = 0; i < 4; ++i) wxyz[i] = float(wxyz[i] / length);
  }
}

GaussianModel rows_of(const GaussianModel& model, const std::vector<std::uint32_t>& source) {
  return {rows_of(model.gaussians, source), model.sh_degree, model.is_ours, model.antialiased,
          model.world_offset};
}

GaussianModel finite_model(const GaussianModel& model) {
  GaussianModel result = rows_of(model, finite_rows(model.gaussians, model.sh_degree));
  for (Quatf& q : result.gaussians.rotation) normalize(&q.w);
  for (Quatf& q : result.gaussians.right_rotation) normalize(&q.w);
  for (ShRest& rest : result.gaussians.sh_rest)
    for (int k = sh_rest_count(model.sh_degree); k < kShRestCount; ++k)
      rest.coefficient[k] = Vec3f(0);
  return result;
}

}  // namespace gs
