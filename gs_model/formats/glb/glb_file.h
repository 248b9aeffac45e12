// SPDX-License-Identifier: Apache-2.0
// The parts of a .glb: its JSON, and arrays in its binary chunk.
#pragma once

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <string_view>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/glb/glb.h"

namespace gs {

inline constexpr const char* kRemedyOfGlb = "export the model again";

/// A file's JSON and its binary chunk. What is missing or of another kind is an Error with the file
/// and a remedy. Path and bytes must outlive it.
class GlbFile {
 public:
  GlbFile(const std::filesystem::path& path, std::string_view file) : path_(path) {
    if (file.size() < 20 || word(file, 0) != kGlbMagic) fail("does not begin as .glb files do");
    if (word(file, 4) != kGlbVersion) fail("is not of version 2 of glTF");
    if (word(file, 16) != kGlbJson) fail("does not begin with its JSON");
    const std::string_view rest = file.substr(20);
    const std::size_t json_bytes = word(file, 12);
    if (json_bytes > rest.size()) fail("is cut short");
    document_ = parse_json<SortedJson>(path, rest.substr(0, json_bytes), kRemedyOfGlb);
    const std::string_view second = rest.substr(json_bytes);
    if (second.size() < 8) return;  // without binary chunk; columns then fail
    if (word(second, 4) != kGlbBinary || word(second, 0) > second.size() - 8)
      fail("has no whole binary chunk");
    binary_ = second.substr(8, word(second, 0));
  }

  const std::filesystem::path& path() const { return path_; }
  /// The elements of one of the document's lists; none where there is no such list.
  const SortedJson& list(const char* name) const {
    static const SortedJson kNone = SortedJson::array();
    const SortedJson* items = find(document_, name);
    return items && items->is_array() ? *items : kNone;
  }
  const SortedJson& item(const char* name, std::uint64_t index) const {
    if (index >= list(name).size() || !list(name)[index].is_object())
      fail(fmt::format("lacks an entry of \"{}\"", name));
    return list(name)[index];
  }
  /// A whole number of an object, at most 2^53.
  std::uint64_t number(const SortedJson& object, const char* key,
                       std::optional<std::uint64_t> otherwise = {}) const {
    const SortedJson* value = find(object, key);
    if (!value && otherwise) return *otherwise;
    if (!value || !value->is_number_unsigned() ||
        value->get<std::uint64_t>() > std::uint64_t(1) << 53)
      fail(fmt::format("has no valid number \"{}\"", key));
    return value->get<std::uint64_t>();
  }
  /// The bytes of a view of the binary chunk.
  std::string_view view(std::uint64_t index) const {
    const SortedJson& view = item("bufferViews", index);
    if (number(view, "buffer") != 0 || find(item("buffers", 0), "uri"))
      fail("has its numbers in another file");
    const std::uint64_t at = number(view, "byteOffset", 0), bytes = number(view, "byteLength");
    if (at > binary_.size() || bytes > binary_.size() - at) fail("has a view beyond its end");
    return binary_.substr(at, bytes);
  }
  /// A member of an object; null where it has none, or where it is no object.
  static const SortedJson* find(const SortedJson& object, const char* key) {
    if (!object.is_object()) return nullptr;
    const auto found = object.find(key);
    return found == object.end() ? nullptr : &*found;
  }
  [[noreturn]] void fail(std::string_view what) const {
    cannot_read(path_, fmt::format("as a .glb it {}; {}", what, kRemedyOfGlb));
  }

 private:
  static std::uint32_t word(std::string_view bytes, std::size_t at) {
    return load_little<std::uint32_t>(bytes.data() + at);
  }

  const std::filesystem::path& path_;
  SortedJson document_;
  std::string_view binary_;
};

/// Rows of numbers in the binary chunk: an accessor.
class GlbRows {
 public:
  static constexpr std::uint64_t kInt8 = 5120, kUint8 = 5121, kInt16 = 5122, kUint16 = 5123,
                                 kUint32 = 5125, kFloat = 5126;

  /// `width` numbers a row, of one type. Those of 1 and 2 bytes are read as they are, or as shares of
  /// the largest one where they are normalized. `whole` ones are of no other type but u32.
  GlbRows(const GlbFile& glb, std::uint64_t index, std::size_t width, bool whole = false) {
    constexpr const char* kTypes[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
    const SortedJson& accessor = glb.item("accessors", index);
    const SortedJson* type = GlbFile::find(accessor, "type");
    if (!type || *type != kTypes[width])
      glb.fail(fmt::format("has an attribute that is not a {}", kTypes[width]));
    if (GlbFile::find(accessor, "sparse")) glb.fail("has sparse attributes, which are not read");
    component_ = glb.number(accessor, "componentType");
    const SortedJson* normalized = GlbFile::find(accessor, "normalized");
    is_normalized_ = normalized && *normalized == true;
    if (whole && component_ != kUint8 && component_ != kUint16 && component_ != kUint32)
      glb.fail("has indices that are not whole numbers");
    if (!whole && component_ != kFloat && (component_ < kInt8 || component_ > kUint16))
      glb.fail("has attributes that are not floats, bytes or numbers of 16 bits");
    bytes_ = component_ <= kUint8 ? 1 : component_ <= kUint16 ? 2 : 4;
    count_ = glb.number(accessor, "count");
    const std::uint64_t view = glb.number(accessor, "bufferView");
    const std::uint64_t row = width * bytes_, at = glb.number(accessor, "byteOffset", 0);
    stride_ = glb.number(glb.item("bufferViews", view), "byteStride", row);
    if (stride_ < row) glb.fail("has rows that lie over each other");
    const std::string_view all = glb.view(view);
    if (at > all.size() ||
        (count_ > 0 && (row > all.size() - at || count_ - 1 > (all.size() - at - row) / stride_)))
      glb.fail("has an attribute beyond the end of its view");
    rows_ = all.substr(at);
  }

  std::size_t count() const { return count_; }
  float operator()(std::size_t row, std::size_t column) const {
    const char* number = rows_.data() + row * stride_ + column * bytes_;
    const auto share_of = [&](auto most, float value) {
      return is_normalized_ ? std::max(value / float(most), -1.0f) : value;
    };
    switch (component_) {
      case kInt8: return share_of(127, load_little<std::int8_t>(number));
      case kUint8: return share_of(255, load_little<std::uint8_t>(number));
      case kInt16: return share_of(32767, load_little<std::int16_t>(number));
      case kUint16: return share_of(65535, load_little<std::uint16_t>(number));
      default: return load_little<float>(number);
    }
  }
  Vec3f vec3(std::size_t row) const { return {(*this)(row, 0), (*this)(row, 1), (*this)(row, 2)}; }
  /// The number of a row of whole ones.
  std::uint32_t whole(std::size_t row) const {
    const char* number = rows_.data() + row * stride_;
    if (component_ == kUint8) return load_little<std::uint8_t>(number);
    return component_ == kUint16 ? load_little<std::uint16_t>(number)
                                 : load_little<std::uint32_t>(number);
  }

 private:
  std::uint64_t component_ = 0, count_ = 0, bytes_ = 0, stride_ = 0;
  bool is_normalized_ = false;
  std::string_view rows_;
};

/// Throws Error where a node turns, scales or moves something: none of ours does.
void check_nodes(const GlbFile& glb);

/// That of the node, as our writers put it. Throws Error where it is damaged.
Vec3d world_offset_of(const GlbFile& glb);

}  // namespace gs
