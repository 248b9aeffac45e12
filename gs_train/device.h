// SPDX-License-Identifier: Apache-2.0
// What the host asks of the device of a backend, whatever is computed there.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/memory.h"
#include "gs_core/scene.h"
#include "gs_render/stage_time.h"

namespace gs {

/// The defaults are those of a device that takes photos from where they lie, and does not know its
/// clock.
class Device {
 public:
  virtual ~Device() = default;
  virtual std::string name() const = 0;  // as in results.json: "cpu", "cuda:0 (NVIDIA H200)"
  /// Makes it the current one of the calling thread. A thread that may have used another GPU calls
  /// it before it works with this backend.
  virtual void make_current() {}
  /// The stream of its work (cudaStream_t); null where there is none.
  virtual void* stream() { return nullptr; }
  virtual Memory& memory() = 0;

  /// Announces the views that steps will use, so that their photos can be uploaded, up to
  /// `photo_bytes` of the device's memory. The views live until the next upload_views(), or as long
  /// as the backend.
  virtual void upload_views(const std::vector<View>&, [[maybe_unused]] std::size_t photo_bytes) {}
  /// Announces a view about kPhotosAhead steps before its step, so that its photo can be decoded in
  /// the background. Called in the order of the steps.
  virtual void prefetch_decode(const View& view) { prefetch_photo(view); }
  /// Announces the view with which the step after the next one begins, so that its photo can be
  /// uploaded during the next one.
  virtual void prefetch_next(const View&) {}

  /// Starts or stops timing the stages. Starting discards earlier times and may wait for the
  /// device.
  virtual void set_profiling(bool on) = 0;
  /// The times of the stages since timing was last started, in pipeline order. May wait for the
  /// device.
  virtual std::vector<StageTime> stage_times() = 0;
  /// The clock of its processors while they are busy, in MHz, for benchmarks; may wait for the
  /// device. Nothing where it is not known.
  virtual std::optional<double> clock_mhz() { return std::nullopt; }
};

}  // namespace gs
