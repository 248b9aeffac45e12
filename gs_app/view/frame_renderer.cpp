// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/frame_renderer.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "gs_app/pictures/pictures.h"
#include "gs_app/run/make_backend.h"

namespace gs {
namespace {

constexpr std::size_t kMostDepths = 20000;  // a sample that is large enough for the range of depths

// The depths of evenly chosen pixels that show something, sorted.
std::vector<float> some_depths(const ImageF& depth) {
  std::vector<float> depths;
  for (const std::size_t i : evenly_chosen(depth.pixels.size(), kMostDepths))
    if (depth.pixels[i] > 0) depths.push_back(depth.pixels[i]);
  std::sort(depths.begin(), depths.end());
  return depths;
}

// The backend and the copy of the model on its device. Only the renderer's thread uses them.
class DeviceModel {
 public:
  DeviceModel(const std::string& device, const GaussianModel& model, const RenderSettings& settings,
              const LookOf& look_of)
      : look_of_(look_of), backend_(make_backend(device)),
        gaussians_(copy_to(backend_->memory(), model)),
        pictures_(*backend_, gaussians_, model.gaussians, settings, true) {}

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
    const Quantity shown = request.quantity;
    const std::unique_ptr<Appearance> look =
        request.look && look_of_ ? look_of_(*request.look) : nullptr;
    if (shown == Quantity::color && !look) return pictures_.color(request.camera);
    const ImageF values = std::move(pictures_.values(request.camera, {shown}, look.get()).front());
    return gs::picture_of(shown, values,
                          shown == Quantity::depth ? range_of(some_depths(values)) : DepthRange());
  }

  const LookOf& look_of_;
  std::unique_ptr<Backend> backend_;
  Gaussians gaussians_;
  ViewPictures pictures_;
};

}  // namespace

FrameRenderer::FrameRenderer(const std::string& device, const GaussianModel& model,
                             const RenderSettings& settings, LookOf look_of)
    : model_(model), settings_(settings), look_of_(std::move(look_of)) {
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
  std::optional<DeviceModel> device_model;
  try {
    device_model.emplace(device, model_, settings_, look_of_);
    ready.set_value(device_model->device());
  } catch (...) {
    return ready.set_exception(std::current_exception());
  }
  while (std::optional<Job> job = next()) {
    try {
      job->result.set_value(device_model->take(job->request));
    } catch (...) {
      job->result.set_exception(std::current_exception());
    }
  }
}

}  // namespace gs
