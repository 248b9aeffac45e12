// SPDX-License-Identifier: Apache-2.0
// Files and folders that the system does not let us read now, which says nothing of their content.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/error.h"

namespace gs {

/// A file or folder that the system does not let us read: the disk fails, too many files are open, a
/// right is missing. Its content may be fine. So nothing may follow from it, as it may from a
/// damaged file, which is an Error of its own.
class AccessError : public Error {
 public:
  explicit AccessError(const std::string& message) : Error(message) {}
};

/// Throws AccessError "cannot read PATH: WHAT".
[[noreturn]] void cannot_access(const std::filesystem::path& path, const std::string& what);

/// The entries of a folder, sorted; none if there is no such folder. Throws AccessError if they
/// cannot be listed: a part of them would look like all.
std::vector<std::filesystem::path> entries_of(const std::filesystem::path& folder);

/// Whether there is a file, or a folder, of that path; false too where the system does not say.
bool is_file(const std::filesystem::path& path);
bool is_folder(const std::filesystem::path& path);

/// Whether something has this path, be it a dangling symbolic link.
bool is_there(const std::filesystem::path& path);

}  // namespace gs
