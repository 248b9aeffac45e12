// SPDX-License-Identifier: Apache-2.0
// Units of memory.
#pragma once

namespace gs {

inline constexpr double kBytesPerGib = 1024.0 * 1024.0 * 1024.0;

}  // namespace gs
