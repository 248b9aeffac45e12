// SPDX-License-Identifier: Apache-2.0
// OpenUSD 26.03: a stage with a prim of type ParticleField3DGaussianSplat (usdVol), as text (.usda),
// as bytes (.usdc: crate.h), or as bytes in a package (.usdz).
//
//   /Scene                        Xform, the default prim; metersPerUnit 1, upAxis "Y"
//   /Scene/Gaussians              ParticleField3DGaussianSplat
//     positions                       point3f[]     half a turn about z: y up
//     orientations                    quatf[]       w x y z, turned, too; of length 1
//     scales                          float3[]      standard deviations, world units
//     opacities                       float[]       0..1
//     radiance:sphericalHarmonicsDegree, radiance:sphericalHarmonicsCoefficients
//                                     float3[]      a Gaussian's (degree + 1)^2 behind each other
//     extent                          float3[2]     of all Gaussians up to 3 standard deviations
//     projectionModeHint, sortingModeHint           as gemsplat trains: "perspective", "zDepth"
//     colorSpace:name                 token         colors are those of a display
//     gemsplat:antialiased            bool          only where it is so; ours, as is the next one
//     gemsplat:worldOffset            double3       only where it is not 0, in the PLY's axes
//   /Scene/Cameras/view_I_NAME    Camera, one for each view that the writer knows
//
// A package is a zip of one layer, which is stored so that its bytes begin at a multiple of 64.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"

namespace gs {

/// A view that a file shows the model from. Cameras with a lens are left out of files.
struct NamedView {
  std::string name;
  Camera camera;  // in the frame of the model
};

/// Reads the one prim of Gaussians of a layer, or of the layers in a .usdz. Floats or halfs are
/// read; what is missing or too short has the schema's defaults. A turn, an even scale and a shift
/// of its parents and an upAxis of "Z" are applied. Throws Error, with the file, the line of a
/// text and a remedy, for damaged files, linear colors, several prims of Gaussians, numbers that change in
/// time, other transforms, and stages without Gaussians.
GaussianModel read_usd(const std::filesystem::path& path);

/// Write a model that finite_model() made, with at least one Gaussian, and views. Throw as the sink
/// does, and a package of more than 4 GiB is an Error.
void write_usda(ByteSink& sink, const GaussianModel& model, const std::vector<NamedView>& views);
void write_usdc(ByteSink& sink, const GaussianModel& model, const std::vector<NamedView>& views);
void write_usdz(ByteSink& sink, const GaussianModel& model, const std::vector<NamedView>& views);

}  // namespace gs
