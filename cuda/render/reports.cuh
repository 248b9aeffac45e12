// SPDX-License-Identifier: Apache-2.0
// The reports of frames and of photos in training: the device writes them into host memory, so that
// the host learns how many instances a view has without a copy.
#pragma once

#include <algorithm>
#include <atomic>
#include <thread>

#include "cuda/stages.cuh"

namespace gs::cuda {

/// One thread of the device: writes a report.
__device__ inline void write_report(volatile StepReport* report, std::uint32_t instances,
                                    std::uint32_t halted, std::uint32_t step) {
  report->instances = instances;
  report->halted = halted;
  __threadfence_system();
  report->step = step;
}

/// The last `count` reports, by the number of their step. Numbers begin with 1.
class Reports {
 public:
  explicit Reports(std::size_t count) : count_(count) {
    void* memory = nullptr;
    check(cudaHostAlloc(&memory, count_ * sizeof(StepReport), cudaHostAllocMapped),
          "allocating page-locked memory");
    reports_ = static_cast<StepReport*>(memory);
    std::fill(reports_, reports_ + count_, StepReport{});
  }
  ~Reports() { cudaFreeHost(reports_); }
  Reports(const Reports&) = delete;
  Reports& operator=(const Reports&) = delete;

  StepReport* of_step(std::uint32_t step) { return reports_ + step % count_; }
  void clear(std::uint32_t step) { *of_step(step) = {}; }
  /// Where no kernel writes it: the step has fitted.
  void settle(std::uint32_t step) { *of_step(step) = {0, 0, 0, step}; }
  /// Returns true and fills `report` once the step's report has arrived.
  bool read(std::uint32_t step, StepReport& report) {
    const volatile StepReport* const from = of_step(step);
    if (from->step != step) return false;
    std::atomic_thread_fence(std::memory_order_acquire);
    report = {from->instances, from->halted, 0, step};
    return true;
  }
  /// Waits for the report of a step that was launched. The device may still be busy with what was
  /// launched behind it. Throws Error where a kernel has failed.
  StepReport wait(Context& context, std::uint32_t step) {
    StepReport report;
    while (!read(step, report)) {
      const cudaError_t state = cudaStreamQuery(context.stream());
      if (state == cudaErrorNotReady) {
        std::this_thread::yield();
        continue;
      }
      check(state, "a kernel");
      GS_CHECK(read(step, report));  // every kernel has run
      break;
    }
    return report;
  }

 private:
  std::size_t count_;
  StepReport* reports_;
};

}  // namespace gs::cuda
