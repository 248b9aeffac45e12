// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/npz/npy_array.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <numeric>
#include <string_view>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/parse_number.h"
#include "gs_model/formats/coding/half.h"
#include "gs_model/formats/coding/little_endian.h"

namespace gs {
namespace {

constexpr std::string_view kMagic = "\x93NUMPY", kDigits = "0123456789";
constexpr std::size_t kAlignment = 64;              // of the numbers in a file
constexpr std::uint64_t kMostNumbers = 1ull << 40;  // so that products of sides do not overflow
constexpr std::string_view kTypes[] = {"i1", "u1", "b1", "i4", "i8", "f2", "f4", "f8"};

std::size_t bytes_each(const std::string& type) { return std::size_t(type[1] - '0'); }

// What follows 'key': in the header; empty where it lacks the key.
std::string_view value_of(std::string_view header, std::string_view key) {
  const std::size_t at = header.find(key);
  if (at == header.npos) return {};
  header.remove_prefix(at + key.size());
  header.remove_prefix(std::min(header.find_first_not_of(": "), header.size()));
  return header;
}

// The sides in "(3, 4)"; false where they are none.
bool read_shape(std::string_view text, std::vector<std::size_t>& shape) {
  if (!text.starts_with('(')) return false;
  std::uint64_t numbers = 1;
  for (text.remove_prefix(1); !text.starts_with(')');) {
    const std::size_t end = std::min(text.find_first_not_of(kDigits), text.size());
    std::uint64_t side;
    if (!parse_number(text.substr(0, end), side) || side > kMostNumbers / std::max(numbers, 1ul))
      return false;
    numbers *= side;
    shape.push_back(side);
    text.remove_prefix(end);
    text.remove_prefix(std::min(text.find_first_not_of(", L"), text.size()));
  }
  return true;
}

}  // namespace

std::size_t NpyArray::size() const {
  return std::accumulate(shape.begin(), shape.end(), std::size_t(1), std::multiplies<>());
}

double NpyArray::at(std::size_t i) const {
  const char* const number = bytes.data() + i * bytes_each(type);
  if (type == "i1") return load_little<std::int8_t>(number);
  if (type == "i4") return load_little<std::int32_t>(number);
  if (type == "i8") return double(load_little<std::int64_t>(number));
  if (type == "f2") return from_half(load_little<std::uint16_t>(number));
  if (type == "f4") return load_little<float>(number);
  if (type == "f8") return load_little<double>(number);
  return load_little<std::uint8_t>(number);
}

NpyArray npy_array(const std::filesystem::path& path, const std::string& name, std::string bytes) {
  const auto fail = [&](const std::string& what) {
    cannot_read(path,
                fmt::format("the array {} in it {}; save it again with numpy.savez_compressed",
                            shown_word(name), what));
  };
  const std::string_view file = bytes;
  const std::size_t length_bytes = file.size() > 6 && file[6] > 1 ? 4 : 2, start = 8 + length_bytes;
  if (!file.starts_with(kMagic) || file.size() < start) fail("has no header of NumPy");
  const std::size_t length = length_bytes == 4 ? load_little<std::uint32_t>(&file[8])
                                               : load_little<std::uint16_t>(&file[8]);
  if (length > kNpyHeaderAtMost || length > file.size() - start) fail("has no header of NumPy");
  const std::string_view header = file.substr(start, length);
  NpyArray array;
  const std::string_view type = value_of(header, "'descr'");  // '<f4'
  if (type.size() > 4 && type[1] != '>') array.type = type.substr(2, 2);
  if (std::find(std::begin(kTypes), std::end(kTypes), array.type) == std::end(kTypes))
    fail("is of a type that no model has");
  if (!value_of(header, "'fortran_order'").starts_with("False")) fail("has columns before rows");
  if (!read_shape(value_of(header, "'shape'"), array.shape)) fail("has no shape");
  bytes.erase(0, start + length);
  if (bytes.size() != array.size() * bytes_each(array.type)) fail("has another size than it says");
  array.bytes = std::move(bytes);
  return array;
}

std::string npy_bytes(const NpyArray& array) {
  const char order = bytes_each(array.type) == 1 ? '|' : '<';
  std::string header =
      fmt::format("{{'descr': '{}{}', 'fortran_order': False, 'shape': ({}{}), }}", order,
                  array.type, fmt::join(array.shape, ", "), array.shape.size() == 1 ? "," : "");
  std::string file = std::string(kMagic) + '\x01' + '\0';
  const std::size_t start = file.size() + 2;
  header.resize((start + header.size() + kAlignment) / kAlignment * kAlignment - start - 1, ' ');
  header += '\n';
  append_little(file, std::uint16_t(header.size()));
  return file + header + array.bytes;
}

}  // namespace gs
