// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace gs {

/// The program's version, as CMake's project() states it.
inline constexpr char kVersion[] = GS_VERSION;

}  // namespace gs
