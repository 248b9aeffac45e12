// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8 of a batch in one: a warp pulls the gradients of its 32 rows back from one photo
// after another, and updates the rows by the sum. No gradient of a parameter is stored, and
// parameters and moments are read and written once for all photos.
//
// A lane adds up the gradients of its Gaussian in registers. Gradients by splats may lie on another
// GPU, so a warp copies those of its visible rows in whole lines, of a few photos at a time.
#include "cuda/gradients/preprocess_backward.cuh"

namespace gs::cuda {
namespace {

// Blocks of one warp: its shared memory is that of eight blocks of a multiprocessor.
constexpr int kBlocks = 8;
// Photos whose gradients are under way at a time.
constexpr int kAtOnce = 4;

// A photo as the kernel reads it.
struct PhotoInput {
  Camera given;
  const DevicePose* pose;  // null: that of the camera
  SplatSettings settings;
  const Splat* splats;               // (N)
  const std::uint32_t* tile_counts;  // (N)
  SplatGradientSum* gradients;       // (N)
  float force_scale;                 // force_scale(); 0: forces are not among the gradients
};

struct BatchInput {
  std::size_t count;  // rows of the shard
  int photos;
  PhotoInput of[kMostBatch];
  float weight;  // of a photo's gradients
  Shard shard;
  const float* filter_scale;                    // (count)  null without a 3D filter
  const GaussianShape<float>* shape_gradients;  // (count)  null without surface terms
};

template <class Stored, bool has_time>
struct Shared : ShRows<Stored> {
  float numbers[kRowNumbers<has_time> * kWarp];  // parameters at first, gradients in the end
  union alignas(16) {
    float4 gradients[kAtOnce][kWarp * sizeof(SplatGradientSum) / sizeof(float4)];
    float sh_gradients[kWarp * kShRowNumbers];  // in the end
  };
};

struct ShGradients {
  const float* numbers;

