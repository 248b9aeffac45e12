// SPDX-License-Identifier: Apache-2.0
// inspect() makes three passes: which rows are finite, how they are distributed (bounds, medians),
// and what looks wrong against that distribution. The texts are in model_info_text.cpp.
#include "gs_model/formats/model_info.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <numeric>

#include "gs_core/math/spacetime/spacetime.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/ply/mip_filter.h"
#include "gs_model/formats/ply/ply.h"
#include "gs_model/formats/ply/ply_file.h"

namespace gs {
namespace {

constexpr float kFaintOpacity = 1.0f / 255, kThinOpacity = 0.05f, kSolidOpacity = 0.9f;
constexpr float kNeedleRatio = 100;       // largest / smallest scale
constexpr float kFarFactor = 10;          // half diagonals of the inner box, from its center
constexpr float kLargeCoordinate = 1e5f;  // world units; float steps there are 0.0078 or more
constexpr float kFineSteps = 10;          // float steps; smaller Gaussians are placed coarsely
constexpr float kUsualNeedles = 0.3f;     // share; trained models have 5 to 15 %

float logit(float opacity) { return std::log(opacity / (1 - opacity)); }
float norm(const Vec3f& v) { return std::sqrt(inner(v, v)); }
float largest(const Vec3f& v) { return std::max({v.x, v.y, v.z}); }
float smallest(const Vec3f& v) { return std::min({v.x, v.y, v.z}); }

template <class T>
bool is_finite(const T& row) {
  const float* values = reinterpret_cast<const float*>(&row);
  return std::all_of(values, values + sizeof(T) / sizeof(float),
                     [](float value) { return std::isfinite(value); });
}

/// Notes a suspicion if any Gaussian shows it; the sentence begins with the count.
void note(ModelInfo& info, const char* key, std::size_t count, const std::string& sentence) {
  if (count) info.suspicions.push_back({key, count, fmt::format("{} {}", count, sentence)});
}

/// The rows without NaN and infinity; notes the others, by quantity.
std::vector<std::size_t> finite_rows(const Gaussians& gaussians, ModelInfo& info) {
  std::vector<bool> finite(gaussians.count(), true);
  std::string quantities;
  for_each_array(
      [&](const char* name, const auto& array) {
        std::size_t bad = 0;
        for (std::size_t i = 0; i < array.size(); ++i) {
          if (is_finite(array[i])) continue;
          finite[i] = false;
          ++bad;
        }
        if (bad) quantities += fmt::format("{}{} {}", quantities.empty() ? "" : ", ", name, bad);
      },
      gaussians);
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < finite.size(); ++i) {
    if (finite[i]) rows.push_back(i);
  }
  note(info, "non_finite", gaussians.count() - rows.size(),
       fmt::format("hold NaN or infinity ({}): training diverged; they are left out when the model "
                   "is written",
                   quantities));
  return rows;
}

/// The value below which `share` of the values lie; reorders them.
float percentile(std::vector<float>& values, double share) {
  const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

void measure(const Gaussians& gaussians, const std::vector<std::size_t>& rows, ModelInfo& info) {
  std::vector<float> values(rows.size());
  const auto gather = [&](auto&& value_of) {
    std::transform(rows.begin(), rows.end(), values.begin(), value_of);
  };
  for (int axis = 0; axis < 3; ++axis) {
    gather([&](std::size_t i) { return gaussians.mean[i][axis]; });
    info.inner_min[axis] = percentile(values, 0.01);
    info.inner_max[axis] = percentile(values, 0.99);
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    info.min[axis] = *low;
    info.max[axis] = *high;
  }
  gather([&](std::size_t i) {
    const Vec3f& s = gaussians.log_scale[i];
    return (s.x + s.y + s.z) / 3;
  });
  info.median_scale = std::exp(percentile(values, 0.5));
  info.has_time = gaussians.has_time;
  if (info.has_time) {
    gather([&](std::size_t i) { return gaussians.log_time_scale[i]; });
    info.median_time_scale = std::exp(percentile(values, 0.5));
  }
  const auto share_of = [&](auto&& holds) {
    const auto count = std::count_if(
        rows.begin(), rows.end(), [&](std::size_t i) { return holds(gaussians.logit_opacity[i]); });
    return float(double(count) / double(rows.size()));
  };
  info.faint_share = share_of([](float value) { return value < logit(kFaintOpacity); });
  info.thin_share = share_of([](float value) { return value < logit(kThinOpacity); });
  info.solid_share = share_of([](float value) { return value > logit(kSolidOpacity); });
}

/// Gaussians that stand exactly where another one does.
std::size_t count_duplicates(const Gaussians& gaussians, const std::vector<std::size_t>& rows) {
  std::vector<std::array<float, 3>> means;
  means.reserve(rows.size());
  for (const std::size_t i : rows) {
    const Vec3f& mean = gaussians.mean[i];
    means.push_back({mean.x, mean.y, mean.z});
  }
  std::sort(means.begin(), means.end());
  return std::size_t(means.end() - std::unique(means.begin(), means.end()));
}

void suspect(const Gaussians& gaussians, const std::vector<std::size_t>& rows, ModelInfo& info) {
  const auto note_if = [&](const char* key, auto&& holds, const std::string& sentence) {
    note(info, key, std::size_t(std::count_if(rows.begin(), rows.end(), holds)), sentence);
  };
  const Vec3f center = 0.5f * (info.inner_min + info.inner_max);
  const float diagonal = norm(info.inner_max - info.inner_min);
  const float huge = diagonal > 0 ? std::log(diagonal) : std::log(FLT_MAX);

  note_if(
      "zero_quaternions", [&](std::size_t i) { return squared_norm(gaussians.rotation[i]) == 0; },
      "have a rotation of length 0: they are read as not rotated");
  note_if(
      "huge_scales", [&](std::size_t i) { return largest(gaussians.log_scale[i]) > huge; },
      fmt::format("are larger than the scene ({0:.4g} across): they cover every view like fog; "
                  "`gemsplat edit --drop size={0:.4g}..` removes them",
                  diagonal));
  note_if(
      "zero_scales",
      [&](std::size_t i) { return largest(gaussians.log_scale[i]) < std::log(FLT_MIN); },
      "have size 0: they are never seen");
  std::size_t needles = std::size_t(std::count_if(rows.begin(), rows.end(), [&](std::size_t i) {
    const Vec3f& s = gaussians.log_scale[i];
    return largest(s) - smallest(s) > std::log(kNeedleRatio);
  }));
  if (float(needles) > kUsualNeedles * float(rows.size())) {
    note(info, "needles", needles,
         fmt::format(
             "({:.1f} %) are needles or flakes, more than {:.0f} times as long as they are thin",
             100.0 * double(needles) / double(rows.size()), kNeedleRatio));
  }
  note_if(
      "far_outliers",
      [&](std::size_t i) {
        return diagonal > 0 && norm(gaussians.mean[i] - center) > kFarFactor * 0.5f * diagonal;
      },
      "lie far outside the box that holds 98 % of the others: viewers may frame the scene badly");
  note_if(
      "imprecise",
      [&](std::size_t i) {
        const Vec3f& m = gaussians.mean[i];
        const float coordinate = std::max({std::abs(m.x), std::abs(m.y), std::abs(m.z)});
        const float step = coordinate * FLT_EPSILON;
        return coordinate > kLargeCoordinate &&
               std::exp(largest(gaussians.log_scale[i])) < kFineSteps * step;
      },
      "lie far from the origin, where floats hold their positions coarsely: move the scene to the "
      "origin");
  note(info, "duplicates", count_duplicates(gaussians, rows),
       "stand exactly where another one does");
  if (info.sh_degree > 0 && std::all_of(rows.begin(), rows.end(), [&](std::size_t i) {
        const float* rest = &gaussians.sh_rest[i].coefficient[0].x;
        return std::all_of(rest, rest + 3 * kShRestCount, [](float value) { return value == 0; });
      })) {
    note(info, "sh_rest_all_zero", rows.size(),
         fmt::format("have SH coefficients that are all 0 beyond degree 0: degree {} only makes "
                     "the file larger",
                     info.sh_degree));
  }
}

}  // namespace

bool is_ply_with_filter_3d(const std::filesystem::path& file) {
  const ModelFormat* format = find_format(file);
  return (!format || format->read == read_gaussian_ply) && has_filter_3d(PlyFile(file).header());
}

ModelInfo inspect(const GaussianModel& model) {
  const Gaussians& gaussians = model.gaussians;
  ModelInfo info;
  info.count = gaussians.count();
  info.sh_degree = model.sh_degree;
  info.antialiased = model.antialiased;
  for_each_array(
      [&](const char*, const auto& array) { info.bytes += array.size() * sizeof(array[0]); },
      gaussians);
  if (info.count == 0) {
    info.suspicions.push_back({"empty", 1, "there are no Gaussians"});
    return info;
  }
  const std::vector<std::size_t> rows = finite_rows(gaussians, info);
  if (rows.empty()) return info;
  measure(gaussians, rows, info);
  suspect(gaussians, rows, info);
  return info;
}

}  // namespace gs
