// SPDX-License-Identifier: Apache-2.0
// The times of the scalar stages: measured while profiling is on, and kept until they are read.
#include "gs_render/stage_clock.h"

#include "gs_render/renderer.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

std::vector<std::string> stages() {
  std::vector<std::string> names;
  for (const StageTime& time : host_stage_clock().times()) names.push_back(time.stage);
  return names;
}

void render() {
  const Camera camera = random_camera(40, 30, 1);
  const Gaussians gaussians = random_gaussians(kTypical, 50, camera, 3);
  RenderPass pass(host_memory());
  make_scalar_renderer()->forward(gaussians.span(), camera, {}, pass);
}

TEST(StageClock, TimesEachRunOfEachStageInOrderWhileItIsOn) {
  host_stage_clock().set_on(true);
  render();
  render();
  EXPECT_THAT(stages(), ElementsAre("preprocess", "depth sort", "instances", "tile sort", "blend"));
  for (const StageTime& time : host_stage_clock().times()) {
    EXPECT_EQ(time.milliseconds.size(), 2u) << time.stage;
    EXPECT_GE(time.milliseconds[0], 0.0f) << time.stage;
  }
  host_stage_clock().set_on(false);
}

TEST(StageClock, KeepsItsTimesWhenItIsOffUntilItIsOnAgain) {
  host_stage_clock().set_on(true);
  render();
  host_stage_clock().set_on(false);
  render();
  EXPECT_EQ(host_stage_clock().times().at(0).milliseconds.size(), 1u);
  host_stage_clock().set_on(true);
  EXPECT_TRUE(host_stage_clock().times().empty());
  host_stage_clock().set_on(false);
}

}  // namespace
}  // namespace gs
