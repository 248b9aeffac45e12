// SPDX-License-Identifier: Apache-2.0
// The same cameras in every form that gemsplat reads.
#include "data_loaders/cameras/read_cameras.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "data_loaders/lenses/undistort.h"
#include "gs_core/error.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/text/json.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class ReadCameras : public FolderTest {
 protected:
  std::vector<NamedCamera> read(const std::string& name, const Vec3d& offset = Vec3d(0.0)) const {
    return read_cameras(path(name), offset);
  }
  std::string error(const std::string& name) const {
    return error_of([&] { read(name); });
  }
};

/// Three images, out of order, each turned and elsewhere.
ColmapModel turned_model(const Vec3d& moved = Vec3d(0.0)) {
  ColmapModel model = small_model(3);
  std::swap(model.images[0], model.images[2]);
  for (std::size_t i = 0; i < 3; ++i) {
    ColmapImage& image = model.images[i];
    const double half = 0.3 + 0.2 * double(i);
    image.cam_from_world_rotation = {std::cos(half), 0.6 * std::sin(half), 0, 0.8 * std::sin(half)};
    const Vec3d center = Vec3d(double(i), 2.0, -1.0) + moved;
    image.cam_from_world_translation =
        -multiply(rotation_matrix(image.cam_from_world_rotation), center);
  }
  return model;
}

/// The same in OpenGL's axes, as nerfstudio writes it.
SortedJson transforms_of(const ColmapModel& model) {
  const ColmapCamera& camera = model.cameras.begin()->second;
  SortedJson json = {{"w", camera.width},        {"h", camera.height},
                     {"fl_x", camera.params[0]}, {"fl_y", camera.params[1]},
                     {"cx", camera.params[2]},   {"cy", camera.params[3]}};
  for (const ColmapImage& image : model.images) {
    const Mat3<double> R = rotation_matrix(image.cam_from_world_rotation);
    const Vec3d c = -multiply_transposed(R, image.cam_from_world_translation);
    json["frames"].push_back({{"file_path", image.name},
                              {"transform_matrix",
                               {{R.row0.x, -R.row1.x, -R.row2.x, c.x},
                                {R.row0.y, -R.row1.y, -R.row2.y, c.y},
                                {R.row0.z, -R.row1.z, -R.row2.z, c.z},
                                {0, 0, 0, 1}}}});
  }
  return json;
}

std::vector<std::string> names_of(const std::vector<NamedCamera>& cameras) {
  std::vector<std::string> names;
  for (const NamedCamera& named : cameras) names.push_back(named.name);
  return names;
}

const NamedCamera& named(const std::vector<NamedCamera>& cameras, const std::string& stem) {
  for (const NamedCamera& camera : cameras)
    if (fs::path(camera.name).stem() == stem) return camera;
  throw Error("no camera " + stem);
}

void expect_same(const std::vector<NamedCamera>& a, const std::vector<NamedCamera>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (const NamedCamera& one : a) {
    const Camera &x = one.camera, &y = named(b, fs::path(one.name).stem()).camera;
    EXPECT_EQ(x.width, y.width);
    EXPECT_EQ(x.height, y.height);
    for (const auto member : {&Camera::fx, &Camera::fy, &Camera::cx, &Camera::cy})
      EXPECT_NEAR(x.*member, y.*member, 1e-4);
    const Vec3f moved = x.position() - y.position();
    EXPECT_LT(std::sqrt(inner(moved, moved)), 1e-5) << one.name;
    const Vec3f turned = x.cam_from_world_rotation.row2 - y.cam_from_world_rotation.row2;
    EXPECT_LT(std::sqrt(inner(turned, turned)), 1e-5) << one.name;
  }
}

TEST_F(ReadCameras, ColmapModelsTransformsAndCameraFilesSayTheSame) {
  const ColmapModel model = turned_model();
  write_binary_model(path("binary/sparse/0"), model);
  write_text_model(path("text"), model);
  write_bytes(path("nerf/transforms.json"), transforms_of(model).dump());
  const auto expected = read("binary/sparse/0");
  EXPECT_THAT(names_of(expected), ElementsAre("a.png", "b.png", "c.png"));
  const Vec3f c = named(expected, "c").camera.position();
  EXPECT_NEAR(c.x, 0, 1e-6);
  EXPECT_NEAR(c.y, 2, 1e-6);
  EXPECT_EQ(expected[0].camera.fx, 10);
  expect_same(read("binary"), expected);
  expect_same(read("text"), expected);
  expect_same(read("nerf"), expected);
  expect_same(read("nerf/transforms.json"), expected);
  EXPECT_THAT(names_of(read("nerf")), ElementsAre("c.png", "b.png", "a.png"));  // its own order
  write_cameras_json(path("run/cameras.json"), expected);
  expect_same(read("run/cameras.json"), expected);
  expect_same(read("run"), expected);
}

TEST_F(ReadCameras, CamerasWrittenUnderTheirNamesKeepThem) {
  auto cameras = std::vector<NamedCamera>{{"left/frame.7", {}}, {"00001", {}}};
  for (NamedCamera& named : cameras) {
    named.camera.width = named.camera.height = 8;
    named.camera.fx = named.camera.fy = 8;
  }
  write_cameras_json(path("cameras.json"), cameras);
  EXPECT_THAT(names_of(read("cameras.json")), ElementsAre("left/frame.7", "00001"));
}

TEST_F(ReadCameras, TheWorldOffsetIsTakenOffInDoublePrecision) {
  const Vec3d offset(500000.0, 5400000.0, 100.0);
  write_binary_model(path("near"), turned_model());
  write_binary_model(path("far"), turned_model(offset));
  write_bytes(path("far.json"), transforms_of(turned_model(offset)).dump());
  const auto expected = read("near");
  expect_same(read("far", offset), expected);
  expect_same(read("far.json", offset), expected);
  expect_same(read("near", offset), expected);  // has it taken off already
}

TEST_F(ReadCameras, ALensBecomesThePinholeOfItsUndistortedPhoto) {
  ColmapModel model = small_model(1);
  model.cameras[7] = {7, CameraModel::simple_radial, 120, 80, {100, 60, 40, -0.1}};
  write_binary_model(path("model"), model);
  const Camera camera = read("model").at(0).camera;
  EXPECT_EQ(camera.fx, 100);
  EXPECT_GT(camera.width, 120);  // barrel distortion: the pinhole sees more at the sides
  model.cameras[7] = {7, CameraModel::equirectangular, 120, 60, {120, 60}};
  write_binary_model(path("sphere"), model);
  const auto halves = read("sphere");
  ASSERT_EQ(halves.size(), 2u);
  EXPECT_EQ(halves[1].name, "a.front.png");
  EXPECT_EQ(halves[1].camera.lens.lens, Lens::fisheye);
}

TEST_F(ReadCameras, WhatHoldsNoCameraIsNamed) {
  fs::create_directory(path("empty"));
  EXPECT_THAT(error("empty"), AllOf(HasSubstr(path("empty").string()), HasSubstr("COLMAP")));
  EXPECT_THAT(error("absent"), HasSubstr(path("absent").string()));
  write_bytes(path("none.json"), "[]");
  EXPECT_THAT(error("none.json"), HasSubstr("no camera"));
  write_bytes(path("other.json"), " {\"frames\": 3}");
  EXPECT_THAT(error("other.json"), HasSubstr("other.json"));
  write_bytes(path("empty.json"), "");
  EXPECT_THAT(error("empty.json"), HasSubstr("empty.json"));
}

}  // namespace
}  // namespace gs
