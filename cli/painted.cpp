// SPDX-License-Identifier: Apache-2.0
#include "cli/painted.h"

#include <algorithm>
#include <cmath>

#include "cli/pictures.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/rotation.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kRowsPerChunk = 4096;
constexpr float kLeastCover = 0.5f;
constexpr double kOutermost = 0.02;  // share of pixels beyond either end of the scale of depths
constexpr float kFarGrey = 55.0f / 255;

float quantile(std::vector<float> values, double share) {
  const auto place = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

Vec3f in_camera(const Camera& camera, const Vec3f& point) {
  return multiply(camera.cam_from_world_rotation, point) + camera.cam_from_world_translation;
}

// Of length 1 in camera axes, towards the camera.
Vec3f normal_in_camera(const Camera& camera, const Gaussians& host, std::size_t i) {
  const Quatf q = host.rotation[i];
  if (is_degenerate(q)) return Vec3f(0.0f);
  const Vec3f& s = host.log_scale[i];
  const int shortest = s.x <= s.y && s.x <= s.z ? 0 : s.y <= s.z ? 1 : 2;
  Vec3f axis(0.0f);
  axis[shortest] = 1;
  const Vec3f normal = multiply(camera.cam_from_world_rotation, multiply(rotation_matrix(q), axis));
  return inner(normal, in_camera(camera, host.mean[i])) > 0 ? -normal : normal;
}

}  // namespace

PaintedModel::PaintedModel(Renderer& renderer, const Gaussians& gaussians, const Gaussians& host)
    : renderer_(renderer), gaussians_(gaussians), host_(host), paint_(renderer.memory()),
      pass_(renderer.memory()) {}

// The three planes of the picture in which Gaussian i has the colour values[i].
std::vector<float> PaintedModel::planes_of(const Camera& camera, RenderSettings settings,
                                           const std::vector<Vec3f>& values, float background) {
  std::vector<Vec3f> sh0(values.size());
  for (std::size_t i = 0; i < values.size(); ++i)
    sh0[i] = (values[i] - Vec3f(kColorOffset)) / float(kSh0);
  paint_.upload(sh0);
  GaussiansSpan painted = gaussians_.span();
  painted.sh0 = paint_.span();
  settings.sh_degree = 0;
  settings.background = Vec3f(background);
  renderer_.forward(painted, camera, settings, pass_);
  return pass_.image.download();
}

Image8 PaintedModel::depth(const Camera& camera, const RenderSettings& settings) {
  std::vector<Vec3f> values(host_.count());
  parallel_for(values.size(), kRowsPerChunk, [&](std::size_t i) {
    const float z = in_camera(camera, host_.mean[i]).z;
    values[i] = {z > 0 ? z : 0, 1, 0};  // depth and cover
  });
  const std::vector<float> planes = planes_of(camera, settings, values, 0);
  const std::size_t pixels = pass_.pixel_count();
  std::vector<float> nearness(pixels, 0.0f), seen;
  for (std::size_t i = 0; i < pixels; ++i) {
    const float depth = planes[i], cover = planes[pixels + i];
    if (!(cover >= kLeastCover && depth > 0)) continue;
    nearness[i] = cover / depth;
    seen.push_back(nearness[i]);
  }
  ImageF image(camera.width, camera.height, 3);
  if (seen.empty()) return to_image8(image);
  const float low = quantile(seen, kOutermost), high = quantile(seen, 1 - kOutermost);
  const float scale = high > low ? (1 - kFarGrey) / (high - low) : 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!(nearness[i] > 0)) continue;
    const float grey = kFarGrey + scale * (clamp_to(nearness[i], low, high) - low);
    for (std::size_t c = 0; c < 3; ++c) image.pixels[3 * i + c] = grey;
  }
  return to_image8(image);
}

Image8 PaintedModel::normals(const Camera& camera, const RenderSettings& settings) {
  std::vector<Vec3f> values(host_.count());
  parallel_for(values.size(), kRowsPerChunk, [&](std::size_t i) {
    const Vec3f n = normal_in_camera(camera, host_, i);
    values[i] = 0.5f + 0.5f * Vec3f(n.x, -n.y, -n.z);
  });
  const std::vector<float> planes = planes_of(camera, settings, values, 0.5f);
  const std::size_t pixels = pass_.pixel_count();
  ImageF image(camera.width, camera.height, 3);
  for (std::size_t i = 0; i < pixels; ++i) {
    Vec3f n{2 * planes[i] - 1, 2 * planes[pixels + i] - 1, 2 * planes[2 * pixels + i] - 1};
    const float length = std::sqrt(inner(n, n));  // the cover, where all normals agree
    if (!(length >= kLeastCover)) continue;
    n = 0.5f + 0.5f * n / length;
    for (int c = 0; c < 3; ++c) image.pixels[3 * i + std::size_t(c)] = n[c];
  }
  return to_image8(image);
}

}  // namespace gs
