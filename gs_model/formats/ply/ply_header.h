// SPDX-License-Identifier: Apache-2.0
// The text at the beginning of a PLY file: its elements (tables) and their properties (columns).
// Format: Greg Turk, "The PLY Polygon File Format", 1994.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

inline constexpr std::size_t kLongestPlyHeader = std::size_t(1) << 20;  // bytes; else damaged

enum class PlyFormat { ascii, little_endian, big_endian };
enum class PlyType { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

std::size_t size_of(PlyType type);  // bytes

struct PlyProperty {
  std::string name;
  PlyType type{};
  std::optional<PlyType> count_type;  // lists only: type of the length before the values
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;  // rows, as promised; PlyFile checks it against the file's size
  std::vector<PlyProperty> properties;

  bool has_lists() const;
  /// The index of a property that is no list, or -1.
  int find(std::string_view property) const;
  /// The size of a row; with lists, of the shortest one possible.
  std::uint64_t row_bytes(PlyFormat format) const;
};

struct PlyHeader {
  PlyFormat format{};
  std::vector<std::string> comments;  // without the word "comment"
  std::vector<PlyElement> elements;
  std::size_t bytes = 0, lines = 0;  // its own length

  /// The element of that name, or nullptr.
  const PlyElement* find(std::string_view element) const;
};

/// Parses the header in the first kLongestPlyHeader bytes of a file (fewer if it is shorter); lines
/// end in LF or CRLF. Throws Error that names `path` and the line for anything that is no PLY
/// header.
PlyHeader parse_ply_header(std::string_view beginning, const std::filesystem::path& path);

}  // namespace gs
