// SPDX-License-Identifier: Apache-2.0
// .rad, version 1 (Spark 2): a tree of Gaussians in chunks of at most 65,536, which viewers fetch
// one by one. Axes and units are the PLY's. Numbers are little-endian.
//
//   file    u32 "RAD0", u32 bytes of JSON, JSON, zeros to a multiple of 8, chunks
//           JSON {"version": 1, "type": "gsplat", "count", "maxSh", "lodTree", "chunkSize",
//                 "allChunkBytes", "chunks": [{"offset" from the first chunk, "bytes"}],
//                 "splatEncoding", "comment"}
//   chunk   u32 "RADC", u32 bytes of JSON, JSON, zeros to a multiple of 8, u64 bytes of the
//           properties, properties, each with zeros to a multiple of 8
//           JSON {"version": 1, "base", "count", "payloadBytes", "maxSh", "lodTree",
//                 "splatEncoding", "properties": [{"offset", "bytes", "property", "encoding",
//                 "compression": "gz", "min", "max"}]}
//
// "gz" is DEFLATE without header. A property holds all values of its first number, then all of the
// second, and so on (rad_values.h). We write
//
//   center       f32_lebytes   x y z
//   alpha        f16           opacity, 0..1
//   rgb          f16           0.5 + C0 sh0
//   scales       ln_f16        standard deviations
//   orientation  oct88r8       axis and angle, 3 bytes a Gaussian
//   sh1 sh2 sh3  s8            9, 15, 21 numbers: coefficient by coefficient, red green blue each
//   child_count  u16, and child_start u32: see SplatTree
//
// "splatEncoding" has ranges for viewers that keep these numbers in bytes.
#pragma once

#include <cstdint>
#include <filesystem>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"

namespace gs {

/// Reads the Gaussians without children, which are the model, in any of the encodings of
/// rad_values.h; opacities above 1 become 1. Throws Error, with the file and a remedy, for damaged
/// files, other versions, files whose chunks are files of their own, and palettes of SH.
GaussianModel read_rad(const std::filesystem::path& path);

/// Makes levels of detail of a model that finite_model() made, with at least one Gaussian, and writes
/// their tree. The same model gives the same bytes. Throws Error where this build lacks zlib, and as
/// the sink does.
void write_rad(ByteSink& sink, const GaussianModel& model);

}  // namespace gs
