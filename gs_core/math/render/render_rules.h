// SPDX-License-Identifier: Apache-2.0
// The published rules among which a render chooses: where a Gaussian ends, which tiles list it, how
// fragments are blended, and in which order. tile_bounds.h, blend.h and ray_depth.h have their
// formulas.
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

/// In which order the fragments of a pixel are blended.
///   z      of the depths of their Gaussians' means, one order for the picture (Kerbl et al. 2023)
///   pixel  of the depths of most weight along its own ray, ray_depth.h (Radl et al. 2024)
enum class RenderOrder : int { z, pixel };

}  // namespace gs
