// SPDX-License-Identifier: Apache-2.0
// Random Gaussians in front of random cameras, from fixed seeds, for the tests of the stages.
#pragma once

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/image.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/random.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/spacetime/spacetime.h"
#include "tests/support/test.h"

namespace gs {

/// A sequence of random numbers that is always the same for a seed.
class Draws {
 public:
  explicit Draws(std::uint64_t seed) : random_{seed, RandomStream::test} {}
  float uniform(float low, float high) { return low + (high - low) * random_.uniform4(next_++).x; }
  float log_uniform(float low, float high) {
    return std::exp(uniform(std::log(low), std::log(high)));
  }
  bool chance(float probability) { return uniform(0, 1) < probability; }
  float normal() { return random_.normal4(next_++).x; }
  std::uint32_t below(std::uint32_t bound) { return random_.below(bound, next_++); }
  Vec3f uniform3(float low, float high) {
    const float x = uniform(low, high), y = uniform(low, high), z = uniform(low, high);
    return {x, y, z};
  }
  Quatf quaternion() {
    const float w = normal(), x = normal(), y = normal(), z = normal();
    return {w, x, y, z};
  }

 private:
  Random random_;
  std::uint64_t next_ = 0;
};

/// A family of Gaussians, described relative to the picture that they are made for.
struct Recipe {
  float sigma_low, sigma_high;  // pixels, of the two thinner axes
  float stretch = 1;            // the longest axis is up to so many times as long
  float opacity_low = 0.1f, opacity_high = 0.95f;
  float reach = 1.1f;  // of the picture: means lie in a rectangle so many times as large
  float depth_low = 1, depth_high = 6;  // world units in front of the camera
  float color_low = 0, color_high = 1;  // seen without the view-dependent part
};
inline constexpr Recipe kTypical{.sigma_low = 0.7f, .sigma_high = 7, .stretch = 3};
inline constexpr Recipe kSharp{.sigma_low = 0.01f, .sigma_high = 0.4f, .opacity_high = 0.9999f};
inline constexpr Recipe kNeedles{.sigma_low = 0.01f, .sigma_high = 0.5f, .stretch = 300};
inline constexpr Recipe kHuge{.sigma_low = 100, .sigma_high = 1000};
inline constexpr Recipe kFaint{
    .sigma_low = 1, .sigma_high = 20, .opacity_low = 0.001f, .opacity_high = 0.02f};
inline constexpr Recipe kBehind{
    .sigma_low = 1, .sigma_high = 20, .depth_low = -5, .depth_high = 0.19f};
inline constexpr Recipe kOffScreen{.sigma_low = 1, .sigma_high = 20, .reach = 4};
inline constexpr Recipe kNegativeColors{
    .sigma_low = 1, .sigma_high = 7, .color_low = -1, .color_high = 0.7f};
inline constexpr Recipe kOpaque{
    .sigma_low = 4, .sigma_high = 12, .opacity_low = 0.9f, .opacity_high = 0.9999f};

/// A camera with a random position and rotation, an off-center principal point, and pixels that are
/// not square.
inline Camera random_camera(int width, int height, std::uint64_t seed = 1) {
  Draws draws(seed + 1000);
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = float(width) * draws.uniform(0.8f, 1.1f);
  camera.fy = camera.fx * draws.uniform(0.9f, 1.1f);
  camera.cx = float(width) * draws.uniform(0.4f, 0.6f);
  camera.cy = float(height) * draws.uniform(0.4f, 0.6f);
  const Quatf turn = draws.quaternion();
  const float n = 2 / squared_norm(turn);
  const auto [w, x, y, z] = turn;
  camera.cam_from_world_rotation = {
      {1 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)},
      {n * (x * y + w * z), 1 - n * (x * x + z * z), n * (y * z - w * x)},
      {n * (x * z - w * y), n * (y * z + w * x), 1 - n * (x * x + y * y)}};
  camera.cam_from_world_translation = draws.uniform3(-1, 1);
  return camera;
}

