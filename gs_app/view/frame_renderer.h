// SPDX-License-Identifier: Apache-2.0
// Renders frames for `gemsplat view --remote` as JPEGs, one at a time, on a thread of its own.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "gs_app/view/frame_request.h"
#include "gs_core/gaussians.h"
#include "gs_render/render_pass.h"
#include "gs_train/photometric/appearance.h"

namespace gs {

struct RenderedFrame {
  std::string jpeg;
  double milliseconds = 0;  // of rendering, without the JPEG encoder
};

/// The look of a camera's photo; null: neutral. Called from one thread.
using LookOf = std::function<std::unique_ptr<Appearance>(std::size_t camera)>;

class FrameRenderer {
 public:
  /// `model` must outlive this; it is copied to the device. Throws Error if the device is not
  /// available.
  FrameRenderer(const std::string& device, const GaussianModel& model,
                const RenderSettings& settings, LookOf look_of = {});
  ~FrameRenderer();
  FrameRenderer(const FrameRenderer&) = delete;
  FrameRenderer& operator=(const FrameRenderer&) = delete;

  /// Waits for its turn and renders. Returns nothing if a newer request of the same client has
  /// arrived while it waited. May be called from any thread. Throws Error.
  std::optional<RenderedFrame> frame(const FrameRequest& request);
  /// The backend's name, e.g. "cpu" or "cuda:0 (...)".
  const std::string& device() const { return device_; }

 private:
  struct Job {
    FrameRequest request;
    std::promise<std::optional<RenderedFrame>> result;
  };
  void serve(const std::string& device, std::promise<std::string> ready);
  std::optional<Job> next();

  const GaussianModel& model_;
  const RenderSettings settings_;
  const LookOf look_of_;
  std::string device_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> waiting_;  // at most one of each client
  bool quit_ = false;
  std::thread thread_;  // the only one that uses the backend: CUDA selects its device per thread
};

}  // namespace gs
