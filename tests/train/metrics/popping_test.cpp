// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/popping.h"

#include "tests/support/scenes.h"

namespace gs {
namespace {

Camera camera_turned_by(float angle) {
  Camera camera = plain_camera(96, 64);
  camera.cx = 48;
  camera.cy = 32;
  camera.cam_from_world_rotation = {
      {std::cos(angle), 0, -std::sin(angle)}, {0, 1, 0}, {std::sin(angle), 0, std::cos(angle)}};
  return camera;
}

// Waves of color in all directions, and a soft red post in the middle, as a camera sees them.
ImageF draw(const Camera& camera, float post_red = 0.2f) {
  ImageF color(camera.width, camera.height, 3);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Vec3f ray = multiply_transposed(camera.cam_from_world_rotation,
                                            Vec3f((float(x) + 0.5f - camera.cx) / camera.fx,
                                                  (float(y) + 0.5f - camera.cy) / camera.fy, 1));
      const float angle = std::atan2(ray.x, ray.z);
      const float wave = 0.5f + 0.4f * std::sin(9 * angle);
      color.at(x, y, 0) = wave + (post_red - wave) * std::exp(-100 * angle * angle);
      color.at(x, y, 1) = 0.5f + 0.4f * std::sin(5 * ray.y / std::hypot(ray.x, ray.z));
      color.at(x, y, 2) = 0.3f;
    }
  return color;
}
FilmFrame frame_at(float angle, float post_red = 0.2f) {
  const Camera camera = camera_turned_by(angle);
  return {camera, draw(camera, post_red)};
}

TEST(Popping, IsNearlyNothingWhereOnlyTheCameraTurns) {
  EXPECT_LT(flip_of_turned(frame_at(0), frame_at(0.03f)), 0.01);
  EXPECT_LT(flip_of_turned(frame_at(0), frame_at(-0.3f)), 0.01);
}

TEST(Popping, IsWhatChangesItsColor) {
  EXPECT_GT(flip_of_turned(frame_at(0), frame_at(0.03f, 0.8f)), 0.03);
}

TEST(Popping, OfFramesThatShowNothingOfEachOtherIsZero) {
  EXPECT_EQ(flip_of_turned(frame_at(0), frame_at(3)), 0);
}

TEST(Popping, OfAPanIsTheMeanOverItsPlaces) {
  std::vector<Camera> cameras(12, camera_turned_by(0));
  const auto with_red = [](float change) {
    return [change](const Camera& camera) {  // of a post whose color depends on the direction
      return draw(camera, 0.2f + change * std::abs(camera.cam_from_world_rotation.row2.x));
    };
  };
  const Popping still = measure_popping(cameras, with_red(0));
  const Popping changing = measure_popping(cameras, with_red(4));
  EXPECT_LT(still.next, 0.01);
  EXPECT_LT(still.seventh, 0.01);
  EXPECT_GT(changing.next, still.next);
  EXPECT_GT(changing.seventh, 2 * changing.next);
}

}  // namespace
}  // namespace gs
