// SPDX-License-Identifier: Apache-2.0
// Floaters: Gaussians right in front of a camera that hardly any other camera sees. Training makes
// them to fit photos of different brightness, or views that no other view overlaps. They look right
// from that camera, but cover the picture when seen from beside it.
//
// clearance   A camera should have free space in front of it. The clearance is the depth of that
//             space as a share of the distance to the nearest sparse points in the camera's
//             picture. For example, with points 2 m away and a clearance of 0.35, a Gaussian
//             within 0.7 m of the camera is a floater. The setting is density.camera_clearance.
// witnesses   A Gaussian in one camera's free space may be real, for example a branch that almost
//             touches the lens. It is kept where enough other views see it from farther away.
//             These views are its witnesses.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/scene.h"
#include "gs_render/renderer.h"
#include "gs_train/training_model.h"

namespace gs {

/// The radius of the free space around each camera: `clearance` times the distance to the nearest
/// sparse points in its picture, of which the nearest hundredth is ignored as wrong.   world units
/// 0 where fewer than 100 points are in the picture.
std::vector<float> clear_distances(const std::vector<View>& views,
                                   const std::vector<ScenePoint>& points, float clearance);

/// The free space around the training cameras of a scene: a sphere around each, with the radius of
/// clear_distances().
class ClearSpace {
 public:
  ClearSpace(const Scene& scene, float clearance);
  /// True where the point is in the sphere of training view v.
  bool holds(std::size_t v, const Vec3f& point) const;
  /// (N) 1 for each point that is in any of the spheres; empty where none is.
  std::vector<std::uint8_t> marks(const std::vector<Vec3f>& points) const;

 private:
  struct Sphere {
    Vec3f center;
    float squared_radius;
  };
  std::vector<Sphere> of_views_, known_;  // known_: those with a radius above 0
};

/// (N) 1 for each floater: a Gaussian in the free space of some view that fewer than `witnesses`
/// other training views see from outside their own free space. A view sees a Gaussian that
/// contributes at least one pixel (contribution.h). With 0 witnesses all Gaussians in the free
/// space are floaters, and nothing is rendered. Empty where there is no floater.
///
/// gaussians   in the renderer's memory
/// means       their means, on the host
/// settings    as for training
std::vector<std::uint8_t> find_floaters(Renderer& renderer, const GaussiansSpan& gaussians,
                                        const std::vector<Vec3f>& means, const Scene& scene,
                                        const RenderSettings& settings, float clearance,
                                        int witnesses);

/// Makes all Gaussians in the free space invisible for its lifetime: their opacities are about 0,
/// so that a prune would remove them. The destructor restores the opacities, unless leave() was
/// called. The model is synchronized and outlives it. Allocates nothing on the device.
class HiddenFloaters {
 public:
  HiddenFloaters(TrainingModel& model, const ClearSpace& space);
  ~HiddenFloaters();
  HiddenFloaters(const HiddenFloaters&) = delete;
  HiddenFloaters& operator=(const HiddenFloaters&) = delete;
  void leave() { opacities_.clear(); }

 private:
  void set(const std::vector<float>& opacities);
  TrainingModel& model_;
  std::vector<float> opacities_;  // of all Gaussians, as they were; empty: nothing is hidden
};

}  // namespace gs
