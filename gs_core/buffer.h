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

/// An array of plain values in one Memory. Its capacity only grows, so that steady work allocates
/// nothing. A Buffer can be moved and not copied. It is const as a pointer is: the elements of a
/// const Buffer can be changed.
template <class T>
class Buffer {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  explicit Buffer(Memory& memory = host_memory()) : memory_(&memory) {}
  Buffer(std::size_t size, Memory& memory) : memory_(&memory) { resize(size); }
  Buffer(Buffer&& other) noexcept { swap(other); }
  Buffer& operator=(Buffer&& other) noexcept {
    swap(other);
    return *this;
  }
  ~Buffer() {
    if (data_) memory_->deallocate(data_, capacity_ * sizeof(T));
  }

  T* data() const { return data_; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  std::size_t capacity() const { return capacity_; }
  Memory& memory() const { return *memory_; }
  Span<T> span() const { return {data_, size_}; }
  /// Host memory only: element i.
  T& operator[](std::size_t i) const { return data_[i]; }
  T* begin() const { return data_; }
  T* end() const { return data_ + size_; }

  /// Changes the size and keeps the first min(old, new) elements; new ones are undefined.
  void resize(std::size_t size) {
    reserve(size);
    size_ = size;
  }
  /// Changes the size without keeping the contents. A Buffer that grows gives its old memory back
  /// first; it is empty if there is too little for the new one.
  void resize_discard(std::size_t size) {
    size_ = 0;
    if (size > capacity_) {
      const std::size_t grown = grown_capacity(size);
      release();
      data_ = static_cast<T*>(memory_->allocate(grown * sizeof(T)));
      capacity_ = grown;
    }
    size_ = size;
  }
  /// Makes the capacity at least `capacity`; if it grows, it has a reserve (grown_bytes).
  void reserve(std::size_t capacity) {
    if (capacity <= capacity_) return;
    const std::size_t grown = grown_capacity(capacity);
    T* fresh = static_cast<T*>(memory_->allocate(grown * sizeof(T)));
    if (size_) memory_->copy(fresh, data_, size_ * sizeof(T));
    if (data_) memory_->deallocate(data_, capacity_ * sizeof(T));
    data_ = fresh;
    capacity_ = grown;
  }
  /// Gives all memory back; the Buffer is empty then.
  void release() noexcept { *this = Buffer(*memory_); }
  /// Gives spare capacity back. Throws Error if there is no memory for the copy, and then changes
  /// nothing.
  void shrink() {
    if (size_ == capacity_) return;
    Buffer fitting(size_, *memory_);
    if (size_) memory_->copy(fitting.data_, data_, size_ * sizeof(T));
    swap(fitting);
  }
  void fill_zero() {
    if (size_) memory_->fill_zero(data_, size_ * sizeof(T));
  }
  void swap(Buffer& other) noexcept {
    std::swap(memory_, other.memory_);
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(capacity_, other.capacity_);
  }

  void upload(const std::vector<T>& values) {
    resize_discard(values.size());
    if (size_) memory_->upload(data_, values.data(), size_ * sizeof(T));
  }
  std::vector<T> download() const {
    std::vector<T> values(size_);
    if (size_) memory_->download(values.data(), data_, size_ * sizeof(T));
    return values;
  }

 private:
  std::size_t grown_capacity(std::size_t size) const {
    return std::max(size, grown_bytes(capacity_ * sizeof(T), size * sizeof(T)) / sizeof(T));
  }

  Memory* memory_ = &host_memory();
  T* data_ = nullptr;
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

/// The numbers of an array one after another, whatever its rows are: float, Vec3f or Quatf.
template <class T>
Span<float> numbers_of(const Buffer<T>& rows) {
  return {reinterpret_cast<float*>(rows.data()), rows.size() * (sizeof(T) / sizeof(float))};
}

}  // namespace gs
