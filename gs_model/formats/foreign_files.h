// SPDX-License-Identifier: Apache-2.0
// Names for files that are no format of ours, so that an error can say what a file is and what to
// do.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// What a file is that no reader takes, and a remedy: "this is an .lcc scene of XGRIDS,
/// not a PLY; convert it to .ply with SuperSplat or splat-transform". Looks at the ending and the
/// first bytes. Empty for a PLY, for something unknown, and where there is no such file.
std::string foreign_kind(const std::filesystem::path& path);

}  // namespace gs
