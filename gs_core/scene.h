// SPDX-License-Identifier: Apache-2.0
// What training starts from: posed photos and sparse points, const once loaded. The photos of a large scene stay
// where they are until they are asked for.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/image.h"
#include "gs_core/math/constants.h"

namespace gs {

class PhotoSource;

/// One posed photo. math/photo_weight.h has what the loss makes of mask and exposure.
struct View {
  std::string name;  // path of the photo relative to the images folder, as in the COLMAP model
  Camera camera;
  Image8 photo;      // (height, width, 3) of the camera's size; empty where `source` has it: with_photo()
  Image8 mask = {};  // (height, width, 1) of that size: 255 trains, 0 does not; empty: every pixel trains, or `source` has it
  bool over_background = false;  // the mask says what the photo covers: the background is behind it, and every pixel trains
  Vec3f exposure{1};  // per channel: the photo shows exposure * the scene's colors (display sRGB)
  std::shared_ptr<PhotoSource> source = {};
  std::size_t index = 0;       // in `source`
  bool may_be_masked = false;  // whether what `source` gives may have a mask

  /// Whether the photo, once it is there, stands for more than itself in the loss.
  bool is_weighted() const { return !mask.empty() || has_exposure(); }
  bool has_exposure() const { return exposure.x != 1 || exposure.y != 1 || exposure.z != 1; }
  /// The photo's value from which on it says no more than how bright the scene is at least (compared_photo()).
  float white() const { return has_exposure() ? kPhotoWhite : 2.0f; }
  /// Whether there are pixels that do not train, or less than others.
  bool has_untrained_pixels() const { return !mask.empty() && !over_background; }
};

/// Brings the photos of a scene that is not held in memory as a whole. All calls may come from any thread.
class PhotoSource {
 public:
  virtual ~PhotoSource() = default;
  /// The view with its photo, which stays while the pointer lives. Waits until it is decoded; throws Error where it cannot be.
  virtual std::shared_ptr<const View> view(std::size_t index) = 0;
  /// Tells that view(index) will be asked for after all that were expected before, so that it can be decoded meanwhile.
  virtual void prefetch_decode(std::size_t index) = 0;
  /// Tells that nobody will ask for it soon: its bytes are the first to go.
  virtual void release(std::size_t index) = 0;
};

/// The view with its photo: itself, or what its source gives. Hold it no longer than the photo is looked at.
std::shared_ptr<const View> with_photo(const View& view);
/// PhotoSource::prefetch_decode() and release(); nothing for a view whose photo is there.
void prefetch_photo(const View& view);
void release_photo(const View& view);
/// Of the view's photo and mask once they are decoded; at most, where it is not known whether there will be a mask.
std::size_t photo_bytes(const View& view);

/// How long before it is asked for a photo is best expected: a decoder takes some tenths of a second, a step on a fast
/// GPU some milliseconds.
inline constexpr std::size_t kPhotosAhead = 64;

/// Calls f(i, view with its photo) for the first `count` views, in order, each expected beforehand.
template <class F>
void for_each_with_photo(const std::vector<View>& views, std::size_t count, F&& f) {
  for (std::size_t i = 0; i < std::min(count, kPhotosAhead); ++i) prefetch_photo(views[i]);
  for (std::size_t i = 0; i < count; ++i) {
    if (i + kPhotosAhead < count) prefetch_photo(views[i + kPhotosAhead]);
    f(i, *with_photo(views[i]));
  }
}

/// A point of the sparse reconstruction.
struct ScenePoint {
  Vec3f position;                    // world units
  std::array<std::uint8_t, 3> color;  // sRGB
};

/// How well the views' exposures explain their colors: the spread of a point's colors over photos, relative, with
/// exposures 1 and with those solved.
struct ExposureSummary {
  std::size_t samples = 0;
  double spread_before = 0, spread_after = 0;
};

/// What refining the cameras came to. Errors are lengths in pixels between where points are seen and where they land.
struct CameraRefinement {
  std::size_t observations = 0, images = 0, points = 0;  // that took part
  double mean_error_before = 0, mean_error_after = 0;
  double median_error_before = 0, median_error_after = 0;
  int steps = 0;  // of the solver
  bool has_converged = false;
  double seconds = 0;
};

/// All views with their split, and the sparse points. Views are sorted by name in byte order.
struct Scene {
  std::vector<View> train_views, test_views;
  std::vector<ScenePoint> points;
  std::string source;  // the folder it was loaded from
  float extent = 1;    // 1.1 * the largest distance of a training camera from their mean, outliers left out; world units
  Vec3d world_offset{0.0, 0.0, 0.0};  // was taken off all coordinates: add it to have the model's own; 0 for most
  std::optional<CameraRefinement> refinement;  // where cameras were refined
  std::optional<ExposureSummary> exposure;  // where exposures were solved for
};

/// Cameras that stand far away from all others, mostly by a wrong pose: more than ten times as far from the median
/// position as nine in ten of the cameras. Indices, ascending; at most a tenth of all.
std::vector<std::size_t> outlier_cameras(const std::vector<View>& views);

/// Extent of a set of cameras, as the position learning rate and the density rules use it
/// (Kerbl et al. 2023), outlier cameras left out. Returns 1 for fewer than two distinct positions.
float camera_extent(const std::vector<View>& views);

}  // namespace gs
