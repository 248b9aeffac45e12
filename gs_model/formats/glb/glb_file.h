// SPDX-License-Identifier: Apache-2.0
// A .glb as a container: its JSON, its binary chunk, and the numbers of attributes. Every number of
// the JSON is checked before it is used as an index or a size.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string_view>

#include "gs_core/system/text/json.h"
#include "gs_core/types.h"

namespace gs {

/// A file's JSON and its binary chunk. What is missing or of another kind is an Error with the file
/// and a remedy. Path and bytes must outlive it.
class GlbFile {
 public:
  GlbFile(const std::filesystem::path& path, std::string_view bytes);

  const std::filesystem::path& path() const { return path_; }
  const SortedJson& document() const { return document_; }
  std::uint64_t bytes() const { return bytes_; }

  /// An element of one of the document's lists.
  const SortedJson& item(const char* list, std::uint64_t index) const;
  /// How many elements a list has; 0 where there is no such list.
  std::uint64_t count(const char* list) const;
  /// A whole number of an object, at most 2^53.
  std::uint64_t number(const SortedJson& object, const char* key,
                       std::optional<std::uint64_t> otherwise = {}) const;
  /// The bytes of a view of the binary chunk.
  std::string_view view(std::uint64_t index) const;
  /// A member of an object; null where it has none, or where it is no object.
  static const SortedJson* find(const SortedJson& object, const char* key);
  [[noreturn]] void fail(std::string_view what) const;

 private:
  const std::filesystem::path& path_;
  std::uint64_t bytes_;
  SortedJson document_;
  std::string_view binary_;
};

/// The numbers of an attribute, as floats.
class GlbAccessor {
 public:
  /// `width` numbers a row. Whole numbers count as fractions where the accessor says so.
  GlbAccessor(const GlbFile& glb, std::uint64_t index, std::size_t width);

  std::size_t count() const { return count_; }
  float operator()(std::size_t row, std::size_t column) const;
  Vec3f vec3(std::size_t row) const { return {(*this)(row, 0), (*this)(row, 1), (*this)(row, 2)}; }

 private:
  std::size_t component_bytes() const;
  float scaled(int value, int most) const;

  std::uint64_t component_ = 0, count_ = 0, stride_ = 0;
  bool is_normalized_ = false;
  std::string_view rows_;
};

}  // namespace gs
