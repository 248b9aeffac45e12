// SPDX-License-Identifier: Apache-2.0
// Panoramas of 360 degrees train as two halves, and are measured as one picture, too.
#pragma once

#include "gs_eval/metrics.h"

namespace gs {

/// PSNR whose squared errors count as much as their pixels see of the sphere: each row of a panorama
/// has the weight cos(latitude). With a mask of pixels that train, times the mask.
///
///   -10 log10(sum w (x - y)^2 / sum w),  w = cos(((row + 1/2) / height - 1/2) pi)    Sun, Lu and Yu 2017, WS-PSNR
double ws_psnr(const ImageF& render, const View& panorama, const Vec3f& background);

/// The metrics of the whole panorama whose front half this view is, in the scene's own colors.
/// `pass` is scratch.
PanoramaMetrics panorama_metrics(Renderer& renderer, const PackedScene& scene, const View& front,
                                 const RenderSettings& settings, RenderPass& pass);

}  // namespace gs
