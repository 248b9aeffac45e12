// SPDX-License-Identifier: Apache-2.0
// PSNR and SSIM against photos, as the papers compute them: on pictures clamped to [0, 1], mean over pixels
// and channels, SSIM with the 11x11 Gaussian window of sigma 1.5 and zero padding.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "gs_core/image.h"
#include "gs_core/scene.h"
#include "gs_render/renderer.h"

namespace gs {

/// Peak signal-to-noise ratio in dB; `render` in [0, 1], same size. Identical pictures: 100 dB.
double psnr(const ImageF& render, const Image8& photo);

/// Mean structural similarity (Wang et al. 2004).
double ssim(const ImageF& render, const Image8& photo);

/// The same of a view with a mask or an exposure: of pictures on this background. Its exposure is given to the render
/// first, which is clamped after it. Where the mask says what trains, nothing else counts:
///   psnr  the mean of the squared error is weighted by the mask
///   ssim  the mean is that over pixels with a mask above 0, of both pictures multiplied by the mask, as in the loss
/// Where it says what the photo covers, the photo is put over the background, and every pixel counts. The view has a pixel
/// that trains.
double psnr(const ImageF& render, const View& view, const Vec3f& background);
double ssim(const ImageF& render, const View& view, const Vec3f& background);

/// The photo to show beside renders: over the background, where its mask says what it covers.
Image8 shown_photo(const View& view, const Vec3f& background);

struct ViewMetrics {
  std::string name;
  double psnr, ssim;
  double psnr_exposure = psnr, ssim_exposure = ssim;  // of the picture under the view's exposure
};

/// Means over views, and each view's own figures.
struct Evaluation {
  double psnr = 0, ssim = 0;  // 0 when there are no views
  double psnr_exposure = 0, ssim_exposure = 0;  // of pictures under their views' exposures
  bool has_exposures = false;                   // some view's exposure is not 1
  std::vector<ViewMetrics> views;
};

/// Renders each view and compares it with its photo: as it is, and under the view's exposure. Views that are masked
/// everywhere count nowhere. `on_view` (may be empty) sees each picture, without exposure, and the view with its photo,
/// in order.
Evaluation evaluate(
    Renderer& renderer, const GaussiansSpan& gaussians, const std::vector<View>& views,
    const RenderSettings& settings,
    const std::function<void(std::size_t, const View&, const ImageF&)>& on_view = {});

}  // namespace gs
