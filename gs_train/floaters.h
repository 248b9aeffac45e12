// SPDX-License-Identifier: Apache-2.0
// Floaters: Gaussians that hang right in front of cameras and that hardly any other camera sees. They are what photos of
// different brightness leave behind, or views that no other overlaps; from a place beside the camera they cover the picture.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/scene.h"
#include "gs_render/renderer.h"
#include "gs_train/training_model.h"

namespace gs {

/// The distance from each camera below which nothing of the scene is expected: `clearance` of that to the nearest of the
/// sparse points in its picture, one in a hundred left out as wrong.   world units
/// 0 where fewer than 100 points are in the picture.
std::vector<float> clear_distances(const std::vector<View>& views,
                                   const std::vector<ScenePoint>& points, float clearance);

/// The space right before the training cameras of a scene, a sphere around each, of their clear distances.
class ClearSpace {
 public:
  ClearSpace(const Scene& scene, float clearance);
  /// Whether the point is in that of training view v.
  bool holds(std::size_t v, const Vec3f& point) const;
  /// (N) 1 for each point that is in that of some view; empty where none is.
  std::vector<std::uint8_t> marks(const std::vector<Vec3f>& points) const;

 private:
  struct Sphere {
    Vec3f center;
    float squared_radius;
  };
  std::vector<Sphere> of_views_, known_;  // known_: those of a radius above 0
};

/// (N) 1 for each Gaussian in the clear space, but for those that `witnesses` training views see from beyond theirs; 0 asks
/// none. A view sees a Gaussian where its share in the picture is at least one pixel. Empty where there is none.
///
/// gaussians   in the renderer's memory; `means` are theirs, on the host
/// settings    as for training
std::vector<std::uint8_t> find_floaters(Renderer& renderer, const GaussiansSpan& gaussians,
                                        const std::vector<Vec3f>& means, const Scene& scene,
                                        const RenderSettings& settings, float clearance,
                                        int witnesses);

/// Takes the opacity of all that is in the clear space, so that nobody sees it and a prune removes it. Gives it back when
/// it dies, unless told to leave it. The model is settled, and outlives it. Allocates nothing on the device.
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
  std::vector<float> opacities_;  // all of them as they were; empty: nothing was hidden
};

}  // namespace gs
