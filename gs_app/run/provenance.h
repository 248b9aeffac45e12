// SPDX-License-Identifier: Apache-2.0
// The origin of a run: program, machine and date.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// The commit that this program was built from, with "-dirty" appended if files had changed, or
/// "unknown" without git. scripts/cmake/write_commit.cmake writes it at each build.
const char* built_commit();
bool knows_commit();

/// What nvcc compiled this program. Both are empty in a build without CUDA.
struct CudaBuild {
  std::string_view toolkit;        // its version, such as "12.4.131"
  std::string_view architectures;  // of GPUs, as CMake names them: "80-virtual, 90"
};
CudaBuild built_cuda();

/// "gemsplat 0.1.0, commit 6eb46d6ba3b0, CUDA 12.4.131 for 80-virtual, 90", or "..., without CUDA".
/// A build that does not know its commit names none.
std::string describe_build();

/// The compiler of this program's C++ files: "GCC 12.2.0".
std::string built_compiler();

/// What the source tree held beyond its commit.
struct UncommittedChanges {
  std::string diff;                // as `git diff` prints it, new files included
  std::string hash;                // FNV-1a of the diff, 16 hexadecimal digits
  std::vector<std::string> files;  // that it changes, relative to the source tree
};

/// The changes that this program was built with: the file uncommitted.diff beside it, which each
/// build writes. Nothing if there are none, or if nobody knows: in an installed program, or when
/// the program's file was replaced since it started. Read once.
const std::optional<UncommittedChanges>& uncommitted_changes();

/// The parts of such a diff.
UncommittedChanges changes_of(std::string diff);

/// The command line of this process, the program first.
std::vector<std::string> command_line();

/// The CPU's name as the system reports it, or "unknown".
std::string cpu_name();

/// The version of NVIDIA's driver, read without a call to the driver; empty if there is none.
std::string gpu_driver();

/// Now, as "2026-01-31T12:00:00Z".
std::string utc_date();

/// The host memory that this process holds now (its resident set), in bytes; 0 if the system does
/// not report it.
std::size_t host_bytes();

/// The most host memory that this process has held at once (its peak resident set), in bytes.
std::size_t peak_host_bytes();

}  // namespace gs
