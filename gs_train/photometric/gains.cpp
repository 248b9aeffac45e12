// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/gains.h"

#include <array>
#include <cmath>

namespace gs {
namespace {

class GainsAppearance final : public Appearance {
 public:
  explicit GainsAppearance(Span<const float> photo) : Appearance(photo.size) {
    for (std::size_t c = 0; c < 3; ++c) a_[c] = photo[c];
  }

 protected:
  void show_row(int, const ColorRow<const float>& colors,
                const ColorRow<float>& shown) const override {
    const std::array<float, 3> gains = photo_gains();
    for (int x = 0; x < colors.width; ++x)
      for (std::size_t c = 0; c < 3; ++c) shown.channel[c][x] = gains[c] * colors.channel[c][x];
  }

  void pull_back_row(int, const ColorRow<const float>& colors, const ColorRow<float>& gradient,
                     const float* shares, double* sums) const override {
    const std::array<float, 3> gains = photo_gains();
    for (int x = 0; x < colors.width; ++x) {
      const float share = shares ? shares[x] : 1.0f;
      for (std::size_t c = 0; c < 3; ++c) {
        const float shown = gains[c] * colors.channel[c][x];
        const GainedGradient<float> d = gained_vjp(shown, gains[c], gradient.channel[c][x]);
        gradient.channel[c][x] = d.x;
        sums[c] += double(share * d.a);
      }
    }
  }

 private:
  std::array<float, 3> photo_gains() const {
    return {std::exp(a_[0]), std::exp(a_[1]), std::exp(a_[2])};
  }

  std::array<float, 3> a_{};
};

class GainsModel final : public PhotometricModel {
 public:
  std::vector<std::string> photo_names() const override {
    return {"log_gain_red", "log_gain_green", "log_gain_blue"};
  }
  std::unique_ptr<Appearance> appearance(Span<const float> photo) const override {
    return std::make_unique<GainsAppearance>(photo);
  }
  void start_from_gains(const Vec3f& gains, Span<float> photo) const override {
    for (int c = 0; c < 3; ++c) photo[std::size_t(c)] = std::log(gains[c]);
  }
  PhotoPulls pulls(const PhotometricState& state) const override {
    PhotoPulls pulls;
    if (state.is_solved) pulls.fill({kGainPriorWeight / state.rows, kGainPriorSpread});
    return pulls;
  }
};

}  // namespace

std::unique_ptr<PhotometricModel> make_gains_model() { return std::make_unique<GainsModel>(); }

}  // namespace gs
