// SPDX-License-Identifier: Apache-2.0
#include "cli/frame_renderer.h"

#include <algorithm>
#include <chrono>

#include "cli/devices.h"
#include "cli/painted.h"
#include "cli/pictures.h"
#include "data_loaders/photos.h"

namespace gs {
namespace {

// What the thread of the renderer holds.
class Studio {
 public:
  Studio(const std::string& device, const GaussianModel& model, const RenderSettings& settings)
      : backend_(make_backend(device)), settings_(settings),
        gaussians_(copy_to(backend_->memory(), model)), pass_(backend_->memory()),
        painted_(backend_->renderer(), gaussians_, model.gaussians) {}

  std::string device() const { return backend_->name(); }

  RenderedFrame take(const FrameRequest& request) {
    using Clock = std::chrono::steady_clock;
    const auto begin = Clock::now();
    const Image8 picture = picture_of(request);
    const std::chrono::duration<double, std::milli> time = Clock::now() - begin;
    const std::vector<std::uint8_t> jpeg = encode_jpeg(picture, request.quality);
    return {std::string(jpeg.begin(), jpeg.end()), time.count()};
  }

 private:
  Image8 picture_of(const FrameRequest& request) {
    if (request.mode == FrameMode::depth) return painted_.depth(request.camera, settings_);
    if (request.mode == FrameMode::normal) return painted_.normals(request.camera, settings_);
    backend_->renderer().forward(gaussians_.span(), request.camera, settings_, pass_);
    return to_image8(image_of(pass_));
  }

  std::unique_ptr<Backend> backend_;
  RenderSettings settings_;
  Gaussians gaussians_;
  RenderPass pass_;
  PaintedModel painted_;
};

}  // namespace

FrameRenderer::FrameRenderer(const std::string& device, const GaussianModel& model,
                             const RenderSettings& settings)
    : model_(model), settings_(settings) {
  std::promise<std::string> ready;
  std::future<std::string> name = ready.get_future();
  thread_ = std::thread(
      [this, device, ready = std::move(ready)]() mutable { serve(device, std::move(ready)); });
  try {
    device_ = name.get();
  } catch (...) {
    thread_.join();
    throw;
  }
}

FrameRenderer::~FrameRenderer() {
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
    for (Job& job : waiting_) job.result.set_value(std::nullopt);
    waiting_.clear();
  }
  changed_.notify_all();
  thread_.join();
}

std::optional<RenderedFrame> FrameRenderer::frame(const FrameRequest& request) {
  Job job{request, {}};
  std::future<std::optional<RenderedFrame>> result = job.result.get_future();
  {
    const std::lock_guard lock(mutex_);
    if (quit_) return std::nullopt;
    const auto older = std::find_if(waiting_.begin(), waiting_.end(), [&](const Job& other) {
      return other.request.client == request.client;
    });
    if (older == waiting_.end()) {
      waiting_.push_back(std::move(job));
    } else {
      older->result.set_value(std::nullopt);
      *older = std::move(job);
    }
  }
  changed_.notify_one();
  return result.get();
}

std::optional<FrameRenderer::Job> FrameRenderer::next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return quit_ || !waiting_.empty(); });
  if (quit_) return std::nullopt;
  std::optional<Job> job(std::move(waiting_.front()));
  waiting_.pop_front();
  return job;
}

void FrameRenderer::serve(const std::string& device, std::promise<std::string> ready) {
  std::optional<Studio> studio;
  try {
    studio.emplace(device, model_, settings_);
    ready.set_value(studio->device());
  } catch (...) {
    return ready.set_exception(std::current_exception());
  }
  while (std::optional<Job> job = next()) {
    try {
      job->result.set_value(studio->take(job->request));
    } catch (...) {
      job->result.set_exception(std::current_exception());
    }
  }
}

}  // namespace gs
