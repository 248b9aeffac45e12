// SPDX-License-Identifier: Apache-2.0
// Words of crate files (.usdc), the binary layers of OpenUSD, for their writer and their reader.
//
//   header    88 bytes: "PXR-USDC", version, where the table of contents begins
//   values    arrays and what does not fit into 48 bits, each at a multiple of 8
//   sections  TOKENS, STRINGS, FIELDS (a name and a value), FIELDSETS (fields of a spec), PATHS (a
//             tree), SPECS (a path, its kind, its fields)
//   contents  u64 sections, then a CrateSection each
//
// Tables of whole numbers are differences of 0, 1, 2 or 4 bytes behind codes of 2 bits, in an LZ4
// block behind a byte 0.
#pragma once

#include <cstdint>
#include <string_view>

namespace gs {

inline constexpr std::string_view kCrateMagic = "PXR-USDC";
inline constexpr std::uint8_t kCrateMinor = 8, kCrateOldestMinor = 7;  // of version 0.x
inline constexpr std::size_t kCrateHeaderBytes = 88;

struct CrateSection {
  char name[16];
  std::int64_t begin, size;
};

/// Kinds of values, as crate files number them.
enum class CrateType : std::uint8_t {
  boolean = 1,
  int32 = 3,
  half = 7,
  float32 = 8,
  float64 = 9,
  string = 10,
  token = 11,
  matrix4d = 15,
  quatd = 16,
  quatf = 17,
  quath = 18,
  vec2f = 20,
  vec3d = 23,
  vec3f = 24,
  vec3h = 25,
  token_list_op = 32,
  token_vector = 41,
  specifier = 42,
  variability = 44
};
/// Kinds of specs.
enum class CrateSpec : std::uint32_t { attribute = 1, prim = 6, root = 7 };

/// A value: 48 bits, which hold it or say where it lies, its type, and what it is.
struct CrateRep {
  static constexpr std::uint64_t kArray = 1ull << 63, kInlined = 1ull << 62,
                                 kCompressed = 1ull << 61;
  std::uint64_t bits = 0;

  bool is(std::uint64_t flag) const { return bits & flag; }
  CrateType type() const { return CrateType(bits >> 48 & 0xff); }
  std::uint64_t payload() const { return bits & 0xffffffffffffull; }
};

}  // namespace gs
