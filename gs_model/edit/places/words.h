// SPDX-License-Identifier: Apache-2.0
// Numbers in the words of a command line.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "gs_model/edit/select.h"

namespace gs {

/// "1,2,3" as finite numbers, exactly `count` of them. Throws UsageError that begins with `what`.
std::vector<double> numbers_of_list(std::string_view text, std::size_t count,
                                    const std::string& what);

/// "0.1..0.5", "0.1..", "..0.5", or one number, which is both ends. Throws UsageError that begins
/// with `what`, the words "NAME=TEXT".
Interval interval_of(const std::string& what, std::string_view text);

}  // namespace gs
