// SPDX-License-Identifier: Apache-2.0
// What this machine calls itself.
#pragma once

#include <string>

namespace gs {

/// Empty where it is not known.
std::string host_name();

}  // namespace gs
