// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/view_pictures.h"

#include <algorithm>

#include "gs_app/export/cameras.h"
#include "gs_app/pictures/color_ramp.h"
#include "gs_app/pictures/pictures.h"
#include "gs_core/error.h"

namespace gs {
namespace {

constexpr std::size_t kMostSampledViews = 8;
constexpr int kSampleSide = 160;        // pixels, the longer one
constexpr double kOutlierShare = 0.01;  // of the depths, at either end
constexpr float kFarColor = 0.12f;      // start of the ramp: far is not black, which means empty

Rgb depth_color(float depth, const DepthRange& range) {
  if (!(depth > 0)) return {0, 0, 0};
  const float far = 1 / range.farthest, near = 1 / range.nearest;
  const float t = near > far ? std::clamp((1 / depth - far) / (near - far), 0.0f, 1.0f) : 1.0f;
  return color_ramp()[std::size_t(255 * (kFarColor + (1 - kFarColor) * t) + 0.5f)];
}

Image8 depth_picture(const ImageF& depth, const DepthRange& range) {
  Image8 picture(depth.width, depth.height, 3);
  for (std::size_t i = 0; i < depth.pixels.size(); ++i) {
    const Rgb color = depth_color(depth.pixels[i], range);
    std::copy(color.begin(), color.end(), &picture.pixels[3 * i]);
  }
  return picture;
}

Image8 normal_picture(ImageF normals) {
  for (std::size_t i = 0; i + 2 < normals.pixels.size(); i += 3) {
    float* const n = &normals.pixels[i];
    if (n[0] == 0 && n[1] == 0 && n[2] == 0) continue;
    for (int c = 0; c < 3; ++c) n[c] = 0.5f + 0.5f * n[c];
  }
  return to_image8(normals);
}

}  // namespace

const std::vector<std::string>& quantity_names() {
  static const std::vector<std::string> names = {"color", "depth", "alpha", "normal"};
  return names;
}

const std::string& name_of(Quantity quantity) { return quantity_names()[std::size_t(quantity)]; }

std::vector<std::string> channels_of(Quantity quantity) {
  switch (quantity) {
    case Quantity::color: return {"R", "G", "B"};
    case Quantity::depth: return {"Z"};
    case Quantity::alpha: return {"A"};
    case Quantity::normal: break;
  }
  return {"N.X", "N.Y", "N.Z"};
}

Image8 picture_of(Quantity quantity, const ImageF& values, const DepthRange& range) {
  if (quantity == Quantity::depth) return depth_picture(values, range);
  return quantity == Quantity::normal ? normal_picture(values) : to_image8(values);
}

ViewPictures::ViewPictures(Backend& backend, const Gaussians& gaussians, const Gaussians& host,
                           const RenderSettings& settings, bool normals_in_camera)
    : backend_(backend), gaussians_(gaussians), host_(host), settings_(settings),
      normals_in_camera_(normals_in_camera), pass_(backend.memory()) {}

SurfaceRenderer& ViewPictures::surface() {
  if (!surface_) surface_.emplace(backend_.renderer(), gaussians_.span(), host_, settings_);
  return *surface_;
}

void ViewPictures::draw(const Camera& camera) {
  if (!packed_) packed_ = backend_.renderer().pack(gaussians_.span(), settings_);
  backend_.renderer().draw(*packed_, camera, settings_, pass_);
}

Image8 ViewPictures::color(const Camera& camera) {
  draw(camera);
  return backend_.renderer().picture_of(pass_);
}

std::vector<ImageF> ViewPictures::values(const Camera& camera,
                                         const std::vector<Quantity>& quantities,
                                         Appearance* look) {
  const auto is_of_color_pass = [](Quantity q) {
    return q == Quantity::color || q == Quantity::alpha;
  };
  if (std::any_of(quantities.begin(), quantities.end(), is_of_color_pass)) draw(camera);
  ImageF depth;
  if (!std::all_of(quantities.begin(), quantities.end(), is_of_color_pass))
    depth = surface().depth(camera);
  std::vector<ImageF> result;
  for (const Quantity quantity : quantities) {
    if (quantity == Quantity::color)
      result.push_back(look ? shown_image(pass_, *look) : image_of(pass_));
    if (quantity == Quantity::alpha) result.push_back(alpha_of(pass_));
    if (quantity == Quantity::depth) result.push_back(depth);
    if (quantity == Quantity::normal) result.push_back(normals(depth, camera));
  }
  return result;
}

ImageF ViewPictures::normals(const ImageF& depth, const Camera& camera) const {
  const ImageF in_world = normals_of(depth, camera);
  return normals_in_camera_ ? gs::normals_in_camera(in_world, camera) : in_world;
}

std::vector<float> ViewPictures::sample_depths(const std::vector<Camera>& cameras) {
  std::vector<float> depths;
  for (const std::size_t i : evenly_chosen(cameras.size(), kMostSampledViews)) {
    const Camera& camera = cameras[i];
    const double scale = std::min(1.0, double(kSampleSide) / std::max(camera.width, camera.height));
    const auto side = [&](int pixels) { return std::max(1, int(pixels * scale)); };
    const ImageF depth = surface().depth(resized(camera, side(camera.width), side(camera.height)));
    std::copy_if(depth.pixels.begin(), depth.pixels.end(), std::back_inserter(depths),
                 [](float z) { return z > 0; });
  }
  std::sort(depths.begin(), depths.end());
  return depths;
}

DepthRange range_of(const std::vector<float>& depths) {
  if (depths.empty()) return {};
  const auto at = [&](double share) {
    return depths[std::size_t(share * double(depths.size() - 1))];
  };
  return {at(kOutlierShare), at(1 - kOutlierShare)};
}

}  // namespace gs
