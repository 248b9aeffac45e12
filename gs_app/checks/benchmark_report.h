// SPDX-License-Identifier: Apache-2.0
// What `gemsplat bench` has measured, as JSON for scripts and as a table for people.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gs_app/checks/benchmark.h"

namespace gs {

/// The model and views that are timed.
struct BenchmarkSubject {
  std::string model, scene;  // their files, or "generated"
  GaussianModel gaussians;
  std::vector<View> train_views, test_views;
  RenderSettings settings;
  Config config;

  const std::vector<View>& rendered_views() const {
    return test_views.empty() ? train_views : test_views;
  }
};

struct BenchmarkReport {
  std::string device;
  TrainingFigures training;
  Workload workload;  // of a training view, averaged
  std::vector<RenderingFigures> rendering;
  std::optional<double> copy_gb_per_second;
  std::optional<double> clock_mhz;  // of a GPU's multiprocessors while they are busy
  std::optional<std::size_t> peak_gpu_bytes;
  double forecast_gpu_bytes = 0;  // of training; only on a GPU
};

std::string report_json(const BenchmarkSubject& subject, const BenchmarkPlan& plan,
                        const BenchmarkReport& report);

std::string report_text(const BenchmarkSubject& subject, const BenchmarkPlan& plan,
                        const BenchmarkReport& report);

}  // namespace gs
