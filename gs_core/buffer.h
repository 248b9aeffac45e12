// SPDX-License-Identifier: Apache-2.0
// The two forms of an array of plain values: a Buffer owns it, a Span is a view that is passed by
// value.
#pragma once

#include <algorithm>
#include <cstddef>
#include <type_traits>
#include <utility>
#include <vector>

#include "gs_core/memory.h"
#include "gs_core/types.h"

namespace gs {

/// A view of an array that somebody else owns. Stages and kernels take it by value.
template <class T>
struct Span {
  T* data = nullptr;
  std::size_t size = 0;

  GS_HD T& operator[](std::size_t i) const { return data[i]; }
  GS_HD T* begin() const { return data; }
  GS_HD T* end() const { return data + size; }
  GS_HD bool empty() const { return size == 0; }
  GS_HD operator Span<const T>() const { return {data, size}; }
};

/// The share of its capacity that a Buffer which grows takes in reserve, of so many bytes. Large
/// arrays are what fills a device, and time to copy them grows slower than they.
constexpr double reserve_share(std::size_t capacity) {
  constexpr std::size_t kMiB = std::size_t(1) << 20;
  return capacity < kMiB ? 1.0 / 2 : capacity < 16 * kMiB ? 1.0 / 16 : 1.0 / 32;
}

/// The bytes of a Buffer that has `capacity` bytes and needs `bytes`, which are more.
constexpr std::size_t grown_bytes(std::size_t capacity, std::size_t bytes) {
  return std::max(bytes, capacity + std::size_t(double(capacity) * reserve_share(capacity)));
}

/// Rows of `row_bytes` bytes each, in one Memory. Its capacity only grows, so that steady work
/// allocates nothing. It can be moved and not copied. It is const as a pointer is: the rows of a
/// const ByteBuffer can be changed. Sizes and capacities are numbers of rows.
class ByteBuffer {
 public:
  ByteBuffer(std::size_t row_bytes, Memory& memory) : memory_(&memory), row_bytes_(row_bytes) {}
  ByteBuffer(ByteBuffer&& other) noexcept : row_bytes_(other.row_bytes_) { swap(other); }
  ~ByteBuffer() {
    if (bytes_) memory_->deallocate(bytes_, capacity_ * row_bytes_);
  }

  std::byte* bytes() const { return bytes_; }
  /// The bytes of row i.
  std::byte* row(std::size_t i) const { return bytes_ + i * row_bytes_; }
  std::size_t row_bytes() const { return row_bytes_; }
  std::size_t size() const { return size_; }
  std::size_t size_bytes() const { return size_ * row_bytes_; }
  bool empty() const { return size_ == 0; }
  std::size_t capacity() const { return capacity_; }
  Memory& memory() const { return *memory_; }

  /// Changes the size and keeps the first min(old, new) rows; new ones are undefined.
  void resize(std::size_t size) {
    reserve(size);
    size_ = size;
  }
  /// Changes the size without keeping the contents. A buffer that grows gives its old memory back
  /// first; it is empty if there is too little for the new one.
  void resize_discard(std::size_t size);
  /// Makes the capacity at least `capacity`; if it grows, it has a reserve (grown_bytes).
  void reserve(std::size_t capacity);
  /// Gives all memory back; the buffer is empty then.
  void release() noexcept { ByteBuffer(row_bytes_, *memory_).swap(*this); }
  /// Releases everything and lies in another memory from now on.
  void use(Memory& memory) noexcept { ByteBuffer(row_bytes_, memory).swap(*this); }
  /// Gives spare capacity back. Throws Error if there is no memory for the copy, and then changes
  /// nothing.
  void shrink();
  void fill_zero() { zero_from(0); }
  /// Zeros row `first` and those after it.
  void zero_from(std::size_t first) {
    if (first < size_) memory_->fill_zero(row(first), (size_ - first) * row_bytes_);
  }
  /// Becomes a copy of rows of the same size, which may lie in another memory.
  void copy_from(const ByteBuffer& from);

 protected:
  ByteBuffer& operator=(ByteBuffer&& other) noexcept {
    swap(other);
    return *this;
  }
  void swap(ByteBuffer& other) noexcept;

 private:
  std::size_t grown_capacity(std::size_t size) const {
    return std::max(size, grown_bytes(capacity_ * row_bytes_, size * row_bytes_) / row_bytes_);
  }

  Memory* memory_ = &host_memory();
  std::byte* bytes_ = nullptr;
  std::size_t row_bytes_;
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

/// A ByteBuffer whose rows are plain values of one type.
template <class T>
class Buffer : public ByteBuffer {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  explicit Buffer(Memory& memory = host_memory()) : ByteBuffer(sizeof(T), memory) {}
  Buffer(std::size_t size, Memory& memory) : Buffer(memory) { resize(size); }

  T* data() const { return reinterpret_cast<T*>(bytes()); }
  Span<T> span() const { return {data(), size()}; }
  /// Host memory only: element i.
  T& operator[](std::size_t i) const { return data()[i]; }
  T* begin() const { return data(); }
  T* end() const { return data() + size(); }
  void swap(Buffer& other) noexcept { ByteBuffer::swap(other); }

  void upload(const std::vector<T>& values) {
    resize_discard(values.size());
    if (!empty()) memory().upload(data(), values.data(), size_bytes());
  }
  std::vector<T> download() const {
    std::vector<T> values(size());
    if (!empty()) memory().download(values.data(), data(), size_bytes());
    return values;
  }
};

/// The numbers of a row: 1 of float, 3 of Vec3f, 4 of Quatf.
template <class T>
inline constexpr std::size_t kNumbersOf =
    sizeof(T) / sizeof(float);  // NOLINT(bugprone-sizeof-expression): T may be float

/// The numbers of an array one after another, whatever its rows are.
template <class T>
Span<float> numbers_of(const Buffer<T>& rows) {
  return {reinterpret_cast<float*>(rows.data()), rows.size() * kNumbersOf<T>};
}

}  // namespace gs
