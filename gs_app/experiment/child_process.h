// SPDX-License-Identifier: Apache-2.0
// Child processes that run at the same time as this program. To run one program and read its
// output, see gs_core/io/subprocess.h.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/io/subprocess.h"

namespace gs {

/// The file of this program.
std::filesystem::path own_program();

/// Starts a program in its own process group; arguments[0] is its path. Its output is appended to
/// `log`. The child gets SIGTERM when the calling thread ends for any reason. Throws Error. Call it
/// only while this program has a single thread.
pid_t start_child(const std::vector<std::string>& arguments, const std::filesystem::path& log);

struct ChildEnd {
  pid_t process;
  ProcessEnd end;
};

/// The next child that has ended, each child once; nothing if none has.
std::optional<ChildEnd> ended_child();

}  // namespace gs
