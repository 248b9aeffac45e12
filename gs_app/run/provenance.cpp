// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/provenance.h"

#include <spdlog/fmt/fmt.h>
#include <sys/resource.h>
#include <unistd.h>

#include <ctime>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "gs_core/system/files/text_file.h"
#include "gs_core/system/fnv1a.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/version.h"

namespace gs {

bool knows_commit() { return std::string_view(built_commit()) != "unknown"; }

// gs_app/CMakeLists.txt defines both macros for this file.
CudaBuild built_cuda() { return {GS_CUDA_TOOLKIT, GS_CUDA_CODE}; }

std::string describe_build() {
  std::string text = fmt::format("gemsplat {}", kVersion);
  if (knows_commit()) text += fmt::format(", commit {}", built_commit());
  const CudaBuild cuda = built_cuda();
  if (cuda.toolkit.empty()) return text + ", without CUDA";
  return text + fmt::format(", CUDA {} for {}", cuda.toolkit, cuda.architectures);
}

std::string built_compiler() {
#ifdef __clang__
  return "clang " __clang_version__;
#else
  return "GCC " __VERSION__;
#endif
}

UncommittedChanges changes_of(std::string diff) {
  UncommittedChanges changes;
  Fnv1a hash;
  hash.add(diff);
  changes.hash = fmt::format("{:016x}", hash.value());
  std::istringstream lines(diff);
  for (std::string line; std::getline(lines, line);) {
    // "diff --git a/FILE b/FILE": no other line of a diff begins without a space or a sign
    constexpr std::string_view kStart = "diff --git ";
    if (!line.starts_with(kStart)) continue;
    const std::size_t name = line.rfind(" b/");
    changes.files.push_back(name == line.npos ? line.substr(kStart.size()) : line.substr(name + 3));
  }
  changes.diff = std::move(diff);
  return changes;
}

const std::optional<UncommittedChanges>& uncommitted_changes() {
  constexpr std::uint64_t kMostBytes = 64 << 20;
  static const std::optional<UncommittedChanges> changes =
      []() -> std::optional<UncommittedChanges> {
    try {
      const std::filesystem::path program = own_program();
      const std::filesystem::path file = program.parent_path() / "uncommitted.diff";
      if (!std::filesystem::exists(program) || !std::filesystem::exists(file)) return std::nullopt;
      return changes_of(read_text_file(file, kMostBytes));
    } catch (const std::exception&) {  // no reason to fail for
      return std::nullopt;
    }
  }();
  return changes;
}

std::vector<std::string> command_line() {
  std::ifstream file("/proc/self/cmdline");
  std::vector<std::string> words;
  for (std::string word; std::getline(file, word, '\0');) words.push_back(word);
  return words;
}

std::string cpu_name() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    const std::size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != line.npos) return line.substr(colon + 2);
  }
  return "unknown";
}

// "NVRM version: NVIDIA UNIX x86_64 Kernel Module  550.54.15  Tue Mar  5 ...": the first word of
// digits with a dot
std::string gpu_driver() {
  std::ifstream file("/proc/driver/nvidia/version");
  std::string line;
  std::getline(file, line);
  std::istringstream words(line);
  for (std::string word; words >> word;)
    if (word.find('.') != word.npos && word.find_first_not_of("0123456789.") == word.npos)
      return word;
  return "";
}

std::string utc_date() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

// The second number of the file: resident pages.
std::size_t host_bytes() {
  std::ifstream file("/proc/self/statm");
  std::size_t total = 0, resident = 0;
  file >> total >> resident;
  return resident * std::size_t(::sysconf(_SC_PAGESIZE));
}

std::size_t peak_host_bytes() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return std::size_t(usage.ru_maxrss) * 1024;  // Linux counts KiB
}

}  // namespace gs
