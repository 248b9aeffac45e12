// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8 of a batch of a few photos in one: a warp pulls the gradients of its 32 rows back
// from one photo after another, and updates the rows by the sum. No gradient of a parameter is
// stored, and parameters and moments are read and written once for all photos.
//
// A lane adds up the gradients of its Gaussian in registers. Gradients by splats may lie on another
// GPU, so a warp copies those of its visible rows in whole lines.
#include "cuda/train/photo_rows.cuh"
#include "cuda/train/preprocess_backward.cuh"

namespace gs::cuda {
namespace {

// Blocks of one warp: its shared memory is that of eight blocks of a multiprocessor.
constexpr int kBlocks = 8;

// A photo as the kernel reads it.
struct PhotoInput {
  Camera camera;
  SplatSettings settings;
  const Splat* splats;               // (N)
  const std::uint32_t* tile_counts;  // (N)
  SplatGradientSum* gradients;       // (N)
  float force_scale;                 // force_scale()
};

struct BatchInput {
  std::size_t count;  // rows of the shard
  int photos;
  PhotoInput of[kMostTogether];
  float weight;  // of a photo's gradients
  Shard shard;
  const float* filter_scale;  // (count)  null without a 3D filter
};

template <class Numbers>
struct BatchShared : CodeRows<Numbers::kHasCodes> {
  // of the parameters, and what goes along; aligned for copies of 16 bytes
  alignas(16) float sh_rows[kFloatArrays<Numbers>][kWarp * kShRowNumbers];
  RowNumbers numbers;  // parameters at first, gradients in the end
  union {
    float4 gradients[kMostTogether][kWarp * sizeof(SplatGradientSum) / sizeof(float4)];
    float sh_gradients[kWarp * kShRowNumbers];  // in the end
  };
};

// The whole warp: starts to copy the gradients by the splats of rows that are visible in a photo.
__device__ void start_gradients(float4* to, const SplatGradientSum* from, std::uint32_t visible) {
  constexpr int kInRow = sizeof(SplatGradientSum) / sizeof(float4);
  for (int item = lane_of_thread(); item < kWarp * kInRow; item += kWarp)
    if (visible >> (item / kInRow) & 1)
      __pipeline_memcpy_async(to + item, reinterpret_cast<const float4*>(from) + item,
                              sizeof(float4));
}

// What the photos of a batch add to the statistics of a row.
struct MoreStatistics {
  float visits = 0, gradient_norm = 0;
};

// The gradients of one row.
template <int degree>
struct RowSum : RowGradient {
  float sh_rest[std::max(kShNumbersInUse<degree>, 1)] = {};

