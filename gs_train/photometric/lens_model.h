// SPDX-License-Identifier: Apache-2.0
// The vignetting of each camera, which the models of photos share: three numbers of a camera, or
// none.
#pragma once

#include <array>

#include "gs_train/photometric/photometric_model.h"

namespace gs {

// A weight in the loss, whose data term is a mean over pixels. Chosen so that it decides only where
// the photos say little.
inline constexpr double kBrightRimWeight = 0.01;

/// The vignetting at the pixels of one photo.
class LensGain {
 public:
  /// `camera` is empty if no vignetting is learned.
  LensGain(Span<const float> camera, const LensPlace& place);
  float rho_at(int x, int y) const { return place_.rho(float(x) + 0.5f, float(y) + 0.5f); }
  /// exp(-B)
  float at(float rho) const {
    return is_learned_ ? gained(1.0f, 0.0f, log_vignetting(b_, rho)) : 1.0f;
  }
  /// Adds the gradient by the three numbers to `sums`.
  void pull_back(float rho, float dL_dB, double* sums) const;

 private:
  LensPlace place_;
  bool is_learned_;
  std::array<float, 3> b_{};
};

/// What all models do with the numbers of cameras.
class LensModel : public PhotometricModel {
 public:
  explicit LensModel(bool has_vignetting) : has_vignetting_(has_vignetting) {}
  std::vector<std::string> camera_names() const override;
  std::map<std::string, float> camera_facts(Span<const float> camera) const override;
  void start_from_lens(const std::array<float, 3>& lens, Span<float> camera) const override;

 protected:
  /// B in the middle of the photo: the scene has the brightness that photos have there.
  double middle_of(const PhotometricState& state, std::size_t photo) const;
  /// The penalty on rims that are brighter than the middle.
  void add_lens_penalty(const PhotometricState& state, std::vector<double>& gradient) const;

 private:
  bool has_vignetting_;
};

}  // namespace gs
