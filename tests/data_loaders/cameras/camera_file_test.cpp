// SPDX-License-Identifier: Apache-2.0
// cameras.json in the form that the viewers of the reference trainer read: writing and reading
// back.
#include "data_loaders/cameras/camera_file.h"

#include <gmock/gmock.h>

#include <cmath>

#include "gs_core/error.h"
#include "gs_core/math/random.h"
#include "gs_core/system/text/json.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"
#include "tests/support/lens_scenes.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

/// A view with a random pose; its rotation is that of a random quaternion.
View random_view(const std::string& name, std::uint64_t seed) {
  const Vec4f q = Random{seed, RandomStream::test}.normal4(0);
  const Vec4f t = Random{seed, RandomStream::test}.normal4(1);
  const float length = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  const float w = q.w / length, x = q.x / length, y = q.y / length, z = q.z / length;
  View view;
  view.name = name;
  Camera& camera = view.camera;
  camera.width = 1600;
  camera.height = 1063;
  camera.fx = 1159.58807f;
  camera.fy = 1164.66016f;
  camera.cx = 799.1f;
  camera.cy = 533.9f;
  camera.cam_from_world_rotation = {
      {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
      {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
      {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
  camera.cam_from_world_translation = {3 * t.x, 3 * t.y, 3 * t.z};
  return view;
}

Scene small_scene() {
  Scene scene;
  scene.train_views = {random_view("b/left.001.jpg", 1), random_view("c.png", 2)};
  scene.test_views = {random_view("a/\"quoted\".jpg", 3)};
  return scene;
}

void expect_near(const Vec3f& a, const Vec3f& b, float tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

class CameraFile : public FolderTest {
 protected:
  std::filesystem::path file() const { return path("cameras.json"); }
  std::string error_reading(const std::string& text) const {
    write_bytes(file(), text);
    return error_of([&] { read_cameras_json(file()); });
  }
};

/// One camera as the reference writes it; `change` replaces or adds keys, null removes one.
std::string reference_text(const std::string& change = "{}") {
  auto camera = SortedJson::parse(R"({"id": 0, "img_name": "DSC05572", "width": 640, "height": 480,
      "position": [1.0, 2.0, 3.0], "rotation": [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
      "fy": 501.25, "fx": 500.5})");
  camera.merge_patch(SortedJson::parse(change));
  return "[" + camera.dump() + "]";
}

TEST_F(CameraFile, RoundTripKeepsIntrinsicsAndPose) {
  const Scene scene = small_scene();
  write_cameras_json(file(), scene);
  const auto cameras = read_cameras_json(file());
  ASSERT_EQ(cameras.size(), 3u);
  EXPECT_EQ(cameras[0].name, "a/\"quoted\"");  // test views stand first
  EXPECT_EQ(cameras[1].name, "b/left.001");
  EXPECT_EQ(cameras[2].name, "c");
  const View* views[] = {&scene.test_views[0], &scene.train_views[0], &scene.train_views[1]};
  for (int i = 0; i < 3; ++i) {
    const Camera &got = cameras[i].camera, &expected = views[i]->camera;
    EXPECT_EQ(got.width, expected.width);
    EXPECT_EQ(got.height, expected.height);
    EXPECT_EQ(got.fx, expected.fx);
    EXPECT_EQ(got.fy, expected.fy);
    EXPECT_EQ(got.cx, expected.cx);
    EXPECT_EQ(got.cy, expected.cy);
    EXPECT_EQ(got.cam_from_world_rotation.row0, expected.cam_from_world_rotation.row0);
    EXPECT_EQ(got.cam_from_world_rotation.row1, expected.cam_from_world_rotation.row1);
    EXPECT_EQ(got.cam_from_world_rotation.row2, expected.cam_from_world_rotation.row2);
    // The center is rounded to float once, and a float rotation is orthonormal up to a few 1e-7.
    expect_near(got.cam_from_world_translation, expected.cam_from_world_translation, 3e-6f);
  }
}

TEST_F(CameraFile, WritesTheReferencesKeysInItsOrder) {
  Scene scene;
  scene.train_views = {random_view("x.jpg", 1)};
  Camera& camera = scene.train_views[0].camera;
  camera.cam_from_world_rotation = {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}};
  camera.cam_from_world_translation = {0.1f, 2, 3};
  write_cameras_json(file(), scene);
  EXPECT_EQ(
      read_bytes(file()),
      "[\n{\"id\":0,\"img_name\":\"x\",\"width\":1600,\"height\":1063,"
      "\"position\":[-0.1,3.0,-2.0],\"rotation\":[[1.0,0.0,0.0],[0.0,0.0,-1.0],[0.0,1.0,0.0]],"
      "\"fy\":1164.6602,\"fx\":1159.588,\"cx\":799.1,\"cy\":533.9}\n]\n");
}

TEST_F(CameraFile, ReadsTheReferencesFile) {
  write_bytes(file(), reference_text());
  const auto cameras = read_cameras_json(file());
  ASSERT_EQ(cameras.size(), 1u);
  EXPECT_EQ(cameras[0].name, "DSC05572");
  const Camera& camera = cameras[0].camera;
  EXPECT_EQ(camera.fx, 500.5f);
  EXPECT_EQ(camera.fy, 501.25f);
  EXPECT_EQ(camera.cx, 320);  // the center of the picture
  EXPECT_EQ(camera.cy, 240);
  EXPECT_EQ(camera.cam_from_world_rotation.row1, Vec3f(0, 0, 1));
  expect_near(camera.position(), {1, 2, 3}, 0);
}

TEST_F(CameraFile, EmptySceneIsAnEmptyList) {
  write_cameras_json(file(), Scene());
  EXPECT_TRUE(read_cameras_json(file()).empty());
}

TEST_F(CameraFile, KeepsTheLensOfACamera) {
  std::vector<NamedCamera> cameras;
  for (const LensScene& lens : lens_scenes())
    cameras.push_back(
        {lens.name, with_lens(random_camera(64, 48, 1), lens.model, lens.params, lens.motion)});
  Camera parallel = random_camera(64, 48, 2);
  parallel.lens = endless_lens<float>(Lens::orthographic);
  cameras.push_back({"parallel", parallel});
  write_cameras_json(file(), cameras);
  const std::vector<NamedCamera> read = read_cameras_json(file());
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    CameraLens<float> lens = cameras[i].camera.lens;
    if (has_angle_chart(lens.lens))  // of which nobody reads the range of u
      lens.low = endless_lens<float>(lens.lens).low,
      lens.high = endless_lens<float>(lens.lens).high;
    EXPECT_EQ(read[i].camera.lens, lens) << cameras[i].name;
  }
}

TEST_F(CameraFile, EveryMissingKeyIsNamed) {
  for (const std::string key :
       {"img_name", "width", "height", "position", "rotation", "fx", "fy"}) {
    EXPECT_THAT(error_reading(reference_text("{\"" + key + "\": null}")),
                AllOf(StartsWith("cannot read " + file().string() + ": camera 0"),
                      HasSubstr("lacks " + key)));
  }
}

TEST_F(CameraFile, WrongValuesAreNamed) {
  const std::pair<const char*, const char*> cases[] = {
      {R"({"img_name": 7})", "img_name"},
      {R"({"width": 0})", "0 as width"},
      {R"({"width": -5})", "-5 as width"},
      {R"({"height": 10.5})", "10.5 as height"},
      {R"({"height": 1e30})", "as height"},
      {R"({"width": "640"})", "no number as width"},
      {R"({"fx": 0})", "0 as fx"},
      {R"({"fy": true})", "no number as fy"},
      {R"({"cx": []})", "no number as cx"},
      {R"({"position": [1, 2]})", "three numbers in position"},
      {R"({"position": [1, 2, "3"]})", "position"},
      {R"({"rotation": [1, 2, 3]})", "three numbers in rotation"},
      {R"({"rotation": [[2, 0, 0], [0, 2, 0], [0, 0, 2]]})", "not a rotation matrix"},
      {R"({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]})", "not a rotation matrix"},
      {R"({"lens": 3})", "lens.kind"},
      {R"({"lens": {"kind": "teapot"}})", "lens.kind"},
      {R"({"lens": {"kind": "fisheye", "k": [1]}})", "6 numbers in lens.k"},
      {R"({"lens": {"kind": "fisheye", "radius": [-1]}})", "lens.radius"},
      {R"({"lens": {"kind": "fisheye", "turn": [0, 0, 1]}})", "lens.rows"},
  };
  for (const auto& [change, expected] : cases) {
    EXPECT_THAT(error_reading(reference_text(change)), HasSubstr(expected)) << change;
  }
}

TEST_F(CameraFile, WhatIsNoListOfCamerasIsAnError) {
  EXPECT_THAT(error_reading(""), HasSubstr("not JSON"));
  EXPECT_THAT(error_reading("{}"), HasSubstr("not a list of cameras"));
  EXPECT_THAT(error_reading("[3]"), HasSubstr("camera 0 of the list is not an object"));
  EXPECT_THAT(error_reading("[1e999]"), HasSubstr("not finite"));
  EXPECT_THAT(error_reading(std::string(100'000, '[')), HasSubstr("deeper than 64"));
  const std::string text = reference_text();
  for (std::size_t length = 0; length < text.size(); ++length) {
    EXPECT_THAT(error_reading(text.substr(0, length)), HasSubstr("not JSON from byte"));
  }
}

TEST_F(CameraFile, MissingFileIsNamed) {
  EXPECT_THROW(read_cameras_json(path("none.json")), Error);
}

}  // namespace
}  // namespace gs
