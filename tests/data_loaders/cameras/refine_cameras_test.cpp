// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment of models whose true cameras are known. Projections come from lens_cases.h,
// which shares no code with it.
#include "data_loaders/refine/refine_cameras.h"

#include <gmock/gmock.h>

#include "data_loaders/refine/refine_exposure.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/tracked_scene.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const ColmapCamera kPinhole{1, CameraModel::pinhole, 320, 240, {260, 258, 158, 122}};

/// The mean error of the centers over the images, in world units.
double mean_center_error(const ColmapModel& model, const ColmapModel& truth) {
  double sum = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const Vec3d off = center_of(model.images[i]) - center_of(truth.images[i]);
    sum += std::sqrt(inner(off, off)) / double(model.images.size());
  }
  return sum;
}

TEST(RefineCameras, NoiseIsRemovedFromPosesLensesAndPointsOfEveryModel) {
  std::vector<LensCase> cases = lens_cases();
  cases.push_back({"PINHOLE", kPinhole});
  cases.push_back({"SIMPLE_PINHOLE", {1, CameraModel::simple_pinhole, 320, 240, {250, 155, 118}}});
  for (const LensCase& lens : cases) {
    const ColmapModel truth = tracked_model(lens.camera, 8, 120);
    ColmapModel model = truth;
    disturb(model, {});
    const CameraRefinement refinement = refine_cameras(model);
    EXPECT_GT(refinement.mean_error_before, 1) << lens.label;
    // The remaining error comes from the prior on the lens.
    EXPECT_LT(refinement.mean_error_after, 0.01) << lens.label;
    EXPECT_TRUE(refinement.has_converged) << lens.label;
    EXPECT_EQ(refinement.images, 8u) << lens.label;
  }
}

TEST(RefineCameras, ModelThatIsOffByTensOfPixelsIsBroughtBackDespiteWrongMatches) {
  const ColmapCamera lens{
      1, CameraModel::opencv, 320, 240, {262, 258, 151, 127, -0.11, 0.02, 2e-3, -3e-3}};
  ColmapModel model = tracked_model(lens, 10, 300);
  for (ColmapImage& image : model.images)
    for (std::size_t i = 0; i < image.observations.size(); i += 12) image.observations[i].x = 7;
  disturb(model, {.pose = 0.05, .point = 0.1, .focal = 0.05});
  const CameraRefinement refinement = refine_cameras(model);
  EXPECT_GT(refinement.median_error_before, 10);
  // the wrong observations agree with one another, and pull a little
  EXPECT_LT(refinement.median_error_after, 0.01 * refinement.median_error_before);
}

TEST(RefineCameras, SceneKeepsItsPlaceScaleAndAxes) {
  const ColmapModel truth = tracked_model(kPinhole, 24, 300);
  ColmapModel noisy = truth;
  disturb(noisy, {});
  ColmapModel model = noisy;
  refine_cameras(model);
  // The frame is the mean of 24 noisy cameras: a fifth of one camera's noise of 0.01, rotated on an
  // arm of length 4.
  const double before = mean_center_error(noisy, truth), after = mean_center_error(model, truth);
  EXPECT_GT(before, 0.03);
  EXPECT_LT(after, 0.02);
  Vec3d moved(0.0);
  for (std::size_t i = 0; i < truth.images.size(); ++i) {
    moved += (center_of(model.images[i]) - center_of(noisy.images[i])) / 24.0;
    EXPECT_LT(turn_between(model.images[i], truth.images[i]), 0.4);
  }
  EXPECT_LT(std::sqrt(inner(moved, moved)), 0.01);
  for (std::size_t i = 0; i < truth.points.size(); ++i) {
    const Vec3d off = model.points[i].position - truth.points[i].position;
    EXPECT_LT(std::sqrt(inner(off, off)), 0.025) << i;
  }
}

TEST(RefineCameras, WhatIsRightAlreadyStaysWhereItIs) {
  const ColmapModel truth = tracked_model(kPinhole, 8, 200);
  ColmapModel model = truth;
  const CameraRefinement refinement = refine_cameras(model);
  EXPECT_LT(refinement.mean_error_after, 1e-6);
  EXPECT_LT(mean_center_error(model, truth), 1e-6);
  EXPECT_NEAR(model.cameras.at(1).params[0], 260, 1e-4);
}

TEST(RefineCameras, WrongMatchesDoNotBreakIt) {
  const Random random{8, RandomStream::test};
  const ColmapModel truth = tracked_model(kPinhole, 12, 300);
  ColmapModel model = truth;
  std::size_t wrong = 0, all = 0;
  for (ColmapImage& image : model.images)
    for (ColmapObservation& seen : image.observations) {
      const Vec4f u = random.uniform4(all++);
      if (u.w > 0.1f) continue;
      seen.x = 320.0 * u.x, seen.y = 240.0 * u.y;  // anywhere in the picture
      ++wrong;
    }
  ASSERT_GT(wrong, all / 12);
  disturb(model, {});
  const double before = mean_center_error(model, truth);
  const CameraRefinement refinement = refine_cameras(model);
  EXPECT_LT(refinement.median_error_after, 0.05);
  EXPECT_GT(refinement.mean_error_after, 5);  // wrong observations still count
  EXPECT_LT(mean_center_error(model, truth), 0.6 * before);
}

