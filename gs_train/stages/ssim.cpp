// SPDX-License-Identifier: Apache-2.0
// Stage 5: the loss "l1_ssim" and its gradient by the picture.
//
//   L = (1 - lambda) mean|X - Y| + lambda (1 - mean SSIM(X, Y))   over 3 H W values; Kerbl et al. 2023, Eq. 7
//
// With the moments m = G * (x, y, xx, yy, xy), G the window, and h = dL/dSSIM at each pixel:
//   dL/dX = G * d_x + 2 X (G * d_xx) + Y (G * d_xy),  (d_x, d_xx, d_xy) = ssim_index_vjp(m, h)
//
// Where a view has a mask or an exposure, X and Y are the two pictures after photo_weight.h. With a
// photometric model X is the picture as the view's appearance shows it.
#include "gs_core/math/loss/ssim.h"

#include "gs_core/error.h"
#include "gs_core/image.h"
#include "gs_core/math/loss/photo_weight.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_train/stages/scalar_stages.h"
#include "gs_train/stages/shown_values.h"
#include "gs_train/stages/window.h"

namespace gs {
namespace {

constexpr std::size_t kRowsAtATime = 8;

class L1SsimLoss final : public Loss {
 public:
  void forward_backward(const RenderPass& pass, const View& view, const LossSettings& settings,
                        Buffer<float>& dL_dimage) override {
    const HostStage stage("loss");
    GS_CHECK(view.photo.width == pass.width && view.photo.height == pass.height);
    width_ = pass.width, height_ = pass.height;
    values_ = 3 * pass.pixel_count();
    const float* X = pass.image.data();
    read_photo(view.photo);
    const bool is_weighted = settings.appearance || view.is_weighted();
    if (is_weighted) X = weighted(view, pass, settings.appearance);
    windowed_moments(X);
    similarity(settings.lambda_dssim);
    image_gradient(X, settings.lambda_dssim, dL_dimage);
    if (is_weighted) pull_back_weights(dL_dimage);
    if (settings.appearance) pull_back(*settings.appearance, pass, view, dL_dimage);
  }
  double value() override { return value_; }

 private:
  // The photo as (3, H, W) in 0..1.
  void read_photo(const Image8& photo) {
    photo_.resize_discard(values_);
    const std::size_t plane = values_ / 3;
    parallel_for(plane, 4096, [&](std::size_t i) {
      for (int c = 0; c < 3; ++c) photo_[c * plane + i] = photo.pixels[3 * i + c] * kPerByte;
    });
  }

  // Returns the weighted picture X' and replaces the photo by what X' is compared with. Leaves
  // the derivative of X' by the shown picture in gains_.
  const float* weighted(const View& view, const RenderPass& pass, const Appearance* appearance) {
    const std::size_t plane = values_ / 3;
    GS_CHECK(view.mask.empty() || view.mask.pixels.size() == plane);
    weighted_.resize_discard(values_);
    gains_.resize_discard(values_);
    const ShownValues shown(view, pass, appearance);
    const float* const X = shown.picture();
    parallel_for(plane, 4096, [&](std::size_t i) {
      const float m = view.mask.empty() ? 1.0f : view.mask.pixels[i] * kPerByte;
      for (int c = 0; c < 3; ++c) {
        const std::size_t value = c * plane + i;
        const PhotoWeight<float> weight = shown.weight(m, c, i);
        gains_[value] = weight.gain;
        weighted_[value] = weight.gain * X[value];
        photo_[value] =
            compared_photo(weighted_[value], weight.cover * photo_[value] + weight.backdrop,
                           photo_[value], shown.white());
      }
    });
    return weighted_.data();
  }

  // Turns dL/dX' into dL/dX.
  void pull_back_weights(Buffer<float>& dL_dimage) {
    parallel_for(values_, 4096, [&](std::size_t i) { dL_dimage[i] *= gains_[i]; });
  }

