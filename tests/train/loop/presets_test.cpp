// SPDX-License-Identifier: Apache-2.0
// Every preset trains, and so do the defaults: a few steps of each on a small scene, with
// refinements and opacity resets in them.
#include "gs_core/config/config_presets.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

/// The small scene, with the time of each photo.
Scene scene_of(const Config& config) {
  Scene scene = small_scene();
  if (!config.model.dynamic) return scene;
  const std::size_t count = scene.train_views.size();
  for (std::size_t i = 0; i < count; ++i)
    scene.train_views[i].camera.time = float(i) / float(count - 1);
  scene.time_count = count;
  return scene;
}

constexpr std::string_view kDefaults = "default";

std::vector<Preset> presets_and_defaults() {
  std::vector<Preset> all = presets();
  all.push_back({kDefaults, ""});
  return all;
}

/// The preset with 160 steps and up to 150 Gaussians: refinements every 16 from step 16 on, and
/// resets every 60.
Config short_preset(const std::string& name) {
  Config config;
  if (name != kDefaults) load_config(config, name);
  config.train.iterations = 160;
  config.train.steps_scaler = 1;
  config.optimizer.position_lr_initial = 1e-3f;
  config.optimizer.log_scale_lr = config.optimizer.sh0_lr = 0.02f;
  DensityConfig& density = config.density;
  density.max_gaussians = 150;
  density.from_step = density.every = 16;
  density.gradient_threshold = std::min(density.gradient_threshold, 1e-5f);
  density.reset_opacity_every = 60;
  if (config.photometric.model == kAutoPhotometricModel) config.photometric.model = "gains";
  if (config.model.dynamic) density.reset_opacity_until = 0;  // too few photos of each moment
  return config;
}

class PresetRun : public ::testing::TestWithParam<Preset> {};

TEST_P(PresetRun, LearnsInAFewSteps) {
  const Config config = short_preset(std::string(GetParam().name));
  validate(config);
  const Scene scene = scene_of(config);
  const auto backend = make_scalar_backend();
  Trainer trainer(scene, config, *backend);
  const std::size_t first = trainer.gaussian_count();
  const double first_psnr = psnr_of(*backend, trainer, scene.train_views);
  trainer.run();
  EXPECT_NE(trainer.gaussian_count(), first);
  EXPECT_EQ(backend->rows().count_not_finite(trainer.model()), 0u);
  EXPECT_GT(psnr_of(*backend, trainer, scene.train_views), first_psnr);
}

INSTANTIATE_TEST_SUITE_P(Each, PresetRun, ::testing::ValuesIn(presets_and_defaults()),
                         [](const auto& preset) { return std::string(preset.param.name); });

}  // namespace
}  // namespace gs
