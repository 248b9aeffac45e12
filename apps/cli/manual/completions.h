// SPDX-License-Identifier: Apache-2.0
// Scripts that let a shell complete the program's verbs, flags and values.
#pragma once

#include <string>

#include "apps/cli/manual/command.h"

namespace gs {

std::string bash_completion(const Command& program);
std::string zsh_completion(const Command& program);
std::string fish_completion(const Command& program);

}  // namespace gs
