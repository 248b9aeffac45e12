// SPDX-License-Identifier: Apache-2.0
// Where an experiment's tables come from: the command, the build and its uncommitted changes.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/run/provenance.h"
#include "gs_core/system/text/json.h"

namespace gs {

struct Provenance {
  std::vector<std::string> command;  // of this process
  std::filesystem::path folder;      // that it runs in
  std::optional<UncommittedChanges> uncommitted;
};

Provenance provenance_of_this_program();

/// The name in the experiment's folder of the file with these changes: a name for each text, so
/// that those of an earlier build are kept.
std::string diff_file_name(const UncommittedChanges& changes);

/// {"command": [...], "folder", "version", "commit", "compiler", "cuda", "uncommitted": {"hash",
/// "files": [...], "diff"}}. "cuda" is null in a build without CUDA, "uncommitted" where there is
/// nothing or nothing is known.
Json provenance_json(const Provenance& provenance);

/// The same as a list.
std::string provenance_markdown(const Provenance& provenance);

}  // namespace gs
