// SPDX-License-Identifier: Apache-2.0
// Where a writer of a format puts its bytes, from the first to the last: a file (AtomicFile), or
// memory.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>

namespace gs {

class ByteSink {
 public:
  virtual ~ByteSink() = default;
  /// What errors and warnings call it: the path of a file.
  virtual std::string name() const = 0;
  /// Throws Error, which names the sink, where it takes no more.
  virtual void write(const void* data, std::size_t bytes) = 0;
  void write(std::string_view text) { write(text.data(), text.size()); }
};

/// Keeps the bytes in memory.
class MemorySink : public ByteSink {
 public:
  explicit MemorySink(std::string name) : name_(std::move(name)) {}
  std::string name() const override { return name_; }
  using ByteSink::write;
  void write(const void* data, std::size_t bytes) override {
    text.append(static_cast<const char*>(data), bytes);
  }

  std::string text;

 private:
  std::string name_;
};

}  // namespace gs
