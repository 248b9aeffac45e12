// SPDX-License-Identifier: Apache-2.0
// Frames of a model for a page elsewhere, rendered by a backend and sent as JPEG: one at a time, on a thread of its own.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <future>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "gs_app/view/frame_request.h"
#include "gs_core/gaussians.h"
#include "gs_render/render_pass.h"

namespace gs {

struct RenderedFrame {
  std::string jpeg;
  double milliseconds = 0;  // rendering, without the encoder
};

class FrameRenderer {
 public:
  /// The model stays on the host, too. Throws Error where the device cannot be had.
  FrameRenderer(const std::string& device, const GaussianModel& model,
                const RenderSettings& settings);
  ~FrameRenderer();
  FrameRenderer(const FrameRenderer&) = delete;
  FrameRenderer& operator=(const FrameRenderer&) = delete;

  /// Waits for its turn; nothing where a newer request of the same client came before that. From any thread. Throws Error.
  std::optional<RenderedFrame> frame(const FrameRequest& request);
  /// "cpu", "cuda:0 (...)"
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
  std::string device_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> waiting_;  // one of each client
  bool quit_ = false;
  std::thread thread_;  // the backend's: a GPU is chosen thread by thread
};

}  // namespace gs
