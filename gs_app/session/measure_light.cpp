// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/measure_light.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_app/run/make_backend.h"
#include "gs_core/system/log.h"
#include "gs_train/loop/trainer.h"
#include "gs_train/photometric/gains.h"

namespace gs {
namespace {

constexpr int kSteps = 1200;
constexpr int kReduction = 4;           // of the photos, in each direction
constexpr float kRate = 0.02f;          // of the gains, so that they arrive in so short a run
constexpr double kLeastSpread = 0.075;  // scenes of the bench: docs/lab/2026-11-photometric.md

// Colors do not depend on the direction, so that gains alone explain light.
Config config_of_short_run(const Config& config) {
  Config run;
  run.train.iterations = kSteps;
  run.train.seed = config.train.seed;
  run.train.photo_gib = config.train.photo_gib;
  run.train.resolution_ramp = {kReduction};
  run.train.resolution_every = 30000;  // in all steps
  run.model.sh_degree = 0;
  run.density.until_step = 0;  // points are enough for brightness
  run.loss.depth_weight = 0;
  run.photometric.model = kGainsModel;
  run.photometric.rate = kRate;
  return run;
}

}  // namespace

double gain_spread(const Config& config, const Scene& scene) {
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  Trainer trainer(scene, config_of_short_run(config), *backend);
  trainer.run();
  const PhotometricState& state = trainer.model().photometric;
  const std::vector<float> values = state.values.download();
  const std::size_t count = state.size();
  double sum = 0;
  for (std::size_t i = 0; i < count; ++i) sum += double(values[i]) * double(values[i]);
  return std::sqrt(sum / double(count));
}

PhotometricChoice choose_photometric_by_run(const Config& config, const Scene& scene) {
  if (scene.points.empty())
    return {false,
            "it is not known how much the photos differ in light, because the scene has no "
            "points"};
  log_info(
      "photometric.model auto: the points have no tracks, so a run of {} steps on reduced "
      "photos measures the light",
      kSteps);
  const double spread = gain_spread(config, scene);
  const bool differs = spread >= kLeastSpread;
  return {differs,
          fmt::format("{}: gains differ by {:.1f} % between photos",
                      differs ? "the photos differ in light" : "the photos hardly differ in light",
                      100 * spread)};
}

}  // namespace gs
