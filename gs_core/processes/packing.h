// SPDX-License-Identifier: Apache-2.0
// Values of a message between processes of the same program on machines of one kind.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "gs_core/error.h"

namespace gs {

/// Puts values one after another, as they lie in memory.
class Packer {
 public:
  template <class T>
  void value(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    put(&value, sizeof value);
  }
  /// A count, and so many values.
  template <class T>
  void list(const T* values, std::size_t count) {
    static_assert(std::is_trivially_copyable_v<T>);
    value(std::uint64_t(count));
    put(values, count * sizeof(T));
  }
  template <class T>
  void list(const std::vector<T>& values) {
    list(values.data(), values.size());
  }
  void text(const std::string& text) { list(text.data(), text.size()); }

  std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  void put(const void* from, std::size_t bytes) {
    if (bytes == 0) return;
    const std::size_t before = bytes_.size();
    bytes_.resize(before + bytes);
    std::memcpy(bytes_.data() + before, from, bytes);
  }

  std::vector<std::byte> bytes_;
};

/// Takes them in the same order. Throws Error where the message is shorter.
class Unpacker {
 public:
  explicit Unpacker(const std::vector<std::byte>& bytes) : bytes_(bytes) {}

  template <class T>
  T value() {
    T value;
    get(&value, sizeof value);
    return value;
  }
  /// The count of a list, whose values come next.
  template <class T>
  std::size_t count() {
    const auto count = value<std::uint64_t>();
    if (count > (bytes_.size() - at_) / sizeof(T)) fail();
    return std::size_t(count);
  }
  template <class T>
  void values(T* to, std::size_t count) {
    static_assert(std::is_trivially_copyable_v<T>);
    get(to, count * sizeof(T));
  }
  template <class T>
  std::vector<T> list() {
    std::vector<T> list(count<T>());
    values(list.data(), list.size());
    return list;
  }
  std::string text() {
    const std::vector<char> letters = list<char>();
    return {letters.begin(), letters.end()};
  }

 private:
  void get(void* to, std::size_t bytes) {
    if (bytes > bytes_.size() - at_) fail();
    if (bytes > 0) std::memcpy(to, bytes_.data() + at_, bytes);
    at_ += bytes;
  }
  [[noreturn]] static void fail() { throw Error("a message between ranks is too short"); }

  const std::vector<std::byte>& bytes_;
  std::size_t at_ = 0;
};

}  // namespace gs
