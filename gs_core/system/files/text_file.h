// SPDX-License-Identifier: Apache-2.0
// Small text files as one string, with a limit of their size.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace gs {

/// The bytes of a regular file that has at most `most_bytes`. A pipe that the shell made for this
/// program (`-c <(...)`, /dev/stdin) is read, too, and gives the same text at each call; other pipes
/// and devices are refused, since reading them may never end. Throws Error, which names the file.
std::string read_text_file(const std::filesystem::path& path, std::uint64_t most_bytes);

/// Whether the path is such a pipe, which lies in no folder of the user's.
bool is_pipe_of_shell(const std::filesystem::path& path);

}  // namespace gs