  // += weight * the gradients of a photo, but for sh_rest.
  __device__ void add(const RowGradient& photo, float weight) {
    for (int c = 0; c < 3; ++c) {
      mean[c] += weight * photo.mean[c];
      log_scale[c] += weight * photo.log_scale[c];
      sh0[c] += weight * photo.sh0[c];
    }
    rotation.w += weight * photo.rotation.w;
    rotation.x += weight * photo.rotation.x;
    rotation.y += weight * photo.rotation.y;
    rotation.z += weight * photo.rotation.z;
    logit_opacity += weight * photo.logit_opacity;
  }
};

// Adds what a photo says of this lane's row, which is visible there. `clamped` has a bit for each
// channel of its color that blending has clamped.
template <int degree, class Sink, class Shared>
__device__ void add_photo(const Shared& shared, const PhotoInput& photo, const Sink& sink,
                          std::size_t i, std::size_t projected, const Shape& shape,
                          float filter_scale, int photo_number, std::uint32_t clamped, float weight,
                          RowSum<degree>& to, MoreStatistics& statistics) {
  const int lane = lane_of_thread();
  const SplatGradientSum sum = load_in_vectors(
      reinterpret_cast<const SplatGradientSum*>(shared.gradients[photo_number]) + lane);
  const auto color_as_bit = [&](int channel) { return clamped >> channel & 1 ? -1.0f : 0.0f; };
  const SplatGradient dL_dsplat =
      masked(sum, Vec3f(color_as_bit(0), color_as_bit(1), color_as_bit(2)));
  statistics.visits += 1.0f;
  statistics.gradient_norm +=
      screen_gradient_norm(sink.by_mean2d(sum), photo.camera.width, photo.camera.height);
  if (sink.adds_forces()) {
    GatherStatistics forces = sink;
    forces.force_scale = photo.force_scale;
    forces.add_forces(i, sum, photo.splats[projected].opacity);
  }
  RowGradient gradient = pull_back(photo.camera, shape, filter_scale, photo.settings, dL_dsplat);
  gradient.sh0 = float(kSh0) * dL_dsplat.color;
  if constexpr (degree > 0) {
    constexpr int kBasis = (degree + 1) * (degree + 1);
    const Vec3f direction = unit_direction(photo.camera.position(), shape.mean);
    float basis[kShBasisCount], dL_dbasis[kShBasisCount];
    sh_basis(degree, direction, basis);
    const Vec3f* const row =
        reinterpret_cast<const Vec3f*>(shared.sh_rows[0] + lane * kShRowNumbers);
    // SH may rise by a degree between two photos of a batch.
    const int in_use = (photo.settings.sh_degree + 1) * (photo.settings.sh_degree + 1);
    for (int k = 1; k < kBasis; ++k) {
      dL_dbasis[k] = k < in_use ? inner(row[k - 1], dL_dsplat.color) : 0.0f;
      if (k >= in_use) continue;
      for (int c = 0; c < 3; ++c)
        to.sh_rest[3 * (k - 1) + c] += weight * (basis[k] * dL_dsplat.color[c]);
    }
    gradient.mean += unit_direction_vjp(photo.camera.position(), shape.mean,
                                        sh_basis_vjp(degree, direction, dL_dbasis));
  }
  to.add(gradient, weight);
}

// The whole warp: updates its SH rows, four numbers at a time where it can.
template <int degree, class Shared, class Numbers>
__device__ void finish_sh_rows(Shared& shared, const Numbers& numbers, std::size_t first,
                               int rows) {
  if constexpr (degree == 0) return;
  if (degree == kMaxShDegree && rows == kWarp) {
    const std::size_t base = first / 4 * kShRowNumbers;  // `first` is a multiple of 32
    for (int item = lane_of_thread(); item < kWarp * kShRowNumbers / 4; item += kWarp) {
      float4 loaded[Numbers::kArrays];
      load_sh(shared, numbers, item, loaded);
      numbers.finish(base + item, loaded,
                     reinterpret_cast<const float4*>(shared.sh_gradients)[item],
                     NumberPlace<Shared>{shared, 4 * item / kShRowNumbers, 4 * item % kShRowNumbers,
                                         kShRowNumbers});
    }
    return;
  }
  constexpr int kInUse = std::max(kShNumbersInUse<degree>, 1);
  for (int item = lane_of_thread(); item < rows * kInUse; item += kWarp) {
    const int row = item / kInUse, number = item % kInUse, at = row * kShRowNumbers + number;
    float loaded[Numbers::kArrays];
    load_sh(shared, numbers, at, loaded);
    numbers.finish(first * kShRowNumbers + at, loaded, shared.sh_gradients[at],
                   NumberPlace<Shared>{shared, row, number, kShRowNumbers});
  }
}

template <int degree, class Sink>
__global__ void __launch_bounds__(kWarp, kBlocks)
    update_by_photos_kernel(const __grid_constant__ BatchInput in,
                            const __grid_constant__ Sink sink) {
  __shared__ BatchShared<typename Sink::Numbers> shared;
  const int lane = lane_of_thread();
  const std::size_t first = std::size_t(blockIdx.x) * kWarp, i = first + lane;
  const std::size_t first_projected = in.shard.row_of_all(first),
                    projected = first_projected + lane;  // a warp's rows are neighbors
  const int rows = int(min(in.count - first, std::size_t(kWarp)));
  const bool is_row = i < in.count;
  // All loads of rows come first. Which are visible says what is loaded of the photos.
  if (degree > 0) start_sh_rows<degree>(shared, sink.sh_rest, first, rows, EveryRow());
  const bool is_halted = sink.is_halted();
  Shares<Sink, false> shares(sink, first, rows, EveryRow());
  const typename Sink::Statistics before =
      is_row ? sink.load_statistics(i) : typename Sink::Statistics{};
  const float filter_scale = in.filter_scale && is_row ? in.filter_scale[i] : 0.0f;
  bool is_visible[kMostTogether];
  Vec3f color[kMostTogether];
#pragma unroll
  for (int p = 0; p < kMostTogether; ++p)
    is_visible[p] = is_row && p < in.photos && in.of[p].tile_counts[projected] > 0;
#pragma unroll
  for (int p = 0; p < kMostTogether; ++p) {
    const std::uint32_t visible = __ballot_sync(kAllLanes, is_visible[p]);
    if (!visible) continue;
    start_gradients(shared.gradients[p], in.of[p].gradients + first_projected, visible);
    if (is_visible[p]) color[p] = in.of[p].splats[projected].color;
  }
  __pipeline_commit();
  if constexpr (Sink::Numbers::kHasCodes)  // the lanes wait for each other in row()
    shared.random[lane] = sink.mean.rounding.of_row(projected);
  const Shape shape = shares.row(shared.numbers, rows, EveryRow());
  __pipeline_wait_prior(0);
  __syncwarp();
  std::uint32_t visible_in = 0, clamped_in = 0;  // bits of photos, and of their colors
#pragma unroll
  for (int p = 0; p < kMostTogether; ++p) {
    if (!is_visible[p]) continue;
    visible_in |= 1u << p;
    for (int c = 0; c < 3; ++c)
      if (!(color[p][c] >= 0.0f)) clamped_in |= 1u << (3 * p + c);
    store_in_vectors(in.of[p].gradients + projected, SplatGradientSum{});  // for the next step
  }
  if (is_halted) return;

  RowSum<degree> sum{};
  MoreStatistics more;
#pragma unroll 1
  for (int p = 0; p < in.photos; ++p) {
    if (!(visible_in >> p & 1)) continue;
    add_photo<degree>(shared, in.of[p], sink, i, projected, shape, filter_scale, p,
                      clamped_in >> (3 * p), in.weight, sum, more);
  }
  sink.template regularize<false>(shape, sum);
  if (is_row) sink.note_all(i, before, more.visits, more.gradient_norm);
  __syncwarp();
  for (int k = 0; k < kShNumbersInUse<degree>; ++k)
    shared.sh_gradients[lane * kShRowNumbers + k] = sum.sh_rest[k];
  stage<false>(shared.numbers, sum);
  __syncwarp();
  finish_sh_rows<degree>(shared, sink.sh_rest, first, rows);
  shares.finish(sink, first, rows, EveryRow(), shared.numbers, shared);
}

}  // namespace

void update_by_photos(Context& context, TrainingModel& model, Span<const PhotoRows> photos,
                      const AdamSteps& steps, const AdamRule& rule, const MomentRounding& rounding,
                      const DensityStep& density, const std::uint32_t* halted, const Shard& shard) {
  const StageScope scope(context, "preprocess backward, Adam");
  GS_CHECK(photos.size >= 1 && photos.size <= std::size_t(kMostTogether) &&
           !model.gaussians.has_time);
  const RenderSettings& settings = photos[photos.size - 1].settings;
  BatchInput in{model.count(),
                int(photos.size),
                {},
                1.0f / float(photos.size),
                shard,
                model.gaussians.filter_scale.data()};
  for (std::size_t p = 0; p < photos.size; ++p) {
    const PhotoRows& photo = photos[p];
    GS_CHECK(photo.settings.sh_degree <= settings.sh_degree);
    in.of[p] = {
        photo.camera,    photo.settings,
        photo.splats,    photo.tile_counts,
        photo.gradients, force_scale(std::size_t(photo.camera.width) * photo.camera.height)};
  }
  // Each photo has its own size and scale.
  const GatherStatistics gather = gather_into(model.statistics, density, settings, 0, 0, halted);
  with_update(model, steps, rule, rounding, density, settings, gather, shard,
              [&]<class Sink>(const Sink& sink) {
                with_sh_degree(settings.sh_degree, [&](auto degree) {
                  context.launch("update by photos", update_by_photos_kernel<degree(), Sink>,
                                 blocks_for(in.count, kWarp), kWarp, in, sink);
                });
              });
}

}  // namespace gs::cuda
