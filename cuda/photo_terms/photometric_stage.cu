// SPDX-License-Identifier: Apache-2.0
#include "cuda/photo_terms/photometric_stage.cuh"

namespace gs::cuda {
namespace {

// Where the photos of a batch have their numbers in the gradient of all.
struct BatchPlaces {
  int photos;
  std::uint32_t photo_begin[kMostBatch];
};

// gradient += the rows of all photos, one photo after another, and clears the rows. A thread has
// one number of each row.
__global__ void add_rows_kernel(const __grid_constant__ BatchPlaces places, PhotometricShape shape,
                                double* rows, double* gradient) {
  const std::uint32_t number = threadIdx.x;
  if (number >= shape.photo_size) return;
  for (int i = 0; i < places.photos; ++i) {
    double& of_photo = rows[std::size_t(i) * shape.photo_size + number];
    gradient[places.photo_begin[i] + number] += of_photo;
    of_photo = 0;
  }
}

}  // namespace

PhotometricUpdate PhotometricStage::update_of(const PhotometricState& state,
                                              const Update& update) const {
  if (!is_on_ || !(update.photometric_rate > 0)) return {};
  const AdamRule& rule = update.photo_rule;
  return {true, adam_step(state.adam_steps + rule.steps, update.photometric_rate), rule};
}

void PhotometricStage::begin(const PhotometricState& state, std::size_t photos) {
  if (!is_on_) return;
  GS_CHECK(!state.empty());
  const std::size_t numbers = has_rows(photos) ? photos * state.shape.photo_size : 0;
  if (gradient_.size() != state.shape.size()) {
    gradient_.resize_discard(state.shape.size());
    gradient_.fill_zero();
  }
  if (rows_.size() < numbers) {
    rows_.resize_discard(numbers);
    rows_.fill_zero();
  }
}

PhotoOnDevice PhotometricStage::photo(const PhotometricState& state,
                                      const PhotometricUpdate& update, const TrainingPhoto& photo,
                                      std::size_t i, std::size_t photos) const {
  PhotoOnDevice result{state.photo(photo.photo_row).data};
  if (!update.is_due) return result;
  result.weight = 1.0 / double(photos);
  result.photo_gradient = has_rows(photos)
                              ? rows_.data() + i * state.shape.photo_size
                              : gradient_.data() + state.shape.photo_begin(photo.photo_row);
  return result;
}

void PhotometricStage::update(PhotometricState& state, const PhotometricUpdate& update,
                              Span<const TrainingPhoto> batch, const std::uint32_t* halted) {
  if (!update.is_due) return;
  if (has_rows(batch.size)) {
    BatchPlaces places{int(batch.size), {}};
    for (std::size_t i = 0; i < batch.size; ++i)
      places.photo_begin[i] = std::uint32_t(state.shape.photo_begin(batch[i].photo_row));
    const std::size_t threads = state.shape.photo_size;
    GS_CHECK(threads <= 1024);
    const StageScope scope(context_, "photometric");
    context_.launch("photometric", add_rows_kernel, 1, int(threads), places, state.shape,
                    rows_.data(), gradient_.data());
  }
  update_photometric(context_, state, gradient_.span(), update.adam, update.rule, halted);
}

}  // namespace gs::cuda
