// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/colmap/world_offset.h"

#include <gmock/gmock.h>

#include "data_loaders/cameras/camera_file.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/tracked_scene.h"

namespace gs {
namespace {

using testing::HasSubstr;

const ColmapCamera kPinhole{1, CameraModel::pinhole, 32, 24, {26, 25.8, 15.8, 12.2}};
const Vec3d kUtm(500123.25, 5400456.75, 312.5);

/// The model as if its origin stood at kUtm.
ColmapModel far_model(ColmapModel model) {
  take_off(model, -kUtm);
  return model;
}

Scene loaded(const ColmapModel& model) {
  const TempFolder temp;
  write_scene(temp.path(), model);
  DatasetConfig dataset;
  dataset.source = temp.path().string();
  return load_scene(dataset);
}

double apart(const Vec3d& a, const Vec3d& b) { return std::sqrt(inner(a - b, a - b)); }

TEST(WorldOffset, SceneInUtmCoordinatesLoadsToTheSameLocalGeometry) {
  const ColmapModel near = tracked_model(kPinhole, 9, 60);
  const Scene local = loaded(near), utm = loaded(far_model(near));
  EXPECT_EQ(local.world_offset, Vec3d(0.0));
  EXPECT_LT(apart(utm.world_offset, kUtm), 5);  // near the cameras
  const double tolerance = 1e-5 * local.extent;
  EXPECT_NEAR(utm.extent, local.extent, tolerance);
  for (std::size_t i = 0; i < local.train_views.size(); ++i) {
    const Camera &a = local.train_views[i].camera, &b = utm.train_views[i].camera;
    EXPECT_LT(apart(Vec3d(a.position()) + kUtm, Vec3d(b.position()) + utm.world_offset), tolerance);
    EXPECT_EQ(a.cam_from_world_rotation.row0, b.cam_from_world_rotation.row0);
  }
  ASSERT_EQ(utm.points.size(), local.points.size());
  for (std::size_t i = 0; i < local.points.size(); ++i)
    EXPECT_LT(apart(Vec3d(local.points[i].position) + kUtm,
                    Vec3d(utm.points[i].position) + utm.world_offset),
              tolerance);
}

TEST(WorldOffset, IsRoundAndOnlyTakenWhereSinglePrecisionLosesDetail) {
  const auto offset_at = [](const Vec3d& place, double size) {
    ColmapModel model = tracked_model(kPinhole, 9, 10);
    for (ColmapImage& image : model.images) image.cam_from_world_translation *= size;
    take_off(model, -place);
    return world_offset_of(model);
  };
  EXPECT_EQ(offset_at({0, 0, 0}, 1), Vec3d(0.0));
  EXPECT_EQ(offset_at({5000, 0, 0}, 1), Vec3d(0.0));  // steps of 0.0005: 1e-4 of 4
  EXPECT_NE(offset_at({50000, 0, 0}, 1), Vec3d(0.0));
  EXPECT_EQ(offset_at({50000, 0, 0}, 1000), Vec3d(0.0));  // large scenes tolerate more
  for (const double size : {0.01, 1.0, 300.0}) {
    const Vec3d offset = offset_at(kUtm, size);
    // at most the spread of the cameras, which is some 3 times size
    const double step = size < 0.1 ? 0.01 : size < 10 ? 1 : 100;
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(offset[axis] / step, std::round(offset[axis] / step), 1e-6) << size;
    EXPECT_LT(apart(offset, kUtm), 5 * size);
  }
}

TEST(WorldOffset, CamerasOfOneHeightAreMeasuredByTheirPoints) {
  ColmapModel model = tracked_model(kPinhole, 3, 50);
  for (ColmapImage& image : model.images)  // a panorama: one position for all cameras
    image.cam_from_world_translation = Vec3d(0.0);
  EXPECT_NE(world_offset_of(far_model(model)), Vec3d(0.0));
  model.points.clear();
  EXPECT_EQ(world_offset_of(far_model(model)), Vec3d(0.0));  // there is no spread to compare with
  EXPECT_EQ(world_offset_of(ColmapModel()), Vec3d(0.0));
}

TEST(WorldOffset, SceneIsBroughtToTheOffsetOfAnother) {
  const ColmapModel near = tracked_model(kPinhole, 9, 60);
  Scene scene = loaded(far_model(near));
  const Vec3d before = Vec3d(scene.train_views[3].camera.position()) + scene.world_offset;
  const Vec3d point = Vec3d(scene.points[7].position) + scene.world_offset;
  bring_to_offset(scene, scene.world_offset + Vec3d(3, -5, 1));
  EXPECT_LT(apart(Vec3d(scene.train_views[3].camera.position()) + scene.world_offset, before),
            1e-5);
  EXPECT_LT(apart(Vec3d(scene.points[7].position) + scene.world_offset, point), 1e-5);
}

TEST(WorldOffset, PlyKeepsItAsACommentAndBringsItBack) {
  const TempFolder temp;
  GaussianModel model{Gaussians(2, host_memory()), 0};
  for_each_array([](const char*, auto& array) { array.fill_zero(); }, model.gaussians);
  write_gaussian_ply(temp.path() / "near.ply", model);
  model.world_offset = kUtm;
  write_gaussian_ply(temp.path() / "far.ply", model);
  EXPECT_EQ(read_gaussian_ply(temp.path() / "near.ply").world_offset, Vec3d(0.0));
  EXPECT_EQ(read_gaussian_ply(temp.path() / "far.ply").world_offset, kUtm);
  EXPECT_THAT(read_bytes(temp.path() / "far.ply"),
              HasSubstr("comment world_offset 500123.25 5400456.75 312.5\n"));
  write_point_ply(temp.path() / "points.ply", {}, kUtm);
  EXPECT_THAT(read_bytes(temp.path() / "points.ply"), HasSubstr("comment world_offset 500123.25"));
  write_world_offset(temp.path() / "world_offset.json", kUtm);
  EXPECT_EQ(read_bytes(temp.path() / "world_offset.json"),
            "{\"world_offset\": [500123.25, 5400456.75, 312.5]}\n");
}

TEST(WorldOffset, CamerasOfAFileAreTakenInTheirOwnCoordinatesOrInTheModels) {
  const TempFolder temp;
  const auto camera_at = [](const char* position) {
    std::string text(
        "[{\"img_name\": \"a\", \"width\": 8, \"height\": 8, \"fx\": 9, \"fy\": 9, "
        "\"rotation\": [[1,0,0],[0,1,0],[0,0,1]], \"position\": ");
    return text.append(position).append("}]");
  };
  write_bytes(temp.path() / "own.json", camera_at("[500124.375, 5400455.75, 312.625]"));
  write_bytes(temp.path() / "run.json", camera_at("[1.125, -1, 0.125]"));
  for (const char* file : {"own.json", "run.json"}) {
    const auto cameras = read_cameras_json(temp.path() / file, kUtm);
    EXPECT_EQ(cameras.at(0).camera.position(), Vec3f(1.125f, -1, 0.125f)) << file;
  }
}

}  // namespace
}  // namespace gs
