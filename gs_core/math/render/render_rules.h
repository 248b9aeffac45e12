// SPDX-License-Identifier: Apache-2.0
// The published rules among which a render chooses: where a Gaussian ends, which tiles list it, how
// fragments are blended. tile_bounds.h and blend.h have their formulas.
#pragma once

namespace gs {

/// Where a Gaussian ends. `alpha`: where alpha falls below 1/255, so that faint Gaussians are
/// small. The others: at that many standard deviations, whatever the opacity.
enum class Truncation : int { alpha, sigma2, sigma3, sigma4 };

/// Which tiles list a splat: those that it hits; all of its bounding box; or all of a square of
/// three standard deviations along its longer axis, whatever the opacity (Kerbl et al. 2023, code),
/// which cuts off a little.
enum class TileBounds : int { exact, box, square };

/// Which of the two published rules blends the fragments of a pixel.
///   faster_gs  no upper clamp of alpha; a pixel ends after the fragment that brings T below 1e-4
///   classic    alpha at most 0.99; a pixel ends before that fragment (Kerbl et al. 2023, code)
enum class BlendRule : int { faster_gs, classic };

}  // namespace gs
