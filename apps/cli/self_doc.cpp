// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/self_doc.h"

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>

#include "apps/cli/manual/completions.h"
#include "apps/cli/manual/man_page.h"
#include "apps/cli/manual/reference_page.h"
#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

struct SelfDocCommand {
  std::string folder;
  bool replace = false, markdown = false;
};

// Today, or the day that SOURCE_DATE_EPOCH names: the same sources then make the same pages.
std::string date() {
  std::time_t seconds = std::time(nullptr);
  if (const char* epoch = std::getenv("SOURCE_DATE_EPOCH")) {
    char* end = nullptr;
    seconds = std::strtoll(epoch, &end, 10);
    if (end == epoch || *end != '\0')
      throw Error("SOURCE_DATE_EPOCH is '" + std::string(epoch) +
                      "'; it takes seconds since 1970, such as `git log -1 --format=%ct` prints",
                  ExitCode::usage);
  }
  std::ostringstream text;
  std::tm day{};
  text << std::put_time(gmtime_r(&seconds, &day), "%Y-%m-%d");
  return text.str();
}

using Files = std::map<fs::path, std::string>;  // below the folder; with their text

void add_pages(Files& files, const Command& command, const std::string& date) {
  files["man/man1/" + command.joined_words("-") + ".1"] = man_page(command, date);
  for (const Command& verb : command.verbs) add_pages(files, verb, date);
}

void write_files(const SelfDocCommand& command, const Files& files) {
  for (const auto& [name, text] : files)
    if (const fs::path path = command.folder / name; !command.replace && fs::exists(path))
      throw Error(path.string() + " exists; --replace replaces it and what else is written");
  for (const auto& [name, text] : files) {
    AtomicFile file(command.folder / name);
    file.write(text);
    file.commit(AtomicFile::Durability::unsynced);
  }
}

}  // namespace

void add_self_doc(CLI::App& program, const std::vector<Verb>& verbs) {
  CLI::App& verb = *program.add_subcommand("self-doc", "Write man pages and completions");
  const auto command = std::make_shared<SelfDocCommand>();
  verb.add_option("folder", command->folder,
                  "gets man/, bash-completion/, zsh/ and fish/, as /usr/share has them")
      ->type_name("FOLDER");
  verb.add_flag("--replace", command->replace, "replace files that an earlier call has written");
  verb.add_flag("--markdown", command->markdown,
                "print docs/reference/commands.md, and do nothing else");
  verb.callback([command, verbs] {
    const Command all = command_of(verbs);
    if (command->markdown) {
      std::cout << reference_page(all);
      return;
    }
    if (command->folder.empty())
      throw UsageError("FOLDER is missing: it gets man/, bash-completion/, zsh/ and fish/");
    Files files = {{"bash-completion/completions/gemsplat", bash_completion(all)},
                   {"zsh/site-functions/_gemsplat", zsh_completion(all)},
                   {"fish/vendor_completions.d/gemsplat.fish", fish_completion(all)}};
    add_pages(files, all, date());
    write_files(*command, files);
  });
}

}  // namespace gs