/// A camera at the origin that looks along z, with exact pixel positions: fx = fy = 64, center (0,
/// 0).
inline Camera plain_camera(int width, int height) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 64;
  camera.cx = camera.cy = 0;
  return camera;
}

/// The world point at this depth behind a position in the picture.
inline Vec3f behind_pixel(const Camera& camera, float x, float y, float depth) {
  const Vec3f p{(x - camera.cx) / camera.fx * depth, (y - camera.cy) / camera.fy * depth, depth};
  return multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
}

/// One isotropic gray Gaussian.
inline void set_gaussian(const Gaussians& gaussians, std::size_t i, const Vec3f& mean, float scale,
                         float opacity, const Vec3f& color = Vec3f(0.8f)) {
  gaussians.mean[i] = mean;
  gaussians.log_scale[i] = Vec3f(std::log(scale));
  gaussians.rotation[i] = {1, 0, 0, 0};
  gaussians.logit_opacity[i] = logit(opacity);
  gaussians.sh0[i] = (color - Vec3f(kColorOffset)) / float(kSh0);
  gaussians.sh_rest[i] = {};
}

/// One isotropic Gaussian of a random scale, opacity and color. Each has a statement of its own, since
/// compilers differ in the order in which they evaluate the arguments of a call.
inline void draw_gaussian(const Gaussians& gaussians, std::size_t i, const Vec3f& mean,
                          float least_scale, float most_scale, Draws& draws) {
  const Vec3f color = draws.uniform3(0, 1);
  const float opacity = draws.uniform(0.5f, 0.95f);
  const float scale = draws.uniform(least_scale, most_scale);
  set_gaussian(gaussians, i, mean, scale, opacity, color);
}

/// A camera of 4096 x 4096 pixels, and Gaussians that each hit all of its 65,536 tiles: `count` of
/// 65,537 makes 2^32 + 65,536 instances.
inline Camera camera_of_65536_tiles() { return plain_camera(4096, 4096); }
inline Gaussians gaussians_over_every_tile(std::size_t count) {
  Gaussians all(count, host_memory());
  const Vec3f center = behind_pixel(camera_of_65536_tiles(), 2048, 2048, 2);
  for (std::size_t i = 0; i < count; ++i) set_gaussian(all, i, center, 1000, 0.05f);
  return all;
}

/// `count` Gaussians of a family for a camera, with coefficients of all SH degrees.
inline Gaussians random_gaussians(const Recipe& recipe, std::size_t count, const Camera& camera,
                                  std::uint64_t seed) {
  Draws draws(seed);
  Gaussians gaussians(count, host_memory());
  for (std::size_t i = 0; i < count; ++i) {
    const float depth = draws.uniform(recipe.depth_low, recipe.depth_high);
    const float edge = 0.5f * (1 - recipe.reach);
    const float x = float(camera.width) * draws.uniform(edge, 1 - edge);
    const float y = float(camera.height) * draws.uniform(edge, 1 - edge);
    const float units_per_pixel = std::max(std::abs(depth), 0.1f) / camera.fx;
    const auto log_sigma = [&] {
      return std::log(units_per_pixel * draws.log_uniform(recipe.sigma_low, recipe.sigma_high));
    };
    gaussians.mean[i] = behind_pixel(camera, x, y, depth);
    gaussians.log_scale[i].x = log_sigma();
    gaussians.log_scale[i].y = log_sigma();
    gaussians.log_scale[i].z = log_sigma();
    gaussians.log_scale[i][int(draws.below(3))] += draws.uniform(0, std::log(recipe.stretch));
    gaussians.rotation[i] = draws.quaternion();
    gaussians.logit_opacity[i] = logit(draws.log_uniform(recipe.opacity_low, recipe.opacity_high));
    const Vec3f color = draws.uniform3(recipe.color_low, recipe.color_high);
    gaussians.sh0[i] = (color - Vec3f(kColorOffset)) / float(kSh0);
    for (Vec3f& coefficient : gaussians.sh_rest[i].coefficient)
      coefficient = draws.uniform3(-0.1f, 0.1f);
  }
  return gaussians;
}

