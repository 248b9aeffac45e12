// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/popping.h"

#include "tests/support/scenes.h"

namespace gs {
namespace {

// A wall in the plane z = 4 with waves of color, and a post in front of its left part at z = 2, as a
// camera sees them that turns about the vertical axis and stands at (shift, 0, 0).
FilmFrame frame_of(float angle, float shift, float post_red = 0.2f) {
  FilmFrame frame{plain_camera(96, 64), ImageF(96, 64, 3), ImageF(96, 64, 1)};
  Camera& camera = frame.camera;
  camera.cx = 48;
  camera.cy = 32;
  camera.cam_from_world_rotation = {
      {std::cos(angle), 0, -std::sin(angle)}, {0, 1, 0}, {std::sin(angle), 0, std::cos(angle)}};
  camera.cam_from_world_translation = -multiply(camera.cam_from_world_rotation, Vec3f(shift, 0, 0));
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 96; ++x) {
      const Vec3f ray = multiply_transposed(
          camera.cam_from_world_rotation,
          Vec3f((float(x) + 0.5f - 48) / camera.fx, (float(y) + 0.5f - 32) / camera.fy, 1));
      const float post = shift + ray.x / ray.z * 2;
      const bool is_post = post > -0.5f && post < -0.2f;
      const float z = is_post ? 2.0f : 4.0f, at = shift + ray.x / ray.z * z;
      frame.depth.at(x, y, 0) = z / ray.z;
      frame.color.at(x, y, 0) = is_post ? post_red : 0.5f + 0.4f * std::sin(2 * at);
      frame.color.at(x, y, 1) = 0.5f;
      frame.color.at(x, y, 2) = 0.3f;
    }
  return frame;
}

TEST(Popping, IsNearlyNothingWhereOnlyTheCameraMoves) {
  EXPECT_LT(flip_of_neighbor(frame_of(0, 0), frame_of(0.03f, 0)), 0.01);
  EXPECT_LT(flip_of_neighbor(frame_of(0, 0), frame_of(-0.02f, 0.1f)), 0.02);
}

TEST(Popping, IsWhatChangesItsColor) {
  const double still = flip_of_neighbor(frame_of(0, 0), frame_of(0.03f, 0));
  EXPECT_GT(flip_of_neighbor(frame_of(0, 0), frame_of(0.03f, 0, 0.8f)), still + 0.02);
}

TEST(Popping, OfFramesThatShowNothingOfEachOtherIsZero) {
  EXPECT_EQ(flip_of_neighbor(frame_of(0, 0), frame_of(3, 0)), 0);
}

TEST(Popping, OfAFilmIsTheMeanOverItsPlaces) {
  std::vector<Camera> film;
  for (int i = 0; i < 30; ++i) film.push_back(frame_of(0, 0.01f * float(i)).camera);
  const auto draw = [](float step) {
    return [step](const Camera& camera) {
      const float shift = -camera.cam_from_world_translation.x;
      return frame_of(0, shift, 0.2f + step * shift);  // its post changes its color all the time
    };
  };
  const Popping still = measure_popping(film, draw(0)), changing = measure_popping(film, draw(2));
  EXPECT_LT(still.next, 0.01);
  EXPECT_GT(changing.next, still.next);
  EXPECT_GT(changing.seventh, changing.next + still.seventh);
}

}  // namespace
}  // namespace gs
