// SPDX-License-Identifier: Apache-2.0
// Files that come from the page, piece by piece. What has arrived stays in .upload/ beside the
// project's input until a file is whole, so that an upload goes on after anything that interrupts it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>

namespace gs {

/// What a project may take up.
struct UploadLimits {
  std::uint64_t bytes = std::uint64_t(200) << 30;
  std::uint64_t free_bytes = std::uint64_t(1) << 30;  // that the disk keeps
  std::size_t files = 20'000;
};

struct UploadState {
  std::uint64_t bytes = 0;  // that are there
  bool is_whole = false;    // the file has its name
};

class Uploads {
 public:
  /// Files go below project/input.
  explicit Uploads(std::filesystem::path project, UploadLimits limits = {});

  /// How much of a file of `of` bytes is there. Throws UsageError for a name that is not safe
  /// (safe_path()), and where a file of another size has it.
  UploadState state(const std::string& name, std::uint64_t of);
  /// Appends bytes that begin at `at`; bytes that begin elsewhere are passed over. A whole file gets
  /// its name; a zip archive is unpacked. Throws Error, a line for the page, beyond the limits and
  /// where the disk is full; what has arrived stays.
  UploadState take(const std::string& name, std::uint64_t at, std::uint64_t of,
                   const std::string& bytes);

 private:
  struct Use {
    std::uint64_t bytes = 0;
    std::size_t files = 0;
  };
  std::filesystem::path part_of(const std::filesystem::path& path, std::uint64_t of) const;
  void count();
  void check_room(std::uint64_t more_bytes, std::size_t more_files) const;
  void unpack(const std::filesystem::path& archive);

  const std::filesystem::path input_, parts_;
  const UploadLimits limits_;
  std::mutex mutex_;
  std::optional<Use> use_;
};

}  // namespace gs
