// SPDX-License-Identifier: Apache-2.0
// The update is a single block, because there are few numbers, and because all sums then have an
// order of their own: the same bits come out each time. Sums are in double, as in the scalar twin.
#include "cuda/photo_terms/photo_table.cuh"

#include "cuda/device/block_sums.cuh"
#include "gs_core/math/loss/pull.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // a power of two for the sums

/// A table on the device.
struct TableValues {
  float* values;
  FloatMoments* moments;
  const float* start;
  double* gradient;
  const double* modes;  // (mode_count, count)
  double mode_length2;
  int count, of_row, mode_count;
};

/// Thread t takes the numbers t, t + kThreads, ... in all loops.
__global__ void __launch_bounds__(kThreads)
    update_kernel(TableValues n, PhotoPulls pulls, AdamStep step, AdamRule rule,
                  const std::uint32_t* halted) {
  if (*halted) return;
  for (int i = int(threadIdx.x); i < n.count; i += kThreads) {
    const PhotoPull& pull = pulls[std::size_t(i % n.of_row)];
    const double of_pull =
        pull_vjp(double(n.values[i]), double(n.start[i]), pull.weight, pull.spread);
    adam_update(n.values[i], n.moments[i], float(n.gradient[i] + of_pull), step, rule);
    n.gradient[i] = 0;
  }
  __shared__ double shared[1][kThreads];
  for (int k = 0; k < n.mode_count; ++k) {
    const double* const mode = n.modes + std::size_t(k) * std::size_t(n.count);
    double sum[1] = {0};
    for (int i = int(threadIdx.x); i < n.count; i += kThreads)
      sum[0] += mode[i] * double(n.values[i]);
    __syncthreads();  // all have read the share before
    sum_by_remainder<1>(sum, shared);
    const double share = shared[0][0] / n.mode_length2;
    for (int i = int(threadIdx.x); i < n.count; i += kThreads)
      n.values[i] = float(double(n.values[i]) - share * mode[i]);
  }
}

}  // namespace

void PhotoTableStage::begin(const PhotoTable& table) {
  if (gradient_.size() == table.size()) return;
  gradient_.resize_discard(table.size());
  gradient_.fill_zero();
}

void PhotoTableStage::update(PhotoTable& table, const PhotoPulls& pulls,
                             const PhotoTableUpdate& update, const std::uint32_t* halted) {
  const StageScope scope(context_, name_);
  const TableValues values{table.values.data(), table.moments.data(), table.start.data(),
                           gradient_.data(),    table.modes.data(),   table.mode_length2,
                           int(table.size()),   int(table.numbers),   int(table.mode_count())};
  context_.launch(name_, update_kernel, 1, kThreads, values, pulls, update.adam, update.rule,
                  halted);
}

}  // namespace gs::cuda
