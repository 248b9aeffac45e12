// SPDX-License-Identifier: Apache-2.0
// The files and folders that one command writes, so that none of them is written over another.
#pragma once

#include <filesystem>
#include <set>

namespace gs {

/// Symbolic links are followed, so that two names of one file count as one.
class OutputNames {
 public:
  /// Throws UsageError if the file is one of the names already, or lies in a folder of them.
  void add_file(const std::filesystem::path& file);
  /// Takes the name of a folder that the command makes and fills as a whole.
  void add_folder(const std::filesystem::path& folder);

 private:
  std::set<std::filesystem::path> files_, folders_;
};

}  // namespace gs
