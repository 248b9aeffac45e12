// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_provenance.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"

namespace gs {
namespace {

// As a shell reads it.
std::string quoted(const std::string& word) {
  const bool is_plain =
      !word.empty() && word.find_first_not_of(
                           "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                           "_./:=,+@%-") == word.npos;
  if (is_plain) return word;
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

}  // namespace

Provenance provenance_of_this_program() {
  std::error_code ignored;
  return {command_line(), std::filesystem::current_path(ignored), uncommitted_changes()};
}

std::string diff_file_name(const UncommittedChanges& changes) {
  return fmt::format("uncommitted-{}.diff", changes.hash);
}

Json provenance_json(const Provenance& provenance) {
  const CudaBuild cuda = built_cuda();
  Json json = {{"command", provenance.command},
               {"folder", provenance.folder.string()},
               {"version", kVersion},
               {"commit", built_commit()},
               {"compiler", built_compiler()},
               {"cuda", cuda.toolkit.empty() ? Json(nullptr) : Json(cuda.toolkit)},
               {"uncommitted", nullptr}};
  if (const auto& changes = provenance.uncommitted)
    json["uncommitted"] = {
        {"hash", changes->hash}, {"files", changes->files}, {"diff", diff_file_name(*changes)}};
  return json;
}

std::string provenance_markdown(const Provenance& provenance) {
  std::vector<std::string> words;
  for (const std::string& word : provenance.command) words.push_back(quoted(word));
  std::string text = fmt::format("- command: `{}`, in `{}`\n- tables by {}, compiled by {}\n",
                                 fmt::join(words, " "), provenance.folder.string(),
                                 describe_build(), built_compiler());
  if (const auto& changes = provenance.uncommitted)
    text += fmt::format("- uncommitted changes {} in {}: `{}`\n", changes->hash,
                        diff_file_name(*changes), fmt::join(changes->files, "`, `"));
  return text;
}

}  // namespace gs
