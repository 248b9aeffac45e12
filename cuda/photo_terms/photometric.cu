// SPDX-License-Identifier: Apache-2.0
// After stage 5, for photos that differ in light: the sum of a photo's gradient. It is a single
// block, so that the sums have an order of their own: the same bits come out each time.
#include "cuda/photo_terms/photometric.cuh"

#include "cuda/device/block_sums.cuh"

namespace gs::cuda {
namespace {

// Threads of a block: a multiple of kNumbers makes all sums of a thread those of one channel.
constexpr int kNumbers = 3, kThreads = 768;  // of a photo: log gains

__global__ void __launch_bounds__(kThreads)
    add_gradient_kernel(Span<const float> of_blocks, PhotoOnDevice photo) {
  __shared__ double shared[1][kThreads];
  double sum[1] = {0};
  for (std::size_t i = threadIdx.x; i < of_blocks.size; i += kThreads)
    sum[0] += double(of_blocks[i]);
  sum_by_remainder<kNumbers>(sum, shared);
  const int i = int(threadIdx.x);
  if (i < kNumbers) photo.photo_gradient[i] += photo.weight * shared[0][i];
}

// Where the photos of a batch have their numbers in the gradient of all.
struct BatchPlaces {
  int photos;
  double* gradient[kMostBatch];
};

// gradient += the rows of all photos, one photo after another, and clears the rows. A thread has
// one number of each row.
__global__ void add_rows_kernel(const __grid_constant__ BatchPlaces places, double* rows) {
  for (int i = 0; i < places.photos; ++i) {
    double& of_photo = rows[std::size_t(i) * blockDim.x + threadIdx.x];
    places.gradient[i][threadIdx.x] += of_photo;
    of_photo = 0;
  }
}

}  // namespace

void add_look_gradient(Context& context, Span<const float> of_blocks, const PhotoOnDevice& photo) {
  if (!photo.photo_gradient) return;
  const StageScope scope(context, "photometric");
  context.launch("photometric", add_gradient_kernel, 1, kThreads, of_blocks, photo);
}

void PhotometricStage::begin(const PhotometricState& state, std::size_t photos) {
  if (!is_on()) return;
  GS_CHECK(!state.empty());
  PhotoTableStage::begin(state);
  const std::size_t numbers = has_rows(photos) ? photos * state.numbers : 0;
  if (rows_.size() >= numbers) return;
  rows_.resize_discard(numbers);
  rows_.fill_zero();
}

PhotoOnDevice PhotometricStage::photo(const PhotometricState& state, const PhotoTableUpdate& update,
                                      const TrainingPhoto& photo, std::size_t i,
                                      std::size_t photos) const {
  PhotoOnDevice result{state.row(photo.photo_row).data};
  if (!update.is_due) return result;
  result.weight = 1.0 / double(photos);
  result.photo_gradient =
      has_rows(photos) ? rows_.data() + i * state.numbers : gradient_of(state, photo.photo_row);
  return result;
}

void PhotometricStage::update(PhotometricState& state, const PhotoTableUpdate& update,
                              Span<const TrainingPhoto> batch, const std::uint32_t* halted) {
  if (!update.is_due) return;
  GS_CHECK(int(state.numbers) == kNumbers);
  if (has_rows(batch.size)) {
    BatchPlaces places{int(batch.size), {}};
    for (std::size_t i = 0; i < batch.size; ++i)
      places.gradient[i] = gradient_of(state, batch[i].photo_row);
    const StageScope scope(context_, name_);
    context_.launch(name_, add_rows_kernel, 1, kNumbers, places, rows_.data());
  }
  PhotoTableStage::update(state, model_->pulls(state), update, halted);
}

}  // namespace gs::cuda
