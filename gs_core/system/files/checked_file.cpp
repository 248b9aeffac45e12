// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/checked_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <new>

#include "gs_core/error.h"

// GCC 12 warns of its own AVX-512 intrinsics, which leave lanes undefined on purpose.
#ifndef __clang__
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#define XXH_INLINE_ALL
#include <xxhash.h>

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little, "the format is that of the machine");

constexpr std::size_t kNameBytes = 32, kKindBytes = 8;
constexpr std::string_view kEnd = "end";
constexpr std::size_t kReadBytes = std::size_t(1) << 20;  // at a time

// A section's name as the file has it.
std::string padded(std::string_view name) {
  GS_CHECK(name.size() <= kNameBytes);
  std::string bytes(name);
  bytes.resize(kNameBytes, '\0');
  return bytes;
}

XXH3_state_t* state_of(void* state) { return static_cast<XXH3_state_t*>(state); }

}  // namespace

RunningHash::RunningHash() : state_(XXH3_createState()) {
  if (!state_) throw std::bad_alloc();
  XXH3_64bits_reset(state_of(state_));
}
RunningHash::~RunningHash() { XXH3_freeState(state_of(state_)); }
void RunningHash::add(const void* data, std::size_t bytes) {
  XXH3_64bits_update(state_of(state_), data, bytes);
}
std::uint64_t RunningHash::value() const { return XXH3_64bits_digest(state_of(state_)); }

CheckedWriter::CheckedWriter(std::filesystem::path path, const FileKind& kind)
    : file_(std::move(path)) {
  GS_CHECK(kind.name.size() == kKindBytes);
  owed_ = kKindBytes + 2 * sizeof(std::uint32_t);
  write(kind.name.data(), kind.name.size());
  const std::uint32_t numbers[2] = {kind.version, 0};
  write(numbers, sizeof numbers);
}

void CheckedWriter::section(std::string_view name, std::uint64_t bytes) {
  GS_CHECK(owed_ == 0);
  owed_ = kNameBytes + sizeof bytes + bytes;
  write(padded(name).data(), kNameBytes);
  write(&bytes, sizeof bytes);
}

void CheckedWriter::write(const void* data, std::size_t bytes) {
  GS_CHECK(bytes <= owed_);
  owed_ -= bytes;
  hash_.add(data, bytes);
  file_.write(data, bytes);
}

void CheckedWriter::text(std::string_view name, std::string_view text) {
  section(name, text.size());
  write(text.data(), text.size());
}

void CheckedWriter::commit() {
  const std::uint64_t hash = hash_.value();
  section(kEnd, sizeof hash);
  write(&hash, sizeof hash);
  file_.commit();
}

CheckedReader::CheckedReader(std::filesystem::path path, const FileKind& kind)
    : reader_(std::move(path)) {
  char name[kKindBytes];
  std::uint32_t numbers[2];
  left_ = sizeof name + sizeof numbers;
  read(name, sizeof name);
  if (std::string_view(name, sizeof name) != kind.name)
    cannot_read(reader_.path(), "it is not a file of this kind; name another one");
  read(numbers, sizeof numbers);
  version_ = numbers[0];
  if (version_ < kind.oldest || version_ > kind.version)
    cannot_read(reader_.path(),
                fmt::format("it has version {} of its format, and this program knows version {}; "
                            "use the program that wrote it",
                            version_, kind.version));
}

std::uint64_t CheckedReader::section(std::string_view name) {
  if (left_ != 0) damaged();
  left_ = kNameBytes + sizeof(std::uint64_t);
  if (next_name() != padded(name)) damaged();
  std::uint64_t bytes = 0;
  read(&bytes, sizeof bytes);
  if (bytes > reader_.left()) damaged();
  left_ = bytes;
  return bytes;
}

std::string CheckedReader::next_name() {
  std::string name(kNameBytes, '\0');
  read(name.data(), kNameBytes);
  return name;
}

void CheckedReader::read(void* to, std::size_t bytes) {
  if (bytes > left_ || bytes > reader_.left()) damaged();
  left_ -= bytes;
  for (auto* at = static_cast<std::uint8_t*>(to); bytes > 0;) {
    const std::size_t some = std::min(bytes, kReadBytes);
    std::memcpy(at, reader_.take(some), some);
    hash_.add(at, some);
    at += some;
    bytes -= some;
  }
}

std::string CheckedReader::text(std::string_view name) {
  std::string text(section(name), '\0');
  read(text.data(), text.size());
  return text;
}

void CheckedReader::finish() {
  const std::uint64_t expected = hash_.value();
  std::uint64_t hash = 0;
  if (section(kEnd) != sizeof hash) damaged();
  read(&hash, sizeof hash);
  if (hash != expected || reader_.left() > 0) damaged();
}

void CheckedReader::damaged() {
  cannot_read(reader_.path(), "it is cut short or damaged: its checksum does not match");
}

}  // namespace gs
