// SPDX-License-Identifier: Apache-2.0
// `gemsplat bench`: times training and rendering of one backend, stage by stage. Start reading this
// folder here.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/checks/stage_traffic.h"
#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/backend.h"

namespace gs {

/// The number of runs of each measurement. A run is a training step or a frame.
struct BenchmarkPlan {
  int steps = 200, warmup = 50;      // timed training steps, and untimed ones before them
  int frames = 5;                    // timed frames of each view, after one that is not timed
  std::vector<double> scales = {1};  // picture sizes for rendering, as multiples of the views' size
  // is called after each run, timed or not
  std::function<void(std::size_t done, std::size_t total)> after_run = [](auto...) {};
};

/// The time of one stage (the median of its runs), its share, and its memory bandwidth.
struct StageFigures {
  std::string stage;
  double milliseconds = 0;
  double share = 0;                     // of the sum of all stages
  std::optional<double> bytes;          // that it must read and write, if memory limits it
  std::optional<double> gb_per_second;  // these bytes over its time, in 1e9 bytes
};

struct TrainingFigures {
  double ms_per_step = 0;            // wall time, without profiling
  std::vector<StageFigures> stages;  // empty if the backend does not time stages
};

struct RenderingFigures {
  double scale = 1;
  int width = 0, height = 0;  // pixels, of the first view
  Workload mean;              // over the views
  double ms_per_frame = 0;    // median of each view's frames, mean over the views
  std::vector<StageFigures> stages;
};

/// Throws UsageError if a view at one of the scales exceeds the largest picture.
void check_scales(const std::vector<View>& views, const std::vector<double>& scales);

/// A training model of these Gaussians in memory that the backend trains in: rows in Morton order,
/// as training keeps them, and zero moments in this form.
TrainingModel benchmark_model(Backend& backend, const GaussianModel& from,
                              MomentStorage moments = MomentStorage::floats);

/// The workload of one view, averaged over `views`.
Workload mean_workload(Backend& backend, const TrainingModel& model, const std::vector<View>& views,
                       const RenderSettings& settings);

/// Times training steps on all views in turn. Learning rates are zero, so that every step sees the
/// same model, but each step computes and moves as much as any other. `workload` gives the stages'
/// bytes. The views must outlive the backend's next upload_views().
TrainingFigures time_training(Backend& backend, TrainingModel& model,
                              const std::vector<View>& views, const RenderSettings& settings,
                              const Config& config, const BenchmarkPlan& plan,
                              const Workload& workload);

/// What the steps of time_training() are expected to take of a GPU's memory at most. `workload` is
/// that of a view in the mean.
double forecast_gpu_bytes(const TrainingModel& model, const std::vector<View>& views,
                          const RenderSettings& settings, const Config& config,
                          const Workload& workload);

/// Times frames of every view at `scale` times its size, which check_scales() has accepted, drawn
/// from a packed model (Renderer::pack).
RenderingFigures time_rendering(Backend& backend, TrainingModel& model,
                                const std::vector<View>& views, const RenderSettings& settings,
                                const BenchmarkPlan& plan, double scale);

/// Bandwidth of copies within the backend's memory, reads and writes together, in 1e9 bytes per
/// second. Nothing if there is too little memory for it.
std::optional<double> copy_gb_per_second(Backend& backend);

}  // namespace gs
