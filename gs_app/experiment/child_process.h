// SPDX-License-Identifier: Apache-2.0
// Programs that run beside this one, several at a time. For one program whose output is read: subprocess.h.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/io/subprocess.h"

namespace gs {

/// This program's own file.
std::filesystem::path own_program();

/// Starts `arguments` (the program first, a path) in a process group of its own, its output at the end of `log`. When the
/// thread that called ends, however it does, the child gets SIGTERM. Throws Error. Call from a program with one thread.
pid_t start_child(const std::vector<std::string>& arguments, const std::filesystem::path& log);

struct ChildEnd {
  pid_t process;
  ProcessEnd end;
};

/// A child that has ended, not told before; nothing where none has.
std::optional<ChildEnd> ended_child();

}  // namespace gs
