// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "apps/cli/manual/command.h"

namespace gs {

/// The page NAME.1 of a program or verb, in the macros of man(7). `date` is YYYY-MM-DD.
std::string man_page(const Command& command, const std::string& date);

}  // namespace gs
