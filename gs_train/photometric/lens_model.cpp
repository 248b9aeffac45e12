// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/lens_model.h"

#include <cmath>

namespace gs {
namespace {

std::array<double, 3> lens(const PhotometricState& state, std::size_t camera) {
  const Span<float> b = state.camera(camera);
  return {double(b[0]), double(b[1]), double(b[2])};
}

}  // namespace

LensGain::LensGain(Span<const float> camera, const LensPlace& place)
    : place_(place), is_learned_(!camera.empty()) {
  for (std::size_t i = 0; is_learned_ && i < 3; ++i) b_[i] = camera[i];
}

void LensGain::pull_back(float rho, float dL_dB, double* sums) const {
  if (!is_learned_) return;
  const std::array<float, 3> dL_db = log_vignetting_vjp(rho, dL_dB);
  for (std::size_t i = 0; i < 3; ++i) sums[i] += double(dL_db[i]);
}

std::vector<std::string> LensModel::camera_names() const {
  if (!has_vignetting_) return {};
  return {"log_vignetting_1", "log_vignetting_2", "log_vignetting_3"};
}

std::map<std::string, float> LensModel::camera_facts(Span<const float> b) const {
  if (!has_vignetting_) return {};
  const std::array<float, 3> all{b[0], b[1], b[2]};
  return {{"corner_brightness", std::exp(log_vignetting(all, 0.0f) - log_vignetting(all, 1.0f))}};
}

void LensModel::start_from_lens(const std::array<float, 3>& from, Span<float> camera) const {
  for (std::size_t i = 0; i < camera.size; ++i) camera[i] = from[i];
}

double LensModel::middle_of(const PhotometricState& state, std::size_t photo) const {
  return has_vignetting_ ? log_vignetting(lens(state, state.camera_of[photo]), 0.0) : 0.0;
}

void LensModel::add_lens_penalty(const PhotometricState& state,
                                 std::vector<double>& gradient) const {
  for (std::size_t k = 0; has_vignetting_ && k < state.shape.cameras; ++k) {
    const std::array<double, 3> more = bright_rim_vjp(lens(state, k), kBrightRimWeight);
    for (std::size_t i = 0; i < 3; ++i) gradient[state.shape.camera_begin(k) + i] += more[i];
  }
}

}  // namespace gs
