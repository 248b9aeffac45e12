// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/text_file.h"

#include <spdlog/fmt/fmt.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>

#include "gs_core/system/byte_reader.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void too_large(const fs::path& path, std::uint64_t most_bytes) {
  cannot_read(path,
              fmt::format("it has more than {} bytes, too many for a file of this kind; check "
                          "what it is",
                          most_bytes));
}

// A pipe can be read only once, but a config is asked for several times.
std::string read_pipe(const fs::path& path, std::uint64_t most_bytes) {
  static std::mutex mutex;
  static std::map<fs::path, std::string> texts;
  const std::lock_guard lock(mutex);
  if (const auto read = texts.find(path); read != texts.end()) return read->second;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             std::fclose);
  if (!file) cannot_read(path, std::strerror(errno) + std::string("; check its permissions"));
  std::string text;
  char block[4096];
  while (const std::size_t got = std::fread(block, 1, sizeof block, file.get())) {
    if (got > most_bytes - text.size()) too_large(path, most_bytes);
    text.append(block, got);
  }
  return texts[path] = text;
}

}  // namespace

// The names under which a shell hands over a pipe.
bool is_pipe_of_shell(const fs::path& path) {
  std::error_code ignored;
  const fs::path folder = path.parent_path();
  return (path == "/dev/stdin" || folder == "/dev/fd" || folder == "/proc/self/fd") &&
         fs::is_fifo(path, ignored);
}

std::string read_text_file(const fs::path& path, std::uint64_t most_bytes) {
  if (is_pipe_of_shell(path)) return read_pipe(path, most_bytes);
  ByteReader file(path);
  if (file.size() > most_bytes) too_large(path, most_bytes);
  const auto bytes = std::size_t(file.size());
  return {reinterpret_cast<const char*>(file.take(bytes)), bytes};
}

}  // namespace gs
