// SPDX-License-Identifier: Apache-2.0
// What this machine calls itself.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// Empty where it is not known.
std::string host_name();

/// Under which other machines reach this one: its IPv4 addresses but loopback.
std::vector<std::string> own_addresses();

}  // namespace gs