  template <int count>
  __device__ Few<float, count> at(int item) const {
    return reinterpret_cast<const Few<float, count>*>(numbers)[item];
  }
};

// Photos whose gradients are under way, as a lane sees them.
struct PhotosUnderWay {
  bool is_visible[kAtOnce];
  Vec3f color[kAtOnce];  // undefined where not visible
};

// The whole warp: starts to copy the gradients by the splats of rows that are visible in photo
// `begin` or one of the next.
template <class Shared>
__device__ PhotosUnderWay start_photos(Shared& shared, const BatchInput& in, int begin,
                                       std::size_t first_projected, bool is_row) {
  constexpr int kInRow = sizeof(SplatGradientSum) / sizeof(float4);
  const int lane = lane_of_thread();
  PhotosUnderWay photos;
#pragma unroll
  for (int p = 0; p < kAtOnce; ++p)
    photos.is_visible[p] =
        is_row && begin + p < in.photos && in.of[begin + p].tile_counts[first_projected + lane] > 0;
#pragma unroll
  for (int p = 0; p < kAtOnce; ++p) {
    const std::uint32_t visible = __ballot_sync(kAllLanes, photos.is_visible[p]);
    if (!visible) continue;
    const float4* const from =
        reinterpret_cast<const float4*>(in.of[begin + p].gradients + first_projected);
    for (int item = lane; item < kWarp * kInRow; item += kWarp)
      if (visible >> (item / kInRow) & 1)
        __pipeline_memcpy_async(shared.gradients[p] + item, from + item, sizeof(float4));
    if (photos.is_visible[p])
      photos.color[p] = in.of[begin + p].splats[first_projected + lane].color;
  }
  __pipeline_commit();
  return photos;
}

// What photos say of this lane's row.
template <int degree, bool has_time>
struct RowSum {
  Row<has_time> gradient;
  float sh_rest[std::max(kShNumbersInUse<degree>, 1)] = {};
  float visits = 0, gradient_norm = 0;  // statistics
};

// Adds a photo that shows the row. `clamped` has a bit for each channel of its color that blending
// has clamped.
template <bool has_lens, int degree, bool has_time, class Target>
__device__ void add_photo(RowSum<degree, has_time>& to, const PhotoInput& photo,
                          const SplatGradientSum& sum, unsigned clamped, float weight,
                          const Row<has_time>& row, const Vec3f* coefficients, float filter_scale,
                          const Target& target, std::size_t i, std::size_t projected) {
  const Camera camera = refined<has_lens>(photo.given, photo.pose);
  const auto color_as_bit = [&](int channel) { return clamped >> channel & 1 ? -1.0f : 0.0f; };
  const SplatGradient dL_dsplat =
      masked(sum, Vec3f(color_as_bit(0), color_as_bit(1), color_as_bit(2)));
  to.visits += 1.0f;
  to.gradient_norm += screen_gradient_norm(target.by_mean2d(sum), camera.width, camera.height);
  if (target.adds_forces() && photo.force_scale > 0) {
    GatherStatistics forces = target;
    forces.force_scale = photo.force_scale;
    forces.add_forces(i, sum, photo.splats[projected].opacity);
  }
  Vec3f mean = row.vector(Quantity::mean), by_color(0.0f);
  if constexpr (has_time) mean = mean_at(row.in_spacetime(), camera.time);
  if constexpr (degree > 0) {
    constexpr int kBasis = (degree + 1) * (degree + 1);
    const Vec3f direction = unit_direction(camera.position(), mean);
    float basis[kShBasisCount], dL_dbasis[kShBasisCount];
    sh_basis(degree, direction, basis);
    // SH may rise by a degree between two photos of a batch.
    const int in_use = (photo.settings.sh_degree + 1) * (photo.settings.sh_degree + 1);
    for (int k = 1; k < kBasis; ++k) {
      dL_dbasis[k] = k < in_use ? inner(coefficients[k - 1], dL_dsplat.color) : 0.0f;
      if (k >= in_use) continue;
      for (int c = 0; c < 3; ++c)
        to.sh_rest[3 * (k - 1) + c] += weight * (basis[k] * dL_dsplat.color[c]);
    }
    by_color =
        unit_direction_vjp(camera.position(), mean, sh_basis_vjp(degree, direction, dL_dbasis));
  }
  Row<has_time> gradient;
  if constexpr (has_time) {
    gradient = pull_back(camera, row, photo.settings, dL_dsplat, by_color);
  } else {
    gradient = pull_back(camera, row, filter_scale, photo.settings, dL_dsplat);
    gradient.set(Quantity::mean, gradient.vector(Quantity::mean) + by_color);
  }
  gradient.set(Quantity::sh0, float(kSh0) * dL_dsplat.color);
  for (int k = 0; k < kRowNumbers<has_time>; ++k)
    to.gradient.numbers[k] += weight * gradient.numbers[k];
}

template <int degree, bool has_time, bool has_lens, class Target>
__global__ void __launch_bounds__(kWarp, kBlocks)
    update_by_photos_kernel(const __grid_constant__ BatchInput in,
                            const __grid_constant__ Target target) {
  using Values = typename Target::Values;
  __shared__ Shared<typename Values::Stored, has_time> shared;
  const int lane = lane_of_thread();
  const std::size_t first = std::size_t(blockIdx.x) * kWarp, i = first + lane;
  const std::size_t first_projected = in.shard.row_of_all(first),
                    projected = first_projected + lane;  // a warp's rows are neighbors
  const int rows = int(min(in.count - first, std::size_t(kWarp)));
  const bool is_row = i < in.count;
  // All loads of rows come first. Which are visible says what is loaded of the photos.
  start_sh_rows<degree>(shared, target.of[Quantity::sh_rest], first, rows);
  const bool is_halted = target.is_halted();
  Shares<has_time, Values> shares(target.of, first, rows);
  const typename Target::Statistics before =
      is_row ? target.load_statistics(i) : typename Target::Statistics{};
  const float filter_scale = in.filter_scale && is_row ? in.filter_scale[i] : 0.0f;
  PhotosUnderWay photos = start_photos(shared, in, 0, first_projected, is_row);
  if constexpr (Values::Stored::kIsRounded)  // the lanes wait for each other in row()
    shared.random[lane] = target.rounding.of_row(projected);
  const Row<has_time> row = shares.row(shared.numbers, rows);
  RowSum<degree, has_time> sum;
#pragma unroll 1
  for (int begin = 0;;) {
    __pipeline_wait_prior(0);
    __syncwarp();
    unsigned visible = 0, clamped = 0;  // bits of photos, and of their colors
#pragma unroll
    for (int p = 0; p < kAtOnce; ++p) {
      if (!photos.is_visible[p]) continue;
      visible |= 1u << p;
      for (int c = 0; c < 3; ++c)
        if (!(photos.color[p][c] >= 0.0f)) clamped |= 1u << (3 * p + c);
      // For the next step.
      store_in_vectors(in.of[begin + p].gradients + projected, SplatGradientSum{});
    }
    if (is_halted) visible = 0;
#pragma unroll 1
    for (int p = 0; p < kAtOnce; ++p)
      if (visible >> p & 1)
        add_photo<has_lens, degree>(
            sum, in.of[begin + p],
            load_in_vectors(reinterpret_cast<const SplatGradientSum*>(shared.gradients[p]) + lane),
            clamped >> (3 * p), in.weight, row, shared.coefficients(), filter_scale, target, i,
            projected);
    __syncwarp();
    begin += kAtOnce;
    if (begin >= in.photos) break;
    photos = start_photos(shared, in, begin, first_projected, is_row);
  }
  if (is_halted) return;

  if (in.shape_gradients && is_row) sum.gradient.add(in.shape_gradients[i]);
  target.regularize(row, sum.gradient);
  if (is_row) target.note_all(i, before, sum.visits, sum.gradient_norm);
  for (int k = 0; k < kShNumbersInUse<degree>; ++k)
    shared.sh_gradients[lane * kShRowNumbers + k] = sum.sh_rest[k];
  store_row(shared.numbers, sum.gradient);
  __syncwarp();
  finish_sh_rows<degree>(shared, target.of[Quantity::sh_rest], first, rows,
                         ShGradients{shared.sh_gradients});
  shares.finish(target.of, first, rows, shared.numbers, shared.random);
}

}  // namespace

void update_by_photos(Context& context, TrainingModel& model, Span<const PhotoRows> photos,
                      const ModelUpdate& update, const std::uint32_t* halted, const Shard& shard,
                      const GaussianShape<float>* shape_gradients) {
  const StageScope scope(context, "preprocess backward, Adam");
  GS_CHECK(photos.size >= 1 && photos.size <= std::size_t(kMostBatch));
  if (photos.size == 1)
    return update_by_photo(context, model, photos[0], update, halted, shard, shape_gradients);
  const PhotoRows& last = photos[photos.size - 1];
  const GaussiansSpan gaussians = model.gaussians.span();
  BatchInput in{model.count(),
                int(photos.size),
                {},
                1.0f / float(photos.size),
                shard,
                gaussians.filter_scale.data,
                shape_gradients};
  bool any_adds_forces = false;
  for (std::size_t p = 0; p < photos.size; ++p) {
    const PhotoRows& photo = photos[p];
    GS_CHECK(photo.settings.sh_degree <= last.settings.sh_degree);
    const bool adds_forces = sums_among_gradients(photo.settings);
    any_adds_forces |= adds_forces;
    in.of[p] = {photo.camera,
                photo.pose,
                photo.settings,
                photo.splats,
                photo.tile_counts,
                photo.gradients,
                adds_forces ? force_scale(photo.pixel_count()) : 0.0f};
  }
  with_update(
      model, update, last, any_adds_forces, halted, shard, [&]<class Target>(const Target& target) {
        with_form(last.settings.sh_degree, gaussians, any_has_lens(photos),
                  [&](auto degree, auto time, auto lens) {
                    context.launch("update by photos",
                                   update_by_photos_kernel<degree(), time(), lens(), Target>,
                                   blocks_for(in.count, kWarp), kWarp, in, target);
                  });
      });
}

}  // namespace gs::cuda
