// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/generated_scene.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "gs_core/math/constants.h"
#include "gs_core/math/random.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/spacetime/spacetime.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr float kCameraDistance = 3;       // world units from the center of the ball
constexpr float kFocalLength = 0.9f;       // in picture widths
constexpr float kShRestRange = 0.1f;       // largest coefficient beyond degree 0
constexpr std::uint32_t kShRestDraws = 8;  // the first draw for a Gaussian's SH rest
constexpr std::uint32_t kTimeDraws = 32;   // the first draw for its numbers of time
constexpr float kTilt = 0.1f;              // of turns of space, into time

Vec3f xyz(const Vec4f& v) { return {v.x, v.y, v.z}; }

/// A uniformly distributed point of the unit ball.
Vec3f point_in_ball(const Vec4f& normal, float u) {
  const Vec3f v = xyz(normal);
  return v * (std::cbrt(u) / std::sqrt(std::max(inner(v, v), 1e-12f)));
}

void draw_gaussian(const SceneRecipe& recipe, const Random& random, const Gaussians& to,
                   std::size_t i) {
  const auto uniform = [&](std::uint32_t draw) { return random.uniform4(i, draw); };
  const auto normal = [&](std::uint32_t draw) { return random.normal4(i, draw); };
  const float pixel = kCameraDistance / (kFocalLength * float(recipe.width));  // world units
  const float low = std::log(recipe.sigma_low * pixel), high = std::log(recipe.sigma_high * pixel);
  const Vec4f u = uniform(0), q = normal(2);

  to.mean[i] = point_in_ball(normal(1), u.x) * (recipe.reach * kCameraDistance);
  to.log_scale[i] = Vec3f(low) + (high - low) * xyz(uniform(3));
  to.rotation[i] = {q.x, q.y, q.z, q.w};
  to.logit_opacity[i] =
      logit(recipe.opacity_low + (recipe.opacity_high - recipe.opacity_low) * u.y);
  to.sh0[i] = (xyz(uniform(4)) - Vec3f(kColorOffset)) / float(kSh0);
  for (std::uint32_t k = 0; k < kShRestCount; ++k)
    to.sh_rest[i].coefficient[k] =
        (2.0f * xyz(uniform(kShRestDraws + k)) - Vec3f(1)) * kShRestRange;
}

/// Gives a Gaussian numbers of time. It moves by about its own size, and is visible in the whole
/// scene.
void draw_motion(const Random& random, const Gaussians& to, std::size_t i) {
  const Vec4f u = random.uniform4(i, kTimeDraws), tilt = random.normal4(i, kTimeDraws + 1);
  const QuatPair<float> pair = turn_of_space(normalized(to.rotation[i]));
  const Quatf& r = pair.right;
  to.rotation[i] = pair.left;
  to.right_rotation[i] = {r.w + kTilt * tilt.x, r.x + kTilt * tilt.y, r.y + kTilt * tilt.z,
                          r.z + kTilt * tilt.w};
  to.time_mean[i] = 0.2f + 0.6f * u.x;
  to.log_time_scale[i] = -u.y;
}

/// Camera `index` of the ring, a little above or below its plane, looking at the center.
Camera ring_camera(const SceneRecipe& recipe, int index) {
  const float angle = 2 * std::numbers::pi_v<float> * float(index) / float(recipe.views);
  const float c = std::cos(angle), s = std::sin(angle);
  const float tilt = 0.3f * std::sin(2.3f * float(index) + 0.5f);  // radians
  const float ct = std::cos(tilt), st = std::sin(tilt);
  Camera camera;
  camera.width = recipe.width;
  camera.height = recipe.height;
  camera.fx = kFocalLength * float(recipe.width);
  camera.fy = 1.05f * camera.fx;
  camera.cx = 0.48f * float(recipe.width);
  camera.cy = 0.53f * float(recipe.height);
  camera.cam_from_world_rotation = {{c, 0, -s}, {st * s, ct, st * c}, {ct * s, -st, ct * c}};
  camera.cam_from_world_translation = {0, 0, kCameraDistance};
  if (recipe.moves) camera.time = (float(index) + 0.5f) / float(recipe.views);
  return camera;
}

Image8 random_photo(const SceneRecipe& recipe, int index) {
  const Random random{recipe.seed + 1 + std::uint64_t(index), RandomStream::test};
  Image8 photo(recipe.width, recipe.height, 3);
  constexpr std::size_t kBlock = sizeof(RandomBits);  // bytes
  const std::size_t bytes = photo.pixels.size();
  parallel_for((bytes + kBlock - 1) / kBlock, 4096, [&](std::size_t block) {
    const RandomBits bits = random.bits(block);
    const std::size_t at = block * kBlock;
    std::memcpy(photo.pixels.data() + at, &bits, std::min(kBlock, bytes - at));
  });
  return photo;
}

}  // namespace

GeneratedScene generated_scene(const SceneRecipe& recipe) {
  GeneratedScene scene;
  const Random random{recipe.seed, RandomStream::test};
  scene.model.gaussians.has_time = recipe.moves;
  scene.model.gaussians.resize(recipe.gaussians);
  parallel_for(recipe.gaussians, 1024,
               [&](std::size_t i) { draw_gaussian(recipe, random, scene.model.gaussians, i); });
  if (recipe.moves)
    parallel_for(recipe.gaussians, 1024,
                 [&](std::size_t i) { draw_motion(random, scene.model.gaussians, i); });
  for (int i = 0; i < recipe.views; ++i)
    scene.views.push_back(
        {"view " + std::to_string(i), ring_camera(recipe, i), random_photo(recipe, i)});
  return scene;
}

}  // namespace gs
