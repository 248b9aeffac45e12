// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/benchmark.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>

#include "gs_app/checks/untrained.h"
#include "gs_core/error.h"
#include "gs_core/forecast/gpu_step.h"
#include "gs_core/forecast/training_memory.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/view/view_splat.h"
#include "gs_core/system/bytes.h"
#include "gs_core/system/log.h"
#include "gs_train/loss.h"

namespace gs {
namespace {

constexpr std::size_t kDeviceCopyBytes = std::size_t(1) << 30;  // much larger than caches
// Larger than caches, but fits small machines.
constexpr std::size_t kHostCopyBytes = std::size_t(1) << 28;
constexpr int kCopies = 8;

/// Of an even number of values, the mean of the two in the middle; 0 for none.
double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const std::size_t n = values.size();
  std::sort(values.begin(), values.end());
  return (values[(n - 1) / 2] + values[n / 2]) / 2;
}

// The camera with a picture `scale` times as large.
Camera at_scale(const Camera& camera, double scale) {
  const auto side = [&](int pixels) { return std::max(1, int(std::lround(pixels * scale))); };
  return resized(camera, side(camera.width), side(camera.height));
}

double milliseconds_now() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double, std::milli>(Clock::now().time_since_epoch()).count();
}

std::vector<StageFigures> figures_of(Backend& backend, const Workload& workload) {
  // stage_traffic.h describes the GPU's stages.
  const bool is_gpu = &backend.memory() != &host_memory();
  std::vector<StageFigures> figures;
  double sum = 0;
  for (const StageTime& time : backend.device().stage_times()) {
    const double ms = median({time.milliseconds.begin(), time.milliseconds.end()});
    const std::optional<double> bytes = is_gpu ? stage_bytes(time.stage, workload) : std::nullopt;
    figures.push_back({time.stage, ms, 0, bytes, std::nullopt});
    if (bytes && ms > 0) figures.back().gb_per_second = *bytes / ms * 1e-6;
    sum += ms;
  }
  for (StageFigures& stage : figures) stage.share = sum > 0 ? stage.milliseconds / sum : 0;
  return figures;
}

// The workload of a pass that was rendered with these settings.
Workload workload_of(const RenderPass& pass, const RenderSettings& settings) {
  Workload workload;
  workload.gaussians = double(pass.tile_counts.size());
  workload.pixels = double(pass.pixel_count());
  workload.tiles = double(pass.tile_count());
  workload.sh_degree = settings.sh_degree;
  for (const std::uint32_t tiles : pass.tile_counts.download()) {
    workload.visible += tiles > 0;
    workload.instances += tiles;
  }
  const std::vector<std::uint32_t> ranges = pass.tile_ranges.download();
  for (std::size_t tile = 0; tile + 1 < ranges.size(); ++tile)
    workload.longest_list =
        std::max(workload.longest_list, double(ranges[tile + 1] - ranges[tile]));
  return workload;
}

// Adds one of `count` views to their mean.
void add_to_mean(const Workload& view, std::size_t count, Workload& mean) {
  const double weight = 1 / double(count);
  mean.gaussians += weight * view.gaussians;
  mean.visible += weight * view.visible;
  mean.instances += weight * view.instances;
  mean.most_instances = std::max(mean.most_instances, view.instances);
  mean.longest_list += weight * view.longest_list;
  mean.pixels += weight * view.pixels;
  mean.tiles += weight * view.tiles;
  mean.sh_degree = view.sh_degree;
}

}  // namespace

void check_scales(const std::vector<View>& views, const std::vector<double>& scales) {
  for (const View& view : views)
    for (const double scale : scales) {
      const Camera camera = at_scale(view.camera, scale);
      if (std::max(camera.width, camera.height) > kMaxPictureSide)
        throw UsageError(
            fmt::format("a picture of {}x{} is too large: a side has at most {} "
                        "pixels; give smaller --scales",
                        camera.width, camera.height, kMaxPictureSide));
    }
}

namespace {

// The run of a benchmark, whose Gaussians stay as many as they are.
TrainingSize benchmark_size(const Gaussians& gaussians, const std::vector<View>& views,
                            const Config& config) {
  TrainingSize size = training_size(config, picture_sizes(views), double(gaussians.count()));
  size.growth = RowGrowth::none;
  size.has_sums = size.has_score_pass = size.has_depth_maps = false;
  size.map_bytes = 0;
  size.has_time = gaussians.has_time;
  size.has_filter = gaussians.has_filter;
  return size;
}

}  // namespace

TrainingModel benchmark_model(Backend& backend, const GaussianModel& from, MomentStorage moments) {
  TrainingModel model = untrained(from, backend.memory(), moments);
  backend.rows().sort_by_morton(model);
  return model;
}

Workload mean_workload(Backend& backend, const TrainingModel& model, const std::vector<View>& views,
                       const RenderSettings& settings) {
  Workload mean;
  RenderPass pass(backend.memory());
  for (const View& view : views) {
    backend.renderer().forward(model.gaussians.span(), view.camera, settings, pass);
    add_to_mean(workload_of(pass, settings), views.size(), mean);
  }
  mean.moments = model.moment_storage();
  return mean;
}

