// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/gains.h"

#include <array>
#include <cmath>

namespace gs {
namespace {

class GainsAppearance final : public Appearance {
 public:
  GainsAppearance(Span<const float> photo, Span<const float> camera, const LensPlace& place)
      : Appearance(photo.size + camera.size), place_(place), has_vignetting_(!camera.empty()) {
    for (std::size_t c = 0; c < 3; ++c) a_[c] = photo[c];
    if (has_vignetting_)
      for (std::size_t i = 0; i < 3; ++i) b_[i] = camera[i];
  }

 protected:
  void show_row(int y, const ColorRow<const float>& colors,
                const ColorRow<float>& shown) const override {
    const std::array<float, 3> e = photo_gains();
    for (int x = 0; x < colors.width; ++x) {
      const float lens = lens_gain(rho_at(x, y));
      for (std::size_t c = 0; c < 3; ++c) shown.channel[c][x] = e[c] * lens * colors.channel[c][x];
    }
  }

  void pull_back_row(int y, const ColorRow<const float>& colors, const ColorRow<float>& gradient,
                     const float* shares, double* sums) const override {
    const std::array<float, 3> e = photo_gains();
    for (int x = 0; x < colors.width; ++x) {
      const float rho = rho_at(x, y), lens = lens_gain(rho), share = shares ? shares[x] : 1.0f;
      float dL_dB = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const float gain = e[c] * lens, shown = gain * colors.channel[c][x];
        const GainedGradient<float> d = gained_vjp(shown, gain, gradient.channel[c][x]);
        gradient.channel[c][x] = d.x;
        sums[c] += double(share * d.a);
        dL_dB += share * d.B;
      }
      if (!has_vignetting_) continue;
      const std::array<float, 3> dL_db = log_vignetting_vjp(rho, dL_dB);
      for (std::size_t i = 0; i < 3; ++i) sums[3 + i] += double(dL_db[i]);
    }
  }

 private:
  float rho_at(int x, int y) const { return place_.rho(float(x) + 0.5f, float(y) + 0.5f); }
  float lens_gain(float rho) const {
    return has_vignetting_ ? gained(1.0f, 0.0f, log_vignetting(b_, rho)) : 1.0f;
  }
  std::array<float, 3> photo_gains() const {
    return {std::exp(a_[0]), std::exp(a_[1]), std::exp(a_[2])};
  }

  LensPlace place_;
  bool has_vignetting_;
  std::array<float, 3> a_{}, b_{};
};

class GainsModel final : public PhotometricModel {
 public:
  explicit GainsModel(bool has_vignetting) : has_vignetting_(has_vignetting) {}
  std::string name() const override { return kGainsModel; }
  std::vector<std::string> photo_names() const override {
    return {"log_gain_red", "log_gain_green", "log_gain_blue"};
  }
  std::vector<std::string> camera_names() const override {
    if (!has_vignetting_) return {};
    return {"log_vignetting_1", "log_vignetting_2", "log_vignetting_3"};
  }
  std::map<std::string, float> camera_facts(Span<const float> b) const override {
    if (!has_vignetting_) return {};
    const std::array<float, 3> all{b[0], b[1], b[2]};
    return {{"corner_brightness", std::exp(log_vignetting(all, 0.0f) - log_vignetting(all, 1.0f))}};
  }
  std::unique_ptr<Appearance> appearance(Span<const float> photo, Span<const float> camera,
                                         const LensPlace& place) const override {
    return std::make_unique<GainsAppearance>(photo, camera, place);
  }
  void start_from_gains(const Vec3f& gains, Span<float> photo) const override {
    for (int c = 0; c < 3; ++c) photo[std::size_t(c)] = std::log(gains[c]);
  }
  void start_from_lens(const std::array<float, 3>& lens, Span<float> camera) const override {
    for (std::size_t i = 0; i < camera.size; ++i) camera[i] = lens[i];
  }
  // The scene has the brightness of the middle of the photos, where lenses do not darken.
  std::vector<double> common_part(const PhotometricState& state) const override {
    std::vector<double> sum(3, 0.0);
    for (std::size_t i = 0; i < state.shape.photos; ++i) {
      const double middle =
          has_vignetting_ ? log_vignetting(lens(state, state.camera_of[i]), 0.0) : 0.0;
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
    for (std::size_t k = 0; has_vignetting_ && k < shape.cameras; ++k) {
      const std::array<double, 3> more = bright_rim_vjp(lens(state, k), kBrightRimWeight);
      for (std::size_t i = 0; i < 3; ++i) gradient[shape.camera_begin(k) + i] += more[i];
    }
  }

 private:
  static std::array<double, 3> lens(const PhotometricState& state, std::size_t camera) {
    const Span<float> b = state.camera(camera);
    return {double(b[0]), double(b[1]), double(b[2])};
  }

  bool has_vignetting_;
};

}  // namespace

std::unique_ptr<PhotometricModel> make_gains_model(const PhotometricConfig& config) {
  return std::make_unique<GainsModel>(config.vignetting);
}

}  // namespace gs