/// At least 91 Gaussians with infinity or NaN in one parameter of some of them.
inline Gaussians with_bad_numbers(Gaussians gaussians) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  gaussians.mean[3].x = nan;
  gaussians.log_scale[40].y = nan;
  gaussians.rotation[50].w = nan;
  gaussians.logit_opacity[60] = nan;
  gaussians.sh0[70].z = nan;
  gaussians.sh_rest[80].coefficient[7].x = nan;
  gaussians.mean[90].z = std::numeric_limits<float>::infinity();
  return gaussians;
}

/// The same Gaussians in space and time: each moves about its own extent in the scene's duration.
/// Most are visible at the middle of it.
inline Gaussians in_spacetime(const Gaussians& still, std::uint64_t seed) {
  Draws draws(seed);
  Gaussians moving = copy_of(still);
  moving.has_time = true;
  moving.resize(still.count());
  for (std::size_t i = 0; i < moving.count(); ++i) {
    const QuatPair<float> still_pair = turn_of_space(still.rotation[i]);
    const Quatf right = still_pair.right, tilt = draws.quaternion();
    const float some = 0.1f * std::sqrt(squared_norm(right));  // tilts it into time a little
    moving.rotation[i] = still_pair.left;
    moving.right_rotation[i] = {right.w + some * tilt.w, right.x + some * tilt.x,
                                right.y + some * tilt.y, right.z + some * tilt.z};
    moving.time_mean[i] = draws.uniform(0.2f, 0.8f);
    moving.log_time_scale[i] = draws.uniform(-2, 0);
  }
  return moving;
}

/// The same Gaussians with 3D filters of about their own sizes.
inline Gaussians with_filters(const Gaussians& plain, std::uint64_t seed) {
  Draws draws(seed);
  Gaussians filtered = copy_of(plain);
  filtered.has_filter = true;
  filtered.resize(plain.count());
  for (std::size_t i = 0; i < filtered.count(); ++i)
    filtered.filter_scale[i] = std::exp(plain.log_scale[i].x) * draws.log_uniform(0.1f, 2);
  return filtered;
}

/// All rows of `a`, then all of `b`.
inline Gaussians joined(const Gaussians& a, const Gaussians& b) {
  Gaussians all(host_memory());
  all.has_time = a.has_time;
  all.resize(a.count() + b.count());
  for_each_array(
      [](const char*, auto& to, const auto& first, const auto& second) {
        std::copy(second.begin(), second.end(), std::copy(first.begin(), first.end(), to.begin()));
      },
      all, a, b);
  return all;
}

/// Some of every family but the opaque one.
inline Gaussians mixed_gaussians(std::size_t count_each, const Camera& camera, std::uint64_t seed) {
  Gaussians all = random_gaussians(kTypical, count_each, camera, seed);
  for (const Recipe& recipe :
       {kSharp, kNeedles, kHuge, kFaint, kBehind, kOffScreen, kNegativeColors})
    all = joined(all, random_gaussians(recipe, count_each, camera, ++seed));
  return all;
}

/// A random permutation of 0 .. count - 1.
inline std::vector<std::uint32_t> random_permutation(std::size_t count, std::uint64_t seed) {
  Draws draws(seed);
  std::vector<std::uint32_t> order(count);
  for (std::size_t i = 0; i < count; ++i) order[i] = std::uint32_t(i);
  for (std::size_t i = count; i > 1; --i)
    std::swap(order[i - 1], order[draws.below(std::uint32_t(i))]);
  return order;
}

/// A photo of random values.
inline Image8 random_photo(int width, int height, std::uint64_t seed) {
  Draws draws(seed);
  Image8 photo(width, height, 3);
  for (std::uint8_t& value : photo.pixels) value = std::uint8_t(draws.below(256));
  return photo;
}

}  // namespace gs
