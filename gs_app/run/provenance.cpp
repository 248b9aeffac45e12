// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/provenance.h"

#include <spdlog/fmt/fmt.h>
#include <sys/resource.h>
#include <unistd.h>

#include <ctime>
#include <fstream>
#include <sstream>

#include "gs_core/version.h"

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
