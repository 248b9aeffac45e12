// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "apps/cli/manual/command.h"

namespace gs {

/// docs/reference/commands.md: every verb with all of its options.
std::string reference_page(const Command& program);

}  // namespace gs