  // From what the photo shows to the scene's colors. A pixel over the background teaches as much as
  // the photo covers it: the background, which the photo shows as well, depends on the appearance,
  // too, and a pixel that is all background must teach nothing.
  void pull_back(Appearance& appearance, const RenderPass& pass, const View& view,
                 Buffer<float>& dL_dimage) {
    shares_.resize_discard(view.over_background ? pass.pixel_count() : 0);
    for (std::size_t i = 0; i < shares_.size(); ++i) shares_[i] = view.mask.pixels[i] * kPerByte;
    appearance.pull_back({pass.image.data(), width_, height_}, dL_dimage.span(), shares_.span());
  }

  // moments_ holds five stacks of three planes each: x, y, xx, yy, xy.
  void windowed_moments(const float* X) {
    moments_.resize_discard(5 * values_);
    float* const m = moments_.data();
    const float* const Y = photo_.data();
    const std::size_t n = values_;
    parallel_for(n, 4096, [=](std::size_t i) {
      m[i] = X[i];
      m[n + i] = Y[i];
      m[2 * n + i] = X[i] * X[i];
      m[3 * n + i] = Y[i] * Y[i];
      m[4 * n + i] = X[i] * Y[i];
    });
    window_means(moments_.span(), 15, width_, height_, scratch_);
  }

  // Sums SSIM and leaves d_x, d_xx, d_xy in the first three stacks of moments_, windowed.
  void similarity(float lambda_dssim) {
    float* const m = moments_.data();
    const std::size_t n = values_;
    const float dL_dssim = -lambda_dssim / float(n);
    ssim_sum_ = sum_over_rows([=](std::size_t i) {
      const WindowMeans<float> local{m[i], m[n + i], m[2 * n + i], m[3 * n + i], m[4 * n + i]};
      const SsimGradient<float> d = ssim_index_vjp(local, dL_dssim);
      m[i] = d.x;
      m[n + i] = d.xx;
      m[2 * n + i] = d.xy;
      return ssim_index(local);
    });
    window_means({m, 3 * n}, 9, width_, height_, scratch_);
  }

  void image_gradient(const float* X, float lambda_dssim, Buffer<float>& dL_dimage) {
    dL_dimage.resize_discard(values_);
    const std::size_t n = values_;
    const float* const m = moments_.data();
    const float* const Y = photo_.data();
    float* const out = dL_dimage.data();
    const float l1 = (1.0f - lambda_dssim) / float(n);
    const double l1_sum = sum_over_rows([=](std::size_t i) {
      const float difference = X[i] - Y[i];
      const float sign = float(difference > 0.0f) - float(difference < 0.0f);
      out[i] = l1 * sign + m[i] + 2.0f * X[i] * m[n + i] + Y[i] * m[2 * n + i];
      return std::abs(difference);
    });
    value_ =
        (1.0 - lambda_dssim) * l1_sum / double(n) + lambda_dssim * (1.0 - ssim_sum_ / double(n));
  }

  // Sum of f(i) over all values: rows in parallel, then the rows' sums one after the other.
  template <class F>
  double sum_over_rows(F&& f) {
    const std::size_t rows = values_ / width_;
    row_sums_.assign(rows, 0.0);
    parallel_for(rows, kRowsAtATime, [&](std::size_t row) {
      float sum = 0;
      for (std::size_t i = row * width_; i < (row + 1) * width_; ++i) sum += f(i);
      row_sums_[row] = sum;
    });
    double total = 0;
    for (const double sum : row_sums_) total += sum;
    return total;
  }

  int width_ = 0, height_ = 0;
  std::size_t values_ = 0;
  Buffer<float> photo_, weighted_, gains_, moments_, scratch_, shares_;
  std::vector<double> row_sums_;
  double ssim_sum_ = 0, value_ = 0;
};

}  // namespace

std::unique_ptr<Loss> make_l1_ssim_loss() { return std::make_unique<L1SsimLoss>(); }

}  // namespace gs
