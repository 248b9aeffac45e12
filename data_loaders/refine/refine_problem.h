// SPDX-License-Identifier: Apache-2.0
// What enters the bundle adjustment of refine_cameras.cpp: which images move as one, and which
// observations can be trusted to hold them.
#pragma once

#include <utility>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/refine/rigid_motion.h"
#include "data_loaders/refine/tracks.h"

namespace gs::refinement {

/// Images that move as one.
struct Frame {
  std::vector<std::size_t> images;  // the first one's pose is the frame's
  rigid::Motion pose;               // frame from world
  bool is_refined = true;
};

/// One photo of one point, as it enters the problem.
struct Observation {
  std::size_t image;
  SeenPoint seen;
};

/// Camera from world.
rigid::Motion pose_of(const ColmapImage& image);

/// The frames, points and observations of a model that are refined. The model outlives it.
struct BundleProblem {
  /// Keeps points that two or more photos show in front of them, and frames that show enough of
  /// these. Throws Error for a model without tracks, and for cameras whose photos cannot be
  /// undistorted.
  explicit BundleProblem(ColmapModel& model);

  /// Mean and median length of the observations' errors, pixels.
  std::pair<double, double> errors() const;
  /// Counts of what is refined.
  std::size_t image_count() const;
  std::size_t point_count() const;
  const Frame& frame_with(std::size_t image) const { return frames[frame_of[image]]; }
  Frame& frame_with(std::size_t image) { return frames[frame_of[image]]; }

  ColmapModel& model;
  std::vector<Frame> frames;
  std::vector<std::size_t> frame_of;          // of each image
  std::vector<rigid::Motion> cam_from_frame;  // of each image; never changes
  bool has_known_size = false;                // a rig with cameras apart holds the scale
  std::vector<bool> point_is_refined;
  std::vector<Observation> observations;

 private:
  void make_frames();
  void collect(const std::vector<std::vector<SeenPoint>>& seen);
  void keep_refinable(std::vector<Observation>& all);
  bool is_in_front(std::size_t image, const SeenPoint& seen) const;
  Vec2d error_of(const Observation& observation) const;
};

}  // namespace gs::refinement
