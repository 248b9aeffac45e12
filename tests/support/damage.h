// SPDX-License-Identifier: Apache-2.0
// Damaged files for readers of untrusted files. Each file must be read or refused with an Error;
// nothing may crash, hang or ask for more memory than a file of its size can need. The damage
// depends only on the number of the case, which failures name: GS_FUZZ_FIRST and GS_FUZZ_CASES run
// that case again, or more of them. Programs that include this have largest_allocation.cpp, too.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <random>
#include <string>

#include "gs_core/error.h"
#include "tests/support/foreign_leaks.h"
#include "tests/support/temp_folder.h"

namespace gs {

// bytes; no file here has more than a few thousand
inline constexpr std::size_t kLargestAllocation = std::size_t(256) << 20;
/// Bytes that were asked for at once; largest_allocation.cpp keeps count.
extern std::atomic<std::size_t> largest_allocation;

inline void damage(std::string& bytes, std::mt19937& random) {
  if (bytes.empty()) bytes = "x";
  const std::size_t at = random() % bytes.size();
  const std::size_t length = std::min<std::size_t>(1 + random() % 16, bytes.size() - at);
  switch (random() % 9) {
    case 0: bytes[at] = char(bytes[at] ^ (1 << random() % 8)); break;
    case 1: bytes[at] = char(random()); break;
    case 2: bytes.resize(at); break;
    case 3: bytes.erase(at, length); break;
    case 4: bytes.insert(at, bytes.substr(random() % bytes.size(), 64)); break;
    case 5: std::fill_n(bytes.begin() + at, length, random() % 2 ? '\xff' : '\0'); break;
    case 6: {  // a number of eight bytes: huge, negative, not a number
      const std::uint64_t numbers[] = {~0ull, 1ull << 62, 0x7ff8000000000000ull,
                                       0xfff0000000000000ull, 1ull << 31};
      for (std::size_t i = 0; i < std::min<std::size_t>(8, bytes.size() - at); ++i)
        bytes[at + i] = char(numbers[random() % 5] >> 8 * i);
      break;
    }
    case 7: {  // words in text files
      const char* const words[] = {"nan",  "-1", "1e999", "99999999999999999999", "\"", "[", "}",
                                   "\r\n", "0x", " "};
      bytes.insert(at, words[random() % 10]);
      break;
    }
    case 8: std::swap(bytes[at], bytes[random() % bytes.size()]); break;
  }
}

/// Applies one to four damages.
inline std::string damaged(std::string bytes, std::mt19937& random) {
  for (unsigned round = 0, rounds = 1 + random() % 4; round < rounds; ++round)
    damage(bytes, random);
  return bytes;
}

/// Replaces a file. If a file is truncated and written again, as write_bytes() does, file systems
/// wait for the disk.
inline void replace_bytes(const std::filesystem::path& file, const std::string& bytes) {
  std::filesystem::remove(file);
  write_bytes(file, bytes);
}

/// Runs a reader on a damaged file. Returns what is wrong with its reaction, or nothing.
inline std::string trouble_of(const std::function<void()>& read, double most_seconds = 1) {
  const auto begin = std::chrono::steady_clock::now();
  largest_allocation = 0;
  std::string trouble;
  try {
    const IgnoreForeignLeaks image_libraries;
    read();
  } catch (const Error& error) {
    const std::string said = error.what();
    if (said.size() < 10) trouble = "an error that says nothing";
    if (said != printable(said)) trouble = "an error that is not text";
  } catch (const std::exception& error) {
    trouble = std::string("not an Error: ") + error.what();
  }
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  if (seconds.count() > most_seconds) trouble += " took " + std::to_string(seconds.count()) + " s";
  if (largest_allocation > kLargestAllocation)
    trouble += " asked for " + std::to_string(largest_allocation) + " bytes";
  return trouble;
}

/// GS_FUZZ_FIRST, GS_FUZZ_CASES: the cases to try.
struct FuzzCases {
  unsigned first = number_in("GS_FUZZ_FIRST", 0), count = number_in("GS_FUZZ_CASES", 1'000);

 private:
  static unsigned number_in(const char* variable, unsigned otherwise) {
    const char* const text = std::getenv(variable);
    return text ? unsigned(std::strtoul(text, nullptr, 10)) : otherwise;
  }
};

}  // namespace gs
