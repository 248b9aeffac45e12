// SPDX-License-Identifier: Apache-2.0
// One photo of a scene on its way to a View: each stage of load_scene.h fills in its part.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "data_loaders/lenses/lens.h"
#include "data_loaders/photos/photo_pool.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/refine/tracks.h"
#include "gs_core/camera.h"
#include "gs_core/math/loss/depth_kind.h"
#include "gs_core/math/render/normal_axes.h"

namespace gs {

/// How masks change a photo (dataset.masks, mask_mode and invert_masks).
struct MaskUse {
  bool use_alpha = true;         // the alpha of photos without a mask file
  bool over_background = false;  // masked pixels show the background; else they are ignored
  bool invert = false;           // in mask files, black trains
};

/// A sparse point that a photo shows.
struct DepthAnchor {
  float x, y;   // in the view, the center of its first pixel at (0.5, 0.5)
  float depth;  // world units along the viewing axis
};

struct Photo {
  // After read_scene().
  std::string name;      // of the view
  bool is_test = false;  // held out to measure on
  MaskUse masks;
  DepthKind depth_kind = DepthKind::automatic;  // never so once the scene is loaded
  float depth_unit = 1;                         // world units of a step of its integers
  NormalAxes normal_axes = NormalAxes::world;

  // After place_scene().
  std::filesystem::path file;  // or the video that it is a frame of; empty: missing
  bool is_frame = false;
  std::int64_t frame = 0;                                    // its number in the video, from 0
  bool is_back = false;                                      // of a panorama: the half behind
  std::filesystem::path mask_file, depth_file, normal_file;  // empty: none

  // After plan_scene().
  std::uint32_t camera_id = 0;
  std::uint32_t rig_frame = 0;              // View::rig_frame
  PhotoSize size, depth_size, normal_size;  // of the files
  LensCamera lens;                          // at the photo's size
  PinholeCamera<double> undistorted;        // without its lens, or native; at full resolution
  bool is_explained = true;                 // its lens explains every pixel (lens_range.h)
  PinholeCamera<double> target;             // at the resolution of training
  Camera camera;                            // the target with its pose, in single precision
  bool may_be_masked = false;               // by a file or by alpha; only decoding tells of alpha
  PhotoCost cost;                           // bytes of the picture, and of making it
  std::vector<DepthAnchor> depth_anchors;   // where it has a depth map
  bool is_used = true;                      // by dataset.photo_list
  std::vector<SeenPoint> seen;              // with dataset.exposure
  std::vector<std::uint32_t> shown;         // indices of points; after find_shown_points()
  std::optional<float> exposure_stops;      // of the view; after read_exposure_stops()

  /// Whether the lens is taken out of the photo; else it trains as it is.
  bool is_undistorted() const { return lens.lens != Lens::none && !undistorted.has_lens(); }
  bool is_resized() const {
    return target.width != undistorted.width || target.height != undistorted.height;
  }
};

}  // namespace gs
