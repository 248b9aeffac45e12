// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/ppisp.h"

#include <array>
#include <cmath>
#include <numbers>

#include "gs_train/photometric/lens_model.h"

namespace gs {
namespace {

class PpispAppearance final : public Appearance {
 public:
  PpispAppearance(Span<const float> photo, Span<const float> camera, const LensPlace& place)
      : Appearance(photo.size + camera.size), lens_(camera, place), exposure_(std::exp2(photo[0])) {
    ColorLatents<float> latents;
    for (std::size_t i = 0; i < kPpispLatents; ++i) latents[i] = photo[1 + i];
    matrix_ = color_matrix(latents);
  }

 protected:
  void show_row(int y, const ColorRow<const float>& colors,
                const ColorRow<float>& shown) const override {
    for (int x = 0; x < colors.width; ++x)
      put(shown, x,
          exposure_ * lens_.at(lens_.rho_at(x, y)) * recolored(matrix_, color_of(colors, x)));
  }

  void pull_back_row(int y, const ColorRow<const float>& colors, const ColorRow<float>& gradient,
                     const float* shares, double* sums) const override {
    RecoloredSums<double> of_row;
    for (int x = 0; x < colors.width; ++x) {
      const float rho = lens_.rho_at(x, y), gain = exposure_ * lens_.at(rho),
                  share = shares ? shares[x] : 1.0f;
      const Vec3f color = color_of(colors, x), dL_dshown = color_of(gradient, x);
      const float dL_dlog = share * inner(dL_dshown, gain * recolored(matrix_, color));
      RecoloredSums<float> of_pixel;
      put(gradient, x, recolored_vjp(matrix_, color, gain * dL_dshown, share, of_pixel));
      add(of_pixel, of_row);
      sums[0] += std::numbers::ln2 * double(dL_dlog);
      lens_.pull_back(rho, -dL_dlog, sums + kPpispNumbers);
    }
    const ColorLatents<double> dL_dlatents = color_matrix_vjp(in_double(matrix_), of_row);
    for (std::size_t i = 0; i < kPpispLatents; ++i) sums[1 + i] += dL_dlatents[i];
  }

 private:
  template <class T>
  static Vec3f color_of(const ColorRow<T>& row, int x) {
    return {row.channel[0][x], row.channel[1][x], row.channel[2][x]};
  }
  static void put(const ColorRow<float>& row, int x, const Vec3f& color) {
    for (int c = 0; c < 3; ++c) row.channel[c][x] = color[c];
  }
  static ColorMatrix<double> in_double(const ColorMatrix<float>& matrix) {
    return {{Vec3d(matrix.M.row0), Vec3d(matrix.M.row1), Vec3d(matrix.M.row2)},
            Vec3d(matrix.k),
            Vec3d(matrix.unlimited_k)};
  }
  static void add(const RecoloredSums<float>& from, RecoloredSums<double>& to) {
    to.M.row0 += Vec3d(from.M.row0);
    to.M.row1 += Vec3d(from.M.row1);
    to.M.row2 += Vec3d(from.M.row2);
    to.k += Vec3d(from.k);
  }

  LensGain lens_;
  float exposure_;  // 2^t
  ColorMatrix<float> matrix_;
};

class PpispModel final : public LensModel {
 public:
  using LensModel::LensModel;
  std::string name() const override { return kPpispModel; }
  std::vector<std::string> photo_names() const override {
    return {"exposure_stops", "blue_1",  "blue_2",  "red_1",  "red_2",
            "green_1",        "green_2", "white_1", "white_2"};
  }
  std::unique_ptr<Appearance> appearance(Span<const float> photo, Span<const float> camera,
                                         const LensPlace& place) const override {
    return std::make_unique<PpispAppearance>(photo, camera, place);
  }
  // A gray surface looks as under the gains; other colors keep their sums.
  void start_from_gains(const Vec3f& gains, Span<float> photo) const override {
    photo[0] = std::log2((gains.x + gains.y + gains.z) / 3);
    const ColorLatents<float> latents = latents_of_gains(gains);
    for (std::size_t i = 0; i < kPpispLatents; ++i) photo[1 + i] = latents[i];
  }
  // The scene has the brightness of the middle of the photos, and their mean colors.
  std::vector<double> common_part(const PhotometricState& state) const override {
    std::vector<double> sum(kPpispNumbers, 0.0);
    for (std::size_t i = 0; i < state.shape.photos; ++i) {
      sum[0] -= middle_of(state, i) / std::numbers::ln2;
      for (std::size_t k = 0; k < kPpispNumbers; ++k) sum[k] += double(state.photo(i)[k]);
    }
    for (double& number : sum) number /= double(state.shape.photos);
    return sum;
  }
  void add_penalties(const PhotometricState& state, std::vector<double>& gradient) const override {
    const PhotometricShape& shape = state.shape;
    for (std::size_t i = 0; state.is_solved && i < shape.camera_begin(0); ++i)
      gradient[i] += gain_prior_vjp(
          double(state.values[i]), double(state.start[i]), kGainPriorWeight / shape.photos,
          i % kPpispNumbers == 0 ? kPpispExposureSpread : kPpispLatentSpread);
    add_lens_penalty(state, gradient);
  }
};

}  // namespace

std::unique_ptr<PhotometricModel> make_ppisp_model(const PhotometricConfig& config) {
  return std::make_unique<PpispModel>(config.vignetting);
}

}  // namespace gs
