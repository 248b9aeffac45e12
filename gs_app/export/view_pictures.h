// SPDX-License-Identifier: Apache-2.0
// The quantities that `gemsplat render` can show of a view, as values and as pictures.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gs_render/surface_renderer.h"
#include "gs_train/backend.h"

namespace gs {

enum class Quantity { color, depth, alpha, normal };
/// "color", "depth", "alpha", "normal"
const std::vector<std::string>& quantity_names();
const std::string& name_of(Quantity quantity);

/// The names of a quantity's channels in an EXR file.
std::vector<std::string> channels_of(Quantity quantity);

/// The depths at the two ends of the color ramp, world units. Depths beyond an end have its color.
struct DepthRange {
  float nearest = 0, farthest = 1;
};

/// Values as a picture of 8 bits:
///   color    as it is
///   depth    a ramp from pale yellow (near) to violet (far), linear in 1 / depth; black where
///            empty
///   alpha    from black to white
///   normal   0.5 + 0.5 n; black where empty
Image8 picture_of(Quantity quantity, const ImageF& values, const DepthRange& range);

/// Renders views of one model. Backend and Gaussians must outlive it, and the Gaussians must not
/// change.
class ViewPictures {
 public:
  /// gaussians, host   the same, in the backend's memory and in the host's
  ViewPictures(Backend& backend, const Gaussians& gaussians, const Gaussians& host,
               const RenderSettings& settings, bool normals_in_camera);

  /// The quantities of a view, in this order. Color and alpha take one pass, depth and normal
  /// another (surface_renderer.h).
  ///
  /// look   how a photo shows the colors; null: they are the scene's own
  std::vector<ImageF> values(const Camera& camera, const std::vector<Quantity>& quantities,
                             Appearance* look = nullptr);

  /// The color of a view as a picture of 8 bits: a GPU copies a quarter of the bytes.
  Image8 color(const Camera& camera);

  /// Depths of pixels in small pictures of a few of the cameras, sorted. Empty where they show
  /// nothing.
  std::vector<float> sample_depths(const std::vector<Camera>& cameras);

 private:
  void draw(const Camera& camera);
  SurfaceRenderer& surface();
  ImageF normals(const ImageF& depth, const Camera& camera) const;

  Backend& backend_;
  const Gaussians &gaussians_, &host_;
  RenderSettings settings_;
  bool normals_in_camera_;
  std::unique_ptr<PackedScene> packed_;  // where color or alpha was asked for
  RenderPass pass_;
  std::optional<SurfaceRenderer> surface_;  // where depth or normals were asked for
};

/// The range of most of these sorted depths: one in a hundred is nearer, one in a hundred farther.
DepthRange range_of(const std::vector<float>& depths);

}  // namespace gs
