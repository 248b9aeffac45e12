// SPDX-License-Identifier: Apache-2.0
// Options of other trainers, such as the reference trainer (Inria) and gsplat, that mean the same
// here: they are taken, and nothing shows them.
#pragma once

#include <string>
#include <string_view>

namespace gs {

class OptionList;

/// Adds the hidden options for the settings of `section`, such as --data-dir for "dataset.".
void foreign_options(OptionList& option, std::string_view section);

/// What to give instead of a value that means something to another trainer: "-r 1600, ..." for
/// "dataset.resolution=-1". Empty for all other values.
std::string own_value(std::string_view flag);

}  // namespace gs
