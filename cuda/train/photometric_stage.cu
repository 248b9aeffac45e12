// SPDX-License-Identifier: Apache-2.0
#include "cuda/train/photometric_stage.cuh"

#include "gs_train/named_row.h"
#include "gs_train/photometric/gains.h"
#include "gs_train/photometric/ppisp.h"

namespace gs::cuda {
namespace {

struct PhotometricRow {
  const char* name;  // a word of photometric.model
  DeviceLook look;
};
constexpr PhotometricRow kPhotometricModels[] = {{kGainsModel, DeviceLook::gains},
                                                 {kPpispModel, DeviceLook::ppisp}};

// Where the photos of a batch have their numbers in the gradient of all.
struct BatchPlaces {
  int photos;
  std::uint32_t photo_begin[kMostBatch], camera_begin[kMostBatch];
};

// gradient += the rows of all photos, one photo after another, and clears the rows. A thread has
// one number of each row.
__global__ void add_rows_kernel(const __grid_constant__ BatchPlaces places, PhotometricShape shape,
                                double* rows, double* gradient) {
  const std::uint32_t number = threadIdx.x, in_row = shape.photo_size + shape.camera_size;
  if (number >= in_row) return;
  for (int i = 0; i < places.photos; ++i) {
    double& of_photo = rows[std::size_t(i) * in_row + number];
    const std::uint32_t to = number < shape.photo_size
                                 ? places.photo_begin[i] + number
                                 : places.camera_begin[i] + (number - shape.photo_size);
    gradient[to] += of_photo;
    of_photo = 0;
  }
}

}  // namespace

void PhotometricStage::use(const PhotometricModel* model, const std::string& device) {
  look_ = std::nullopt;
  if (!model) return;
  look_ = row_named(kPhotometricModels, model->name(), "photometric.model", " on " + device)->look;
}

PhotometricUpdate PhotometricStage::update_of(const PhotometricState& state,
                                              const Update& update) const {
  if (!look_ || !(update.photometric_rate > 0)) return {};
  const AdamRule& rule = update.photo_rule;
  return {true, adam_step(state.adam_steps + rule.steps, update.photometric_rate, rule.photo_beta2),
          rule};
}

void PhotometricStage::begin(const PhotometricState& state, std::size_t photos) {
  if (!look_) return;
  GS_CHECK(!state.empty());
  const std::size_t numbers = has_rows(photos) ? photos * row_size(state.shape) : 0;
  if (gradient_.size() != state.shape.size()) {
    gradient_.resize_discard(state.shape.size());
    gradient_.fill_zero();
  }
  if (rows_.size() < numbers) {
    rows_.resize_discard(numbers);
    rows_.fill_zero();
  }
  if (camera_of_on_host_ == state.camera_of) return;
  camera_of_on_host_.clear();  // if the upload throws
  camera_of_.upload(state.camera_of);
  camera_of_on_host_ = state.camera_of;
}

PhotoOnDevice PhotometricStage::photo(const PhotometricState& state,
                                      const PhotometricUpdate& update, const TrainingPhoto& photo,
                                      const Camera& camera, std::size_t i,
                                      std::size_t photos) const {
  const PhotometricShape& shape = state.shape;
  const Camera& whole = photo.view->camera;
  PhotoOnDevice result{
      state.photo(photo.photo_row).data,
      shape.camera_size ? state.camera(photo.camera_row).data : nullptr,
      lens_place(camera.cx, camera.cy, whole.width, whole.height, photo.reduction)};
  result.look = *look_;
  if (!update.is_due) return result;
  result.weight = 1.0 / double(photos);
  if (has_rows(photos)) {
    result.photo_gradient = row_of(state, update, i, photos).data;
    result.camera_gradient = result.photo_gradient + shape.photo_size;
  } else {
    result.photo_gradient = gradient_.data() + shape.photo_begin(photo.photo_row);
    result.camera_gradient = gradient_.data() + shape.camera_begin(photo.camera_row);
  }
  return result;
}

Span<double> PhotometricStage::row_of(const PhotometricState& state,
                                      const PhotometricUpdate& update, std::size_t i,
                                      std::size_t photos) const {
  if (!update.is_due || !has_rows(photos)) return {};
  return {rows_.data() + i * row_size(state.shape), row_size(state.shape)};
}

void PhotometricStage::update(PhotometricState& state, const PhotometricUpdate& update,
                              Span<const TrainingPhoto> batch, const std::uint32_t* halted) {
  if (!update.is_due) return;
  if (has_rows(batch.size)) {
    BatchPlaces places{int(batch.size), {}, {}};
    for (std::size_t i = 0; i < batch.size; ++i) {
      places.photo_begin[i] = std::uint32_t(state.shape.photo_begin(batch[i].photo_row));
      places.camera_begin[i] = std::uint32_t(state.shape.camera_begin(batch[i].camera_row));
    }
    const std::size_t threads = row_size(state.shape);
    GS_CHECK(threads <= 1024);
    const StageScope scope(context_, "photometric");
    context_.launch("photometric", add_rows_kernel, 1, int(threads), places, state.shape,
                    rows_.data(), gradient_.data());
  }
  update_photometric(context_, *look_, state, camera_of_.span(), gradient_.span(), update.adam,
                     update.rule, halted);
}

}  // namespace gs::cuda
