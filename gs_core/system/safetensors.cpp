// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/safetensors.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/checked_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::uint64_t kLengthBytes = 8;  // before the header

// The values that the shape has room for; more than any file has where there are too many.
std::uint64_t count_of(const std::vector<std::int64_t>& shape) {
  std::uint64_t count = 1;
  for (const std::int64_t size : shape) {
    if (size == 0) return 0;
    if (size < 0 || std::uint64_t(size) > kLargestSafetensors / count) return kLargestSafetensors;
    count *= std::uint64_t(size);
  }
  return count;
}

}  // namespace

SafetensorsFile::SafetensorsFile(std::filesystem::path path, std::string remedy)
    : path_(std::move(path)), remedy_(std::move(remedy)) {
  ByteReader reader(path_);
  RunningHash hash;
  const auto take = [&](std::uint64_t bytes) {
    const std::uint8_t* const taken = reader.take(std::size_t(bytes));
    hash.add(taken, std::size_t(bytes));
    return taken;
  };
  if (reader.size() > kLargestSafetensors) refuse("it is larger than 1 GiB");
  if (reader.size() < kLengthBytes) refuse("it is no safetensors file");
  std::uint64_t length = 0;
  std::memcpy(&length, take(kLengthBytes), kLengthBytes);
  if (length > reader.left() || length == 0 || *reader.peek(1) != '{')
    refuse("it is no safetensors file");
  const auto* const text = reinterpret_cast<const char*>(take(length));
  read_header(std::string(text, std::size_t(length)));
  const std::uint64_t left = reader.left();
  const std::uint8_t* const data = take(left);
  data_.assign(data, data + left);
  for (const auto& [name, entry] : entries_) check(name, entry);
  hash_ = fmt::format("{:016x}", hash.value());
}

void SafetensorsFile::read_header(const std::string& text) {
  const auto header = parse_json<SortedJson>(path_, text, remedy_);
  take_from_json(path_, remedy_, [&] {
    for (const auto& [name, array] : header.get_ref<const SortedJson::object_t&>()) {
      if (name == "__metadata__") continue;
      const auto& offsets = array.at("data_offsets").get_ref<const SortedJson::array_t&>();
      if (offsets.size() != 2) refuse("the offsets of " + name + " are damaged");
      Entry& entry = entries_[name];
      entry.kind = array.at("dtype").get<std::string>();
      for (const SortedJson& size : array.at("shape").get_ref<const SortedJson::array_t&>())
        entry.shape.push_back(whole_number<std::int64_t>(size));
      entry.begin = whole_number<std::uint64_t>(offsets[0]);
      entry.end = whole_number<std::uint64_t>(offsets[1]);
    }
  });
}

void SafetensorsFile::check(const std::string& name, const Entry& entry) const {
  if (entry.begin > entry.end || entry.end > data_.size())
    refuse("the data of " + name + " are missing");
  if (entry.kind == "F32" && entry.end - entry.begin != count_of(entry.shape) * sizeof(float))
    refuse("the data of " + name + " do not fit its shape");
}

FloatArray SafetensorsFile::array(const std::string& name) const {
  const auto found = entries_.find(name);
  if (found == entries_.end()) refuse("it has no " + name);
  const Entry& entry = found->second;
  if (entry.kind != "F32") refuse(name + " is of the kind " + entry.kind + " and not F32");
  FloatArray array{entry.shape, std::vector<float>((entry.end - entry.begin) / sizeof(float))};
  if (!array.values.empty())
    std::memcpy(array.values.data(), data_.data() + entry.begin, entry.end - entry.begin);
  if (!std::all_of(array.values.begin(), array.values.end(),
                   [](float value) { return std::isfinite(value); }))
    refuse(name + " holds a value that is not finite");
  return array;
}

void SafetensorsFile::refuse(const std::string& what) const {
  cannot_read(path_, what + "; " + remedy_);
}

}  // namespace gs
