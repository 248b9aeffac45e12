// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/merge_models.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"

namespace gs {
namespace {

[[noreturn]] void refuse(const NamedModel& has, const char* what, const NamedModel& has_not,
                         const char* what_not, const std::string& remedy) {
  throw UsageError(
      fmt::format("{} {}, and {} {}; {}", has.name, what, has_not.name, what_not, remedy));
}

// Refuses two models of which one has what the other lacks.
template <class Has>
void check_alike(const NamedModel& a, const NamedModel& b, Has&& has, const char* what,
                 const char* what_not, std::string (*remedy)(const NamedModel& with)) {
  const bool a_has = has(a.model.model), b_has = has(b.model.model);
  if (a_has == b_has) return;
  const NamedModel &with = a_has ? a : b, &without = a_has ? b : a;
  refuse(with, what, without, what_not, remedy(with));
}

void check_mergeable(const NamedModel& a, const NamedModel& b, const MergeOptions& options) {
  check_alike(
      a, b, [](const GaussianModel& m) { return m.gaussians.has_time; },
      "holds Gaussians in space and time", "3D Gaussians",
      [](const NamedModel& with) {
        return fmt::format(
            "write one moment of the former first: gemsplat edit {} --time 0.5 -o "
            "moment.ply",
            with.name);
      });
  check_alike(
      a, b, [](const GaussianModel& m) { return m.gaussians.has_filter; },
      "has a 3D filter beside its Gaussians", "has none",
      [](const NamedModel& with) {
        return fmt::format(
            "put the filter into scales and opacities first: gemsplat export {} "
            "plain.glb",
            with.name);
      });
  if (options.antialiased) return;
  check_alike(
      a, b, [](const GaussianModel& m) { return m.antialiased; }, "is antialiased", "is not",
      [](const NamedModel&) {
        return std::string(
            "one of them will look different; say how to render the result with "
            "--antialiased yes or --antialiased no");
      });
}

// From the numbers of each model to those of the first one.
std::vector<Mat4d> ways_to_first(const std::vector<NamedModel>& models, bool as_stored) {
  const auto frame = [&](const EditModel& m) {
    return as_stored ? translation(m.model.world_offset) : input_from(m);
  };
  const Mat4d first_from_frame = inverse_of(frame(models.front().model));
  std::vector<Mat4d> ways;
  for (const NamedModel& named : models)
    ways.push_back(multiply(first_from_frame, frame(named.model)));
  return ways;
}

// What has to be taken off the numbers of the first model so that floats hold those of all.
Vec3d common_shift(const std::vector<NamedModel>& models, const std::vector<Mat4d>& ways) {
  std::vector<Vec3d> positions;
  for (std::size_t m = 0; m < models.size(); ++m) {
    const std::vector<Vec3d> some = positions_under(ways[m], models[m].model.model.gaussians);
    positions.insert(positions.end(), some.begin(), some.end());
  }
  return offset_of_positions(positions);
}

Gaussians joined(const std::vector<NamedModel>& models) {
  Gaussians all(host_memory());
  std::size_t count = 0;
  for (const NamedModel& named : models) {
    const Gaussians& part = named.model.model.gaussians;
    all.has_time = part.has_time;
    all.has_filter = part.has_filter;
    count += part.count();
  }
  all.resize(count);
  all.fill_zero();
  std::size_t begin = 0;
  for (const NamedModel& named : models) {
    const Gaussians& part = named.model.model.gaussians;
    copy_rows(part, 0, part.count(), all, begin);
    begin += part.count();
  }
  return all;
}

}  // namespace

EditModel merge_models(std::vector<NamedModel> models, const MergeOptions& options) {
  GS_CHECK(!models.empty());
  for (const NamedModel& other : models) check_mergeable(models.front(), other, options);
  const std::vector<Mat4d> ways = ways_to_first(models, options.as_stored);
  const Vec3d shift = common_shift(models, ways);
  for (std::size_t m = 0; m < models.size(); ++m)
    transform_numbers(models[m].model, transform_of(multiply(translation(-shift), ways[m])));
  EditModel result;
  result.model.gaussians = joined(models);
  const EditModel& first = models.front().model;
  result.model.world_offset = first.model.world_offset;
  result.input_from_model = first.input_from_model;
  result.model.antialiased = options.antialiased.value_or(first.model.antialiased);
  result.model.sh_degree = 0;
  for (const auto& [name, part] : models) {
    result.model.sh_degree = std::max(result.model.sh_degree, part.model.sh_degree);
    result.model.is_ours &= part.model.is_ours;
    result.cameras.insert(result.cameras.end(), part.cameras.begin(), part.cameras.end());
  }
  return result;
}

}  // namespace gs