TrainingFigures time_training(Backend& backend, TrainingModel& model,
                              const std::vector<View>& views, const RenderSettings& settings,
                              const Config& config, const BenchmarkPlan& plan,
                              const Workload& workload) {
  backend.device().upload_views(views, std::size_t(double(config.train.photo_gib) * kBytesPerGib));
  RenderSettings training = settings;
  training.for_backward = true;
  const std::size_t batch = std::size_t(config.train.batch);
  const Update update{{}, batch_rule(config.train.batch)};  // all rates are zero
  std::vector<TrainingPhoto> photos(batch);
  std::size_t next = 0, done = 0;
  const std::size_t total = std::size_t(plan.warmup) + 2 * std::size_t(plan.steps);
  const auto milliseconds_of = [&](int steps) {
    backend.synchronize(model);
    const double begin = milliseconds_now();
    for (int step = 0; step < steps; ++step) {
      for (TrainingPhoto& photo : photos) photo = {&views[next++ % views.size()], training};
      backend.device().prefetch_next(views[next % views.size()]);
      backend.step(model, {{photos.data(), batch},
                           {config.loss.lambda_dssim},
                           update,
                           {.gather_statistics = true}});
      plan.after_run(++done, total);
    }
    backend.synchronize(model);
    return milliseconds_now() - begin;
  };

  TrainingFigures figures;
  milliseconds_of(plan.warmup);
  figures.ms_per_step = milliseconds_of(plan.steps) / plan.steps;
  backend.device().set_profiling(true);
  milliseconds_of(plan.steps);
  figures.stages = figures_of(backend, workload);
  backend.device().set_profiling(false);
  return figures;
}

double forecast_gpu_bytes(const TrainingModel& model, const std::vector<View>& views,
                          const RenderSettings& settings, const Config& config,
                          const Workload& workload) {
  const double count = double(model.count());
  TrainingSize size = benchmark_size(model.gaussians, views, config);
  size.is_deterministic = settings.deterministic;
  if (count > 0)
    size.instance_places = capacity_of_views(model.count(), workload.most_instances) / count;
  return training_bytes(size);
}

RenderingFigures time_rendering(Backend& backend, TrainingModel& model,
                                const std::vector<View>& views, const RenderSettings& settings,
                                const BenchmarkPlan& plan, double scale) {
  RenderPass pass(backend.memory());
  RenderSettings viewing = settings;
  viewing.for_backward = false;
  const std::unique_ptr<PackedScene> scene =
      backend.renderer().pack(model.gaussians.span(), viewing);
  std::size_t done = 0;
  const std::size_t total = views.size() * (2 * std::size_t(plan.frames) + 1);
  const auto milliseconds_of_frame = [&](const Camera& camera) {
    const double begin = milliseconds_now();
    backend.renderer().draw(*scene, camera, viewing, pass);
    backend.synchronize(model);
    const double milliseconds = milliseconds_now() - begin;
    plan.after_run(++done, total);
    return milliseconds;
  };
  const auto median_frame = [&](const Camera& camera) {
    std::vector<double> frames(std::size_t(plan.frames));
    for (double& frame : frames) frame = milliseconds_of_frame(camera);
    return median(frames);
  };

  RenderingFigures figures;
  figures.scale = scale;
  figures.mean.is_packed = !model.gaussians.has_time;
  std::vector<Camera> cameras;
  for (const View& view : views) cameras.push_back(at_scale(view.camera, scale));
  figures.width = cameras.front().width;
  figures.height = cameras.front().height;
  for (const Camera& camera : cameras) {
    milliseconds_of_frame(camera);
    figures.mean.splat_bytes = pass.splats.empty() ? sizeof(ViewSplat) : sizeof(Splat);
    add_to_mean(workload_of(pass, settings), cameras.size(), figures.mean);
    figures.ms_per_frame += median_frame(camera) / double(cameras.size());
  }
  backend.device().set_profiling(true);
  for (const Camera& camera : cameras) median_frame(camera);
  figures.stages = figures_of(backend, figures.mean);
  backend.device().set_profiling(false);
  return figures;
}

std::optional<double> copy_gb_per_second(Backend& backend) {
  Memory& memory = backend.memory();
  const std::size_t bytes = &memory == &host_memory() ? kHostCopyBytes : kDeviceCopyBytes;
  try {
    Buffer<std::uint8_t> from(bytes, memory), to(bytes, memory);
    from.fill_zero();
    const auto milliseconds_of = [&](int copies) {
      const double begin = milliseconds_now();
      for (int i = 0; i < copies; ++i) memory.copy(to.data(), from.data(), bytes);
      std::uint8_t last;
      memory.download(&last, to.data() + bytes - 1, 1);  // waits for the copies
      return milliseconds_now() - begin;
    };
    milliseconds_of(1);
    return 2.0 * double(bytes) * kCopies / milliseconds_of(kCopies) * 1e-6;
  } catch (const Error& error) {
    if (error.code() != ExitCode::out_of_memory) throw;
    log_warning(
        "the copy bandwidth was not measured: there is too little memory for it beside the model");
    return std::nullopt;
  }
}

}  // namespace gs
