// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8 for one photo: its gradients are written to arrays, or Adam follows at once.
#include "cuda/gradients/preprocess_backward.cuh"

namespace gs::cuda {
namespace {

constexpr int kBasisStride = kShBasisCount + 1;  // odd, so that 32 rows begin in different banks

template <class Stored>
struct Shared : ShRows<Stored> {
  union {
    float numbers[kRowNumbers<true> * kWarp];  // parameters at first, gradients in the end
    struct {                                   // between
      float basis[kWarp * kBasisStride];       // of the viewing direction of each Gaussian
      float dL_dcolor[kWarp * 3];              // zero where a Gaussian is not visible
    };
  };
};

// The gradients of the SH rows.
template <class Stored>
struct ShGradients {
  const Shared<Stored>& shared;

  __device__ float number(int row, int number) const {
    return shared.basis[row * kBasisStride + 1 + number / 3] *
           shared.dL_dcolor[row * 3 + number % 3];
  }
  template <int count>
  __device__ Few<float, count> at(int item) const {
    const int row = count * item / kShRowNumbers, first = count * item % kShRowNumbers;
    Few<float, count> gradient;
    for (int k = 0; k < count; ++k) {
      const bool is_next = first + k >= kShRowNumbers;
      gradient.of[k] = number(row + is_next, first + k - (is_next ? kShRowNumbers : 0));
    }
    return gradient;
  }
};

// The whole warp: pulls the color gradients back to the SH coefficients of its `rows` rows. Returns
// the part of dL/d(mean) that comes from the viewing direction.
template <int degree, class Values>
__device__ Vec3f color_backward(Shared<typename Values::Stored>& shared, const Vec3f& mean,
                                const Camera& camera, std::size_t first, int rows, bool is_visible,
                                const Vec3f& dL_dcolor, const Values& numbers) {
  if constexpr (degree == 0) return Vec3f(0.0f);
  const int lane = lane_of_thread();
  float* const basis = shared.basis + lane * kBasisStride;
  Vec3f direction(0.0f);
  if (is_visible) {
    direction = unit_direction(camera.position(), mean);
    sh_basis(degree, direction, basis);
  } else {
    for (int k = 0; k < kShBasisCount; ++k) basis[k] = 0.0f;
  }
  for (int c = 0; c < 3; ++c) shared.dL_dcolor[3 * lane + c] = dL_dcolor[c];
  __pipeline_wait_prior(0);
  __syncwarp();
  finish_sh_rows<degree>(shared, numbers, first, rows, ShGradients{shared});
  if (!is_visible) return Vec3f(0.0f);
  float dL_dbasis[kShBasisCount];
  for (int k = 1; k < (degree + 1) * (degree + 1); ++k)
    dL_dbasis[k] = inner(shared.coefficients()[k - 1], dL_dcolor);
  return unit_direction_vjp(camera.position(), mean, sh_basis_vjp(degree, direction, dL_dbasis));
}

// What one launch works on.
struct Input {
  std::size_t count;  // rows of the shard
  Camera given;
  const DevicePose* pose;  // null: that of the camera
  SplatSettings settings;
  const std::uint32_t* tile_counts;  // (N)
  const Splat* splats;               // (N)
  SplatGradientSum* sums;            // (N)
  Shard shard;                       // the three arrays above have the rows of the whole model
  const float* filter_scale;         // (count)  null without a 3D filter
  const GaussianShape<float>* shape_gradients;  // (count)  null without surface terms
};

// The least blocks of a multiprocessor, a quarter of them on each of its parts. Shared memory has
// room for 11 with FloatMoments and for 18 with HalfMoments. Gaussians in space and time need
// more registers than so many blocks would leave, and so do lenses.
template <bool has_time, bool has_lens, class Stored>
constexpr int kLeastBlocks = has_lens             ? (!Stored::kIsRounded ? 8 : has_time ? 10 : 12)
                             : Stored::kIsRounded ? (has_time ? 12 : 16)
                                                  : (has_time ? 8 : 11);

// Blocks of one warp: shared memory, which bounds the warps of a multiprocessor, is given to blocks.
template <int degree, bool has_time, bool has_lens, class Target>
__global__ void __launch_bounds__(kWarp,
                                  kLeastBlocks<has_time, has_lens, typename Target::Values::Stored>)
    preprocess_backward_kernel(const __grid_constant__ Input in,
                               const __grid_constant__ Target target) {
  using Values = typename Target::Values;
  __shared__ Shared<typename Values::Stored> shared;
  const Camera camera = refined<has_lens>(in.given, in.pose);
  const std::size_t first = std::size_t(blockIdx.x) * kWarp, i = first + lane_of_thread(),
                    projected = in.shard.row_of_all(i);
  const int rows = int(min(in.count - first, std::size_t(kWarp)));
  // All loads come first, before any store, so that the warp waits for memory only once.
  start_sh_rows<degree>(shared, target.of[Quantity::sh_rest], first, rows);
  const bool is_halted = target.is_halted(), is_row = i < in.count;
  Shares<has_time, Values> shares(target.of, first, rows);
  const typename Target::Statistics statistics =
      is_row ? target.load_statistics(i) : typename Target::Statistics{};
  const SplatGradientSum sum = is_row ? load_in_vectors(in.sums + projected) : SplatGradientSum{};
  const Splat& splat = in.splats[projected];
  const Vec3f color = is_row ? splat.color : Vec3f(0.0f);  // undefined where not visible
  const float opacity = target.adds_forces() && is_row ? splat.opacity : 0.0f;
  const bool is_visible = is_row && in.tile_counts[projected] > 0;
  const float filter_scale = in.filter_scale && is_row ? in.filter_scale[i] : 0.0f;
  if (is_visible) store_in_vectors(in.sums + projected, SplatGradientSum{});  // for the next step
  if (is_halted) return;

  if constexpr (Values::Stored::kIsRounded)  // the lanes wait for each other in row()
    shared.random[lane_of_thread()] = target.rounding.of_row(projected);
  const Row<has_time> row = shares.row(shared.numbers, rows);
  SplatGradient dL_dsplat{};
  Row<has_time> gradient;
  Vec2f by_mean2d(0.0f);
  if (is_visible) {
    dL_dsplat = masked(sum, color);
    by_mean2d = target.by_mean2d(sum);
    target.add_forces(i, sum, opacity);
  }
  if constexpr (has_time) {
    // The color's part of the mean reaches the time, too, so that it comes first.
    const Vec3f mean = is_visible ? mean_at(row.in_spacetime(), camera.time) : Vec3f(0.0f);
    const Vec3f by_color = color_backward<degree>(shared, mean, camera, first, rows, is_visible,
                                                  dL_dsplat.color, target.of[Quantity::sh_rest]);
    if (is_visible) gradient = pull_back(camera, row, in.settings, dL_dsplat, by_color);
  } else {
    if (is_visible) gradient = pull_back(camera, row, filter_scale, in.settings, dL_dsplat);
    const Vec3f by_color =
        color_backward<degree>(shared, row.vector(Quantity::mean), camera, first, rows, is_visible,
                               dL_dsplat.color, target.of[Quantity::sh_rest]);
    gradient.set(Quantity::mean, gradient.vector(Quantity::mean) + by_color);
  }
  if (is_visible) gradient.set(Quantity::sh0, float(kSh0) * dL_dsplat.color);
  if (in.shape_gradients && is_row) gradient.add(in.shape_gradients[i]);
  target.regularize(row, gradient);
  if (is_row) target.note(i, statistics, by_mean2d, is_visible);
  __syncwarp();
  store_row(shared.numbers, gradient);
  __syncwarp();
  shares.finish(target.of, first, rows, shared.numbers, shared.random);
}

template <class Target>
void launch(Context& context, const GaussiansSpan& gaussians, const PhotoRows& photo,
            const Target& target, const GaussianShape<float>* shape_gradients,
            const Shard& shard = {}) {
  const Input in{gaussians.mean.size,         photo.camera,   photo.pose,      photo.settings,
                 photo.tile_counts,           photo.splats,   photo.gradients, shard,
                 gaussians.filter_scale.data, shape_gradients};
  with_form(photo.settings.sh_degree, gaussians, photo.camera.has_lens(),
            [&](auto degree, auto time, auto lens) {
              context.launch("preprocess backward",
                             preprocess_backward_kernel<degree(), time(), lens(), Target>,
                             blocks_for(in.count, kWarp), kWarp, in, target);
            });
}

}  // namespace

void preprocess_backward(Context& context, const GaussiansSpan& gaussians, const PhotoRows& photo,
                         const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d,
                         const GaussianShape<float>* shape_gradients) {
  const StageScope scope(context, "preprocess backward");
  if (photo.settings.sh_degree < kMaxShDegree && gradients.sh_rest.size)  // those not in use
    check(cudaMemsetAsync(gradients.sh_rest.data, 0, gradients.sh_rest.size * sizeof(ShRest),
                          context.stream()),
          "preprocess backward");
  WriteGradients target{{}, dL_dmean2d.data, photo.settings.absolute_gradient};
  int quantity = 0;
  for_each_array(
      [&](const char*, const auto& rows, const auto& to) {
        target.of[quantity++] = {numbers_of(rows), numbers_of(to)};
      },
      gaussians, gradients);
  launch(context, gaussians, photo, target, shape_gradients);
}

void update_by_photo(Context& context, TrainingModel& model, const PhotoRows& photo,
                     const ModelUpdate& update, const std::uint32_t* halted, const Shard& shard,
                     const GaussianShape<float>* shape_gradients) {
  with_update(model, update, photo, sums_among_gradients(photo.settings), halted, shard,
              [&](const auto& target) {
                launch(context, model.gaussians.span(), photo, target, shape_gradients, shard);
              });
}

}  // namespace gs::cuda
