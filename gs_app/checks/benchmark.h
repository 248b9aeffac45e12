// SPDX-License-Identifier: Apache-2.0
// Times one backend at training and rendering: what `gemsplat bench` reports.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gs_app/checks/stage_traffic.h"
#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/backend.h"

namespace gs {

/// How often to run what.
struct BenchmarkPlan {
  int steps = 200, warmup = 50;      // training steps that are timed, and those before them
  int frames = 5;                    // of each rendered view, after one that is not counted
  std::vector<double> scales = {1};  // of the views' size, for rendering
};

/// One stage: the median of its runs, and what that makes of its share and of the memory's speed.
struct StageFigures {
  std::string stage;
  double milliseconds = 0;
  double share = 0;                     // of the sum of all stages
  std::optional<double> bytes;          // that it has to move, where memory limits it
  std::optional<double> gb_per_second;  // at that, 1e9 bytes
};

struct TrainingFigures {
  double ms_per_step = 0;            // wall time, nothing profiled
  std::vector<StageFigures> stages;  // empty where the backend does not time stages
};

struct RenderingFigures {
  double scale = 1;
  int width = 0, height = 0;         // pixels, of the first view
  Workload mean;                     // over the views
  double ms_per_frame = 0;           // median of each view's frames, mean over the views
  std::vector<StageFigures> stages;
};

/// The same view in a picture so many times as large.
Camera at_scale(const Camera& camera, double scale);

/// Throws UsageError where a view at a scale is too large a picture.
void check_scales(const std::vector<View>& views, const std::vector<double>& scales);

/// A model of these Gaussians in the backend's memory, rows in Morton order as training keeps them, moments zero.
TrainingModel benchmark_model(Backend& backend, const GaussianModel& from);

/// What one view asks of the stages, in the mean.
Workload mean_workload(Backend& backend, const TrainingModel& model, const std::vector<View>& views,
                       const RenderSettings& settings);

/// Training steps on all views in turn, at learning rates of zero, so that each step finds the same model; what is
/// computed and moved is what any step computes and moves. The views outlive the backend's next upload_views().
/// workload: for the stages' bytes
TrainingFigures time_training(Backend& backend, TrainingModel& model,
                              const std::vector<View>& views, const RenderSettings& settings,
                              const Config& config, const BenchmarkPlan& plan,
                              const Workload& workload);

/// Frames of every view at `scale` times its size; see check_scales().
RenderingFigures time_rendering(Backend& backend, TrainingModel& model,
                                const std::vector<View>& views, const RenderSettings& settings,
                                const BenchmarkPlan& plan, double scale);

/// Bytes read and written per second by copies within the backend's memory, in 1e9; nothing where it has no room.
std::optional<double> copy_gb_per_second(Backend& backend);

}  // namespace gs
