// SPDX-License-Identifier: Apache-2.0
// What values an option takes, for those who give values and not words of a command line.
#pragma once

#include "gs_app/jobs/parts/job.h"

namespace gs {

/// "bool", "int", "float" or "text".
std::string kind_of(const Option& option);
/// All words that text can be, or all numbers; empty: others, too.
std::vector<std::string> choices_of(const Option& option);
/// Whether it takes a list, too.
bool takes_list(const Option& option);
/// Whether a number lies in the option's range.
bool allows(const Option& option, double number);
/// What stands in the request before it is filled; null where that is no value to give.
Json default_of(const Option& option);
/// "a whole number from 1 to 64", "merge or drop", "text".
std::string what_it_takes(const Option& option);

}  // namespace gs
