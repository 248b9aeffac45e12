// SPDX-License-Identifier: Apache-2.0
// Another program, run to its end: its output line by line to us, and whole to a log.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "gs_core/system/processes/process.h"

namespace gs {

using LineVisitor = std::function<void(std::string_view line)>;

/// Runs `arguments` (the program first) with standard output and error in one pipe. Every line goes
/// to `on_line`, every byte to the end of `log`; an empty path means no log. A SIGINT or SIGTERM
/// that this program gets ends the other one, a second one kills it, and Error is thrown; so it is
/// if the program cannot be started. One call at a time.
ProcessEnd run_process(const std::vector<std::string>& arguments, const std::filesystem::path& log,
                       const LineVisitor& on_line);

}  // namespace gs
