// SPDX-License-Identifier: Apache-2.0
#include "gs_core/forecast/training_memory.h"

#include <algorithm>

#include "gs_core/density/growth_method.h"
#include "gs_core/forecast/gpu_step.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/render/ray_depth.h"
#include "gs_core/math/render/surface_loss.h"
#include "gs_core/model_rows.h"
#include "gs_core/system/bytes.h"

namespace gs {
namespace {

constexpr double kWord = sizeof(std::uint32_t);
constexpr double kTilePixels = kTileWidth * kTileHeight;
constexpr int kPhotoSlots = 4;             // of photos beyond the budget
constexpr double kSmallBuffers = 2 << 20;  // counters, reports, scratch of scans

// Bytes of a pixel: picture 12, transmittance 4, last instance 4, its gradient 12, and three
// derivatives of SSIM by each channel 36, whose rows are rounded up to whole blocks.
constexpr double kBytesOfPixel = 12 + 4 + 4 + 12 + 1.05 * 36;
constexpr double kBytesOfReducedPhoto = 1;  // a pixel in four of photo and mask, at first
constexpr double kBytesOfDepthPixel = 12;   // blended depths, gradients by them and by alpha
// Sums of surfaces and the gradient by them, inverse depths, gradients by these, two gray photos.
constexpr double kBytesOfSurfacePixel =
    2 * sizeof(SurfaceRow) + sizeof(PixelSurface<float>) + 3 * sizeof(float);
constexpr double kBytesOfTile = 3 * kWord + 2 * kWord;  // range, order, checkpoint; a segment

// What an array is expected to have for each byte in use, half way between two steps of its growth.
double mean_reserve(double bytes) { return 1.0 + 0.5 * reserve_share(std::size_t(bytes)); }
double with_reserve(double bytes) { return bytes * mean_reserve(bytes); }

// Adds up arrays with a row per Gaussian.
struct Rows {
  double count;
  bool have_reserve;
  double sum = 0;