TEST(RefineCameras, PhotosOfARigFrameKeepTheirPosesToOneAnother) {
  ColmapModel truth = tracked_model(kPinhole, 8, 300);
  truth.cameras[2] = {2, CameraModel::simple_radial, 320, 240, {240, 160, 120, -0.05}};
  for (std::uint32_t i = 0; i < 8; ++i) {  // a second camera 0.3 to the right, turned by 3 degrees
    const double angle = 1.75 * (double(i) / 7 - 0.5);
    const Vec3d right(0.3 * std::cos(angle), 0.0, 0.3 * std::sin(angle));
    truth.images.push_back(
        posed_image(i + 101, 2, center_of(truth.images[i]) + right, angle + 0.05));
    truth.frames.push_back({i + 1, 1, {i + 1, i + 101}});
  }
  observe(truth);
  ColmapModel model = truth;
  // The frames move as a whole: the second image of each stays fixed to its first.
  const auto relative = [](const ColmapModel& of, std::size_t i) {
    const ColmapImage &a = of.images[i], &b = of.images[i + 8];
    return std::pair(in_camera(b, center_of(a)), turn_between(a, b));
  };
  const Random random{4, RandomStream::test};
  for (std::size_t i = 0; i < 8; ++i) {
    const Vec4f n = random.normal4(i);
    const Vec3d shift = Vec3d(n.x, n.y, n.z) * 0.05;
    for (ColmapImage* image : {&model.images[i], &model.images[i + 8]})
      image->cam_from_world_translation -=
          multiply(rotation_matrix(image->cam_from_world_rotation), shift);
  }
  for (ColmapPoint& point : model.points) point.position += Vec3d(0.02, -0.01, 0.015);
  const ColmapModel before = model;
  const CameraRefinement refinement = refine_cameras(model);
  EXPECT_GT(refinement.mean_error_before, 1);
  EXPECT_LT(refinement.mean_error_after, 0.01);
  for (std::size_t i = 0; i < 8; ++i) {
    const auto [at, turn] = relative(model, i);
    const auto [at_before, turn_before] = relative(before, i);
    EXPECT_NEAR(at.x, at_before.x, 1e-12);
    EXPECT_NEAR(at.y, at_before.y, 1e-12);
    EXPECT_NEAR(at.z, at_before.z, 1e-12);
    EXPECT_NEAR(turn, turn_before, 1e-5);  // degrees, through an arc cosine near 1
  }
}

TEST(RefineCameras, PhotoThatSeesNextToNothingStaysAsItIs) {
  ColmapModel model = tracked_model(kPinhole, 8, 200);
  disturb(model, {});
  model.images[3].observations.resize(5);
  const ColmapImage before = model.images[3];
  const CameraRefinement refinement = refine_cameras(model);
  EXPECT_EQ(refinement.images, 7u);
  EXPECT_EQ(model.images[3].cam_from_world_translation, before.cam_from_world_translation);
  EXPECT_EQ(model.images[3].cam_from_world_rotation.y, before.cam_from_world_rotation.y);
}

TEST(RefineCameras, IsTheSameOnEveryNumberOfThreadsAndShowsEachStep) {
  const int threads = thread_count();
  std::vector<ColmapModel> models(2, tracked_model(kPinhole, 8, 200));
  std::vector<std::size_t> steps;
  for (int k = 0; k < 2; ++k) {
    set_thread_count(1 + 2 * k);
    disturb(models[std::size_t(k)], {});
    steps.clear();
    refine_cameras(models[std::size_t(k)], [&](std::size_t step, std::size_t most) {
      EXPECT_LE(step, most);
      steps.push_back(step);
    });
  }
  set_thread_count(threads);
  EXPECT_GT(steps.size(), 3u);
  EXPECT_EQ(steps.front(), 0u);
  for (std::size_t i = 0; i < 8; ++i)
    EXPECT_EQ(models[0].images[i].cam_from_world_translation,
              models[1].images[i].cam_from_world_translation);
}

TEST(RefineCameras, ModelWithoutTracksIsRefusedWithAdvice) {
  ColmapModel model = small_model(3);
  model.folder = "scenes/a";
  try {
    refine_cameras(model);
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("scenes/a"), HasSubstr("--refine-cameras"),
                                    HasSubstr("dataset.model"), HasSubstr("POINTS2D")));
  }
}

TEST(RefineCameras, SceneIsLoadedWithTheRefinedCameras) {
  const TempFolder temp;
  const ColmapModel truth = tracked_model(kPinhole, 8, 200);
  ColmapModel model = truth;
  disturb(model, {.pose = 0.01, .point = 0.02, .focal = 0.02});
  write_scene(temp.path(), model);
  DatasetConfig dataset;
  dataset.source = temp.path().string();
  const Scene as_it_is = load_scene(dataset);
  dataset.refine_cameras = true;
  const Scene refined = load_scene(dataset);
  EXPECT_FALSE(as_it_is.refinement);
  ASSERT_TRUE(refined.refinement);
  EXPECT_LT(refined.refinement->mean_error_after, 0.02);
  EXPECT_NEAR(as_it_is.train_views[0].camera.fx, 260 * 1.02, 1e-3);
  EXPECT_NEAR(refined.train_views[0].camera.fx, 260, 1);
  EXPECT_EQ(refined.points.size(), truth.points.size());
  EXPECT_NE(refined.points[0].position, as_it_is.points[0].position);
}

}  // namespace
}  // namespace gs
