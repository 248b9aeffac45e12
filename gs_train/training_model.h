// SPDX-License-Identifier: Apache-2.0
// Everything that training changes, and the one list of its arrays.
#pragma once

#include <string>
#include <type_traits>

#include "gs_core/error.h"
#include "gs_core/gaussians.h"
#include "gs_core/math/density/growth.h"
#include "gs_core/moment_arrays.h"
#include "gs_train/photometric/photometric_state.h"
#include "gs_train/poses/pose_state.h"

namespace gs {

/// What density control looks at, gathered over the steps since the last refinement.
struct DensityStatistics {
  Buffer<float> visits;         // (N) steps in which the Gaussian was visible
  Buffer<float> gradient_norm;  // (N) sum of |(W/2, H/2) * dL/dmean2d| over those steps
  // Scores that need them have sums over fragments, too; otherwise the array is empty.
  bool has_sums = false;
  Buffer<FragmentSums> sums;  // (N)

  explicit DensityStatistics(Memory& memory = host_memory())
      : visits(memory), gradient_norm(memory), sums(memory) {}
};

/// Calls f(name, a.array, b.array, ...) for each statistic that `first` has.
template <class F, class First, class... Rest>
void for_each_statistic(F&& f, First&& first, Rest&&... rest) {
  f("visits", first.visits, rest.visits...);
  f("gradient_norm", first.gradient_norm, rest.gradient_norm...);
  if (first.has_sums) f("sums", first.sums, rest.sums...);
}

/// The parameters, Adam's moments and the statistics of N Gaussians. A new array is a member
/// here and a line in for_each_row_array(): row operations, checkpoints and copies then treat it
/// like the others.
struct TrainingModel {
  Gaussians gaussians;
  StoredMoments moments;  // of Adam, as optimizer.moments says
  DensityStatistics statistics;
  PhotometricState photometric;  // of the photos; empty without photometric.model
  PoseState poses;               // of the photos; empty without poses.refine
  // updates since the start; one count for all Gaussians, as in Kerbl et al. 2023
  int adam_steps = 0;
  // Gaussians before the first step; a growth curve begins there. 0: not known
  std::size_t first_count = 0;

  explicit TrainingModel(Memory& memory = host_memory())
      : gaussians(memory), moments(AdamMoments<FloatMoments>(memory)), statistics(memory),
        photometric(memory) {}
  std::size_t count() const { return gaussians.count(); }
  /// Where its arrays lie.
  Memory& memory() const { return gaussians.memory(); }
  MomentStorage moment_storage() const { return MomentStorage(moments.index()); }
  /// Stores moments like this from now on. Call it before rows are added.
  void store_moments_as(MomentStorage storage) {
    if (storage == MomentStorage::halves)
      moments = AdamMoments<HalfMoments>(memory());
    else
      moments = AdamMoments<FloatMoments>(memory());
  }
  /// Says that parameters and moments have the learned quantities of `like`. Call it before rows are
  /// added.
  void set_learned_arrays(const Gaussians& like) {
    take_learned_arrays(gaussians, like);
    std::visit([&](auto& arrays) { take_learned_arrays(arrays, like); }, moments);
  }
};

/// What an array holds. It decides what the row of a new Gaussian starts with.
enum class RowRole {
  parameter,  // a new Gaussian has those of the Gaussian that it is made from
  moment,     // of Adam; a new Gaussian starts with zeros
  statistic,  // of density control; every Gaussian starts with zeros after a refinement
};

/// One array of a TrainingModel, for example {moment, "moments", "mean"}.
struct RowArray {
  RowRole role;
  const char* group;
  const char* name;

  /// "moments.mean": checkpoint files name their sections like this.
  std::string key() const { return std::string(group) + "." + name; }
};

/// Calls f(RowArray, a.array, b.array, ...) for every array that has one row per Gaussian, in a
/// fixed order. The models may be const, and all of them store moments as the first one does.
template <class F, class First, class... Rest>
void for_each_row_array(F&& f, First&& first, Rest&&... rest) {
  const auto visit = [&f](RowRole role, const char* group) {
    return [&f, role, group](const char* name, auto&... arrays) {
      f(RowArray{role, group, name}, arrays...);
    };
  };
  for_each_stored_array(visit(RowRole::parameter, "gaussians"), first.gaussians, rest.gaussians...);
  std::visit(
      [&]<class Moments>(Moments& moments) {
        for_each_array(visit(RowRole::moment, "moments"), moments,
                       std::get<std::remove_const_t<Moments>>(rest.moments)...);
      },
      first.moments);
  for_each_statistic(visit(RowRole::statistic, "statistics"), first.statistics, rest.statistics...);
}

/// Sets moments and statistics to zero, as before the first step. The parameters must be set.
inline void clear_history(TrainingModel& model) {
  const std::size_t count = model.count();
  model.set_learned_arrays(model.gaussians);
  for_each_row_array(
      [count](const RowArray& which, auto& array) {
        if (which.role == RowRole::parameter) return;
        array.resize(count);
        array.fill_zero();
      },
      model);
  model.adam_steps = 0;
  model.first_count = count;
}

/// Gives the statistics sums over fragments, zeros, where they have none yet.
inline void begin_sums(TrainingModel& model) {
  DensityStatistics& statistics = model.statistics;
  if (statistics.has_sums) return;
  statistics.sums.resize_discard(model.count());
  statistics.sums.fill_zero();
  statistics.has_sums = true;
}

/// Zeros all statistics.
inline void clear_statistics(TrainingModel& model) {
  for_each_statistic([](const char*, auto& array) { array.fill_zero(); }, model.statistics);
}

/// Zeros the moments of the opacities, or all of them, or none.
inline void clear_moments(TrainingModel& model, MomentClearing which) {
  std::visit(
      [which](auto& moments) {
        if (which == MomentClearing::opacity) moments.logit_opacity.fill_zero();
        if (which == MomentClearing::all)
          for_each_array([](const char*, auto& array) { array.fill_zero(); }, moments);
      },
      model.moments);
}

/// A copy of everything, in another memory.
inline TrainingModel copy_to(Memory& memory, const TrainingModel& from) {
  TrainingModel model(memory);
  model.store_moments_as(from.moment_storage());
  model.set_learned_arrays(from.gaussians);
  model.gaussians.has_filter = from.gaussians.has_filter;
  model.statistics.has_sums = from.statistics.has_sums;
  for_each_row_array(
      [](const RowArray&, auto& to, const auto& array) { to.upload(array.download()); }, model,
      from);
  model.photometric = copy_to(memory, from.photometric);
  model.poses = from.poses;
  model.adam_steps = from.adam_steps;
  model.first_count = from.first_count;
  return model;
}

/// Gives the model `count` rows. The first ones stay as they are; new ones are undefined.
inline void resize_rows(TrainingModel& model, std::size_t count) {
  for_each_row_array([count](const RowArray&, auto& array) { array.resize(count); }, model);
}

}  // namespace gs
