// SPDX-License-Identifier: Apache-2.0
// The rows of a model in training, and the one list of their columns.
#pragma once

#include <string_view>

#include "gs_core/math/density/growth.h"
#include "gs_core/moment_arrays.h"

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

/// The columns of statistics, which may be const.
template <class Statistics>
ColumnsIn<Statistics> statistic_columns(Statistics& of) {
  const char* const group = "statistics";
  ColumnsIn<Statistics> columns{{RowRole::statistic, group, "visits", &of.visits},
                                {RowRole::statistic, group, "gradient_norm", &of.gradient_norm}};
  if (of.has_sums) columns.push_back({RowRole::statistic, group, "sums", &of.sums});
  return columns;
}

/// The parameters, Adam's moments and the statistics of N Gaussians. A new array is a member and a
/// row of for_each_array(), columns_in() or statistic_columns(): row operations, checkpoints,
/// copies and forecasts then treat it like the others.
struct ModelRows {
  Gaussians gaussians;
  StoredMoments moments;  // of Adam, as optimizer.moments says
  DensityStatistics statistics;

  explicit ModelRows(Memory& memory = host_memory())
      : gaussians(memory), moments(AdamMoments<FloatMoments>(memory)), statistics(memory) {}
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
  /// Moments have the learned quantities of the parameters from now on. Call it before rows are
  /// added.
  void match_moments() {
    std::visit([this](auto& arrays) { arrays.has_time = gaussians.has_time; }, moments);
  }
  /// Has the columns of `like` from now on. Call it before rows are added.
  void match_columns(const ModelRows& like) {
    if (moment_storage() != like.moment_storage()) store_moments_as(like.moment_storage());
    gaussians.has_time = like.gaussians.has_time;
    gaussians.has_filter = like.gaussians.has_filter;
    statistics.has_sums = like.statistics.has_sums;
    match_moments();
  }
  /// All arrays with a row per Gaussian, in a fixed order.
  Columns columns() { return columns_of(*this); }
  ConstColumns columns() const { return columns_of(*this); }

 private:
  template <class Model>
  static ColumnsIn<Model> columns_of(Model& model) {
    ColumnsIn<Model> all = model.gaussians.columns();
    const auto add = [&all](const ColumnsIn<Model>& more) {
      all.insert(all.end(), more.begin(), more.end());
    };
    add(std::visit([](auto& of) { return columns_in(of, RowRole::moment, "moments"); },
                   model.moments));
    add(statistic_columns(model.statistics));
    return all;
  }
};

/// Zeros the columns of a role, for example all statistics.
inline void clear_columns(ModelRows& model, RowRole role) {
  for (const Column& column : model.columns())
    if (column.role == role) column.rows->fill_zero();
}

/// Gives the statistics sums over fragments, zeros, where they have none yet.
inline void begin_sums(ModelRows& model) {
  DensityStatistics& statistics = model.statistics;
  if (statistics.has_sums) return;
  statistics.sums.resize_discard(model.count());
  statistics.sums.fill_zero();
  statistics.has_sums = true;
}

/// Zeros the moments of the opacities, or all of them, or none.
inline void clear_moments(ModelRows& model, MomentClearing which) {
  for (const Column& column : model.columns())
    if (column.role == RowRole::moment &&
        (which == MomentClearing::all ||
         (which == MomentClearing::opacity && std::string_view(column.name) == "logit_opacity")))
      column.rows->fill_zero();
}

/// Gives the model `count` rows. The first ones stay as they are; new ones are undefined.
inline void resize_rows(ModelRows& model, std::size_t count) {
  for (const Column& column : model.columns()) column.rows->resize(count);
}

}  // namespace gs
