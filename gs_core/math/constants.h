// SPDX-License-Identifier: Apache-2.0
// Every constant of the method, once, with its unit and source. Sources: [3DGS] Kerbl et al. 2023,
// [FGS] Faster-GS 2026, [Mip] Yu et al. 2024 (Mip-Splatting), [SSIM] Wang et al. 2004, [MCMC]
// Kheradmand et al. 2024.
#pragma once

namespace gs {
// clang-format off

// Tiles. Width and height are two names even where they are equal.
inline constexpr int kTileWidth = 16;   // pixels [3DGS]
inline constexpr int kTileHeight = 16;  // pixels [3DGS]
inline constexpr int kWideTile = 24;    // pixels, both ways, in large pictures for viewing

inline constexpr int kMaxPictureSide = 65520;  // pixels; rectangles are held in 16 bits

inline constexpr int kDepthKeyBits = 24;  // of the depth sort: three passes of a radix sort by bytes

// Fragments.
inline constexpr float kMinAlpha = 1.0f / 255.0f;       // a fragment below this is not blended [3DGS]
inline constexpr float kMinTransmittance = 1e-4f;       // a pixel below this is finished [3DGS]
inline constexpr float kMaxAlphaClassic = 0.99f;        // upper clamp of the classic rule [3DGS]
inline constexpr float kMinExponent = -80.0f;           // exp(-80) is a normal float; no fragment comes near it
inline constexpr float kMinOneMinusAlpha = 1e-6f;       // guard of the backward residual [FGS]

inline constexpr double kLog2E = 1.4426950408889634;    // log2(e)
inline constexpr double kLn2 = 0.6931471805599453;      // ln(2)

// Projection.
inline constexpr float kBlur = 0.3f;                    // pixels^2 added to the image covariance [3DGS]
inline constexpr float kBlurAntialias = 0.1f;           // pixels^2, with opacity compensation [Mip]
inline constexpr float kFilter3dVariance = 0.2f;        // of the 3D filter, in squared distances between samples [Mip]
inline constexpr float kMostStoredOpacity = 0.999f;     // before the 3D filter, after a reset
inline constexpr float kFrustumMargin = 0.15f;          // of the picture's size: the Jacobian is clamped beyond [3DGS: 1.3 tan]
inline constexpr float kMinCovarianceDeterminant = 1e-6f;  // pixels^4; below it a splat is not rendered [FGS]
inline constexpr float kMaxCovarianceDeterminant = 1e30f;  // pixels^4; above it 1 / det loses its range in float
inline constexpr float kMinQuaternionNorm2 = 1e-8f;     // below it a Gaussian is degenerate [FGS]
inline constexpr double kLeastThickness = 1e-3;         // of a Gaussian's length, in the order by pixel (Radl et al. 2024, code: world units)

// Time.
inline constexpr float kMinMarginal = 0.05f;            // a Gaussian whose opacity is scaled by less is not rendered [FGS]
inline constexpr float kMinTimeVariance = 1e-8f;        // durations^2; below it a velocity would exceed float
inline constexpr float kMaxLogTimeScale = 3.0f;         // a longer life counts as this one: 20 durations

// Spherical harmonics, normalization of the real basis functions.
inline constexpr double kSh0 = 0.28209479177387814;     // 1/2 sqrt(1/pi)
inline constexpr double kSh1 = 0.48860251190291987;     // 1/2 sqrt(3/pi)
inline constexpr double kSh2a = 1.0925484305920792;     // 1/2 sqrt(15/pi)
inline constexpr double kSh2b = 0.94617469575755997;    // 3/4 sqrt(5/pi)
inline constexpr double kSh2c = 0.31539156525251999;    // 1/4 sqrt(5/pi)
inline constexpr double kSh2d = 0.54627421529603959;    // 1/4 sqrt(15/pi)
inline constexpr double kSh3a = 0.59004358992664352;    // 1/4 sqrt(35/(2 pi))
inline constexpr double kSh3b = 1.7701307697799304;     // 3/4 sqrt(35/(2 pi))
inline constexpr double kSh3c = 2.8906114426405538;     // 1/2 sqrt(105/pi)
inline constexpr double kSh3d = 0.45704579946446572;    // 1/4 sqrt(21/(2 pi))
inline constexpr double kSh3e = 2.2852289973223288;     // 5/4 sqrt(21/(2 pi))
inline constexpr double kSh3f = 1.865881662950577;      // 5/4 sqrt(7/pi)
inline constexpr double kSh3g = 1.1195289977703462;     // 3/4 sqrt(7/pi)
inline constexpr double kSh3h = 1.4453057213202769;     // 1/4 sqrt(105/pi)
inline constexpr float kColorOffset = 0.5f;             // color of all-zero coefficients [3DGS]

// Loss.
inline constexpr int kSsimRadius = 5;                   // pixels: an 11x11 window [SSIM]
inline constexpr float kSsimC1 = 1e-4f;                 // (0.01 * 1)^2 [SSIM]
inline constexpr float kSsimC2 = 9e-4f;                 // (0.03 * 1)^2 [SSIM]
inline constexpr float kPhotoWhite = 0.92f;             // display sRGB: photos flatten from here on

// Adam (Kingma & Ba 2015), with the epsilon of [3DGS].
inline constexpr double kAdamBeta1 = 0.9;
inline constexpr double kAdamBeta2 = 0.999;
inline constexpr float kAdamEpsilon = 1e-15f;
inline constexpr int kMostBatch = 8;                    // photos of one update

// Density control.
inline constexpr float kSplitScaleDivisor = 1.6f;       // both halves of a split shrink by it [3DGS]
inline constexpr float kResetOpacity = 0.01f;           // an opacity reset lowers to it [3DGS]
inline constexpr double kMinChildOpacity = 1e-6;        // children are not fainter, so that their logits stay finite

// Density control as a Markov chain.
inline constexpr float kNoiseScale = 5e5f;              // of the noise on a mean, times its learning rate [MCMC, code]
inline constexpr float kNoiseOpacity = 0.005f;          // at which the noise on a mean is halved [MCMC, code]
inline constexpr float kNoiseSteepness = 100.0f;        // of its fall towards opaque Gaussians [MCMC, code]
inline constexpr int kMostCopies = 51;                  // that one Gaussian is shared among, for its new size [MCMC, code]
inline constexpr float kMinShareTransmittance = 0x1p-23f;  // 1 - o of an opaque Gaussian that is shared

// Poses that are refined.
inline constexpr double kSmallAngle2 = 1e-6;            // radians^2, below which a rotation is its series
inline constexpr double kPoseSpreadTurn = 0.00872664625997;  // radians, half a degree: the unit of kPosePull
inline constexpr double kPoseSpreadShift = 0.01;        // of the extent: the same of shifts
inline constexpr double kPosePull = 1e-4;               // weight of the mean squared motion in the loss

// Initialization.
inline constexpr int kInitialNeighbors = 3;            // whose mean distance is the first scale [3DGS]
inline constexpr float kExtentMargin = 1.1f;            // of the farthest camera's distance [3DGS]
inline constexpr float kMinNeighborDistance2 = 1e-7f;  // world units^2 [3DGS]
inline constexpr float kInitialTimeMargin = 0.1f;      // durations that means in time reach beyond the scene's (Yang et al. 2024)

// Morton order.
inline constexpr int kMostTimeHalvings = 9;             // 512 intervals of the Morton order in time
inline constexpr int kMortonBits = 21;                  // per axis, 63 in all [FGS]

// clang-format on
}  // namespace gs
