// SPDX-License-Identifier: Apache-2.0
// Arrays of numbers by name, in files of the safetensors format, in which programs of PyTorch keep
// weights of networks.
//
//   u64       bytes of the header
//   header    JSON: {name: {"dtype": "F32", "shape": [...], "data_offsets": [begin, end]}, ...}, and
//             "__metadata__", which says nothing of the arrays
//   data      the arrays; the offsets count from here
//
// Numbers are little-endian, the last index of an array runs fastest.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace gs {

inline constexpr std::uint64_t kLargestSafetensors = std::uint64_t(1)
                                                     << 30;  // bytes; VGG-16 has 2^26

/// An array of such a file, or of a network.
struct FloatArray {
  std::vector<std::int64_t> shape;
  std::vector<float> values;
};

/// Such a file, in memory. Throws Error, which names the file and ends with `remedy`, if it is
/// damaged; what the arrays hold is looked at only when they are asked for.
class SafetensorsFile {
 public:
  SafetensorsFile(std::filesystem::path path, std::string remedy);

  bool has(const std::string& name) const { return entries_.contains(name); }
  /// An array of float32. Throws Error if there is none of that name, if it has numbers of another
  /// kind, and if one of them is infinite or not a number.
  FloatArray array(const std::string& name) const;
  /// XXH3 of all bytes of the file: 16 hexadecimal digits.
  const std::string& hash() const { return hash_; }
  /// Throws Error "cannot read PATH: WHAT; REMEDY".
  [[noreturn]] void refuse(const std::string& what) const;

 private:
  struct Entry {
    std::string kind;
    std::vector<std::int64_t> shape;
    std::uint64_t begin = 0, end = 0;  // of its bytes in data_
  };
  void read_header(const std::string& text);
  void check(const std::string& name, const Entry& entry) const;

  std::filesystem::path path_;
  std::string remedy_, hash_;
  std::map<std::string, Entry> entries_;
  std::vector<std::uint8_t> data_;
};

}  // namespace gs
