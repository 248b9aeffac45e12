// SPDX-License-Identifier: Apache-2.0
#include "gs_core/buffer.h"

#include "gs_core/error.h"

namespace gs {

void ByteBuffer::resize_discard(std::size_t size) {
  size_ = 0;
  if (size > capacity_) {
    const std::size_t grown = grown_capacity(size);
    release();
    bytes_ = static_cast<std::byte*>(memory_->allocate(grown * row_bytes_));
    capacity_ = grown;
  }
  size_ = size;
}

void ByteBuffer::reserve(std::size_t capacity) {
  if (capacity <= capacity_) return;
  const std::size_t grown = grown_capacity(capacity);
  auto* const fresh = static_cast<std::byte*>(memory_->allocate(grown * row_bytes_));
  if (size_) memory_->copy(fresh, bytes_, size_bytes());
  if (bytes_) memory_->deallocate(bytes_, capacity_ * row_bytes_);
  bytes_ = fresh;
  capacity_ = grown;
}

void ByteBuffer::shrink() {
  if (size_ == capacity_) return;
  ByteBuffer fitting(row_bytes_, *memory_);
  fitting.resize(size_);
  if (size_) memory_->copy(fitting.bytes_, bytes_, size_bytes());
  swap(fitting);
}

void ByteBuffer::copy_from(const ByteBuffer& from) {
  GS_CHECK(row_bytes_ == from.row_bytes_);
  resize_discard(from.size_);
  if (size_ == 0) return;
  if (memory_ == from.memory_) return memory_->copy(bytes_, from.bytes_, size_bytes());
  if (memory_ == &host_memory()) return from.memory_->download(bytes_, from.bytes_, size_bytes());
  if (from.memory_ == &host_memory()) return memory_->upload(bytes_, from.bytes_, size_bytes());
  ByteBuffer on_host(row_bytes_, host_memory());
  on_host.copy_from(from);
  memory_->upload(bytes_, on_host.bytes_, size_bytes());
}

void ByteBuffer::swap(ByteBuffer& other) noexcept {
  std::swap(memory_, other.memory_);
  std::swap(bytes_, other.bytes_);
  std::swap(row_bytes_, other.row_bytes_);
  std::swap(size_, other.size_);
  std::swap(capacity_, other.capacity_);
}

}  // namespace gs
