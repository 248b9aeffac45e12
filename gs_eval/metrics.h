// SPDX-License-Identifier: Apache-2.0
// PSNR and SSIM against photos as the papers compute them: on pictures clamped to [0, 1], as a mean
// over pixels and channels; SSIM with the 11x11 Gaussian window of sigma 1.5 and zero padding. The
// slower FLIP and LPIPS are in flip/ and lpips/.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/image.h"
#include "gs_core/scene.h"
#include "gs_eval/looks/scene_looks.h"
#include "gs_render/renderer.h"

namespace gs {

class Lpips;

/// Peak signal-to-noise ratio in dB of pictures of the same size, `render` in [0, 1]. Identical
/// pictures have 100 dB.
double psnr(const ImageF& render, const Image8& photo);

/// Mean structural similarity (Wang et al. 2004).
double ssim(const ImageF& render, const Image8& photo);

/// FLIP (flip/flip.h). It takes several times as long as the others, so that it is measured at the
/// end of a run alone.
struct PerceptualMetrics {
  double flip = 0;
  std::optional<double> lpips{};  // with a network alone
};
PerceptualMetrics perceptual_metrics(const ImageF& render, const Image8& photo);

/// The metrics of a view with a mask or an exposure, in front of this background. The render is
/// multiplied by the view's exposure and clamped again. A mask of pixels that train removes all
/// others from the metrics:
///   psnr  the mean of the squared error is weighted by the mask
///   ssim  both pictures are multiplied by the mask, as in the loss; the mean is over pixels with
///         a mask above 0
///   others  both pictures are multiplied by the mask; pixels of FLIP and places of LPIPS count as
///         much as the mask there
/// A mask of what the photo covers composes the photo over the background, and every pixel counts.
/// At least one pixel of the view trains.
double psnr(const ImageF& render, const View& view, const Vec3f& background);
double ssim(const ImageF& render, const View& view, const Vec3f& background);
PerceptualMetrics perceptual_metrics(const ImageF& render, const View& view,
                                     const Vec3f& background);

/// The photo to show beside renders. With a mask of what it covers, it is composed over the
/// background.
Image8 shown_photo(const View& view, const Vec3f& background);

/// PSNR and SSIM of one form of a picture.
struct PictureMetrics {
  double psnr = 0, ssim = 0;
};

/// Of a panorama as one picture, with WS-PSNR (panorama_metrics.h).
struct PanoramaMetrics : PictureMetrics {
  double ws_psnr = 0;
};

struct ViewMetrics {
  std::string name;
  double psnr, ssim;
  double psnr_exposure = psnr, ssim_exposure = ssim;  // of the picture under the view's exposure
  float time = 0;                                     // of the view (PinholeCamera::time)
  /// Where they were asked for; the second of the picture under the view's exposure.
  std::optional<PerceptualMetrics> perceptual{}, perceptual_exposure{};
  /// Where they were asked for: of the picture as a photometric model shows it, and of the picture
  /// whose colors were fitted to the photo (metrics/color_correction.h).
  std::optional<PictureMetrics> photometric{}, corrected{};
  std::optional<PanoramaMetrics> panorama{};  // with FLIP: of the front halves of panoramas
  std::optional<double> depth_error{};        // of views with a depth map (metrics/depth_error.h)
};

/// The network of LPIPS, as results tell it.
struct LpipsSource {
  std::string file, network, hash;  // the latter two as in Lpips
};

/// Means over views, and the metrics of each view.
struct Evaluation {
  double psnr = 0, ssim = 0;                    // 0 when there are no views
  double psnr_exposure = 0, ssim_exposure = 0;  // of pictures under their views' exposures
  bool has_exposures = false;                   // true where the exposure of any view is not 1
  std::vector<ViewMetrics> views;
  std::optional<PerceptualMetrics> perceptual, perceptual_exposure;  // as in ViewMetrics
  std::optional<PictureMetrics> photometric, corrected;              // the same
  std::optional<PanoramaMetrics> panorama;                           // mean over the panoramas
  std::optional<double> depth_error;        // mean over the views that have one
  std::optional<double> normal_angle;       // degrees (normal_angle.h)
  std::optional<LpipsSource> lpips_source;  // where LPIPS was measured
};

/// What evaluate() measures besides PSNR and SSIM.
struct MetricSet {
  bool is_perceptual = false;  // FLIP
  Lpips* lpips = nullptr;      // with them, where it is not null

  static const MetricSet quick, all;  // the latter without LPIPS
};
inline const MetricSet MetricSet::quick{}, MetricSet::all{true};

/// What to measure besides PSNR and SSIM.
struct EvaluationOptions {
  MetricSet metrics = MetricSet::quick;
  AppearanceOf appearance_of = {};  // of a photometric model; measured where it gives one
  // The appearance under exposures that were solved for; measured in place of the view's exposure
  // alone
  AppearanceOf solved_appearance_of = {};
  bool is_corrected = false;  // measure the picture with fitted colors, too

  EvaluationOptions(MetricSet set = MetricSet::quick) : metrics(set) {}
};

/// Renders each view and compares it with its photo, without and with the view's exposure. Views
/// that are masked everywhere are not counted. `on_view` (may be empty) is called in order with
/// each picture, without exposure, and its view with the photo loaded.
Evaluation evaluate(
    Renderer& renderer, const GaussiansSpan& gaussians, const std::vector<View>& views,
    const RenderSettings& settings,
    const std::function<void(std::size_t, const View&, const ImageF&)>& on_view = {},
    const EvaluationOptions& options = {});
/// Evaluates a model that was packed for viewing (Renderer::pack).
Evaluation evaluate(
    Renderer& renderer, const PackedScene& scene, const std::vector<View>& views,
    const RenderSettings& settings,
    const std::function<void(std::size_t, const View&, const ImageF&)>& on_view = {},
    const EvaluationOptions& options = {});

}  // namespace gs
