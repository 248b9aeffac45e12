// SPDX-License-Identifier: Apache-2.0
// A scene to train on: posed photos and sparse points, const once loaded. The photos of a large
// scene are decoded when they are needed.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/image.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/loss/depth_kind.h"

namespace gs {

class PhotoSource;

/// One posed photo. math/photo_weight.h says how the loss uses mask and exposure.
struct View {
  std::string name;  // path of the photo relative to the images folder, as in the COLMAP model
  Camera camera;
  Image8 photo;  // (height, width, 3) of the camera's size; empty if `source` has it: with_photo()
  // (height, width, 1) of that size: 255 trains, 0 does not; empty: all train, or `source` has it
  Image8 mask = {};
  bool over_background = false;  // the mask is the photo's alpha; every pixel trains
  // (height, width, 1) of that size: values of a depth map, 0 where nothing is known. Empty: the
  // photo has no map, or `source` has it
  ImageF depth = {};
  DepthKind depth_kind = DepthKind::metric;  // what they mean, once they are there; not `automatic`
  bool has_depth_map = false;                // also before the map is read
  // (height, width, 3) of that size: NormalBytes of a normal map. Empty: as for `depth`
  Image8 normals = {};
  bool has_normal_map = false;  // also before the map is read
  Vec3f exposure{1};  // per channel: the photo shows exposure * the scene's colors (display sRGB)
  std::shared_ptr<PhotoSource> source = {};
  std::size_t index = 0;        // in `source`
  bool may_be_masked = false;   // whether the view from `source` may have a mask
  std::uint32_t camera_id = 0;  // views of one camera have the same
  // Photos that a rig took at one moment have the same number; 0: the photo was taken alone.
  std::uint32_t rig_frame = 0;
  // How the camera exposed the photo, by EXIF: log2(seconds ISO / f-number^2), one more for twice
  // the light. None where the tags are missing or were not asked for.
  std::optional<float> exposure_stops = {};
  // Of the front half of a panorama: decodes the whole, as sharp as the half. Only its photo and mask
  // count; without a lens its camera has no meaning.
  std::function<View()> panorama = {};

  /// Whether the loss weights the photo's pixels, for its mask or its exposure. Ask when the photo
  /// is there.
  bool is_weighted() const { return !mask.empty() || has_exposure(); }
  bool has_exposure() const { return exposure.x != 1 || exposure.y != 1 || exposure.z != 1; }
  /// From this value on the photo is saturated: it gives only a lower bound of the brightness
  /// (compared_photo()).
  float white() const { return has_exposure() ? kPhotoWhite : 2.0f; }
  /// Whether the mask leaves no pixel to train on or to measure. Ask when the photo is there.
  bool trains_nowhere() const {
    return has_untrained_pixels() && std::all_of(mask.pixels.begin(), mask.pixels.end(),
                                                 [](auto value) { return value == 0; });
  }
  /// Whether some pixels do not train, or train with less weight than others.
  bool has_untrained_pixels() const { return !mask.empty() && !over_background; }
};

/// Decodes the photos of a scene that is not held in memory as a whole. All functions may be called
/// by any thread.
class PhotoSource {
 public:
  virtual ~PhotoSource() = default;
  /// The view with its photo, which stays in memory while the pointer lives. Waits until the photo
  /// is decoded. Throws Error if it cannot be decoded.
  virtual std::shared_ptr<const View> view(std::size_t index) = 0;
  /// Announces a call of view(index), after those announced before, so that the photo can be
  /// decoded meanwhile.
  virtual void prefetch_decode(std::size_t index) = 0;
  /// Says that the photo is not needed soon: its memory is the first to be reused.
  virtual void release(std::size_t index) = 0;
};

/// The view with its photo: the view itself, or a copy from its source. Keep it only while the
/// photo is used.
std::shared_ptr<const View> with_photo(const View& view);
/// PhotoSource::prefetch_decode() and release(). They do nothing for a view that has its photo.
void prefetch_photo(const View& view);
void release_photo(const View& view);
/// Bytes of the view's photo and mask once they are decoded. If it is not known whether there is a
/// mask, it counts.
std::size_t photo_bytes(const View& view);
/// Bytes of a view's maps of depth and of normals.
std::size_t map_bytes(const View& view);

/// How many photos ahead to call prefetch_decode(): decoding takes some tenths of a second, a step
/// on a fast GPU some milliseconds.
inline constexpr std::size_t kPhotosAhead = 64;

/// Calls f(i, view with its photo) for the first `count` views, in order, and prefetches the next
/// ones.
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
  Vec3f position;                     // world units
  std::array<std::uint8_t, 3> color;  // sRGB
};

/// How well the views' exposures explain their colors: the relative spread of a point's colors over
/// photos, with all exposures 1 and with the solved ones.
struct ExposureSummary {
  std::size_t samples = 0;
  double spread_before = 0, spread_after = 0;
};

/// The result of refining the cameras. Errors are reprojection errors in pixels.
struct CameraRefinement {
  std::size_t observations = 0, images = 0, points = 0;  // used by the solver
  double mean_error_before = 0, mean_error_after = 0;
  double median_error_before = 0, median_error_after = 0;
  int steps = 0;  // of the solver
  bool has_converged = false;
  double seconds = 0;
};

/// Whether any of the views has a depth map, or a normal map.
bool have_depth_maps(const std::vector<View>& views);
bool have_normal_maps(const std::vector<View>& views);

/// All views with their split, and the sparse points. Views are sorted by name in byte order.
struct Scene {
  std::vector<View> train_views, test_views;
  std::vector<ScenePoint> points;
  std::string source;  // the folder it was loaded from
  // 1.1 * the largest distance of a training camera from their mean, without outliers; world units
  float extent = 1;
  // Subtracted from all coordinates; add it to have those of the COLMAP model. Mostly 0.
  Vec3d world_offset{0.0, 0.0, 0.0};
  std::size_t time_count = 0;  // different times of its photos; 2 and more: it moves
  std::optional<CameraRefinement> refinement;  // if cameras were refined
  std::optional<ExposureSummary> exposure;     // if exposures were solved for
};

/// The warning for such a scene, where it is taken for a static one.
std::string text_of_moving_scene(std::size_t time_count);

/// Cameras far away from all others (outlier_positions), mostly because of a wrong pose. Indices,
/// ascending; at most a tenth of all.
std::vector<std::size_t> outlier_cameras(const std::vector<View>& views);

/// Extent of a set of cameras without its outliers, for the position learning rate and the density
/// rules (Kerbl et al. 2023). 1 for fewer than two distinct positions.
float camera_extent(const std::vector<View>& views);

}  // namespace gs
