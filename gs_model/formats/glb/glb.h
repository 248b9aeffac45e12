// SPDX-License-Identifier: Apache-2.0
// Binary glTF 2.0 with the extension KHR_gaussian_splatting: a mesh of points with the attributes
// of Gaussians after activation. Viewers without the extension show colored points.
//
//   POSITION                                    float x y z    half a turn about z: y up
//   COLOR_0                                     u8 r g b a     linear; without the extension
//   KHR_gaussian_splatting:ROTATION             float x y z w  turned, too; of length 1
//   KHR_gaussian_splatting:SCALE                float x y z    standard deviations, world units
//   KHR_gaussian_splatting:OPACITY              float          0..1
//   KHR_gaussian_splatting:SH_DEGREE_d_COEF_k   float r g b    turned, too
//
// A world offset that is not 0 stands in the node's extras as "world_offset", in the PLY's axes:
// viewers would lose precision if it were in the positions or in the node's matrix.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"

namespace gs {

// Words of the file, for its writer and its reader.
inline constexpr const char* kGlbGaussians = "KHR_gaussian_splatting";
inline constexpr std::uint32_t kGlbMagic = 0x46546C67, kGlbVersion = 2;         // "glTF"
inline constexpr std::uint32_t kGlbJson = 0x4E4F534A, kGlbBinary = 0x004E4942;  // "JSON", "BIN"

/// All of a file before its binary chunk, which has so many bytes, a multiple of 4.
std::string glb_head(std::string json, std::uint64_t binary_bytes);

/// Display sRGB to linear light, as COLOR_0 has it; both 0..1.   IEC 61966-2-1
float linear_of(float srgb);
/// Its inverse.
float srgb_of(float linear);

/// Reads a file with one primitive of Gaussians, whose attributes are as above and which no node
/// moves; rotations, scales and opacities may be of bytes and of 16 bits, as the extension permits. Throws Error, with the file and a remedy, for damaged files, linear colors, compressed
/// Gaussians, several primitives, nodes that move, and files of triangles alone.
GaussianModel read_glb(const std::filesystem::path& path);

/// Writes a model that finite_model() made, with at least one Gaussian. Throws Error for a file of
/// more than 4 GiB, and as the sink does.
void write_glb(ByteSink& sink, const GaussianModel& model);

}  // namespace gs
