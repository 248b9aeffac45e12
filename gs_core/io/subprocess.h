// SPDX-License-Identifier: Apache-2.0
// Another program, run to its end: no shell between, its output line by line to us and whole to a log.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// The file that `name` runs: itself if it has a '/', else the first of that name on the PATH; nothing if no
/// such file may be run.
std::optional<std::filesystem::path> find_program(const std::string& name);

/// How a program ended.
struct ProcessEnd {
  int exit_code = 0;  // where `signal` is 0
  int signal = 0;     // the one that killed it
  bool good() const { return exit_code == 0 && signal == 0; }
};

using LineVisitor = std::function<void(std::string_view line)>;

/// Runs `arguments` (the program first) with standard output and error in one pipe: every line goes to
/// `on_line`, every byte to the end of `log` (an empty path: to no file). Our SIGINT or SIGTERM ends the
/// program, a second one kills it; then, and when the program cannot be started, throws Error. One at a time.
ProcessEnd run_process(const std::vector<std::string>& arguments, const std::filesystem::path& log,
                       const LineVisitor& on_line);

}  // namespace gs
