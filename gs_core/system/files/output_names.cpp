// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/output_names.h"

#include "gs_core/error.h"
#include "gs_core/system/files/move_aside.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// By what two names of one place are known.
fs::path identity_of(const fs::path& path) {
  const fs::path whole = fs::weakly_canonical(fs::absolute(path));
  return whole.has_filename() ? whole : whole.parent_path();  // "tiles/"
}

[[noreturn]] void refuse_second(const fs::path& name) {
  throw UsageError(name.string() +
                   " is named twice, and one output would overwrite the other; give each a name "
                   "of its own");
}

[[noreturn]] void refuse_inside(const fs::path& inner, const fs::path& outer) {
  throw UsageError(inner.string() + " lies in " + outer.string() +
                   ", which this command fills by itself; name a place outside of it");
}

}  // namespace

void OutputNames::add_file(const fs::path& file) {
  if (folders_.contains(identity_of(file)) || !files_.insert(identity_of(file)).second)
    refuse_second(file);
  for (const fs::path& folder : folders_)
    if (is_within(file, folder)) refuse_inside(file, folder);
}

void OutputNames::add_folder(const fs::path& folder) {
  if (files_.contains(identity_of(folder)) || folders_.contains(identity_of(folder)))
    refuse_second(folder);
  for (const fs::path& file : files_)
    if (is_within(file, folder)) refuse_inside(file, folder);
  for (const fs::path& other : folders_) {
    if (is_within(other, folder)) refuse_inside(other, folder);
    if (is_within(folder, other)) refuse_inside(folder, other);
  }
  folders_.insert(identity_of(folder));
}

}  // namespace gs
