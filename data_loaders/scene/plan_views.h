// SPDX-License-Identifier: Apache-2.0
// The plan for each photo, decided from its header: its lens, its sizes, its camera.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "data_loaders/lenses/lens.h"
#include "data_loaders/photos/photo_pool.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/scene/scene_model.h"

namespace gs {

/// A sparse point that a photo shows.
struct DepthAnchor {
  float x, y;   // in the view, the center of its first pixel at (0.5, 0.5)
  float depth;  // world units along the viewing axis
};

/// All that is known of a view before its photo is decoded.
struct ViewPlan {
  std::string name;
  std::uint32_t camera_id = 0;
  std::uint32_t rig_frame = 0;          // View::rig_frame
  std::optional<float> exposure_stops;  // of the view; after read_exposure_stops()
  std::filesystem::path file;           // of the photo, or the video that it is a frame of
  bool is_frame = false;
  std::int64_t frame = 0;           // its number in the video, from 0
  std::filesystem::path mask_file;  // empty: none
  MaskUse masks;
  PhotoSize photo_size;
  std::filesystem::path depth_file;  // the map; empty: none
  PhotoSize depth_size;
  DepthKind depth_kind = DepthKind::automatic;  // never so once the scene is loaded
  float depth_unit = 1;                         // world units of a step of its integers
  std::vector<DepthAnchor> depth_anchors;       // of views with a map; after add_depth_anchors()
  LensCamera lens;                              // at the photo's size
  PinholeCamera<double> undistorted;            // the photo without its lens, at full resolution
  PinholeCamera<double> target;                 // at the resolution of training
  Camera camera;                                // the target with its pose, in single precision
  bool may_be_masked = false;  // by a file or by alpha; only decoding tells of alpha
  PhotoCost cost;              // bytes of the picture, and of making it

  bool has_lens() const { return lens.lens != LensCamera::Lens::none; }
  bool is_resized() const {
    return target.width != undistorted.width || target.height != undistorted.height;
  }
};

/// Reads the headers of all photos, masks and depth maps and plans the views, in the order of the
/// model's images. `progress` counts headers, from one thread at a time. Throws Error that names
/// the photo and the remedy: a photo, mask or depth map of another shape than its camera, a lens
/// that cannot become a pinhole, a pose beyond single precision. Throws UsageError for a resolution
/// that is none.
std::vector<ViewPlan> plan_views(
    const SceneModel& scene, int resolution,
    const std::function<void(std::size_t done, std::size_t total)>& progress);

/// Plans the view without its depth map.
void leave_out_depth(ViewPlan& plan);

/// Reads how the photos were exposed, from their headers. Frames of videos have no such tags.
void read_exposure_stops(std::vector<ViewPlan>& plans);

}  // namespace gs
