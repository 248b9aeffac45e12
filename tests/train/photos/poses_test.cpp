// SPDX-License-Identifier: Apache-2.0
// Poses that are refined: which photos move as one, an update, and what all have in common.
#include "gs_train/poses/poses.h"

#include "gs_core/geometry/vectors.h"
#include "tests/support/poses.h"

namespace gs {
namespace {

Config refining() {
  Config config = adaptive_config();
  config.poses.refine = true;
  return config;
}

TrainingModel model_for(const Scene& scene) {
  TrainingModel model;
  begin_poses(refining(), scene, model);
  return model;
}

TEST(Poses, AreThereOnlyWhereTheyAreRefined) {
  TrainingModel model;
  begin_poses(adaptive_config(), small_scene(), model);
  EXPECT_TRUE(model.poses.empty());
  EXPECT_EQ(model_for(small_scene()).poses.rows, 8u);
}

TEST(Poses, BeginAsGiven) {
  const Scene scene = small_scene();
  const TrainingModel model = model_for(scene);
  for (std::size_t i = 0; i < scene.train_views.size(); ++i) {
    const Camera given = scene.train_views[i].camera,
                 camera = refined_camera(model.poses, scene.train_views[i].camera, i);
    EXPECT_EQ(camera.cam_from_world_rotation.row1, given.cam_from_world_rotation.row1);
    EXPECT_LT(length(camera.cam_from_world_translation - given.cam_from_world_translation), 1e-6f);
  }
}

TEST(Poses, OfARigFrameMoveAsOne) {
  Scene scene = small_scene();
  for (const std::size_t i : {1, 4, 6}) scene.train_views[i].rig_frame = 9;
  TrainingModel model = model_for(scene);
  EXPECT_THAT(model.poses.row_of, ElementsAre(0, 1, 2, 3, 1, 4, 1, 5));
  model.poses.values[6 + 1] = 0.1f;  // the turn of the rig
  const auto distance = [](const Camera& a, const Camera& b) {
    return length(a.position() - b.position());
  };
  const std::vector<Camera> now = refined_cameras(model.poses, scene.train_views);
  const auto given = [&](std::size_t i) { return scene.train_views[i].camera; };
  EXPECT_NEAR(distance(now[1], now[4]), distance(given(1), given(4)), 1e-5);
  EXPECT_GT(distance(now[1], given(1)), 0.05f);
  EXPECT_LT(distance(now[2], given(2)), 1e-6f);
}

TEST(Poses, OfOtherPhotosAreRefused) {
  TrainingModel model = model_for(small_scene());
  Scene smaller = small_scene();
  smaller.train_views.pop_back();
  EXPECT_THAT(error_of([&] { begin_poses(refining(), smaller, model); }),
              HasSubstr("refined poses of 8 photos"));
}

// An orbit in which all photos are disturbed, and then moved as one similarity would move them.
TEST(Poses, HaveNothingInCommonAfterCentering) {
  const Scene scene = small_scene();
  TrainingModel model = model_for(scene);
  PoseState& state = model.poses;
  disturb(state, 0.01, 0.02);
  take_out_modes(state);
  const std::vector<float> own = state.values.download();
  add_similarity(state, {0.003, -0.002, 0.001}, {0.01, 0.02, -0.03}, 0.01);
  EXPECT_GT(largest_difference(state.values.download(), own), 1e-3);
  take_out_modes(state);
  EXPECT_LT(largest_difference(state.values.download(), own), 1e-6);
}

TEST(Poses, TheirPullIsTheGradientOfItsPenalty) {
  const Scene scene = small_scene();
  TrainingModel model = model_for(scene);
  disturb(model.poses, 0.01, 0.02);
  const std::vector<float> before = model.poses.values.download();
  std::vector<double> gradient(before.size(), 0.0);
  update_table(model.poses, pose_pulls(model.poses), 1e-5f, AdamRule(), gradient);
  // The first moment of the first update is a tenth of the gradient.
  for (std::size_t i = 0; i < before.size(); ++i) {
    const double sigma = i % 6 < 3 ? 0.5 * 3.14159265 / 180 : 0.01;
    const float first = model.poses.moments[i].first;
    EXPECT_NEAR(10 * first, 1e-4 / 8 * before[i] / (sigma * sigma), 1e-4 * std::abs(10 * first));
  }
}

}  // namespace
}  // namespace gs
