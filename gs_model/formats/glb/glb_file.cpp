// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/glb/glb_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/glb/glb.h"

namespace gs {
namespace {

constexpr const char* kRemedyOfGlb = "export the model again";

std::uint32_t word(std::string_view bytes, std::size_t at) {
  return load_little<std::uint32_t>(bytes.data() + at);
}

}  // namespace

GlbFile::GlbFile(const std::filesystem::path& path, std::string_view file)
    : path_(path), bytes_(file.size()) {
  if (file.size() < 20 || word(file, 0) != kGlbMagic) fail("does not begin as .glb files do");
  if (word(file, 4) != kGlbVersion) fail("is not of version 2 of glTF");
  if (word(file, 16) != kGlbJson) fail("does not begin with its JSON");
  const std::string_view rest = file.substr(20);
  const std::size_t json_bytes = word(file, 12);
  if (json_bytes > rest.size()) fail("is cut short");
  document_ = parse_json<SortedJson>(path, rest.substr(0, json_bytes), kRemedyOfGlb);
  const std::string_view second = rest.substr(json_bytes);
  if (second.size() < 8) return;  // without binary chunk; accessors then fail
  if (word(second, 4) != kGlbBinary || word(second, 0) > second.size() - 8)
    fail("has no whole binary chunk");
  binary_ = second.substr(8, word(second, 0));
}

const SortedJson& GlbFile::item(const char* list, std::uint64_t index) const {
  const SortedJson* items = find(document_, list);
  if (!items || !items->is_array() || index >= items->size() || !(*items)[index].is_object())
    fail(fmt::format("lacks an entry of \"{}\"", list));
  return (*items)[index];
}

std::uint64_t GlbFile::count(const char* list) const {
  const SortedJson* items = find(document_, list);
  return items && items->is_array() ? items->size() : 0;
}

std::uint64_t GlbFile::number(const SortedJson& object, const char* key,
                              std::optional<std::uint64_t> otherwise) const {
  const SortedJson* value = find(object, key);
  if (!value && otherwise) return *otherwise;
  if (!value || !value->is_number_unsigned() ||
      value->get<std::uint64_t>() > std::uint64_t(1) << 53)
    fail(fmt::format("has no valid number \"{}\"", key));
  return value->get<std::uint64_t>();
}

std::string_view GlbFile::view(std::uint64_t index) const {
  const SortedJson& view = item("bufferViews", index);
  if (number(view, "buffer") != 0 || find(item("buffers", 0), "uri"))
    fail("has its numbers in another file");
  const std::uint64_t at = number(view, "byteOffset", 0), bytes = number(view, "byteLength");
  if (at > binary_.size() || bytes > binary_.size() - at) fail("has a view beyond its end");
  return binary_.substr(at, bytes);
}

const SortedJson* GlbFile::find(const SortedJson& object, const char* key) {
  if (!object.is_object()) return nullptr;
  const auto found = object.find(key);
  return found == object.end() ? nullptr : &*found;
}

void GlbFile::fail(std::string_view what) const {
  cannot_read(path_, fmt::format("as a .glb it {}; {}", what, kRemedyOfGlb));
}

GlbAccessor::GlbAccessor(const GlbFile& glb, std::uint64_t index, std::size_t width) {
  const SortedJson& accessor = glb.item("accessors", index);
  constexpr const char* kTypes[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
  const SortedJson* type = GlbFile::find(accessor, "type");
  if (!type || *type != kTypes[width])
    glb.fail(fmt::format("has an attribute that is not a {}", kTypes[width]));
  if (GlbFile::find(accessor, "sparse")) glb.fail("has sparse attributes, which are not read");
  component_ = glb.number(accessor, "componentType");
  const SortedJson* normalized = GlbFile::find(accessor, "normalized");
  is_normalized_ = normalized && *normalized == true;
  const std::size_t bytes = component_bytes();
  if (bytes == 0) glb.fail("has an attribute of a type that Gaussians do not have");
  count_ = glb.number(accessor, "count");
  const std::uint64_t view = glb.number(accessor, "bufferView");
  const std::string_view all = glb.view(view);
  stride_ = glb.number(glb.item("bufferViews", view), "byteStride", bytes * width);
  const std::uint64_t at = glb.number(accessor, "byteOffset", 0), row = bytes * width;
  if (stride_ < row || stride_ > 252) glb.fail("has a stride that glTF does not allow");
  if (at > all.size() ||
      (count_ > 0 && (all.size() - at < row || (count_ - 1) > (all.size() - at - row) / stride_)))
    glb.fail("has an attribute beyond the end of its view");
  rows_ = all.substr(at);
}

float GlbAccessor::operator()(std::size_t row, std::size_t column) const {
  const char* at = rows_.data() + row * stride_ + column * component_bytes();
  switch (component_) {
    case 5120: return scaled(load_little<std::int8_t>(at), 127);
    case 5121: return scaled(load_little<std::uint8_t>(at), 255);
    case 5122: return scaled(load_little<std::int16_t>(at), 32767);
    case 5123: return scaled(load_little<std::uint16_t>(at), 65535);
    default: return load_little<float>(at);
  }
}

std::size_t GlbAccessor::component_bytes() const {
  return component_ == 5126                         ? 4
         : component_ == 5122 || component_ == 5123 ? 2
         : component_ == 5120 || component_ == 5121 ? 1
                                                    : 0;
}

float GlbAccessor::scaled(int value, int most) const {
  return is_normalized_ ? std::max(float(value) / float(most), -1.0f) : float(value);
}

}  // namespace gs
