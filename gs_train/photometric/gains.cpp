// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/gains.h"

#include <array>
#include <cmath>

#include "gs_train/photometric/lens_model.h"

namespace gs {
namespace {

class GainsAppearance final : public Appearance {
 public:
  GainsAppearance(Span<const float> photo, Span<const float> camera, const LensPlace& place)
      : Appearance(photo.size + camera.size), lens_(camera, place) {
    for (std::size_t c = 0; c < 3; ++c) a_[c] = photo[c];
  }

 protected:
  void show_row(int y, const ColorRow<const float>& colors,
                const ColorRow<float>& shown) const override {
    const std::array<float, 3> e = photo_gains();
    for (int x = 0; x < colors.width; ++x) {
      const float lens = lens_.at(lens_.rho_at(x, y));
      for (std::size_t c = 0; c < 3; ++c) shown.channel[c][x] = e[c] * lens * colors.channel[c][x];
    }
  }

  void pull_back_row(int y, const ColorRow<const float>& colors, const ColorRow<float>& gradient,
                     const float* shares, double* sums) const override {
    const std::array<float, 3> e = photo_gains();
    for (int x = 0; x < colors.width; ++x) {
      const float rho = lens_.rho_at(x, y), lens = lens_.at(rho), share = shares ? shares[x] : 1.0f;
      float dL_dB = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const float gain = e[c] * lens, shown = gain * colors.channel[c][x];
        const GainedGradient<float> d = gained_vjp(shown, gain, gradient.channel[c][x]);
        gradient.channel[c][x] = d.x;
        sums[c] += double(share * d.a);
        dL_dB += share * d.B;
      }
      lens_.pull_back(rho, dL_dB, sums + 3);
    }
  }

 private:
  std::array<float, 3> photo_gains() const {
    return {std::exp(a_[0]), std::exp(a_[1]), std::exp(a_[2])};
  }

  LensGain lens_;
  std::array<float, 3> a_{};
};

class GainsModel final : public LensModel {
 public:
  using LensModel::LensModel;
  std::string name() const override { return kGainsModel; }
  std::vector<std::string> photo_names() const override {
    return {"log_gain_red", "log_gain_green", "log_gain_blue"};
  }
  std::unique_ptr<Appearance> appearance(Span<const float> photo, Span<const float> camera,
                                         const LensPlace& place) const override {
    return std::make_unique<GainsAppearance>(photo, camera, place);
  }
  void start_from_gains(const Vec3f& gains, Span<float> photo) const override {
    for (int c = 0; c < 3; ++c) photo[std::size_t(c)] = std::log(gains[c]);
  }
  // The scene has the brightness of the middle of the photos, where lenses do not darken.
  std::vector<double> common_part(const PhotometricState& state) const override {
    std::vector<double> sum(3, 0.0);
    for (std::size_t i = 0; i < state.shape.photos; ++i) {
      const double middle = middle_of(state, i);
      for (std::size_t c = 0; c < 3; ++c) sum[c] += double(state.photo(i)[c]) - middle;
    }
    for (double& number : sum) number /= double(state.shape.photos);
    return sum;
  }
  void add_penalties(const PhotometricState& state, std::vector<double>& gradient) const override {
    const PhotometricShape& shape = state.shape;
    const std::size_t gains = shape.camera_begin(0);
    for (std::size_t i = 0; state.is_solved && i < gains; ++i)
      gradient[i] += gain_prior_vjp(double(state.values[i]), double(state.start[i]),
                                    kGainPriorWeight / shape.photos, kGainPriorSpread);
    add_lens_penalty(state, gradient);
  }
};

}  // namespace

std::unique_ptr<PhotometricModel> make_gains_model(const PhotometricConfig& config) {
  return std::make_unique<GainsModel>(config.vignetting);
}

}  // namespace gs