  void add(double row_bytes) {
    const double bytes = count * row_bytes;
    sum += have_reserve ? with_reserve(bytes) : bytes;
  }
  void add_words(int arrays) {
    for (int array = 0; array < arrays; ++array) add(kWord);
  }
  void add(const std::vector<ByteBuffer*>& arrays) {
    for (const ByteBuffer* const array : arrays) add(double(array->row_bytes()));
  }
};

// Parameters, moments and statistics.
void add_state(const TrainingSize& size, Rows& rows) {
  ModelRows model;
  model.gaussians.has_time = size.has_time;
  model.gaussians.has_filter = size.has_filter;
  model.statistics.has_sums = size.has_sums;
  model.store_moments_as(size.moments);
  model.match_moments();
  for (const Column& column : model.columns()) rows.add(double(column.rows->row_bytes()));
}

// The arrays of each photo of a batch. Those of the first one are partly borrowed by row operations
// and so kept, and partly released with the step.
void add_photos(const TrainingSize& size, Rows& kept, Rows& step) {
  const StepSums sums{size.has_sums && !size.has_score_pass, size.is_deterministic,
                      size.is_absolute, size.has_depth_maps || size.has_surface};
  PhotoArrays of_photo;
  for (int photo = 0; photo < size.batch; ++photo) {
    kept.add(of_photo.borrowed());
    (photo == 0 ? step : kept).add(of_photo.others(sums));
  }
}

// What a step has once, whatever the photos are.
void add_step(const TrainingSize& size, Rows& rows) {
  rows.add_words(3);  // depth order, rows and the first instances
  if (size.is_deterministic) rows.add(sizeof(FineSums)), rows.add(sizeof(CoarseSums));
  if (size.has_score_pass) rows.add(sizeof(FixedFragmentSums));
  if (size.is_by_pixel) rows.add(sizeof(RayDepth<float>));
  if (size.has_surface) rows.add(2 * sizeof(SurfaceRow) + sizeof(GaussianShape<float>));
}

// What row operations keep besides the memory that they borrow from the step.
void add_row_operations(const TrainingSize& size, Rows& rows) {
  if (size.growth == RowGrowth::none) return;
  rows.add(size.relocates ? sizeof(std::uint64_t) : 1);  // sums of weights, or actions
  // dead rows and how often each is drawn, or sources, clones and parents
  rows.add_words(size.relocates ? 2 : 3);
}

double instance_bytes(const TrainingSize& size, bool have_reserve) {
  Rows places{std::max(size.instance_places * size.gaussians, double(kLeastCapacity)),
              have_reserve};
  constexpr double kSegmentPixels = kTilePixels / kSegmentLength;
  const bool has_short_keys = size.pixels / kTilePixels < kShortKeyTiles && !size.is_by_pixel;
  places.add(std::max(double(unsorted_bytes(has_short_keys)), sizeof(Vec4f) * kSegmentPixels));
  if (size.has_depth_maps) places.add(sizeof(float) * kSegmentPixels);
  places.add_words(1);  // the lists
  return places.sum;
}

double picture_bytes(const TrainingSize& size) {
  double bytes = kBytesOfPixel + kBytesOfReducedPhoto + kBytesOfTile / kTilePixels;
  if (size.has_score_pass) bytes += sizeof(float);
  if (size.has_depth_maps) bytes += kBytesOfDepthPixel;
  if (size.has_surface) bytes += kBytesOfSurfacePixel;
  return bytes * size.pixels + size.photo_bytes + size.map_bytes;
}

}  // namespace

PictureSizes picture_sizes(const std::vector<View>& train_views) {
  PictureSizes sizes;
  for (const View& view : train_views) {
    const double pixels = double(view.camera.width) * double(view.camera.height);
    const double photo = double(photo_bytes(view));
    sizes.pixels = std::max(sizes.pixels, pixels);
    sizes.photo_bytes += photo;
    sizes.largest_photo_bytes = std::max(sizes.largest_photo_bytes, photo);
    if (view.has_depth_map) sizes.depth_pixels += pixels;
    if (view.has_normal_map) sizes.normal_pixels += pixels;
  }
  return sizes;
}

bool rises_to_cap(const Config& config) {
  return config.density.max_gaussians > 0 && growth_method(config.density.strategy).rises_to_cap();
}

TrainingSize training_size(const Config& config, const PictureSizes& pictures, double gaussians) {
  const GrowthMethod& method = growth_method(config.density.strategy);
  const double budget = double(config.train.photo_gib) * kBytesPerGib;
  TrainingSize size;
  size.gaussians = gaussians;
  size.pixels = pictures.pixels;
  size.photo_bytes = pictures.photo_bytes <= budget
                         ? pictures.photo_bytes
                         : budget + kPhotoSlots * pictures.largest_photo_bytes;
  size.growth = rises_to_cap(config) ? RowGrowth::reserved : RowGrowth::by_need;
  size.relocates = method.relocates;
  size.batch = config.train.batch;
  size.moments = config.optimizer.moments;
  size.has_time = config.model.dynamic;
  size.has_filter = config.model.filter_3d;
  size.has_sums = needs_fragment_sums(method.score) || method.prunes_shares();
  size.has_score_pass = sums_pixel_values(method.score);
  size.is_absolute = method.absolute_gradient;
  size.has_depth_maps = config.loss.depth_weight > 0 && pictures.depth_pixels > 0;
  size.has_surface = config.surface.is_on();
  if (size.has_depth_maps) size.map_bytes += sizeof(float) * pictures.depth_pixels;
  if (config.surface.prior_weight > 0) size.map_bytes += 3 * pictures.normal_pixels;
  size.is_deterministic = config.train.deterministic;
  size.is_by_pixel = config.render.order == RenderOrder::pixel;
  return size;
}

double first_gaussians(const Config& config, std::size_t points, std::size_t most) {
  const double cap = double(config.density.max_gaussians);  // 0 or less: none yet
  const double start =
      points == 0 ? double(config.model.random_points) : double(std::min(points, most));
  return cap > 0 ? std::min(start, cap) : start;
}

double certain_gaussians(const Config& config, double start) {
  return rises_to_cap(config) ? std::max(start, double(config.density.max_gaussians)) : start;
}

double state_bytes(const TrainingSize& size, double gaussians) {
  Rows state{gaussians, false};
  add_state(size, state);
  return state.sum;
}

double training_bytes(const TrainingSize& size) {
  const bool grows = size.growth != RowGrowth::none;
  const bool is_held_twice = size.growth == RowGrowth::by_need;
  Rows state{size.gaussians, is_held_twice}, kept{size.gaussians, grows},
      step{size.gaussians, grows};
  add_state(size, state);
  add_row_operations(size, kept);
  add_photos(size, kept, step);
  add_step(size, step);
  const double of_step = step.sum + instance_bytes(size, grows);
  // An array that grows holds its old rows until they are copied. SH coefficients have most, or
  // their moments.
  const double of_number = std::max(int(sizeof(float)), moment_bytes(size.moments));
  const double rows = size.gaussians * of_number * (sizeof(ShRest) / sizeof(float));
  const double old_rows = is_held_twice ? rows / mean_reserve(rows) : 0;
  const double most =
      old_rows < double(kBytesWorthReleasing) ? of_step + old_rows : std::max(of_step, old_rows);
  return state.sum + kept.sum + most + picture_bytes(size) + kSmallBuffers;
}

double gaussians_that_fit(TrainingSize size, double bytes) {
  double low = 0, high = 1e12;
  for (int round = 0; round < 100 && high - low > 0.5; ++round) {
    size.gaussians = (low + high) / 2;
    (training_bytes(size) <= bytes ? low : high) = size.gaussians;
  }
  return low;
}

}  // namespace gs
