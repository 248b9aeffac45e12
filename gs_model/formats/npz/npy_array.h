// SPDX-License-Identifier: Apache-2.0
// One array of numbers in NumPy's .npy format: magic, version, length of the header, a header that is
// a Python dict with type, order and shape, and the numbers. Format: NEP 1.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace gs {

struct NpyArray {
  std::string type;  // kind and bytes of a number: "i1", "u1", "b1", "i4", "i8", "f2", "f4" or "f8"
  std::vector<std::size_t> shape;  // none: one number
  std::string bytes;               // the numbers, rows one after the other, lowest byte first

  std::size_t size() const;
  /// A number; i < size().
  double at(std::size_t i) const;
};

/// The longest header that is read, bytes. NumPy writes 118 for every shape of few dimensions.
inline constexpr std::size_t kNpyHeaderAtMost = 4096;

/// An array of its file's bytes. Throws Error "cannot read PATH: ..." that names `name` where the
/// bytes are no such array, where they are of another type, order or length.
NpyArray npy_array(const std::filesystem::path& path, const std::string& name, std::string bytes);

/// The bytes of a file of version 1.0.
std::string npy_bytes(const NpyArray& array);

}  // namespace gs
